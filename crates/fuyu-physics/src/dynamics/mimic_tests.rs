//! Mimic joints in every formulation, checked against the same tree with all its joints free, and against closed forms.

use nalgebra::{DMatrix, DVector, Isometry3, Matrix3, Matrix6xX, Translation3, UnitQuaternion};
use nalgebra::{Unit, Vector3};
use rand::{RngExt, SeedableRng, rngs::StdRng};

use super::newton_euler::{Axis, BodyState};
use super::*;
use crate::model::{Joint, JointKind, JointLimits, Model, ModelBuilder, Spring};
use crate::spatial::{Pose, RigidInertia, Twist, Wrench};

/// Follower, leader (bodies), ratio and offset: a chain of two, and a leader behind its followers.
const FOLLOWS: [(usize, usize, f64, f64); 3] =
    [(2, 5, -1.7, 0.3), (4, 2, 0.5, -0.2), (6, 3, 2.0, 0.1)];

fn vector(random: &mut StdRng, scale: f64) -> Vector3<f64> {
    Vector3::from_fn(|_, _| random.random_range(-scale..scale))
}

fn body(random: &mut StdRng) -> RigidInertia {
    let second = Vector3::from_fn(|_, _| random.random_range(0.1..0.5));
    RigidInertia {
        mass: random.random_range(1.0..5.0),
        com: vector(random, 0.5),
        about_com: Matrix3::from_diagonal(&(Vector3::repeat(second.sum()) - second)),
    }
}

/// A branched tree of seven bodies, with mimic joints or without.
fn robot(seed: u64, with_mimics: bool) -> Model {
    let mut random = StdRng::seed_from_u64(seed);
    let mut builder = ModelBuilder::new("random", "base", body(&mut random));
    for (k, parent) in [0, 1, 2, 1, 0, 5].into_iter().enumerate() {
        let slides = k == 3;
        let joint = Joint {
            name: format!("joint{}", k + 1),
            kind: if slides {
                JointKind::Prismatic
            } else {
                JointKind::Continuous
            },
            axis: Unit::new_normalize(vector(&mut random, 1.0)),
            X_PJ: Pose::from_parts(
                Translation3::from(vector(&mut random, 1.0)),
                nalgebra::Rotation3::new(vector(&mut random, 2.0)),
            ),
            limits: JointLimits::NONE,
            damping: random.random_range(0.0..2.0),
            friction: 0.0,
            spring: Spring {
                stiffness: random.random_range(0.0..3.0),
                rest: random.random_range(-1.0..1.0),
            },
        };
        builder.joint(&format!("body{}", k + 1), parent, joint, body(&mut random));
    }
    if with_mimics {
        for (follower, leader, ratio, offset) in FOLLOWS {
            builder.mimic(follower, leader, ratio, offset);
        }
    }
    builder.build()
}

/// `S` and `b` by hand: coordinates are joints 1, 3 and 5.
fn coupling() -> (DMatrix<f64>, DVector<f64>) {
    #[rustfmt::skip]
    let s = DMatrix::from_row_slice(6, 3, &[
        1.0, 0.0, 0.0,
        0.0, 0.0, -1.7,
        0.0, 1.0, 0.0,
        0.0, 0.0, -0.85,
        0.0, 0.0, 1.0,
        0.0, 2.0, 0.0,
    ]);
    let b = DVector::from_row_slice(&[0.0, 0.3, 0.0, 0.5 * 0.3 - 0.2, 0.0, 0.1]);
    (s, b)
}

struct Case {
    mimicking: Model,
    free: Model,
    state: State,
    free_state: State,
    input: Input,
}

