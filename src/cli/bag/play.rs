//! `fuyu bag play`.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use super::super::{Failure, print};
use super::failure;
use crate::bag::Bag;
use crate::nodes::player::{NAME, Played, Player};
use crate::ros::{DiscoveryRange, NodeError, NodeOptions, Process};

/// Publish the messages of a bag with the recorded types, QoS and times
///
/// On this computer only, unless ROS_AUTOMATIC_DISCOVERY_RANGE is set. Ctrl-C stops it. The services
/// pause, resume, toggle_paused and is_paused are those of `ros2 bag play`.
#[derive(Debug, clap::Args)]
pub struct PlayArgs {
    /// Folder or .mcap file
    bag: PathBuf,
    /// Recorded seconds per second
    #[arg(short, long, value_name = "FACTOR", default_value_t = 1.0, value_parser = factor)]
    rate: f64,
    /// Repeat until Ctrl-C
    #[arg(short = 'l', long = "loop")]
    repeat: bool,
    /// Publish /clock at this rate instead of the recorded one [Hz]; 40 if no value is given
    #[arg(long, value_name = "HZ", num_args = 0..=1, default_missing_value = "40", value_parser = factor)]
    clock: Option<f64>,
    /// Topics to play; default: all
    #[arg(long, value_name = "TOPIC", num_args = 1.., value_delimiter = ',')]
    topics: Vec<String>,
    /// Rename a topic, as in ROS
    #[arg(short = 'm', long, value_name = "FROM:=TO", num_args = 1..)]
    remap: Vec<String>,
    /// Skip the beginning; of latched topics the last message before it is published [s]
    #[arg(long, value_name = "S", default_value_t = 0.0, value_parser = seconds)]
    start_offset: f64,
    /// Time for subscribers to match before the first message [s]
    #[arg(short, long, value_name = "S", default_value_t = 1.0, value_parser = seconds)]
    delay: f64,
    /// Start paused, until the service resume is called
    #[arg(short = 'p', long)]
    start_paused: bool,
}

fn factor(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(factor) if (1e-3..=1e3).contains(&factor) => Ok(factor),
        _ => Err("give a positive number, 0.001 to 1000".to_owned()),
    }
}

fn seconds(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(seconds) if (0.0..1e9).contains(&seconds) => Ok(seconds),
        _ => Err("give a number of seconds, zero or more".to_owned()),
    }
}

/// Runs the command.
pub fn run(args: &PlayArgs, mut ros_args: Vec<String>) -> Result<(), Failure> {
    let bag = Bag::open(&args.bag).map_err(failure)?;
    if !args.remap.is_empty() && ros_args.is_empty() {
        ros_args.push("--ros-args".to_owned());
    }
    for rule in &args.remap {
        ros_args.extend(["-r".to_owned(), rule.clone()]);
    }
    let (mut process, rest) =
        Process::from_env(ros_args, DiscoveryRange::Localhost).map_err(node_failure)?;
    if let Some(unknown) = rest.first() {
        return Err(Failure::Input(format!(
            "argument {unknown}: not a known argument after --ros-args"
        )));
    }
    let player = Player {
        bag,
        rate: args.rate,
        repeat: args.repeat,
        clock: args.clock,
        topics: args.topics.clone(),
        start_offset: Duration::from_secs_f64(args.start_offset),
        delay: Duration::from_secs_f64(args.delay),
        start_paused: args.start_paused,
    };
    let played = Arc::new(Mutex::new(Played::default()));
    let options = NodeOptions {
        name: NAME.to_owned(),
        namespace: "/".to_owned(),
        args: Arc::new(process.args().clone()),
        domain: process.domain(),
        parameter_services: true,
    };
    let shared = Arc::clone(&played);
    process
        .start_with(options, move |node| player.run(node, &shared))
        .map_err(node_failure)?;
    process.wait().map_err(node_failure)?;
    let played = played.lock().unwrap_or_else(PoisonError::into_inner);
    for damage in &played.damage {
        tracing::warn!("{damage}");
    }
    let mut text = format!("{} messages on {} topics\n", played.messages, played.topics);
    if played.dropped > 0 {
        text += &format!(
            "{} of them were dropped: subscribers were too slow\n",
            played.dropped
        );
    }
    print(&text)
}

fn node_failure(error: NodeError) -> Failure {
    match error.exit_code() {
        2 => Failure::Input(error.to_string()),
        _ => Failure::Runtime(error.to_string()),
    }
}
