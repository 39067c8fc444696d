//! Robots without damping, friction and limits move as ever.

use fuyu_physics::dynamics::{Dissipated, Floating, IntegrationMethod, JointPhysics};

use crate::robots::{arm, moving};

/// Limits that are not reached change no bit, and neither do settings for joints that have nothing to simulate.
#[test]
fn limits_that_are_not_reached_change_nothing() {
    let free = arm(|_, _| {});
    let limited = arm(|_, joint| {
        (joint.limits.lower, joint.limits.upper) = (-20.0, 20.0);
        joint.limits.velocity = 50.0;
    });
    for method in [IntegrationMethod::Dop8, IntegrationMethod::Rk4] {
        let run = |model, settings: &JointPhysics| {
            let robot = Floating::new(model, moving(&free), method);
            let mut robot = robot.with_joint_physics(settings);
            robot.hold_efforts(&[0.5, -0.4, 0.3, 2.0, -0.1, 0.05]);
            robot.step(0.01, 100);
            robot.state().clone()
        };
        let expected = run(free.clone(), &JointPhysics::DAMPING_ONLY);
        assert_eq!(run(free.clone(), &JointPhysics::default()), expected);
        assert_eq!(run(limited.clone(), &JointPhysics::default()), expected);
        assert_eq!(expected.dissipated, Dissipated::default());
    }
}
