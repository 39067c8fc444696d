//! Composite inertia of a rigid or locked set of bodies, and articulated inertia of a set whose joints and modes move
//! freely.

use nalgebra::{Matrix3, Matrix6, Vector3};

use crate::spatial::{Pose, RigidInertia, Twist, Wrench};

/// Mass, first moment and moment of inertia about a frame's origin, in its axes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Composite {
    pub mass: f64,
    pub S: Vector3<f64>,
    pub J: Matrix3<f64>,
}

impl Composite {
    pub fn zero() -> Self {
        Self {
            mass: 0.0,
            S: Vector3::zeros(),
            J: Matrix3::zeros(),
        }
    }

    pub fn add(&mut self, o: &Self) {
        self.mass += o.mass;
        self.S += o.S;
        self.J += o.J;
    }

    /// Moment of inertia about the centre of mass.
    pub fn about_com(&self) -> Matrix3<f64> {
        if self.mass == 0.0 {
            return self.J;
        }
        let c = self.S / self.mass;
        self.J - (Matrix3::identity() * c.norm_squared() - c * c.transpose()) * self.mass
    }

    /// Centre of mass and inertia about it; all zero without mass.
    pub fn rigid_inertia(&self) -> RigidInertia {
        if self.mass == 0.0 {
            return RigidInertia::zero();
        }
        RigidInertia {
            mass: self.mass,
            com: self.S / self.mass,
            about_com: self.about_com(),
        }
    }

    /// Mass matrix for a velocity `(v, w)` of the frame, about its origin.
    pub fn mass_matrix(&self) -> Matrix6<f64> {
        let mut M = Matrix6::identity() * self.mass;
        let S = self.S.cross_matrix();
        M.fixed_view_mut::<3, 3>(0, 3).copy_from(&-S);
        M.fixed_view_mut::<3, 3>(3, 0).copy_from(&S);
        M.fixed_view_mut::<3, 3>(3, 3).copy_from(&self.J);
        M
    }

    /// Momentum at a twist, about the origin.
    pub fn momentum(&self, V: &Twist) -> Wrench {
        Wrench {
            torque: self.J * V.angular + self.S.cross(&V.linear),
            force: V.linear * self.mass + V.angular.cross(&self.S),
        }
    }

    /// The inertia in the frame E, in which its frame C has the pose `X_EC`.
    pub fn in_parent(&self, X_EC: &Pose) -> Self {
        let (R, p) = (X_EC.rotation.matrix(), &X_EC.translation.vector);
        // With g = S + m p / 2, the shift adds 2 (p·g) 1 - p gᵀ - g pᵀ.
        let S = R * self.S;
        let g = S + p * (0.5 * self.mass);
        let shift = p * g.transpose();
        Self {
            mass: self.mass,
            S: S + p * self.mass,
            J: R * self.J * R.transpose() + Matrix3::identity() * (2.0 * p.dot(&g))
                - shift
                - shift.transpose(),
        }
    }
}

/// Articulated inertia of a subtree: `torque = J α + H a`, `force = Hᵀ α + M a`, about a frame's origin, in its axes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Articulated {
    pub J: Matrix3<f64>,
    pub H: Matrix3<f64>,
    pub M: Matrix3<f64>,
}

impl Articulated {
    pub fn zero() -> Self {
        Self {
            J: Matrix3::zeros(),
            H: Matrix3::zeros(),
            M: Matrix3::zeros(),
        }
    }

    pub fn of(c: &Composite) -> Self {
        Self {
            J: c.J,
            H: c.S.cross_matrix(),
            M: Matrix3::identity() * c.mass,
        }
    }

    pub fn add(&mut self, o: &Self) {
        self.J += o.J;
        self.H += o.H;
        self.M += o.M;
    }

    pub fn times(&self, a: &Twist) -> Wrench {
        Wrench {
            torque: self.J * a.angular + self.H * a.linear,
            force: self.H.tr_mul(&a.angular) + self.M * a.linear,
        }
    }

    /// `self -= u vᵀ` for a symmetric `u vᵀ`.
    pub fn subtract(&mut self, u: &Wrench, v: &Wrench) {
        self.J -= u.torque * v.torque.transpose();
        self.H -= u.torque * v.force.transpose();
        self.M -= u.force * v.force.transpose();
    }

    /// The inertia in the frame E, in which its frame C has the pose `X_EC`.
    pub fn in_parent(&self, X_EC: &Pose) -> Self {
        let (R, p) = (X_EC.rotation.matrix(), &X_EC.translation.vector);
        let turned = |m: &Matrix3<f64>| R * m * R.transpose();
        let (J, H, M, X) = (
            turned(&self.J),
            turned(&self.H),
            turned(&self.M),
            p.cross_matrix(),
        );
        let shifted = H + X * M;
        Self {
            J: J - H * X + X * shifted.transpose(),
            H: shifted,
            M,
        }
    }

    /// Acceleration of a free body on which `-force` acts. NaN if the inertia is singular.
    pub fn free_acceleration(&self, force: &Wrench) -> Twist {
        let nan = Matrix3::from_element(f64::NAN);
        let inverse = self.M.try_inverse().unwrap_or(nan);
        let eliminated = self.H * inverse;
        let schur = self.J - eliminated * self.H.transpose();
        let moment = eliminated * force.force - force.torque;
        let angular = schur.try_inverse().unwrap_or(nan) * moment;
        let linear = -(inverse * (force.force + self.H.tr_mul(&angular)));
        Twist { angular, linear }
    }
}