/// A robot in motion with momentum, under efforts and wrenches.
fn case(seed: u64) -> Case {
    let (mimicking, free) = (robot(seed, true), robot(seed, false));
    let mut random = StdRng::seed_from_u64(1000 + seed);
    let (s, b) = coupling();
    let mut state = State::at_rest(&mimicking);
    state.q = DVector::from_fn(3, |_, _| random.random_range(-2.0..2.0));
    state.qd = DVector::from_fn(3, |_, _| random.random_range(-2.0..2.0));
    let mut free_state = State::at_rest(&free);
    (free_state.q, free_state.qd) = (&s * &state.q + b, &s * &state.qd);
    let turn = UnitQuaternion::from_scaled_axis(vector(&mut random, 2.0));
    let pose = Isometry3::from_parts(Translation3::from(vector(&mut random, 1.0)), turn);
    let twist = Twist::new(vector(&mut random, 1.0), vector(&mut random, 1.0));
    state.set_base(&mut Workspace::new(&mimicking), &pose, &twist);
    free_state.set_base(&mut Workspace::new(&free), &pose, &twist);
    let mut input = Input::zero(&mimicking);
    input.efforts = DVector::from_fn(3, |_, _| random.random_range(-5.0..5.0));
    for wrench in &mut input.wrenches {
        *wrench = Wrench::new(vector(&mut random, 1.0), vector(&mut random, 1.0));
    }
    Case {
        mimicking,
        free,
        state,
        free_state,
        input,
    }
}

fn close(what: &str, found: &[f64], expected: &[f64]) {
    assert_eq!(found.len(), expected.len(), "{what}");
    let scale = expected.iter().fold(1e-3_f64, |m, x| m.max(x.abs()));
    for (a, b) in found.iter().zip(expected) {
        assert!(
            (a - b).abs() < 1e-12 * scale,
            "{what}: {found:?} {expected:?}"
        );
    }
}

#[test]
fn matrices_are_those_of_the_free_tree_times_the_coupling() {
    let (s, _) = coupling();
    for seed in 0..10 {
        let Case {
            mimicking,
            free,
            state,
            free_state,
            ..
        } = case(seed);
        assert_eq!((mimicking.dof(), free.dof()), (3, 6));
        let (mut a, mut b) = (Workspace::new(&mimicking), Workspace::new(&free));
        a.set_positions(&state.q);
        b.set_positions(&free_state.q);
        close("centre of mass", a.p_BC().as_slice(), b.p_BC().as_slice());
        let reduced = s.transpose() * b.reduced_inertia() * &s;
        close(
            "reduced inertia",
            a.reduced_inertia().as_slice(),
            reduced.as_slice(),
        );
        let mut columns = (Matrix6xX::zeros(3), Matrix6xX::zeros(6));
        let compare = |what, columns: &(Matrix6xX<f64>, Matrix6xX<f64>)| {
            close(what, columns.0.as_slice(), (&columns.1 * &s).as_slice());
        };
        a.base_map(&mut columns.0);
        b.base_map(&mut columns.1);
        compare("base map", &columns);
        for (frame, same) in mimicking.frames().iter().zip(free.frames()) {
            a.generalized_jacobian(frame, &mut columns.0);
            b.generalized_jacobian(same, &mut columns.1);
            compare("generalized Jacobian", &columns);
            a.fixed_base_jacobian(frame, &mut columns.0);
            b.fixed_base_jacobian(same, &mut columns.1);
            compare("fixed-base Jacobian", &columns);
            let poses = [a.X_BF(frame), b.X_BF(same)].map(|X| X.to_homogeneous());
            close("pose", poses[0].as_slice(), poses[1].as_slice());
        }
        a.set_motion(&state);
        b.set_motion(&free_state);
        let energies = [a.kinetic_energy(), b.kinetic_energy()];
        close("energy", &energies[..1], &energies[1..]);
        let momenta = [&a, &b].map(|w| w.carried_momentum().angular);
        close("momentum", momenta[0].as_slice(), momenta[1].as_slice());
        let stated = state.momentum_W.expressed_in(&state.R_WB).angular;
        close(
            "momentum of the state",
            momenta[0].as_slice(),
            stated.as_slice(),
        );
    }
}

