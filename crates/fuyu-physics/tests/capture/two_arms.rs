//! A robot with two arms: a second grasp closes a loop. Rates that servos hold, and ball joints that turn far.

use fuyu_physics::dynamics::capture::{
    Captured, Grasp, JointReaction, Latch, LatchPair, System, close_latches,
};
use fuyu_physics::dynamics::{Floating, IntegrationMethod, State, Workspace};
use fuyu_physics::model::{Frame, JointKind, Model, ModelBuilder};
use fuyu_physics::spatial::{Pose, RigidInertia};
use nalgebra::{DVector, Matrix3, Rotation3, Translation3, Vector3};

use crate::support::{body, floating, momentum, near};

/// Two arms of six joints on one base.
fn two_arms() -> Model {
    let inertia = |mass: f64, x: f64| RigidInertia {
        mass,
        com: Vector3::new(x, 0.0, 0.02),
        about_com: Matrix3::from_diagonal(&Vector3::new(0.1, 0.3, 0.25)) * (0.1 * mass),
    };
    let mut builder = ModelBuilder::new("two_arms", "base_link", inertia(400.0, 0.0));
    let axes = [
        Vector3::z_axis(),
        Vector3::y_axis(),
        Vector3::y_axis(),
        Vector3::x_axis(),
        Vector3::y_axis(),
        Vector3::x_axis(),
    ];
    for (side, y) in [("left", 0.6), ("right", -0.6)] {
        let (mut parent, mut at) = (0, Pose::translation(0.5, y, 0.0));
        for (k, axis) in axes.into_iter().enumerate() {
            let name = format!("{side}{k}");
            parent = builder.body(
                &name,
                parent,
                JointKind::Continuous,
                axis,
                at,
                inertia(8.0 - k as f64, 0.25),
            );
            at = Pose::translation(0.5, 0.0, 0.0);
        }
        builder.frame(
            &format!("{side}_tip"),
            parent,
            None,
            Pose::translation(0.3, 0.0, 0.0),
        );
    }
    builder.build()
}

/// The robot in motion, and a target whose grasp frame is at its left tip.
fn scene() -> (Floating, Floating, Frame) {
    let model = two_arms();
    let q = [
        0.3, 0.5, -0.9, 0.2, 0.6, 0.1, -0.3, 0.6, -1.0, -0.2, 0.5, 0.3,
    ];
    let qd = [
        0.02, -0.03, 0.01, 0.04, -0.02, 0.03, -0.01, 0.02, 0.03, -0.02, 0.01, -0.03,
    ];
    let robot = floating(
        &model,
        Vector3::new(0.1, 0.2, 0.3),
        Default::default(),
        Vector3::new(0.01, -0.02, 0.005),
        Vector3::new(0.01, 0.02, -0.01),
        &q,
        &qd,
    );
    let tip = model.frame("left_tip").unwrap();
    let X_WE = robot.state().X_WB(robot.workspace()) * robot.workspace().X_BF(tip);
    let X_TG = Pose::from_parts(
        Translation3::new(0.2, 0.6, -0.1),
        Rotation3::from_euler_angles(0.3, -0.4, 0.9),
    );
    let X_WT = X_WE * X_TG.inverse();
    let inertia = Matrix3::new(40.0, 2.0, -1.0, 2.0, 55.0, 3.0, -1.0, 3.0, 50.0);
    let R = nalgebra::UnitQuaternion::from_rotation_matrix(&X_WT.rotation);
    let target = floating(
        &body("target", 250.0, inertia),
        X_WT.translation.vector,
        R,
        Vector3::new(0.03, -0.01, 0.02),
        Vector3::new(-0.02, 0.05, 0.03),
        &[],
        &[],
    );
    let grasp = Frame {
        name: "grasp".to_owned(),
        body: 0,
        parent: None,
        X_BF: X_TG,
    };
    (robot, target, grasp)
}

fn grasp(robot: &Model, target: &Frame, latch: Latch, joints: JointReaction) -> Grasp {
    Grasp {
        robot: robot.frame("left_tip").unwrap().clone(),
        target: target.clone(),
        latch,
        joints,
    }
}

