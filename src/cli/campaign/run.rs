//! `fuyu campaign run` and `run-range`.

use std::{
    io::IsTerminal,
    num::NonZeroUsize,
    ops::ControlFlow,
    path::PathBuf,
    time::{Duration, Instant},
};

use indicatif::{ProgressBar, ProgressStyle};

use super::{dask, print_summary};
use crate::{
    cli::Failure,
    experiments::campaign::{
        Campaign, Dataset, Progress, RangeOptions, Summary, Workers, run_range as compute,
    },
};

/// Confidence level of the interval printed at the end.
const CONFIDENCE: f64 = 0.95;

/// Period of progress reports if stderr is not a terminal.
const REPORT_PERIOD: Duration = Duration::from_secs(30);

/// Computes the runs of a campaign that its folder lacks, and prints statistics
///
/// After a kill the same command continues. Results are in DIR/results/*.parquet, wall times in DIR/wall_time.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Campaign: a YAML file, such as config/campaigns/positioning.yaml
    #[arg(value_name = "CONFIG")]
    config: String,
    /// Folder of the campaign: a new one, or one to continue
    #[arg(long, value_name = "DIR")]
    output: PathBuf,
    /// Number of runs instead of the campaign's
    #[arg(long, value_name = "N")]
    runs: Option<u64>,
    /// Runs at the same time; default: the number of processors
    #[arg(long, value_name = "N")]
    jobs: Option<NonZeroUsize>,
    /// Where to compute: on this machine, or by the workers of a Dask scheduler
    #[arg(long, value_enum, default_value = "local")]
    engine: Engine,
    /// Address of the Dask scheduler, such as tcp://127.0.0.1:8786
    #[arg(long, value_name = "A")]
    address: Option<String>,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Engine {
    Local,
    Dask,
}

/// Computes some runs of a campaign into its folder, which other processes may fill at the same time
///
/// For Slurm arrays, Dask and the like. Tables are complete when all of their runs are, whoever computed them.
#[derive(Debug, clap::Args)]
pub(super) struct RangeArgs {
    /// Campaign: a YAML file
    #[arg(value_name = "CONFIG")]
    config: String,
    /// Folder of the campaign
    #[arg(long, value_name = "DIR")]
    output: PathBuf,
    /// First run, from 0
    #[arg(long, value_name = "A")]
    first: u64,
    /// Last run, included
    #[arg(long, value_name = "B")]
    last: u64,
    /// Number of runs of the whole campaign instead of the file's
    #[arg(long, value_name = "N")]
    runs: Option<u64>,
    /// Runs at the same time
    #[arg(long, value_name = "N", default_value = "1")]
    jobs: NonZeroUsize,
}

fn workers() -> Result<Workers, Failure> {
    let executable = std::env::current_exe();
    let executable = executable
        .map_err(|e| Failure::Runtime(format!("the executable's path is unknown: {e}")))?;
    let command = [executable.into(), "campaign".into(), "worker".into()];
    Ok(Workers::Processes(command.to_vec()))
}

fn processors() -> NonZeroUsize {
    std::thread::available_parallelism().unwrap_or(NonZeroUsize::MIN)
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    match (args.engine, &args.address) {
        (Engine::Local, Some(_)) => {
            return Err(Failure::Input(
                "--address: only --engine dask has a scheduler".to_owned(),
            ));
        }
        (Engine::Dask, None) => {
            return Err(Failure::Input(
                "--engine dask: give the address of the scheduler, as in --address tcp://127.0.0.1:8786"
                    .to_owned(),
            ));
        }
        (Engine::Dask, Some(_)) if args.jobs.is_some() => {
            return Err(Failure::Input(
                "--jobs: with --engine dask, the workers of the scheduler decide; leave it out"
                    .to_owned(),
            ));
        }
        _ => {}
    }
    let campaign = Campaign::load(&args.config, args.runs)?;
    if let (Engine::Dask, Some(address)) = (args.engine, &args.address) {
        dask::check(address)?;
        let dataset = Dataset::create(&campaign, &args.output)?;
        dask::run(address, &dataset)?;
    } else {
        let dataset = Dataset::create(&campaign, &args.output)?;
        let options = RangeOptions {
            jobs: args.jobs.unwrap_or_else(processors).get(),
            workers: workers()?,
        };
        let mut reporter = Reporter::new(campaign.runs());
        compute(
            &campaign,
            &dataset,
            0..=campaign.runs() - 1,
            &options,
            |progress| {
                reporter.see(progress);
                ControlFlow::Continue(())
            },
        )?;
        reporter.finish();
    }
    let dataset = Dataset::open(&args.output)?;
    print_summary(&Summary::of(&dataset, CONFIDENCE)?, args.json)
}

