//! Log: `tracing` events on stderr, in the format of ROS, and on `/rosout`.

use std::{
    cell::RefCell,
    fmt::{self, Write as _},
    io::{IsTerminal, Write as _},
    sync::{Arc, Weak},
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

use super::{RosArgs, Time, node_core::NodeCore};
use crate::msg::rcl_interfaces::Log;

/// Libraries whose messages do not concern users (most occur at shutdown), with their levels unless `--log-level` names
/// them.
const QUIET: [(&str, LevelFilter); 8] = [
    ("rustdds", LevelFilter::OFF),
    ("ros2_client", LevelFilter::OFF),
    ("foxglove", LevelFilter::WARN),
    ("zenoh", LevelFilter::WARN),
    ("zenoh_ext", LevelFilter::WARN),
    ("zenoh_link_tcp", LevelFilter::WARN),
    ("zenoh_link_tls", LevelFilter::WARN),
    ("zenoh_transport", LevelFilter::WARN),
];

thread_local! {
    /// The node that this thread works for.
    static NODE: RefCell<Weak<NodeCore>> = const { RefCell::new(Weak::new()) };
}

/// Assigns this thread to a node, whose name its log messages carry.
pub(super) fn enter(core: &Arc<NodeCore>) {
    NODE.with_borrow_mut(|node| *node = Arc::downgrade(core));
}

/// Starts the log of this process with the options of `args`. No effect if the program has a log already.
pub fn init(args: &RosArgs) {
    let layer = RosLog {
        level: args.log_level.unwrap_or(LevelFilter::INFO),
        loggers: args.logger_levels.clone(),
        console: args.console,
        colour: std::io::stderr().is_terminal(),
    };
    let _ = tracing_subscriber::registry().with(layer).try_init();
}

struct RosLog {
    level: LevelFilter,
    loggers: Vec<(String, LevelFilter)>,
    console: bool,
    colour: bool,
}

/// Whether `name` is `parent` or below it (`a.b` and `a::b` are below `a`).
fn is_within(name: &str, parent: &str) -> bool {
    name.strip_prefix(parent)
        .is_some_and(|rest| rest.is_empty() || rest.starts_with(['.', ':']))
}

impl RosLog {
    /// The level of a target or node: that of the longest matching logger name, otherwise the default.
    fn level_of(&self, target: &str, node: Option<&str>) -> LevelFilter {
        let fits =
            |logger: &str| is_within(target, logger) || node.is_some_and(|n| is_within(n, logger));
        let named = self.loggers.iter().filter(|(logger, _)| fits(logger));
        if let Some((_, level)) = named.max_by_key(|(logger, _)| logger.len()) {
            return *level;
        }
        let quiet = QUIET.iter().find(|(q, _)| is_within(target, q));
        quiet.map_or(self.level, |(_, most)| self.level.min(*most))
    }
}

impl<S: Subscriber> Layer<S> for RosLog {
    fn enabled(&self, metadata: &Metadata<'_>, _: Context<'_, S>) -> bool {
        let node = logger_name();
        *metadata.level() <= self.level_of(metadata.target(), node.as_deref())
    }

    fn max_level_hint(&self) -> Option<LevelFilter> {
        let named = self.loggers.iter().map(|(_, level)| *level);
        named.chain([self.level]).max()
    }

    fn on_event(&self, event: &Event<'_>, _: Context<'_, S>) {
        let metadata = event.metadata();
        let mut text = Text::default();
        event.record(&mut text);
        let core = NODE.with_borrow(Weak::upgrade);
        let name = logger_name().unwrap_or_else(|| text.target(metadata).to_owned());
        let stamp = core.as_ref().map_or_else(Time::wall, |c| c.clock.now());
        let (severity, label, colour) = severity(*metadata.level());
        if self.console {
            let line = if self.colour && !colour.is_empty() {
                format!(
                    "{colour}[{label}] [{stamp}] [{name}]: {}\x1b[0m\n",
                    text.message
                )
            } else {
                format!("[{label}] [{stamp}] [{name}]: {}\n", text.message)
            };
            // An error of writing the log cannot be reported.
            let _ = std::io::stderr().lock().write_all(line.as_bytes());
        }
        if let Some(core) = core
            && let Some(writer) = core.log()
        {
            let record = Log {
                stamp: stamp.into(),
                level: severity,
                name,
                msg: text.message,
                file: metadata.file().unwrap_or_default().to_owned(),
                function: metadata.module_path().unwrap_or_default().to_owned(),
                line: metadata.line().unwrap_or_default(),
            };
            core.publish(writer, &record);
        }
    }
}

/// `chaser.dynamics`, as rclcpp names the logger of a node.
fn logger_name() -> Option<String> {
    let core = NODE.with_borrow(Weak::upgrade)?;
    let full = core.names.node().full();
    Some(full.trim_start_matches('/').replace('/', "."))
}

fn severity(level: Level) -> (u8, &'static str, &'static str) {
    match level {
        Level::ERROR => (Log::ERROR, "ERROR", "\x1b[31m"),
        Level::WARN => (Log::WARN, "WARN", "\x1b[33m"),
        Level::INFO => (Log::INFO, "INFO", ""),
        Level::DEBUG | Level::TRACE => (Log::DEBUG, "DEBUG", "\x1b[32m"),
    }
}

/// The message of an event, followed by its fields.
#[derive(Default)]
struct Text {
    message: String,
    /// Target of a record of the `log` crate: the bridge gives all of them the same target in `tracing`.
    log_target: Option<String>,
}

impl Text {
    /// Target of the message; used if the thread belongs to no node.
    fn target<'a>(&'a self, metadata: &'a Metadata<'_>) -> &'a str {
        let target = self.log_target.as_deref().unwrap_or(metadata.target());
        target.split("::").next().unwrap_or(target)
    }
}

impl Visit for Text {
    fn record_str(&mut self, field: &Field, value: &str) {
        match field.name() {
            "message" => self.message.insert_str(0, value),
            "log.target" => self.log_target = Some(value.to_owned()),
            _ => self.record_debug(field, &value),
        }
    }

    fn record_debug(&mut self, field: &Field, value: &dyn fmt::Debug) {
        // Writing to a string cannot fail.
        let _ = match field.name() {
            "message" => {
                let before = std::mem::take(&mut self.message);
                write!(self.message, "{value:?}{before}")
            }
            name if name.starts_with("log.") => Ok(()),
            name => write!(self.message, " {name}={value:?}"),
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn libraries_are_quiet_unless_named() {
        let log = RosLog {
            level: LevelFilter::INFO,
            loggers: vec![
                ("chaser".into(), LevelFilter::WARN),
                ("chaser.camera".into(), LevelFilter::DEBUG),
                ("rustdds::rtps".into(), LevelFilter::ERROR),
            ],
            console: false,
            colour: false,
        };
        let node = |n| log.level_of("fuyu::nodes", Some(n));
        assert_eq!(node("chaser.dynamics"), LevelFilter::WARN);
        assert_eq!(node("chaser.camera"), LevelFilter::DEBUG);
        assert_eq!(node("chaser2"), LevelFilter::INFO);
        assert_eq!(log.level_of("rustdds::discovery", None), LevelFilter::OFF);
        let sdk = log.level_of("foxglove::websocket::server", None);
        assert_eq!(sdk, LevelFilter::WARN);
        assert_eq!(
            log.level_of("rustdds::rtps::writer", None),
            LevelFilter::ERROR
        );
    }
}
