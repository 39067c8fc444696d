//! `--ros-args`: the ROS arguments on the command line of a node.

use std::path::PathBuf;

use super::{NodeError, NodeName};
use super::{
    names::{Remap, Target},
    params::{Override, ParameterValue, Source},
    params_file::ParamsFile,
};

/// An invalid ROS argument.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("argument {argument:?}: {expected}")]
pub struct ArgsError {
    argument: String,
    expected: String,
}

/// Severity of a log record, or the level of a log level argument.
pub use tracing::level_filters::LevelFilter;

/// A source of parameters on the command line. Later sources override earlier ones.
#[derive(Debug, Clone, PartialEq)]
pub enum ParameterSource {
    /// `--params-file FILE`
    File(PathBuf),
    /// A parameter file that has been read already.
    Read(ParamsFile),
    /// `-p [node:]name:=value`
    Value {
        /// The node that the value is for; `None` for all nodes.
        node: Option<String>,
        /// Name of the parameter.
        name: String,
        /// Value of the parameter.
        value: ParameterValue,
    },
}

/// The ROS arguments of a process.
#[derive(Debug, Clone, PartialEq)]
pub struct RosArgs {
    /// Remap rules, `-r`.
    pub remaps: Vec<Remap>,
    /// Parameters, `-p` and `--params-file`, in order.
    pub parameters: Vec<ParameterSource>,
    /// `--log-level LEVEL`
    pub log_level: Option<LevelFilter>,
    /// `--log-level LOGGER:=LEVEL`
    pub logger_levels: Vec<(String, LevelFilter)>,
    /// Whether logs are published on `/rosout`; false with `--disable-rosout-logs`.
    pub rosout: bool,
    /// Whether logs are written to stderr; false with `--disable-stdout-logs`.
    pub console: bool,
    /// Whether the process has a single node, which must then declare every parameter that `-p` sets. With several
    /// nodes, `-p` without a node name applies to those that declare such a parameter.
    pub only_node: bool,
}

impl Default for RosArgs {
    fn default() -> Self {
        Self {
            remaps: Vec::new(),
            parameters: Vec::new(),
            log_level: None,
            logger_levels: Vec::new(),
            rosout: true,
            console: true,
            only_node: false,
        }
    }
}

impl RosArgs {
    /// Splits `argv` (without the program's name) into the parsed sections `--ros-args ... --` and the remaining
    /// arguments.
    ///
    /// # Errors
    /// [`ArgsError`] names the argument and says what would be right.
    pub fn parse(argv: impl IntoIterator<Item = String>) -> Result<(Self, Vec<String>), ArgsError> {
        let mut args = Self::default();
        let mut rest = Vec::new();
        let mut argv = argv.into_iter();
        while let Some(arg) = argv.next() {
            if arg != "--ros-args" {
                rest.push(arg);
                continue;
            }
            while let Some(flag) = argv.next().filter(|a| a != "--") {
                if flag != "--ros-args" {
                    args.take(&flag, &mut argv)?;
                }
            }
        }
        Ok((args, rest))
    }

    fn take(
        &mut self,
        flag: &str,
        argv: &mut impl Iterator<Item = String>,
    ) -> Result<(), ArgsError> {
        let mut value = |what: &str| {
            argv.next()
                .filter(|v| v != "--" && v != "--ros-args")
                .ok_or_else(|| wrong(flag, format!("expected {what} after it")))
        };
        match flag {
            "-r" | "--remap" => {
                let rule = value("FROM:=TO")?;
                self.remaps.push(parse_remap(&rule)?);
            }
            "-p" | "--param" => {
                let rule = value("NAME:=VALUE")?;
                self.parameters.push(parse_param(&rule)?);
            }
            "--params-file" => {
                let path = value("a file")?;
                self.parameters.push(ParameterSource::File(path.into()));
            }
            "--log-level" => {
                let text = value("a level or LOGGER:=LEVEL")?;
                match text.split_once(":=") {
                    None => self.log_level = Some(parse_level(&text, &text)?),
                    Some((logger, level)) => {
                        let level = parse_level(&text, level)?;
                        self.logger_levels.push((logger.to_owned(), level));
                    }
                }
            }
            "-e" | "--enclave" => {
                let enclave = value("an enclave")?;
                tracing::warn!("--enclave {enclave}: ignored, DDS Security is not supported");
            }
            "--log-config-file" => {
                let file = value("a file")?;
                tracing::warn!("--log-config-file {file}: ignored, use --log-level");
            }
            "--enable-rosout-logs" => self.rosout = true,
            "--disable-rosout-logs" => self.rosout = false,
            "--enable-stdout-logs" => self.console = true,
            "--disable-stdout-logs" => self.console = false,
            // Accepted without effect: fuyu writes no log files, and no external library has a log of its own.
            "--enable-external-lib-logs" | "--disable-external-lib-logs" => {}
            _ => {
                return Err(wrong(
                    flag,
                    "not a ROS argument; expected -r, -p, --params-file, --log-level, \
                     --[en|dis]able-rosout-logs, --[en|dis]able-stdout-logs, or `--` to end them",
                ));
            }
        }
        Ok(())
    }

