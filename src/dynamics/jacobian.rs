//! Fixed-base and generalized Jacobians.

use nalgebra::{Matrix6xX, Vector3};

use super::Workspace;
use super::joint_map::Axis;
use crate::model::Frame;

impl Workspace {
    /// Fixed-base Jacobian `[J_L; J_A]` (6 × n, linear rows first, base axes) of `frame`'s origin.
    /// Masutani 1995 eqs. (4.32), (4.33).
    pub fn fixed_base_jacobian(&self, frame: &Frame, out: &mut Matrix6xX<f64>) {
        out.fill(0.0);
        self.add_fixed_base_jacobian(frame, &self.tip(frame), out);
    }

    /// Generalized Jacobian `[Ĵ_L; Ĵ_A]` (6 × n, linear rows first): inertial velocity of `frame`'s
    /// origin in base axes per unit joint rate, base reaction included, at zero momentum.
    /// Masutani 1995 eqs. (4.36), (4.37).
    pub fn generalized_jacobian(&self, frame: &Frame, out: &mut Matrix6xX<f64>) {
        let tip = self.tip(frame);
        let r_CE = tip - self.p_BC;
        out.fill(0.0);
        for (column, joint) in out.as_mut_slice().chunks_exact_mut(6).zip(&self.joints) {
            let w_B = &joint.H_A;
            add(column, &(w_B.cross(&r_CE) - joint.J_C), w_B);
        }
        self.add_fixed_base_jacobian(frame, &tip, out);
    }

    /// Position of `frame`'s origin.
    fn tip(&self, frame: &Frame) -> Vector3<f64> {
        let body = &self.bodies[frame.body];
        body.p_0B + body.R_0B * frame.X_BF.translation.vector
    }

    fn add_fixed_base_jacobian(&self, frame: &Frame, tip: &Vector3<f64>, out: &mut Matrix6xX<f64>) {
        let out = out.as_mut_slice();
        let mut body = frame.body;
        while body > 0 {
            let joint = &self.joints[body - 1];
            let column = &mut out[6 * (body - 1)..6 * body];
            match &joint.axis {
                Axis::Turn(axis) => {
                    add(column, &axis.cross(&(tip - self.bodies[body].p_0B)), axis);
                }
                Axis::Slide(axis) => add(column, axis, &Vector3::zeros()),
            }
            body = joint.parent;
        }
    }
}

/// Adds to a column `[linear; angular]`.
fn add(column: &mut [f64], linear: &Vector3<f64>, angular: &Vector3<f64>) {
    for (entry, value) in column.iter_mut().zip(linear.iter().chain(angular)) {
        *entry += value;
    }
}
