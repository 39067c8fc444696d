//! Tests of a world whose robot has flexible parts, wheels and thrusters.

use super::*;
use crate::{
    dynamics::flexible::Thruster,
    nodes::{
        dynamics::{
            FrameTree, appendage_states,
            external_wrenches::{ExternalWrench, WrenchAxes},
            free_body::FreeBody as _,
            params::ThrusterParams,
            wheel_states,
        },
        scenario::Scenario,
    },
    ros::Time,
    spatial::Wrench,
};
use nalgebra::{Unit, Vector3};

fn params() -> DynamicsParams {
    let scenario = Scenario::read("package://fuyu/config/flexible_servicer.yaml").unwrap();
    scenario.dynamics().unwrap()
}

fn thruster(min_on_time: f64) -> ThrusterParams {
    ThrusterParams {
        link: String::new(),
        thruster: Thruster {
            name: "main".to_owned(),
            position: Vector3::new(0.5, 0.0, -0.7),
            direction: Unit::new_normalize(Vector3::new(0.0, 1.0, 1.0)),
            thrust: 20.0,
            min_on_time,
        },
    }
}

/// Kinetic and strain energy plus losses \[J\].
fn energy(world: &World) -> f64 {
    let robot = &world.robot;
    robot.kinetic_energy() + robot.strain_energy() + robot.lost_energy()
}

// Would break if a step copied states into new memory.
#[test]
fn steps_and_commands_do_not_allocate() {
    let mut params = params();
    params.flexible.thrusters.push(thruster(0.0));
    let mut world = World::new(&params).unwrap();
    let mut steps = || {
        world.hold_efforts([(0, 0.1)]);
        world.hold_wheel_torques([(1, 0.5)]);
        world.fire([(0, 0.012)]);
        let time = world.time() + 0.003;
        world.step_within_tick_or_restore(time).unwrap();
        world.step_to_tick_or_restore().unwrap();
        world.drive_rates([(1, 0.01)]);
        world.step_to_tick_or_restore().unwrap();
    };
    steps();
    assert_eq!(allocation_counter::measure(steps).count_total, 0);
}

#[test]
fn a_reset_restores_the_start() {
    let mut world = World::new(&params()).unwrap();
    let start = world.robot.flexible().unwrap().state().clone();
    assert!(start.mu()[0] == 0.5 && start.mu()[7] == 0.03);
    world.hold_wheel_torques([(0, 1.0)]);
    for _ in 0..20 {
        world.step_to_tick();
    }
    assert_ne!(*world.robot.flexible().unwrap().state(), start);
    world.reset_time();
    world.reset_state();
    let robot = world.robot.flexible().unwrap();
    assert_eq!(*robot.state(), start);
    assert_eq!(robot.input().wheel_torques.amax(), 0.0);
}

// The wheel and the base exchange momentum; the total momentum stays zero.
#[test]
fn a_wheel_takes_momentum_from_the_base() {
    let mut world = World::new(&params()).unwrap();
    world.hold_wheel_torques([(2, 0.5)]);
    for _ in 0..200 {
        world.step_to_tick();
    }
    let robot = world.robot.flexible().unwrap();
    let speed = robot.state().wheel_speeds()[2];
    // .5 N m for 2 s on .2 kg m², less what the base turns.
    assert!((speed - 5.0).abs() < 0.02, "{speed}");
    assert!(world.robot.V_WB_B().angular.z < -1e-4);
    assert_eq!(world.robot.state().momentum_W.angular, Vector3::zeros());
    assert!(world.robot.carried_momentum().angular.norm() < 1e-12);
    let states = wheel_states(Time::ZERO, "base_link", &world).unwrap();
    assert_eq!(states.name, ["wheel_x", "wheel_y", "wheel_z"]);
    assert!((states.effort[2] - 0.5).abs() < 1e-12 && states.velocity[2] == speed);
    let work = robot.state().partial_work().wheel_motors;
    assert!((work - 0.5 * states.position[2]).abs() < 1e-9, "{work}");
}

