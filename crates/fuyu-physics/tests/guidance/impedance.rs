//! The tip's impedance on the simulated robot, and its effective mass in an impact.

use fuyu_physics::control::capture::{FrameMotion, TipImpedance, TipLaw, inertial_state};
use fuyu_physics::dynamics::capture::{Captured, Grasp, JointReaction, Latch};
use fuyu_physics::dynamics::{Floating, State, Workspace};
use fuyu_physics::model::{Frame, ModelBuilder};
use fuyu_physics::spatial::{Pose, RigidInertia, Twist};
use nalgebra::{Matrix3, Vector3};

use crate::world::{METHOD, posture, servicer};

// A step of the goal is answered by (1 + ωt) exp(-ωt), whatever the posture; the base is free.
#[test]
fn the_tip_moves_as_a_critically_damped_mass() {
    let (model, tip, _) = servicer();
    let frequency = 2.0;
    let law = TipLaw::Impedance {
        frequency,
        damping: 1.0,
    };
    let mut impedance = TipImpedance::new(&model, &tip, law);
    let mut robot = Floating::new(
        model.clone(),
        State::at_rest_with(&model, &posture()),
        METHOD,
    );
    let mut workspace = Workspace::new(&model);
    let state = |robot: &Floating, workspace: &mut Workspace| {
        let w = robot.workspace().V_WB_B().angular;
        let own = robot.state();
        inertial_state(workspace, own.time, (own.R_WB, &w), (&own.q, &own.qd))
    };
    let X_WE = robot.state().X_WB(robot.workspace()) * robot.workspace().X_BF(&tip);
    let in_I = X_WE.translation.vector - robot.state().p_WC;
    let step = Vector3::new(0.03, -0.05, 0.04);
    let goal = FrameMotion {
        X: Pose::from_parts((in_I + step).into(), X_WE.rotation),
        V: Twist::default(),
        A: Twist::default(),
    };
    for k in 0..3000 {
        let t = 1e-3 * f64::from(k);
        let now = state(&robot, &mut workspace);
        let (efforts, off) = impedance.efforts(&now, &goal);
        let left = (1.0 + frequency * t) * (-frequency * t).exp();
        let error = (off.position_error - step * left).norm() / step.norm();
        // The hold over a period delays the answer by half of it.
        assert!(error < 2e-3, "{t}: {error}");
        let efforts = efforts.as_slice().to_vec();
        robot.hold_efforts(&efforts);
        robot.step(1e-3, 1);
    }
}

// The impulse that stops a small ball of mass m at the tip: with the tip's effective mass M, the relative velocity v
// becomes zero by the impulse v m M / (m + M). By the latch, which solves the impulse equations of both bodies.
#[test]
fn effective_mass_predicts_the_impulse_of_a_ball() {
    let (model, tip, _) = servicer();
    let law = TipLaw::Impedance {
        frequency: 1.0,
        damping: 1.0,
    };
    let mut impedance = TipImpedance::new(&model, &tip, law);
    let robot = Floating::new(
        model.clone(),
        State::at_rest_with(&model, &posture()),
        METHOD,
    );
    let X_WE = robot.state().X_WB(robot.workspace()) * robot.workspace().X_BF(&tip);
    for direction in [Vector3::x(), Vector3::y(), Vector3::new(1.0, -2.0, 0.5)] {
        let mass = impedance.effective_mass(&posture(), &direction);
        // A ball joint passes force only; a tiny ball that is heavy for its size turns freely.
        let m = 1e-4;
        let ball = RigidInertia {
            mass: m,
            com: Vector3::zeros(),
            about_com: Matrix3::identity() * 1e-9,
        };
        let ball = ModelBuilder::new("ball", "ball", ball).build();
        let mut state = State::at_rest(&ball);
        state.p_WC = X_WE.translation.vector;
        let v = direction.normalize() * 0.1;
        state.momentum_W.linear = v * m;
        let frame = Frame {
            name: "ball".to_owned(),
            body: 0,
            parent: None,
            X_BF: Pose::identity(),
        };
        let grasp = Grasp {
            robot: tip.clone(),
            target: frame,
            latch: Latch::Ball,
            joints: JointReaction::Free,
        };
        let target = Floating::new(ball, state, METHOD);
        let (held, impulse) = Captured::new(&robot, &target, &grasp, METHOD).unwrap();
        let _ = held;
        // The tip takes the velocity m / (m + M) v along the direction to first order in m / M.
        let mut of_robot = robot.clone();
        of_robot.set_state(impulse.states[0].clone());
        let V = of_robot.workspace().V_WF_B(&tip).linear;
        let along = direction.normalize();
        let taken = V.dot(&along) / 0.1;
        let expected = m / (m + mass);
        assert!(
            (taken - expected).abs() < 1e-3 * expected,
            "{taken} {expected} {mass}"
        );
    }
}
