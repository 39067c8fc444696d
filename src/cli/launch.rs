//! `fuyu launch`: a scenario's nodes in one process, talking over DDS.

use std::{
    fmt::Write as _,
    io::IsTerminal,
    path::PathBuf,
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
    time::{Duration, Instant},
};

use indicatif::{ProgressBar, ProgressStyle};

use super::{Failure, print};
use crate::{
    bag::Bag,
    experiments::{RecordedRun, RecordedRuns, momentum_residuals},
    msg::{fuyu_msgs::ControllerState, rosgraph_msgs::Clock},
    nodes::{self, recorder, scenario::Scenario},
    ros::{
        Node, NodeError, NodeName, NodeOptions, ParameterValue, Process, Qos, Reach, RosArgs, Time,
        args::ParameterSource,
    },
    spatial::roll_pitch_yaw_intrinsic,
};

/// Starts every node that a scenario names, in one process, talking over DDS
///
/// On this computer only, unless ROS_AUTOMATIC_DISCOVERY_RANGE says otherwise. Ctrl-C stops in order and
/// closes the bag. `--ros-args` at the end, with -r, -p, --params-file and --log-level, is for all nodes.
#[derive(Debug, Default, clap::Args)]
pub struct Args {
    /// Scenario: a ROS 2 parameter file; config/servicing.yaml without it
    #[arg(value_name = "CONFIG")]
    config: Option<String>,
    /// Simulated time after which it ends [s], instead of the scenario's
    #[arg(long, value_name = "S", value_parser = super::positive_seconds, allow_hyphen_values = true)]
    duration: Option<f64>,
    /// Every state waits for the command that answers it, as fast as that goes
    #[arg(long)]
    lockstep: bool,
    /// New folder for the bag, instead of one in bags/
    #[arg(long, value_name = "DIR")]
    bag: Option<PathBuf>,
}

/// Runs the command.
///
/// # Errors
/// [`Failure::Input`] for a wrong scenario, argument or folder; [`Failure::Runtime`] when a node fails.
pub fn run(args: &Args, ros_args: Vec<String>) -> Result<(), Failure> {
    let name = args
        .config
        .as_deref()
        .unwrap_or("package://fuyu/config/servicing.yaml");
    let scenario = Scenario::read(name).map_err(Failure::Input)?;
    let (mut process, _) = Process::from_env(ros_args, Reach::Localhost).map_err(failure)?;
    let scenario = scenario.with_arguments(process.args().clone());
    // Before any node runs: a bag that is begun and a graph that comes and goes would mislead.
    scenario.check().map_err(Failure::Input)?;
    let plan = Plan::new(args, &scenario).map_err(Failure::Input)?;
    process.set_args(plan.arguments(&scenario));
    let progress = Arc::new(Progress::default());
    let started = start(&mut process, &scenario, &plan, &progress);
    if started.is_ok() {
        watch(&mut process, &plan, &progress);
    }
    let finished = process.finish();
    started.and(finished).map_err(failure)?;
    print(&summary(&scenario, &plan, &progress))
}

fn failure(error: NodeError) -> Failure {
    match error.exit_code() {
        2 => Failure::Input(error.to_string()),
        _ => Failure::Runtime(error.to_string()),
    }
}

/// What is to be run.
struct Plan {
    /// Nodes in the order of their start.
    nodes: Vec<(NodeName, nodes::Program)>,
    /// Simulated time after which it ends \[s\]; zero is never.
    duration: f64,
    lockstep: bool,
    bag: Option<PathBuf>,
}

