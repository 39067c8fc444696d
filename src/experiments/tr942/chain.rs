//! Example 1: a satellite with a manipulator of four links (section 3.2).

use nalgebra::{Matrix3, Rotation3, Translation3, Vector3};
use std::f64::consts::{FRAC_PI_2, PI};

use super::{body, hinge};
use crate::dynamics::newton_euler::{Axis, Start, System};
use crate::model::{JointKind, Model, ModelBuilder};
use crate::spatial::Pose;

/// Step of the printed solution \[s\], by Runge-Kutta-Gill.
pub const STEP: f64 = 0.05;

/// Initial angles of hinges 2 to 5 \[rad\], Table 3.2.3; all rates are zero.
pub const INITIAL: [f64; 4] = [FRAC_PI_2, -FRAC_PI_2, PI, -FRAC_PI_2];

/// The angles of hinges 2 and 3 at a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Angles {
    /// Time \[s\].
    pub time: f64,
    /// `θ₂`, `θ₃` \[rad\].
    pub theta: [f64; 2],
}

const fn angles(time: f64, theta_2: f64, theta_3: f64) -> Angles {
    Angles {
        time,
        theta: [theta_2, theta_3],
    }
}

/// The values printed below Table 3.2.4, with all digits.
pub const PRINTED: [Angles; 5] = [
    angles(0.0, 1.5707964, -1.5707964),
    angles(2.0, 5.0269164e-2, -3.3256799e-1),
    angles(4.0, -7.3774916e-1, 1.8884898),
    angles(6.0, -5.0845999e-1, 5.6723559e-1),
    angles(8.0, 7.1992821e-1, -3.2072845e-1),
];

/// The solution without step error, by an independent program (Python): DOP853 at a tolerance of 1e-13.
pub const CONVERGED: [Angles; 4] = [
    angles(2.0, 0.050269493456, -0.332567777886),
    angles(4.0, -0.737754617723, 1.888506610851),
    angles(6.0, -0.508475946424, 0.567258634128),
    angles(8.0, 0.719929152765, -0.320750374962),
];

/// The robot of Tables 3.2.1 and 3.2.2 as printed. Body 2's moments of inertia are physically impossible, but it only
/// rotates about its axis of symmetry. `urdf/tr942_chain.urdf` is the same robot with possible inertias.
pub fn model() -> Model {
    // x3 = -x2, y3 = -z2, z3 = -y2.
    let turned = Matrix3::new(-1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, -1.0, 0.0);
    let turned = Rotation3::from_matrix_unchecked(turned);
    let base = body(200.0, [100.0; 3], [0.0; 3]);
    let mut robot = ModelBuilder::new("tr942_chain", "base_link", base);
    let straight = Rotation3::identity();
    for (number, d, R, control, inertia) in [
        (
            2,
            [-0.5, 0.0, 0.5],
            straight,
            [10.0, 5.0],
            body(10.0, [0.01, 0.01, 0.1], [0.0, 0.0, 0.05]),
        ),
        (
            3,
            [0.0, 0.0, 0.1],
            turned,
            [10.0, 2.0],
            body(50.0, [5.0, 0.5, 5.0], [0.0, -0.5, 0.0]),
        ),
        (
            4,
            [0.0, -1.0, 0.0],
            straight,
            [10.0, 2.0],
            body(40.0, [4.0, 0.4, 4.0], [0.0, -0.5, 0.0]),
        ),
        (
            5,
            [0.0, -1.0, 0.0],
            straight,
            [1.0, 5.0],
            body(30.0, [0.3, 0.3, 0.3], [0.0, -0.15, 0.0]),
        ),
    ] {
        let X_PJ = Pose::from_parts(Translation3::from(Vector3::from(d)), R);
        let joint = hinge(
            &format!("h{number}"),
            JointKind::Continuous,
            Vector3::z_axis(),
            X_PJ,
            control,
        );
        robot.joint(&format!("body{number}"), number - 2, joint, inertia);
    }
    robot.build()
}

/// [`INITIAL`] for the matrix method, with `System::from_model` of [`model`].
pub fn start(system: &System) -> Start {
    let hinges = (1..).zip(INITIAL);
    hinges.fold(Start::new(), |start, (hinge, angle)| {
        start.with(&system.hinges()[hinge].name, Axis::RotationZ, angle, 0.0)
    })
}
