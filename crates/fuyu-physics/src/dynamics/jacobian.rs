//! Fixed-base and generalized Jacobians.

use nalgebra::{Matrix6xX, Vector3};
use pulp::{Simd, WithSimd};

use super::axis::Axis;
use super::kernel::Vec3;
use super::{Workspace, checks};
use crate::model::{Coupling, Frame};

impl Workspace {
    /// Fixed-base Jacobian `[J_L; J_A]` (6 × n, linear rows first, base axes) of `frame`'s origin.
    /// Masutani 1995 eqs. (4.32), (4.33).
    ///
    /// # Panics
    /// If `out` does not have one column per joint.
    pub fn fixed_base_jacobian(&self, frame: &Frame, out: &mut Matrix6xX<f64>) {
        checks::joint_vector("out", out.ncols(), &self.model);
        out.fill(0.0);
        self.add_fixed_base_jacobian(frame, out);
    }

    /// Generalized Jacobian `[Ĵ_L; Ĵ_A]` (6 × n, linear rows first): inertial velocity of `frame`'s origin in base axes
    /// per unit joint rate, including the base's reaction, at zero momentum. Masutani 1995 eqs. (4.36), (4.37).
    ///
    /// # Panics
    /// If `out` does not have one column per joint.
    pub fn generalized_jacobian(&self, frame: &Frame, out: &mut Matrix6xX<f64>) {
        checks::frame(frame, &self.model);
        checks::joint_vector("out", out.ncols(), &self.model);
        if self.model.has_mimics() {
            // First the base's motion, then that of the joints.
            let r_CE = self.p_KF(frame) + self.p_BK(frame.body) - self.p_BC;
            for (j, column) in out
                .as_mut_slice()
                .as_chunks_mut::<6>()
                .0
                .iter_mut()
                .enumerate()
            {
                let of_joint = self.column(j);
                let (J_C, H_A) = (Vector3::from(of_joint.J_C.0), Vector3::from(of_joint.H_A.0));
                column.fill(0.0);
                add(column, &(H_A.cross(&r_CE) - J_C), &H_A, 1.0);
            }
            self.add_fixed_base_jacobian(frame, out);
            return;
        }
        self.arch.dispatch(GeneralizedJacobian {
            workspace: self,
            frame,
            columns: out.as_mut_slice().as_chunks_mut().0,
        });
    }

    fn add_fixed_base_jacobian(&self, frame: &Frame, out: &mut Matrix6xX<f64>) {
        let tip = self.p_KF(frame) + self.p_BK(frame.body);
        let out = out.as_mut_slice();
        let mut body = frame.body;
        while body > 0 {
            let Coupling {
                coordinate, ratio, ..
            } = self.model.coupling(body - 1);
            let column = &mut out[6 * coordinate..6 * (coordinate + 1)];
            match &self.axis(body - 1) {
                Axis::Turn(axis) => {
                    let origin = self.p_BK(body);
                    add(column, &axis.cross(&(tip - origin)), axis, ratio);
                }
                Axis::Slide(axis) => add(column, axis, &Vector3::zeros(), ratio),
            }
            body = self.tree.joints[body - 1].parent;
        }
    }
}

/// The generalized Jacobian; `pulp` compiles it for every instruction set.
struct GeneralizedJacobian<'a> {
    workspace: &'a Workspace,
    frame: &'a Frame,
    columns: &'a mut [[f64; 6]],
}

impl WithSimd for GeneralizedJacobian<'_> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Workspace {
            tree, joints, p_BC, ..
        } = self.workspace;
        let p_KE = Vec3(tree.p_KF(self.frame).into());
        let (body, p_BC) = (self.frame.body, Vec3((*p_BC).into()));
        joints.set_jacobian(simd, p_BC, body, p_KE, self.columns);
    }
}

/// Adds `ratio` times a motion to a column `[linear; angular]`.
fn add(column: &mut [f64], linear: &Vector3<f64>, angular: &Vector3<f64>, ratio: f64) {
    for (entry, value) in column.iter_mut().zip(linear.iter().chain(angular)) {
        *entry += ratio * value;
    }
}
