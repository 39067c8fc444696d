use nalgebra::{DVector, Translation3, Vector3};

use super::*;
use crate::control::prediction::Prediction;
use crate::control::{Gains, LawKind, Saturation};
use crate::dynamics::Workspace;
use crate::model::Model;

const TIMEOUT: f64 = 0.5;
const Q: [f64; 2] = [0.3, 1.0];
const QD: [f64; 2] = [0.1, -0.2];
/// `-K_V q̇` of the gains below at `QD` \[N m\].
const DAMPING: [f64; 2] = [-20.0, 200.0];

fn config(prediction: Prediction) -> ControllerConfig {
    let gains = Gains {
        k_p: 100.0,
        k_o: 1.0,
        k_v: vec![200.0, 1000.0],
        saturation: Saturation::NONE,
    };
    ControllerConfig {
        prediction,
        ..ControllerConfig::new(LawKind::TransposeJacobian, gains)
    }
}

fn control_loop(lockstep: bool) -> ControlLoop {
    predicting(Prediction::None, lockstep)
}

fn predicting(prediction: Prediction, lockstep: bool) -> ControlLoop {
    let xml = include_str!("../../../../../urdf/planar_two_link.urdf");
    let model = Model::from_urdf(xml, "planar_two_link.urdf").unwrap();
    let tip = model.frame("tool0").unwrap().clone();
    let controller = Controller::new(model, tip, config(prediction)).unwrap();
    let timeout = TIMEOUT;
    let config = ControlLoopConfig {
        timeout,
        lockstep,
        compensates_delay: false,
    };
    ControlLoop::new(controller, config)
}

fn at(seconds: f64) -> Stamp {
    Stamp::from_secs_f64(seconds)
}

fn tip(control_loop: &ControlLoop) -> Pose {
    let controller = control_loop.controller();
    let mut workspace = Workspace::new(controller.model());
    workspace.set_positions(&DVector::from_row_slice(&Q));
    workspace.X_BF(controller.tip())
}

/// The tip's pose shifted by `x` \[m\].
fn goal(control_loop: &ControlLoop, x: f64) -> Pose {
    Translation3::new(x, 0.0, 0.0) * tip(control_loop)
}

fn see(control_loop: &mut ControlLoop, seconds: f64, x: f64) -> Result<(), InputError> {
    let (X_BE, X_BD) = (tip(control_loop), goal(control_loop, x));
    control_loop.add_tip_pose(0, at(seconds), X_BE)?;
    control_loop.add_goal_pose(0, at(seconds), X_BD)
}

/// Answers a joint state at `seconds` \[s\].
fn step(control_loop: &mut ControlLoop, seconds: f64) -> LoopReport {
    control_loop.add_joint_state(at(seconds), &Q, &QD).unwrap();
    control_loop.step().unwrap()
}

/// The x component of the position error that was acted on \[m\].
fn error(report: &LoopReport) -> Option<f64> {
    let report = report.control.as_ref().unwrap();
    report.error.as_ref().map(|error| error.position.x)
}

fn near(a: Option<f64>, b: f64) -> bool {
    a.is_some_and(|a| (a - b).abs() < 1e-9)
}

#[test]
fn poses_of_one_stamp_are_one_measurement_in_any_order() {
    let mut run = control_loop(false);
    let (X_BE, X_BD) = (tip(&run), goal(&run, 0.1));
    run.add_goal_pose(0, at(1.0), X_BD).unwrap();
    run.add_tip_pose(0, at(0.9), X_BE).unwrap();
    let report = step(&mut run, 1.0);
    assert_eq!(report.tip, InputStatus::Missing);
    assert_eq!(report.mode, ControlMode::DampingOnly);
    assert_eq!(run.efforts().as_slice(), DAMPING);

    run.add_tip_pose(0, at(1.0), X_BE).unwrap();
    let report = step(&mut run, 1.25);
    assert_eq!(report.tip, InputStatus::Used { age: 0.25 });
    assert_eq!(report.mode, ControlMode::Law);
    assert!(near(error(&report), 0.1), "{report:?}");
    assert_ne!(run.efforts().as_slice(), DAMPING);
    assert!(run.step().is_none(), "a state is answered once");
}

#[test]
fn the_newest_stamp_counts_whatever_arrives_last() {
    let mut run = control_loop(false);
    see(&mut run, 1.0, 0.1).unwrap();
    see(&mut run, 0.9, 0.2).unwrap();
    let report = step(&mut run, 1.1);
    assert!(near(error(&report), 0.1), "{report:?}");
    // A repeated stamp replaces the earlier sample.
    see(&mut run, 1.0, 0.3).unwrap();
    assert!(near(error(&step(&mut run, 1.1)), 0.3));
    // Only the newest joint state is answered.
    for k in 2..6 {
        run.add_joint_state(at(1.0 + 0.1 * f64::from(k)), &Q, &QD)
            .unwrap();
    }
    assert_eq!(run.step().unwrap().stamp, at(1.5));
    assert!(run.step().is_none());
}

