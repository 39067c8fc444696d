//! Whole missions: from observation to the identified target.

use fuyu_physics::control::capture::{CaptureConfig, CaptureMission, Phase};
use std::f64::consts::PI;

use nalgebra::{Rotation3, Vector3};

use crate::world::{SENSORS, Target, World, client, servicer, sides};

/// A target with grasp frames on its six sides, and a mission that may choose one.
fn begin(target: &Target, seed: u64) -> (World, CaptureMission) {
    begin_with(target, seed, CaptureConfig::default())
}

fn begin_with(target: &Target, seed: u64, config: CaptureConfig) -> (World, CaptureMission) {
    let mut world = World::new(target, SENSORS, seed);
    world.grasps = sides(target);
    let X_GT = target.X_TG.inverse();
    let config = CaptureConfig {
        grasps: world.grasps.iter().map(|X_TK| X_GT * X_TK).collect(),
        ..config
    };
    let (model, tip, camera) = servicer();
    let mission = CaptureMission::new(&model, &tip, &camera, config).unwrap();
    (world, mission)
}

fn print(mission: &CaptureMission) {
    for report in mission.reports() {
        println!(
            "{:9} {:7.2} {:?} {}",
            report.phase.name(),
            report.start,
            report.end,
            report.outcome
        );
        for figure in &report.figures {
            println!("    {}: {:.6} {}", figure.name, figure.value, figure.unit);
        }
    }
}

/// Runs until the mission is over, or until `limit` \[s\]; `each` sees every state.
fn run(
    world: &mut World,
    mission: &mut CaptureMission,
    limit: f64,
    mut each: impl FnMut(&mut World, &mut CaptureMission),
) {
    let mut note = String::new();
    while world.time() < limit && !mission.phase().is_over() {
        if note != mission.waits_for() {
            mission.waits_for().clone_into(&mut note);
            if mission.phase() == Phase::Plan {
                println!("{:7.2} {note}", world.time());
            }
        }
        each(world, mission);
        world.answer(mission);
    }
    print(mission);
}

fn slow(mass: f64) -> Target {
    client(mass, 3f64.to_radians(), Vector3::new(1.0, 0.3, 0.2))
}

#[test]
fn a_satellite_is_captured_stopped_and_identified() {
    let target = slow(300.0);
    let (mut world, mut mission) = begin(&target, 7);
    let standoff = mission.config().standoff;
    let mut meeting = None;
    run(&mut world, &mut mission, 200.0, |world, mission| {
        if mission.phase() == Phase::Grasp && meeting.is_none() {
            meeting = Some(world.relative(mission.X_GK(), standoff));
        }
    });
    println!("largest wrench {:?}", world.grasp);
    assert_eq!(mission.phase(), Phase::Done);
    // At the rendezvous the true twist of the point ahead of the grasp frame relative to the tip is small.
    let (X, V) = meeting.unwrap();
    println!(
        "{} {} {}",
        X.translation.vector.norm(),
        V.linear.norm(),
        V.angular.norm()
    );
    assert!(X.translation.vector.norm() < 0.02 && X.rotation.angle() < 0.02);
    assert!(V.linear.norm() < 2e-3 && V.angular.norm() < 2e-3);
    let rate = world.robot.workspace().V_WB_B().angular.norm();
    assert!(rate < 0.05f64.to_radians(), "{rate}");
    let truth = world.target_in_grasp_frame();
    let found = mission.payload().unwrap();
    assert!(
        (found.mass / truth.mass - 1.0).abs() < 0.01,
        "{} {}",
        found.mass,
        truth.mass
    );
    let identify = mission
        .reports()
        .iter()
        .find(|r| r.phase == Phase::Identify)
        .unwrap();
    assert_eq!(identify.figure("rank"), Some(13.0));
    let [before, after] = ["presumed", "identified"].map(|inertia| {
        let name = format!("joint error over motion with the {inertia} inertia");
        identify.figure(&name).unwrap()
    });
    assert!(after < 0.5 * before, "{after} {before}");
    let config = mission.config().detumble;
    assert!(world.grasp.0 < config.grasp_force && world.grasp.1 < config.grasp_torque);
}

#[test]
fn a_target_that_disappears_and_a_latch_that_fails_end_in_safety() {
    let target = slow(150.0);
    let (mut world, mut mission) = begin(&target, 8);
    run(&mut world, &mut mission, 200.0, |world, mission| {
        if mission.phase() == Phase::Approach {
            world.target_is_visible = false;
        }
    });
    assert_eq!(mission.phase(), Phase::Aborted);
    let reason = mission.abort_reason().unwrap();
    assert!(
        reason.contains("the target has not been seen for"),
        "{reason}"
    );
    assert!(world.robot.state().qd.amax() < 2e-3);
    assert!(world.held.is_none());
}

#[test]
fn a_latch_that_does_not_hold_is_found_by_pulling() {
    let target = slow(150.0);
    let (mut world, mut mission) = begin(&target, 9);
    world.latch_works = false;
    run(&mut world, &mut mission, 200.0, |_, _| {});
    assert_eq!(mission.phase(), Phase::Aborted);
    let reason = mission.abort_reason().unwrap();
    assert!(reason.contains("not grasped in 2 attempts"), "{reason}");
    // The tip has retreated.
    let (X, _) = world.relative(mission.X_GK(), 0.0);
    assert!(X.translation.vector.norm() > 0.2, "{X}");
}

