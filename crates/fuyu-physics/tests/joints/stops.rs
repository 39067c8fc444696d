//! Stops at position limits, and limits of speed and effort.

use fuyu_physics::dynamics::{JointPhysics, State};
use nalgebra::DVector;

use crate::robots::{
    arm, coaxial, coaxial_inertia, energy, energy_error, floating, momentum_error, moving,
};

/// A link that coasts to its stop is thrown back with `-e v` at the time when it gets there, and the impact takes
/// `½ (1 - e²) Ĥ v²`. Would break if the stop acted at the end of a step only, or changed momentum.
#[test]
fn a_coasting_link_is_thrown_back_with_the_restitution() {
    let moments = [4.0, 0.5];
    let inertia = coaxial_inertia(&moments)[(0, 0)];
    for restitution in [0.0, 0.35, 1.0] {
        let model = coaxial(&moments, |_, joint| {
            (joint.limits.lower, joint.limits.upper) = (-1.0, 0.7123);
        });
        let settings = JointPhysics {
            restitution,
            ..JointPhysics::default()
        };
        let mut state = State::at_rest(&model);
        state.qd[0] = 0.9;
        let mut robot = floating(&model, state).with_joint_physics(&settings);
        let before = energy(&robot);
        robot.step(0.01, 100);
        let rebound = -restitution * 0.9;
        let position = 0.7123 + rebound * (1.0 - 0.7123 / 0.9);
        let state = robot.state();
        assert!(
            (state.qd[0] - rebound).abs() < 1e-14,
            "{restitution}: {}",
            state.qd[0]
        );
        assert!(
            (state.q[0] - position).abs() < 1e-13,
            "{restitution}: {}",
            state.q[0]
        );
        let lost = 0.5 * (1.0 - restitution * restitution) * inertia * 0.81;
        assert!((state.dissipated.stops - lost).abs() < 1e-14);
        assert!(energy_error(&robot, before) < 1e-13 && momentum_error(&robot) < 1e-14);
    }
}

/// An effort presses the link onto its stop: it bounces, rests there without creep, and leaves when the effort turns.
#[test]
fn a_link_rests_at_its_stop_and_leaves_it() {
    let moments = [4.0, 0.5];
    let inertia = coaxial_inertia(&moments)[(0, 0)];
    let model = coaxial(&moments, |_, joint| joint.limits.upper = 0.1);
    let settings = JointPhysics {
        restitution: 0.5,
        ..JointPhysics::default()
    };
    let mut robot = floating(&model, State::at_rest(&model)).with_joint_physics(&settings);
    let before = energy(&robot);
    robot.hold_efforts(&[0.4]);
    let mut highest = 0.0_f64;
    for _ in 0..300 {
        robot.step(0.01, 1);
        highest = highest.max(robot.state().q[0]);
    }
    // No penetration.
    assert_eq!(highest, 0.1);
    assert_eq!((robot.state().q[0], robot.state().qd[0]), (0.1, 0.0));
    assert!(robot.accelerations()[0].abs() < 1e-14);
    // All that the effort has done is lost.
    assert!((robot.state().dissipated.stops - 0.04).abs() < 1e-13);
    robot.hold_efforts(&[-0.4]);
    robot.step(0.01, 10);
    let a = -0.4 / inertia;
    assert!((robot.state().q[0] - (0.1 + 0.5 * a * 0.01)).abs() < 1e-13);
    assert!(energy_error(&robot, before) < 1e-12);
}

/// The impulse of a stop moves the other joints as the reduced inertia demands: against the conservation of what no force acts
/// on, the angular momentum of the last link and that of everything.
#[test]
fn an_impact_moves_the_other_joints() {
    let moments = [4.0, 0.5, 0.2];
    let model = coaxial(&moments, |j, joint| {
        if j == 0 {
            joint.limits.upper = 0.05;
        }
    });
    let mut state = State::at_rest(&model);
    state.qd = DVector::from_vec(vec![0.8, 0.1]);
    let rates = |qd: &DVector<f64>| {
        let base = -(0.7 * qd[0] + 0.2 * qd[1]) / 4.7;
        [base, base + qd[0], base + qd[0] + qd[1]]
    };
    let before = rates(&state.qd);
    let mut robot = floating(&model, state);
    robot.step(0.01, 10);
    let after = rates(&robot.state().qd);
    // The stop is between base and first link; the second turns on.
    assert!((after[2] - before[2]).abs() < 1e-14);
    assert!((after[0] - after[1]).abs() < 1e-14);
    let total = |w: [f64; 3]| 4.0 * w[0] + 0.5 * w[1] + 0.2 * w[2];
    assert!(total(after).abs() < 1e-14);
}

