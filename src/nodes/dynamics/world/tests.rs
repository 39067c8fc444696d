//! Tests of the world: steps, commands, divergence, reset.

use super::*;
use crate::{
    dynamics::{IntegrationMethod, JointPhysics},
    nodes::{
        dynamics::{
            Description, InitialJoints, InitialMotion, Target, TargetParams,
            external_wrenches::{ExternalWrench, WrenchAxes},
            free_body::FreeBody as _,
            imu, joint_states, momentum,
        },
        scenario::Scenario,
    },
    ros::Time,
    spatial::{Twist, Wrench},
};
use nalgebra::{Isometry3, Vector3};

fn params(config: &str) -> DynamicsParams {
    let scenario = Scenario::read(&format!("package://fuyu/config/{config}.yaml")).unwrap();
    scenario.dynamics().unwrap()
}

fn world(config: &str) -> World {
    World::new(&params(config)).unwrap()
}

/// Checks that all published numbers are finite.
fn assert_publishable(world: &mut World) {
    assert!(world.check_divergence().is_ok());
    let stamp = Time::from_secs_f64(world.time());
    let states = joint_states(stamp, "base_link", world);
    let numbers = [&states.position, &states.velocity, &states.effort];
    assert!(
        numbers
            .iter()
            .all(|list| list.iter().all(|x| x.is_finite()))
    );
    let momentum = momentum(stamp, &world.robot);
    assert!(momentum.kinetic_energy.is_finite());
    let imu = imu(stamp, "base_link", world);
    let (w, a) = (imu.angular_velocity, imu.linear_acceleration);
    assert!([w.x, w.y, w.z, a.x, a.y, a.z].iter().all(|x| x.is_finite()));
}

#[test]
fn a_state_that_is_not_finite_is_replaced_by_the_one_before() {
    let mut world = world("positioning");
    world.hold_efforts([(0, 1.0)]);
    world.step_to_tick_or_restore().unwrap();
    let before = world.robot.state().clone();
    world.robot.input_mut().efforts[0] = f64::NAN;
    // A command within a period also steps the world.
    let problem = world.step_within_tick_or_restore(0.015).unwrap_err();
    assert!(problem.contains("diverged at 0.015 s"), "{problem}");
    let state = world.robot.state();
    assert_eq!((&state.q, &state.R_WB), (&before.q, &before.R_WB));
    assert_eq!(state.momentum_W, before.momentum_W);
    assert_eq!((state.qd.amax(), world.robot.efforts().amax()), (0.0, 0.0));
    world.step_to_tick_or_restore().unwrap();
    assert_eq!(world.ticks(), 2);
    assert!(world.mean_efforts().iter().all(|effort| *effort == 0.0));
    assert_publishable(&mut world);
}

/// Five seconds of efforts, `efforts(state, joint)` \[N m\], commanded at every state, and, if `between`, also between
/// states. Returns the reports of divergence.
fn attack(world: &mut World, between: bool, efforts: impl Fn(u64, usize) -> f64) -> Vec<String> {
    let mut problems = Vec::new();
    for tick in 0..500 {
        world.hold_efforts((0..6).map(|j| (j, efforts(tick, j))));
        if between {
            let time = world.time() + 0.0049;
            problems.extend(world.step_within_tick_or_restore(time).err());
            assert_publishable(world);
            world.hold_efforts((0..6).map(|j| (j, efforts(tick, j))));
        }
        problems.extend(world.step_to_tick_or_restore().err());
        assert_publishable(world);
        assert_eq!(world.ticks(), tick + 1);
    }
    problems
}

