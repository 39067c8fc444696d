//! Liveliness tokens. Each node, publisher, subscription, service and client has a token, whose key expression
//! describes it:
//!
//! `@ros2_lv/domain/session/node id/entity id/kind/enclave/namespace/node`, followed (except for nodes) by
//! `/name/type/hash/qos`. Slashes within a part are written as `%`.

use xxhash_rust::xxh3::xxh3_128;

use super::{keys::TopicKey, qos};
use crate::ros::{Gid, Qos};

/// First part of all tokens. Because of the `@`, wildcards of other key expressions do not match tokens.
const PREFIX: &str = "@ros2_lv";

/// Kind of entity that a token describes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) enum EntityKind {
    Node,
    Publisher,
    Subscription,
    Service,
    Client,
}

impl EntityKind {
    const ALL: [Self; 5] = [
        Self::Node,
        Self::Publisher,
        Self::Subscription,
        Self::Service,
        Self::Client,
    ];

    fn name(self) -> &'static str {
        match self {
            Self::Node => "NN",
            Self::Publisher => "MP",
            Self::Subscription => "MS",
            Self::Service => "SS",
            Self::Client => "SC",
        }
    }
}

/// An entity of the ROS graph: a node, publisher, subscription, service or client.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Entity {
    /// `ROS_DOMAIN_ID`.
    pub(super) domain: u16,
    /// Zenoh id of the session.
    pub(super) session: String,
    /// Number of the node in the session.
    pub(super) node_id: u64,
    /// Number of the entity in the session; for a node, its own number.
    pub(super) id: u64,
    pub(super) kind: EntityKind,
    /// Namespace of the node, `/` or `/chaser`.
    pub(super) namespace: String,
    /// Name of the node.
    pub(super) node: String,
    /// Topic or service with its QoS; `None` for nodes.
    pub(super) topic: Option<(TopicKey, Qos)>,
}

impl Entity {
    /// Key expression that matches the tokens of a domain.
    pub(super) fn all_tokens(domain: u16) -> String {
        format!("{PREFIX}/{domain}/**")
    }

    /// Key expression of the entity's token.
    pub(super) fn token(&self) -> String {
        let Self {
            domain,
            session,
            node_id,
            id,
            kind,
            namespace,
            node,
            topic,
        } = self;
        let namespace = mangle(namespace);
        // The enclave is part of SROS, which is not supported.
        let mut token = format!(
            "{PREFIX}/{domain}/{session}/{node_id}/{id}/{}/%/{namespace}/{node}",
            kind.name()
        );
        if let Some((key, qos)) = topic {
            let (name, type_name) = (mangle(&key.name), mangle(&key.type_name));
            for part in [name.as_str(), type_name.as_str(), key.token_hash()] {
                token.push('/');
                token.push_str(part);
            }
            token.push('/');
            token.push_str(&qos::encode(qos));
        }
        token
    }

    /// Parses the key expression of a token; `None` if it is not one.
    pub(super) fn parse(token: &str) -> Option<Self> {
        let mut parts = token.split('/');
        let mut next = || parts.next().filter(|part| !part.is_empty());
        if next()? != PREFIX {
            return None;
        }
        let domain = next()?.parse().ok()?;
        let session = next()?.to_owned();
        let node_id = next()?.parse().ok()?;
        let id = next()?.parse().ok()?;
        let name = next()?;
        let kind = EntityKind::ALL.into_iter().find(|k| k.name() == name)?;
        next()?;
        let namespace = demangle(next()?);
        let node = demangle(next()?);
        let topic = match kind {
            EntityKind::Node => None,
            _ => {
                let key = TopicKey::from_token(demangle(next()?), demangle(next()?), next()?);
                Some((key, qos::decode(next()?)?))
            }
        };
        Some(Self {
            domain,
            session,
            node_id,
            id,
            kind,
            namespace,
            node,
            topic,
        })
    }

    /// Full name of the node, `/chaser/arm`.
    pub(super) fn node_name(&self) -> String {
        format!("{}/{}", self.namespace.trim_end_matches('/'), self.node)
    }
}

