//! Coulomb friction: sliding, rest, slip.

use fuyu_physics::dynamics::{Input, IntegrationMethod, Integrator, State, Workspace};
use nalgebra::DVector;

use crate::robots::{
    arm, coaxial, coaxial_inertia, energy, energy_error, floating, momentum_error, moving,
};

/// A link that coasts is stopped by `F` at `t = Ĥ v / F` after the angle `Ĥ v² / 2F`, and stays there. Would break if the stop
/// were found only at the end of a step, or if friction acted as `F tanh(q̇/v)`.
#[test]
fn a_coasting_link_stops_at_the_closed_form_s_time_and_angle() {
    let moments = [4.0, 0.5];
    let (friction, rate) = (0.37, 0.9);
    let inertia = coaxial_inertia(&moments)[(0, 0)];
    let (time, angle) = (
        inertia * rate / friction,
        0.5 * inertia * rate * rate / friction,
    );
    let model = coaxial(&moments, |_, joint| joint.friction = friction);
    let mut state = State::at_rest(&model);
    state.qd[0] = rate;
    let mut robot = floating(&model, state);
    let before = energy(&robot);
    let steps = (time / 0.01).floor() as usize;
    robot.step(0.01, steps);
    let left = rate - friction / inertia * 0.01 * steps as f64;
    assert!((robot.state().qd[0] - left).abs() < 1e-13);
    robot.step(0.01, 1);
    assert_eq!(robot.state().qd[0], 0.0);
    assert!(
        (robot.state().q[0] - angle).abs() < 1e-13,
        "{}",
        robot.state().q[0] - angle
    );
    let rest = robot.state().q[0];
    robot.step(0.01, 1000);
    assert_eq!((robot.state().q[0], robot.state().qd[0]), (rest, 0.0));
    let lost = robot.state().dissipated;
    assert!((lost.friction - 0.5 * inertia * rate * rate).abs() < 1e-14);
    assert_eq!(lost.total(), lost.friction);
    assert!(energy_error(&robot, before) < 1e-13 && momentum_error(&robot) < 1e-14);
}

/// With viscous damping too: `Ĥ q̈ = -F - c q̇` stops at `t = Ĥ/c ln(1 + c v / F)`.
#[test]
fn with_damping_it_stops_earlier() {
    let moments = [4.0, 0.5];
    let (friction, c, rate) = (0.37, 2.0, 0.9);
    let inertia = coaxial_inertia(&moments)[(0, 0)];
    let time = inertia / c * (c * rate / friction).ln_1p();
    let angle = inertia * rate / c - friction / c * time;
    let model = coaxial(&moments, |_, joint| {
        (joint.friction, joint.damping) = (friction, c)
    });
    let mut state = State::at_rest(&model);
    state.qd[0] = rate;
    let mut robot = floating(&model, state);
    let before = energy(&robot);
    robot.step(0.01, (time / 0.01).ceil() as usize);
    assert_eq!(robot.state().qd[0], 0.0);
    assert!(
        (robot.state().q[0] - angle).abs() < 1e-13,
        "{:e}",
        robot.state().q[0] - angle
    );
    assert!(energy_error(&robot, before) < 1e-13);
}

