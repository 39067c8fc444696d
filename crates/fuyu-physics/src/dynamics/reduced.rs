//! Reduced inertia, kinetic energy, and the reduced form as one of the formulations.

use nalgebra::{DMatrix, Vector3};

use super::{Formulation, Input, TreeAcceleration, TreeMotion, Workspace, checks};
use crate::model::Model;
use crate::spatial::Wrench;

/// Forward dynamics of the reduced system: [`Workspace::accelerations`], with the base eliminated.
#[derive(Debug, Clone)]
pub struct Reduced {
    workspace: Workspace,
}

impl Reduced {
    /// The formulation for `model`. Allocates; evaluations do not.
    pub fn new(model: &Model) -> Self {
        Self {
            workspace: Workspace::new(model),
        }
    }
}

impl Formulation for Reduced {
    fn accelerations(&mut self, motion: &TreeMotion, input: &Input, out: &mut TreeAcceleration) {
        let workspace = &mut self.workspace;
        checks::formulation(motion, input, out, &workspace.model);
        workspace.set_positions_from(motion.q);
        workspace.bodies[0].twist = motion.V_WB_B;
        workspace.propagate_motion(motion.qd);
        workspace.solve(motion.q, motion.qd, input, &mut out.qdd);
        workspace.set_accelerations(&out.qdd);
        out.A_WB_B = workspace.bodies[0].acceleration;
    }
}

impl Workspace {
    /// Reduced inertia `Ĥ` (n × n): joint-space inertia with a free base. Masutani 1995 eq. (4.48), with `H_q` of eq.
    /// (4.46) from composite inertias.
    pub fn reduced_inertia(&mut self) -> &DMatrix<f64> {
        self.set_reduced_inertia();
        self.reduced.fill_lower_triangle_with_upper_triangle();
        &self.reduced
    }

    /// Fills the upper triangle of `Ĥ`.
    pub(super) fn set_reduced_inertia(&mut self) {
        if self.model.has_mimics() {
            self.gather_reduced_inertia();
            return;
        }
        let mut reduced = std::mem::replace(&mut self.reduced, DMatrix::zeros(0, 0));
        self.fill_reduced_inertia(&mut reduced);
        self.reduced = reduced;
    }

    /// `Sᵀ Ĥ S` ([`crate::model::Coupling`]) from `Ĥ` of all joints of the tree.
    fn gather_reduced_inertia(&mut self) {
        let mut tree = std::mem::replace(&mut self.tree_reduced, DMatrix::zeros(0, 0));
        self.fill_reduced_inertia(&mut tree);
        for j in 0..self.reduced.ncols() {
            for i in 0..=j {
                let mut sum = 0.0;
                for &(k, of_k) in self.model.members(i) {
                    for &(l, of_l) in self.model.members(j) {
                        sum += of_k * of_l * tree[(k.min(l), k.max(l))];
                    }
                }
                self.reduced[(i, j)] = sum;
            }
        }
        self.tree_reduced = tree;
    }

    /// Fills the upper triangle of `Ĥ` of all joints of the tree.
    fn fill_reduced_inertia(&self, reduced: &mut DMatrix<f64>) {
        let n = self.tree.dof();
        for j in 0..n {
            let column = self.joints.column(j);
            // Momentum of the free-floating system due to joint j alone. With it, the base's contribution to every pair
            // (i, j) is one dot product: m J_Cᵀ J_C + H_Mᵀ H_B⁻¹ H_M.
            let (mut torque, force) = (
                column.angular_momentum.0.into(),
                Vector3::from(column.linear_momentum.0),
            );
            let answer = Vector3::from(column.H_A.0);
            let entries = &mut reduced.as_mut_slice()[j * n..=j * n + j];
            for (i, entry) in entries.iter_mut().enumerate() {
                let other = self.joints.column(i);
                let (H_M, J_C) = (Vector3::from(other.H_M.0), Vector3::from(other.J_C.0));
                *entry = H_M.dot(&answer) - J_C.dot(&force);
            }
            // Effort that the motion of joint j's subtree requires of each joint that supports it.
            let mut i = j;
            loop {
                let taken = self.axis(i).effort(&Wrench { torque, force });
                reduced.as_mut_slice()[j * n + i] += taken;
                let parent = self.tree.joints[i].parent;
                if parent == 0 {
                    break;
                }
                torque += self.p_PK(i).cross(&force);
                i = parent - 1;
            }
        }
    }

    /// Kinetic energy \[J\] as the sum over bodies of Masutani 1995 eq. (4.44), from their twists
    /// (needs [`Workspace::set_motion`]).
    pub fn kinetic_energy(&self) -> f64 {
        let bodies = self.model.bodies().iter().enumerate();
        let twice: f64 = bodies
            .map(|(b, body)| {
                let (X_0B, inertia) = (self.X_0B(b), &body.inertia);
                let w = X_0B.rotation.inverse() * self.bodies[b].twist.angular;
                let v = self.v_com(b, &X_0B, inertia);
                inertia.mass * v.norm_squared() + w.dot(&(inertia.about_com * w))
            })
            .sum();
        0.5 * twice
    }
}
