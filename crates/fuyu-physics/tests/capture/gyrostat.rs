//! Robots with wheels and thrusters that capture: compared with trees in which every wheel is a link on a joint.

use fuyu_physics::dynamics::capture::{
    CaptureError, Captured, CapturedGyrostat, Grasp, JointReaction, Latch, ReleaseSpring,
};
use fuyu_physics::dynamics::flexible::{
    FlexibleFloating, FlexibleInput, FlexibleState, FlexibleSystem, FlexibleWorkspace, Thruster,
    Wheel,
};
use fuyu_physics::dynamics::{Floating, IntegrationMethod, State, Workspace};
use fuyu_physics::model::{Frame, Model};
use fuyu_physics::spatial::{Pose, Twist, Wrench};
use nalgebra::{DVector, Isometry3, Matrix3, Translation3, Unit, UnitQuaternion, Vector3};

use crate::support::{body, floating, momentum, near};

const METHOD: IntegrationMethod = IntegrationMethod::Dop8;
/// Step \[s\].
const STEP: f64 = 0.01;
/// Moment of inertia of a wheel about its axis \[kg m²\].
const INERTIA: f64 = 0.3;
/// Speeds of the wheels relative to the base \[rad/s\], and torques of their motors \[N m\].
const SPEEDS: [f64; 2] = [40.0, -25.0];
const TORQUES: [f64; 2] = [0.4, 0.7];