// The pulse ends within a step: impulse and reported change must be thrust times time.
#[test]
fn what_thrusters_change_is_reported_as_coming_from_outside() {
    let mut params = params();
    params.flexible.thrusters.push(thruster(0.0));
    let mut world = World::new(&params).unwrap();
    let before = energy(&world);
    world.fire([(0, 0.1234)]);
    for _ in 0..30 {
        world.step_to_tick();
    }
    let change = world.change_from_outside().unwrap();
    let momentum = world.robot.state().momentum_W;
    assert!((momentum.linear - change.momentum_W.linear).norm() < 1e-14);
    assert!((momentum.angular - change.momentum_W.angular).norm() < 1e-14);
    let impulse = momentum.linear.norm();
    // The base turns by less than a milliradian meanwhile.
    assert!((impulse / (20.0 * 0.1234) - 1.0).abs() < 1e-6, "{impulse}");
    let gained = energy(&world) - before;
    // The classical method takes some 1e-7 J a second from the vibration of 3.4 Hz.
    assert!(
        (gained - change.work).abs() < 1e-6 && gained > 1e-4,
        "{gained} {change:?}"
    );
}

#[test]
fn a_wrench_changes_momentum_and_energy_by_what_is_reported() {
    let mut world = World::new(&params()).unwrap();
    let before = energy(&world);
    let link = world.robot.model().frame("link3").unwrap().clone();
    world.hold_efforts([(0, 1.0), (2, -0.5)]);
    let wrench = ExternalWrench {
        axes: WrenchAxes::Robot(link.clone()),
        link,
        point: Vector3::new(1.0, 0.0, 0.0),
        wrench: Wrench::new(Vector3::new(0.0, 2.0, 0.0), Vector3::new(1.0, -3.0, 2.0)),
        from: 0.052,
        until: 0.5,
        is_streamed: false,
    };
    world.wrenches_mut().add(wrench).unwrap();
    for _ in 0..100 {
        world.step_to_tick();
    }
    let change = world.change_from_outside().unwrap();
    let momentum = world.robot.state().momentum_W;
    assert!((momentum.linear - change.momentum_W.linear).norm() < 1e-12);
    assert!((momentum.angular - change.momentum_W.angular).norm() < 1e-12);
    assert!(change.momentum_W.linear.norm() > 1.0);
    let of_joints = world.robot.state().work - change.work;
    let gained = energy(&world) - before;
    assert!(
        (gained - change.work - of_joints).abs() < 1e-6,
        "{gained} {change:?}"
    );
    assert!(
        change.work > 1e-3 && of_joints.abs() > 1e-5,
        "{} {of_joints}",
        change.work
    );
}

// The arm is stopped where it was, and momentum is kept, although the wheels go on turning.
#[test]
fn a_motion_that_diverges_is_stopped() {
    let mut world = World::new(&params()).unwrap();
    world.hold_wheel_torques([(0, 1.0)]);
    for _ in 0..50 {
        world.step_to_tick_or_restore().unwrap();
    }
    let before = world.robot.flexible().unwrap().state().clone();
    world.robot.input_mut().efforts[0] = f64::NAN;
    let problem = world.step_to_tick_or_restore().unwrap_err();
    assert!(problem.contains("the robot has diverged"), "{problem}");
    let state = world.robot.flexible().unwrap().state();
    assert_eq!(state.tree.q, before.tree.q);
    assert_eq!(state.mu(), before.mu());
    assert_eq!(state.wheel_speeds(), before.wheel_speeds());
    assert_eq!(state.tree.momentum_W, before.tree.momentum_W);
    assert_eq!((state.tree.qd.amax(), state.mu_dot()[0]), (0.0, 0.0));
    for _ in 0..10 {
        world.step_to_tick_or_restore().unwrap();
    }
}

// Accelerations of base and tip against differences of their velocities.
#[test]
fn accelerations_are_those_of_the_motion() {
    let mut world = World::new(&params()).unwrap();
    world.robot.hold_efforts(&[20.0, -10.0, 5.0, 1.0, 0.5, 0.0]);
    for _ in 0..30 {
        world.step_to_tick();
    }
    for link in ["base_link", "tool0"] {
        let robot = &mut world.robot;
        let frame = robot.model().frame(link).unwrap().clone();
        robot.set_accelerations();
        let R_WB = robot.state().R_WB;
        let in_world = |robot: &Robot| {
            let V = robot.V_WF_B(&frame);
            (
                robot.state().R_WB * V.linear,
                robot.state().R_WB * V.angular,
            )
        };
        let (before, A) = (in_world(robot), robot.A_WF_B(&frame));
        let dt = 1e-5;
        robot.step(dt, 1);
        let after = in_world(robot);
        for (a, b, expected) in [
            (before.0, after.0, A.linear),
            (before.1, after.1, A.angular),
        ] {
            let found = R_WB.inverse() * ((b - a) / dt);
            assert!(
                (found - expected).norm() < 1e-3 * expected.norm(),
                "{link}: {found} {expected}"
            );
        }
    }
}

