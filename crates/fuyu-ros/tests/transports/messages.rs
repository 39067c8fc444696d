//! The service of the demos of ROS.

fuyu_ros::services! {
    package example_interfaces;

    /// Adds two numbers.
    service AddTwoInts {
        AddTwoIntsRequest {
            /// First number.
            a: i64,
            /// Second number.
            b: i64,
        }
        AddTwoIntsResponse {
            /// Their sum.
            sum: i64,
        }
    }
}