    /// Adds a parameter file before all others, so that arguments of the command line override it.
    #[must_use]
    pub fn with_scenario(mut self, file: ParamsFile) -> Self {
        self.parameters.insert(0, ParameterSource::Read(file));
        self
    }

    /// The parameter values of these arguments for the node `name`, which is called `declared` before remapping. Later
    /// values override earlier ones.
    ///
    /// # Errors
    /// [`NodeError::ParamsFile`] if a file cannot be read or is not a parameter file.
    pub fn overrides(&self, name: &NodeName, declared: &str) -> Result<Vec<Override>, NodeError> {
        let mut all = Vec::new();
        for source in &self.parameters {
            match source {
                ParameterSource::File(path) => {
                    all.extend(ParamsFile::read(path)?.overrides(name));
                }
                ParameterSource::Read(file) => all.extend(file.overrides(name)),
                ParameterSource::Value {
                    node,
                    name: n,
                    value,
                } => {
                    let for_us =
                        |node: &str| node == declared || node == name.name() || node == name.full();
                    if node.as_deref().is_none_or(for_us) {
                        all.push(Override {
                            name: n.clone(),
                            value: value.clone(),
                            source: Source::Argument,
                            shared: node.is_none() && !self.only_node,
                        });
                    }
                }
            }
        }
        Ok(all)
    }
}

fn wrong(argument: &str, expected: impl Into<String>) -> ArgsError {
    ArgsError {
        argument: argument.to_owned(),
        expected: expected.into(),
    }
}

fn parse_level(argument: &str, level: &str) -> Result<LevelFilter, ArgsError> {
    match level.to_ascii_lowercase().as_str() {
        "debug" => Ok(LevelFilter::DEBUG),
        "info" => Ok(LevelFilter::INFO),
        "warn" => Ok(LevelFilter::WARN),
        // `tracing` has no level above ERROR.
        "error" | "fatal" => Ok(LevelFilter::ERROR),
        _ => Err(wrong(
            argument,
            "expected debug, info, warn, error or fatal",
        )),
    }
}

/// Splits `node:rest`. The scheme of a URL (`rostopic://`) is not a node name.
fn split_node(text: &str) -> (Option<&str>, &str) {
    match text.split_once(':') {
        Some((node, rest)) if !rest.starts_with("//") => (Some(node), rest),
        _ => (None, text),
    }
}

fn parse_remap(rule: &str) -> Result<Remap, ArgsError> {
    let (left, to) = rule
        .split_once(":=")
        .ok_or_else(|| wrong(rule, "expected FROM:=TO, as in joint_states:=js"))?;
    let (node, from) = split_node(left);
    if from.is_empty() || to.is_empty() || node == Some("") {
        return Err(wrong(rule, "expected a name on both sides of `:=`"));
    }
    let name = |from: &str, topics, services| Target::Name {
        from: from.to_owned(),
        topics,
        services,
    };
    let target = match from {
        "__node" | "__name" => Target::NodeName,
        "__ns" => Target::Namespace,
        _ => match (
            from.strip_prefix("rostopic://"),
            from.strip_prefix("rosservice://"),
        ) {
            (Some(topic), _) => name(topic, true, false),
            (_, Some(service)) => name(service, false, true),
            _ => name(from, true, true),
        },
    };
    let remap = Remap {
        node: node.map(str::to_owned),
        target,
        to: to.to_owned(),
    };
    check_remap(&remap).map_err(|e| wrong(rule, e.to_string()))?;
    Ok(remap)
}