impl Plan {
    fn new(args: &Args, scenario: &Scenario) -> Result<Self, String> {
        let named = scenario.nodes();
        let mut nodes = Vec::new();
        for (name, program) in nodes::NODES {
            nodes.extend(
                named
                    .iter()
                    .filter(|n| n.name() == name)
                    .map(|n| (n.clone(), program)),
            );
        }
        let has = |name: &str| named.iter().any(|n| n.name() == name);
        let mut duration = args.duration;
        if has("dynamics") {
            duration = duration.or(Some(scenario.dynamics()?.duration));
        }
        let bag = if has("recorder") {
            let given = args.bag.clone().or(scenario.recorder()?.bag);
            Some(given.unwrap_or_else(|| recorder::new_folder(&scenario.name())))
        } else {
            None
        };
        if args.bag.is_some() && bag.is_none() {
            let path = scenario.path().display();
            return Err(format!("--bag: {path} names no recorder to write a bag"));
        }
        if args.lockstep && has("camera") {
            let quality = scenario.camera()?.quality;
            if quality.rate != 0.0 || quality.latency != 0.0 || quality.dropout != 0.0 {
                let path = scenario.path().display();
                return Err(format!(
                    "--lockstep: {path}: the camera must answer every state at once; its rate, latency and dropout must be 0.0"
                ));
            }
        }
        Ok(Self {
            nodes,
            duration: duration.unwrap_or(0.0),
            lockstep: args.lockstep,
            bag,
        })
    }

    /// The process's ROS arguments, with the scenario and what the command line says of it.
    fn arguments(&self, scenario: &Scenario) -> RosArgs {
        let mut arguments = scenario.arguments().clone();
        let mut set = |node: &str, name: &str, value: ParameterValue| {
            arguments.parameters.push(ParameterSource::Value {
                node: Some(node.to_owned()),
                name: name.to_owned(),
                value,
            });
        };
        set(
            "dynamics",
            "duration",
            ParameterValue::Double(self.duration),
        );
        if self.lockstep {
            set("dynamics", "lockstep", ParameterValue::Bool(true));
            set("controller", "lockstep", ParameterValue::Bool(true));
            set("dynamics", "real_time_factor", ParameterValue::Double(0.0));
        }
        if let Some(bag) = &self.bag {
            set(
                "recorder",
                "bag",
                ParameterValue::String(bag.display().to_string()),
            );
        }
        arguments
    }
}

fn start(
    process: &mut Process,
    scenario: &Scenario,
    plan: &Plan,
    progress: &Arc<Progress>,
) -> Result<(), NodeError> {
    let names: Vec<_> = plan.nodes.iter().map(|(name, _)| name.full()).collect();
    tracing::info!(
        "{}: {} on DDS domain {}",
        scenario.path().display(),
        names.join(", "),
        process.domain().id
    );
    let (args, domain) = (Arc::new(process.args().clone()), process.domain());
    let options = |name: &str, namespace: &str| NodeOptions {
        name: name.to_owned(),
        namespace: namespace.to_owned(),
        args: Arc::clone(&args),
        domain,
    };
    for (name, program) in &plan.nodes {
        process.start_with(options(name.name(), name.namespace()), *program)?;
    }
    let namespace = plan.nodes.last().map_or("/", |(name, _)| name.namespace());
    let options = options("launch_monitor", namespace);
    let (shared, duration) = (Arc::clone(progress), plan.duration);
    process.start_with(options, move |node| monitor(node, duration, &shared))?;
    Ok(())
}

/// What the monitor has learnt of the run.
#[derive(Debug, Default)]
struct Progress {
    over: AtomicBool,
    seen: Mutex<Seen>,
}

#[derive(Debug, Default, Clone)]
struct Seen {
    /// Simulated time when it was first seen to run, and when that was.
    start: Option<(f64, Instant)>,
    /// The last.
    last: Option<(f64, Instant)>,
    /// Position and attitude error \[m, rad\].
    error: Option<(f64, f64)>,
}

impl Progress {
    fn see(&self, change: impl FnOnce(&mut Seen)) {
        change(&mut self.seen.lock().unwrap_or_else(PoisonError::into_inner));
    }

    fn seen(&self) -> Seen {
        self.seen
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .clone()
    }
}

