//! Configuration of Zenoh sessions, from the environment variables of rmw_zenoh.

use std::{fmt, path::Path};

use super::super::TransportError;
use crate::ros::context::DomainError;

/// Settings of rmw_zenoh that differ from Zenoh's defaults: a peer that listens on loopback and is introduced to other
/// peers by a router on this computer.
const DEFAULT: &str = r#"{
    mode: "peer",
    connect: {
        timeout_ms: { router: -1, peer: -1, client: 0 },
        endpoints: ["tcp/localhost:7447"],
        exit_on_failure: { router: false, peer: false, client: true },
    },
    listen: {
        timeout_ms: 0,
        endpoints: ["tcp/localhost:0"],
        exit_on_failure: true,
    },
    scouting: {
        delay: 500,
        multicast: { enabled: false },
        gossip: {
            enabled: true,
            target: { router: ["router", "peer"], peer: ["router"] },
            autoconnect: { router: [], peer: ["router", "peer"] },
            autoconnect_strategy: { peer: { to_router: "always", to_peer: "greater-zid" } },
        },
    },
    timestamping: { enabled: { router: true, peer: true, client: true } },
    queries_default_timeout: 600000,
    transport: {
        unicast: {
            open_timeout: 60000,
            accept_timeout: 60000,
            accept_pending: 10000,
            max_sessions: 10000,
        },
    },
}"#;

/// Settings of rmw_zenoh's router that differ from Zenoh's defaults. As an exception, an attempt to connect to another
/// router ends after 5 s instead of 60 s and is repeated after a second, so that an interruption ends soon.
const ROUTER: &str = r#"{
    mode: "router",
    connect: {
        endpoints: [],
        retry: { period_init_ms: 1000, period_max_ms: 1000, period_increase_factor: 1 },
    },
    listen: { endpoints: ["tcp/[::]:7447"], exit_on_failure: true },
    scouting: { multicast: { enabled: false } },
    timestamping: { enabled: { router: true, peer: true, client: true } },
    queries_default_timeout: 600000,
    transport: {
        unicast: {
            open_timeout: 5000,
            accept_timeout: 60000,
            accept_pending: 10000,
            max_sessions: 10000,
        },
    },
}"#;

const SESSION_FILE: &str = "ZENOH_SESSION_CONFIG_URI";
const ROUTER_FILE: &str = "ZENOH_ROUTER_CONFIG_URI";

/// Configuration of the Zenoh session of a participant, or of a router.
#[derive(Clone)]
pub struct ZenohConfig {
    config: zenoh::Config,
    /// Number of checks for a router, a second apart, before the nodes start; `None` for no check.
    pub(super) router_checks: Option<u64>,
}

impl fmt::Debug for ZenohConfig {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // Not shown: the configuration may contain names of key files.
        f.debug_struct("ZenohConfig").finish_non_exhaustive()
    }
}

impl Default for ZenohConfig {
    /// The settings of rmw_zenoh: a peer that connects to a router at `tcp/localhost:7447`.
    fn default() -> Self {
        let config = zenoh::Config::from_json5(DEFAULT);
        Self {
            config: config.expect("the default configuration is valid"),
            router_checks: Some(1),
        }
    }
}

impl ZenohConfig {
    /// Reads `ZENOH_SESSION_CONFIG_URI` (a file), `ZENOH_CONFIG_OVERRIDE` (`key=value;...`) and
    /// `ZENOH_ROUTER_CHECK_ATTEMPTS`.
    ///
    /// # Errors
    /// [`DomainError`] names the variable, its value and what would be right.
    pub fn from_env() -> Result<Self, DomainError> {
        Self::from_variables(Self::default(), SESSION_FILE, |name| {
            std::env::var(name).ok()
        })
    }

    /// Configuration of a [`ZenohRouter`](super::ZenohRouter): the file named by `ZENOH_ROUTER_CONFIG_URI`, or else the
    /// settings of rmw_zenoh's router, which listens on port 7447 of all addresses; then `ZENOH_CONFIG_OVERRIDE` is
    /// applied.
    ///
    /// # Errors
    /// As [`Self::from_env`].
    pub fn router_from_env() -> Result<Self, DomainError> {
        let config = zenoh::Config::from_json5(ROUTER);
        let default = Self {
            config: config.expect("the default configuration is valid"),
            router_checks: None,
        };
        Self::from_variables(default, ROUTER_FILE, |name| std::env::var(name).ok())
    }