// Would break if a state beyond all measure were kept, or published, because its numbers are still finite.
#[test]
fn large_efforts_at_any_time_never_end_the_simulation() {
    let all = |_: u64, _: usize| 300.0;
    let rocking = |tick: u64, j: usize| match (tick + j as u64) / 7 % 2 {
        0 => 300.0,
        _ => -300.0,
    };
    let wrist = |_: u64, j: usize| if j == 4 { 300.0 } else { 0.0 };
    let elbow = |_: u64, j: usize| if j == 2 || j == 3 { 300.0 } else { 0.0 };
    let efforts: [&dyn Fn(u64, usize) -> f64; 4] = [&all, &rocking, &wrist, &elbow];
    for acceleration in [0.0, 1000.0] {
        let mut params = params("positioning");
        params.default_joint_acceleration = acceleration;
        let mut problems = Vec::new();
        for (efforts, between) in efforts.into_iter().flat_map(|e| [(e, false), (e, true)]) {
            let mut world = World::new(&params).unwrap();
            let found = attack(&mut world, between, efforts);
            println!(
                "limit {acceleration}, {between}: {} {:?}",
                found.len(),
                found.first()
            );
            println!("{:?}", world.robot.state().qd.as_slice());
            problems.extend(found);
            // The robot executes commands again.
            world.robot.restore(&world.start);
            world.hold_efforts((0..6).map(|j| (j, if j == 1 { 1.0 } else { 0.0 })));
            for _ in 0..100 {
                world.step_to_tick_or_restore().unwrap();
            }
            assert!(world.robot.state().qd[1] > 1e-3);
        }
        let named = problems
            .iter()
            .filter(|problem| problem.contains("joint '"));
        assert!(acceleration != 0.0 || named.count() > 0, "nothing diverges");
    }
}

// The momentum itself is too large: stopping the joints does not help.
#[test]
fn a_base_that_turns_too_fast_is_stopped() {
    for rate in [100.0, 1e5] {
        let mut world = world("servicing");
        let spin = Twist::new(Vector3::new(0.0, 0.0, rate), Vector3::zeros());
        world
            .robot
            .move_base(&Isometry3::identity(), &spin)
            .unwrap();
        let mut count = 0;
        for _ in 0..500 {
            count += usize::from(world.step_to_tick_or_restore().is_err());
            assert_publishable(&mut world);
        }
        println!("{rate} rad/s: restored {count} times");
        assert!(
            count <= 2 && (count == 2) == (world.robot.state().momentum_W.angular.norm() == 0.0)
        );
    }
}

#[test]
fn a_target_beyond_all_measure_is_stopped() {
    let mut world = world("servicing");
    let mut state = world.targets[0].body.state().clone();
    state.momentum_W.linear.x = 1e300;
    world.targets[0].body.set_state(state);
    assert!(
        world
            .step_to_tick_or_restore()
            .unwrap_err()
            .contains("target")
    );
    world.step_to_tick_or_restore().unwrap();
    assert_eq!(world.targets[0].body.state().momentum_W.linear.x, 0.0);
    assert_publishable(&mut world);
}

#[test]
fn joints_without_an_effort_limit_get_one() {
    let mut world = world("positioning");
    let note = world.default_effort_limits().unwrap();
    assert!(
        note.contains("joint1, joint2") && note.contains("1000 rad/s2"),
        "{note}"
    );
    assert!(world.hold_efforts([(5, 300.0)]));
    assert_eq!(world.robot.efforts()[5], 25.0);
    let mut params = params("positioning");
    params.default_joint_acceleration = 0.0;
    let mut world = World::new(&params).unwrap();
    assert_eq!(world.default_effort_limits(), None);
    assert!(!world.hold_efforts([(5, 300.0)]));
}

// Would break if a command in the middle of a period cost an integration step more in a free body.
#[test]
fn steps_within_a_period_end_at_the_same_tick() {
    let mut world = world("servicing");
    world.step_within_tick_or_restore(0.004).unwrap();
    world.step_within_tick_or_restore(0.002).unwrap();
    assert_eq!(world.time(), 0.004);
    world.step_to_tick();
    assert_eq!((world.time(), world.ticks()), (0.01, 1));
    assert!((world.robot.state().time - 0.01).abs() < 1e-15);
    assert!((world.targets[0].body.state().time - 0.01).abs() < 1e-15);
}