/// A node that learns of the run as anybody can: from its topics. It ends when the duration is over.
fn monitor(node: &Node, duration: f64, progress: &Progress) -> Result<(), NodeError> {
    let clock = node.subscribe::<Clock>("/clock", Qos::CLOCK_SUBSCRIPTION)?;
    let state = node.subscribe::<ControllerState>("controller/state", Qos::RELIABLE.depth(1))?;
    while node.wait_for(Duration::from_millis(200)) {
        if let Some(received) = state.latest() {
            let message = received.message;
            let error = (message.position_error_norm, message.attitude_error_angle);
            progress.see(|seen| seen.error = Some(error));
        }
        if let Some(received) = clock.latest() {
            let time = Time::from(received.message.clock).as_secs_f64();
            let now = Instant::now();
            progress.see(|seen| {
                // Time that stands still has not begun.
                if time > 0.0 && seen.last.is_none_or(|(last, _)| time > last) {
                    seen.start.get_or_insert((time, now));
                    seen.last = Some((time, now));
                }
            });
            if duration > 0.0 && time >= duration - 1e-9 {
                progress.over.store(true, Ordering::Release);
                return Ok(());
            }
        }
    }
    Ok(())
}

/// Shows how the run goes until there is a reason to stop.
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
    let mut told = Instant::now();
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
        if let Some((position, attitude)) = seen.error {
            let _ = write!(
                line,
                ", tip error {position:.4} m, {:.2} deg",
                attitude.to_degrees()
            );
        }
        bar.set_message(line.clone());
        if !terminal && told.elapsed() > Duration::from_secs(10) {
            tracing::info!("{line}");
            told = Instant::now();
        }
        if !warned && seen.last.is_none() && begin.elapsed() > Duration::from_secs(5) {
            tracing::warn!("simulated time does not run: is a controller missing?");
            warned = true;
        }
    }
    bar.finish_and_clear();
}

/// What there is to say at the end.
fn summary(scenario: &Scenario, plan: &Plan, progress: &Progress) -> String {
    let seen = progress.seen();
    let mut out = String::new();
    let mut row = |label: &str, value: String| {
        // Writing to a string cannot fail.
        let _ = writeln!(out, "{label:<24}{value}");
    };
    let run = if progress.over.load(Ordering::Acquire) {
        "done"
    } else {
        "stopped"
    };
    row(&scenario.name(), run.to_owned());
    if let (Some((t0, w0)), Some((t1, w1))) = (seen.start, seen.last) {
        let wall = w1.duration_since(w0).as_secs_f64();
        let factor = if wall > 0.0 { (t1 - t0) / wall } else { 0.0 };
        row(
            "simulated time",
            format!("{t1:.2} s, real-time factor {factor:.3}"),
        );
    }
    let Some(folder) = &plan.bag else { return out };
    let bag = match Bag::open(folder) {
        Ok(bag) => bag,
        Err(problem) => {
            row("bag", problem.to_string());
            return out;
        }
    };
    let mut runs = RecordedRuns::default();
    let mut messages = 0u64;
    for message in bag.messages() {
        messages += 1;
        runs.accept(&message);
    }
    for (_, run) in runs.robots() {
        describe(run, &mut row);
    }
    row("bag", format!("{} ({messages} messages)", folder.display()));
    out
}

fn describe(run: &RecordedRun, row: &mut impl FnMut(&str, String)) {
    if let Some(last) = run.controller.last() {
        row(
            "tip position error",
            format!("{:.3e} m", last.position_error),
        );
        row(
            "tip attitude error",
            format!("{:.3e} rad", last.attitude_error),
        );
    }
    if let (Some(first), Some(last)) = (run.base.first(), run.base.last()) {
        let moved = last.X_WB.translation.vector - first.X_WB.translation.vector;
        row(
            "base displacement",
            format!("{:.4}, {:.4}, {:.4} m", moved.x, moved.y, moved.z),
        );
        let angles = roll_pitch_yaw_intrinsic(&last.X_WB.rotation.to_rotation_matrix());
        let [roll, pitch, yaw] = angles.map(f64::to_degrees);
        row(
            "base roll, pitch, yaw",
            format!("{roll:.3}, {pitch:.3}, {yaw:.3} deg"),
        );
    }
    if let Some(residuals) = momentum_residuals(run) {
        let [linear, angular] = residuals.map(|r| r.values.iter().fold(0.0, |m, v| v.1.max(m)));
        row(
            "momentum residual",
            format!("{linear:.1e} linear, {angular:.1e} angular"),
        );
    }
}
