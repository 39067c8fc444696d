//! `fuyu launch`: runs a scenario's nodes in one process.

mod monitor;
mod overload;
mod plan;
mod summary;

use std::{
    fmt::Write as _,
    io::IsTerminal,
    net::SocketAddr,
    path::PathBuf,
    sync::Arc,
    time::{Duration, Instant},
};

use indicatif::{ProgressBar, ProgressStyle};

use super::{Failure, print};
use crate::nodes::foxglove::{self, Cockpit, Page};
use crate::ros::{DiscoveryRange, Node, NodeError, NodeOptions, Process, return_free_memory};
use monitor::{Observed, Progress};
use overload::Overload;
use plan::Plan;

/// Longest wait for the recorder at the start.
const RECORDER_PATIENCE: Duration = Duration::from_secs(5);

/// Starts every node that a scenario names, in one process
///
/// The nodes exchange messages in memory; other processes find all nodes and topics over DDS, on this computer only,
/// unless ROS_AUTOMATIC_DISCOVERY_RANGE is set. Ctrl-C stops the nodes in order and closes
/// the bag. `--ros-args` at the end, with -r, -p, --params-file and --log-level, applies to all nodes.
#[derive(Debug, Default, clap::Args)]
pub struct Args {
    /// Scenario: a ROS 2 parameter file; default: config/capture.yaml
    #[arg(value_name = "CONFIG")]
    config: Option<String>,
    /// Simulated duration [s], instead of the scenario's
    #[arg(long, value_name = "S", value_parser = super::positive_seconds, allow_hyphen_values = true)]
    duration: Option<f64>,
    /// Every state waits for the command that answers it, as fast as possible
    #[arg(long)]
    lockstep: bool,
    /// New folder for the bag, instead of one in bags/
    #[arg(long, value_name = "DIR")]
    bag: Option<PathBuf>,
    /// Give every node a DDS participant, as if each were a process; without it, nodes of this process exchange messages
    /// in memory
    #[arg(long)]
    isolated: bool,
    /// Serve the run to Foxglove: all topics over a WebSocket, by default on 127.0.0.1:8765; also starts the node
    /// views
    #[arg(
        long,
        value_name = "ADDR:PORT",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "127.0.0.1:8765"
    )]
    foxglove: Option<SocketAddr>,
    /// Serve the operator's page, from which the robot is steered in a browser, on the address of --foxglove; prints
    /// its address with an access token. Build the page with `just cockpit` before
    #[arg(long)]
    cockpit: bool,
}

/// Runs the command.
///
/// # Errors
/// [`Failure::Input`] for an invalid scenario, argument or folder; [`Failure::Runtime`] if a node fails, or if the
/// computer was too slow to reach the scenario's result.
pub fn run(args: &Args, ros_args: Vec<String>) -> Result<(), Failure> {
    return_free_memory();
    let (mut process, rest) =
        Process::from_env(ros_args, DiscoveryRange::Localhost).map_err(failure)?;
    if let Some(unknown) = rest.first() {
        return Err(Failure::Input(format!(
            "argument {unknown}: not a known argument after --ros-args"
        )));
    }
    if args.isolated {
        process = process.isolated();
    }
    let plan = Plan::new(args, process.args().clone()).map_err(Failure::Input)?;
    process.set_args(plan.scenario.args().clone());
    for warning in plan.scenario.warnings(false) {
        tracing::warn!("{warning}");
    }
    let progress = Arc::new(Progress::default());
    let mut nodes = Vec::new();
    let started = start(&mut process, &plan, &progress, &mut nodes);
    if started.is_ok() {
        watch(&mut process, &plan, &progress);
    }
    // Counted before the nodes end, together with their endpoints.
    let overload = Overload::of(&nodes);
    let robot = summary::robot_of(&nodes);
    let finished = process.finish();
    // The bag is useful even if a node failed.
    let mut missed = None;
    if progress.seen().last.is_some() || finished.is_ok() && started.is_ok() {
        let (text, off) = summary::summary(&plan, &progress, &overload, robot.as_deref());
        print(&text)?;
        missed = off;
    }
    started.and(finished).map_err(failure)?;
    missed.map_or(Ok(()), |missed| Err(Failure::Runtime(missed)))
}

fn failure(error: NodeError) -> Failure {
    match error.exit_code() {
        2 => Failure::Input(error.to_string()),
        _ => Failure::Runtime(error.to_string()),
    }
}

