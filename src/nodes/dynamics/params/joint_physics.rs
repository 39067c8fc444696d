//! Parameters of friction, stops and speed limits of the joints.

use crate::{dynamics::JointPhysics, ros::Declare};

/// Declares `joint_physics.*` and reads them.
pub(super) fn declare_joint_physics(declare: &mut Declare) -> JointPhysics {
    let usual = JointPhysics::default();
    let mut switch = |name: &str, default: bool, text: &str| {
        let parameter = declare.param(&format!("joint_physics.{name}"), default, text);
        parameter.read_only().value()
    };
    let friction = switch(
        "friction",
        usual.friction,
        "Simulate the Coulomb friction of the joints",
    );
    let stops = switch("stops", usual.stops, "Stop joints at their position limits");
    let velocity_limits = switch(
        "velocity_limits",
        usual.velocity_limits,
        "Brake joints at their velocity limits",
    );
    let restitution = declare
        .param(
            "joint_physics.restitution",
            usual.restitution,
            "Coefficient of restitution of the stops",
        )
        .range(0.0, 1.0)
        .read_only()
        .value();
    JointPhysics {
        friction,
        stops,
        restitution,
        velocity_limits,
    }
}
