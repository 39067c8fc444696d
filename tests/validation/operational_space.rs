//! The equations of the operational-space law, term by term.

use fuyu::control::prediction::{Prediction, TipPrediction};
use fuyu::control::{
    Controller, ControllerConfig, FeedForward, Gains, Measurement, MovingGoal,
    OperationalSpaceConfig, PoseError, Saturation, TipMeasurement,
};
use fuyu::dynamics::{Floating, IntegrationMethod, State, Workspace};
use fuyu::spatial::{Pose, Twist};
use nalgebra::{DVector, Matrix6xX, Translation3, UnitQuaternion, Vector3};

use crate::fixtures::{degrees, servicer};

const K_V: [f64; 6] = [400.0, 100.0, 200.0, 10.0, 2.0, 2.0];

fn gains() -> Gains {
    Gains {
        k_p: 75.0,
        k_o: 100.0,
        k_v: K_V.to_vec(),
        saturation: Saturation::NONE,
    }
}

/// A moving servicer with linear and angular momentum.
fn moving() -> Floating {
    let model = servicer();
    let mut state = State::at_rest_with(&model, &degrees(&[80.0, 90.0, -90.0, 10.0, 30.0, 20.0]));
    state.qd = DVector::from_row_slice(&[0.05, -0.04, 0.06, 0.1, -0.08, 0.12]);
    let drift = Twist::new(
        Vector3::new(0.01, -0.02, 0.015),
        Vector3::new(0.01, 0.0, -0.02),
    );
    let mut workspace = Workspace::new(&model);
    state.set_base(&mut workspace, &nalgebra::Isometry3::identity(), &drift);
    Floating::new(model, state, IntegrationMethod::Rk4)
}

/// The closed loop of the operational-space law is `a = A_D + 2ζω ė + ω² e`, independently of Coriolis terms and momentum.
#[test]
fn resolved_acceleration_gives_the_tip_the_acceleration_that_it_asks_for() {
    let mut robot = moving();
    let model = robot.model().clone();
    let tip = model.frame("tool0").unwrap().clone();
    let law = OperationalSpaceConfig {
        task_damping: 1e-3,
        ..OperationalSpaceConfig::default()
    };
    let config = ControllerConfig::new(law, gains());
    let mut controller = Controller::new(model.clone(), tip.clone(), config).unwrap();
    let X_BE = robot.workspace().X_BF(&tip);
    let X_BD = Pose::from_parts(
        Translation3::new(0.1, -0.05, 0.07) * X_BE.translation,
        nalgebra::Rotation3::from_euler_angles(0.05, -0.1, 0.08) * X_BE.rotation,
    );
    let sight = TipMeasurement::new(0.0, X_BE, X_BD);
    let w = robot.workspace().V_WB_B().angular;
    let (q, qd) = (robot.state().q.clone(), robot.state().qd.clone());
    let seen = Measurement::new(0.0, &q, &qd)
        .with_tip(Some(&sight))
        .with_gyro(Some(&w));
    controller.update(&seen).unwrap();
    robot.hold_efforts(controller.efforts().as_slice());
    robot.accelerations();
    let error = PoseError::between(&X_BE, &X_BD);
    // The tip's velocity relative to the centre of mass, whose velocity is constant.
    let X_WB = robot.state().X_WB(robot.workspace());
    let v_WC_B = X_WB.rotation.inverse() * robot.state().momentum_W.linear / model.total_mass();
    let V = robot.workspace().V_WF_B(&tip);
    let A = robot.workspace().A_WF_B(&tip);
    let linear = error.position - (V.linear - v_WC_B) * 2.0;
    let angular = error.orientation - V.angular * 2.0;
    assert!(
        (A.linear - linear).norm() < 1e-9 * linear.norm(),
        "{} {linear}",
        A.linear
    );
    assert!(
        (A.angular - angular).norm() < 1e-9 * angular.norm(),
        "{} {angular}",
        A.angular
    );
}

/// With the tip at the goal and `q̇ = q̇_D`, tip and goal stay together: the tip has the acceleration of the goal, with momentum
/// and Coriolis terms included. A wrong term of the feed-forward makes this fail.
#[test]
fn what_is_fed_forward_moves_the_tip_with_the_goal() {
    let mut robot = moving();
    let model = robot.model().clone();
    let tip = model.frame("tool0").unwrap().clone();
    let V_WC = robot.state().momentum_W.linear / model.total_mass();
    let tip_in_I = |robot: &Floating| {
        let V = robot.workspace().V_WF_B(&tip);
        let R_WB = robot.state().R_WB;
        Twist::new(V.angular, V.linear - R_WB.inverse() * V_WC)
    };
    // A goal with the present velocity of the tip, but a different acceleration.
    let V_ID_B = tip_in_I(&robot);
    let A_ID_B = Twist::new(
        Vector3::new(0.01, -0.03, 0.02),
        Vector3::new(0.02, 0.01, -0.03),
    );
    let mut feed_forward = FeedForward::new(&model, &tip);
    feed_forward.damping = 1e-9;
    let w = robot.workspace().V_WB_B().angular;
    let (q, qd) = (robot.state().q.clone(), robot.state().qd.clone());
    let goal = MovingGoal {
        q: &q,
        qd: &qd,
        w_IB_B: &w,
        V_ID_B: &V_ID_B,
        A_ID_B: &A_ID_B,
    };
    let mut efforts = DVector::zeros(6);
    feed_forward.update(robot.workspace(), &goal);
    feed_forward.add(robot.workspace(), &goal, &K_V, 1.0, &mut efforts);
    assert!(
        (feed_forward.rates() - &qd).amax() < 1e-10,
        "the rates are those of the goal"
    );
    for j in 0..6 {
        efforts[j] -= K_V[j] * qd[j];
    }
    robot.hold_efforts(efforts.as_slice());
    robot.accelerations();
    let A = robot.workspace().A_WF_B(&tip);
    // The finite difference over a microsecond has an error of some 1e-6.
    assert!((A.linear - A_ID_B.linear).norm() < 1e-5, "{}", A.linear);
    assert!((A.angular - A_ID_B.angular).norm() < 1e-5, "{}", A.angular);
}