    /// Reads a Zenoh configuration file.
    ///
    /// # Errors
    /// The error of reading, or the invalid part of the file.
    pub fn from_file(path: &Path) -> Result<Self, String> {
        let config = zenoh::Config::from_file(path).map_err(|e| e.to_string())?;
        Ok(Self {
            config,
            ..Self::default()
        })
    }

    fn from_variables(
        default: Self,
        file: &'static str,
        get: impl Fn(&str) -> Option<String>,
    ) -> Result<Self, DomainError> {
        let get = |name| get(name).filter(|value| !value.is_empty());
        let mut config = match get(file) {
            None => default,
            Some(path) => Self::from_file(Path::new(&path)).map_err(|e| {
                let expected = format!("expected a configuration file of Zenoh: {e}");
                DomainError::new(file, &path, expected)
            })?,
        };
        const OVERRIDE: &str = "ZENOH_CONFIG_OVERRIDE";
        if let Some(text) = get(OVERRIDE) {
            for pair in text.split(';').filter(|pair| !pair.trim().is_empty()) {
                let wrong = |why: String| {
                    let expected = format!(
                        "expected key=value with a value in JSON5, as in mode=\"client\": {why}"
                    );
                    DomainError::new(OVERRIDE, pair, expected)
                };
                let Some((key, value)) = pair.split_once('=') else {
                    return Err(wrong("there is no =".to_owned()));
                };
                config = config.with(key.trim(), value).map_err(wrong)?;
            }
        }
        const CHECKS: &str = "ZENOH_ROUTER_CHECK_ATTEMPTS";
        if let Some(text) = get(CHECKS) {
            let expected = "expected a number of attempts, 0 for any number, or -1 for none";
            let number = text.trim().parse::<i64>();
            let number = number.map_err(|_| DomainError::new(CHECKS, &text, expected))?;
            config.router_checks = match number {
                0 => Some(u64::MAX),
                number => u64::try_from(number).ok(),
            };
        }
        Ok(config)
    }

    /// Sets a value, in JSON5, at a key such as `connect/endpoints`.
    ///
    /// # Errors
    /// The error in key or value.
    pub fn with(mut self, key: &str, json5: &str) -> Result<Self, String> {
        let inserted = self.config.insert_json5(key, json5);
        inserted.map_err(|e| format!("{key}={json5}: {e}"))?;
        Ok(self)
    }

    /// Opens a session. Its threads inherit the caller's signal mask.
    pub(super) fn open(&self) -> Result<zenoh::Session, TransportError> {
        let session = zenoh::Wait::wait(zenoh::open(self.config.clone()));
        session.map_err(|e| TransportError::other(format!("no Zenoh session: {e}")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn config(variables: &[(&str, &str)]) -> Result<ZenohConfig, DomainError> {
        ZenohConfig::from_variables(ZenohConfig::default(), SESSION_FILE, |name| {
            let found = variables.iter().find(|(n, _)| *n == name);
            found.map(|(_, value)| (*value).to_owned())
        })
    }

    #[test]
    fn variables_mean_what_they_mean_in_rmw_zenoh() {
        let plain = config(&[]).unwrap();
        assert_eq!(plain.router_checks, Some(1));
        assert_eq!(plain.config.get_json("mode").unwrap(), "\"peer\"");
        let endpoints = plain.config.get_json("connect/endpoints").unwrap();
        assert!(endpoints.contains("tcp/localhost:7447"), "{endpoints}");
        for (text, checks) in [("0", Some(u64::MAX)), ("-1", None), ("5", Some(5))] {
            let config = config(&[("ZENOH_ROUTER_CHECK_ATTEMPTS", text)]).unwrap();
            assert_eq!(config.router_checks, checks);
        }
        let overridden = config(&[(
            "ZENOH_CONFIG_OVERRIDE",
            "mode=\"client\";connect/endpoints=[\"tcp/127.0.0.1:7448\"]",
        )]);
        let overridden = overridden.unwrap().config;
        assert_eq!(overridden.get_json("mode").unwrap(), "\"client\"");
        let endpoints = overridden.get_json("connect/endpoints").unwrap();
        assert!(endpoints.contains("7448"), "{endpoints}");
    }

    #[test]
    fn wrong_values_are_named() {
        for (name, value) in [
            ("ZENOH_SESSION_CONFIG_URI", "/no/such/file.json5"),
            ("ZENOH_CONFIG_OVERRIDE", "mode"),
            ("ZENOH_CONFIG_OVERRIDE", "mode=\"king\""),
            ("ZENOH_ROUTER_CHECK_ATTEMPTS", "often"),
        ] {
            let text = config(&[(name, value)]).unwrap_err().to_string();
            assert!(text.contains(name) && !text.contains('\n'), "{text}");
        }
    }
}
