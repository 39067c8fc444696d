//! `fuyu bag`: contents, physical checks, plots, pictures, playback, conversion and recovery of bags.

mod convert;
mod play;
mod recover;
mod render;

use std::fmt::Write;
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::table::{shown, width};
use super::{Failure, print};
use crate::bag::{Bag, BagError, Info};
use crate::experiments::{CheckLimits, CheckLine, CheckReport, Verdict, check_bag, plot_bag};

/// The folder next to `bag` with the name of the bag, an underscore and `suffix`.
fn next_to(bag: &Path, suffix: &str) -> PathBuf {
    // `.` and `..` have no file name; their full paths have one.
    let full = match bag.file_name() {
        Some(_) => bag.to_owned(),
        None => bag.canonicalize().unwrap_or_else(|_| bag.to_owned()),
    };
    let name = full.file_name().unwrap_or_default().to_string_lossy();
    let stem = name.split(".mcap").next().unwrap_or_default();
    full.with_file_name(format!("{stem}_{suffix}"))
}

/// Inspects, checks, plots, draws, plays, converts or recovers a bag
///
/// BAG is a folder in the layout of rosbag2 or a single .mcap file, recorded by fuyu or by rosbag2. A truncated
/// bag (killed recorder, full disk) is read up to its last complete chunk.
#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(subcommand)]
    command: BagCommand,
}

#[derive(Debug, clap::Subcommand)]
enum BagCommand {
    /// Topics, types, counts, times and sizes
    Info(InfoArgs),
    /// Checks momentum, energy, final tip error, gaps, stamps and finite values; exit code 1 if one fails
    Check(CheckArgs),
    /// Plots tip error, base drift, momentum residual, joint rates and the estimate of a target, as SVG and PNG
    Plot(PlotArgs),
    Render(render::RenderArgs),
    Play(play::PlayArgs),
    Convert(convert::ConvertArgs),
    Recover(recover::RecoverArgs),
}

#[derive(Debug, clap::Args)]
struct InfoArgs {
    /// Folder or .mcap file
    bag: PathBuf,
    /// One JSON object on stdout
    #[arg(long)]
    json: bool,
}

#[derive(Debug, clap::Args)]
struct CheckArgs {
    /// Folder or .mcap file
    bag: PathBuf,
    /// Largest final distance of the tip from its goal [m]
    #[arg(long, value_name = "M", default_value_t = CheckLimits::default().position)]
    position_error: f64,
    /// Largest final angle of the tip from its goal [rad]
    #[arg(long, value_name = "RAD", default_value_t = CheckLimits::default().attitude)]
    attitude_error: f64,
    /// Largest relative change of momentum
    #[arg(long, value_name = "RATIO", default_value_t = CheckLimits::default().momentum)]
    momentum: f64,
    /// Largest unexplained fraction of the energy
    #[arg(long, value_name = "RATIO", default_value_t = CheckLimits::default().energy)]
    energy: f64,
    /// One JSON object on stdout
    #[arg(long)]
    json: bool,
}

#[derive(Debug, clap::Args)]
struct PlotArgs {
    /// Folder or .mcap file
    bag: PathBuf,
    /// Folder for the pictures, created if needed; default: the bag's folder
    #[arg(long, value_name = "DIR")]
    output: Option<PathBuf>,
}

/// Runs `fuyu bag`.
///
/// # Errors
/// [`Failure::Input`] if BAG is not a bag, [`Failure::Check`] if a check fails, [`Failure::Runtime`] if a picture or
/// table cannot be written or DDS fails.
pub fn run(args: Args, ros_args: Vec<String>) -> Result<(), Failure> {
    match args.command {
        BagCommand::Play(args) => play::run(&args, ros_args),
        _ if !ros_args.is_empty() => Err(super::no_ros_args()),
        BagCommand::Info(args) => info(&args),
        BagCommand::Check(args) => check(&args),
        BagCommand::Plot(args) => plot(&args),
        BagCommand::Render(args) => render::run(&args),
        BagCommand::Convert(args) => convert::run(&args),
        BagCommand::Recover(args) => recover::run(&args),
    }
}

