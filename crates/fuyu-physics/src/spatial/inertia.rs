//! Mass properties of rigid bodies: about the centre of mass, as in a URDF ([`RigidInertia`]), and about a frame's
//! origin, as in the recursions ([`SpatialInertia`]).

use nalgebra::{Matrix3, SymmetricEigen, Vector3};
use std::ops::{Add, AddAssign};

use super::{Pose, Symmetric3, Twist, Wrench};

/// Mass, centre of mass and rotational inertia about that centre of mass, in a body's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RigidInertia {
    /// Mass \[kg\].
    pub mass: f64,
    /// Centre of mass in the body frame \[m\].
    pub com: Vector3<f64>,
    /// Rotational inertia about the centre of mass, in the body frame's axes \[kg m²\].
    pub about_com: Matrix3<f64>,
}

/// Why mass properties are not those of a rigid body.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum InertiaError {
    /// The mass is zero, negative or not finite.
    #[error("mass is {0} kg; it must be positive and finite")]
    Mass(f64),
    /// A component is NaN or infinite.
    #[error("{0} has a component that is not finite")]
    NotFinite(&'static str),
    /// A principal moment is not positive.
    #[error(
        "inertia is not positive definite: its principal moments are {0:.4e}, {1:.4e}, {2:.4e} kg m²; all must be positive"
    )]
    NotPositiveDefinite(f64, f64, f64),
    /// One principal moment exceeds the sum of the others.
    #[error(
        "inertia breaks the triangle inequality: of its principal moments {0:.4e}, {1:.4e}, {2:.4e} kg m² the largest exceeds the sum of the other two"
    )]
    Triangle(f64, f64, f64),
}

impl RigidInertia {
    /// A body without mass, such as a link that only carries other links.
    pub fn zero() -> Self {
        Self {
            mass: 0.0,
            com: Vector3::zeros(),
            about_com: Matrix3::zeros(),
        }
    }

    /// Checks that a rigid body can have these mass properties.
    ///
    /// # Errors
    /// [`InertiaError`] for a non-positive mass, an indefinite inertia, or principal moments that violate the triangle
    /// inequality by more than rounding (1e-9 of the largest: a thin rod satisfies it with equality).
    pub fn check(&self) -> Result<(), InertiaError> {
        if !(self.mass.is_finite() && self.mass > 0.0) {
            return Err(InertiaError::Mass(self.mass));
        }
        if !self.com.iter().all(|x| x.is_finite()) {
            return Err(InertiaError::NotFinite("centre of mass"));
        }
        if !self.about_com.iter().all(|x| x.is_finite()) {
            return Err(InertiaError::NotFinite("inertia"));
        }
        let mut m: [f64; 3] = SymmetricEigen::new(self.about_com).eigenvalues.into();
        m.sort_by(f64::total_cmp);
        // A moment below the rounding error of the largest counts as zero.
        if m[0] <= 1e-14 * m[2].abs() || m[2] <= 0.0 {
            return Err(InertiaError::NotPositiveDefinite(m[0], m[1], m[2]));
        }
        if m[2] > (m[0] + m[1]) + 1e-9 * m[2] {
            return Err(InertiaError::Triangle(m[0], m[1], m[2]));
        }
        Ok(())
    }

    /// The same mass properties in frame A, where `X_AB` is the pose of their frame B in A.
    pub fn expressed_in(&self, X_AB: &Pose) -> Self {
        let r = X_AB.rotation.matrix();
        Self {
            mass: self.mass,
            com: X_AB.rotation * self.com + X_AB.translation.vector,
            about_com: r * self.about_com * r.transpose(),
        }
    }

    /// The two bodies welded together (same frame). A body without mass changes nothing.
    pub fn merged_with(&self, other: &Self) -> Self {
        let mass = self.mass + other.mass;
        if mass == 0.0 {
            return *self;
        }
        let com = (self.com * self.mass + other.com * other.mass) / mass;
        let at = |b: &Self| b.about_com + parallel_axis(&(b.com - com)).to_matrix() * b.mass;
        Self {
            mass,
            com,
            about_com: at(self) + at(other),
        }
    }
}

/// `D(r)` of Masutani 1995 eq. (4.20): the inertia of a unit point mass at `r` about the origin.
#[inline]
pub(crate) fn parallel_axis(r: &Vector3<f64>) -> Symmetric3 {
    Symmetric3::shift(r, &(r * 0.5))
}

/// Spatial inertia about a frame's origin: mass, first moment and second moment.
///
/// The sum of two spatial inertias (same frame) is the inertia of the bodies welded together.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpatialInertia {
    /// Mass \[kg\].
    pub mass: f64,
    /// First moment `m c` about the frame's origin \[kg m\].
    pub first_moment: Vector3<f64>,
    /// Rotational inertia about the frame's origin \[kg m²\].
    pub about_origin: Symmetric3,
}

impl SpatialInertia {
    /// Zero.
    pub const ZERO: Self = Self {
        mass: 0.0,
        first_moment: Vector3::new(0.0, 0.0, 0.0),
        about_origin: Symmetric3::ZERO,
    };

