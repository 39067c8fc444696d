//! ROS package [`rosgraph_msgs`](https://docs.ros.org/en/jazzy/p/rosgraph_msgs/).

use super::builtin_interfaces::Time;

crate::messages! {
    package rosgraph_msgs;

    /// Simulated time, as `/clock` carries it.
    message Clock {
        /// The time now.
        clock: Time,
    }
}
