//! QoS profiles in bags: the `offered_qos_profiles` of a topic.

use serde::{Deserialize, Deserializer, Serialize};

use crate::ros;

/// QoS that a publisher of a recorded topic offered, with rosbag2's names and order of fields.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Qos {
    /// Which messages the publisher keeps.
    pub history: History,
    /// Number of messages kept with [`History::KeepLast`].
    pub depth: u64,
    /// Whether lost messages are retransmitted.
    pub reliability: Reliability,
    /// Whether late subscribers receive earlier messages.
    pub durability: Durability,
    /// Deadline: longest time between messages.
    pub deadline: QosDuration,
    /// Lifespan: how long a message stays valid.
    pub lifespan: QosDuration,
    /// How a publisher asserts its liveliness.
    pub liveliness: Liveliness,
    /// Time without an assertion of liveliness after which the publisher counts as dead.
    pub liveliness_lease_duration: QosDuration,
    /// Whether topic names have no ROS prefix.
    #[serde(default)]
    pub avoid_ros_namespace_conventions: bool,
}

/// A duration in the representation of rmw.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct QosDuration {
    /// Seconds.
    pub sec: u64,
    /// Nanoseconds.
    pub nsec: u64,
}

impl QosDuration {
    /// Infinite: 2⁶³ - 1 ns.
    pub const INFINITE: Self = Self {
        sec: 9_223_372_036,
        nsec: 854_775_807,
    };
}

impl From<ros::Qos> for Qos {
    fn from(qos: ros::Qos) -> Self {
        let duration = |d: Option<std::time::Duration>| {
            d.map_or(QosDuration::INFINITE, |d| QosDuration {
                sec: d.as_secs(),
                nsec: d.subsec_nanos().into(),
            })
        };
        Self {
            history: match qos.history {
                ros::qos::History::KeepLast => History::KeepLast,
                ros::qos::History::KeepAll => History::KeepAll,
            },
            depth: qos.depth as u64,
            reliability: match qos.reliability {
                ros::qos::Reliability::Reliable => Reliability::Reliable,
                ros::qos::Reliability::BestEffort => Reliability::BestEffort,
            },
            durability: match qos.durability {
                ros::qos::Durability::Volatile => Durability::Volatile,
                ros::qos::Durability::TransientLocal => Durability::TransientLocal,
            },
            deadline: duration(qos.deadline),
            lifespan: duration(qos.lifespan),
            liveliness: match qos.liveliness {
                ros::qos::Liveliness::Automatic => Liveliness::Automatic,
                ros::qos::Liveliness::ManualByTopic => Liveliness::ManualByTopic,
            },
            liveliness_lease_duration: duration(qos.liveliness_lease_duration),
            avoid_ros_namespace_conventions: false,
        }
    }
}

impl Qos {
    /// The profile for one publisher in place of several with these profiles: the policies that they have in common
    /// and, where they differ, the policy that is compatible with most subscribers. Deadlines and lifespans are
    /// omitted, since the replay rate may differ.
    pub fn offer(profiles: &[Self]) -> ros::Qos {
        let all = |is: fn(&Self) -> bool| !profiles.is_empty() && profiles.iter().all(is);
        let depth = profiles.iter().map(|q| q.depth).max().unwrap_or(0);
        let default = ros::Qos::RELIABLE;
        ros::Qos {
            reliability: match all(|q| q.reliability == Reliability::BestEffort) {
                true => ros::qos::Reliability::BestEffort,
                false => ros::qos::Reliability::Reliable,
            },
            durability: match all(|q| q.durability == Durability::TransientLocal) {
                true => ros::qos::Durability::TransientLocal,
                false => ros::qos::Durability::Volatile,
            },
            // Zero means unknown.
            depth: match usize::try_from(depth) {
                Ok(depth @ 1..=100_000) => depth,
                _ => default.depth,
            },
            ..default
        }
    }
}

