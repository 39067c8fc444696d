//! The camera latency up to which the control loop is stable.

use fuyu::control::LawKind;
use fuyu::control::prediction::Prediction;
use fuyu::experiments::tracking::{Run, Setup, latency_margin};
use fuyu::vision::PoseCameraConfig;

/// Where the thesis's gains are lost without compensation, and that nothing is with it.
#[test]
fn known_latency_is_compensated_and_unknown_latency_is_not() {
    let margin = |prediction, law| latency_margin(prediction, law, 0.0);
    let law = LawKind::TransposeJacobian;
    // k_o / k_v of the wrist is 50 1/s: a quarter of a turn of phase is 31 ms, less what sampling takes.
    let bare = margin(Prediction::None, law).expect("unstable somewhere");
    assert!((0.01..0.03).contains(&bare), "{bare}");
    assert_eq!(margin(Prediction::Latency, law), None);
    assert_eq!(margin(Prediction::Motion, law), None);
    assert_eq!(margin(Prediction::Motion, LawKind::OperationalSpace), None);
}

#[test]
fn ten_frames_a_second_are_too_few_without_compensation_and_enough_with_it() {
    let law = LawKind::TransposeJacobian;
    assert_eq!(latency_margin(Prediction::None, law, 10.0), Some(0.0));
    assert_eq!(latency_margin(Prediction::Latency, law, 10.0), None);
}

/// A camera that is late by 0.4 s brings the tip to a goal at rest as exactly as one that is not.
#[test]
fn latency_costs_no_accuracy_where_the_goal_is_at_rest() {
    let end = |latency| {
        let camera = PoseCameraConfig {
            latency,
            rate: 10.0,
            ..PoseCameraConfig::default()
        };
        let setup = Setup {
            camera,
            moving: false,
            ..Setup::ideal(Prediction::Latency)
        };
        let moments = Run::new(setup).moments(60.0);
        moments.last().unwrap().error.position.norm()
    };
    assert!(end(0.4) < 1e-4 && end(0.0) < 1e-4);
}
