//! Mechanisms with closed loops, built by hand.

use fuyu::dynamics::{Direction, LoopClosure, Loops, State};
use fuyu::model::{Joint, JointKind, JointLimits, Model, ModelBuilder, Spring};
use fuyu::spatial::{Pose, RigidInertia};
use nalgebra::{Matrix3, Rotation3, Translation3, Vector3};

pub use Direction::{Pitch, Roll, X, Y, Yaw, Z};

/// Constraints of a hinge about z: `IN_PLANE` has those that are independent in a planar mechanism, `HINGE` has all.
pub const IN_PLANE: &[Direction] = &[X, Y];
pub const HINGE: &[Direction] = &[X, Y, Z, Roll, Pitch];

pub fn at(x: f64, y: f64) -> Pose {
    Translation3::new(x, y, 0.0).into()
}

pub fn body(mass: f64, com_x: f64, moments: [f64; 3]) -> RigidInertia {
    RigidInertia {
        mass,
        com: Vector3::new(com_x, 0.0, 0.0),
        about_com: Matrix3::from_diagonal(&moments.into()),
    }
}

fn joint(
    name: &str,
    kind: JointKind,
    axis: Vector3<f64>,
    X_PJ: Pose,
    damping: f64,
    k: f64,
) -> Joint {
    Joint {
        name: name.to_owned(),
        kind,
        axis: nalgebra::Unit::new_normalize(axis),
        X_PJ,
        limits: JointLimits::NONE,
        damping,
        friction: 0.0,
        spring: Spring {
            stiffness: k,
            rest: 0.0,
        },
    }
}

/// The satellite with a pantograph of TR-942 section 3.3, cut at the hinges h6 and h7. The
/// joints are, in this order, s2, θ2, θ5, s3, θ3, θ4. `damping` scales the damping of the report.
pub fn pantograph(damping: f64) -> Model {
    let massless = RigidInertia::zero();
    let long = || body(20.0, 1.0, [1.0, 5.0, 5.0]);
    let short = || body(10.0, 0.5, [0.2, 1.0, 1.0]);
    let slide = |name, k, d| {
        joint(
            name,
            JointKind::Prismatic,
            Vector3::y(),
            at(1.0, 0.0),
            d * damping,
            k,
        )
    };
    let turn = |name, x, k, d| {
        joint(
            name,
            JointKind::Continuous,
            Vector3::z(),
            at(x, 0.0),
            d * damping,
            k,
        )
    };
    let mut robot = ModelBuilder::new("pantograph", "1", body(200.0, 0.0, [20.0; 3]));
    let c2 = robot.joint("c2", 0, slide("s2", 1.0, 10.0), massless);
    let b2 = robot.joint("2", c2, turn("theta2", 0.0, 4.0, 10.0), long());
    let b5 = robot.joint("5", b2, turn("theta5", 2.0, 0.0, 0.0), short());
    let c3 = robot.joint("c3", 0, slide("s3", 0.0, 0.0), massless);
    let b3 = robot.joint("3", c3, turn("theta3", 0.0, 0.0, 0.0), long());
    let b4 = robot.joint("4", b3, turn("theta4", 2.0, 0.0, 0.0), short());
    for (name, body) in [("h6_2", b2), ("h6_3", b3), ("h7_4", b4), ("h7_5", b5)] {
        robot.frame(name, body, None, at(1.0, 0.0));
    }
    robot.build()
}

/// The hinges h6 and h7.
pub fn pantograph_loops(model: &Model, directions: &[Direction]) -> Loops {
    let hinge = |name, a, b| LoopClosure::between(model, name, a, b, directions).unwrap();
    let closures = vec![hinge("h6", "h6_2", "h6_3"), hinge("h7", "h7_4", "h7_5")];
    Loops::new(model, closures).unwrap()
}

