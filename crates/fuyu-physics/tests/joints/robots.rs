//! Robots with closed forms, and one without.

use fuyu_physics::dynamics::{Floating, IntegrationMethod, State};
use fuyu_physics::model::{Joint, JointKind, JointLimits, Model, ModelBuilder, Spring};
use fuyu_physics::spatial::{Pose, RigidInertia};
use nalgebra::{DMatrix, DVector, Matrix3, Rotation3, Translation3, Unit, Vector3};

pub fn body(mass: f64, com: [f64; 3], moment: f64) -> RigidInertia {
    RigidInertia {
        mass,
        com: Vector3::from(com),
        about_com: Matrix3::from_diagonal(&Vector3::new(moment, 1.1 * moment, moment)),
    }
}

pub fn joint(axis: Unit<Vector3<f64>>, X_PJ: Pose) -> Joint {
    Joint {
        name: "joint".to_owned(),
        kind: JointKind::Revolute,
        axis,
        X_PJ,
        limits: JointLimits::NONE,
        damping: 0.0,
        friction: 0.0,
        spring: Spring::default(),
    }
}

/// Bodies that turn about one common axis through their centres of mass, with these moments of inertia about it, and what
/// `change` makes of their joints. All terms are constant, so every motion has a closed form.
pub fn coaxial(moments: &[f64], change: impl Fn(usize, &mut Joint)) -> Model {
    let mut builder = ModelBuilder::new("coaxial", "base", body(5.0, [0.0; 3], moments[0]));
    for (j, moment) in moments[1..].iter().enumerate() {
        let mut hinge = joint(Vector3::z_axis(), Pose::identity());
        hinge.name = format!("joint{j}");
        change(j, &mut hinge);
        builder.joint(&format!("link{j}"), j, hinge, body(1.0, [0.0; 3], *moment));
    }
    builder.build()
}

/// Reduced inertia of [`coaxial`] bodies without momentum: body b turns with the base and the joints before it. From the kinetic
/// energy, `Σ_b I_b w_b²`, with the base's rate eliminated by `Σ_b I_b w_b = 0`.
pub fn coaxial_inertia(moments: &[f64]) -> DMatrix<f64> {
    let n = moments.len() - 1;
    let beyond = |j: usize| moments[j + 1..].iter().sum::<f64>();
    let total: f64 = moments.iter().sum();
    DMatrix::from_fn(n, n, |i, j| {
        beyond(i.max(j)) - beyond(i) * beyond(j) / total
    })
}

/// An arm of six joints, one of them prismatic, on a free base, without closed form. `change` sets damping and the like.
pub fn arm(change: impl Fn(usize, &mut Joint)) -> Model {
    let mut builder = ModelBuilder::new("arm", "base", body(40.0, [0.1, 0.0, -0.05], 4.0));
    for j in 0..6 {
        let axis = [Vector3::z_axis(), Vector3::y_axis(), Vector3::x_axis()][j % 3];
        let X_PJ = Pose::from_parts(
            Translation3::new(0.3, 0.05 * j as f64, 0.1),
            Rotation3::from_euler_angles(0.2, 0.1 * j as f64, -0.3),
        );
        let mut hinge = joint(axis, X_PJ);
        hinge.name = format!("joint{j}");
        if j == 3 {
            hinge.kind = JointKind::Prismatic;
        }
        change(j, &mut hinge);
        let mass = 6.0 / (1.0 + j as f64);
        builder.joint(
            &format!("link{j}"),
            j,
            hinge,
            body(mass, [0.1, 0.02, 0.0], 0.02 * mass),
        );
    }
    builder.build()
}

/// A moving state of [`arm`] with momentum.
pub fn moving(model: &Model) -> State {
    let mut state = State::at_rest_with(model, &DVector::from_fn(6, |j, _| 0.3 * j as f64 - 0.8));
    state.qd = DVector::from_fn(6, |j, _| 0.4 * (1.0 + 2.0 * j as f64).cos());
    state.momentum_W.linear = Vector3::new(3.0, -2.0, 1.0);
    state.momentum_W.angular = Vector3::new(0.5, 1.0, -0.7);
    state
}

pub fn floating(model: &Model, state: State) -> Floating {
    Floating::new(model.clone(), state, IntegrationMethod::Dop8)
}

/// Largest relative changes of momentum, summed over the bodies, against that of the state.
pub fn momentum_error(robot: &Floating) -> f64 {
    let (carried, (linear, angular)) = robot.workspace().carried_momentum_and_scale();
    let state = robot.state();
    let known = state.momentum_W.expressed_in(&state.R_WB);
    let relative = |error: f64, scale: f64| error / scale.max(1.0);
    let linear = relative((carried.linear - known.linear).norm(), linear);
    linear.max(relative((carried.angular - known.angular).norm(), angular))
}

/// How far kinetic energy less work has moved from `before`, relative to the energy turned over.
pub fn energy_error(robot: &Floating, before: f64) -> f64 {
    let state = robot.state();
    let turned_over = before.abs() + state.dissipated.total() + robot.workspace().kinetic_energy();
    (robot.workspace().kinetic_energy() - state.work - before).abs() / turned_over.max(1e-3)
}

/// Kinetic energy less work.
pub fn energy(robot: &Floating) -> f64 {
    robot.workspace().kinetic_energy() - robot.state().work
}