#[test]
fn stale_measurements_leave_damping() {
    let mut run = control_loop(false);
    see(&mut run, 1.0, 0.1).unwrap();
    let last = step(&mut run, 1.0 + TIMEOUT);
    assert_eq!(last.tip, InputStatus::Used { age: TIMEOUT });
    let report = step(&mut run, 1.75);
    assert_eq!(report.tip, InputStatus::Stale { age: 0.75 });
    assert_eq!(report.mode, ControlMode::DampingOnly);
    assert_eq!(error(&report), None);
    see(&mut run, 1.75, 0.1).unwrap();
    assert_eq!(step(&mut run, 1.75).mode, ControlMode::Law);
}

// A pose may be ahead of its joint state; a pose of another clock or another run must not be used, nor block later
// ones.
#[test]
fn stamps_ahead_of_the_joint_state_are_used_within_the_timeout_only() {
    let mut run = control_loop(false);
    // Before the first joint state there is no time to compare with.
    see(&mut run, 1e9, 0.2).unwrap();
    run.add_gyro(at(1e9), Vector3::x()).unwrap();
    let report = step(&mut run, 1.0);
    assert_eq!(
        (report.tip, report.gyro),
        (InputStatus::Missing, InputStatus::Missing)
    );
    see(&mut run, 1.25, 0.1).unwrap();
    let report = step(&mut run, 1.0);
    assert_eq!(report.tip, InputStatus::Used { age: -0.25 });
    let refused = see(&mut run, 1.75, 0.2).unwrap_err();
    assert_eq!(
        refused.to_string(),
        "stamp is 0.75 s after the newest joint state; at most 0.5 s is accepted"
    );
    assert!(run.add_gyro(at(1.75), Vector3::x()).is_err());
    assert!(run.add_goal_rate(at(1.75), Vector3::x()).is_err());
    assert!(near(error(&step(&mut run, 1.25)), 0.1));
}

#[test]
fn time_that_jumps_back_starts_another_run() {
    let mut run = predicting(Prediction::Motion, false);
    let answers = |run: &mut ControlLoop| {
        let mut answers = Vec::new();
        for k in 0..20 {
            let time = 0.1 * f64::from(k);
            run.add_joint_state(at(time), &Q, &QD).unwrap();
            if k % 3 == 0 {
                see(run, time, 0.1 + 0.01 * f64::from(k)).unwrap();
            }
            run.add_gyro(at(time), Vector3::new(0.0, 0.0, 0.01))
                .unwrap();
            answers.push((run.step().unwrap(), run.efforts().clone()));
        }
        answers
    };
    let first = answers(&mut run);
    assert_eq!(answers(&mut run), first);
    // No earlier measurement remains: not even a pose that waits for its partner.
    let X_BE = tip(&run);
    run.add_tip_pose(0, at(0.5), X_BE).unwrap();
    run.add_joint_state(at(0.0), &Q, &QD).unwrap();
    let X_BD = goal(&run, 0.1);
    run.add_goal_pose(0, at(0.5), X_BD).unwrap();
    let report = run.step().unwrap();
    assert_eq!(
        (report.tip, report.gyro),
        (InputStatus::Missing, InputStatus::Missing)
    );
}

/// Efforts at 1 s with a camera frame from 0.2 s before, since when the arm has moved, and gyro samples until
/// `gyro_until` \[s\].
fn efforts_with_gyro_until(gyro_until: f64, w: Vector3<f64>) -> (DVector<f64>, InputStatus) {
    let mut run = predicting(Prediction::Latency, false);
    let mut status = InputStatus::Missing;
    for k in 0..=100 {
        let time = 0.01 * f64::from(k);
        run.add_joint_state(at(time), &Q, &QD).unwrap();
        if k % 10 == 0 && k <= 80 {
            see(&mut run, time, 0.1).unwrap();
        }
        if time <= gyro_until {
            run.add_gyro(at(time), w).unwrap();
        }
        status = run.step().unwrap().gyro;
    }
    (run.efforts().clone(), status)
}

