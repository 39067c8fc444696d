//! ROS package [`nav_msgs`](https://docs.ros.org/en/jazzy/p/nav_msgs/).

use super::geometry_msgs::{PoseStamped, PoseWithCovariance, TwistWithCovariance};
use super::std_msgs::Header;

crate::messages! {
    package nav_msgs;

    /// Pose of a body in `header.frame_id`, and its twist in its own frame `child_frame_id`.
    message Odometry {
        /// Time; the frame of the pose.
        header: Header,
        /// The body's frame, in which the twist is expressed.
        child_frame_id: String,
        /// Pose of the body.
        pose: PoseWithCovariance,
        /// Velocity of the body's frame.
        twist: TwistWithCovariance,
    }

    /// Poses along a path.
    message Path {
        /// Time; the frame of the path.
        header: Header,
        /// The poses, in order.
        poses: Vec<PoseStamped>,
    }
}
