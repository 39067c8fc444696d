//! Quality of service: the profiles of ROS 2, with all fields explicit.

use std::time::Duration;

/// Number of samples that an endpoint keeps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum History {
    /// The last [`Qos::depth`].
    KeepLast,
    /// All samples, as far as memory permits.
    KeepAll,
}

/// Whether lost samples are retransmitted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reliability {
    /// Lost samples are retransmitted.
    Reliable,
    /// Lost samples are not retransmitted.
    BestEffort,
}

/// Samples that a late joiner receives.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Durability {
    /// Only messages published from then on.
    Volatile,
    /// Also the last samples of each living publisher ("latched").
    TransientLocal,
}

/// How the liveliness of a publisher is asserted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Liveliness {
    /// By the middleware.
    Automatic,
    /// By the program, for each topic.
    ManualByTopic,
}

/// A quality-of-service profile with the fields of `rmw_qos_profile_t`. `None` is an infinite duration.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Qos {
    /// Number of samples that are kept.
    pub history: History,
    /// Number of samples with [`History::KeepLast`]; also the length of the queues of subscriptions and publishers.
    pub depth: usize,
    /// Whether lost samples are retransmitted.
    pub reliability: Reliability,
    /// Samples that a late joiner receives.
    pub durability: Durability,
    /// Longest expected time between two samples.
    pub deadline: Option<Duration>,
    /// Age at which a sample expires.
    pub lifespan: Option<Duration>,
    /// How the liveliness of a publisher is asserted.
    pub liveliness: Liveliness,
    /// Time without an assertion of liveliness after which a publisher counts as dead.
    pub liveliness_lease_duration: Option<Duration>,
}

impl Qos {
    /// State and commands: reliable, volatile, the last 10.
    pub const RELIABLE: Self = Self {
        history: History::KeepLast,
        depth: 10,
        reliability: Reliability::Reliable,
        durability: Durability::Volatile,
        deadline: None,
        lifespan: None,
        liveliness: Liveliness::Automatic,
        liveliness_lease_duration: None,
    };

    /// Sensor streams, and anything faster than 100 Hz: best effort, volatile, the last 5.
    pub const SENSOR_DATA: Self = Self {
        depth: 5,
        reliability: Reliability::BestEffort,
        ..Self::RELIABLE
    };

    /// Latched: published once and delivered to late subscribers (`robot_description`, `camera_info`):
    /// reliable, transient local, the last one.
    pub const LATCHED: Self = Self {
        depth: 1,
        durability: Durability::TransientLocal,
        ..Self::RELIABLE
    };

    /// `tf`, as tf2_ros has it: reliable, volatile, the last 100.
    pub const TF: Self = Self {
        depth: 100,
        ..Self::RELIABLE
    };

    /// `tf_static`, as tf2_ros has it: reliable, transient local.
    pub const TF_STATIC: Self = Self::LATCHED;

    /// `/clock`: reliable, volatile, the last one.
    pub const CLOCK: Self = Self {
        depth: 1,
        ..Self::RELIABLE
    };

    /// Subscriptions to `/clock`, as in rclcpp: best effort, so that a dead subscriber does not delay the publisher.
    pub const CLOCK_SUBSCRIPTION: Self = Self {
        depth: 1,
        ..Self::SENSOR_DATA
    };

    /// Services, including parameter services, as in rmw: reliable, volatile, the last 10.
    pub const SERVICES: Self = Self::RELIABLE;

    /// `/parameter_events`, as rmw has it: reliable, volatile, the last 1000.
    pub const PARAMETER_EVENTS: Self = Self {
        depth: 1000,
        ..Self::RELIABLE
    };

    /// `/rosout`, as rcl has it: reliable, transient local, the last 1000 for 10 s.
    pub const ROSOUT: Self = Self {
        depth: 1000,
        durability: Durability::TransientLocal,
        lifespan: Some(Duration::from_secs(10)),
        ..Self::RELIABLE
    };

    /// The same profile with another depth.
    #[must_use]
    pub const fn depth(self, depth: usize) -> Self {
        Self { depth, ..self }
    }

    pub(super) const fn is_reliable(&self) -> bool {
        matches!(self.reliability, Reliability::Reliable)
    }
}

/// Number of samples that the DDS reader of a reliable subscription keeps. After a lost datagram has been
/// retransmitted, all samples that waited for it arrive at once; rustdds drops those beyond this limit (64 by default)
/// before they can be taken. This number suffices for some seconds of any stream in the graph; a state message has
/// about a kilobyte.
pub(super) const KEPT: i32 = 4096;
/// As [`KEPT`], for messages of the order of a megabyte.
const KEPT_LARGE: i32 = 64;

/// Largest number of samples of a reliable subscription that wait for a late program.
pub(super) const fn kept(large: bool) -> usize {
    (if large { KEPT_LARGE } else { KEPT }) as usize
}
