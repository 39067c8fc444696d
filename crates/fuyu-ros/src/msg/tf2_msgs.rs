//! ROS package [`tf2_msgs`](https://docs.ros.org/en/jazzy/p/tf2_msgs/).

use super::geometry_msgs::TransformStamped;

crate::messages! {
    package tf2_msgs;

    /// Transforms, as `/tf` and `/tf_static` carry them.
    message TFMessage {
        /// The transforms.
        transforms: Vec<TransformStamped>,
    }
}
