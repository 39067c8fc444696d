//! Configuration of the router, which enforces the permissions of the roles.
//!
//! The flow `ingress` goes from the holder of a certificate to the router, `egress` from the router to the holder.
//! Whatever no rule allows is denied. Keys of data are `domain/name/type/hash`, liveliness tokens begin with
//! `@ros2_lv`, and caches of latched topics have keys with `@adv`, which `**` does not match.

use super::{Role, authority::Authority, authority::Identity, tls};

/// Key expressions of everything that ROS uses.
const ALL: &str = r#"["**", "@ros2_lv/**", "**/@adv/**"]"#;
/// Key expressions of the caches of latched topics.
const CACHES: &str = r#"["**/@adv/**"]"#;

/// A rule of access control.
struct Rule {
    id: String,
    flow: &'static str,
    messages: &'static [&'static str],
    keys: String,
}

impl Rule {
    fn new(
        id: impl Into<String>,
        flow: &'static str,
        messages: &'static [&'static str],
        keys: impl Into<String>,
    ) -> Self {
        Self {
            id: id.into(),
            flow,
            messages,
            keys: keys.into(),
        }
    }

    fn json5(&self) -> String {
        let Self {
            id,
            flow,
            messages,
            keys,
        } = self;
        format!(
            r#"      {{ id: "{id}", permission: "allow", flows: ["{flow}"], messages: {messages:?}, key_exprs: {keys} }},"#
        )
    }
}

/// Permissions of all roles: read, and be discovered.
fn reading() -> Vec<Rule> {
    let interests = &[
        "declare_subscriber",
        "declare_liveliness_subscriber",
        "liveliness_query",
        "liveliness_token",
    ];
    let data = &["put", "delete", "reply", "liveliness_token"];
    vec![
        Rule::new("read", "ingress", interests, ALL),
        Rule::new("receive", "egress", data, ALL),
        Rule::new("read-caches", "ingress", &["query"], CACHES),
        Rule::new("find-caches", "egress", &["declare_queryable"], CACHES),
    ]
}

/// Additional permissions of a role.
fn writing(role: Role) -> Vec<Rule> {
    let name = role.name();
    let id = |what| format!("{name}-{what}");
    let Some(topics) = role.topics() else {
        let all = &[
            "put",
            "delete",
            "query",
            "reply",
            "declare_queryable",
            "declare_subscriber",
            "declare_liveliness_subscriber",
            "liveliness_query",
        ];
        return vec![
            Rule::new(id("sends"), "ingress", all, ALL),
            Rule::new(id("gets"), "egress", all, ALL),
        ];
    };
    let mut rules = Vec::new();
    if !topics.is_empty() {
        // The topics in any domain and namespace, with any type, and their caches.
        let keys = topics.iter().flat_map(|topic| {
            let key = format!("*/**/{topic}/*/*");
            [format!("{key}/@adv/**"), key]
        });
        let keys = format!("{:?}", keys.collect::<Vec<_>>());
        let publish = &[
            "put",
            "delete",
            "declare_queryable",
            "reply",
            "liveliness_token",
        ];
        let listeners = &[
            "declare_subscriber",
            "query",
            "declare_liveliness_subscriber",
        ];
        rules.push(Rule::new(id("publishes"), "ingress", publish, keys.clone()));
        rules.push(Rule::new(id("is-heard"), "egress", listeners, keys));
    }
    const SERVICES: &str = r#"["**"]"#;
    if role.may_call() {
        rules.push(Rule::new(id("calls"), "ingress", &["query"], SERVICES));
        rules.push(Rule::new(
            id("finds"),
            "egress",
            &["declare_queryable"],
            SERVICES,
        ));
    }
    if role.may_serve() {
        let serve = &["declare_queryable", "reply"];
        rules.push(Rule::new(id("serves"), "ingress", serve, SERVICES));
        rules.push(Rule::new(id("is-called"), "egress", &["query"], SERVICES));
    }
    rules
}

/// The configuration of a router that listens at this port.
pub(super) fn configuration(port: u16, identity: &Identity, authority: &Authority) -> String {
    let (mut rules, mut subjects, mut policies) = (Vec::new(), Vec::new(), Vec::new());
    let reading = reading();
    rules.extend(reading.iter().map(Rule::json5));
    for role in Role::ALL {
        let name = role.name();
        let own = writing(role);
        rules.extend(own.iter().map(Rule::json5));
        let ids: Vec<_> = reading.iter().chain(&own).map(|r| r.id.as_str()).collect();
        subjects.push(format!(
            r#"      {{ id: "{name}", cert_common_names: ["{name}"], link_protocols: ["tls"] }},"#
        ));
        policies.push(format!(
            r#"      {{ rules: {ids:?}, subjects: ["{name}"] }},"#
        ));
    }
    format!(
        r#"// Start the router with this file: fuyu router --config router.json5. It contains a secret key.
{{
  mode: "router",
  listen: {{ endpoints: ["tls/[::]:{port}"] }},
  connect: {{ endpoints: [] }},
  scouting: {{ multicast: {{ enabled: false }}, gossip: {{ enabled: false }} }},
  timestamping: {{ enabled: {{ router: true, peer: true, client: true }} }},
  transport: {{
    {}
  }},
  access_control: {{
    enabled: true,
    default_permission: "deny",
    rules: [
{}
    ],
    subjects: [
{}
    ],
    policies: [
{}
    ],
  }},
}}
"#,
        tls("listen", identity, authority),
        rules.join("\n"),
        subjects.join("\n"),
        policies.join("\n")
    )
}
