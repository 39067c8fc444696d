//! Momentum map and base map: the base's reaction to the joints.

use nalgebra::{DVector, Matrix6xX, Vector3};

use super::{Momentum, Workspace, checks};
use crate::spatial::{Pose, RigidInertia, Twist};

impl Workspace {
    /// Twist of the base frame for momentum and joint rates (all in base axes): Masutani 1995
    /// eqs. (4.13), (4.23), solved without assuming that momentum is zero.
    ///
    /// # Panics
    /// If `qd` does not have one element per joint.
    pub fn base_twist(&self, momentum_B: &Momentum, qd: &DVector<f64>) -> Twist {
        checks::joint_vector("qd", qd.len(), &self.model);
        let mut angular_momentum = momentum_B.angular;
        let mut v_com = momentum_B.linear / self.mass;
        for (j, rate) in qd.as_slice().iter().enumerate() {
            let column = self.column(j);
            angular_momentum -= Vector3::from(column.H_M.0) * *rate;
            v_com -= Vector3::from(column.J_C.0) * *rate;
        }
        let angular = &self.H_B_inverse * angular_momentum;
        Twist::new(angular, v_com - angular.cross(&self.p_BC))
    }

    /// Momentum (base axes) of the system for the base twist `V_WB_B` and joint rates `qd`: eq. (4.13). The inverse of
    /// [`Workspace::base_twist`].
    ///
    /// # Panics
    /// If `qd` does not have one element per joint.
    pub fn momentum_of(&self, V_WB_B: &Twist, qd: &DVector<f64>) -> Momentum {
        checks::joint_vector("qd", qd.len(), &self.model);
        let Twist {
            angular: w,
            linear: v,
        } = V_WB_B;
        let mut linear = (v + w.cross(&self.p_BC)) * self.mass;
        let mut angular = &self.H_B * *w;
        for (j, rate) in qd.as_slice().iter().enumerate() {
            let column = self.column(j);
            linear += Vector3::from(column.linear_momentum.0) * *rate;
            angular += Vector3::from(column.H_M.0) * *rate;
        }
        Momentum { linear, angular }
    }

    /// Base map `[H_L; H_A]` (6 × n, linear rows first, base axes): velocity of the **base body's centre
    /// of mass** and angular velocity of the base per unit joint rate at zero momentum.
    /// Masutani 1995 eqs. (4.23), (4.24).
    ///
    /// # Panics
    /// If `out` does not have one column per joint.
    pub fn base_map(&self, out: &mut Matrix6xX<f64>) {
        checks::joint_vector("out", out.ncols(), &self.model);
        let r = self.p_BC - self.model.bodies()[0].inertia.com;
        let (columns, _) = out.as_mut_slice().as_chunks_mut::<6>();
        for (j, column) in columns.iter_mut().enumerate().take(self.model.dof()) {
            let of_joint = self.column(j);
            let (J_C, H_A) = (Vector3::from(of_joint.J_C.0), Vector3::from(of_joint.H_A.0));
            let linear = -J_C - H_A.cross(&r);
            column[..3].copy_from_slice(linear.as_slice());
            column[3..].copy_from_slice(H_A.as_slice());
        }
    }

    /// Momentum (base axes, angular about the system's centre of mass) summed over the bodies, eqs. (4.7), (4.8),
    /// from their twists (needs [`Workspace::set_motion`]). The computation is independent of the momentum map, so
    /// comparing the result with the state's momentum is a check.
    pub fn carried_momentum(&self) -> Momentum {
        self.carried_momentum_and_scale().0
    }

    /// Scale of the momentum's rounding error: the sums of the magnitudes of the bodies' linear momenta \[N s\] and of
    /// their angular momenta \[N m s\], about the system's centre of mass and relative to its velocity. The bodies'
    /// momenta may cancel in the system's momentum; if the latter is larger, it is the scale.
    pub fn momentum_scale(&self) -> (f64, f64) {
        self.carried_momentum_and_scale().1
    }

    /// [`Workspace::carried_momentum`] and [`Workspace::momentum_scale`] in one sweep.
    pub fn carried_momentum_and_scale(&self) -> (Momentum, (f64, f64)) {
        let (mut sum, mut scale) = (Momentum::default(), (0.0, 0.0));
        for (b, (body, terms)) in self.model.bodies().iter().zip(&self.bodies).enumerate() {
            let (X_0B, inertia) = (self.X_0B(b), &body.inertia);
            let R_0B = X_0B.rotation.matrix();
            let spin = R_0B * (inertia.about_com * R_0B.tr_mul(&terms.twist.angular));
            let linear = self.v_com(b, &X_0B, inertia) * inertia.mass;
            // The velocity of the centre of mass contributes no angular momentum about the centre of mass.
            let own = linear - self.v_WC * inertia.mass;
            let arm = R_0B * inertia.com + X_0B.translation.vector - self.p_BC;
            let angular = spin + arm.cross(&own);
            sum.linear += linear;
            sum.angular += angular;
            scale.0 += own.norm();
            scale.1 += angular.norm();
        }
        (sum, scale)
    }

    /// Velocity of the centre of mass of body `b`, whose pose is `X_0B`.
    pub(super) fn v_com(&self, b: usize, X_0B: &Pose, inertia: &RigidInertia) -> Vector3<f64> {
        let twist = &self.bodies[b].twist;
        let com = X_0B * nalgebra::Point3::from(inertia.com);
        let origin = self.p_BK(b);
        twist.linear + twist.angular.cross(&(com.coords - origin))
    }
}