/// A start outside the limits is no impact: the joint may move inwards only.
#[test]
fn a_joint_beyond_its_limit_may_return() {
    let model = coaxial(&[4.0, 0.5], |_, joint| joint.limits.upper = -0.5);
    let mut robot = floating(&model, State::at_rest(&model));
    robot.hold_efforts(&[0.1]);
    robot.step(0.01, 10);
    assert_eq!((robot.state().q[0], robot.state().qd[0]), (0.0, 0.0));
    robot.hold_efforts(&[-0.1]);
    robot.step(0.01, 400);
    assert!(robot.state().q[0] < -0.5);
    robot.hold_efforts(&[10.0]);
    robot.step(0.01, 200);
    assert_eq!(robot.state().q[0], -0.5);
}

/// A joint accelerates to its speed limit within a step, keeps it, and brakes freely. The drive's braking takes the effort's power.
#[test]
fn a_joint_keeps_its_speed_limit() {
    let moments = [4.0, 0.5];
    let inertia = coaxial_inertia(&moments)[(0, 0)];
    let (effort, speed) = (0.8, 0.3);
    let model = coaxial(&moments, |_, joint| {
        (joint.limits.velocity, joint.limits.effort) = (speed, effort);
    });
    let mut robot = floating(&model, State::at_rest(&model));
    let before = energy(&robot);
    assert!(robot.hold_efforts(&[5.0]), "cut to the effort limit");
    robot.step(0.01, 100);
    let state = robot.state();
    let reached = inertia * speed / effort;
    let position = 0.5 * speed * reached + speed * (1.0 - reached);
    assert_eq!(state.qd[0], speed);
    assert!(
        (state.q[0] - position).abs() < 1e-13,
        "{:e}",
        state.q[0] - position
    );
    assert!((state.dissipated.velocity_limits - effort * speed * (1.0 - reached)).abs() < 1e-13);
    assert!(energy_error(&robot, before) < 1e-13);
    robot.hold_efforts(&[-effort]);
    robot.step(0.01, 1);
    assert!((robot.state().qd[0] - (speed - effort / inertia * 0.01)).abs() < 1e-14);
    // A start above the limit is braked at once.
    let mut state = State::at_rest(&model);
    state.qd[0] = -2.0;
    let mut robot = floating(&model, state);
    robot.step(0.01, 1);
    assert_eq!(robot.state().qd[0], -speed);
    let lost = 0.5 * inertia * (4.0 - speed * speed);
    assert!((robot.state().dissipated.velocity_limits - lost).abs() < 1e-13);
}

/// All causes together on an arm in three dimensions, at 10 ms: momentum and the energy balance.
#[test]
fn an_arm_with_everything_balances() {
    for restitution in [0.0, 0.4, 1.0] {
        let model = arm(|j, joint| {
            joint.friction = [0.3, 0.0, 0.1, 2.0, 0.05, 0.02][j];
            joint.damping = [0.1, 30.0, 0.02, 1000.0, 0.0, 0.3][j];
            (joint.limits.lower, joint.limits.upper) = (-1.0, 0.9);
            joint.limits.velocity = 0.6;
        });
        let settings = JointPhysics {
            restitution,
            ..JointPhysics::default()
        };
        let mut robot = floating(&model, moving(&model)).with_joint_physics(&settings);
        let before = energy(&robot);
        let (mut energy_worst, mut momentum_worst) = (0.0_f64, 0.0_f64);
        for k in 0..600 {
            let efforts = [2.0, -9.0, 1.0, 30.0, -0.5, 0.1];
            let sign = if (k / 150) % 2 == 0 { 1.0 } else { -1.0 };
            robot.hold_efforts(&efforts.map(|effort| sign * effort));
            robot.step(0.01, 1);
            let state = robot.state();
            for j in 0..6 {
                assert!(state.q[j] <= 0.9_f64.max(0.3 * j as f64 - 0.8));
                assert!(
                    state.q[j] >= -1.0 && state.qd[j].abs() <= 0.6,
                    "{j} {state:?}"
                );
            }
            energy_worst = energy_worst.max(energy_error(&robot, before));
            momentum_worst = momentum_worst.max(momentum_error(&robot));
        }
        let lost = robot.state().dissipated;
        println!(
            "e {restitution}: energy {energy_worst:.1e} momentum {momentum_worst:.1e} {lost:?}"
        );
        assert!(
            energy_worst < 1e-9 && momentum_worst < 1e-14,
            "{energy_worst:e} {momentum_worst:e}"
        );
        assert!(lost.damping > 0.1 && lost.friction > 0.1 && lost.velocity_limits > 0.01);
        assert!(restitution == 1.0 || lost.stops > 1e-4);
    }
}
