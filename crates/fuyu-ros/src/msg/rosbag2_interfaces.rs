//! ROS package [`rosbag2_interfaces`](https://docs.ros.org/en/jazzy/p/rosbag2_interfaces/), as of Jazzy:
//! the services that control a recorder.

crate::services! {
    package rosbag2_interfaces;

    /// Starts a recording.
    service Record {
        RecordRequest {
            /// Folder of the bag; if empty, the one that the recorder was started with.
            uri: String,
        }
        RecordResponse {
            /// 0 if the recording has started.
            return_code: i32,
            /// Reason if it has not.
            error_string: String,
        }
    }

    /// Ends the recording.
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

    /// Continues the recording in another file of the bag.
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

    /// Pauses the recording: messages are dropped from now on.
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

    /// Resumes a paused recording.
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

    /// Pauses the recording, or resumes a paused one.
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

    /// Asks whether the recording is paused.
    service IsPaused {
        IsPausedRequest {
            /// ROS sends one octet for an empty message.
            structure_needs_at_least_one_member: u8,
        }
        IsPausedResponse {
            /// Whether it is paused.
            paused: bool,
        }
    }
}
