//! ROS package [`rosgraph_msgs`](https://docs.ros.org/en/jazzy/p/rosgraph_msgs/).

use super::builtin_interfaces::Time;

crate::messages! {
    package rosgraph_msgs;

    /// Simulated time, published on `/clock`.
    message Clock {
        /// Current time.
        clock: Time,
    }
}
