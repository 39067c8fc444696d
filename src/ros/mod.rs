//! The ROS layer: context, arguments, parameters, clock, QoS. It knows no physics.
