//! The ROS 2 nodes: physics joined to topics, services and parameters.