    /// The same inertia about the same point in axes A, where `R_AB` takes components in its axes B to components in A.
    #[inline]
    pub fn rotated(&self, R_AB: &Matrix3<f64>) -> Self {
        Self {
            mass: self.mass,
            first_moment: R_AB * self.first_moment,
            about_origin: self.about_origin.rotated(R_AB),
        }
    }

    /// The same inertia about a new reference point, from which the present one lies at `p` (same axes).
    #[inline]
    pub fn shifted(&self, p: &Vector3<f64>) -> Self {
        // I + m D(p) + 2 (p·h) 1 - p hᵀ - h pᵀ: the parallel-axis theorem without division by m. With g = h + m p / 2,
        // all terms but I are 2 (p·g) 1 - p gᵀ - g pᵀ.
        let half = p * (0.5 * self.mass);
        let g = self.first_moment + half;
        Self {
            mass: self.mass,
            first_moment: g + half,
            about_origin: self.about_origin + Symmetric3::shift(p, &g),
        }
    }

    /// Momentum of a body that moves with `twist`, about the frame's origin.
    #[inline]
    pub fn momentum(&self, twist: &Twist) -> Wrench {
        Wrench {
            torque: &self.about_origin * twist.angular + self.first_moment.cross(&twist.linear),
            force: twist.linear * self.mass - self.first_moment.cross(&twist.angular),
        }
    }
}

impl From<&RigidInertia> for SpatialInertia {
    fn from(b: &RigidInertia) -> Self {
        let com = &b.com;
        Self {
            mass: b.mass,
            first_moment: com * b.mass,
            about_origin: Symmetric3::from(b.about_com)
                + Symmetric3::shift(com, &(com * (0.5 * b.mass))),
        }
    }
}

impl Add for SpatialInertia {
    type Output = Self;
    #[inline]
    fn add(mut self, o: Self) -> Self {
        self += o;
        self
    }
}

impl AddAssign for SpatialInertia {
    #[inline]
    fn add_assign(&mut self, o: Self) {
        self.mass += o.mass;
        self.first_moment += o.first_moment;
        self.about_origin += o.about_origin;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Rotation3, Translation3};

    fn body() -> RigidInertia {
        RigidInertia {
            mass: 7.0,
            com: Vector3::new(0.2, -0.4, 0.1),
            about_com: Matrix3::new(2.0, 0.1, -0.2, 0.1, 1.5, 0.3, -0.2, 0.3, 1.8),
        }
    }

    #[test]
    fn shifting_agrees_with_expressing_the_body_in_the_other_frame() {
        let x = Pose::from_parts(
            Translation3::new(0.3, -1.2, 0.7),
            Rotation3::from_euler_angles(0.4, -0.9, 2.1),
        );
        let a = SpatialInertia::from(&body())
            .rotated(x.rotation.matrix())
            .shifted(&x.translation.vector);
        let b = SpatialInertia::from(&body().expressed_in(&x));
        assert!((a.first_moment - b.first_moment).norm() < 1e-14);
        let difference = a.about_origin.to_matrix() - b.about_origin.to_matrix();
        assert!(difference.norm() < 1e-13);
    }

    #[test]
    fn momentum_is_that_of_a_mass_at_its_centre() {
        let t = Twist::new(Vector3::new(0.2, -0.5, 1.1), Vector3::new(-2.0, 0.4, 0.9));
        let b = body();
        let v = t.linear + t.angular.cross(&b.com);
        let h = SpatialInertia::from(&b).momentum(&t);
        assert!((h.force - v * b.mass).norm() < 1e-14);
        assert!((h.torque - (b.about_com * t.angular + b.com.cross(&(v * b.mass)))).norm() < 1e-14);
    }

    #[test]
    fn welding_two_halves_makes_the_whole() {
        // A rod of 2 kg and 2 m, from its two halves.
        let half = |x: f64| RigidInertia {
            mass: 1.0,
            com: Vector3::new(x, 0.0, 0.0),
            about_com: Matrix3::from_diagonal(&Vector3::new(1e-3, 1.0 / 12.0, 1.0 / 12.0)),
        };
        let rod = half(-0.5).merged_with(&half(0.5));
        assert!(rod.com.norm() < 1e-16);
        assert!((rod.about_com[(1, 1)] - 2.0 * 4.0 / 12.0).abs() < 1e-15);
    }

    #[test]
    fn impossible_bodies_are_refused() {
        let mut b = body();
        b.mass = -1.0;
        assert_eq!(b.check(), Err(InertiaError::Mass(-1.0)));
        let mut b = body();
        b.about_com = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, 2.1));
        assert!(matches!(b.check(), Err(InertiaError::Triangle(..))));
        b.about_com = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, 2.0));
        assert!(matches!(
            b.check(),
            Err(InertiaError::NotPositiveDefinite(..))
        ));
        b.about_com[(0, 1)] = f64::NAN;
        assert!(matches!(b.check(), Err(InertiaError::NotFinite(_))));
        // A thin disc satisfies the triangle inequality with equality.
        b.about_com = Matrix3::from_diagonal(&Vector3::new(0.1, 0.2, 0.1 + 0.2));
        assert_eq!(b.check(), Ok(()));
    }
}
