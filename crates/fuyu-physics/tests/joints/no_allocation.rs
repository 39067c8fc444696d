//! Steps take no memory.

use allocation_counter::measure;
use fuyu_physics::dynamics::{IntegrationMethod, JointPhysics};

use crate::robots::{arm, moving};

#[test]
fn steps_with_everything_do_not_allocate() {
    let model = arm(|j, joint| {
        joint.friction = [0.3, 0.0, 0.1, 2.0, 0.05, 0.02][j];
        joint.damping = [0.1, 30.0, 0.02, 1000.0, 0.0, 0.3][j];
        (joint.limits.lower, joint.limits.upper) = (-1.2, 0.9);
        joint.limits.velocity = 0.6;
    });
    let settings = JointPhysics {
        restitution: 0.4,
        ..JointPhysics::default()
    };
    for method in [IntegrationMethod::Rk4, IntegrationMethod::Dop8] {
        let robot = fuyu_physics::dynamics::Floating::new(model.clone(), moving(&model), method);
        let mut robot = robot.with_joint_physics(&settings);
        robot.hold_efforts(&[2.0, -9.0, 1.0, 30.0, -0.5, 0.1]);
        let used = measure(|| {
            for _ in 0..100 {
                robot.step(0.01, 1);
                robot.accelerations();
            }
        });
        assert_eq!(used.count_total, 0, "{method:?}: {used:?}");
        // Something was there to allocate for.
        let lost = robot.state().dissipated;
        assert!(lost.stops > 0.0 && lost.velocity_limits > 0.0 && lost.friction > 0.0);
    }
}
