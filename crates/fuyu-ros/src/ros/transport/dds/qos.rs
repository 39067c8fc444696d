//! Conversion of quality of service to and from DDS policies.

use rustdds::{
    QosPolicies, QosPolicyBuilder,
    policy::{self, Deadline, Lifespan, ResourceLimits},
};
use std::time::Duration;

use crate::ros::{
    Qos,
    qos::{Durability, History, KEPT, Liveliness, Reliability},
};

/// Longest time that one `write` may block a node's sending thread. A full send window means that a subscriber is dead
/// or overloaded; the node's other topics must not wait for it.
const MAX_BLOCKING: Duration = Duration::from_millis(5);

/// DDS policies of a subscription. Of messages with a `bulky` type only 64 are kept (the default of rustdds), since
/// more could exhaust the memory.
pub(super) fn for_reader(qos: &Qos, bulky: bool) -> QosPolicies {
    let mut limits = QosPolicyBuilder::new();
    if qos.is_reliable() && !bulky {
        limits = limits.resource_limits(ResourceLimits {
            max_samples: KEPT,
            max_instances: KEPT,
            max_samples_per_instance: KEPT,
        });
    }
    QosPolicies::from(qos).modify_by(&limits.build())
}

impl From<&Qos> for QosPolicies {
    fn from(q: &Qos) -> Self {
        let lease_duration = dds_duration(q.liveliness_lease_duration);
        QosPolicyBuilder::new()
            .history(match q.history {
                History::KeepLast => policy::History::KeepLast {
                    depth: i32::try_from(q.depth).unwrap_or(i32::MAX),
                },
                History::KeepAll => policy::History::KeepAll,
            })
            .reliability(match q.reliability {
                Reliability::BestEffort => policy::Reliability::BestEffort,
                Reliability::Reliable => policy::Reliability::Reliable {
                    max_blocking_time: dds_duration(Some(MAX_BLOCKING)),
                },
            })
            .durability(match q.durability {
                Durability::Volatile => policy::Durability::Volatile,
                Durability::TransientLocal => policy::Durability::TransientLocal,
            })
            .liveliness(match q.liveliness {
                Liveliness::Automatic => policy::Liveliness::Automatic { lease_duration },
                Liveliness::ManualByTopic => policy::Liveliness::ManualByTopic { lease_duration },
            })
            .deadline(Deadline(dds_duration(q.deadline)))
            .lifespan(Lifespan {
                duration: dds_duration(q.lifespan),
            })
            .build()
    }
}

fn dds_duration(d: Option<Duration>) -> rustdds::Duration {
    match d {
        None => rustdds::Duration::INFINITE,
        Some(d) => rustdds::Duration::from_nanos(i64::try_from(d.as_nanos()).unwrap_or(i64::MAX)),
    }
}

impl From<&QosPolicies> for Qos {
    /// Converts the QoS that a peer states. DDS does not transmit the history, so the result has keep-last 10.
    fn from(q: &QosPolicies) -> Self {
        let (liveliness, lease) = match q.liveliness() {
            Some(policy::Liveliness::ManualByTopic { lease_duration }) => {
                (Liveliness::ManualByTopic, Some(lease_duration))
            }
            Some(
                policy::Liveliness::Automatic { lease_duration }
                | policy::Liveliness::ManualByParticipant { lease_duration },
            ) => (Liveliness::Automatic, Some(lease_duration)),
            None => (Liveliness::Automatic, None),
        };
        let finite = |d: rustdds::Duration| (d != rustdds::Duration::INFINITE).then(|| d.to_std());
        Self {
            reliability: match q.reliability() {
                Some(policy::Reliability::Reliable { .. }) => Reliability::Reliable,
                _ => Reliability::BestEffort,
            },
            durability: match q.durability() {
                None | Some(policy::Durability::Volatile) => Durability::Volatile,
                Some(_) => Durability::TransientLocal,
            },
            deadline: q.deadline().and_then(|d| finite(d.0)),
            lifespan: q.lifespan().and_then(|l| finite(l.duration)),
            liveliness,
            liveliness_lease_duration: lease.and_then(finite),
            ..Self::RELIABLE
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // Fails if a policy that determines matching is changed by the conversion to DDS and back.
    #[test]
    fn profiles_survive_dds() {
        for q in [
            Qos::RELIABLE,
            Qos::SENSOR_DATA,
            Qos::LATCHED,
            Qos::ROSOUT,
            Qos {
                deadline: Some(Duration::from_millis(250)),
                liveliness: Liveliness::ManualByTopic,
                liveliness_lease_duration: Some(Duration::from_secs(2)),
                ..Qos::RELIABLE
            },
        ] {
            let back = Qos::from(&QosPolicies::from(&q));
            assert_eq!(back, Qos { depth: 10, ..q });
        }
    }
}