// Bags before version 9 contain the numbers of rmw; later ones contain names.
macro_rules! policy {
    ($(#[doc = $doc:literal])* $policy:ident {
        $($(#[doc = $variant_doc:literal])* $variant:ident = $number:literal, $text:literal;)*
    }) => {
        $(#[doc = $doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
        pub enum $policy {
            $($(#[doc = $variant_doc])* #[serde(rename = $text)] $variant,)*
            /// Another value.
            #[serde(rename = "unknown")]
            Unknown,
        }

        impl $policy {
            /// The name of the policy, as rosbag2 writes it.
            pub fn as_str(self) -> &'static str {
                match self {
                    $(Self::$variant => $text,)*
                    Self::Unknown => "unknown",
                }
            }
        }

        impl<'de> Deserialize<'de> for $policy {
            fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                let text = NumberOrText::deserialize(deserializer)?.0;
                Ok(match text.as_str() {
                    $($number | $text => Self::$variant,)*
                    _ => Self::Unknown,
                })
            }
        }
    };
}

policy! {
    /// Which messages are kept by a publisher.
    History {
        /// The middleware's default.
        SystemDefault = "0", "system_default";
        /// The last `depth` messages.
        KeepLast = "1", "keep_last";
        /// All messages.
        KeepAll = "2", "keep_all";
    }
}
policy! {
    /// Whether lost messages are retransmitted.
    Reliability {
        /// The middleware's default.
        SystemDefault = "0", "system_default";
        /// Retransmitted.
        Reliable = "1", "reliable";
        /// Not retransmitted.
        BestEffort = "2", "best_effort";
    }
}
policy! {
    /// Whether late subscribers receive earlier messages.
    Durability {
        /// The middleware's default.
        SystemDefault = "0", "system_default";
        /// Late subscribers receive them.
        TransientLocal = "1", "transient_local";
        /// Late subscribers do not.
        Volatile = "2", "volatile";
    }
}
policy! {
    /// How a publisher asserts its liveliness.
    Liveliness {
        /// The middleware's default.
        SystemDefault = "0", "system_default";
        /// The middleware asserts it.
        Automatic = "1", "automatic";
        /// The publisher asserts it.
        ManualByTopic = "3", "manual_by_topic";
    }
}

struct NumberOrText(String);

impl<'de> Deserialize<'de> for NumberOrText {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Visitor;
        impl serde::de::Visitor<'_> for Visitor {
            type Value = NumberOrText;
            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str("the number or name of a policy")
            }
            fn visit_str<E>(self, v: &str) -> Result<Self::Value, E> {
                Ok(NumberOrText(v.to_owned()))
            }
            fn visit_u64<E>(self, v: u64) -> Result<Self::Value, E> {
                Ok(NumberOrText(v.to_string()))
            }
            fn visit_i64<E>(self, v: i64) -> Result<Self::Value, E> {
                Ok(NumberOrText(v.to_string()))
            }
        }
        deserializer.deserialize_any(Visitor)
    }
}

/// Profiles as the text stored in an MCAP channel.
pub(super) fn to_yaml(profiles: &[Qos]) -> String {
    // The types contain nothing that YAML cannot represent.
    serde_saphyr::to_string(&profiles).expect("profiles have a YAML form")
}

/// Parses profiles; returns none if the text is not understood, since the bag is usable without them.
pub(super) fn from_yaml(text: &str) -> Vec<Qos> {
    serde_saphyr::from_str(text).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn profiles_survive_a_round_trip() {
        let profiles = [ros::Qos::RELIABLE, ros::Qos::SENSOR_DATA, ros::Qos::ROSOUT].map(Qos::from);
        let text = to_yaml(&profiles);
        assert!(text.contains("history: keep_last"), "{text}");
        assert!(text.contains("sec: 10\n"), "{text}");
        assert!(text.contains("sec: 9223372036"), "{text}");
        assert_eq!(from_yaml(&text), profiles);
    }

    #[test]
    fn numbered_policies_of_older_bags_are_read() {
        // As rosbag2 Humble writes it.
        let text = "- history: 3\n  depth: 0\n  reliability: 2\n  durability: 2\n  deadline:\n    sec: 9223372036\n    nsec: 854775807\n  lifespan:\n    sec: 9223372036\n    nsec: 854775807\n  liveliness: 1\n  liveliness_lease_duration:\n    sec: 9223372036\n    nsec: 854775807\n  avoid_ros_namespace_conventions: false";
        let [qos] = from_yaml(text)[..] else {
            panic!("{:?}", from_yaml(text))
        };
        assert_eq!(qos.history, History::Unknown);
        assert_eq!(qos.reliability, Reliability::BestEffort);
        assert_eq!(qos.durability, Durability::Volatile);
        assert_eq!(qos.liveliness, Liveliness::Automatic);
        assert_eq!(from_yaml("{"), []);
        assert_eq!(from_yaml(""), []);
    }
}
