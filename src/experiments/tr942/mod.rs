//! The two examples of TR-942, chapter 3: models and printed results.
//!
//! The figures that define the body frames are missing in the text; the frames here were found by search and reproduce
//! the printed numbers. Rounded multiples of a degree in the table are replaced by the exact values.

pub mod chain;
pub mod pantograph;
mod run;

pub use run::{MatrixRun, Run};

use nalgebra::{Matrix3, Vector3};

use crate::model::{Joint, JointKind, JointLimits, Spring};
use crate::spatial::{Pose, RigidInertia};

/// A body: row `W`, `H` (about the centre of mass), `r` of the table.
fn body(mass: f64, moments: [f64; 3], com: [f64; 3]) -> RigidInertia {
    RigidInertia {
        mass,
        com: Vector3::from(com),
        about_com: Matrix3::from_diagonal(&Vector3::from(moments)),
    }
}

/// A hinge with its control law `-K q - D q̇`, (3.2.1), (3.3.1), (3.3.2).
fn hinge(
    name: &str,
    kind: JointKind,
    axis: nalgebra::UnitVector3<f64>,
    X_PJ: Pose,
    [stiffness, damping]: [f64; 2],
) -> Joint {
    Joint {
        name: name.to_owned(),
        kind,
        axis,
        X_PJ,
        limits: JointLimits::NONE,
        damping,
        friction: 0.0,
        spring: Spring {
            stiffness,
            rest: 0.0,
        },
    }
}