/// A mission whose gripper says what `says` does of the phase and of the time since it was told to close.
fn with_report(says: fn(Phase, f64) -> Option<bool>) -> (World, CaptureMission) {
    let config = CaptureConfig {
        reports_grip: true,
        ..CaptureConfig::default()
    };
    let (mut world, mut mission) = begin_with(&slow(150.0), 9, config);
    let mut closed = None;
    run(&mut world, &mut mission, 250.0, |world, mission| {
        let time = world.time();
        match world.held.is_some() {
            true => _ = closed.get_or_insert(time),
            false => closed = None,
        }
        mission.set_grip(closed.and_then(|closed| says(mission.phase(), time - closed)));
    });
    (world, mission)
}

// Fails if the mission went on with a target that its gripper does not hold: it opens the gripper, and retreats, or stops.
#[test]
fn a_gripper_that_holds_nothing_or_loses_the_target_ends_in_safety() {
    let (world, mission) = with_report(|_, since| (since > 2.0).then_some(false));
    assert_eq!(
        mission.abort_reason(),
        Some("not grasped in 2 attempts: the gripper holds nothing")
    );
    let (X, _) = world.relative(mission.X_GK(), 0.0);
    assert!(X.translation.vector.norm() > 0.2, "{X}");
    let (world, mission) = with_report(|phase, since| match phase {
        Phase::Grasp => (since > 4.0).then_some(true),
        _ => Some(since < 15.0),
    });
    assert_eq!(
        mission.abort_reason(),
        Some("the gripper has lost the target")
    );
    assert!(world.held.is_none());
    assert!(world.robot.state().qd.amax() < 5e-3);
}

#[test]
fn an_operator_holds_resumes_skips_and_aborts() {
    let target = slow(200.0);
    let (mut world, mut mission) = begin(&target, 10);
    assert!(mission.skip().is_ok());
    let mut paused_at = None;
    let mut done = false;
    run(&mut world, &mut mission, 400.0, |world, mission| {
        let time = world.time();
        match (mission.phase(), paused_at) {
            (Phase::Approach, None) if mission.progress() > 0.3 => {
                assert!(mission.skip().unwrap_err().to_string().contains("approach"));
                mission.hold().unwrap();
                paused_at = Some(time);
            }
            (_, Some(at)) if mission.is_paused() && time > at + 5.0 => {
                assert!(world.robot.state().qd.amax() < 1e-2, "the arm has stopped");
                mission.resume().unwrap();
            }
            (Phase::Grasp, Some(_)) if mission.progress() > 0.3 && !done => {
                done = true;
                mission.abort("the operator").unwrap();
            }
            _ => {}
        }
    });
    assert!(done);
    assert_eq!(mission.abort_reason(), Some("the operator"));
    let (X, _) = world.relative(mission.X_GK(), 0.0);
    assert!(X.translation.vector.norm() > 0.2, "{X}");
    assert!(mission.hold().is_err() && mission.abort("again").is_err());
    assert!(world.held.is_none());
}

/// Dispersed missions: masses from 60 to 500 kg, any attitude, rates from .5 to 5 deg/s. `RUNS` says how many. Fails if
/// fewer than 97 % are captured, or if one that is captured turns, was loaded, or is wrong in its mass beyond the limits.
#[test]
#[ignore = "a minute"]
fn dispersed_missions() {
    use rand::{RngExt, SeedableRng, rngs::StdRng};
    let runs: u64 = std::env::var("RUNS").map_or(20, |runs| runs.parse().unwrap());
    let mut random = StdRng::seed_from_u64(2026);
    let (mut captured, mut worst) = (0, [0.0_f64; 4]);
    for run_index in 0..runs {
        let mass = random.random_range(60.0..500.0);
        let rate = random.random_range(0.5f64..5.0).to_radians();
        let axis = Vector3::from_fn(|_, _| random.random_range(-1.0..1.0));
        let mut target = client(mass, rate, axis);
        let turn = Vector3::from_fn(|_, _| random.random_range(-1.0..1.0)) * PI;
        target.X_WT.rotation = Rotation3::from_scaled_axis(turn);
        let (mut world, mut mission) = begin(&target, run_index);
        while world.time() < 400.0 && !mission.phase().is_over() {
            world.answer(&mut mission);
        }
        let final_rate = world.robot.workspace().V_WB_B().angular.norm().to_degrees();
        let found = mission.payload().map_or(f64::NAN, |p| p.mass);
        let error = (found / world.target_in_grasp_frame().mass - 1.0).abs();
        println!(
            "{run_index:3} {mass:5.0} kg {:4.1} deg/s: {} {:.0} s, {:?}; rate {final_rate:.4} deg/s, wrench {:.1} N {:.1} N m, mass error {:.3} %",
            rate.to_degrees(),
            mission.phase().name(),
            world.time(),
            mission.abort_reason(),
            world.grasp.0,
            world.grasp.1,
            100.0 * error
        );
        if mission.phase() == Phase::Done {
            captured += 1;
            let figures = [final_rate, world.grasp.0, world.grasp.1, error];
            for (worst, figure) in worst.iter_mut().zip(figures) {
                *worst = worst.max(figure);
            }
        }
    }
    println!(
        "captured {captured} of {runs}; worst rate {} deg/s, force {} N, torque {} N m, mass error {}",
        worst[0], worst[1], worst[2], worst[3]
    );
    let [rate, force, torque, mass] = worst;
    assert!(
        f64::from(captured) >= 0.97 * runs as f64,
        "{captured} of {runs}"
    );
    assert!(rate < 0.05 && mass < 0.01, "{rate} {mass}");
    let limits = CaptureConfig::default().detumble;
    assert!(force <= limits.grasp_force && torque <= limits.grasp_torque);
}