/// Efforts below the friction move nothing, by not one bit; above it the link accelerates with the difference, from the
/// time at which a growing effort exceeds the friction.
#[test]
fn below_the_limit_nothing_creeps_and_above_it_the_joint_slips() {
    let moments = [4.0, 0.5];
    let friction = 0.37;
    let inertia = coaxial_inertia(&moments)[(0, 0)];
    let model = coaxial(&moments, |_, joint| joint.friction = friction);
    for sign in [1.0, -1.0] {
        let mut robot = floating(&model, State::at_rest(&model));
        robot.hold_efforts(&[sign * friction * (1.0 - 1e-9)]);
        robot.step(0.01, 100_000);
        assert_eq!((robot.state().q[0], robot.state().qd[0]), (0.0, 0.0));
        robot.hold_efforts(&[sign * 0.5]);
        robot.step(0.01, 100);
        let a = sign * (0.5 - friction) / inertia;
        assert!((robot.state().q[0] - 0.5 * a).abs() < 1e-13);
        assert!((robot.state().qd[0] - a).abs() < 1e-13);
    }
    // An effort that grows with time, evaluated at the stages: slip begins at 0.37 s.
    let (mut state, mut workspace) = (State::at_rest(&model), Workspace::new(&model));
    let mut integrator = Integrator::new(&model, IntegrationMethod::Dop8);
    let mut ramp = |time: f64, _: &State, input: &mut Input| input.efforts[0] = time;
    integrator.steps(&mut state, &mut workspace, 0.01, 37, &mut ramp);
    assert_eq!(state.qd[0], 0.0);
    integrator.steps(&mut state, &mut workspace, 0.011, 50, &mut ramp);
    let since = state.time - friction;
    let (q, qd) = (
        since.powi(3) / (6.0 * inertia),
        since.powi(2) / (2.0 * inertia),
    );
    assert!((state.q[0] - q).abs() < 1e-10 && (state.qd[0] - qd).abs() < 1e-10);
}

/// The joint that rests is held by a reaction, so the others move as if it were welded; when they accelerate too much, it slips.
#[test]
fn a_joint_that_rests_is_a_weld_to_the_others() {
    let moments = [4.0, 0.5, 0.2];
    let model = coaxial(&moments, |j, joint| joint.friction = [0.0, 0.1][j]);
    let welded = coaxial(&[4.0, 0.7], |_, _| {});
    let effort = 0.3;
    // The second link follows with the first's acceleration by at most F = 0.1 N m: 0.2 a < 0.1 here.
    let mut robot = floating(&model, State::at_rest(&model));
    let mut one = floating(&welded, State::at_rest(&welded));
    robot.hold_efforts(&[effort, 0.0]);
    one.hold_efforts(&[effort]);
    robot.step(0.01, 100);
    one.step(0.01, 100);
    assert_eq!(robot.state().q[1], 0.0);
    assert!((robot.state().q[0] - one.state().q[0]).abs() < 1e-13);
    // Accelerations at an instant know it as well.
    assert!((robot.accelerations()[0] - one.accelerations()[0]).abs() < 1e-13);
    // With eight times the effort it slips, and lags behind.
    robot.hold_efforts(&[8.0 * effort, 0.0]);
    robot.step(0.01, 20);
    assert!(robot.state().qd[1] < -0.1);
    // Newton's law of the second link alone: it is driven by 0.1 N m in the world.
    let total = 4.0 + 0.5 + 0.2;
    let base = -(0.7 * robot.accelerations()[0] + 0.2 * robot.accelerations()[1]) / total;
    let second = base + robot.accelerations()[0] + robot.accelerations()[1];
    assert!((0.2 * second - 0.1).abs() < 1e-13);
}

/// An arm in three dimensions whose joints stop and slip one after the other.
#[test]
fn an_arm_with_friction_comes_to_rest_and_balances() {
    let model = arm(|j, joint| {
        joint.friction = [0.3, 0.2, 0.1, 2.0, 0.05, 0.02][j];
        joint.damping = [0.1, 0.0, 0.02, 1.0, 0.0, 0.01][j];
    });
    let mut state = moving(&model);
    // A base that turned would keep the arm moving.
    state.momentum_W.angular *= 0.0;
    let mut robot = floating(&model, state);
    let before = energy(&robot);
    robot.step(0.01, 3000);
    let error = energy_error(&robot, before);
    println!("energy {error:.1e}, {:?}", robot.state().dissipated);
    assert!(error < 1e-9 && momentum_error(&robot) < 1e-14, "{error:e}");
    assert_eq!(robot.state().qd, DVector::zeros(6));
    assert!(robot.state().dissipated.friction > 0.1);
}