#[test]
fn all_formulations_agree_on_accelerations() {
    for seed in 0..10 {
        let Case {
            mimicking,
            state,
            input,
            ..
        } = case(seed);
        let mut results = Vec::new();
        for (name, kind) in FormulationKind::NAMES {
            let mut dynamics = kind.prepare(&mimicking).unwrap();
            let mut out = Evaluation::zero(&mimicking);
            dynamics.evaluate(&state, &mut Workspace::new(&mimicking), &input, &mut out);
            results.push((name, out.acceleration.qdd, out.acceleration.A_WB_B));
        }
        let with_com = Kane::new(&mimicking).with_base_speed(BaseSpeed::SystemCom);
        let mut out = Evaluation::zero(&mimicking);
        let mut with_com = with_com;
        with_com.evaluate(&state, &mut Workspace::new(&mimicking), &input, &mut out);
        results.push((
            "kane, centre of mass",
            out.acceleration.qdd,
            out.acceleration.A_WB_B,
        ));
        let (_, expected, base) = results[0].clone();
        for (name, qdd, A_WB_B) in &results[1..] {
            close(name, qdd.as_slice(), expected.as_slice());
            close(name, A_WB_B.linear.as_slice(), base.linear.as_slice());
            close(name, A_WB_B.angular.as_slice(), base.angular.as_slice());
        }
    }
}

/// The accelerations equal those of the free tree under the coupling forces, which do no work: `Sᵀ τ_t` is the effort
/// of actuators, springs and dampers. This check shares neither the gathering of matrices nor that of passive efforts.
#[test]
fn accelerations_are_those_of_the_free_tree_under_coupling_forces() {
    let (s, _) = coupling();
    for seed in 0..10 {
        let Case {
            mimicking,
            free,
            state,
            free_state,
            input,
        } = case(seed);
        let mut workspace = Workspace::new(&mimicking);
        let mut out = Evaluation::zero(&mimicking);
        let mut dynamics = FormulationKind::ArticulatedBody
            .prepare(&mimicking)
            .unwrap();
        dynamics.evaluate(&state, &mut workspace, &input, &mut out);
        let qdd = out.acceleration.qdd;
        let motion = |q, qd| TreeMotion {
            R_WB: state.R_WB,
            V_WB_B: *workspace.V_WB_B(),
            q,
            qd,
        };
        // Actuator efforts that the free tree needs for these accelerations, in addition to its springs and dampers.
        let tree_qdd = &s * &qdd;
        let mut efforts = vec![0.0; 6];
        let at = motion(free_state.q.as_slice(), free_state.qd.as_slice());
        let base = InverseDynamics::new(&free).free_floating_efforts(
            &at,
            tree_qdd.as_slice(),
            &input.wrenches,
            &mut efforts,
        );
        let along = s.transpose() * DVector::from_vec(efforts);
        close("efforts", along.as_slice(), input.efforts.as_slice());
        close(
            "base",
            base.linear.as_slice(),
            out.acceleration.A_WB_B.linear.as_slice(),
        );
        // And the inverse dynamics of the mimicking robot itself.
        let mut efforts = vec![0.0; 3];
        let at = motion(state.q.as_slice(), state.qd.as_slice());
        InverseDynamics::new(&mimicking).free_floating_efforts(
            &at,
            qdd.as_slice(),
            &input.wrenches,
            &mut efforts,
        );
        close("inverse dynamics", &efforts, input.efforts.as_slice());
        // Accelerations of all bodies, the followers' too.
        workspace.set_positions(&state.q);
        workspace.set_motion(&state);
        let mut again = DVector::zeros(3);
        workspace.accelerations(&state, &input, &mut again);
        workspace.set_accelerations(&again);
        let mut tree = Workspace::new(&free);
        tree.set_positions(&free_state.q);
        tree.set_motion(&free_state);
        let mut free_input = Input::zero(&free);
        free_input.wrenches.clone_from(&input.wrenches);
        tree.accelerations(&free_state, &free_input, &mut DVector::zeros(6));
        tree.set_accelerations(&tree_qdd);
        for (frame, same) in mimicking.frames().iter().zip(free.frames()) {
            let [a, b] = [workspace.A_WF_B(frame), tree.A_WF_B(same)];
            close("acceleration", a.linear.as_slice(), b.linear.as_slice());
            close("acceleration", a.angular.as_slice(), b.angular.as_slice());
        }
    }
}