// Would break if a step copied states or efforts into new memory.
#[test]
fn steps_and_commands_do_not_allocate() {
    let mut world = world("servicing");
    let mut steps = || {
        world.hold_efforts([(0, 0.1)]);
        let time = world.time() + 0.003;
        world.step_within_tick_or_restore(time).unwrap();
        world.step_to_tick_or_restore().unwrap();
        world.drive_rates([(1, 0.01)]);
        world.step_to_tick_or_restore().unwrap();
    };
    steps();
    assert_eq!(allocation_counter::measure(steps).count_total, 0);
}

// Would break if stops or friction of a target's joints used new memory in a step.
const HINGED: &str = r#"<robot name="panel">
    <link name="hull"><inertial><mass value="2"/>
        <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
    <link name="panel"><inertial><mass value="1"/>
        <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
    <joint name="hinge" type="revolute"><parent link="hull"/><child link="panel"/><axis xyz="0 0 1"/>
        <limit lower="-0.01" upper="0.01" effort="10" velocity="5"/>
        <dynamics damping="0.01" friction="0.01"/></joint>
</robot>"#;

/// A target of a description at the world's origin, with joint rates \[rad/s\].
fn described(name: &str, urdf: &str, velocities: Vec<f64>) -> Target {
    let target = TargetParams {
        name: name.to_owned(),
        description: Description::new(urdf.to_owned(), name.to_owned(), true),
        motion: InitialMotion {
            pose: nalgebra::Isometry3::identity(),
            velocity_W: Vector3::zeros(),
            angular_velocity_B: Vector3::zeros(),
        },
        joints: InitialJoints {
            positions: vec![0.0; velocities.len()],
            velocities,
        },
    };
    Target::new(&target, IntegrationMethod::Rk4, &JointPhysics::default()).unwrap()
}

// A body is removed and another one of its name added, as by services. Fails if contact goes on with the first one.
#[test]
fn contact_is_with_the_body_that_has_replaced_another_of_its_name() {
    let mut world = world("gripping");
    world.step_to_tick_or_restore().unwrap();
    let joints = |world: &World| {
        let touching = world.robot.current_contact_system().expect("contact");
        touching.world().systems()[1].model().dof()
    };
    assert_eq!(joints(&world), 0);
    let name = world.targets.remove(0).name;
    world.targets.push(described(&name, HINGED, vec![0.0]));
    world.step_to_tick_or_restore().unwrap();
    assert_eq!(joints(&world), 1);
}

#[test]
fn bodies_whose_shapes_cannot_touch_are_found_before_they_are_simulated() {
    let mut world = world("gripping");
    assert_eq!(world.check_shapes(), Ok(()));
    let missing = HINGED.replacen(
        "</inertial></link>",
        r#"</inertial><collision><geometry><mesh filename="missing.stl"/></geometry></collision></link>"#,
        1,
    );
    world.targets.push(described("panel", &missing, vec![0.0]));
    let problem = world.check_shapes().unwrap_err();
    assert!(problem.contains("missing.stl"), "{problem}");
}

#[test]
fn steps_of_a_target_with_stops_and_friction_do_not_allocate() {
    let mut world = world("servicing");
    world.targets.push(described("panel", HINGED, vec![0.5]));
    let mut steps = || {
        for _ in 0..20 {
            world.step_to_tick_or_restore().unwrap();
        }
    };
    steps();
    assert_eq!(allocation_counter::measure(steps).count_total, 0);
    // It has hit a stop and lost energy.
    let state = world.targets.last().unwrap().body.state();
    assert!(
        state.q[0].abs() < 0.02 && state.qd[0].abs() < 0.5,
        "{state:?}"
    );
}

