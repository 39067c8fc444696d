//! ROS package [`std_srvs`](https://docs.ros.org/en/jazzy/p/std_srvs/).

crate::services! {
    package std_srvs;

    /// Something is to be done that needs no answer.
    service Empty {
        EmptyRequest {
            /// ROS sends one octet for an empty message.
            structure_needs_at_least_one_member: u8,
        }
        EmptyResponse {
            /// ROS sends one octet for an empty message.
            structure_needs_at_least_one_member: u8,
        }
    }

    /// Something is to be switched on or off.
    service SetBool {
        SetBoolRequest {
            /// On.
            data: bool,
        }
        SetBoolResponse {
            /// It was switched.
            success: bool,
            /// Why not.
            message: String,
        }
    }

    /// Something is to be done.
    service Trigger {
        TriggerRequest {
            /// ROS sends one octet for an empty message.
            structure_needs_at_least_one_member: u8,
        }
        TriggerResponse {
            /// It was done.
            success: bool,
            /// Why not.
            message: String,
        }
    }
}
