//! The section of an elastic link that carries the links which follow.

use nalgebra::{Matrix3, Vector3};

use super::ModalBody;
use super::composite::{Articulated, Composite};
use crate::spatial::{Twist, Wrench};

/// Pose and motion of a carrying section E relative to the link's body frame B, in axes of B, and sums over what it carries.
#[derive(Clone, Debug)]
pub(super) struct Section {
    /// Axes of E, those of B while the link is straight.
    pub R_BE: Matrix3<f64>,
    pub p_BE: Vector3<f64>,
    /// Twist of E relative to B for each modal rate.
    pub columns: Vec<Twist>,
    /// Twist of E relative to B.
    pub relative: Twist,
    /// Acceleration of E relative to B at constant modal rates, as seen in B.
    pub curvature: Twist,
    /// Acceleration of E while B and the modal rates do not accelerate, once B's angular velocity is known.
    pub bias: Twist,
    /// What E carries, in the frame E.
    pub composite: Composite,
    pub momentum: Wrench,
    pub inertia: Articulated,
    pub force: Wrench,
}

impl Section {
    pub fn new(body: &ModalBody) -> Self {
        Self {
            R_BE: Matrix3::identity(),
            p_BE: Vector3::zeros(),
            columns: vec![Twist::ZERO; body.modes()],
            relative: Twist::ZERO,
            curvature: Twist::ZERO,
            bias: Twist::ZERO,
            composite: Composite::zero(),
            momentum: Wrench::ZERO,
            inertia: Articulated::zero(),
            force: Wrench::ZERO,
        }
    }

    /// Pose, columns and relative motion, from the output point `output` of `body`. The small rotation φ of the output is the
    /// sequence `Rz(φ_z) Ry(φ_y) Rx(φ_x)` in axes of the attachment frame A.
    pub fn set_shape(&mut self, body: &ModalBody, output: usize, mu: &[f64], mu_dot: &[f64]) {
        let (R_BA, point) = (body.X_BA.rotation.matrix(), &body.in_body.outputs[output]);
        let small = &body.appendage.outputs[output].rotation;
        let sum = |weights: &[f64]| -> Vector3<f64> {
            small.iter().zip(weights).map(|(r, m)| r * *m).sum()
        };
        let (angles, rates) = (sum(mu), sum(mu_dot));
        let (sx, cx) = angles.x.sin_cos();
        let (sy, cy) = angles.y.sin_cos();
        let (sz, cz) = angles.z.sin_cos();
        let Rz = Matrix3::new(cz, -sz, 0.0, sz, cz, 0.0, 0.0, 0.0, 1.0);
        let Ry = Matrix3::new(cy, 0.0, sy, 0.0, 1.0, 0.0, -sy, 0.0, cy);
        let Rx = Matrix3::new(1.0, 0.0, 0.0, 0.0, cx, -sx, 0.0, sx, cx);
        self.R_BE = R_BA * Rz * Ry * Rx * R_BA.transpose();
        // Axes about which the three rotations turn, in A: x after Ry and Rz, y after Rz, z.
        let axes = [
            (Rz * Ry).column(0).into_owned(),
            Rz.column(1).into_owned(),
            Vector3::z(),
        ];
        let about_z = axes[2] * rates.z;
        let about_zy = about_z + axes[1] * rates.y;
        let turning = about_z.cross(&axes[1]) * rates.y + about_zy.cross(&axes[0]) * rates.x;

        self.p_BE = point.position + point.displacement(mu);
        self.relative = Twist::ZERO;
        self.curvature = Twist {
            angular: R_BA * turning,
            linear: Vector3::zeros(),
        };
        for (k, column) in self.columns.iter_mut().enumerate() {
            let r = small[k];
            column.angular = R_BA * (axes[0] * r.x + axes[1] * r.y + axes[2] * r.z);
            column.linear = point.translation[k];
            if !point.chi.is_empty() {
                let n = mu.len();
                for l in 0..n {
                    let chi = point.chi[fuyu_structures::pair_index(n, k, l)];
                    column.linear += chi * mu[l];
                    self.curvature.linear += chi * (mu_dot[k] * mu_dot[l]);
                }
            }
            self.relative.angular += column.angular * mu_dot[k];
            self.relative.linear += column.linear * mu_dot[k];
        }
    }

    /// Twist of E, in its axes, from that of B.
    pub fn twist(&self, V_B: &Twist) -> Twist {
        let w = V_B.angular + self.relative.angular;
        let v = V_B.linear + V_B.angular.cross(&self.p_BE) + self.relative.linear;
        Twist {
            angular: self.R_BE.tr_mul(&w),
            linear: self.R_BE.tr_mul(&v),
        }
    }

    /// Sets the bias acceleration for an angular velocity `w` of B, in its axes.
    pub fn set_bias(&mut self, w: &Vector3<f64>) {
        let Twist { angular, linear } = &self.relative;
        self.bias = Twist {
            angular: self.curvature.angular + w.cross(angular),
            linear: self.curvature.linear + w.cross(&(w.cross(&self.p_BE) + linear * 2.0)),
        };
    }

    /// Acceleration of E, in its axes, from those of B and the modes.
    pub fn acceleration(&self, A_B: &Twist, mu_ddot: &[f64]) -> Twist {
        let mut angular = A_B.angular + self.bias.angular;
        let mut linear = A_B.linear + A_B.angular.cross(&self.p_BE) + self.bias.linear;
        for (column, rate) in self.columns.iter().zip(mu_ddot) {
            angular += column.angular * *rate;
            linear += column.linear * *rate;
        }
        Twist {
            angular: self.R_BE.tr_mul(&angular),
            linear: self.R_BE.tr_mul(&linear),
        }
    }

    pub fn clear_carried(&mut self) {
        self.composite = Composite::zero();
        self.momentum = Wrench::ZERO;
    }
}
