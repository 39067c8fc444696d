//! The `fuyu` command line: one file per command, with its `Args` and `run`.

mod bag;
mod campaign;
mod estimate;
mod files;
mod inspect;
mod joint_values;
#[cfg(feature = "zenoh")]
mod keys;
mod launch;
mod modes;
mod reproduce;
#[cfg(feature = "zenoh")]
mod router;
mod simulate;
mod table;

use std::ffi::OsString;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Parser, Subcommand};

use crate::model::{Model, Repaired};
use crate::nodes::resource::Lookup;

/// Free-floating space robots as ROS 2 nodes.
///
/// Without a command: fuyu launch.
#[derive(Parser)]
#[command(name = "fuyu", version)]
struct Cli {
    #[command(subcommand)]
    command: Option<Command>,
}

#[derive(Subcommand)]
enum Command {
    Bag(bag::Args),
    Campaign(campaign::Args),
    Estimate(estimate::Args),
    Files(files::Args),
    Inspect(inspect::Args),
    #[cfg(feature = "zenoh")]
    Keys(keys::Args),
    Launch(launch::Args),
    Modes(modes::Args),
    Reproduce(reproduce::Args),
    #[cfg(feature = "zenoh")]
    Router(router::Args),
    Simulate(simulate::Args),
}

impl Command {
    /// `ros_args` is `--ros-args` and the arguments after it.
    fn run(self, ros_args: Vec<String>) -> Result<(), Failure> {
        match self {
            Self::Launch(args) => launch::run(&args, ros_args),
            Self::Bag(args) => bag::run(args, ros_args),
            _ if !ros_args.is_empty() => Err(no_ros_args()),
            Self::Campaign(args) => campaign::run(args),
            Self::Estimate(args) => estimate::run(&args),
            Self::Files(args) => files::run(&args),
            Self::Inspect(args) => inspect::run(args),
            #[cfg(feature = "zenoh")]
            Self::Keys(args) => keys::run(&args),
            Self::Modes(args) => modes::run(&args),
            Self::Reproduce(args) => reproduce::run(&args),
            #[cfg(feature = "zenoh")]
            Self::Router(args) => router::run(&args),
            Self::Simulate(args) => simulate::run(&args),
        }
    }
}

/// Reason for the failure of a command. Printed on stderr, one line per problem.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Failure {
    /// Invalid input: a file, a value, a name. Exit code 2.
    #[error("{0}")]
    Input(String),
    /// The command ran, but a check failed. Exit code 1.
    #[error("{0}")]
    Check(String),
    /// An error of the environment: a full disk, a port in use. Exit code 1.
    #[error("{0}")]
    Runtime(String),
}

impl Failure {
    fn exit_code(&self) -> ExitCode {
        ExitCode::from(match self {
            Self::Input(_) => 2,
            Self::Check(_) | Self::Runtime(_) => 1,
        })
    }
}

/// Runs the command given by the process's arguments. Returns its exit code (0 done, 1 ran but a check failed, 2
/// invalid input).
pub fn main() -> ExitCode {
    // Paths may be invalid UTF-8.
    let mut args: Vec<OsString> = std::env::args_os().collect();
    let ros_args = match args.iter().position(|arg| arg == "--ros-args") {
        Some(at) => args.split_off(at),
        None => Vec::new(),
    };
    let command = Cli::parse_from(args).command;
    let command = command.unwrap_or_else(|| Command::Launch(launch::Args::default()));
    let ros_args = ros_args.into_iter().map(|arg| {
        let problem = |arg: OsString| Failure::Input(format!("argument {arg:?} is not UTF-8"));
        arg.into_string().map_err(problem)
    });
    match ros_args
        .collect::<Result<_, _>>()
        .and_then(|args| command.run(args))
    {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            for line in failure.to_string().lines() {
                let line = line.replace('\r', " ");
                // If stderr is closed, there is nowhere to report it.
                let _ = writeln!(io::stderr(), "fuyu: error: {line}");
            }
            failure.exit_code()
        }
    }
}

fn no_ros_args() -> Failure {
    let text = "--ros-args: only `fuyu launch` and `fuyu bag play` accept them";
    Failure::Input(text.to_owned())
}

/// Reads and compiles a robot description: a path, or `package://PACKAGE/PATH`, also searched for in `packages`.
/// Repairs are reported as warnings on stderr; with `strict`, as errors.
fn read_model(path: &Path, packages: &[PathBuf], strict: bool) -> Result<Model, Failure> {
    let name = path.to_str().ok_or_else(|| {
        let path = path.display();
        Failure::Input(format!("{path}: the name of the file is not UTF-8"))
    })?;
    let lookup = Lookup {
        packages: packages.to_vec(),
        ..Lookup::default()
    };
    let (xml, source) = lookup.read(name).map_err(Failure::Input)?;
    let repaired = Repaired::from_urdf(&xml, &source, strict);
    let repaired = repaired.map_err(|e| Failure::Input(e.to_string()))?;
    for warning in repaired.warnings() {
        // If stderr is closed, there is nowhere to report it.
        let _ = writeln!(io::stderr(), "fuyu: warning: {warning}");
    }
    Ok(repaired.model)
}

/// Writes a command's result to stdout. A closed pipe (`fuyu ... | head`) is not an error.
fn print(text: &str) -> Result<(), Failure> {
    let mut stdout = io::stdout().lock();
    match stdout
        .write_all(text.as_bytes())
        .and_then(|()| stdout.flush())
    {
        Err(e) if e.kind() != io::ErrorKind::BrokenPipe => {
            Err(Failure::Runtime(format!("cannot write to stdout: {e}")))
        }
        _ => Ok(()),
    }
}

/// Numbers given as `1,-2,3e-1`.
#[derive(Debug, Clone, PartialEq)]
struct Numbers(Vec<f64>);

impl std::str::FromStr for Numbers {
    type Err = String;

    fn from_str(list: &str) -> Result<Self, String> {
        let number = |word: &str| match word.trim().parse::<f64>() {
            Ok(x) if x.is_finite() => Ok(x),
            _ => Err(format!(
                "'{word}' is not a finite number; give numbers as 1,-2,0.3"
            )),
        };
        list.split(',')
            .map(number)
            .collect::<Result<_, _>>()
            .map(Self)
    }
}

/// A number above zero.
fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if x > 0.0 && x.is_finite() => Ok(x),
        _ => Err("give a positive number".to_owned()),
    }
}

/// A number that is zero or above.
fn not_negative(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if x >= 0.0 && x.is_finite() => Ok(x),
        _ => Err("give a number that is not negative".to_owned()),
    }
}

/// A positive duration in seconds.
fn positive_seconds(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(seconds) if seconds > 0.0 && seconds.is_finite() => Ok(seconds),
        _ => Err("give a positive number of seconds".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use clap::CommandFactory;

    use super::*;

    fn check(command: &mut clap::Command) {
        command.build();
        let name = command.get_name().to_owned();
        let mut shorts = BTreeSet::new();
        for argument in command.get_arguments() {
            if let Some(short) = argument.get_short() {
                assert!(shorts.insert(short), "{name}: two options are -{short}");
            }
        }
        let help = command.render_long_help().to_string();
        assert!(!help.contains("\\]"), "{name}: {help}");
        command.get_subcommands_mut().for_each(check);
    }

    // clap checks short options only in debug builds, by a panic.
    #[test]
    fn every_short_option_has_one_meaning_and_help_is_plain_text() {
        check(&mut Cli::command());
    }
}
