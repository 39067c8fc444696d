//! Momentum map and base map: how the base answers the joints.

use nalgebra::{DVector, Matrix6xX, Vector3};

use super::workspace::BodyTerms;
use super::{Momentum, Workspace};
use crate::model::Model;
use crate::spatial::{RigidInertia, SpatialInertia, Twist};

impl Workspace {
    /// Composite inertias by one sweep from the tips, then the columns of the momentum map: joint `j` at
    /// unit rate with the base held gives the momentum of its subtree moving as one body. Linear in the
    /// number of joints. Masutani 1995 eqs. (4.9)-(4.18), (4.25), (4.26).
    pub(super) fn set_momentum_map(&mut self) {
        for (j, joint) in self.joints.iter_mut().enumerate().rev() {
            let (earlier, rest) = self.bodies.split_at_mut(j + 1);
            let (parent, body) = (&mut earlier[joint.parent], &rest[0]);
            parent.composite += body.composite.shifted(&body.p_PB);
            joint.momentum = joint.axis.momentum(&body.composite);
        }
        let system: &SpatialInertia = &self.bodies[0].composite;
        self.p_BC = system.first_moment / self.mass;
        // Bodies are positive definite, so only a position that is not finite can make this fail, and
        // that shows in every result.
        self.H_B_inverse = system.shifted(&-self.p_BC).about_origin.inverse();
        for (joint, body) in self.joints.iter_mut().zip(&self.bodies[1..]) {
            joint.J_C = joint.momentum.force / self.mass;
            joint.H_M = joint.momentum.shifted(&(body.p_0B - self.p_BC)).torque;
            joint.H_A = -(&self.H_B_inverse * joint.H_M);
        }
    }

    /// Twist of the base frame for momentum and joint rates (all in base axes): Masutani 1995
    /// eqs. (4.13), (4.23) solved with the momentum kept.
    pub fn base_twist(&self, momentum_B: &Momentum, qd: &DVector<f64>) -> Twist {
        let mut angular_momentum = momentum_B.angular;
        let mut v_com = momentum_B.linear / self.mass;
        for (joint, rate) in self.joints.iter().zip(qd.as_slice()) {
            angular_momentum -= joint.H_M * *rate;
            v_com -= joint.J_C * *rate;
        }
        let angular = &self.H_B_inverse * angular_momentum;
        Twist::new(angular, v_com - angular.cross(&self.p_BC))
    }

    /// Momentum (base axes) of the system whose base frame moves with `V_WB_B` while the joints move
    /// with `qd`: eq. (4.13). The inverse of [`Workspace::base_twist`].
    pub fn momentum_of(&self, V_WB_B: &Twist, qd: &DVector<f64>) -> Momentum {
        let about_origin = self.bodies[0].composite.momentum(V_WB_B);
        let mut linear = about_origin.force;
        let mut angular = about_origin.torque - self.p_BC.cross(&about_origin.force);
        for (joint, rate) in self.joints.iter().zip(qd.as_slice()) {
            linear += joint.momentum.force * *rate;
            angular += joint.H_M * *rate;
        }
        Momentum { linear, angular }
    }

    /// Base map `[H_L; H_A]` (6 × n, linear rows first, base axes): velocity of the **base body's centre
    /// of mass** and angular velocity of the base per unit joint rate at zero momentum.
    /// Masutani 1995 eqs. (4.23), (4.24).
    pub fn base_map(&self, model: &Model, out: &mut Matrix6xX<f64>) {
        let r = self.p_BC - model.bodies()[0].inertia.com;
        for (joint, mut column) in self.joints.iter().zip(out.column_iter_mut()) {
            let linear = -joint.J_C - joint.H_A.cross(&r);
            column.fixed_rows_mut::<3>(0).copy_from(&linear);
            column.fixed_rows_mut::<3>(3).copy_from(&joint.H_A);
        }
    }

    /// Momentum (base axes, angular about the system's centre of mass) as the bodies carry it: the sum
    /// over bodies of eqs. (4.7), (4.8), from their twists (needs [`Workspace::set_motion`]). It shares
    /// no step with the momentum map, so comparing it with the state's momentum is a check.
    pub fn carried_momentum(&self, model: &Model) -> Momentum {
        self.carried_momentum_and_scale(model).0
    }

    /// How much momentum the bodies carry without regard to sign: the sums of the magnitudes of their
    /// linear momenta and of their angular momenta about the system's centre of mass, as seen by an
    /// observer who moves with that centre. What they cancel to is the system's momentum, so this, or
    /// that if it is larger, is the scale of its rounding.
    pub fn momentum_scale(&self, model: &Model) -> (f64, f64) {
        self.carried_momentum_and_scale(model).1
    }

    /// [`Workspace::carried_momentum`] and [`Workspace::momentum_scale`] in one sweep.
    pub fn carried_momentum_and_scale(&self, model: &Model) -> (Momentum, (f64, f64)) {
        let (mut sum, mut scale) = (Momentum::default(), (0.0, 0.0));
        for (body, terms) in model.bodies().iter().zip(&self.bodies) {
            let (R_0B, inertia) = (&terms.R_0B, &body.inertia);
            let spin = R_0B * (inertia.about_com * R_0B.tr_mul(&terms.twist.angular));
            let linear = terms.v_com(inertia) * inertia.mass;
            // The common motion carries no angular momentum about the centre of mass.
            let own = linear - self.v_WC * inertia.mass;
            let arm = R_0B * inertia.com + terms.p_0B - self.p_BC;
            let angular = spin + arm.cross(&own);
            sum.linear += linear;
            sum.angular += angular;
            scale.0 += own.norm();
            scale.1 += angular.norm();
        }
        (sum, scale)
    }
}

impl BodyTerms {
    /// Velocity of the body's centre of mass.
    pub(super) fn v_com(&self, inertia: &RigidInertia) -> Vector3<f64> {
        self.twist.linear + self.twist.angular.cross(&(self.R_0B * inertia.com))
    }
}
