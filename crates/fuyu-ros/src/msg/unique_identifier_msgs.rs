//! ROS package [`unique_identifier_msgs`](https://docs.ros.org/en/jazzy/p/unique_identifier_msgs/).

crate::messages! {
    package unique_identifier_msgs;

    /// A universally unique identifier, RFC 4122.
    message UUID {
        /// Its octets.
        uuid: [u8; 16],
    }
}
