//! Twists (spatial velocities) and wrenches (spatial forces), with named parts instead of a stacked vector of six.

use nalgebra::Vector3;
use std::ops::{Add, AddAssign, Mul, Neg, Sub, SubAssign};

use super::Pose;

/// Spatial velocity of a frame: `angular` \[rad/s\] and `linear`, the velocity of the frame's origin
/// \[m/s\], both expressed in one frame. Also used for other motion-like quantities: the motion along a joint's axis, and
/// accelerations, whose linear part is that of the point at the frame's origin.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Twist {
    /// Angular part \[rad/s\].
    pub angular: Vector3<f64>,
    /// Linear part: velocity of the point at the frame's origin \[m/s\].
    pub linear: Vector3<f64>,
}

/// Spatial force: `torque` about the frame's origin \[N m\] and `force` \[N\], both expressed in one
/// frame. Also used for momentum (angular \[N m s\], linear \[N s\]).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Wrench {
    /// Moment about the frame's origin \[N m\].
    pub torque: Vector3<f64>,
    /// Force \[N\].
    pub force: Vector3<f64>,
}

impl Twist {
    /// The zero twist.
    pub const ZERO: Self = Self {
        angular: Vector3::new(0.0, 0.0, 0.0),
        linear: Vector3::new(0.0, 0.0, 0.0),
    };

    /// A twist from its angular and linear parts, in this order.
    #[inline]
    pub const fn new(angular: Vector3<f64>, linear: Vector3<f64>) -> Self {
        Self { angular, linear }
    }

    /// The same motion seen from frame A's origin and axes, where `X_AB` is the pose of this twist's
    /// frame B in A.
    #[inline]
    pub fn shifted_to_parent(&self, X_AB: &Pose) -> Self {
        let angular = X_AB.rotation * self.angular;
        let linear = X_AB.rotation * self.linear + X_AB.translation.vector.cross(&angular);
        Self { angular, linear }
    }

    /// The same motion seen from frame B's origin and axes, where `X_AB` is the pose of B in this
    /// twist's frame A.
    #[inline]
    pub fn shifted_to_child(&self, X_AB: &Pose) -> Self {
        let linear = self.linear + self.angular.cross(&X_AB.translation.vector);
        Self {
            angular: X_AB.rotation.inverse_transform_vector(&self.angular),
            linear: X_AB.rotation.inverse_transform_vector(&linear),
        }
    }

    /// Spatial cross product of motions: the rate of change of `other` when its frame moves with `self`.
    #[inline]
    pub fn cross(&self, other: &Self) -> Self {
        Self {
            angular: self.angular.cross(&other.angular),
            linear: self.angular.cross(&other.linear) + self.linear.cross(&other.angular),
        }
    }

    /// Spatial cross product with a force: the rate of change of `force` when its frame moves with `self`.
    #[inline]
    pub fn cross_force(&self, force: &Wrench) -> Wrench {
        Wrench {
            torque: self.angular.cross(&force.torque) + self.linear.cross(&force.force),
            force: self.angular.cross(&force.force),
        }
    }

    /// Power \[W\] that `wrench` delivers along this twist (same frame).
    #[inline]
    pub fn dot(&self, wrench: &Wrench) -> f64 {
        self.angular.dot(&wrench.torque) + self.linear.dot(&wrench.force)
    }
}

impl Wrench {
    /// The zero wrench.
    pub const ZERO: Self = Self {
        torque: Vector3::new(0.0, 0.0, 0.0),
        force: Vector3::new(0.0, 0.0, 0.0),
    };

    /// A wrench from its torque and force, in this order.
    #[inline]
    pub const fn new(torque: Vector3<f64>, force: Vector3<f64>) -> Self {
        Self { torque, force }
    }

    /// Whether any of `wrenches` is not zero. Branchless, since every evaluation calls it.
    #[inline]
    pub(crate) fn any(wrenches: &[Self]) -> bool {
        // The union of all bits except the signs: faster than a sum, whose additions depend on each other.
        let mut bits = 0;
        for Self { torque, force } in wrenches {
            for part in [torque, force] {
                bits |= part.x.to_bits() | part.y.to_bits() | part.z.to_bits();
            }
        }
        bits << 1 != 0
    }

    /// The same wrench about a new reference point, from which the present one lies at `p` (same axes).
    #[inline]
    pub fn shifted(&self, p: &Vector3<f64>) -> Self {
        Self {
            torque: self.torque + p.cross(&self.force),
            force: self.force,
        }
    }