pub(super) fn run_range(args: &RangeArgs) -> Result<(), Failure> {
    let campaign = Campaign::load(&args.config, args.runs)?;
    if args.first > args.last || args.last >= campaign.runs() {
        return Err(Failure::Input(format!(
            "--first {} --last {}: the campaign has runs 0 to {}",
            args.first,
            args.last,
            campaign.runs() - 1
        )));
    }
    let dataset = Dataset::create(&campaign, &args.output)?;
    let options = RangeOptions {
        jobs: args.jobs.get(),
        workers: workers()?,
    };
    compute(
        &campaign,
        &dataset,
        args.first..=args.last,
        &options,
        |_| ControlFlow::Continue(()),
    )?;
    Ok(())
}

/// Reports progress on stderr: a bar on a terminal, otherwise a line from time to time.
struct Reporter {
    bar: ProgressBar,
    is_terminal: bool,
    start: Instant,
    /// Number of runs done before this command.
    before: Option<u64>,
    last: Instant,
}

impl Reporter {
    fn new(runs: u64) -> Self {
        let is_terminal = std::io::stderr().is_terminal();
        let bar = match is_terminal {
            true => ProgressBar::new(runs),
            false => ProgressBar::hidden(),
        };
        let style = ProgressStyle::with_template("{bar:40} {pos} of {len} runs, {msg}");
        bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
        Self {
            bar,
            is_terminal,
            start: Instant::now(),
            before: None,
            last: Instant::now(),
        }
    }

    fn see(&mut self, progress: Progress) {
        let Progress { done, total } = progress;
        let Some(before) = self.before else {
            self.before = Some(done);
            self.bar.set_position(done);
            if done > 0 && done < total {
                eprintln!("fuyu: note: {done} of {total} runs are done already");
            }
            return;
        };
        if done == before {
            return;
        }
        let elapsed = self.start.elapsed().as_secs_f64();
        let rate = (done - before) as f64 / elapsed;
        let remaining = duration_text((total - done) as f64 / rate);
        let message = format!("{rate:.1} per second, {remaining} remaining");
        self.bar.set_position(done);
        self.bar.set_message(message.clone());
        if !self.is_terminal && self.last.elapsed() >= REPORT_PERIOD {
            self.last = Instant::now();
            eprintln!("fuyu: {done} of {total} runs, {message}");
        }
    }

    fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

/// Hours, minutes and seconds.
fn duration_text(seconds: f64) -> String {
    let seconds = seconds.clamp(0.0, 1e9).round() as u64;
    let (hours, minutes, seconds) = (seconds / 3600, seconds / 60 % 60, seconds % 60);
    match (hours, minutes) {
        (0, 0) => format!("{seconds} s"),
        (0, _) => format!("{minutes} min {seconds} s"),
        _ => format!("{hours} h {minutes} min"),
    }
}

#[cfg(test)]
mod tests {
    use super::duration_text;

    #[test]
    fn remaining_time_is_readable() {
        for (seconds, text) in [
            (0.4, "0 s"),
            (59.7, "1 min 0 s"),
            (3725.0, "1 h 2 min"),
            (f64::INFINITY, "277777 h 46 min"),
        ] {
            assert_eq!(duration_text(seconds), text);
        }
    }
}
