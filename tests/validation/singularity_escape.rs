//! Where the law of Masutani 1995 chapter 5 would rest away from its goal: singular positions, eq. (5.4), half a turn
//! of attitude, eq. (5.5), goals out of reach. The law is sampled at 100 Hz.

use fuyu::control::{
    Controller, ControllerConfig, ConvergenceFailure, Gains, LawKind, Measurement, PoseError,
    Saturation, SingularityEscapeConfig, TipMeasurement,
};
use fuyu::dynamics::{Floating, IntegrationMethod, State, Workspace};
use fuyu::experiments::masutani_ch5;
use fuyu::experiments::masutani_ch6::{Planar, gains};
use fuyu::model::{Frame, Model};
use fuyu::spatial::Pose;
use nalgebra::{DVector, Rotation3, Translation3, Vector3};

struct Run {
    error: PoseError,
    /// The last failure to converge that was reported.
    failure: Option<ConvergenceFailure>,
    fastest_joint: f64,
}

fn run(model: Model, tip: &Frame, config: ControllerConfig, q: &[f64], goal: Pose) -> Run {
    let start = State::at_rest_with(&model, &DVector::from_row_slice(q));
    let mut robot = Floating::new(model.clone(), start, IntegrationMethod::Rk4);
    let mut controller = Controller::new(model, tip.clone(), config).unwrap();
    let (mut failure, mut fastest_joint) = (None, 0f64);
    let mut error = None;
    for _ in 0..6000 {
        let state = robot.state();
        let X_WB = state.X_WB(robot.workspace());
        let sight = TipMeasurement::new(
            state.time,
            robot.workspace().X_BF(tip),
            X_WB.inverse() * goal,
        );
        let seen = Measurement::new(state.time, &state.q, &state.qd).with_tip(Some(&sight));
        let report = controller.update(&seen).unwrap();
        failure = report.convergence_failure;
        error = report.error;
        fastest_joint = fastest_joint.max(state.qd.amax());
        robot.hold_efforts(controller.efforts().as_slice());
        robot.step(0.01, 1);
    }
    Run {
        error: error.unwrap(),
        failure,
        fastest_joint,
    }
}

fn planar(rate: f64, q: [f64; 2], goal: [f64; 2]) -> Run {
    let planar = Planar::table_6_2();
    let config = ControllerConfig {
        singularity_escape: SingularityEscapeConfig {
            rate,
            ..SingularityEscapeConfig::default()
        },
        ..ControllerConfig::new(LawKind::TransposeJacobian, gains(f64::INFINITY))
    };
    let goal = Translation3::new(goal[0], goal[1], 0.0);
    let goal = Pose::from_parts(goal, Rotation3::identity());
    run(planar.model.clone(), &planar.tip, config, &q, goal)
}

/// A stretched arm, and a goal on its line: the pull goes through every joint.
#[test]
fn a_kick_leaves_a_singular_position() {
    let (stretched, goal) = ([0.0, 0.0], [4.5, 0.0]);
    let resting = planar(0.0, stretched, goal);
    assert!((resting.error.position.norm() - 1.6).abs() < 1e-9);
    assert!(matches!(
        resting.failure,
        Some(ConvergenceFailure::AtSingularity { escapes: 0, .. })
    ));
    let kicked = planar(0.1, stretched, goal);
    assert!(kicked.error.position.norm() < 0.01, "{:?}", kicked.error);
    assert_eq!(kicked.failure, None);
}

/// No posture is there: the arm stretches towards the goal, rests, and says why. Nothing moves wildly.
#[test]
fn a_goal_out_of_reach_is_named_and_the_arm_rests() {
    let far = planar(0.1, [0.3, 1.0], [9.0, 2.0]);
    let Some(ConvergenceFailure::OutOfWorkspace { excess: short }) = far.failure else {
        panic!("{:?}", far.failure);
    };
    let left = far.error.position.norm();
    // Towards the stretched arm the pull on the joints fades, and with it the pace.
    assert!(left > short && left < short + 0.15, "{left} {short}");
    assert!(far.fastest_joint < 2.0, "{}", far.fastest_joint);
    let said = far.failure.unwrap().to_string();
    assert!(
        said.contains("farther from the system's centre of mass"),
        "{said}"
    );
}

/// The tip must turn by half a turn exactly: eq. (5.2) vanishes, and the thesis's law does not turn it at all.
#[test]
fn half_a_turn_is_made() {
    let model = masutani_ch5::model();
    let tip = model.frame("tool0").unwrap().clone();
    let q = masutani_ch5::GOAL.map(f64::to_radians);
    let mut workspace = Workspace::new(&model);
    workspace.set_positions(&DVector::from_row_slice(&q));
    let X = workspace.X_BF(&tip);
    // About the axis of the last joint, which alone can do it.
    let half = Rotation3::new(Vector3::x() * std::f64::consts::PI);
    let goal = Pose::from_parts(X.translation, X.rotation * half);
    assert!(PoseError::between(&X, &goal).orientation.norm() < 1e-12);
    let gains = Gains {
        k_p: 75.0,
        k_o: 100.0,
        k_v: masutani_ch5::K_V.to_vec(),
        saturation: Saturation {
            position: 0.2,
            orientation: 0.1,
        },
    };
    let config = ControllerConfig::new(LawKind::TransposeJacobian, gains);
    let turned = run(model, &tip, config, &q, goal);
    assert!(turned.error.angle < 0.02, "{:?}", turned.error);
    assert_eq!(turned.failure, None);
}
