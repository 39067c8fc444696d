use super::*;
use crate::nodes::scenario::Scenario;

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
fn momentum(world: &World) -> (nalgebra::Vector3<f64>, nalgebra::Vector3<f64>) {
    let states = [world.robot.state(), world.targets[0].body.state()];
    let sum = |of: &dyn Fn(&crate::dynamics::State) -> nalgebra::Vector3<f64>| {
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
    // At rest again where it was at the start, but it has been apart meanwhile.
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
