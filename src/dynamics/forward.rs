//! Forward dynamics of the reduced system.

use nalgebra::{DVector, Vector3};

use super::{State, Workspace};
use crate::model::{Frame, Model};
use crate::spatial::{Twist, Wrench};

/// What acts on the robot: joint efforts and external wrenches.
#[derive(Debug, Clone, PartialEq)]
pub struct Input {
    /// Joint efforts of the actuators \[N m or N\], `τ` of Masutani 1995 eq. (4.49).
    pub efforts: DVector<f64>,
    /// External wrench on each body, about the body frame's origin in the body's axes.
    pub wrenches: Vec<Wrench>,
}

impl Input {
    /// Nothing acts.
    pub fn zero(model: &Model) -> Self {
        Self {
            efforts: DVector::zeros(model.dof()),
            wrenches: vec![Wrench::ZERO; model.bodies().len()],
        }
    }

    /// Takes over `other`'s values without allocating; both must be of the same model.
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
    /// non-zero momentum and external wrenches. Needs positions and motion of `state`; `qdd` has
    /// length n.
    ///
    /// The bias is found with the base moving at its true twist and held at zero acceleration
    /// (recursive Newton-Euler); the base's reaction to it is then eliminated like its inertia.
    pub fn accelerations(
        &mut self,
        model: &Model,
        state: &State,
        input: &Input,
        qdd: &mut DVector<f64>,
    ) {
        self.set_bias_forces(input);
        let (force, torque) = self.base_reaction();
        let motion = state.q.as_slice().iter().zip(state.qd.as_slice());
        let acting = input.efforts.as_slice().iter().zip(motion);
        let moved = (model.joints().iter().zip(&self.joints)).zip(&self.bodies[1..]);
        let rhs = qdd.as_mut_slice();
        for ((rhs, (effort, (q, qd))), ((joint, terms), body)) in
            rhs.iter_mut().zip(acting).zip(moved)
        {
            let bias =
                terms.axis.effort(&body.force) - terms.J_C.dot(&force) + terms.H_A.dot(&torque);
            *rhs = effort + joint.passive_effort(*q, *qd) - bias;
        }
        self.set_reduced_inertia();
        solve_positive_definite(self.reduced.as_mut_slice(), qdd.as_mut_slice());
    }

    /// Newton's and Euler's equations of every body at its bias acceleration, external wrenches taken
    /// off, then summed from the tips: `force[b]` becomes what moves body `b`'s subtree.
    fn set_bias_forces(&mut self, input: &Input) {
        self.external = Wrench::ZERO;
        self.external_power = 0.0;
        for (body, wrench) in self.bodies.iter_mut().zip(&input.wrenches) {
            let (w, bias, inertia) = (&body.twist.angular, &body.bias, &body.inertia);
            let h = &inertia.first_moment;
            body.force = Wrench {
                torque: &inertia.about_origin * bias.angular
                    + w.cross(&(&inertia.about_origin * *w))
                    + h.cross(&bias.linear),
                force: bias.linear * inertia.mass + bias.angular.cross(h) + w.cross(&w.cross(h)),
            };
            if *wrench != Wrench::ZERO {
                let wrench = Wrench::new(body.R_0B * wrench.torque, body.R_0B * wrench.force);
                body.force -= wrench;
                self.external += wrench.shifted(&(body.p_0B - self.p_BC));
                self.external_power += body.twist.dot(&wrench);
            }
        }
        for (j, joint) in self.joints.iter().enumerate().rev() {
            let (earlier, rest) = self.bodies.split_at_mut(j + 1);
            earlier[joint.parent].force += rest[0].force.shifted(&rest[0].p_PB);
        }
    }

    /// Force that the whole system's bias motion takes, and torque about its centre of mass.
    fn base_reaction(&self) -> (Vector3<f64>, Vector3<f64>) {
        let at_com = self.bodies[0].force.shifted(&-self.p_BC);
        (at_com.force, at_com.torque)
    }

    /// Base acceleration that goes with joint accelerations `qdd` (after [`Workspace::accelerations`] for
    /// the same state), then every body's: afterwards [`Workspace::A_WF_B`] can be read.
    pub fn set_accelerations(&mut self, qdd: &DVector<f64>) {
        let (force, mut torque) = self.base_reaction();
        let mut a_com = -force / self.mass;
        for (joint, qdd) in self.joints.iter().zip(qdd.as_slice()) {
            torque += joint.H_M * *qdd;
            a_com -= joint.J_C * *qdd;
        }
        let angular = -(&self.H_B_inverse * torque);
        self.bodies[0].acceleration = Twist::new(angular, a_com - angular.cross(&self.p_BC));
        for (j, (joint, &qdd)) in self.joints.iter().zip(qdd.as_slice()).enumerate() {
            let (earlier, rest) = self.bodies.split_at_mut(j + 1);
            let (parent, body) = (&earlier[joint.parent], &mut rest[0]);
            // What base and joints add to the bias acceleration spreads from body to body as a twist.
            let mut added = parent.acceleration - parent.bias;
            added.linear += added.angular.cross(&body.p_PB);
            body.acceleration = body.bias + added + joint.axis.twist(qdd);
        }
    }

    /// Acceleration of `frame` in the world, components in the base's axes: angular \[rad/s²\] and that of
    /// the frame's origin as a point \[m/s²\] (needs [`Workspace::set_accelerations`]).
    pub fn A_WF_B(&self, frame: &Frame) -> Twist {
        let body = &self.bodies[frame.body];
        let (a, w) = (&body.acceleration, &body.twist.angular);
        let r = body.R_0B * frame.X_BF.translation.vector;
        let linear = a.linear + a.angular.cross(&r) + w.cross(&w.cross(&r));
        Twist::new(a.angular, linear)
    }
}

/// Solves `a x = b` in place by `L D Lᵀ`, where column `i` of `a` holds row `i` of the lower triangle. A
/// general factorization of a dynamic matrix costs several times as much at the sizes of robot arms. A
/// matrix that is not positive definite (positions that are not finite: every physical model has a
/// positive definite `Ĥ`) gives values that are not finite.
fn solve_positive_definite(a: &mut [f64], b: &mut [f64]) {
    let n = b.len();
    for i in 0..n {
        let (known, rest) = a.split_at_mut(i * n);
        let row = &mut rest[..=i];
        // L D of this row; rows above hold L, and 1/D on the diagonal.
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