/// `½ sᵀ Ĥ s + U` decreases at the rate `sᵀ K_V s` in the closed loop, for a goal that moves and a robot with momentum.
#[test]
fn the_lyapunov_function_falls_at_the_rate_that_the_proof_says() {
    let mut robot = moving();
    let model = robot.model().clone();
    let tip = model.frame("tool0").unwrap().clone();
    let gains = gains();
    let mut feed_forward = FeedForward::new(&model, &tip);
    feed_forward.damping = 1e-9;
    let start = robot.state().X_WB(robot.workspace()) * robot.workspace().X_BF(&tip);
    // The goal in the world: it starts next to the tip, drifts, and rotates at a constant rate.
    let (v_W, w_W) = (
        Vector3::new(0.03, -0.02, 0.04),
        Vector3::new(0.02, 0.03, -0.04),
    );
    let v_WC = robot.state().momentum_W.linear / model.total_mass();
    let X_WD = |t: f64| {
        let turn = UnitQuaternion::from_scaled_axis(w_W * t).to_rotation_matrix();
        let p = start.translation.vector + Vector3::new(0.1, 0.05, -0.08) + v_W * t;
        Pose::from_parts(
            p.into(),
            turn * nalgebra::Rotation3::from_euler_angles(0.1, 0.2, -0.1) * start.rotation,
        )
    };
    let mut J = Matrix6xX::zeros(6);
    let mut scratch = Workspace::new(&model);
    let dt = 1e-5;
    let mut before: Option<(f64, f64)> = None;
    for k in 0..400 {
        let t = dt * f64::from(k);
        let X_WB = robot.state().X_WB(robot.workspace());
        let (q, qd) = (robot.state().q.clone(), robot.state().qd.clone());
        let X_BE = robot.workspace().X_BF(&tip);
        let error = PoseError::between(&X_BE, &(X_WB.inverse() * X_WD(t)));
        let V_ID_B = Twist::new(
            X_WB.rotation.inverse() * w_W,
            X_WB.rotation.inverse() * (v_W - v_WC),
        );
        let w = robot.workspace().V_WB_B().angular;
        let goal = MovingGoal {
            q: &q,
            qd: &qd,
            w_IB_B: &w,
            V_ID_B: &V_ID_B,
            A_ID_B: &Twist::ZERO,
        };
        scratch.set_positions(&q);
        scratch.generalized_jacobian(&tip, &mut J);
        let (force, torque) = (error.position * gains.k_p, error.orientation * gains.k_o);
        let mut efforts =
            J.fixed_rows::<3>(0).tr_mul(&force) + J.fixed_rows::<3>(3).tr_mul(&torque);
        feed_forward.update(&scratch, &goal);
        feed_forward.add(&scratch, &goal, &K_V, 1.0, &mut efforts);
        for j in 0..6 {
            efforts[j] -= K_V[j] * qd[j];
        }
        robot.hold_efforts(efforts.as_slice());
        let s = &qd - feed_forward.rates();
        let energy = 0.5 * s.dot(&(scratch.reduced_inertia() * &s))
            + gains.saturation.potential(&error, gains.k_p, gains.k_o);
        let rate: f64 = (0..6).map(|j| K_V[j] * s[j] * s[j]).sum();
        if let Some((last, last_rate)) = before {
            let fallen = (last - energy) / dt;
            let said = 0.5 * (rate + last_rate);
            // Efforts are constant for 10 us, an error of first order: 10 us times the fastest rate of the wrist, 100 1/s.
            assert!((fallen / said - 1.0).abs() < 5e-3, "{fallen} {said} at {t}");
        }
        before = Some((energy, rate));
        robot.step(dt, 1);
    }
}

/// For a goal at rest and zero momentum the feed-forward is zero: the law is that of the thesis.
#[test]
fn nothing_is_fed_forward_to_a_goal_at_rest() {
    let model = servicer();
    let tip = model.frame("tool0").unwrap().clone();
    let q = degrees(&[80.0, 90.0, -90.0, 10.0, 30.0, 20.0]);
    let qd = DVector::from_row_slice(&[0.05, -0.04, 0.06, 0.1, -0.08, 0.12]);
    let mut workspace = Workspace::new(&model);
    workspace.set_positions(&q);
    let w = workspace
        .base_twist(&fuyu::dynamics::Momentum::default(), &qd)
        .angular;
    let at_rest = TipPrediction::at_rest(Pose::identity(), Pose::identity());
    let goal = MovingGoal {
        q: &q,
        qd: &qd,
        w_IB_B: &w,
        V_ID_B: &at_rest.V_ID_B,
        A_ID_B: &at_rest.A_ID_B,
    };
    let mut efforts = DVector::zeros(6);
    let mut feed_forward = FeedForward::new(&model, &tip);
    feed_forward.update(&workspace, &goal);
    feed_forward.add(&workspace, &goal, &K_V, 1.0, &mut efforts);
    assert!(efforts.amax() < 1e-9, "{efforts}");
    assert_eq!(Prediction::default(), Prediction::None);
}
