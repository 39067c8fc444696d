//! Several tips and the reaction null space, on the two-armed robot of `urdf/dual_arm.urdf`.

use fuyu::control::{
    BaseTask, Controller, ControllerConfig, Gains, Measurement, OperationalSpaceConfig, PoseError,
    Rows, Saturation, TaskPriority, TipMeasurement, TipTask,
};
use fuyu::dynamics::{Floating, IntegrationMethod, State, Workspace};
use fuyu::model::{Frame, Model};
use fuyu::spatial::Pose;
use nalgebra::{DMatrix, DVector, Vector6};

/// Joint angles at the start, and at the goals [deg]; elbows and wrists are bent.
const START: [f64; 14] = [
    20.0, 40.0, 10.0, -80.0, 10.0, 50.0, 0.0, -20.0, 40.0, -10.0, -80.0, -10.0, 50.0, 0.0,
];
const GOAL: [f64; 14] = [
    50.0, 60.0, 0.0, -60.0, 30.0, 30.0, 20.0, -20.0, 20.0, -30.0, -95.0, -10.0, 70.0, -30.0,
];

fn robot() -> (Model, Frame, Frame) {
    let xml = include_str!("../../urdf/dual_arm.urdf");
    let model = Model::from_urdf(xml, "urdf/dual_arm.urdf").unwrap();
    let [left, right] = ["left_tool", "right_tool"].map(|f| model.frame(f).unwrap().clone());
    (model, left, right)
}

fn degrees(values: &[f64; 14]) -> DVector<f64> {
    DVector::from_iterator(14, values.iter().map(|x| x.to_radians()))
}

struct End {
    errors: [PoseError; 2],
    /// Rotation of the base at the end, and its largest rotation during the run [rad].
    turned: f64,
    most: f64,
    fastest_joint: f64,
}

/// Simulates 40 s: both tips start at rest, and each has a goal at rest in the world.
fn run(tips: [TipTask; 2], base: BaseTask) -> End {
    let (model, left, right) = robot();
    let mut workspace = Workspace::new(&model);
    workspace.set_positions(&degrees(&GOAL));
    let goals: [Pose; 2] = [&left, &right].map(|tip| workspace.X_BF(tip));
    let gains = Gains {
        k_p: 1.0,
        k_o: 1.0,
        k_v: vec![1.0; 14],
        saturation: Saturation {
            position: 0.2,
            orientation: 0.2,
        },
    };
    let law = OperationalSpaceConfig {
        tips: tips.to_vec(),
        base,
        ..OperationalSpaceConfig::default()
    };
    let config = ControllerConfig::new(law, gains);
    let more = vec![right.clone()];
    let mut controller = Controller::with_tips(model.clone(), left.clone(), more, config).unwrap();
    let state = State::at_rest_with(&model, &degrees(&START));
    let mut floating = Floating::new(model, state, IntegrationMethod::Rk4);
    let mut end = None;
    let (mut most, mut fastest_joint) = (0.0f64, 0.0f64);
    for k in 0..=4000 {
        let time = 0.01 * f64::from(k);
        let X_WB = floating.state().X_WB(floating.workspace());
        let sights = [(&left, &goals[0]), (&right, &goals[1])].map(|(tip, X_WD)| {
            TipMeasurement::new(time, floating.workspace().X_BF(tip), X_WB.inverse() * X_WD)
        });
        let w = floating.workspace().V_WB_B().angular;
        let (q, qd) = (&floating.state().q, &floating.state().qd);
        let others = [Some(sights[1])];
        let seen = Measurement {
            more_tips: &others,
            ..Measurement::new(time, q, qd)
        };
        let seen = seen.with_tip(Some(&sights[0])).with_gyro(Some(&w));
        controller.update(&seen).unwrap();
        let turned = X_WB.rotation.angle();
        most = most.max(turned);
        fastest_joint = fastest_joint.max(qd.amax());
        end = Some(End {
            errors: sights.map(|s| PoseError::between(&s.X_BE, &s.X_BD)),
            turned,
            most,
            fastest_joint,
        });
        floating.hold_efforts(controller.efforts().as_slice());
        floating.step(0.01, 1);
    }
    end.unwrap()
}

fn arrived(error: &PoseError) -> bool {
    error.position.norm() < 1e-3 && error.angle < 1e-3
}

#[test]
fn two_tips_reach_a_goal_each_and_the_base_turns_meanwhile() {
    let end = run([TipTask::Pose; 2], BaseTask::Free);
    assert!(end.errors.iter().all(arrived), "{:?}", end.errors);
    assert!(end.most.to_degrees() > 2.0, "{}", end.most.to_degrees());
    assert!(end.fastest_joint < 1.0, "{}", end.fastest_joint);
}

