//! Forward dynamics of the reduced system.

use nalgebra::{Cholesky, DMatrix, DVector};

use super::{State, Workspace};
use crate::model::Model;
use crate::spatial::Wrench;

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
        let n = model.dof();
        self.set_bias_forces(model, &state.qd, input);
        if n == 0 {
            return;
        }
        let base_force = self.force[0].force;
        let base_torque = self.force[0].torque - self.p_BC.cross(&base_force);
        let base_turn = self.H_B_inverse * base_torque;
        for (j, joint) in model.joints().iter().enumerate() {
            let bias = self.axes[j].dot(&self.force[j + 1])
                - self.J_C.column(j).dot(&base_force)
                - self.H_M.column(j).dot(&base_turn);
            self.rhs[j] = input.efforts[j] - joint.damping * state.qd[j] - bias;
        }
        self.set_reduced_inertia(model);
        // The factorization takes the matrix and gives its memory back.
        let reduced = std::mem::replace(&mut self.reduced, DMatrix::zeros(0, 0));
        qdd.copy_from(&self.rhs);
        match Cholesky::new(reduced) {
            Some(factor) => {
                factor.solve_mut(qdd);
                self.reduced = factor.unpack_dirty();
            }
            None => {
                // Positive definite for every physical model and finite state; what is not finite
                // must show.
                qdd.fill(f64::NAN);
                self.reduced = DMatrix::zeros(n, n);
            }
        }
    }

    /// Recursive Newton-Euler with zero joint accelerations and zero base acceleration: `force[b]`
    /// becomes the force that moves body `b`'s subtree, external wrenches taken off.
    fn set_bias_forces(&mut self, model: &Model, qd: &DVector<f64>, input: &Input) {
        let bodies = model.bodies();
        for (b, body) in bodies.iter().enumerate() {
            let twist = self.twist[b];
            self.acceleration[b] = match body.parent {
                None => crate::spatial::Twist::ZERO,
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
            let parent = model.joint_parent(b - 1);
            let child = self.force[b].shifted_to_parent(&self.X_PB[b]);
            self.force[parent] += child;
        }
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
