//! Key expressions of topics and services: `domain/name/type/hash`.

use crate::ros::endpoint::{EndpointSpec, Role};

/// Used in place of the hash of an unknown type. It matches no hash in the key expressions of data.
const NO_HASH: &str = "TypeHashNotSupported";

/// Name, type and hash of a topic or service, as in key expressions and tokens.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub(super) struct TopicKey {
    /// Full name, `/chatter`.
    pub(super) name: String,
    /// `std_msgs::msg::dds_::String_`; for a service, without `Request` or `Response`.
    pub(super) type_name: String,
    /// Type hash; `None` if the definition of the type is not known in this program.
    pub(super) hash: Option<String>,
}

impl TopicKey {
    pub(super) fn of(spec: &EndpointSpec) -> Self {
        let (type_name, hash) = match &spec.role {
            Role::Topic => {
                let hash = (spec.stated_hash.clone()).filter(|hash| is_hash(hash));
                let computed = spec.definition.map(|known| known.type_hash());
                (spec.dds_type.clone(), hash.or(computed))
            }
            Role::Request(service) | Role::Reply(service) => {
                let (package, kind) = (service.package, service.kind.name());
                let type_name = format!("{package}::{kind}::dds_::{}_", service.name);
                (type_name, Some(service.type_hash()))
            }
        };
        Self {
            name: spec.name.clone(),
            type_name,
            hash,
        }
    }

    /// Key expression for sending messages.
    pub(super) fn data(&self, domain: u16) -> String {
        self.expression(domain, self.token_hash())
    }

    /// Key expression for receiving messages: with any hash if the definition is not known in this program.
    pub(super) fn any_data(&self, domain: u16) -> String {
        self.expression(domain, self.hash.as_deref().unwrap_or("*"))
    }

    fn expression(&self, domain: u16, hash: &str) -> String {
        let name = self.name.trim_matches('/');
        format!("{domain}/{name}/{}/{hash}", self.type_name)
    }

    /// The hash in a token.
    pub(super) fn token_hash(&self) -> &str {
        self.hash.as_deref().unwrap_or(NO_HASH)
    }

    /// Whether endpoints with these two keys exchange messages.
    pub(super) fn is_exchanged_with(&self, other: &Self) -> bool {
        let are_known = self.hash.is_some() && other.hash.is_some();
        self.name == other.name
            && self.type_name == other.type_name
            && (!are_known || self.hash == other.hash)
    }

    /// Creates a key from the parts of a token.
    pub(super) fn from_token(name: String, type_name: String, hash: &str) -> Self {
        Self {
            name,
            type_name,
            hash: is_hash(hash).then(|| hash.to_owned()),
        }
    }
}

fn is_hash(text: &str) -> bool {
    let digits = text.strip_prefix("RIHS01_");
    digits.is_some_and(|d| d.len() == 64 && d.bytes().all(|b| b.is_ascii_hexdigit()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        msg::{ServiceDefinition, std_msgs, std_srvs::SetBool},
        ros::{
            Qos,
            service::{REPLY, REQUEST, service_spec},
        },
    };

    // From the design document of rmw_zenoh.
    #[test]
    fn keys_of_topics_are_those_of_rmw_zenoh() {
        let hash = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18";
        for (name, domain, expected) in [
            ("/chatter", 0, "0/chatter/std_msgs::msg::dds_::String_/"),
            (
                "/robot1/chatter",
                0,
                "0/robot1/chatter/std_msgs::msg::dds_::String_/",
            ),
        ] {
            let spec = EndpointSpec::topic::<std_msgs::String>(name, Qos::RELIABLE);
            let key = TopicKey::of(&spec);
            assert_eq!(key.data(domain), format!("{expected}{hash}"));
            assert_eq!(key.any_data(domain), key.data(domain));
        }
        let mut unknown = EndpointSpec::topic::<std_msgs::String>("/chatter", Qos::RELIABLE);
        unknown.definition = None;
        let key = TopicKey::of(&unknown);
        assert_eq!(key.any_data(0), "0/chatter/std_msgs::msg::dds_::String_/*");
        unknown.stated_hash = Some(hash.to_owned());
        assert!(TopicKey::of(&unknown).data(0).ends_with(hash));
        assert!(key.is_exchanged_with(&TopicKey::of(&unknown)));
    }

    // Fails if the two directions of a service have different keys: a service is a single queryable.
    #[test]
    fn both_directions_of_a_service_have_one_key() {
        let [request, reply] =
            [REQUEST, REPLY].map(|d| TopicKey::of(&service_spec::<SetBool>("/arm/enable", d)));
        let hash = ServiceDefinition::of::<SetBool>().type_hash();
        let expected = format!("2/arm/enable/std_srvs::srv::dds_::SetBool_/{hash}");
        assert_eq!(request.data(2), expected);
        assert_eq!(request, reply);
    }
}