    /// The same wrench about frame A's origin in A's axes, where `X_AB` is the pose of this wrench's
    /// frame B in A.
    #[inline]
    pub fn shifted_to_parent(&self, X_AB: &Pose) -> Self {
        let force = X_AB.rotation * self.force;
        let torque = X_AB.rotation * self.torque + X_AB.translation.vector.cross(&force);
        Self { torque, force }
    }

    /// The same wrench about frame B's origin in B's axes, where `X_AB` is the pose of B in this
    /// wrench's frame A.
    #[inline]
    pub fn shifted_to_child(&self, X_AB: &Pose) -> Self {
        let torque = self.torque - X_AB.translation.vector.cross(&self.force);
        Self {
            torque: X_AB.rotation.inverse_transform_vector(&torque),
            force: X_AB.rotation.inverse_transform_vector(&self.force),
        }
    }
}

macro_rules! linear_ops {
    ($type:ident, $a:ident, $b:ident) => {
        impl Add for $type {
            type Output = Self;
            #[inline]
            fn add(self, o: Self) -> Self {
                Self {
                    $a: self.$a + o.$a,
                    $b: self.$b + o.$b,
                }
            }
        }
        impl Sub for $type {
            type Output = Self;
            #[inline]
            fn sub(self, o: Self) -> Self {
                Self {
                    $a: self.$a - o.$a,
                    $b: self.$b - o.$b,
                }
            }
        }
        impl Neg for $type {
            type Output = Self;
            #[inline]
            fn neg(self) -> Self {
                Self {
                    $a: -self.$a,
                    $b: -self.$b,
                }
            }
        }
        impl Mul<f64> for $type {
            type Output = Self;
            #[inline]
            fn mul(self, k: f64) -> Self {
                Self {
                    $a: self.$a * k,
                    $b: self.$b * k,
                }
            }
        }
        impl AddAssign for $type {
            #[inline]
            fn add_assign(&mut self, o: Self) {
                self.$a += o.$a;
                self.$b += o.$b;
            }
        }
        impl SubAssign for $type {
            #[inline]
            fn sub_assign(&mut self, o: Self) {
                self.$a -= o.$a;
                self.$b -= o.$b;
            }
        }
    };
}
linear_ops!(Twist, angular, linear);
linear_ops!(Wrench, torque, force);

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Rotation3, Translation3};

    fn pose() -> Pose {
        Pose::from_parts(
            Translation3::new(0.3, -1.2, 0.7),
            Rotation3::from_euler_angles(0.4, -0.9, 2.1),
        )
    }

    #[test]
    fn power_does_not_depend_on_the_frame() {
        let t = Twist::new(Vector3::new(0.2, -0.5, 1.1), Vector3::new(-2.0, 0.4, 0.9));
        let f = Wrench::new(Vector3::new(3.0, 0.1, -0.6), Vector3::new(0.7, 5.0, -1.5));
        let moved = t
            .shifted_to_parent(&pose())
            .dot(&f.shifted_to_parent(&pose()));
        assert!((moved - t.dot(&f)).abs() < 1e-14);
    }

    #[test]
    fn shifting_there_and_back_is_the_identity() {
        let t = Twist::new(Vector3::new(0.2, -0.5, 1.1), Vector3::new(-2.0, 0.4, 0.9));
        let back = t.shifted_to_parent(&pose()).shifted_to_child(&pose());
        assert!((back - t).angular.norm() + (back - t).linear.norm() < 1e-15);
        let f = Wrench::new(Vector3::new(3.0, 0.1, -0.6), Vector3::new(0.7, 5.0, -1.5));
        let back = f.shifted_to_parent(&pose()).shifted_to_child(&pose());
        assert!((back - f).torque.norm() + (back - f).force.norm() < 2e-15);
    }

    #[test]
    fn cross_products_are_dual() {
        let v = Twist::new(Vector3::new(0.2, -0.5, 1.1), Vector3::new(-2.0, 0.4, 0.9));
        let m = Twist::new(Vector3::new(1.3, 0.6, -0.2), Vector3::new(0.5, 0.8, -1.0));
        let f = Wrench::new(Vector3::new(3.0, 0.1, -0.6), Vector3::new(0.7, 5.0, -1.5));
        assert!((v.cross(&m).dot(&f) + m.dot(&v.cross_force(&f))).abs() < 1e-14);
    }
}