/// Checks that both sides of a remap rule are valid names, with a placeholder for the node, which is not known yet.
fn check_remap(remap: &Remap) -> Result<(), super::names::NameError> {
    let any = NodeName::new("/", "node")?;
    match &remap.target {
        Target::NodeName => NodeName::new("/", &remap.to).map(drop),
        Target::Namespace => NodeName::new(&remap.to, "node").map(drop),
        Target::Name { from, .. } => any.expand(from).and(any.expand(&remap.to)).map(drop),
    }
}

fn parse_param(rule: &str) -> Result<ParameterSource, ArgsError> {
    let (left, text) = rule
        .split_once(":=")
        .ok_or_else(|| wrong(rule, "expected NAME:=VALUE, as in rate:=30.0"))?;
    let (node, name) = split_node(left);
    if name.is_empty() || node == Some("") {
        return Err(wrong(rule, "expected the parameter's name before `:=`"));
    }
    let value = ParameterValue::parse_yaml(text).map_err(|e| wrong(rule, e))?;
    Ok(ParameterSource::Value {
        node: node.map(str::to_owned),
        name: name.to_owned(),
        value,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<(RosArgs, Vec<String>), ArgsError> {
        RosArgs::parse(text.split_whitespace().map(str::to_owned))
    }

    #[test]
    fn everything_a_ros_user_writes() {
        let (args, rest) = parse(
            "run.yaml --ros-args -r __ns:=/chaser -r cam:__node:=eye -r joint_states:=js \
             --remap rostopic://~/a:=/b -p rate:=30 -p cam:noise:=[0.1,0.2] --params-file a.yaml \
             --log-level debug --log-level fuyu.camera:=WARN --disable-rosout-logs -- --duration 3 \
             --ros-args -p name:='7'",
        )
        .unwrap();
        assert_eq!(rest, ["run.yaml", "--duration", "3"]);
        assert_eq!(args.remaps.len(), 4);
        assert_eq!(args.remaps[0].target, Target::Namespace);
        assert_eq!(args.remaps[1].node.as_deref(), Some("cam"));
        assert!(matches!(
            &args.remaps[3].target,
            Target::Name { from, topics: true, services: false } if from == "~/a"
        ));
        let value = |node: Option<&str>, name: &str, value| ParameterSource::Value {
            node: node.map(str::to_owned),
            name: name.to_owned(),
            value,
        };
        assert_eq!(
            args.parameters,
            [
                value(None, "rate", ParameterValue::Integer(30)),
                value(
                    Some("cam"),
                    "noise",
                    ParameterValue::DoubleArray(vec![0.1, 0.2])
                ),
                ParameterSource::File("a.yaml".into()),
                value(None, "name", ParameterValue::String("7".into())),
            ]
        );
        assert_eq!(args.log_level, Some(LevelFilter::DEBUG));
        assert_eq!(
            args.logger_levels,
            [("fuyu.camera".into(), LevelFilter::WARN)]
        );
        assert!(!args.rosout && args.console);
    }

    #[test]
    fn wrong_arguments_are_named() {
        for (text, named, expected) in [
            ("--ros-args -r", "-r", "FROM:=TO"),
            ("--ros-args -r a:b", "a:b", "FROM:=TO"),
            ("--ros-args -r a:=", "a:=", "both sides"),
            ("--ros-args -r a:=2b", "a:=2b", "digit"),
            ("--ros-args -r __ns:=a//b", "__ns:=a//b", "two in a row"),
            ("--ros-args -p rate", "rate", "NAME:=VALUE"),
            ("--ros-args -p :=1", ":=1", "name"),
            ("--ros-args -p a:=[1,2.0]", "a:=[1,2.0]", "1.0"),
            ("--ros-args --params-file --", "--params-file", "a file"),
            ("--ros-args --log-level loud", "loud", "debug, info"),
            ("--ros-args --rate 3", "--rate", "not a ROS argument"),
        ] {
            let text = parse(text).unwrap_err().to_string();
            assert!(text.contains(named) && text.contains(expected), "{text}");
        }
    }
}
