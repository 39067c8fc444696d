//! The section of an elastic link that carries the following links.

use nalgebra::{Rotation3, Translation3, Vector3};

use super::ModalBody;
use super::composite::{Articulated, Composite};
use crate::spatial::{Pose, Twist, Wrench};

/// Pose and motion of a carrying section E relative to the link's body frame B, and sums over the bodies that E
/// carries. Components of motion and sums are in axes of E, about its origin.
#[derive(Clone, Debug)]
pub(super) struct Section {
    /// Index of the elastic link among the deformable bodies, and the number of the output point that is the section.
    pub modal_body: usize,
    output: usize,
    /// Origin of E in B while the link is straight; E then has the axes of B.
    pub p_BE_straight: Vector3<f64>,
    pub X_BE: Pose,
    /// Twist of E relative to B for each modal rate.
    pub columns: Vec<Twist>,
    /// Twist of E relative to B.
    pub relative: Twist,
    /// Acceleration of E relative to B at constant modal rates, as seen in B.
    curvature: Twist,
    /// Acceleration of E while B and the modal rates do not accelerate, once B's angular velocity is known.
    pub bias: Twist,
    /// Composite inertia of the bodies that E carries.
    pub composite: Composite,
    pub momentum: Wrench,
    pub inertia: Articulated,
    pub force: Wrench,
    /// External wrench on the elastic link.
    pub external: Wrench,
}

impl Section {
    /// The section at output point `output` of `body`, the deformable body with index `modal_body`.
    pub fn new(modal_body: usize, body: &ModalBody, output: usize) -> Self {
        Self {
            modal_body,
            output,
            p_BE_straight: body.in_body.outputs[output].position,
            X_BE: Pose::identity(),
            columns: vec![Twist::ZERO; body.modes()],
            relative: Twist::ZERO,
            curvature: Twist::ZERO,
            bias: Twist::ZERO,
            composite: Composite::zero(),
            momentum: Wrench::ZERO,
            inertia: Articulated::zero(),
            force: Wrench::ZERO,
            external: Wrench::ZERO,
        }
    }

    /// Sets pose, columns and relative motion; clears composite inertia and momentum of the carried bodies. The small
    /// rotation φ of the output point is the sequence `Rz(φ_z) Ry(φ_y) Rx(φ_x)` in axes of the attachment frame A.
    pub fn set_shape(&mut self, body: &ModalBody, mu: &[f64], mu_dot: &[f64]) {
        (self.composite, self.momentum) = (Composite::zero(), Wrench::ZERO);
        let (R_BA, point) = (body.X_BA.rotation, &body.in_body.outputs[self.output]);
        let small = &body.appendage.outputs[self.output].rotation;
        let sum = |weights: &[f64]| -> Vector3<f64> {
            small.iter().zip(weights).map(|(r, m)| r * *m).sum()
        };
        let (angles, rates) = (sum(mu), sum(mu_dot));
        let [Rx, Ry, Rz] = [
            Rotation3::from_axis_angle(&Vector3::x_axis(), angles.x),
            Rotation3::from_axis_angle(&Vector3::y_axis(), angles.y),
            Rotation3::from_axis_angle(&Vector3::z_axis(), angles.z),
        ];
        let R_BE = R_BA * Rz * Ry * Rx * R_BA.inverse();
        self.X_BE = Pose::from_parts(
            Translation3::from(point.position + point.displacement(mu)),
            R_BE,
        );
        // Axes about which the three rotations turn, in A: x after Ry and Rz, y after Rz, z.
        let axes = [Rz * Ry * Vector3::x(), Rz * Vector3::y(), Vector3::z()];
        let about_z = axes[2] * rates.z;
        let about_zy = about_z + axes[1] * rates.y;
        let turning = about_z.cross(&axes[1]) * rates.y + about_zy.cross(&axes[0]) * rates.x;

        let n = mu.len();
        let mut bending = Vector3::zeros();
        self.relative = Twist::ZERO;
        for (k, column) in self.columns.iter_mut().enumerate() {
            let r = small[k];
            let angular = R_BA * (axes[0] * r.x + axes[1] * r.y + axes[2] * r.z);
            let mut linear = point.translation[k];
            if !point.chi.is_empty() {
                for l in 0..n {
                    let chi = point.chi[fuyu_structures::pair_index(n, k, l)];
                    linear += chi * mu[l];
                    bending += chi * (mu_dot[k] * mu_dot[l]);
                }
            }
            *column = in_axes_of(&R_BE, angular, linear);
            self.relative += *column * mu_dot[k];
        }
        self.curvature = in_axes_of(&R_BE, R_BA * turning, bending);
    }

    /// Inertial twist of E from that of B.
    pub fn twist(&self, V_B: &Twist) -> Twist {
        V_B.shifted_to_child(&self.X_BE) + self.relative
    }

    /// Sets the bias acceleration for an angular velocity `w` of B, in axes of B.
    pub fn set_bias(&mut self, w: &Vector3<f64>) {
        let Twist { angular, linear } = &self.relative;
        let centripetal = w.cross(&w.cross(&self.X_BE.translation.vector));
        let w = self.X_BE.rotation.inverse_transform_vector(w);
        self.bias = Twist {
            angular: self.curvature.angular + w.cross(angular),
            linear: self.curvature.linear
                + self.X_BE.rotation.inverse_transform_vector(&centripetal)
                + w.cross(linear) * 2.0,
        };
    }

    /// Acceleration of E from those of B and the modes.
    pub fn acceleration(&self, A_B: &Twist, mu_ddot: &[f64]) -> Twist {
        let mut A = A_B.shifted_to_child(&self.X_BE) + self.bias;
        for (column, rate) in self.columns.iter().zip(mu_ddot) {
            A += *column * *rate;
        }
        A
    }
}

/// A motion with components in axes of B, in axes of E.
fn in_axes_of(R_BE: &Rotation3<f64>, angular: Vector3<f64>, linear: Vector3<f64>) -> Twist {
    Twist {
        angular: R_BE.inverse_transform_vector(&angular),
        linear: R_BE.inverse_transform_vector(&linear),
    }
}
