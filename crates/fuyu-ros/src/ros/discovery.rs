//! Discovered topics of other nodes.

use std::collections::BTreeSet;

use super::{
    Gid, NodeName, Qos,
    endpoint::{EndpointSpec, Writer},
    qos::History,
    transport::RemotePublisher,
};

/// Message of the log for a topic that is not exchanged because the QoS profiles are incompatible.
pub(super) fn not_exchanged(topic: &str, offered: &Qos, requested: &Qos) -> String {
    format!(
        "topic {topic} is not exchanged with a peer: {:?} and {:?} are offered, {:?} and {:?} are requested",
        offered.reliability, offered.durability, requested.reliability, requested.durability
    )
}

/// A publisher of another node.
#[derive(Debug, Clone, PartialEq)]
pub struct DiscoveredPublisher {
    /// Full topic name.
    pub topic: String,
    /// ROS type, `pkg/msg/Name`.
    pub type_name: String,
    /// Offered QoS.
    pub qos: Qos,
    /// Type hash that the publisher states, if any.
    pub type_hash: Option<String>,
    /// Identity of the publisher.
    pub gid: Gid,
}

/// Largest number of topics that are warned about, since peers choose the topic names.
const MOST_WARNINGS: usize = 1000;

/// ROS topic publishers among the discovered ones, except those of hidden topics (a part of the name begins with `_`,
/// as in actions). Topics with the prefix of ROS but an invalid name or type are omitted and logged once each;
/// `warned_topics` contains the logged ones.
pub(super) fn publishers(
    found: Vec<RemotePublisher>,
    node: &NodeName,
    warned_topics: &mut BTreeSet<(String, String)>,
) -> Vec<DiscoveredPublisher> {
    let mut publishers = Vec::new();
    for remote in found {
        let Some(topic) = ros_topic(&remote.dds_topic).filter(|topic| !topic.contains("/_")) else {
            continue;
        };
        let type_name = ros_type(&remote.dds_type).filter(|_| node.expand(topic).is_ok());
        if let Some(type_name) = type_name {
            publishers.push(DiscoveredPublisher {
                topic: topic.to_owned(),
                type_name,
                qos: remote.qos,
                type_hash: remote.type_hash,
                gid: remote.gid,
            });
        } else if warned_topics.len() < MOST_WARNINGS
            && warned_topics.insert((remote.dds_topic.clone(), remote.dds_type.clone()))
        {
            tracing::warn!(
                "node {node}: topic {topic} of type {}, published by a peer, is ignored: name or type \
                 is not valid in ROS",
                remote.dds_type
            );
        }
    }
    publishers
}

/// A topic that another node of the same participant publishes or subscribes to.
#[derive(Debug, Clone, PartialEq)]
pub struct LocalTopicUse {
    /// Full topic name.
    pub topic: String,
    /// ROS type, `pkg/msg/Name`.
    pub type_name: String,
    /// Offered or requested QoS, with the default history and depth.
    pub qos: Qos,
    /// True if the node publishes the topic, false if it subscribes.
    pub is_published: bool,
}

impl LocalTopicUse {
    /// `None` if the topic is not a ROS topic, or is hidden.
    pub(super) fn of(spec: &EndpointSpec, is_published: bool) -> Option<Self> {
        let topic = ros_topic(&spec.dds_topic).filter(|topic| !topic.contains("/_"))?;
        Some(Self {
            topic: topic.to_owned(),
            type_name: ros_type(&spec.dds_type)?,
            // DDS discovery does not transmit the history, so it is omitted here too.
            qos: Qos {
                history: History::KeepLast,
                depth: Qos::RELIABLE.depth,
                ..spec.qos
            },
            is_published,
        })
    }
}

impl DiscoveredPublisher {
    /// A publisher of the same participant, in the form in which other participants discover it; `None` if its topic is
    /// hidden or not a ROS topic.
    pub(super) fn local(writer: &Writer) -> Option<Self> {
        let LocalTopicUse {
            topic,
            type_name,
            qos,
            ..
        } = LocalTopicUse::of(&writer.spec, true)?;
        Some(Self {
            topic,
            type_name,
            qos,
            type_hash: None,
            gid: writer.identity(),
        })
    }
}

/// Converts `rt/name` to `/name`; `None` for DDS topics that are not ROS topics.
fn ros_topic(dds: &str) -> Option<&str> {
    dds.strip_prefix("rt").filter(|name| name.starts_with('/'))
}

/// Converts `pkg::msg::dds_::Name_` to `pkg/msg/Name`.
pub(super) fn ros_type(dds: &str) -> Option<String> {
    let (path, name) = dds.rsplit_once("::dds_::")?;
    let (package, kind) = path.split_once("::")?;
    let name = name.strip_suffix('_')?;
    let is_word = |s: &str| {
        let ok = |c: char| c.is_ascii_alphanumeric() || c == '_';
        s.starts_with(|c: char| c.is_ascii_alphabetic()) && s.chars().all(ok)
    };
    [package, kind, name]
        .into_iter()
        .all(is_word)
        .then(|| format!("{package}/{kind}/{name}"))
}

/// Converts `pkg/msg/Name` to `pkg::msg::dds_::Name_`.
pub(super) fn dds_type(ros: &str) -> Option<String> {
    let mut parts = ros.split('/');
    match (parts.next(), parts.next(), parts.next(), parts.next()) {
        (Some(package), Some(kind), Some(name), None) => {
            Some(format!("{package}::{kind}::dds_::{name}_"))
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn type_names_cross_over_and_back() {
        let dds = "sensor_msgs::msg::dds_::JointState_";
        assert_eq!(ros_type(dds).unwrap(), "sensor_msgs/msg/JointState");
        assert_eq!(dds_type("sensor_msgs/msg/JointState").unwrap(), dds);
        assert_eq!(dds_type("JointState"), None);
        for strange in [
            "a::b::msg::dds_::C_",
            "msg::dds_::C_",
            "a::msg::dds_::C",
            "a::msg::C",
        ] {
            assert_eq!(ros_type(strange), None);
        }
        // A plain DDS topic whose name begins like that of a ROS topic.
        assert_eq!(ros_topic("rtk_fix"), None);
        assert_eq!(ros_topic("rt/fix"), Some("/fix"));
    }
}