fn failure(e: BagError) -> Failure {
    Failure::Input(e.to_string())
}

fn json(value: &impl Serialize) -> Result<String, Failure> {
    serde_json::to_string(value)
        .map(|text| text + "\n")
        .map_err(|e| Failure::Runtime(format!("cannot write JSON: {e}")))
}

fn info(args: &InfoArgs) -> Result<(), Failure> {
    let info = Bag::open(&args.bag)
        .and_then(|bag| bag.info())
        .map_err(failure)?;
    if args.json {
        #[derive(Serialize)]
        struct Document<'a> {
            #[serde(flatten)]
            info: &'a Info,
            duration: f64,
        }
        let duration = info.duration_ns() as f64 * 1e-9;
        let info = &info;
        return print(&json(&Document { info, duration })?);
    }
    print(&info_for_people(&info))
}

fn info_for_people(info: &Info) -> String {
    let mut out = String::new();
    let mut line = |name: &str, text: String| {
        let _ = writeln!(out, "{:<13}{text}", format!("{name}:"));
    };
    line("Bag", info.path.display().to_string());
    line("Files", info.files.join(", "));
    line("Size", bytes(info.size));
    line("Compression", info.compression.clone());
    if let Some(distro) = &info.ros_distro {
        line("ROS distro", distro.clone());
    }
    line(
        "Duration",
        format!("{:.3} s", info.duration_ns() as f64 * 1e-9),
    );
    if let (Some(start), Some(end)) = (info.start_ns, info.end_ns) {
        line("Start", instant(start));
        line("End", instant(end));
    }
    line("Messages", info.messages.to_string());
    if info.complete {
        let ending = match info.has_metadata {
            true => "closed and indexed",
            false => "closed and indexed, no metadata.yaml",
        };
        line("Condition", ending.into());
    }
    for damage in &info.damage {
        line("Condition", damage.to_string());
    }
    line("Topics", info.topics.len().to_string());
    let rows: Vec<_> = (info.topics.iter())
        .map(|t| (t, shown(&t.name), shown(&t.type_name)))
        .collect();
    let name = width(rows.iter().map(|r| r.1.as_str()));
    let kind = width(rows.iter().map(|r| r.2.as_str()));
    for (t, topic, type_name) in &rows {
        let qos = t.qos.first().map_or(String::new(), |q| {
            format!("{}, {}", q.reliability.as_str(), q.durability.as_str())
        });
        let row = format!(
            "  {:name$}  {:kind$}  {:>9}  {qos}",
            topic, type_name, t.count
        );
        let _ = writeln!(out, "{}", row.trim_end());
    }
    out
}

fn bytes(n: u64) -> String {
    match n {
        0..10_000 => format!("{n} B"),
        10_000..10_000_000 => format!("{:.1} kB", n as f64 / 1e3),
        10_000_000..10_000_000_000 => format!("{:.1} MB", n as f64 / 1e6),
        _ => format!("{:.1} GB", n as f64 / 1e9),
    }
}

/// A time stamp: as a date if it is a plausible wall time, otherwise as simulated time.
fn instant(nanos: u64) -> String {
    const YEAR_2000: u64 = 946_684_800;
    let (sec, nsec) = (nanos / 1_000_000_000, nanos % 1_000_000_000);
    let date = i64::try_from(sec)
        .ok()
        .filter(|_| sec >= YEAR_2000)
        .and_then(|s| chrono::DateTime::from_timestamp(s, nsec as u32));
    match date {
        Some(date) => format!(
            "{} ({sec}.{nsec:09})",
            date.format("%Y-%m-%d %H:%M:%S%.3f UTC")
        ),
        None => format!("{sec}.{nsec:09} s"),
    }
}