/// Starts the nodes; adds the scenario's nodes to `started`.
fn start(
    process: &mut Process,
    plan: &Plan,
    progress: &Arc<Progress>,
    started: &mut Vec<Node>,
) -> Result<(), NodeError> {
    let names: Vec<_> = plan.nodes.iter().map(|(name, _)| name.full()).collect();
    tracing::info!(
        "{}: {} on DDS domain {}",
        plan.scenario.path().display(),
        names.join(", "),
        process.domain().id
    );
    let (args, domain) = (Arc::new(process.args().clone()), process.domain());
    let options = |name: &str, namespace: &str| NodeOptions {
        name: name.to_owned(),
        namespace: namespace.to_owned(),
        args: Arc::clone(&args),
        domain,
        parameter_services: true,
    };
    let namespace = plan.nodes.last().map_or("/", |(name, _)| name.namespace());
    if let Some(address) = plan.foxglove {
        let cockpit = plan.cockpit.then(Page::read).transpose();
        let cockpit = cockpit.map_err(NodeError::Input)?.map(Cockpit::new);
        // Before the publishing nodes, so that no message is missed.
        process.start_with(options("foxglove", namespace), move |node| {
            foxglove::program(node, address, cockpit, |page| {
                // Printed only: the log is public, and its readers must not get control.
                if let Err(e) = print(&format!("cockpit: {page}\n")) {
                    tracing::warn!("cockpit: {e}");
                }
            })
        })?;
    }
    for (name, program) in &plan.nodes {
        let node = process.start_with(options(name.name(), name.namespace()), *program)?;
        if name.name() == "recorder" {
            wait_for_recorder(process, &node);
        }
        started.push(node);
    }
    let (shared, duration) = (Arc::clone(progress), plan.duration);
    let observed = |program: &str| {
        let nodes = plan.nodes.iter().map(|(name, _)| name);
        let pairs = nodes.zip(started.iter());
        let pairs = pairs.filter(|(name, _)| name.name() == program);
        let pairs = pairs.map(|(planned, node)| Observed {
            planned: planned.namespace().to_owned(),
            actual: node.name().namespace().to_owned(),
        });
        pairs.collect::<Vec<_>>()
    };
    let mut robots = observed("dynamics");
    if robots.len() == 1 {
        // Another process owns the time: /clock shows it.
        robots.clear();
    }
    let (controllers, missions) = (observed("controller"), observed("mission"));
    let monitor = NodeOptions {
        parameter_services: false,
        ..options("launch_monitor", namespace)
    };
    process.start_with(monitor, move |node| {
        monitor::program(node, duration, &robots, (&controllers, &missions), &shared)
    })?;
    Ok(())
}

/// Waits until the recorder is ready, so that the bag has the first message of every node.
fn wait_for_recorder(process: &mut Process, recorder: &Node) {
    let start = Instant::now();
    while !recorder.is_ready() && process.run_for(Duration::from_millis(2)) {
        if start.elapsed() > RECORDER_PATIENCE {
            tracing::warn!(
                "node {} is not ready after {RECORDER_PATIENCE:?}: the bag may miss the first messages",
                recorder.name()
            );
            return;
        }
    }
}

/// Shows progress until the run ends.
fn watch(process: &mut Process, plan: &Plan, progress: &Progress) {
    let terminal = std::io::stderr().is_terminal();
    let bar = if terminal {
        ProgressBar::new(1000)
    } else {
        ProgressBar::hidden()
    };
    let style = ProgressStyle::with_template("{bar:40} {msg}");
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    let begin = Instant::now();
    let mut last_report = Instant::now();
    let mut warned = false;
    while process.run_for(Duration::from_millis(200)) {
        let seen = progress.seen();
        let time = seen.last.map_or(0.0, |(time, _)| time);
        let mut line = format!("{time:.1} s");
        if plan.duration > 0.0 {
            bar.set_position((1000.0 * time / plan.duration) as u64);
            // Writing to a string cannot fail.
            let _ = write!(line, " of {} s", plan.duration);
        }
        for (namespace, (position, attitude)) in &seen.errors {
            let of = match seen.errors.len() {
                1 => String::new(),
                _ => format!(" of {namespace}"),
            };
            let _ = write!(
                line,
                ", tip error{of} {position:.4} m, {:.2} deg",
                attitude.to_degrees()
            );
        }
        bar.set_message(line.clone());
        if !terminal && last_report.elapsed() > Duration::from_secs(10) {
            tracing::info!("{line}");
            last_report = Instant::now();
        }
        if !warned && seen.last.is_none() && begin.elapsed() > Duration::from_secs(5) {
            tracing::warn!(
                "simulated time is not advancing: is a controller or an operator missing?"
            );
            warned = true;
        }
    }
    bar.finish_and_clear();
}
