//! ROS package [`diagnostic_msgs`](https://docs.ros.org/en/jazzy/p/diagnostic_msgs/).

use super::Byte;
use super::std_msgs::Header;

crate::messages! {
    package diagnostic_msgs;

    /// A named value.
    message KeyValue {
        /// Name.
        key: String,
        /// Value.
        value: String,
    }

    /// How one part of a robot fares.
    message DiagnosticStatus {
        /// One of the constants.
        level: Byte,
        /// The part.
        name: String,
        /// What is the matter with it.
        message: String,
        /// Which piece of hardware.
        hardware_id: String,
        /// Details.
        values: Vec<KeyValue>,
    }
    constants {
        /// All is well.
        OK: Byte = Byte(0),
        /// Worth a look.
        WARN: Byte = Byte(1),
        /// Broken.
        ERROR: Byte = Byte(2),
        /// Not heard of for a while.
        STALE: Byte = Byte(3),
    }

    /// How a robot's parts fare.
    message DiagnosticArray {
        /// Time of the report.
        header: Header,
        /// One entry a part.
        status: Vec<DiagnosticStatus>,
    }
}
