//! Forward dynamics of the reduced system.

use nalgebra::{DMatrix, DVector};

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
}

impl Input {
    /// Takes over `other`'s values without allocating; both must be of the same model.
    pub fn copy_from(&mut self, other: &Self) {
        self.efforts.copy_from(&other.efforts);
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
        self.set_bias_forces(model, &state.qd, input);
        let base_force = self.force[0].force;
        let base_torque = self.force[0].torque - self.p_BC.cross(&base_force);
        for (j, joint) in model.joints().iter().enumerate() {
            let bias = self.axes[j].dot(&self.force[j + 1]) - self.J_C[j].dot(&base_force)
                + self.H_A[j].dot(&base_torque);
            self.rhs[j] = input.efforts[j] - joint.damping * state.qd[j] - bias;
        }
        self.set_reduced_inertia();
        solve_positive_definite(&mut self.reduced, &mut self.rhs);
        qdd.copy_from(&self.rhs);
    }

    /// Recursive Newton-Euler with zero joint accelerations and zero base acceleration: `force[b]`
    /// becomes the force that moves body `b`'s subtree, external wrenches taken off.
    fn set_bias_forces(&mut self, model: &Model, qd: &DVector<f64>, input: &Input) {
        let bodies = model.bodies();
        for (b, body) in bodies.iter().enumerate() {
            let twist = self.twist[b];
            self.acceleration[b] = match body.parent {
                None => Twist::ZERO,
                Some(parent) => {
                    self.acceleration[parent].shifted_to_child(&self.X_PB[b])
                        + twist.cross(&(self.axes[b - 1] * qd[b - 1]))
                }
            };
            let inertia = &body.spatial_inertia;
            self.force[b] = inertia.momentum(&self.acceleration[b])
                + twist.cross_force(&inertia.momentum(&twist))
                - input.wrenches[b];
        }
        for b in (1..bodies.len()).rev() {
            let parent = self.parents[b - 1];
            let child = self.force[b].shifted_to_parent(&self.X_PB[b]);
            self.force[parent] += child;
        }
    }

    /// Base acceleration that goes with joint accelerations `qdd` (after [`Workspace::accelerations`] for
    /// the same state), then every body's: afterwards [`Workspace::A_WF_B`] can be read.
    pub fn set_accelerations(&mut self, qd: &DVector<f64>, qdd: &DVector<f64>) {
        let force = self.force[0].force;
        let mut torque = self.force[0].torque - self.p_BC.cross(&force);
        let mut a_com = -force / self.mass;
        for (j, qdd) in qdd.iter().enumerate() {
            torque += self.H_M[j] * *qdd;
            a_com -= self.J_C[j] * *qdd;
        }
        let angular = -(self.H_B_inverse * torque);
        self.acceleration[0] = Twist::new(angular, a_com - angular.cross(&self.p_BC));
        for j in 0..qd.len() {
            let (b, parent) = (j + 1, self.parents[j]);
            self.acceleration[b] = self.acceleration[parent].shifted_to_child(&self.X_PB[b])
                + self.twist[b].cross(&(self.axes[j] * qd[j]))
                + self.axes[j] * qdd[j];
        }
    }

    /// Acceleration of `frame` in the world, components in the base's axes: angular \[rad/s²\] and that of
    /// the frame's origin as a point \[m/s²\] (needs [`Workspace::set_accelerations`]).
    pub fn A_WF_B(&self, frame: &Frame) -> Twist {
        let (a, v) = (&self.acceleration[frame.body], &self.twist[frame.body]);
        let r = &frame.X_BF.translation.vector;
        let v_origin = v.linear + v.angular.cross(r);
        let linear = a.linear + a.angular.cross(r) + v.angular.cross(&v_origin);
        let R_0B = &self.X_0B[frame.body].rotation;
        Twist::new(R_0B * a.angular, R_0B * linear)
    }

    /// Sum of the external wrenches, in base axes, torque about the system's centre of mass; and the
    /// power \[W\] that they deliver.
    pub(super) fn external_wrench(&self, input: &Input) -> (Wrench, f64) {
        let (mut sum, mut power) = (Wrench::ZERO, 0.0);
        for (b, wrench) in input.wrenches.iter().enumerate() {
            if *wrench != Wrench::ZERO {
                sum += wrench.shifted_to_parent(&self.X_0B[b]);
                power += self.twist[b].dot(wrench);
            }
        }
        sum.torque -= self.p_BC.cross(&sum.force);
        (sum, power)
    }
}

/// Solves `a x = b` in place by `L D Lᵀ` on the lower triangle of `a`. A general factorization of a
/// dynamic matrix costs three times as much at the sizes of robot arms. A matrix that is not positive
/// definite (positions that are not finite: every physical model has a positive definite `Ĥ`) gives
/// values that are not finite.
fn solve_positive_definite(a: &mut DMatrix<f64>, b: &mut DVector<f64>) {
    let n = b.len();
    let (a, b) = (a.as_mut_slice(), b.as_mut_slice());
    for j in 0..n {
        let (done, rest) = a.split_at_mut((j + 1) * n);
        let column = &mut done[j * n..];
        let inverse = if column[j] > 0.0 {
            1.0 / column[j]
        } else {
            f64::NAN
        };
        let b_j = b[j];
        for (k, later) in (j + 1..n).zip(rest.chunks_exact_mut(n)) {
            let factor = column[k] * inverse;
            for (x, l) in later[k..].iter_mut().zip(&column[k..]) {
                *x -= factor * l;
            }
            b[k] -= factor * b_j;
        }
        // The column now holds L D; keep 1/D for the way back.
        column[j] = inverse;
    }
    for (j, column) in a.chunks_exact(n.max(1)).enumerate().rev() {
        let known: f64 = column[j + 1..]
            .iter()
            .zip(&b[j + 1..])
            .map(|(l, x)| l * x)
            .sum();
        b[j] = (b[j] - known) * column[j];
    }
}
