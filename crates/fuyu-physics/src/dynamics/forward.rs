//! Forward dynamics of the reduced system.

use nalgebra::{DVector, Vector3};

use super::{State, Workspace, checks};
use crate::model::{Frame, Model};
use crate::spatial::{Twist, Wrench};

/// Joint efforts and external wrenches on a robot.
#[derive(Debug, Clone, PartialEq)]
pub struct Input {
    /// Joint efforts of the actuators \[N m or N\], `τ` of Masutani 1995 eq. (4.49).
    pub efforts: DVector<f64>,
    /// External wrench on each body, about the body frame's origin in the body's axes.
    pub wrenches: Vec<Wrench>,
}

impl Input {
    /// No efforts and no wrenches.
    pub fn zero(model: &Model) -> Self {
        Self {
            efforts: DVector::zeros(model.dof()),
            wrenches: vec![Wrench::ZERO; model.bodies().len()],
        }
    }

    /// Copies `other`'s values without allocating.
    ///
    /// # Panics
    /// If the two are not for the same number of joints and bodies.
    pub fn copy_from(&mut self, other: &Self) {
        self.efforts
            .as_mut_slice()
            .copy_from_slice(other.efforts.as_slice());
        self.wrenches.copy_from_slice(&other.wrenches);
    }
}

impl Workspace {
    /// Joint accelerations \[rad/s² or m/s²\] of the reduced system, `Ĥ q̈ = τ - C q̇ - bias`:
    /// Masutani 1995 eq. (4.49) (whose second term lost a dot in print: `dĤ/dt + C`), extended to
    /// non-zero momentum and external wrenches. Positions and motion of `state` must be set.
    ///
    /// The bias is computed by recursive Newton-Euler with the base at its true twist and zero acceleration; the base's
    /// reaction to the bias is then eliminated like its inertia.
    ///
    /// # Panics
    /// If a length does not fit the robot.
    pub fn accelerations(&mut self, state: &State, input: &Input, qdd: &mut DVector<f64>) {
        checks::state(state, &self.model);
        checks::input(input, &self.model);
        checks::joint_vector("qdd", qdd.len(), &self.model);
        let (q, qd) = (state.q.as_slice(), state.qd.as_slice());
        self.solve(q, qd, input, qdd);
    }

    /// [`Workspace::accelerations`] from slices.
    pub(super) fn solve(&mut self, q: &[f64], qd: &[f64], input: &Input, qdd: &mut DVector<f64>) {
        self.set_bias_forces(input);
        let (force, torque) = self.base_reaction();
        let acting = input.efforts.as_slice().iter().zip(q.iter().zip(qd));
        let rhs = qdd.as_mut_slice();
        for (j, (rhs, (effort, (q, qd)))) in rhs.iter_mut().zip(acting).enumerate() {
            let column = self.column(j);
            let (J_C, H_A) = (Vector3::from(column.J_C.0), Vector3::from(column.H_A.0));
            let bias = self.joint_effort(j) - J_C.dot(&force) + H_A.dot(&torque);
            *rhs = effort + self.model.joints()[j].passive_effort(*q, *qd) - bias;
        }
        self.set_reduced_inertia();
        solve_positive_definite(self.reduced.as_mut_slice(), qdd.as_mut_slice());
    }

    /// Effort along coordinate `j` that the bias forces on the subtrees require.
    fn joint_effort(&self, j: usize) -> f64 {
        let of_joint = |k: usize| self.axis(k).effort(&self.bodies[k + 1].force);
        if !self.model.has_mimics() {
            return of_joint(j);
        }
        let members = self.model.members(j).iter();
        members.map(|&(k, ratio)| ratio * of_joint(k)).sum()
    }

    /// Computes the force of Newton's and Euler's equations on every body at its bias acceleration, minus the external
    /// wrenches, and sums from the tips: `force[b]` becomes the force on body `b`'s subtree.
    fn set_bias_forces(&mut self, input: &Input) {
        for (b, wrench) in input.wrenches.iter().enumerate() {
            let inertia = self.tree.bodies[b].inertia.rotated(&self.R_BK(b));
            let X_0B = (*wrench != Wrench::ZERO).then(|| self.X_0B(b));
            let origin = self.p_BK(b);
            let body = &mut self.bodies[b];
            let (w, bias, h) = (&body.twist.angular, &body.bias, &inertia.first_moment);
            body.force = Wrench {
                torque: &inertia.about_origin * bias.angular
                    + w.cross(&(&inertia.about_origin * *w))
                    + h.cross(&bias.linear),
                force: bias.linear * inertia.mass + bias.angular.cross(h) + w.cross(&w.cross(h)),
            };
            if let Some(X_0B) = X_0B {
                let wrench = wrench.shifted_to_parent(&X_0B).shifted(&-origin);
                body.force -= wrench;
            }
        }
        for j in (0..self.tree.dof()).rev() {
            let p_PK = self.p_PK(j);
            let (earlier, rest) = self.bodies.split_at_mut(j + 1);
            earlier[self.tree.joints[j].parent].force += rest[0].force.shifted(&p_PK);
        }
    }

