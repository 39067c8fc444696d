use super::super::wrist_tests::check_wrist;
use super::*;
use crate::nodes::scenario::Scenario;
use nalgebra::Vector3;

/// A servicer whose tip is at the target's origin, which moves past it.
fn params(more: &str) -> DynamicsParams {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("grasp.yaml");
    let base = "dynamics:\n  ros__parameters:\n    initial_joint_positions: [0.3, 0.7, -0.9, 0.1, 0.6, -0.4]\n    \
                targets: [debris]\n    grasps: [hand]\n    hand:\n      frame: tool0\n      target: debris\n";
    let read = |text: &str| {
        std::fs::write(&path, text).unwrap();
        let scenario = Scenario::read(path.to_str().unwrap()).unwrap();
        scenario.dynamics().unwrap()
    };
    let world = World::new(&read(base)).unwrap();
    let tool = world.robot.model().frame("tool0").unwrap().clone();
    let X_WG = world.robot.X_BF(&tool);
    let q = nalgebra::UnitQuaternion::from_rotation_matrix(&X_WG.rotation).coords;
    let p = X_WG.translation.vector;
    read(&format!(
        "{base}{more}    debris:\n      position: {:?}\n      orientation: {:?}\n      velocity: [0.0, 0.0, 0.01]\n",
        [p.x, p.y, p.z],
        [q.x, q.y, q.z, q.w]
    ))
}

fn step_to(world: &mut World, time: f64) {
    while world.time() < time - 1e-9 {
        world.step_to_tick();
    }
}

/// Total momentum, angular about the world's origin.
fn momentum(world: &World) -> (Vector3<f64>, Vector3<f64>) {
    let states = [world.robot.state(), world.targets[0].body.state()];
    let sum = |of: &dyn Fn(&crate::dynamics::State) -> Vector3<f64>| {
        states.iter().map(|state| of(state)).sum()
    };
    (
        sum(&|s| s.momentum_W.linear),
        sum(&|s| s.momentum_W.angular + s.p_WC.cross(&s.momentum_W.linear)),
    )
}

// Would break if a command latched frames that are apart, if momentum were lost in the impulse or while the robot is
// driven, or if what is published as the targets' effect did not explain the robot's own momentum.
#[test]
fn a_command_latches_and_releases() {
    let mut world = World::new(&params("")).unwrap();
    assert_eq!(world.detach().unwrap_err(), "no grasp is closed");
    let (P, L) = momentum(&world);
    let own = world.robot.state().momentum_W;
    let done = world.attach().unwrap();
    assert!(done.starts_with("grasp 'hand' holds debris, "), "{done}");
    assert_eq!(world.held_target(), Some("debris"));
    assert!(world.attach().unwrap_err().contains("closed already"));
    // A servo drives the joints meanwhile.
    world.drive_rates([(0, 0.05), (2, -0.05)]);
    step_to(&mut world, 1.0);
    let grasp = &world.grasps.all[0].grasp;
    let robot = world.robot.rigid().unwrap();
    let (distance, angle) = grasp.separation(robot, &world.targets[0].body);
    assert!(distance < 1e-9 && angle < 1e-6, "{distance:e} {angle:e}");
    assert!((world.robot.state().qd[0] - 0.05).abs() < 1e-3);
    let (P_now, L_now) = momentum(&world);
    assert!((P_now - P).norm() < 1e-12 * (1.0 + P.norm()));
    assert!((L_now - L).norm() < 1e-12 * (1.0 + L.norm()));
    let change = world.change_from_outside().unwrap().momentum_W;
    let now = world.robot.state().momentum_W;
    assert!((now.linear - own.linear - change.linear).norm() < 1e-11);
    assert!((now.angular - own.angular - change.angular).norm() < 1e-11);
    assert_eq!(world.detach().unwrap(), "debris is released");
    step_to(&mut world, 3.0);
    let (P_now, L_now) = momentum(&world);
    assert!((P_now - P).norm() < 1e-12 * (1.0 + P.norm()));
    assert!((L_now - L).norm() < 1e-12 * (1.0 + L.norm()));
    let too_far = world.attach().unwrap_err();
    assert!(
        too_far.contains("m and") && too_far.contains("apart"),
        "{too_far}"
    );
    let what: Vec<_> = world
        .grasp_events()
        .iter()
        .map(|e| e.what.as_str())
        .collect();
    assert_eq!(what.len(), 2, "{what:?}");
}

// Would break if a grasp that latches by itself did so again as soon as it was opened, or from too far away.
#[test]
fn a_grasp_latches_by_itself_and_not_again_before_it_has_moved_apart() {
    let mut world = World::new(&params("      automatic: true\n      distance: 0.005\n")).unwrap();
    assert_eq!(world.held_target(), Some("debris"));
    step_to(&mut world, 0.5);
    world.detach().unwrap();
    step_to(&mut world, 1.0);
    assert_eq!(world.held_target(), None);
    // Robot and target are reset to the start; the frames have been apart meanwhile.
    world.reset_state();
    step_to(&mut world, 1.1);
    assert_eq!(world.held_target(), Some("debris"));
}

// Would break if one of the two kept the other's motion, or if the simulation ended.
#[test]
fn a_motion_that_diverges_opens_the_grasp() {
    let mut world = World::new(&params("      at: 0.0\n")).unwrap();
    assert_eq!(world.held_target(), Some("debris"));
    step_to(&mut world, 0.2);
    world.robot.input_mut().efforts[0] = f64::NAN;
    assert!(world.step_to_tick_or_restore().is_err());
    assert_eq!(world.held_target(), None);
    assert!(world.check_divergence().is_ok());
    world.step_to_tick_or_restore().unwrap();
    assert!(
        world.targets[0]
            .body
            .state()
            .p_WC
            .iter()
            .all(|x| x.is_finite())
    );
}

