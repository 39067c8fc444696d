//! The positioning runs of Masutani 1995 chapter 5, with the law sampled at 100 Hz as the nodes do,
//! against an independent simulation (`fixtures/masutani_ch5.json`: the law evaluated continuously).

use fuyu::control::{
    Controller, ControllerConfig, Gains, JacobianKind, LawKind, PoseError, Saturation,
};
use fuyu::dynamics::{Floating, Method, State, Workspace};
use fuyu::spatial::{Pose, roll_pitch_yaw_intrinsic};
use nalgebra::Vector3;
use serde_json::Value;

use crate::fixtures::{degrees, numbers, servicer};

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

const K_V: [f64; 6] = [400.0, 100.0, 200.0, 10.0, 2.0, 2.0];

fn run(law: LawKind, jacobian: JacobianKind, period: f64) -> Run {
    let model = servicer();
    let tip = model.frame("tool0").unwrap().clone();
    let mut workspace = Workspace::new(&model);
    workspace.set_positions(&model, &degrees(&[87.0, 62.0, -41.0, 51.0, 28.0, 68.0]));
    let X_WD = workspace.X_BF(&tip);
    let gains = Gains {
        k_p: 75.0,
        k_o: 100.0,
        k_v: K_V.to_vec(),
        saturation: Saturation {
            position: 0.2,
            orientation: 0.1,
        },
    };
    let joint_k_p = K_V.iter().map(|k| 0.2 * k).collect();
    let config = ControllerConfig {
        law,
        jacobian,
        gains,
        joint_k_p,
    };
    let mut controller = Controller::new(model.clone(), tip.clone(), config).unwrap();
    let start = State::at_rest_with(&model, &degrees(&[65.0, 99.0, -95.0, -22.0, 3.0, -42.0]));
    let mut robot = Floating::new(model, start, Method::Rk4);
    let per_sample = (3.0 / period).round() as usize;
    let mut out = Run {
        settled: 0.0,
        error: PoseError::between(&X_WD, &X_WD),
        base: Pose::identity(),
        max_tip_speed: 0.0,
        max_tip_acceleration: 0.0,
        max_base_angular_acceleration: 0.0,
        samples: Vec::new(),
    };
    for k in 0..=20 * per_sample {
        out.base = robot.state().X_WB(robot.workspace());
        let X_BE = robot.workspace().X_BF(&tip);
        let X_BD = out.base.inverse() * X_WD;
        out.error = PoseError::between(&X_BE, &X_BD);
        if out.error.position.norm() > 0.01 {
            out.settled = (k + 1) as f64 * period;
        }
        if k % per_sample == 0 {
            let p = (out.base * X_BE).translation.vector;
            out.samples.push((robot.state().q.as_slice().to_vec(), p));
        }
        let (q, qd) = (robot.state().q.clone(), robot.state().qd.clone());
        controller.update(&q, &qd, Some((&X_BE, &X_BD))).unwrap();
        robot.hold_efforts(controller.efforts().as_slice());
        robot.accelerations();
        let seen = robot.workspace();
        let base_link = &robot.model().frames()[0];
        out.max_tip_speed = out.max_tip_speed.max(seen.V_WF_B(&tip).linear.norm());
        out.max_tip_acceleration = out
            .max_tip_acceleration
            .max(seen.A_WF_B(&tip).linear.norm());
        out.max_base_angular_acceleration = out
            .max_base_angular_acceleration
            .max(seen.A_WF_B(base_link).angular.norm());
        robot.step(period, 1);
    }
    out
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
/// halves the distance from the reference. A wrong bias force, momentum map or gain breaks this by orders.
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
    // Richardson: at period zero what is left must be far smaller than either.
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