/// A robot with two joints and two wheels, each on a joint of this type. The second wheel's axis is oblique.
fn robot(wheel_joint: &str) -> Model {
    let link = |name: &str, mass: f64, xyz: &str, [x, y, z]: [f64; 3]| {
        format!(
            r#"<link name="{name}"><inertial><origin xyz="{xyz}"/><mass value="{mass}"/>
               <inertia ixx="{x}" iyy="{y}" izz="{z}" ixy="0" ixz="0" iyz="0"/></inertial></link>"#
        )
    };
    let joint = |kind: &str, parent: &str, child: &str, origin: &str, axis: &str| {
        format!(
            r#"<joint name="{child}_joint" type="{kind}"><parent link="{parent}"/><child link="{child}"/>
               <origin {origin}/><axis xyz="{axis}"/></joint>"#
        )
    };
    let wheel = [0.2, 0.2, INERTIA];
    let parts = [
        link("base", 200.0, "0.05 0 0.1", [60.0, 80.0, 70.0]),
        link("upper", 12.0, "0.5 0 0", [0.1, 1.0, 1.0]),
        link("hand", 9.0, "0.4 0.02 0", [0.1, 0.8, 0.8]),
        link("first", 5.0, "0 0 0", wheel),
        link("second", 5.0, "0 0 0.03", wheel),
        joint("continuous", "base", "upper", r#"xyz="0.6 0 0.5""#, "0 0 1"),
        joint("continuous", "upper", "hand", r#"xyz="1 0 0""#, "0 1 0"),
        joint(wheel_joint, "base", "first", r#"xyz="0 0.2 0.1""#, "0 0 1"),
        joint(
            wheel_joint,
            "base",
            "second",
            r#"xyz="-0.2 0 0" rpy="0.9 0.4 0""#,
            "0 0 1",
        ),
    ];
    let text = format!(r#"<robot name="robot">{}</robot>"#, parts.concat());
    Model::from_urdf(&text, "robot").unwrap()
}

/// Axis of a wheel in base axes.
fn axis(wheel: &str) -> Unit<Vector3<f64>> {
    let model = robot("fixed");
    let frame = model.frame(wheel).unwrap();
    Unit::new_normalize(frame.X_BF.rotation * Vector3::z())
}

fn thruster() -> Thruster {
    Thruster {
        name: "jet".to_owned(),
        position: Vector3::new(-0.5, 0.3, 0.2),
        direction: Vector3::y_axis(),
        thrust: 4.0,
        min_on_time: 0.0,
    }
}

/// Robot with the wheels as parts of the base, the same with wheels on joints, and a target at the hand.
fn scene() -> (FlexibleFloating, Floating, Floating) {
    let fixed = robot("fixed");
    let base = fixed.frame("base").unwrap();
    let system = FlexibleSystem::builder(&fixed)
        .wheel(base, Wheel::new("first", axis("first"), INERTIA))
        .wheel(base, Wheel::new("second", axis("second"), INERTIA))
        .thruster(base, thruster())
        .build()
        .unwrap();
    let R = UnitQuaternion::from_euler_angles(0.3, -0.2, 0.5);
    let X_WB = Isometry3::from_parts(Translation3::new(1.0, -2.0, 0.5), R);
    let V = Twist::new(
        Vector3::new(0.02, -0.05, 0.03),
        Vector3::new(0.1, 0.02, 0.0),
    );
    let mut state = FlexibleState::at_rest_with(&system, &DVector::from_row_slice(&[0.4, -0.7]));
    state.tree.qd = DVector::from_row_slice(&[0.05, -0.1]);
    state.wheel_speeds_mut().copy_from_slice(&SPEEDS);
    let X = Pose::from_parts(X_WB.translation, R.to_rotation_matrix());
    state.set_base(&mut FlexibleWorkspace::new(&system), &X, &V);
    let gyrostat = FlexibleFloating::new(&system, state, METHOD);

    let tree = robot("continuous");
    let by_name = |values: [f64; 4]| {
        let names = ["upper_joint", "hand_joint", "first_joint", "second_joint"];
        let mut all = DVector::zeros(4);
        for (name, value) in names.iter().zip(values) {
            all[tree.joint_index(name).unwrap()] = value;
        }
        all
    };
    let mut state = State::at_rest_with(&tree, &by_name([0.4, -0.7, 0.0, 0.0]));
    state.qd = by_name([0.05, -0.1, SPEEDS[0], SPEEDS[1]]);
    state.set_base(&mut Workspace::new(&tree), &X_WB, &V);
    let tree = Floating::new(tree, state, METHOD);

    let hand = tree.model().frame("hand").unwrap();
    let X_WG = tree.state().X_WB(tree.workspace()) * tree.workspace().X_BF(hand);
    let X_WT = X_WG * on_target().X_BF.inverse();
    let target = floating(
        &body(
            "target",
            150.0,
            Matrix3::from_diagonal(&Vector3::new(40.0, 55.0, 50.0)),
        ),
        X_WT.translation.vector,
        UnitQuaternion::from_rotation_matrix(&X_WT.rotation),
        Vector3::new(0.05, -0.1, 0.08),
        Vector3::new(-0.1, 0.15, 0.2),
        &[],
        &[],
    );
    (gyrostat, tree, target)
}

fn on_target() -> Frame {
    Frame {
        name: "grapple".to_owned(),
        body: 0,
        parent: None,
        X_BF: Pose::new(Vector3::new(0.3, -0.4, 0.2), Vector3::new(0.2, 0.5, -0.3)),
    }
}

fn grasp(model: &Model, latch: Latch, joints: JointReaction) -> Grasp {
    Grasp {
        robot: model.frame("hand").unwrap().clone(),
        target: on_target(),
        latch,
        joints,
    }
}

fn of_wheels(tree: &Model, values: &DVector<f64>) -> [f64; 2] {
    ["first_joint", "second_joint"].map(|name| values[tree.joint_index(name).unwrap()])
}

/// Compares robot and target of both, and momentum and energy of the whole.
fn compare(at: &str, found: &CapturedGyrostat, expected: &Captured, tolerance: f64) {
    let near = |what: &str, found: &[f64], expected: &[f64]| {
        near(&format!("{at}: {what}"), found, expected, tolerance);
    };
    let (mut robot, mut tree, mut target) = scene();
    let mut other = target.clone();
    found.copy_robot_to(&mut robot);
    expected.copy_robot_to(&mut tree);
    found.copy_target_to(&mut target);
    expected.copy_target_to(&mut other);
    let (state, whole) = (robot.state(), tree.state());
    near_base(&near, &robot, &tree);
    for name in ["upper_joint", "hand_joint"] {
        let [i, j] = [robot.model(), tree.model()].map(|model| model.joint_index(name).unwrap());
        near("q", &[state.tree.q[i]], &[whole.q[j]]);
        near("qd", &[state.tree.qd[i]], &[whole.qd[j]]);
    }
    let wheels = |values: &DVector<f64>| of_wheels(tree.model(), values);
    near("wheels", state.wheel_speeds(), &wheels(&whole.qd));
    near("angles", state.wheel_angles(), &wheels(&whole.q));
    let [p, p_other] = [&target, &other].map(|body| body.state().p_WC);
    near("target", p.as_slice(), p_other.as_slice());
    let (V, V_other) = (target.workspace().V_WB_B(), other.workspace().V_WB_B());
    near("target w", V.angular.as_slice(), V_other.angular.as_slice());
    near("target v", V.linear.as_slice(), V_other.linear.as_slice());
    let whole = found.floating();
    let (P, L) = momentum(&[&whole.state().tree]);
    let (P_other, L_other) = momentum(&[expected.floating().state()]);
    near("P", P.as_slice(), P_other.as_slice());
    near("L", L.as_slice(), L_other.as_slice());
    let energy = whole.workspace().kinetic_energy(whole.state());
    let other = expected.floating().workspace().kinetic_energy();
    near("energy", &[energy / other], &[1.0]);
    let (work, other) = (whole.state().tree.work, expected.floating().state().work);
    near("work", &[work / energy], &[other / energy]);
}

fn near_base(near: &impl Fn(&str, &[f64], &[f64]), robot: &FlexibleFloating, tree: &Floating) {
    let (V, V_other) = (robot.workspace().V_WB_B(), tree.workspace().V_WB_B());
    near("w", V.angular.as_slice(), V_other.angular.as_slice());
    near("v", V.linear.as_slice(), V_other.linear.as_slice());
    let (X, X_other) = (robot.X_WB(), tree.state().X_WB(tree.workspace()));
    let [p, p_other] = [X, X_other].map(|X| X.translation.vector);
    near("p", p.as_slice(), p_other.as_slice());
    let [R, R_other] = [X, X_other].map(|X| *X.rotation.matrix());
    near("R", R.as_slice(), R_other.as_slice());
}

/// Holds efforts of the arm and torques of the wheels, and fires the thruster of the one and the same force on the other.
fn hold(robot: &mut FlexibleFloating, tree: &mut Floating, burn: f64) {
    let efforts = [0.6, -0.2];
    for (name, effort) in ["upper_joint", "hand_joint"].iter().zip(efforts) {
        let j = robot.model().joint_index(name).unwrap();
        robot.input_mut().tree.efforts[j] = effort;
    }
    robot.input_mut().wheel_torques.copy_from_slice(&TORQUES);
    robot.fire(0, burn);
    let names = ["upper_joint", "hand_joint", "first_joint", "second_joint"];
    for (name, effort) in names.iter().zip(efforts.iter().chain(&TORQUES)) {
        let j = tree.model().joint_index(name).unwrap();
        tree.input_mut().efforts[j] = *effort;
    }
    let jet = thruster();
    let force = *jet.direction * jet.thrust;
    tree.input_mut().wrenches[0] = match burn > 0.0 {
        true => Wrench {
            torque: jet.position.cross(&force),
            force,
        },
        false => Wrench::ZERO,
    };
}

#[track_caller]
fn near_vector(what: &str, found: &Vector3<f64>, expected: &Vector3<f64>) {
    near(what, found.as_slice(), expected.as_slice(), 1e-10);
}

// Fails if wheels take part in the impulse with their inertia about their axes (base rates differ by 1 %), if their momentum
// is lost, or if torques and thrusters act elsewhere than on the robot's base.
#[test]
fn a_gyrostat_captures_moves_and_releases_as_a_tree_with_the_wheels_as_links() {
    for latch in [Latch::Weld, Latch::Ball] {
        let (mut robot, mut tree, target) = scene();
        let near_before = |what: &str, found: &[f64], expected: &[f64]| {
            near(&format!("before: {what}"), found, expected, 1e-12);
        };
        near_base(&near_before, &robot, &tree);
        let before = momentum(&[&robot.state().tree, target.state()]);
        let of = |model: &Model| grasp(model, latch, JointReaction::Free);
        let (mut found, impulse) =
            CapturedGyrostat::new(&robot, &target, &of(robot.model()), METHOD).unwrap();
        let (mut expected, other) =
            Captured::new(&tree, &target, &of(tree.model()), METHOD).unwrap();
        let (on_hand, other_wrench) = (impulse.on_first[0], other.on_first[0]);
        assert!(on_hand.force.norm() > 1.0, "{on_hand:?}");
        near_vector("force", &on_hand.force, &other_wrench.force);
        near_vector("torque", &on_hand.torque, &other_wrench.torque);
        near("loss", &[impulse.energy_lost], &[other.energy_lost], 1e-11);
        compare(&format!("{latch:?} at capture"), &found, &expected, 1e-10);
        let after = momentum(&[&found.floating().state().tree]);
        assert!((before.0 - after.0).norm() < 1e-13 * before.0.norm().max(1.0));
        assert!((before.1 - after.1).norm() < 1e-13 * before.1.norm().max(1.0));

        for second in 0..5 {
            found.copy_robot_to(&mut robot);
            expected.copy_robot_to(&mut tree);
            // One second of thrust, and the torques of the wheels all the time.
            hold(&mut robot, &mut tree, if second == 2 { 1.0 } else { 0.0 });
            expected.hold_robot_input(tree.input());
            if second % 2 == 0 {
                found.hold_robot_input(&robot);
                found.step(STEP, 100);
            } else {
                for _ in 0..100 {
                    let mut keep = |_: f64, _: &FlexibleState, _: &mut FlexibleInput| {};
                    found.step_with(STEP, &mut robot, &mut keep);
                    found.copy_robot_to(&mut robot);
                }
            }
            expected.step(STEP, 100);
            compare(
                &format!("{latch:?} after {} s", second + 1),
                &found,
                &expected,
                1e-9,
            );
        }
        found.copy_robot_to(&mut robot);
        expected.copy_robot_to(&mut tree);
        found.copy_robot_accelerations_to(&mut robot);
        expected.copy_robot_accelerations_to(&mut tree);
        let hands = [robot.model(), tree.model()].map(|model| model.frame("hand").unwrap());
        let A = robot.workspace().A_WF_B(hands[0]);
        let A_other = tree.workspace().A_WF_B(hands[1]);
        near_vector("angular", &A.angular, &A_other.angular);
        near_vector("linear", &A.linear, &A_other.linear);

        let spring = ReleaseSpring {
            direction: Vector3::new(0.3, 0.1, -1.0),
            energy: 0.8,
        };
        for spring in [None, Some(&spring)] {
            let (parted, other) = (found.release(spring), expected.release(spring));
            let (mut robot, mut tree) = (robot.clone(), tree.clone());
            robot.set_state(parted.robot.clone());
            tree.set_state(other.robot.clone());
            let at = |what: &str, found: &[f64], expected: &[f64]| {
                near(&format!("release: {what}"), found, expected, 1e-9);
            };
            near_base(&at, &robot, &tree);
            let speeds = of_wheels(tree.model(), &other.robot.qd);
            at("wheels", parted.robot.wheel_speeds(), &speeds);
            at("work", &[parted.robot.tree.work], &[other.robot.work]);
            let now = momentum(&[&found.floating().state().tree]);
            let both = momentum(&[&parted.robot.tree, &parted.target]);
            assert!((now.0 - both.0).norm() < 1e-13 * now.0.norm().max(1.0));
            assert!((now.1 - both.1).norm() < 1e-13 * now.1.norm().max(1.0));
            let [w, w_other] = [&parted.target, &other.target].map(|state| state.momentum_W);
            at("target", w.angular.as_slice(), w_other.angular.as_slice());
        }
    }
}

/// Brakes in the arm act on its joints, not on the wheels.
#[test]
fn wheels_turn_on_where_brakes_stop_the_arm() {
    let (robot, _, target) = scene();
    let grasp = grasp(robot.model(), Latch::Weld, JointReaction::Locked);
    let (mut captured, _) = CapturedGyrostat::new(&robot, &target, &grasp, METHOD).unwrap();
    let (P, L) = momentum(&[&robot.state().tree, target.state()]);
    let energy = captured.floating().energy();
    captured.step(0.01, 500);
    let mut shown = robot.clone();
    captured.copy_robot_to(&mut shown);
    assert_eq!(shown.state().tree.q, robot.state().tree.q);
    assert_eq!(shown.state().tree.qd, DVector::zeros(2));
    let change = shown.state().wheel_speeds()[0] - SPEEDS[0];
    assert!(change.abs() < 1.0 && change != 0.0, "{change}");
    let (P_now, L_now) = momentum(&[&captured.floating().state().tree]);
    assert!((P - P_now).norm() < 1e-12 && (L - L_now).norm() < 1e-11);
    assert!((captured.floating().energy() - energy).abs() < 1e-10 * energy);
}

#[test]
fn robots_that_bend_are_refused() {
    use fuyu_structures::PlateStrip;
    let model = robot("fixed");
    let panel = PlateStrip {
        length: 3.0,
        width: 1.0,
        areal_mass: 3.0,
        EI: 300.0,
        GJ: 80.0,
        bending_modes: 2,
        torsion_modes: 0,
        damping: 0.005,
        second_order: false,
    };
    let system = FlexibleSystem::builder(&model)
        .appendage(
            model.frame("base").unwrap(),
            Pose::translation(1.0, 0.0, 0.0),
            panel.appendage("panel").unwrap(),
        )
        .build()
        .unwrap();
    let robot = FlexibleFloating::new(&system, FlexibleState::at_rest(&system), METHOD);
    let target = scene().2;
    let grasp = grasp(&model, Latch::Weld, JointReaction::Free);
    let refused = CapturedGyrostat::new(&robot, &target, &grasp, METHOD).unwrap_err();
    assert_eq!(refused, CaptureError::Deformable("robot".to_owned()));
    assert!(
        refused.to_string().contains("deformable bodies"),
        "{refused}"
    );
}