/// The pantograph on its branch: joint positions for s2, θ2 and their rates.
pub fn on_branch(model: &Model, s2: f64, theta: f64, s2_rate: f64, theta_rate: f64) -> State {
    let mut state = State::at_rest(model);
    let s3 = s2 + 2.0 * theta.sin();
    let s3_rate = s2_rate + 2.0 * theta.cos() * theta_rate;
    let q = [s2, theta, -2.0 * theta, s3, -theta, 2.0 * theta];
    let t = theta_rate;
    let qd = [s2_rate, t, -2.0 * t, s3_rate, -t, 2.0 * t];
    state.q.copy_from_slice(&q);
    state.qd.copy_from_slice(&qd);
    state
}

/// A planar four-bar linkage on a free base: crank, coupler and rocker of these lengths, pivots 1 m apart on
/// the base, each with its centre of mass in the middle.
pub const FOUR_BAR: [f64; 3] = [0.4, 0.9, 0.7];
pub const BAR_MASS: [f64; 3] = [2.0, 3.0, 2.5];
pub const BAR_MOMENT: [f64; 3] = [0.05, 0.3, 0.2];
pub const BASE: (f64, f64) = (12.0, 3.0);

pub fn four_bar() -> Model {
    let bar = |i: usize| {
        let i_z = BAR_MOMENT[i];
        body(BAR_MASS[i], FOUR_BAR[i] / 2.0, [0.6 * i_z, 0.7 * i_z, i_z])
    };
    let base = body(BASE.0, 0.0, [2.5, 2.0, BASE.1]);
    let turn = |name, x| {
        joint(
            name,
            JointKind::Continuous,
            Vector3::z(),
            at(x, 0.0),
            0.0,
            0.0,
        )
    };
    let mut robot = ModelBuilder::new("four_bar", "base", base);
    let crank = robot.joint("crank", 0, turn("a", 0.2), bar(0));
    let coupler = robot.joint("coupler", crank, turn("b", FOUR_BAR[0]), bar(1));
    let rocker = robot.joint("rocker", 0, turn("c", 1.2), bar(2));
    robot.frame("coupler_tip", coupler, None, at(FOUR_BAR[1], 0.0));
    robot.frame("rocker_tip", rocker, None, at(FOUR_BAR[2], 0.0));
    robot.build()
}

/// A Bennett linkage on a free base: four hinges whose axes are neither parallel nor meet, which
/// moves only because `a sin β = b sin α`. Lengths and twists of its links.
pub const BENNETT: (f64, f64) = (1.0, 0.7);
pub fn bennett_twists() -> (f64, f64) {
    let alpha: f64 = 0.9;
    (alpha, (alpha.sin() * BENNETT.1 / BENNETT.0).asin())
}

/// Transform from the hinge of a link to the next hinge: a translation along x and a rotation about x.
fn link(length: f64, twist: f64) -> Pose {
    Pose::from_parts(
        Translation3::new(length, 0.0, 0.0),
        Rotation3::from_axis_angle(&Vector3::x_axis(), twist),
    )
}

pub fn bennett() -> Model {
    let ((a, b), (alpha, beta)) = (BENNETT, bennett_twists());
    let bar = |mass: f64, length: f64| body(mass, length / 2.0, [0.05, 0.2, 0.22]);
    let turn = |name, X_PJ| joint(name, JointKind::Continuous, Vector3::z(), X_PJ, 0.0, 0.0);
    let mut robot = ModelBuilder::new("bennett", "base", body(8.0, -0.3, [1.0, 1.2, 1.4]));
    let one = robot.joint("1", 0, turn("theta1", Pose::identity()), bar(2.0, a));
    let two = robot.joint("2", one, turn("theta2", link(a, alpha)), bar(1.5, b));
    let three = robot.joint("3", two, turn("theta3", link(b, beta)), bar(1.0, a));
    robot.frame("end", three, None, link(a, alpha));
    robot.frame("hinge", 0, None, link(b, beta).inverse());
    robot.build()
}
