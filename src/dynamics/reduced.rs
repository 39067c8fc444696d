//! Reduced inertia, kinetic energy, and the reduced form as one of the formulations.

use nalgebra::DMatrix;

use super::{Formulation, Input, TreeAcceleration, TreeMotion, Workspace};
use crate::model::Model;
use crate::spatial::Wrench;

/// Forward dynamics of the reduced system: [`Workspace::accelerations`], with the base eliminated.
#[derive(Debug, Clone)]
pub struct Reduced {
    workspace: Workspace,
}

impl Reduced {
    /// Scratch for `model`; the only place where memory is taken.
    pub fn new(model: &Model) -> Self {
        Self {
            workspace: Workspace::new(model),
        }
    }
}

impl Formulation for Reduced {
    fn accelerations(
        &mut self,
        model: &Model,
        motion: &TreeMotion,
        input: &Input,
        out: &mut TreeAcceleration,
    ) {
        let workspace = &mut self.workspace;
        workspace.place(model, motion.q);
        workspace.bodies[0].twist = motion.V_WB_B;
        workspace.spread_motion(motion.qd);
        workspace.solve(model, motion.q, motion.qd, input, &mut out.qdd);
        workspace.set_accelerations(&out.qdd);
        out.A_WB_B = workspace.bodies[0].acceleration;
    }
}

impl Workspace {
    /// Reduced inertia `Ĥ` (n × n): inertia that the joints feel when the base is free.
    /// Masutani 1995 eq. (4.48); `H_q` of eq. (4.46) by composite bodies.
    pub fn reduced_inertia(&mut self) -> &DMatrix<f64> {
        self.set_reduced_inertia();
        self.reduced.fill_lower_triangle_with_upper_triangle();
        &self.reduced
    }

    /// Fills the upper triangle of `Ĥ`.
    pub(super) fn set_reduced_inertia(&mut self) {
        let n = self.joints.len();
        let reduced = self.reduced.as_mut_slice();
        for (j, joint) in self.joints.iter().enumerate() {
            let column = &mut reduced[j * n..=j * n + j];
            // The momentum that joint j alone gives to the free-floating system, in terms of which the
            // base's share of every pair (i, j) is one dot product: m J_Cᵀ J_C + H_Mᵀ H_B⁻¹ H_M.
            let Wrench { mut torque, force } = joint.momentum;
            for (entry, other) in column.iter_mut().zip(&self.joints) {
                *entry = other.H_M.dot(&joint.H_A) - other.J_C.dot(&force);
            }
            // What joint j's subtree takes of each joint that carries it.
            let mut i = j;
            loop {
                let carrier = &self.joints[i];
                column[i] += carrier.axis.effort(&Wrench { torque, force });
                if carrier.parent == 0 {
                    break;
                }
                torque += self.bodies[i + 1].p_PB.cross(&force);
                i = carrier.parent - 1;
            }
        }
    }

    /// Kinetic energy \[J\] as the sum over bodies of Masutani 1995 eq. (4.44), from their twists
    /// (needs [`Workspace::set_motion`]).
    pub fn kinetic_energy(&self, model: &Model) -> f64 {
        let twice: f64 = (model.bodies().iter().zip(&self.bodies))
            .map(|(body, terms)| {
                let w_B = terms.R_0B.tr_mul(&terms.twist.angular);
                let v_com = terms.v_com(&body.inertia);
                body.inertia.mass * v_com.norm_squared() + w_B.dot(&(body.inertia.about_com * w_B))
            })
            .sum();
        0.5 * twice
    }
}
