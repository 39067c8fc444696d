//! Fixed-base and generalized Jacobians.

use nalgebra::Matrix6xX;

use super::Workspace;
use crate::model::{Frame, Model};

impl Workspace {
    /// Fixed-base Jacobian `[J_L; J_A]` (6 × n, linear rows first, base axes) of `frame`'s origin.
    /// Masutani 1995 eqs. (4.32), (4.33).
    pub fn fixed_base_jacobian(&self, model: &Model, frame: &Frame, out: &mut Matrix6xX<f64>) {
        out.fill(0.0);
        let tip = self.X_BF(frame).translation.vector;
        let mut body = frame.body;
        while let Some(parent) = model.bodies()[body].parent {
            let (X_0B, axis) = (&self.X_0B[body], &self.axes[body - 1]);
            let angular = X_0B.rotation * axis.angular;
            let linear =
                X_0B.rotation * axis.linear + angular.cross(&(tip - X_0B.translation.vector));
            out.fixed_view_mut::<3, 1>(0, body - 1).copy_from(&linear);
            out.fixed_view_mut::<3, 1>(3, body - 1).copy_from(&angular);
            body = parent;
        }
    }

    /// Generalized Jacobian `[Ĵ_L; Ĵ_A]` (6 × n, linear rows first): inertial velocity of `frame`'s
    /// origin in base axes per unit joint rate, base reaction included, at zero momentum.
    /// Masutani 1995 eqs. (4.36), (4.37).
    pub fn generalized_jacobian(&self, model: &Model, frame: &Frame, out: &mut Matrix6xX<f64>) {
        self.fixed_base_jacobian(model, frame, out);
        let r_CE = self.X_BF(frame).translation.vector - self.p_BC;
        for j in 0..model.dof() {
            let w_B = &self.H_A[j];
            let mut linear = out.fixed_view_mut::<3, 1>(0, j);
            linear += w_B.cross(&r_CE) - self.J_C[j];
            let mut angular = out.fixed_view_mut::<3, 1>(3, j);
            angular += w_B;
        }
    }
}
