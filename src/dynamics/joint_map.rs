//! Where a joint puts the body that it moves.

use nalgebra::{Matrix3, Unit, Vector3};

use crate::model::Joint;
use crate::spatial::{SpatialInertia, Twist, Wrench};

/// Axis along which a joint moves, in base axes.
#[derive(Debug, Clone, Copy)]
pub(super) enum Axis {
    /// The moved body turns about this direction.
    Turn(Vector3<f64>),
    /// The moved body slides along this direction.
    Slide(Vector3<f64>),
}

impl Axis {
    /// What moving along the axis takes of `wrench`: joint effort.
    #[inline]
    pub(super) fn effort(&self, wrench: &Wrench) -> f64 {
        match self {
            Self::Turn(direction) => direction.dot(&wrench.torque),
            Self::Slide(direction) => direction.dot(&wrench.force),
        }
    }

    /// Momentum of a body that moves along the axis at unit rate.
    #[inline]
    pub(super) fn momentum(&self, inertia: &SpatialInertia) -> Wrench {
        match self {
            Self::Turn(direction) => Wrench {
                torque: &inertia.about_origin * *direction,
                force: direction.cross(&inertia.first_moment),
            },
            Self::Slide(direction) => Wrench {
                torque: inertia.first_moment.cross(direction),
                force: direction * inertia.mass,
            },
        }
    }

    /// What moving at `rate` adds to the body's twist.
    #[inline]
    pub(super) fn twist(&self, rate: f64) -> Twist {
        match self {
            Self::Turn(direction) => Twist::new(direction * rate, Vector3::zeros()),
            Self::Slide(direction) => Twist::new(Vector3::zeros(), direction * rate),
        }
    }
}

/// Pose of a moved body in its parent as a function of joint position, with everything that does not
/// depend on the position multiplied out.
#[derive(Debug, Clone)]
pub(super) enum JointMap {
    /// `R_PB = along + cos q · across + sin q · turning`.
    Turn {
        along: Matrix3<f64>,
        across: Matrix3<f64>,
        turning: Matrix3<f64>,
        p_PB: Vector3<f64>,
        axis_B: Vector3<f64>,
    },
    /// `p_PB = p_PJ + q · axis`.
    Slide {
        R_PB: Matrix3<f64>,
        p_PJ: Vector3<f64>,
        axis_P: Vector3<f64>,
    },
}

impl JointMap {
    pub(super) fn new(joint: &Joint) -> Self {
        let R_PJ = joint.X_PJ.rotation.matrix();
        let p_PJ = joint.X_PJ.translation.vector;
        let axis: Vector3<f64> = Unit::into_inner(joint.axis);
        if joint.kind.is_rotational() {
            let along = R_PJ * axis * axis.transpose();
            Self::Turn {
                along,
                across: R_PJ - along,
                turning: R_PJ * axis.cross_matrix(),
                p_PB: p_PJ,
                axis_B: axis,
            }
        } else {
            Self::Slide {
                R_PB: *R_PJ,
                p_PJ,
                axis_P: R_PJ * axis,
            }
        }
    }

    /// For a parent with axes `R_0P` and a joint at `position`: `R_0B`, `p_PB` and the axis, both in
    /// base axes.
    #[inline]
    pub(super) fn place(
        &self,
        R_0P: &Matrix3<f64>,
        position: f64,
    ) -> (Matrix3<f64>, Vector3<f64>, Axis) {
        match self {
            Self::Turn {
                along,
                across,
                turning,
                p_PB,
                axis_B,
            } => {
                let (sin, cos) = position.sin_cos();
                let R_0B = R_0P * (along + across * cos + turning * sin);
                (R_0B, R_0P * p_PB, Axis::Turn(R_0B * axis_B))
            }
            Self::Slide { R_PB, p_PJ, axis_P } => {
                let axis = R_0P * axis_P;
                (
                    R_0P * R_PB,
                    R_0P * p_PJ + axis * position,
                    Axis::Slide(axis),
                )
            }
        }
    }
}