// Friction and stops are simulated for rigid robots only: a note says so, and settings switch it off.
#[test]
fn stops_that_are_not_simulated_are_reported() {
    let mut params = params();
    assert_eq!(World::new(&params).unwrap().not_simulated(), None);
    params.robot.xml = params.robot.xml.replacen(
        r#"<joint name="joint2" type="continuous">"#,
        r#"<joint name="joint2" type="revolute"><limit lower="-2" upper="2" effort="100" velocity="1"/>"#,
        1,
    );
    let world = World::new(&params).unwrap();
    let note = world.not_simulated().unwrap();
    assert!(
        note.contains("speed limits of joint2 are not simulated"),
        "{note}"
    );
    params.joint_physics.stops = false;
    params.joint_physics.velocity_limits = false;
    assert_eq!(World::new(&params).unwrap().not_simulated(), None);
}

// The tip frame moves by the displacement in the appendage states.
#[test]
fn frames_show_the_deflection() {
    let world = World::new(&params()).unwrap();
    let frames = FrameTree::new(&world.robot);
    let attached = frames.static_transforms(&world.targets).transforms;
    let minus = attached.iter().find(|t| t.child_frame_id == "solar_minus");
    let minus = minus.unwrap();
    assert_eq!(minus.header.frame_id, "base_link");
    assert_eq!(minus.transform.translation.x, -1.2);
    let moving = frames.transforms(Time::ZERO, &world).transforms;
    let tip = moving.iter().find(|t| t.child_frame_id == "solar_plus/tip");
    let tip = tip.unwrap();
    assert_eq!(tip.header.frame_id, "solar_plus");
    let states = appendage_states(Time::ZERO, "base_link", &world).unwrap();
    let at = &tip.transform.translation;
    assert!((at.x - 8.0).abs() < 1e-12 && at.z > 0.1);
    assert_eq!(at.z, states.tip_displacement[0].z);
    // Bending up turns the tip about -y, torsion about x.
    let turned = &tip.transform.rotation;
    assert!(turned.y < -0.01 && turned.x > 0.003, "{turned:?}");
}

// An elastic link has only the link's frame, which moves with the tip: by 2 cm here, without turning.
#[test]
fn frames_of_an_elastic_link_move_with_its_tip() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scenario.yaml");
    let moved = |deflection: f64| {
        let text = format!(
            "dynamics:\n  ros__parameters:\n    urdf: package://fuyu/urdf/servicer.urdf\n    time_step: 0.005\n    links:\n      link2:\n        length: 2.5\n        linear_mass: 20.0\n        EI: 2.0e5\n        initial_mu: [{deflection:?}, 0.0, 0.0, 0.0]\n"
        );
        std::fs::write(&path, text).unwrap();
        let scenario = Scenario::read(path.to_str().unwrap()).unwrap();
        let world = World::new(&scenario.dynamics().unwrap()).unwrap();
        let frames = FrameTree::new(&world.robot);
        let fixed = frames.static_transforms(&world.targets).transforms;
        assert!(fixed.iter().all(|t| t.child_frame_id != "link2"));
        let moving = frames.transforms(Time::ZERO, &world).transforms;
        let of = |child: &str| {
            let mut found = moving.iter().filter(|t| t.child_frame_id == child);
            let transform = found.next().unwrap();
            assert!(found.next().is_none(), "{child}");
            let p = &transform.transform.translation;
            Vector3::new(p.x, p.y, p.z)
        };
        assert!(moving.iter().all(|t| t.child_frame_id != "link2/tip"));
        [of("link2"), of("link3")]
    };
    let ([straight, next], [bent, after]) = (moved(0.0), moved(0.02));
    assert!(((bent - straight).norm() - 0.02).abs() < 1e-12, "{bent}");
    // Link 3 is fixed to the section.
    assert!((after - next).norm() < 1e-12, "{after} {next}");
}