// The servo computes efforts with the inertia of the tree, which is not that of the mechanism: measured, it overshoots a way of
// 0.34 rad by 0.064 rad. Would break if it swung, did not arrive, or opened the loops.
#[test]
fn a_joint_of_a_closed_loop_is_driven_to_a_position_and_held() {
    let mut world = world("tr942_pantograph");
    let (joint, goal) = (1, -1.2);
    let start = world.robot.state().q.clone();
    world.command(&[(joint, Setpoint::Position(goal))]);
    let (mut open, mut beyond) = (0.0f64, 0.0f64);
    for _ in 0..3000 {
        world.step_to_tick_or_restore().unwrap();
        let robot = world.robot.rigid().expect("a rigid robot");
        let gaps = robot.loops().gaps(robot.workspace());
        open = gaps.fold(open, |most, (_, gap)| {
            most.max(gap.translation.max(gap.rotation))
        });
        beyond = beyond.max(world.robot.state().q[joint] - goal);
    }
    let state = world.robot.state();
    let (off, rate) = (state.q[joint] - goal, state.qd[joint]);
    println!("off by {off} rad, at {rate} rad/s; overshoot {beyond} rad, gap {open}");
    assert!(off.abs() < 1e-3 && rate.abs() < 1e-3 && beyond < 0.1 && open < 1e-9);
    let moved = (&state.q - &start).map(f64::abs);
    assert!(moved.sum() - moved[joint] > 0.1, "{moved}");
}

#[test]
fn a_reset_restores_the_start() {
    let mut world = world("servicing");
    let start = (
        world.robot.state().clone(),
        world.targets[0].body.state().clone(),
    );
    world.drive_rates([(0, 0.1)]);
    for _ in 0..10 {
        world.step_to_tick();
    }
    world.reset_time();
    world.reset_state();
    assert_eq!(*world.robot.state(), start.0);
    assert_eq!(*world.targets[0].body.state(), start.1);
    assert_eq!((world.time(), world.drive_mode()), (0.0, DriveMode::Effort));
    assert!(world.mean_efforts().iter().all(|effort| *effort == 0.0));
}

// Would break if the impulse of steps that are discarded were kept, or if the wrench went on to throw the robot about.
#[test]
fn a_wrench_beyond_all_measure_ends_and_leaves_no_impulse_behind() {
    let mut world = world("positioning");
    let link = world.robot.model().frames().last().unwrap().clone();
    let wrench = |strength: f64, from: f64, until: f64| ExternalWrench {
        axes: WrenchAxes::Robot(link.clone()),
        link: link.clone(),
        point: Vector3::zeros(),
        wrench: Wrench::new(
            Vector3::zeros(),
            Vector3::new(strength, -strength, strength),
        ),
        from,
        until,
        is_streamed: false,
    };
    for wrench in [wrench(1.0, 0.0, 0.055), wrench(1e12, 0.1, f64::INFINITY)] {
        world.wrenches_mut().add(wrench).unwrap();
    }
    let begin = world.robot.state().momentum_W;
    let problem = (0..20).find_map(|_| {
        let stepped = world.step_to_tick_or_restore();
        assert_publishable(&mut world);
        stepped.err()
    });
    println!("{problem:?}");
    assert!(problem.unwrap().contains("has diverged"));
    for _ in 0..10 {
        world.step_to_tick_or_restore().unwrap();
    }
    assert_eq!(world.wrenches_mut().clear(None), 0);
    let change = world.change_from_outside().unwrap();
    let momentum = world.robot.state().momentum_W;
    for (now, before, change) in [
        (momentum.linear, begin.linear, change.momentum_W.linear),
        (momentum.angular, begin.angular, change.momentum_W.angular),
    ] {
        assert!(change.norm() > 0.01 && change.norm() < 1.0, "{change}");
        assert!((now - before - change).norm() < 1e-12);
    }
    assert!(change.work > 0.0 && change.work < 1.0, "{}", change.work);
}