#[test]
fn motion_conserves_momentum_and_energy() {
    let Case {
        mimicking, state, ..
    } = case(3);
    let mut robot = Floating::new(mimicking, state.clone(), IntegrationMethod::Dop8);
    let energy = |robot: &Floating| robot.workspace().kinetic_energy() - robot.state().work;
    let (before, momentum) = (energy(&robot), state.momentum_W);
    robot.step(0.005, 400);
    assert_eq!(robot.state().momentum_W, momentum);
    let carried = robot.workspace().carried_momentum().angular;
    let expected = momentum.expressed_in(&robot.state().R_WB).angular;
    assert!((carried - expected).norm() < 1e-12 * expected.norm());
    assert!(
        (energy(&robot) - before).abs() < 1e-9 * before,
        "{}",
        energy(&robot) - before
    );
}

/// A gear train in line: with an immense base, a torque `τ` on the first of two flywheels accelerates it by `τ / (I_1 +
/// n² I_2)`, and the gear has the torque `n I_2` times the acceleration of the second.
#[test]
fn reflected_inertia_of_a_gear_train() {
    let wheel = |inertia: f64| RigidInertia {
        mass: 1.0,
        com: Vector3::zeros(),
        about_com: Matrix3::identity() * inertia,
    };
    let mut builder = ModelBuilder::new("gears", "base", wheel(1e15));
    let at = |x: f64| Pose::from(Translation3::new(x, 0.0, 0.0));
    let turn = JointKind::Continuous;
    let first = builder.body("first", 0, turn, Vector3::z_axis(), at(0.0), wheel(0.3));
    let second = builder.body("second", 0, turn, Vector3::z_axis(), at(1.0), wheel(0.02));
    builder.mimic(second, first, -5.0, 0.7);
    let model = builder.build();
    let mut state = State::at_rest(&model);
    state.q[0] = 0.4;
    let mut input = Input::zero(&model);
    input.efforts[0] = 2.0;
    let expected = 2.0 / (0.3 + 25.0 * 0.02);
    for (name, kind) in FormulationKind::NAMES {
        let mut out = Evaluation::zero(&model);
        let mut dynamics = kind.prepare(&model).unwrap();
        dynamics.evaluate(&state, &mut Workspace::new(&model), &input, &mut out);
        let found = out.acceleration.qdd[0];
        assert!(
            (found - expected).abs() < 1e-12 * expected,
            "{name}: {found}"
        );
        if let ForwardDynamics::NewtonEuler(matrix) = &dynamics {
            let torque = matrix.method().hinge_efforts(2)[Axis::RotationZ.index()];
            assert!((torque - -5.0 * 0.02 * expected).abs() < 1e-12);
        }
    }
    // The second wheel is where the coupling puts it.
    let mut workspace = Workspace::new(&model);
    workspace.set_positions(&state.q);
    let angle = workspace
        .X_BF(model.frame("second").unwrap())
        .rotation
        .angle();
    assert!((angle - (5.0 * 0.4 - 0.7)).abs() < 1e-14);
}

#[test]
fn systems_of_the_matrix_method_keep_the_coupling() {
    let model = robot(5, true);
    let system = newton_euler::System::from_model(&model).unwrap();
    let start = newton_euler::Start::new()
        .with("joint1", Axis::RotationZ, 0.2, 0.5)
        .with("joint5", Axis::RotationZ, -0.3, 0.8);
    let mut state = system.assemble(&start).unwrap();
    let mut method = newton_euler::MatrixMethod::new(&system);
    let load = newton_euler::Load::zero(&system);
    let gap = |state: &[f64]| {
        let follower = system.displacement(state, 2)[Axis::RotationZ.index()];
        let leader = system.displacement(state, 5)[Axis::RotationZ.index()];
        follower - (-1.7 * leader + 0.3)
    };
    assert!(gap(&state).abs() < 1e-12);
    // Euler steps leave the constraint, and projection returns to it.
    for _ in 0..20 {
        let mut rates = vec![0.0; state.len()];
        method.derivative(&system, &state, &load, &mut rates);
        for (x, rate) in state.iter_mut().zip(&rates) {
            *x += 0.01 * rate;
        }
        method.project(&system, &mut state);
    }
    assert!(gap(&state).abs() < 1e-12, "{}", gap(&state));
    assert!(system.displacement(&state, 5)[Axis::RotationZ.index()] > -0.3);
    let moved = BodyState::read(&state, 0).p_WC.norm();
    assert!(moved > 0.0);
    let follower = newton_euler::Start::new().with("joint2", Axis::RotationZ, 0.1, 0.0);
    assert!(system.assemble(&follower).is_err());
}

