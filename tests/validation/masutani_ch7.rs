//! Masutani 1995 chapter 7, straight paths, against an independent reference (`fixtures/masutani_ch7.json`), and on
//! twelve tasks; and beyond the thesis, on an arm with a light wrist.

use fuyu::control::{
    Controller, ControllerConfig, JacobianKind, LawConfig, LawKind, Measurement, PoseError,
    Shaping, StraightPathConfig, TipMeasurement,
};
use fuyu::dynamics::{Floating, IntegrationMethod, State, Workspace};
use fuyu::experiments::masutani_ch5;
use fuyu::experiments::masutani_ch7::{FIG_7_3, Outcome, Steering, Task, config, tasks};
use nalgebra::DVector;
use serde_json::Value;

use crate::fixtures::numbers;

const ROTATION: Steering = Steering::Straight(Shaping::Rotation);
const DAMPING: Steering = Steering::Straight(Shaping::Damping);

/// The tip every 3 s for a minute, within 1e-6 m, with the reference's integration (RK4, 20 ms). The method matters:
/// where the tip starts, the rotation jumps from `P = I` to what the first motion asks for, and every method has its
/// own error there. A rotation to the other side, without one of its bounds or about another axis is off by
/// centimetres. In the last run the tip has become so slow after 28 s that the rotation is too stiff for the
/// reference's step: rounding grows there, to 1e-5 m.
#[test]
fn the_plain_and_the_rotated_law_go_as_the_reference() {
    let runs: Vec<Value> =
        serde_json::from_str(include_str!("fixtures/masutani_ch7.json")).unwrap();
    for run in &runs {
        let steering = match run["mod"].as_u64().unwrap() {
            0 => Steering::Plain,
            _ => ROTATION,
        };
        let task = Task {
            start: numbers(&run["q0"]).try_into().unwrap(),
            goal: numbers(&run["target"]).try_into().unwrap(),
        };
        let mut robot = task
            .start(config(steering))
            .with_method(IntegrationMethod::Rk4);
        for sample in run["samples"].as_array().unwrap() {
            let theirs = numbers(sample);
            if theirs[0] > 0.0 {
                robot.run_to(theirs[0], 0.02);
            }
            let ours = robot.X_WE().translation.vector;
            let stiff = steering == ROTATION && task != FIG_7_3 && theirs[0] > 28.0;
            let tolerance = if stiff { 1e-5 } else { 1e-6 };
            for (ours, theirs) in ours.iter().zip(&theirs[1..]) {
                assert!(
                    (ours - theirs).abs() < tolerance,
                    "{steering:?} {ours} {theirs}"
                );
            }
        }
    }
}

#[test]
fn the_example_becomes_straight() {
    let run = |steering| FIG_7_3.run(config(steering), 60.0);
    let (plain, rotated) = (run(Steering::Plain), run(ROTATION));
    assert!(
        (plain.deviation - 0.466).abs() < 1e-3,
        "{}",
        plain.deviation
    );
    assert!(
        (plain.path_ratio - 1.228).abs() < 2e-3,
        "{}",
        plain.path_ratio
    );
    assert!(
        (rotated.deviation - 0.044).abs() < 2e-3,
        "{}",
        rotated.deviation
    );
    assert!(
        (rotated.path_ratio - 1.001).abs() < 2e-3,
        "{}",
        rotated.path_ratio
    );
}

/// Rotation straightens every path but crawls on some; damping straightens them more and is through with each within
/// half a minute.
#[test]
fn twelve_tasks_straight_and_in_time() {
    let mut crawled = 0;
    for (number, task) in tasks().iter().enumerate() {
        let run = |steering| -> Outcome { task.run(config(steering), 60.0) };
        let [plain, rotated, damped] = [Steering::Plain, ROTATION, DAMPING].map(run);
        assert!(rotated.deviation < plain.deviation, "{number}");
        assert!(damped.deviation < 0.3 * plain.deviation, "{number}");
        assert!(damped.settled.is_some_and(|t| t < 30.0), "{number}");
        crawled += usize::from(rotated.settled.is_none_or(|t| t > 30.0));
    }
    assert!(crawled > 0);
}

/// How the servicer of chapter 5 fared, sampled at 100 Hz.
#[derive(Debug)]
struct Sampled {
    /// Largest distance of the tip from the straight line [m].
    deviation: f64,
    /// Time after which the tip stays within 1 cm and 2 degrees [s].
    settled: Option<f64>,
    /// How often a joint's acceleration changed its side from one sample to the next.
    reversals: usize,
    fastest_joint: f64,
}

