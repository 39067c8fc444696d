//! Configuration of the sessions of a role.

use super::{Role, authority::Authority, authority::Identity, tls};

/// The configuration of a client of the router at `endpoint`. A client sends everything through the router.
pub(super) fn configuration(
    role: Role,
    endpoint: &str,
    identity: &Identity,
    authority: &Authority,
) -> String {
    format!(
        r#"// For ZENOH_SESSION_CONFIG_URI of the role {}. It contains a secret key.
{{
  mode: "client",
  connect: {{ endpoints: ["{endpoint}"], timeout_ms: 3000 }},
  listen: {{ endpoints: [] }},
  scouting: {{ multicast: {{ enabled: false }}, gossip: {{ enabled: false }} }},
  timestamping: {{ enabled: {{ router: true, peer: true, client: true }} }},
  queries_default_timeout: 600000,
  transport: {{
    {}
  }},
}}
"#,
        role.name(),
        tls("connect", identity, authority)
    )
}