fn check(args: &CheckArgs) -> Result<(), Failure> {
    let limits = CheckLimits {
        momentum: positive("--momentum", args.momentum)?,
        energy: positive("--energy", args.energy)?,
        position: positive("--position-error", args.position_error)?,
        attitude: positive("--attitude-error", args.attitude_error)?,
        ..CheckLimits::default()
    };
    let bag = Bag::open(&args.bag).map_err(failure)?;
    let report = check_bag(&bag, &limits);
    if args.json {
        print(&json(&report)?)?;
    } else {
        print(&report_for_people(&report))?;
    }
    if report.passed {
        return Ok(());
    }
    let failed: Vec<&str> = report
        .checks
        .iter()
        .filter(|c| c.verdict == Verdict::Failed)
        .map(|c| c.name.as_str())
        .collect();
    Err(Failure::Check(format!(
        "bag {}: {} of {} checks failed: {}",
        report.bag,
        failed.len(),
        report.checks.len(),
        failed.join("; ")
    )))
}

fn positive(option: &str, value: f64) -> Result<f64, Failure> {
    if value > 0.0 {
        return Ok(value);
    }
    Err(Failure::Input(format!(
        "{option} {value}: a limit must be positive"
    )))
}

fn report_for_people(report: &CheckReport) -> String {
    let mut out = format!("Bag: {}\n", report.bag);
    let rows: Vec<_> = (report.checks.iter())
        .map(|c| (c, shown(&c.name), values(c)))
        .collect();
    let name = width(rows.iter().map(|r| r.1.as_str()));
    let found = width(rows.iter().map(|r| r.2.as_str()));
    for (c, check, values) in &rows {
        let verdict = match c.verdict {
            Verdict::Passed => "passed",
            Verdict::Failed => "FAILED",
            Verdict::Skipped => "skipped",
            Verdict::Noted => "noted",
        };
        let _ = writeln!(
            out,
            "  {verdict:7}  {check:name$}  {values:found$}  {}",
            c.detail
        );
    }
    let _ = writeln!(
        out,
        "{}",
        if report.passed {
            "All checks passed."
        } else {
            "Not all checks passed."
        }
    );
    out
}

fn values(line: &CheckLine) -> String {
    let (Some(value), Some(limit)) = (line.value, line.limit) else {
        return String::new();
    };
    let number = |v: f64| match v.abs() {
        0.0 => "0".to_owned(),
        0.01..1000.0 => format!("{v:.4}"),
        _ => format!("{v:.1e}"),
    };
    let unit = match line.unit {
        "" => String::new(),
        unit => format!(" {unit}"),
    };
    format!("{}{unit} (limit {}{unit})", number(value), number(limit))
}

fn plot(args: &PlotArgs) -> Result<(), Failure> {
    let bag = Bag::open(&args.bag).map_err(failure)?;
    let folder = picture_folder(&args.bag, args.output.as_deref())?;
    let pictures = plot_bag(&bag, &folder).map_err(|e| Failure::Runtime(e.to_string()))?;
    if pictures.is_empty() {
        return Err(Failure::Input(format!(
            "bag {}: nothing to plot: no controller/state, ground_truth/odom, ground_truth/momentum, joint_states or estimator/motion",
            args.bag.display()
        )));
    }
    print(&list_of(&pictures))
}

/// The folder for pictures of a bag, created if needed: `output`, or the bag's folder.
fn picture_folder(bag: &Path, output: Option<&Path>) -> Result<PathBuf, Failure> {
    let folder = match output {
        Some(folder) => folder.to_owned(),
        None if bag.is_dir() => bag.to_owned(),
        None => bag.parent().map(PathBuf::from).unwrap_or_default(),
    };
    std::fs::create_dir_all(&folder).map_err(|e| {
        Failure::Input(format!(
            "--output {}: cannot be created: {e}",
            folder.display()
        ))
    })?;
    Ok(folder)
}

fn list_of(paths: &[PathBuf]) -> String {
    let lines = paths.iter().map(|p| format!("{}\n", p.display()));
    lines.collect()
}
