//! `fuyu campaign`: runs a scenario many times, with parameters that differ from run to run.

mod dask;
mod report;
mod run;

use std::path::PathBuf;

use super::{Failure, print};
use crate::experiments::campaign::{self, CampaignError, Dataset, Summary, serve_worker};

/// Runs a scenario many times with dispersed parameters, and evaluates the results.
#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, clap::Subcommand)]
enum Action {
    Run(run::Args),
    RunRange(run::RangeArgs),
    Show(ShowArgs),
    Summary(SummaryArgs),
    #[command(hide = true)]
    Worker(WorkerArgs),
}

/// Prints the scenario of a run, which `fuyu simulate` repeats to the bit
#[derive(Debug, clap::Args)]
struct ShowArgs {
    /// Folder of the campaign
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// Number of the run, from 0
    #[arg(long, value_name = "N")]
    run: u64,
}

/// Prints statistics of the runs that are done
///
/// Success rate with confidence interval, quantiles of the results, worst runs, rank correlations of results with parameters.
#[derive(Debug, clap::Args)]
struct SummaryArgs {
    /// Folder of the campaign
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// Confidence of the interval of the success rate
    #[arg(long, value_name = "P", default_value = "0.95", value_parser = confidence)]
    confidence: f64,
    /// Draw pictures (SVG, PNG) into DIR/plots
    #[arg(long)]
    plots: bool,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// Computes runs for another process, which writes their numbers to stdin and reads rows from stdout
#[derive(Debug, clap::Args)]
struct WorkerArgs {
    /// Folder of the campaign
    #[arg(value_name = "DIR")]
    folder: PathBuf,
}

/// A number between zero and one.
fn confidence(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(p) if p > 0.0 && p < 1.0 => Ok(p),
        _ => Err("give a number between 0 and 1, such as 0.95".to_owned()),
    }
}

impl From<CampaignError> for Failure {
    fn from(error: CampaignError) -> Self {
        match error {
            CampaignError::Input(text) => Self::Input(text),
            CampaignError::Runtime(text) => Self::Runtime(text),
        }
    }
}

/// Runs the command.
///
/// # Errors
/// [`Failure::Input`] for an invalid file, folder or argument, [`Failure::Runtime`] if the dataset cannot be written or
/// read.
pub fn run(args: Args) -> Result<(), Failure> {
    match args.action {
        Action::Run(args) => run::run(&args),
        Action::RunRange(args) => run::run_range(&args),
        Action::Show(args) => show(&args),
        Action::Summary(args) => summary(&args),
        Action::Worker(args) => Ok(serve_worker(&args.folder)?),
    }
}

fn show(args: &ShowArgs) -> Result<(), Failure> {
    let campaign = Dataset::open(&args.folder)?.campaign()?;
    if args.run >= campaign.runs() {
        return Err(Failure::Input(format!(
            "--run {}: the campaign has runs 0 to {}",
            args.run,
            campaign.runs() - 1
        )));
    }
    let text = campaign.scenario_text_of(args.run)?;
    let (name, seed) = (campaign.name(), campaign.seed_of(args.run));
    print(&format!(
        "# Run {} of the campaign {name}, seed {seed}.\n{text}",
        args.run
    ))
}

fn summary(args: &SummaryArgs) -> Result<(), Failure> {
    let dataset = Dataset::open(&args.folder)?;
    let summary = Summary::of(&dataset, args.confidence)?;
    let mut pictures = Vec::new();
    if args.plots {
        pictures = campaign::plot(&dataset, &summary, &args.folder.join("plots"))?;
    }
    print_summary(&summary, args.json)?;
    for picture in pictures.iter().filter(|_| !args.json) {
        print(&format!("{}\n", picture.display()))?;
    }
    Ok(())
}

fn print_summary(summary: &Summary, json: bool) -> Result<(), Failure> {
    print(&match json {
        true => {
            let json = serde_json::to_string(summary);
            json.map_err(|e| Failure::Runtime(e.to_string()))? + "\n"
        }
        false => report::text(summary),
    })
}
