//! The positioning runs of Masutani 1995 chapter 5, with the law sampled at 100 Hz as the nodes do,
//! against an independent simulation (`fixtures/masutani_ch5.json`: the law evaluated continuously).

use fuyu::control::{JacobianKind, LawKind, PoseError};
use fuyu::experiments::masutani_ch5 as positioning;
use fuyu::spatial::{Pose, roll_pitch_yaw_intrinsic};
use nalgebra::Vector3;
use serde_json::Value;

use crate::fixtures::numbers;

struct Run {
    /// Time after which the tip stays within 1 cm \[s\].
    settled: f64,
    error: PoseError,
    base: Pose,
    max_tip_speed: f64,
    max_tip_acceleration: f64,
    max_base_angular_acceleration: f64,
    /// Joint positions and tip position every 3 s.
    samples: Vec<(Vec<f64>, Vector3<f64>)>,
}

fn run(law: LawKind, jacobian: JacobianKind, period: f64) -> Run {
    let moments = positioning::Run::new(law, jacobian, period).moments(60.0);
    let largest =
        |figure: fn(&positioning::Moment) -> f64| moments.iter().map(figure).fold(0.0, f64::max);
    let far = moments.iter().rposition(|m| m.error.position.norm() > 0.01);
    let every_3_s = (3.0 / period).round() as usize;
    let samples = moments.iter().step_by(every_3_s);
    let last = moments.last().unwrap();
    Run {
        settled: far.map_or(0.0, |k| (k + 1) as f64 * period),
        error: last.error,
        base: last.X_WB,
        max_tip_speed: largest(|m| m.tip_speed),
        max_tip_acceleration: largest(|m| m.tip_acceleration),
        max_base_angular_acceleration: largest(|m| m.alpha_WB_B.norm()),
        samples: samples.map(|m| (m.q.as_slice().to_vec(), m.p_WE)).collect(),
    }
}

fn fixture(name: &str) -> Value {
    let all: Value = serde_json::from_str(include_str!("fixtures/masutani_ch5.json")).unwrap();
    all[name].clone()
}

/// Base position and attitude within 1 % of the reference's norm.
fn assert_base_drift(run: &Run, reference: &Value) {
    let position = Vector3::from_row_slice(&numbers(&reference["base_pos_end"]));
    let angles = Vector3::from_row_slice(&numbers(&reference["base_rpy_end"]));
    let ours = Vector3::from(roll_pitch_yaw_intrinsic(&run.base.rotation)).map(f64::to_degrees);
    assert!((run.base.translation.vector - position).norm() < 0.01 * position.norm());
    assert!(
        (ours - angles).norm() < 0.01 * angles.norm(),
        "{ours} {angles}"
    );
}

#[test]
fn the_transpose_generalized_jacobian_law_settles_as_the_reference() {
    let run = run(LawKind::TransposeJacobian, JacobianKind::Generalized, 0.01);
    let reference = fixture("TJC_GJM");
    assert!((run.settled - 33.9).abs() < 0.2, "{}", run.settled);
    assert!(run.error.position.norm() < 1e-3 && run.error.angle < 1e-3);
    assert_base_drift(&run, &reference);
    // Thesis: about 0.65 m/s and 2.5 m/s²; the reference gives .624 and 2.556.
    assert!((run.max_tip_speed / reference["vmax"].as_f64().unwrap() - 1.0).abs() < 0.01);
    assert!((run.max_tip_acceleration / reference["amax"].as_f64().unwrap() - 1.0).abs() < 0.01);
    let alpha = reference["base_alpha_max"].as_f64().unwrap();
    assert!((run.max_base_angular_acceleration / alpha - 1.0).abs() < 0.02);
}

/// The sampled law tends to the continuous one as the period shrinks, at first order: halving the period
/// halves the distance from the reference. A wrong bias force, momentum map or gain would change it by orders of magnitude.
#[test]
fn sampling_faster_tends_to_the_continuous_law() {
    let reference = fixture("TJC_GJM");
    let distance = |period: f64| {
        let run = run(
            LawKind::TransposeJacobian,
            JacobianKind::Generalized,
            period,
        );
        let samples = reference["samples_3s"].as_array().unwrap();
        assert_eq!(run.samples.len(), samples.len());
        samples
            .iter()
            .zip(&run.samples)
            .fold(0.0f64, |worst, (theirs, (q, _))| {
                let theirs = numbers(&theirs["q"]);
                q.iter()
                    .zip(&theirs)
                    .fold(worst, |w, (a, b)| w.max((a - b).abs()))
            })
    };
    let (coarse, fine) = (distance(0.01), distance(0.0025));
    assert!(coarse < 2e-3, "{coarse:e}");
    assert!((coarse / fine - 4.0).abs() < 0.4, "{coarse:e} {fine:e}");
    // Richardson extrapolation to period zero: the remaining distance must be far smaller than either.
    assert!(
        fine - (coarse - fine) / 3.0 < 0.03 * fine,
        "{coarse:e} {fine:e}"
    );
}

#[test]
fn the_fixed_base_jacobian_arrives_too() {
    let run = run(LawKind::TransposeJacobian, JacobianKind::FixedBase, 0.01);
    let reference = fixture("TJC_fixedJ");
    assert!(
        (run.settled - reference["t_1cm"].as_f64().unwrap()).abs() < 0.2,
        "{}",
        run.settled
    );
    assert!(run.error.position.norm() < 1e-3);
    assert_base_drift(&run, &reference);
}

#[test]
fn joint_pd_towards_a_goal_fixed_at_the_start_misses() {
    let run = run(LawKind::JointPd, JacobianKind::Generalized, 0.01);
    let reference = fixture("jointPD_Kp=0.2KV");
    let miss = run.error.position.norm();
    assert!((miss / 0.93 - 1.0).abs() < 0.02, "{miss}");
    assert!(
        (miss / reference["e_final"].as_f64().unwrap() - 1.0).abs() < 1e-3,
        "{miss}"
    );
    let degrees = reference["ang_final"].as_f64().unwrap();
    assert!((run.error.angle.to_degrees() - degrees).abs() < 0.01);
}