/// One latch after the other in an instant is both at once: projections onto nested spaces. The loop that they
/// close stays closed.
#[test]
fn a_second_arm_closes_a_loop() {
    for second in [Latch::Weld, Latch::Ball] {
        let (robot, target, at) = scene();
        let model = robot.model();
        let first = grasp(model, &at, Latch::Weld, JointReaction::Free);
        let (mut captured, _) =
            Captured::new(&robot, &target, &first, IntegrationMethod::Dop8).unwrap();
        let tip = model.frame("right_tip").unwrap();
        let impulses = captured.grasp_again(tip, &at, second).unwrap();
        assert!(impulses.energy_lost > 1e-6);

        // Where the right tip is on the target.
        let X_WE = robot.state().X_WB(robot.workspace()) * robot.workspace().X_BF(tip);
        let X_WT = target.state().X_WB(target.workspace());
        let other = Frame {
            X_BF: X_WT.inverse() * X_WE,
            ..at.clone()
        };
        let (mut of_robot, mut of_target) = (robot.workspace().clone(), target.workspace().clone());
        let mut systems = [
            System {
                state: robot.state(),
                workspace: &mut of_robot,
                joints: &[],
            },
            System {
                state: target.state(),
                workspace: &mut of_target,
                joints: &[],
            },
        ];
        let pairs = [
            LatchPair {
                first: (0, &first.robot),
                second: (1, &first.target),
                latch: Latch::Weld,
            },
            LatchPair {
                first: (0, tip),
                second: (1, &other),
                latch: second,
            },
        ];
        let both = close_latches(&mut systems, &pairs);
        let (q, qd) = captured.robot_joints();
        near("rates", qd.as_slice(), both.states[0].qd.as_slice(), 1e-12);
        near("positions", q.as_slice(), robot.state().q.as_slice(), 1e-12);

        let (P, L) = momentum(&[robot.state(), target.state()]);
        let energy = captured.floating().workspace().kinetic_energy();
        let before = robot.workspace().kinetic_energy() + target.workspace().kinetic_energy();
        assert!((before - energy - both.energy_lost).abs() < 1e-12 * before);
        captured.step(0.01, 1000);
        let system = captured.floating();
        let (P_now, L_now) = momentum(&[system.state()]);
        assert!((P - P_now).norm() < 1e-13 * P.norm() && (L - L_now).norm() < 1e-12 * L.norm());
        let drift = (system.workspace().kinetic_energy() / energy - 1.0).abs();
        assert!(drift < 1e-10, "{drift:e}");
        let X_BE = system.workspace().X_BF(tip);
        let X_TE = system.workspace().X_BF(captured.target_root()).inverse() * X_BE;
        let moved = (X_TE.translation.vector - other.X_BF.translation.vector).norm();
        assert!(moved < 1e-11, "{moved:e}");
        let turned = (X_TE.rotation.matrix() - other.X_BF.rotation.matrix()).norm();
        // A ball joint turns, a weld does not.
        assert_eq!(turned < 1e-11, second == Latch::Weld, "{turned:e}");
        let moving = (captured.robot_joints().0 - q).norm();
        assert!(moving > 1e-3, "{moving}");
    }
}

/// Servos that hold the rates in the impulse: tip and grasp move together, momentum stays, and the energy is what
/// it is said to be.
#[test]
fn servos_hold_their_rates_in_the_impulse() {
    for joints in [JointReaction::RateHeld, JointReaction::Locked] {
        let (robot, target, at) = scene();
        let grasp = grasp(robot.model(), &at, Latch::Weld, joints);
        let (_, impulse) = Captured::new(&robot, &target, &grasp, IntegrationMethod::Dop8).unwrap();
        let mut after = [robot.clone(), target.clone()];
        for (system, state) in after.iter_mut().zip(&impulse.states) {
            system.set_state(state.clone());
        }
        match joints {
            JointReaction::RateHeld => assert_eq!(after[0].state().qd, robot.state().qd),
            _ => assert_eq!(after[0].state().qd, DVector::zeros(12)),
        }
        let twist = |system: &Floating, frame: &Frame| {
            let V = system.workspace().V_WF_B(frame);
            (
                system.state().R_WB * V.linear,
                system.state().R_WB * V.angular,
            )
        };
        let (of_tip, of_grasp) = (
            twist(&after[0], &grasp.robot),
            twist(&after[1], &grasp.target),
        );
        assert!((of_tip.0 - of_grasp.0).norm() < 1e-14 && (of_tip.1 - of_grasp.1).norm() < 1e-14);
        let kinetic = |systems: &[&Floating]| {
            systems
                .iter()
                .map(|s| s.workspace().kinetic_energy())
                .sum::<f64>()
        };
        let before = kinetic(&[&robot, &target]);
        let lost = before - kinetic(&[&after[0], &after[1]]);
        assert!(
            (lost - impulse.energy_lost).abs() < 1e-13 * before,
            "{lost} {}",
            impulse.energy_lost
        );
        let (P, L) = momentum(&[robot.state(), target.state()]);
        let (P_after, L_after) = momentum(&[&impulse.states[0], &impulse.states[1]]);
        assert!((P - P_after).norm() < 1e-13 * P.norm() && (L - L_after).norm() < 1e-13 * L.norm());
        // What servo and brake do on their joints is what changes the rates as if nothing held them.
        assert!(impulse.joints[0].norm() > 1e-3);
    }
}