/// Six degrees of freedom for the tip and three for the base, of fourteen.
#[test]
fn in_the_reaction_null_space_the_base_stands_still() {
    let end = run([TipTask::Pose, TipTask::Free], BaseTask::BeforeTips);
    assert!(arrived(&end.errors[0]), "{:?}", end.errors[0]);
    let most = end.most.to_degrees();
    // The remaining motion is due to sampling.
    assert!(most < 0.02, "{most}");
    assert!(end.fastest_joint < 1.0, "{}", end.fastest_joint);
}

/// The self-motion that compensates the base reaches a limit: the task with the lowest priority is given up, and the joint
/// rates stay bounded.
#[test]
fn tasks_that_cannot_all_be_met_do_not_run_away() {
    let end = run([TipTask::Pose, TipTask::Position], BaseTask::BeforeTips);
    // Without the limit on joint rates they overflow. Sampling exceeds the limit of 1 rad/s slightly.
    assert!(end.fastest_joint < 1.1, "{}", end.fastest_joint);
    assert!(end.most.to_degrees() < 1.0, "{}", end.most.to_degrees());
}

/// An arm without a task compensates the reaction of the other on the base.
#[test]
fn a_free_arm_holds_the_base_for_the_other() {
    let end = run([TipTask::Pose, TipTask::Free], BaseTask::AfterTips);
    assert!(arrived(&end.errors[0]), "{:?}", end.errors[0]);
    let alone = run([TipTask::Pose, TipTask::Free], BaseTask::Free);
    let (held, free) = (end.most.to_degrees(), alone.most.to_degrees());
    assert!(free > 1.0 && held < 0.02, "{held} {free}");
}

/// If the tasks need more degrees of freedom than there are, the first task is fulfilled.
#[test]
fn the_more_important_task_is_served_first() {
    let tips = run([TipTask::Pose; 2], BaseTask::AfterTips);
    // The self-motion that tries to hold the base continues, and disturbs the tips slightly.
    let near = |error: &PoseError| error.position.norm() < 5e-3;
    assert!(tips.errors.iter().all(near), "{:?}", tips.errors);
    let base = run([TipTask::Pose; 2], BaseTask::BeforeTips);
    assert!(base.most.to_degrees() < 1.0, "{}", base.most.to_degrees());
    for run in [&tips, &base] {
        assert!(run.fastest_joint < 1.1, "{}", run.fastest_joint);
    }
    assert!(base.errors[0].position.norm() < 5e-3, "{:?}", base.errors);
    let free = run([TipTask::Pose; 2], BaseTask::Free);
    // Two degrees of freedom are left for the base's three.
    assert!(tips.turned < free.turned, "{} {}", tips.turned, free.turned);
}

/// Compared with the textbook formula for two tasks, with pseudo-inverses weighted by the inertia.
#[test]
fn priorities_agree_with_projectors_made_explicitly() {
    let (model, left, _) = robot();
    let mut workspace = Workspace::new(&model);
    workspace.set_positions(&degrees(&START));
    let inertia = workspace.reduced_inertia().clone();
    let mut J = [Rows::zeros(14), Rows::zeros(14)];
    workspace.generalized_jacobian(&left, &mut J[0]);
    workspace.base_map(&mut J[1]);
    J[1].fixed_rows_mut::<3>(0).fill(0.0);
    let b = [
        Vector6::new(0.1, -0.2, 0.3, 0.4, -0.1, 0.2),
        Vector6::new(0.0, 0.0, 0.0, 0.02, -0.01, 0.03),
    ];
    let mut priority = TaskPriority::new(14, 3);
    priority.damping = 1e-6;
    priority.begin(&inertia);
    priority.add(&J[0], &b[0]);
    priority.add(&J[1], &b[1]);
    let still = DVector::from_fn(14, |j, _| 0.1 * j as f64 - 0.5);
    priority.add_in_null_space(&still);
    let mut efforts = DVector::zeros(14);
    priority.efforts(&mut efforts);

    let inverse = inertia.clone().try_inverse().unwrap();
    let full = |J: &Rows| DMatrix::from_iterator(6, 14, J.iter().copied());
    let second = full(&J[1]).rows(3, 3).into_owned();
    let (J0, J1) = (full(&J[0]), second);
    let lambda = |J: &DMatrix<f64>| (J * &inverse * J.transpose()).try_inverse().unwrap();
    let N0 = DMatrix::identity(14, 14) - J0.transpose() * lambda(&J0) * &J0 * &inverse;
    let J1N = &J1 * &inverse * &N0 * &inertia;
    let first = J0.transpose() * lambda(&J0) * b[0];
    let off = b[1].fixed_rows::<3>(3) - &J1 * &inverse * &first;
    let both = &first + J1N.transpose() * lambda(&J1N) * off;
    let mut all = DMatrix::zeros(9, 14);
    all.rows_mut(0, 6).copy_from(&J0);
    all.rows_mut(6, 3).copy_from(&J1);
    let N = DMatrix::identity(14, 14) - all.transpose() * lambda(&all) * &all * &inverse;
    let expected = both + N * still;
    assert!(
        (&efforts - &expected).amax() < 1e-6 * expected.amax(),
        "{efforts} {expected}"
    );
}
