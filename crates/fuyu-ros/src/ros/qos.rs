//! Quality of service: the profiles of ROS 2, with all fields explicit.

use std::time::Duration;

/// How many samples an endpoint keeps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum History {
    /// The last [`Qos::depth`].
    KeepLast,
    /// All, as far as resources go.
    KeepAll,
}

/// Whether lost samples are sent again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reliability {
    /// They are.
    Reliable,
    /// They are not.
    BestEffort,
}

/// What a late joiner gets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Durability {
    /// Only messages published from then on.
    Volatile,
    /// Also the last samples of each living publisher ("latched").
    TransientLocal,
}

/// Who asserts that a publisher lives.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Liveliness {
    /// The middleware.
    Automatic,
    /// The program, topic by topic.
    ManualByTopic,
}

/// A quality-of-service profile with the fields of `rmw_qos_profile_t`. `None` is an infinite duration.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Qos {
    /// How many samples are kept.
    pub history: History,
    /// The number for [`History::KeepLast`]; a subscription's queue and a publisher's are as long.
    pub depth: usize,
    /// Whether lost samples are sent again.
    pub reliability: Reliability,
    /// What a late joiner gets.
    pub durability: Durability,
    /// Longest expected time between two samples.
    pub deadline: Option<Duration>,
    /// Age at which a sample is dropped.
    pub lifespan: Option<Duration>,
    /// Who asserts that a publisher lives.
    pub liveliness: Liveliness,
    /// Silence after which a publisher counts as dead.
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

    /// Subscriptions to `/clock`, as rclcpp has it: best effort, so that a dead one holds nobody up.
    pub const CLOCK_SUBSCRIPTION: Self = Self {
        depth: 1,
        ..Self::SENSOR_DATA
    };

    /// Services and their parameters, as rmw has it: reliable, volatile, the last 10.
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

    /// The same with another depth.
    #[must_use]
    pub const fn depth(self, depth: usize) -> Self {
        Self { depth, ..self }
    }

    pub(super) const fn is_reliable(&self) -> bool {
        matches!(self.reliability, Reliability::Reliable)
    }
}

/// How many samples a reliable subscription keeps below its queue. After a lost datagram is repaired all
/// that waited for it arrives at once, and rustdds drops samples beyond this limit (64 by default)
/// before it can be taken. Seconds of any stream in the graph; a state message takes about a kilobyte.
pub(super) const KEPT: i32 = 4096;
/// The same for messages of a megabyte.
const KEPT_LARGE: i32 = 64;

/// How many samples a reliable subscription keeps for a program that is late.
pub(super) const fn kept(large: bool) -> usize {
    (if large { KEPT_LARGE } else { KEPT }) as usize
}
