//! The axis of a joint, with its type of motion.

use nalgebra::Vector3;

use crate::spatial::{Twist, Wrench};

/// Axis along which a joint moves, in base axes.
#[derive(Debug, Clone, Copy)]
pub(super) enum Axis {
    /// The body rotates about this direction.
    Turn(Vector3<f64>),
    /// The body translates along this direction.
    Slide(Vector3<f64>),
}

impl Axis {
    /// Component of `wrench` along the axis: the joint effort.
    #[inline]
    pub(super) fn effort(&self, wrench: &Wrench) -> f64 {
        match self {
            Self::Turn(direction) => direction.dot(&wrench.torque),
            Self::Slide(direction) => direction.dot(&wrench.force),
        }
    }

    /// Twist of the moved body relative to its parent at joint rate `rate`.
    #[inline]
    pub(super) fn twist(&self, rate: f64) -> Twist {
        match self {
            Self::Turn(direction) => Twist::new(direction * rate, Vector3::zeros()),
            Self::Slide(direction) => Twist::new(Vector3::zeros(), direction * rate),
        }
    }
}