// Fails if the last sample of a gyro that has stopped is used for ever.
#[test]
fn without_a_recent_gyro_sample_angular_momentum_is_taken_to_be_zero() {
    let turning = Vector3::new(0.0, 0.0, 0.5);
    let (never, missing) = efforts_with_gyro_until(-1.0, turning);
    assert_eq!(missing, InputStatus::Missing);
    let (always, used) = efforts_with_gyro_until(1.0, turning);
    assert!(matches!(used, InputStatus::Used { age } if age == 0.0));
    assert!((&always - &never).amax() > 0.1, "{always} {never}");
    // Without gyro over the last 0.2 s, in which the frame is extrapolated to the present.
    let (lost, stale) = efforts_with_gyro_until(0.25, turning);
    assert!(matches!(stale, InputStatus::Stale { age } if (age - 0.75).abs() < 1e-9));
    assert!((&lost - &never).amax() < 1e-9, "{lost} {never}");
    // Within the timeout the last sample is used.
    let (late, used) = efforts_with_gyro_until(0.75, turning);
    assert!(used.is_used());
    assert!((&late - &always).amax() < 1e-9, "{late} {always}");
}

#[test]
fn a_goal_rate_has_its_time_too() {
    let mut run = control_loop(false);
    assert_eq!(step(&mut run, 1.0).goal_rate, InputStatus::Missing);
    run.add_goal_rate(at(1.0), Vector3::x()).unwrap();
    let age = 0.25;
    assert_eq!(step(&mut run, 1.25).goal_rate, InputStatus::Used { age });
    let age = 1.0;
    assert_eq!(step(&mut run, 2.0).goal_rate, InputStatus::Stale { age });
}

#[test]
fn in_lockstep_a_state_waits_for_frame_and_gyro_of_its_stamp() {
    let mut run = control_loop(true);
    for k in 0..3 {
        run.add_joint_state(at(0.01 * f64::from(k)), &Q, &QD)
            .unwrap();
    }
    assert!(run.step().is_none());
    see(&mut run, 0.01, 0.1).unwrap();
    assert!(run.step().is_none(), "the gyro is missing");
    run.add_gyro(at(0.0), Vector3::zeros()).unwrap();
    assert!(run.step().is_none(), "the gyro's sample is older");
    run.add_gyro(at(0.01), Vector3::zeros()).unwrap();
    let report = run.step().unwrap();
    assert_eq!(
        (report.stamp, report.tip),
        (at(0.01), InputStatus::Used { age: 0.0 })
    );
    assert_eq!(report.goal_rate, InputStatus::Ignored);
    assert!(
        run.step().is_none(),
        "the frame of the next state has not come"
    );
    // A state that is sent again is answered again.
    run.skip();
    run.add_joint_state(at(0.01), &Q, &QD).unwrap_or_default();
    assert!(run.step().is_none(), "time jumped back");
    see(&mut run, 0.01, 0.1).unwrap();
    run.add_gyro(at(0.01), Vector3::zeros()).unwrap();
    assert!(run.step().is_some());
    run.add_joint_state(at(0.01), &Q, &QD).unwrap();
    assert_eq!(run.step().unwrap().stamp, at(0.01));
}

#[test]
fn values_that_are_wrong_are_refused_by_name() {
    let mut run = control_loop(false);
    let message = |added: Result<(), InputError>| added.unwrap_err().to_string();
    let short = message(run.add_joint_state(at(0.0), &Q[..1], &QD));
    assert_eq!(short, "joint position has 1 values; the robot has 2 joints");
    let nan = message(run.add_joint_state(at(0.0), &Q, &[0.0, f64::NAN]));
    assert_eq!(nan, "joint velocity is not finite");
    assert!(run.step().is_none());
    let X = Pose::from_parts(
        Translation3::new(f64::INFINITY, 0.0, 0.0),
        tip(&run).rotation,
    );
    assert_eq!(
        message(run.add_goal_pose(0, at(0.0), X)),
        "goal pose is not finite"
    );
    let X = tip(&run);
    let none = message(run.add_tip_pose(1, at(0.0), X));
    assert_eq!(none, "there is no tip 1; the robot has 1, counted from 0");
    let w = Vector3::new(0.0, f64::NAN, 0.0);
    assert_eq!(
        message(run.add_gyro(at(0.0), w)),
        "angular_velocity is not finite"
    );
}

#[test]
fn queues_are_bounded() {
    let mut run = control_loop(true);
    let (X_BE, X_BD) = (tip(&run), goal(&run, 0.1));
    run.add_gyro(at(0.0), Vector3::zeros()).unwrap();
    for k in 0..1000 {
        let stamp = Stamp::from_nanos(k);
        run.add_joint_state(stamp, &Q, &QD).unwrap();
        run.add_tip_pose(0, stamp, X_BE).unwrap();
    }
    // Of 1000 states the last 64 are left, and as many poses.
    run.add_goal_pose(0, Stamp::from_nanos(935), X_BD).unwrap();
    assert!(run.step().is_none());
    run.add_goal_pose(0, Stamp::from_nanos(936), X_BD).unwrap();
    run.add_gyro(at(1e-6), Vector3::zeros()).unwrap();
    assert_eq!(run.step().unwrap().stamp, Stamp::from_nanos(936));
}