/// GID of the entity with this token, as stated in attachments: XXH3-128 of the token, lower half first.
pub(super) fn gid(token: &str) -> Gid {
    xxh3_128(token.as_bytes()).to_le_bytes().into()
}

fn mangle(name: &str) -> String {
    name.replace('/', "%")
}

fn demangle(part: &str) -> String {
    part.replace('%', "/")
}

#[cfg(test)]
mod tests {
    use super::*;

    const STRING: &str = "std_msgs::msg::dds_::String_/RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18";
    const SUM: &str = "example_interfaces::srv::dds_::AddTwoInts_/RIHS01_e118de6bf5eeb66a2491b5bda11202e7b68f198d6f67922cf30364858239c81a";

    /// The example tokens in the design document of rmw_zenoh.
    fn examples() -> [(EntityKind, String); 5] {
        let [listener, talker, server, client] = [
            "aac3178e146ba6f1fc6e6a4085e77f21",
            "8b20917502ee955ac4476e0266340d5c",
            "f9980ee0495eaafb3e38f0d19e2eae12",
            "e1dc8d1b45ae8717fce78689cc655685",
        ];
        [
            (
                EntityKind::Node,
                format!("@ros2_lv/2/{listener}/0/0/NN/%/%/listener"),
            ),
            (
                EntityKind::Subscription,
                format!(
                    "@ros2_lv/2/{listener}/0/10/MS/%/%/listener/%chatter/{STRING}/::,10:,:,:,,"
                ),
            ),
            (
                EntityKind::Publisher,
                format!("@ros2_lv/2/{talker}/0/10/MP/%/%/talker/%chatter/{STRING}/::,7:,:,:,,"),
            ),
            (
                EntityKind::Service,
                format!(
                    "@ros2_lv/2/{server}/0/10/SS/%/%/add_two_ints_server/%add_two_ints/{SUM}/::,10:,:,:,,"
                ),
            ),
            (
                EntityKind::Client,
                format!(
                    "@ros2_lv/2/{client}/0/10/SC/%/%/add_two_ints_client/%add_two_ints/{SUM}/::,10:,:,:,,"
                ),
            ),
        ]
    }

    #[test]
    fn tokens_are_those_of_rmw_zenoh() {
        for (kind, token) in examples() {
            let entity = Entity::parse(&token).expect(&token);
            assert_eq!((entity.kind, entity.domain), (kind, 2));
            assert_eq!(entity.namespace, "/");
            assert_eq!(entity.token(), token);
        }
        let [_, (_, subscription), ..] = examples();
        let (key, qos) = Entity::parse(&subscription).unwrap().topic.unwrap();
        assert_eq!(key.name, "/chatter");
        assert_eq!(qos, Qos::RELIABLE);
    }

    #[test]
    fn namespaces_are_mangled() {
        let [(_, node), ..] = examples();
        let entity = Entity {
            namespace: "/a/b".to_owned(),
            ..Entity::parse(&node).unwrap()
        };
        assert!(entity.token().ends_with("/NN/%/%a%b/listener"));
        assert_eq!(entity.node_name(), "/a/b/listener");
        assert_eq!(Entity::parse(&entity.token()), Some(entity));
    }

    #[test]
    fn what_is_no_token_is_refused() {
        let [(_, node), (_, subscription), ..] = examples();
        for wrong in [
            "",
            "@ros2_lv/2",
            &node.replace("NN", "XX"),
            &node.replace("/listener", "/"),
            &subscription.replace("/::,10:,:,:,,", ""),
            &subscription.replace("::,10", "::,ten"),
        ] {
            assert_eq!(Entity::parse(wrong), None, "{wrong}");
        }
    }

    // XXH3-128 with seed 0, as computed by the reference implementation (`xxhsum -H2`). Fails if the halves are
    // exchanged.
    #[test]
    fn a_gid_is_the_hash_of_its_token() {
        let empty = 0x99aa_06d3_0147_98d8_6001_c324_468d_497f_u128;
        assert_eq!(gid(""), Gid::from(empty.to_le_bytes()));
    }
}
