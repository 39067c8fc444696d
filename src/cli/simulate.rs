//! `fuyu simulate`: a scenario's closed loop without DDS.

mod tables;

use std::{path::PathBuf, time::Instant};

use super::{Failure, print};
use crate::{
    experiments::{
        Fleet, MissionSummary, Summary, check_robots, mission_lines, notes,
        simulation::{self, Observed},
        warnings,
    },
    nodes::scenario::Scenario,
};
use tables::{table, table_of_parts};

/// Simulates a scenario without DDS, as fast as possible; the same scenario gives bit-identical
/// results.
#[derive(clap::Args)]
pub struct Args {
    /// Scenario: a ROS 2 parameter file
    #[arg(value_name = "CONFIG")]
    config: String,
    /// Simulated time instead of the scenario's [s]
    #[arg(long, value_name = "S", value_parser = super::positive_seconds, allow_hyphen_values = true)]
    duration: Option<f64>,
    /// Write the run as a bag into this new folder
    #[arg(long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// Runs the command.
///
/// # Errors
/// [`Failure::Input`] for an invalid scenario or output folder, [`Failure::Runtime`] when the state becomes non-finite or
/// the bag cannot be written, [`Failure::Check`] if a mission does not capture its target.
pub fn run(args: &Args) -> Result<(), Failure> {
    let scenario = Scenario::read(&args.config).map_err(Failure::Input)?;
    scenario.check().map_err(Failure::Input)?;
    check_robots(&scenario).map_err(Failure::Input)?;
    let mut fleet = Fleet::new(&scenario).map_err(Failure::Input)?;
    for note in notes(&scenario, &fleet) {
        eprintln!("fuyu: note: {note}");
    }
    for warning in scenario.warnings(true) {
        eprintln!("fuyu: warning: {warning}");
    }
    let duration = simulation::duration_of(&fleet, args.duration);
    let mut bag = match &args.output {
        None => None,
        Some(folder) => {
            let bag = simulation::create_bag(&scenario, &fleet, folder);
            Some(bag.map_err(Failure::Input)?)
        }
    };
    let start = Instant::now();
    let observed = simulation::simulate(&mut fleet, duration, bag.as_mut(), |_, _| Ok(()));
    let wall_time = start.elapsed().as_secs_f64();
    // The bag contains a run that stopped early up to that point.
    let finished = bag.map(|bag| bag.finish().map_err(|e| Failure::Runtime(e.to_string())));
    let observed = observed.map_err(|stop| Failure::Runtime(stop.describe(&scenario)))?;
    for warning in warnings(&scenario, &fleet, &observed) {
        eprintln!("fuyu: warning: {warning}");
    }
    finished.transpose()?;
    let summaries = simulation::summaries(&fleet, &observed, wall_time);
    print(&match args.json {
        true => {
            let json = simulation::results_text(&fleet, &observed, &summaries);
            json.map_err(|e| Failure::Runtime(e.to_string()))? + "\n"
        }
        false => text(&scenario.name(), &fleet, &observed, &summaries),
    })?;
    check_missions(&scenario, &fleet, args.duration.is_some())
}

/// An error if a mission did not capture its target, unless it is unfinished because the run was shortened.
fn check_missions(scenario: &Scenario, fleet: &Fleet, is_shorter: bool) -> Result<(), Failure> {
    for (i, (_, closed_loop)) in fleet.robots().enumerate() {
        let Some(capturing) = closed_loop.capturing() else {
            continue;
        };
        let summary = MissionSummary::new(capturing, &closed_loop.world);
        if summary.end.is_none() && is_shorter {
            continue;
        }
        if let Some(failure) = summary.failure() {
            let path = scenario.path().display();
            return Err(Failure::Check(format!(
                "{path}: {}",
                fleet.of_robot(i, &failure)
            )));
        }
    }
    Ok(())
}

/// A table per robot, headed by its namespace, or by `scenario` if there is only one robot.
fn text(scenario: &str, fleet: &Fleet, observed: &[Observed], summaries: &[Summary]) -> String {
    let runs = fleet.robots().zip(summaries).zip(observed);
    let tables = runs.map(|(((namespace, closed_loop), summary), observed)| {
        let name = match summaries.len() {
            1 => scenario,
            _ => namespace,
        };
        let parts = table_of_parts(&closed_loop.world, observed.events.events());
        let capturing = closed_loop.capturing();
        let mission = capturing.map(|capturing| mission_lines(capturing, &closed_loop.world));
        table(name, summary) + &parts + &mission.unwrap_or_default()
    });
    tables.collect::<Vec<_>>().join("\n")
}