/// A ball joint whose angles pass 90° many times: the axes are chosen again, which the motion does not show.
#[test]
fn ball_joints_turn_any_way() {
    let (robot, target, at) = scene();
    let mut spinning = target.state().clone();
    let R = spinning.R_WB;
    spinning.momentum_W.angular += R * Vector3::new(30.0, 70.0, 20.0);
    let mut target = target;
    target.set_state(spinning);
    let grasp = grasp(robot.model(), &at, Latch::Ball, JointReaction::Free);
    let start = |robot: &Floating, target: &Floating| {
        Captured::new(robot, target, &grasp, IntegrationMethod::Dop8)
            .unwrap()
            .0
    };
    let mut one = start(&robot, &target);
    let (P, L) = momentum(&[one.floating().state()]);
    let energy = one.floating().workspace().kinetic_energy();
    one.step(0.0025, 4000);
    let (P_now, L_now) = momentum(&[one.floating().state()]);
    assert!((P - P_now).norm() < 1e-12 * P.norm() && (L - L_now).norm() < 1e-12 * L.norm());
    let drift = (one.floating().workspace().kinetic_energy() / energy - 1.0).abs();
    assert!(drift < 1e-9, "{drift:e}");
    // The same motion in other coordinates: released and grasped again after a while, which has no impulse.
    let mut other = start(&robot, &target);
    other.step(0.0025, 1400);
    let apart = other.release(None);
    let (mut of_robot, mut of_target) = (robot.clone(), target.clone());
    of_robot.set_state(apart.robot);
    of_target.set_state(apart.target);
    let (mut other, impulse) =
        Captured::new(&of_robot, &of_target, &grasp, IntegrationMethod::Dop8).unwrap();
    assert!(impulse.on_first[0].force.norm() < 1e-10);
    other.step(0.0025, 2600);
    let (X, V) = one.target_motion();
    let (X_other, V_other) = other.target_motion();
    near(
        "position",
        X.translation.vector.as_slice(),
        X_other.translation.vector.as_slice(),
        1e-8,
    );
    near(
        "attitude",
        X.rotation.matrix().as_slice(),
        X_other.rotation.matrix().as_slice(),
        1e-8,
    );
    near(
        "angular velocity",
        V.angular.as_slice(),
        V_other.angular.as_slice(),
        1e-8,
    );
    near(
        "joints",
        one.robot_joints().0.as_slice(),
        other.robot_joints().0.as_slice(),
        1e-8,
    );
}

/// What cannot be grasped is said in one line.
#[test]
fn impossible_grasps_are_refused() {
    let (robot, target, at) = scene();
    let valid = grasp(robot.model(), &at, Latch::Weld, JointReaction::Free);
    let mut unknown = valid.clone();
    unknown.robot.name = "hand".to_owned();
    let message = Captured::new(&robot, &target, &unknown, IntegrationMethod::Dop8)
        .unwrap_err()
        .to_string();
    assert_eq!(
        message,
        "the grasp's frame 'hand' is none of robot 'two_arms'; give a link of its description"
    );
    let mut away = target.clone();
    let mut state = State::at_rest(target.model());
    state.set_base(
        &mut Workspace::new(target.model()),
        &nalgebra::Isometry3::translation(9.0, 0.0, 0.0),
        &Default::default(),
    );
    away.set_state(state);
    assert!(valid.check_separation(&robot, &target, 1e-6, 1e-6).is_ok());
    let message = valid
        .check_separation(&robot, &away, 0.01, 0.1)
        .unwrap_err()
        .to_string();
    assert!(
        message.contains("m and") && message.contains("at most 0.01 m"),
        "{message}"
    );
    let links = target.model().frames()[0].clone();
    let elsewhere = Grasp {
        target: Frame { body: 1, ..links },
        ..valid
    };
    let message = Captured::new(&robot, &target, &elsewhere, IntegrationMethod::Dop8)
        .unwrap_err()
        .to_string();
    assert_eq!(
        message,
        "the grasp is on body 1 of target 'target'; it must be on its base, body 0"
    );
}
