//! Log of a router: warnings of Zenoh, and messages refused by access control, which Zenoh itself does not report as
//! warnings.

use std::{
    collections::HashMap,
    fmt::{self, Write as _},
    sync::{Mutex, PoisonError},
};
use tracing::{
    Event, Level, Metadata, Subscriber,
    field::{Field, Visit},
    level_filters::LevelFilter,
};
use tracing_subscriber::{
    Layer,
    layer::{Context, SubscriberExt},
    util::SubscriberInitExt,
};

/// Log target of access control: reports at level TRACE what is allowed and what is refused.
const ACCESS_CONTROL: &str = "zenoh::net::routing::interceptor::access_control";
/// Log target of connections: reports at level DEBUG why a connection has ended, such as a manipulated or replayed
/// message.
const LINKS: &str = "zenoh_transport::unicast::universal::link";
/// Log target of fuyu's router: reports the addresses at which it listens.
const ROUTER: &str = "fuyu_ros::ros::transport::zenoh::router";

/// Largest number of sessions whose roles are remembered.
const REMEMBERED: usize = 1024;

/// The log of a router.
pub struct RouterLog<F> {
    sink: F,
    access_control: AccessControl,
}

impl<F: Fn(Level, String) + Send + Sync + 'static> RouterLog<F> {
    /// Passes the log of this process's routers to `sink` from now on. No effect if the process has a log already.
    pub fn start(sink: F) {
        let log = Self {
            sink,
            access_control: AccessControl::default(),
        };
        let _ = tracing_subscriber::registry().with(log).try_init();
    }
}

impl<F: Fn(Level, String) + Send + Sync + 'static, S: Subscriber> Layer<S> for RouterLog<F> {
    fn enabled(&self, metadata: &Metadata<'_>, _: Context<'_, S>) -> bool {
        let most = match metadata.target() {
            ACCESS_CONTROL => LevelFilter::TRACE,
            LINKS => LevelFilter::DEBUG,
            ROUTER => LevelFilter::INFO,
            other if other.starts_with("zenoh") || other.starts_with("fuyu_ros") => {
                LevelFilter::WARN
            }
            _ => LevelFilter::OFF,
        };
        *metadata.level() <= most
    }

    fn max_level_hint(&self) -> Option<LevelFilter> {
        Some(LevelFilter::TRACE)
    }

    fn on_event(&self, event: &Event<'_>, _: Context<'_, S>) {
        let metadata = event.metadata();
        let mut message = Message::default();
        event.record(&mut message);
        let (level, text) = match metadata.target() {
            _ if *metadata.level() <= Level::INFO => {
                (*metadata.level(), Some(refused_connection(message.0)))
            }
            ACCESS_CONTROL => (Level::WARN, self.access_control.refusal(&message.0)),
            _ => {
                let why = message.0.strip_prefix("RX task failed: ");
                let ended = why.map(|why| format!("a connection has ended: {why}"));
                (Level::WARN, ended)
            }
        };
        if let Some(text) = text {
            (self.sink)(level, without_source(text));
        }
    }
}

/// Removes the location in Zenoh's source from the end of a message: ` at /path/unicast.rs:163.`
fn without_source(mut text: String) -> String {
    if let Some((message, place)) = text.rsplit_once(" at /")
        && place.contains(".rs:")
        && !place.contains(' ')
    {
        text.truncate(message.len());
    }
    text
}

/// Message about a failed handshake, without Zenoh's guess at the reason.
fn refused_connection(message: String) -> String {
    match message.strip_suffix(". Hint: increase the system open file limit.") {
        Some(why) if !why.contains("Too many open files") => {
            format!("a connection is refused: {why}")
        }
        _ => message,
    }
}

/// Interprets the messages of access control: `ZID on NAME is unauthorized to ACTION on KEY` when a key is declared,
/// for each possible action, and `Using cached result: ZID is unauthorized to ACTION on KEY` when an action is
/// attempted.
#[derive(Default)]
struct AccessControl {
    /// Roles of sessions by Zenoh id.
    roles: Mutex<HashMap<String, String>>,
}

impl AccessControl {
    /// Log text if the message reports a refused action of a session.
    fn refusal(&self, message: &str) -> Option<String> {
        let mut roles = self.roles.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(result) = message.strip_prefix("Using cached result: ") else {
            let (who, _) = message.split_once(" is ")?;
            let (zid, role) = who.split_once(" on ")?;
            if !roles.contains_key(zid) {
                if roles.len() >= REMEMBERED {
                    roles.clear();
                }
                roles.insert(zid.to_owned(), common_name(role).to_owned());
            }
            return None;
        };
        let (zid, what) = result.split_once(" is unauthorized to ")?;
        // Only actions that a session attempts are reported: not messages that the router withholds from it, nor its
        // declarations.
        let (action, key) = what.split_once(" (ingress) on ")?;
        let verb = match action {
            "Put" | "Delete" => "publish",
            "Query" => "call",
            "Reply" => "reply",
            _ => return None,
        };
        let role = roles.get(zid).map_or("?", String::as_str);
        Some(format!(
            "refused: {role} (session {zid}) may not {verb} {key}"
        ))
    }
}

/// Common name of the certificate in a subject such as `Interface(lo)+CertCommonName(viewer)+Transport(Tls)`; the whole
/// subject if there is none.
fn common_name(subject: &str) -> &str {
    let name = subject.split_once("CertCommonName(");
    let name = name.and_then(|(_, rest)| rest.split_once(')'));
    name.map_or(subject, |(name, _)| name)
}

#[derive(Default)]
struct Message(String);

impl Visit for Message {
    fn record_debug(&mut self, field: &Field, value: &dyn fmt::Debug) {
        if field.name() == "message" {
            // Writing to a string cannot fail.
            let _ = write!(self.0, "{value:?}");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_do_not_name_zenohs_source() {
        let text = "Read error on TCP link 127.0.0.1:7447: early eof at /a/unicast.rs:163.";
        let short = "Read error on TCP link 127.0.0.1:7447: early eof";
        assert_eq!(without_source(text.to_owned()), short);
        assert_eq!(without_source("listens at /x".to_owned()), "listens at /x");
    }

    // Fails if an action that would be refused is reported like one that has been refused.
    #[test]
    fn only_attempts_are_refusals() {
        let log = AccessControl::default();
        for possible in [
            "a1 on Interface(lo)+CertCommonName(viewer)+a1 is unauthorized to Put (ingress) on 0/arm/joint_commands",
            "a1 on Interface(lo)+CertCommonName(viewer)+a1 is authorized to Declare Subscriber (ingress) on 0/arm",
            "Using cached result: a1 is unauthorized to Declare Queryable (ingress) on 0/arm/get_parameters",
            "Using cached result: a1 is authorized to Query (ingress) on 0/arm/joint_commands",
            "Using cached result: a1 is unauthorized to Query (egress) on 0/arm/joint_commands",
            "anything else",
        ] {
            assert_eq!(log.refusal(possible), None);
        }
        let attempt =
            "Using cached result: a1 is unauthorized to Put (ingress) on 0/arm/joint_commands";
        assert_eq!(
            log.refusal(attempt).unwrap(),
            "refused: viewer (session a1) may not publish 0/arm/joint_commands"
        );
    }
}