#[cfg(feature = "batch")]
#[test]
fn batches_are_bit_identical_to_single_runs() {
    let Case {
        mimicking, state, ..
    } = case(7);
    let mut batch = Batch::new(&mimicking, IntegrationMethod::Rk4, 11);
    let mut single = Vec::new();
    for index in 0..11 {
        let mut start = state.clone();
        start.q[1] += 0.1 * index as f64;
        batch.set_state(index, &start);
        batch.hold_efforts(index, &[1.0, -0.5, 0.2]);
        let mut robot = Floating::new(mimicking.clone(), start, IntegrationMethod::Rk4);
        robot.hold_efforts(&[1.0, -0.5, 0.2]);
        robot.step(0.01, 20);
        single.push(robot.state().clone());
    }
    batch.step(0.01, 20);
    for (index, expected) in single.iter().enumerate() {
        assert_eq!(batch.state(index), *expected);
    }
}

#[test]
fn limits_of_followers_narrow_those_of_their_leader() {
    let limited = |lower, upper, velocity| JointLimits {
        lower,
        upper,
        velocity,
        effort: 3.0,
    };
    let mut random = StdRng::seed_from_u64(1);
    let mut builder = ModelBuilder::new("gripper", "base", body(&mut random));
    let mut finger = |name: &str, limits| {
        let joint = Joint {
            name: name.to_owned(),
            kind: JointKind::Prismatic,
            axis: Vector3::x_axis(),
            X_PJ: Pose::identity(),
            limits,
            damping: 1.0,
            friction: 0.5,
            spring: Spring {
                stiffness: 4.0,
                rest: 1.0,
            },
        };
        builder.joint(name, 0, joint, body(&mut random))
    };
    let left = finger("left", limited(0.0, 0.1, 1.0));
    let right = finger("right", limited(-0.1, 0.02, 1.0));
    builder.mimic(right, left, -2.0, 0.01);
    let model = builder.build();
    let joint = &model.joints()[0];
    // -2 q + 0.01 is in -0.1 .. 0.02 for q in -0.005 .. 0.055; rates are twice as large.
    assert!((joint.limits.lower - 0.0).abs() < 1e-15 && (joint.limits.upper - 0.055).abs() < 1e-15);
    assert_eq!((joint.limits.velocity, joint.limits.effort), (0.5, 3.0));
    assert_eq!((joint.damping, joint.friction), (5.0, 1.5));
    // Springs: 4 (1 - q) - 2 · 4 (1 - (-2 q + 0.01)) = -3.92 - 20 q.
    assert!((joint.passive_effort(0.3, 0.0) - (-3.92 - 6.0)).abs() < 1e-12);
    assert_eq!(model.mimics().count(), 1);
    assert_eq!((model.joint_body(0), model.joint_parent(0)), (1, 0));
}

#[test]
#[should_panic(expected = "follows itself")]
fn a_cycle_of_mimic_joints_is_refused() {
    let mut random = StdRng::seed_from_u64(1);
    let mut builder = ModelBuilder::new("cycle", "base", body(&mut random));
    for name in ["a", "b"] {
        let (axis, at) = (Vector3::z_axis(), Pose::identity());
        builder.body(name, 0, JointKind::Continuous, axis, at, body(&mut random));
    }
    builder.mimic(1, 2, 1.0, 0.0);
    builder.mimic(2, 1, 1.0, 0.0);
    builder.build();
}
