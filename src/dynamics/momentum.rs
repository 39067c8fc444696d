//! Momentum map and base map: how the base answers the joints.

use nalgebra::{DVector, Matrix3, Matrix6xX};

use super::{Momentum, Workspace};
use crate::model::Model;
use crate::spatial::{SpatialInertia, Twist};

impl Workspace {
    /// Composite inertias by one sweep from the tips, then the columns of the momentum map: joint `j` at
    /// unit rate with the base held gives the momentum of its subtree moving as one body. Linear in the
    /// number of joints. Masutani 1995 eqs. (4.9)-(4.18), (4.25), (4.26).
    pub(super) fn set_composite_inertias(&mut self, model: &Model) {
        for (composite, body) in self.composite.iter_mut().zip(model.bodies()) {
            *composite = body.spatial_inertia;
        }
        for j in (0..model.dof()).rev() {
            let child = self.composite[j + 1].shifted_to_parent(&self.X_PB[j + 1]);
            self.composite[self.parents[j]] += child;
        }
        let system: &SpatialInertia = &self.composite[0];
        self.p_BC = system.first_moment / self.mass;
        let about_com = system.about_origin - crate::spatial::parallel_axis(&self.p_BC) * self.mass;
        // Bodies are positive definite, so only a position that is not finite can make this fail; it
        // must then show in every result.
        self.H_B_inverse = about_com
            .try_inverse()
            .unwrap_or_else(|| Matrix3::from_element(f64::NAN));
        for j in 0..model.dof() {
            let momentum = self.composite[j + 1].momentum(&self.axes[j]);
            let about_base = momentum.shifted_to_parent(&self.X_0B[j + 1]);
            self.J_C[j] = about_base.force / self.mass;
            self.H_M[j] = about_base.torque - self.p_BC.cross(&about_base.force);
            self.H_A[j] = -(self.H_B_inverse * self.H_M[j]);
        }
    }

    /// Twist of the base frame for momentum and joint rates (all in base axes): Masutani 1995
    /// eqs. (4.13), (4.23) solved with the momentum kept.
    pub fn base_twist(&self, momentum_B: &Momentum, qd: &DVector<f64>) -> Twist {
        let mut angular_momentum = momentum_B.angular;
        let mut v_com = momentum_B.linear / self.mass;
        for ((H_M, J_C), rate) in self.H_M.iter().zip(&self.J_C).zip(qd) {
            angular_momentum -= H_M * *rate;
            v_com -= J_C * *rate;
        }
        let angular = self.H_B_inverse * angular_momentum;
        Twist::new(angular, v_com - angular.cross(&self.p_BC))
    }

    /// Momentum (base axes) of the system whose base frame moves with `V_WB_B` while the joints move
    /// with `qd`: eq. (4.13). The inverse of [`Workspace::base_twist`].
    pub fn momentum_of(&self, V_WB_B: &Twist, qd: &DVector<f64>) -> Momentum {
        let about_origin = self.composite[0].momentum(V_WB_B);
        let mut linear = about_origin.force;
        let mut angular = about_origin.torque - self.p_BC.cross(&about_origin.force);
        for ((H_M, J_C), rate) in self.H_M.iter().zip(&self.J_C).zip(qd) {
            linear += J_C * (*rate * self.mass);
            angular += H_M * *rate;
        }
        Momentum { linear, angular }
    }

    /// Base map `[H_L; H_A]` (6 × n, linear rows first, base axes): velocity of the **base body's centre
    /// of mass** and angular velocity of the base per unit joint rate at zero momentum.
    /// Masutani 1995 eqs. (4.23), (4.24).
    pub fn base_map(&self, model: &Model, out: &mut Matrix6xX<f64>) {
        let r = self.p_BC - model.bodies()[0].inertia.com;
        for j in 0..model.dof() {
            let linear = -self.J_C[j] - self.H_A[j].cross(&r);
            out.fixed_view_mut::<3, 1>(0, j).copy_from(&linear);
            out.fixed_view_mut::<3, 1>(3, j).copy_from(&self.H_A[j]);
        }
    }

    /// Momentum (base axes, angular about the system's centre of mass) as the bodies carry it: the sum
    /// over bodies of eqs. (4.7), (4.8), from their twists (needs [`Workspace::set_motion`]). It shares
    /// no step with the momentum map, so comparing it with the state's momentum is a check.
    pub fn carried_momentum(&self, model: &Model) -> Momentum {
        let mut sum = Momentum::default();
        self.for_each_body_momentum(model, |linear, angular| {
            sum.linear += linear;
            sum.angular += angular;
        });
        sum
    }

    /// Scale against which a momentum residual is judged: the sum over bodies of the magnitudes of
    /// their momenta (linear, angular), each about the system's centre of mass.
    pub fn momentum_scale(&self, model: &Model) -> (f64, f64) {
        let mut scale = (0.0, 0.0);
        self.for_each_body_momentum(model, |linear, angular| {
            scale.0 += linear.norm();
            scale.1 += angular.norm();
        });
        scale
    }

    fn for_each_body_momentum(
        &self,
        model: &Model,
        mut visit: impl FnMut(nalgebra::Vector3<f64>, nalgebra::Vector3<f64>),
    ) {
        for (b, body) in model.bodies().iter().enumerate() {
            let (X_0B, twist, inertia) = (&self.X_0B[b], &self.twist[b], &body.inertia);
            let v_com = X_0B.rotation * (twist.linear + twist.angular.cross(&inertia.com));
            let spin = X_0B.rotation * (inertia.about_com * twist.angular);
            let linear = v_com * inertia.mass;
            let arm = X_0B.rotation * inertia.com + X_0B.translation.vector - self.p_BC;
            visit(linear, spin + arm.cross(&linear));
        }
    }
}