    /// Sums the external wrenches and their power. If there are any, computes the motion of all bodies first.
    pub(super) fn set_external(&mut self, input: &Input, qd: &[f64]) {
        self.external = Wrench::ZERO;
        self.external_power = 0.0;
        if !Wrench::any(&input.wrenches) {
            return;
        }
        self.propagate_motion(qd);
        for (b, wrench) in input.wrenches.iter().enumerate() {
            if *wrench != Wrench::ZERO {
                let origin = self.p_BK(b);
                let wrench = wrench.shifted_to_parent(&self.X_0B(b)).shifted(&-origin);
                self.external += wrench.shifted(&(origin - self.p_BC));
                self.external_power += self.bodies[b].twist.dot(&wrench);
            }
        }
    }

    /// Force and torque (about the centre of mass) that the whole system's bias motion requires.
    fn base_reaction(&self) -> (Vector3<f64>, Vector3<f64>) {
        let at_com = self.bodies[0].force.shifted(&-self.p_BC);
        (at_com.force, at_com.torque)
    }

    /// Computes the accelerations of the base and then of all bodies from joint accelerations `qdd`, after
    /// [`Workspace::accelerations`] for the same state. [`Workspace::A_WF_B`] reads them.
    ///
    /// # Panics
    /// If `qdd` does not have one element per joint.
    pub fn set_accelerations(&mut self, qdd: &DVector<f64>) {
        checks::joint_vector("qdd", qdd.len(), &self.model);
        let (force, mut torque) = self.base_reaction();
        let mut a_com = -force / self.mass;
        for (j, qdd) in qdd.as_slice().iter().enumerate() {
            let column = self.column(j);
            torque += Vector3::from(column.H_M.0) * *qdd;
            a_com -= Vector3::from(column.J_C.0) * *qdd;
        }
        let angular = -(&self.H_B_inverse * torque);
        let base = Twist::new(angular, a_com - angular.cross(&self.p_BC));
        self.propagate_accelerations(base, qdd.as_slice());
    }

    /// Accelerations of all bodies from the base's and the joints'.
    pub(super) fn propagate_accelerations(&mut self, base: Twist, qdd: &[f64]) {
        self.bodies[0].acceleration = base;
        self.with_tree_rates(qdd, |workspace, qdd| {
            for (j, &qdd) in qdd.iter().enumerate() {
                let (p_PK, own) = (workspace.p_PK(j), workspace.axis(j).twist(qdd));
                let (earlier, rest) = workspace.bodies.split_at_mut(j + 1);
                let (parent, body) = (&earlier[workspace.tree.joints[j].parent], &mut rest[0]);
                // The acceleration in excess of the bias propagates from body to body like a twist.
                let mut added = parent.acceleration - parent.bias;
                added.linear += added.angular.cross(&p_PK);
                body.acceleration = body.bias + added + own;
            }
        });
    }

    /// Acceleration of `frame` in the world, components in the base's axes: angular \[rad/s²\], and of the frame's
    /// origin as a point \[m/s²\] (needs [`Workspace::set_accelerations`]).
    pub fn A_WF_B(&self, frame: &Frame) -> Twist {
        let r = self.p_KF(frame);
        let body = &self.bodies[frame.body];
        let (a, w) = (&body.acceleration, &body.twist.angular);
        let linear = a.linear + a.angular.cross(&r) + w.cross(&w.cross(&r));
        Twist::new(a.angular, linear)
    }
}

/// Solves `a x = b` in place by `L D Lᵀ`, where column `i` of `a` holds row `i` of the lower triangle. At the sizes of
/// robot arms this is several times as fast as a general factorization of a dynamic matrix. The result is NaN if `a`
/// is not positive definite, which can only come from positions that are not finite.
fn solve_positive_definite(a: &mut [f64], b: &mut [f64]) {
    let n = b.len();
    for i in 0..n {
        let (known, rest) = a.split_at_mut(i * n);
        let row = &mut rest[..=i];
        // L D of this row; the rows above contain L, and 1/D on the diagonal.
        for j in 1..i {
            let above = &known[j * n..j * n + j];
            let mut entry = row[j];
            for (l, ld) in above.iter().zip(&*row) {
                entry -= l * ld;
            }
            row[j] = entry;
        }
        let (row, pivot) = row.split_at_mut(i);
        let (mut d, mut z) = (pivot[0], b[i]);
        for (j, (entry, z_j)) in row.iter_mut().zip(&*b).enumerate() {
            let l = *entry * known[j * n + j];
            d -= l * *entry;
            z -= *entry * z_j;
            *entry = l;
        }
        pivot[0] = if d > 0.0 { 1.0 / d } else { f64::NAN };
        b[i] = z * pivot[0];
    }
    for i in (1..n).rev() {
        let (earlier, x) = b.split_at_mut(i);
        for (b, l) in earlier.iter_mut().zip(&a[i * n..]) {
            *b -= l * x[0];
        }
    }
}