/// Parameters of two wheels and a thruster.
const WHEELS: &str = "    wheels: [wheel_x, wheel_z]\n    wheel_x:\n      axis: [1.0, 0.0, 0.0]\n      inertia: 0.2\n    \
    wheel_z:\n      axis: [0.0, 0.0, 1.0]\n      inertia: 0.2\n      viscous_friction: 0.01\n    thrusters: [jet]\n    jet:\n      \
    position: [0.5, 0.0, -0.7]\n      direction: [0.0, 1.0, 0.0]\n      thrust: 10.0\n";

// Would break if the momentum of wheels were lost when a target is grasped, held or released, if wheels or thrusters did
// not act while it is held, or if their effects were taken for those of the target.
#[test]
fn a_robot_with_wheels_and_thrusters_holds_a_target() {
    let mut world = World::new(&params(WHEELS)).unwrap();
    world.hold_wheel_torques([(0, 0.5), (1, -1.0)]);
    step_to(&mut world, 0.5);
    let (P, L) = momentum(&world);
    let own = world.robot.state().momentum_W;
    let energy = |world: &World| world.robot.kinetic_energy();
    let own_energy = energy(&world);
    let work = world.robot.whole_work();
    let before = world.robot.flexible().unwrap().state().wheel_speeds()[0];
    world.attach().unwrap();
    step_to(&mut world, 1.0);
    world.fire([(0, 0.25)]);
    step_to(&mut world, 1.5);
    let robot = world.robot.flexible().unwrap();
    assert!(!robot.is_firing());
    assert!((robot.state().thruster_impulses()[0] - 2.5).abs() < 1e-9);
    // 0.5 N m for 1 s on 0.2 kg m2, less what the base turns.
    let after = robot.state().wheel_speeds()[0];
    assert!((after - before - 2.5).abs() < 0.1, "{before} {after}");
    let pushed = world.external_change().unwrap().momentum_W;
    assert!((pushed.linear.norm() - 2.5).abs() < 1e-3, "{pushed:?}");
    let (P_now, _) = momentum(&world);
    assert!((P_now - P - pushed.linear).norm() < 1e-12 * (1.0 + P.norm()));
    let change = world.change_from_outside().unwrap();
    let now = world.robot.state().momentum_W;
    assert!((now.linear - own.linear - change.momentum_W.linear).norm() < 1e-11);
    assert!((now.angular - own.angular - change.momentum_W.angular).norm() < 1e-11);
    // What the targets have added explains the robot's energy, with the work of motors and thrusters.
    let motors = world.robot.whole_work() - work;
    assert!(motors.abs() > 1.0 && (energy(&world) - own_energy).abs() > 1e-3);

    let (P, L_held) = momentum(&world);
    world.detach().unwrap();
    let (P_now, L_now) = momentum(&world);
    assert!((P_now - P).norm() < 1e-12 && (L_now - L_held).norm() < 1e-12 * (1.0 + L.norm()));
    step_to(&mut world, 2.0);
    assert_eq!(world.held_target(), None);
    world.reset_time();
    world.reset_state();
    world.attach().unwrap();
    let again = world.attach().unwrap_err();
    assert!(again.contains("closed already"), "{again}");
}

#[test]
fn robots_that_bend_and_targets_with_stops_are_refused() {
    let refused = |params: &DynamicsParams| World::new(params).err().expect("an error");
    let mut bent = params("");
    bent.flexible
        .joints
        .push(crate::dynamics::flexible::ElasticJoint {
            joint: World::new(&bent).unwrap().robot.model().joints()[0]
                .name
                .clone(),
            stiffness: 5000.0,
            damping: 1.0,
            rotor_inertia: 1e-3,
            gear_ratio: 100.0,
            rotor: crate::dynamics::flexible::RotorModel::Reduced,
        });
    let text = refused(&bent);
    assert!(
        text.starts_with("parameter grasps: ") && text.contains("elastic"),
        "{text}"
    );

    let mut stopped = params(WHEELS);
    stopped.targets[0].description = params("    urdf: package://fuyu/urdf/ur5.urdf\n").robot;
    let text = refused(&stopped);
    assert!(
        text.contains("of target 'debris' are not simulated"),
        "{text}"
    );
}

// The sensor against the rate of the momentum of what is beyond it, which holds the target, while wheels and a thruster turn the
// base. Fails if wheels, the thruster or the target are left out.
#[test]
fn a_robot_with_wheels_feels_in_its_wrist_what_it_holds() {
    for joints in ["", "      joints: locked\n"] {
        let wrist = "    wrist:\n      joint: joint5\n      frame: tool0\n";
        let mut world = World::new(&params(&format!("{joints}{WHEELS}{wrist}"))).unwrap();
        world.attach().unwrap();
        world.hold_wheel_torques([(0, 0.5), (1, -1.0)]);
        world.fire([(0, 2.0)]);
        world.robot.hold_efforts(&[3.0, -2.0, 1.0, 0.3, -0.2, 0.1]);
        let with_target = |world: &World| {
            let target = world.targets[0].body.state();
            let P = target.momentum_W.linear;
            [P, target.momentum_W.angular + target.p_WC.cross(&P)]
        };
        let largest = check_wrist(&mut world, 1e-5, with_target);
        assert!(largest > 0.5, "{largest}");
    }
}
