//! ROS package [`rosbag2_interfaces`](https://docs.ros.org/en/jazzy/p/rosbag2_interfaces/), as of Jazzy:
//! the services that control a recorder.

crate::services! {
    package rosbag2_interfaces;

    /// A recording is to begin.
    service Record {
        RecordRequest {
            /// Folder of the bag; empty is the one that the recorder was started with.
            uri: String,
        }
        RecordResponse {
            /// 0 if it has begun.
            return_code: i32,
            /// Why not.
            error_string: String,
        }
    }

    /// A recording is to end.
    service Stop {
        StopRequest {
            /// ROS sends one octet for an empty message.
            structure_needs_at_least_one_member: u8,
        }
        StopResponse {
            /// ROS sends one octet for an empty message.
            structure_needs_at_least_one_member: u8,
        }
    }

    /// Another file of the bag is to begin.
    service SplitBagfile {
        SplitBagfileRequest {
            /// ROS sends one octet for an empty message.
            structure_needs_at_least_one_member: u8,
        }
        SplitBagfileResponse {
            /// ROS sends one octet for an empty message.
            structure_needs_at_least_one_member: u8,
        }
    }

    /// What comes from now on is not wanted.
    service Pause {
        PauseRequest {
            /// ROS sends one octet for an empty message.
            structure_needs_at_least_one_member: u8,
        }
        PauseResponse {
            /// ROS sends one octet for an empty message.
            structure_needs_at_least_one_member: u8,
        }
    }

    /// What comes from now on is wanted again.
    service Resume {
        ResumeRequest {
            /// ROS sends one octet for an empty message.
            structure_needs_at_least_one_member: u8,
        }
        ResumeResponse {
            /// ROS sends one octet for an empty message.
            structure_needs_at_least_one_member: u8,
        }
    }

    /// From pause to no pause or back.
    service TogglePaused {
        TogglePausedRequest {
            /// ROS sends one octet for an empty message.
            structure_needs_at_least_one_member: u8,
        }
        TogglePausedResponse {
            /// ROS sends one octet for an empty message.
            structure_needs_at_least_one_member: u8,
        }
    }

    /// Whether there is a pause.
    service IsPaused {
        IsPausedRequest {
            /// ROS sends one octet for an empty message.
            structure_needs_at_least_one_member: u8,
        }
        IsPausedResponse {
            /// There is.
            paused: bool,
        }
    }
}