/// The positioning run of chapter 5 for a minute under `law`; commands act `late` samples after the state that they answer.
fn sampled(law: impl Into<LawConfig>, late: usize) -> Sampled {
    let model = masutani_ch5::model();
    let tip = model.frame("tool0").unwrap().clone();
    let radians = |degrees: [f64; 6]| DVector::from_iterator(6, degrees.map(f64::to_radians));
    let mut workspace = Workspace::new(&model);
    workspace.set_positions(&radians(masutani_ch5::GOAL));
    let X_WD = workspace.X_BF(&tip);
    let chapter_5 = masutani_ch5::config(LawKind::TransposeJacobian, JacobianKind::Generalized);
    let config = ControllerConfig {
        law: law.into(),
        ..chapter_5
    };
    let mut controller = Controller::new(model.clone(), tip.clone(), config).unwrap();
    let start = State::at_rest_with(&model, &radians(masutani_ch5::START));
    let mut robot = Floating::new(model, start, IntegrationMethod::Rk4);
    let mut commands = vec![DVector::zeros(6); late];
    let (mut rates, mut change) = (DVector::zeros(6), DVector::zeros(6));
    let (mut path, mut far, mut reversals, mut fastest_joint) = (Vec::new(), Some(0), 0, 0.0f64);
    for k in 0..6000 {
        let time = 0.01 * f64::from(k);
        let X_WB = robot.state().X_WB(robot.workspace());
        let X_BE = robot.workspace().X_BF(&tip);
        path.push((X_WB * X_BE).translation.vector);
        let sight = TipMeasurement::new(time, X_BE, X_WB.inverse() * X_WD);
        let error = PoseError::between(&sight.X_BE, &sight.X_BD);
        if !(error.position.norm() < 0.01 && error.angle < 2f64.to_radians()) {
            far = Some(k);
        }
        let (q, qd) = (robot.state().q.clone(), robot.state().qd.clone());
        if !robot.state().is_finite() {
            far = Some(5999);
            break;
        }
        fastest_joint = fastest_joint.max(qd.amax());
        let changes = &qd - &rates;
        let turned =
            |(now, before): (&f64, &f64)| now * before < 0.0 && (now - before).abs() > 1e-5;
        reversals += changes
            .iter()
            .zip(&change)
            .filter(|pair| turned(*pair))
            .count();
        (rates, change) = (qd.clone(), changes);
        let seen = Measurement::new(time, &q, &qd).with_tip(Some(&sight));
        controller.update(&seen).unwrap();
        commands.push(controller.efforts().clone());
        robot.hold_efforts(commands.remove(0).as_slice());
        robot.step(0.01, 1);
    }
    let line = (X_WD.translation.vector - path[0]).normalize();
    let off = path.iter().map(|p| (p - path[0]).cross(&line).norm());
    Sampled {
        deviation: off.fold(0.0, f64::max),
        settled: far.filter(|k| *k < 5999).map(|k| 0.01 * f64::from(k + 1)),
        reversals,
        fastest_joint,
    }
}

/// The tip of the whole servicer goes straight as well, although its wrist is light: it has joints with 0.02 kg m² against a
/// tip that is damped by hundreds of N s/m. Without the bound by the period both ways are lost within a second.
#[test]
fn straight_paths_serve_a_light_wrist_that_is_sampled() {
    let with = |shaping, period| StraightPathConfig {
        shaping,
        period,
        d_along: 225.0,
        ..StraightPathConfig::default()
    };
    let plain = sampled(LawKind::TransposeJacobian, 0);
    let [damped, late, rotated] = [
        (Shaping::Damping, 0),
        (Shaping::Damping, 1),
        (Shaping::Rotation, 0),
    ]
    .map(|(shaping, late)| sampled(with(shaping, 0.01), late));
    println!("plain {plain:?}\ndamped {damped:?}\nlate {late:?}\nrotated {rotated:?}");
    assert!(plain.deviation > 0.8, "{plain:?}");
    for run in [&damped, &late] {
        assert!(run.deviation < 0.05, "{run:?}");
        assert!(run.settled.is_some_and(|t| t < 35.0), "{run:?}");
        assert!(run.fastest_joint < 0.5, "{run:?}");
    }
    assert!(rotated.deviation < 0.5 * plain.deviation, "{rotated:?}");
    assert!(rotated.settled.is_some_and(|t| t < 45.0), "{rotated:?}");
    for run in [&damped, &late, &rotated] {
        assert!(run.reversals < plain.reversals + 60, "{run:?} {plain:?}");
    }
    for shaping in [Shaping::Damping, Shaping::Rotation] {
        let unbounded = sampled(with(shaping, 0.0), 0);
        println!("unbounded {shaping:?} {unbounded:?}");
        assert!(unbounded.reversals > 1000 || unbounded.settled.is_none());
    }
}
