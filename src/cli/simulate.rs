//! `fuyu simulate`: a scenario's closed loop without DDS.

mod mission;
mod tables;

use std::{collections::BTreeMap, path::PathBuf, time::Instant};

use serde::Serialize;

use super::{Failure, print};
use crate::{
    bag::BagError,
    control::ConvergenceFailure,
    experiments::{
        ClosedLoop, Event, EventWatch, FinalState, Fleet, Performance, Recorded, SimulatedBag, Summary,
    },
    nodes::scenario::Scenario,
};
use tables::{table, table_of_parts};

/// Simulated time of a scenario that states none \[s\].
const DEFAULT_DURATION: f64 = 60.0;

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

/// What `--json` prints of a robot.
#[derive(Serialize)]
struct Report<'a> {
    #[serde(flatten)]
    summary: &'a Summary,
    r#final: FinalState,
    events: &'a [Event],
    #[serde(skip_serializing_if = "Option::is_none")]
    mission: Option<Vec<mission::PhaseSummary>>,
}

impl<'a> Report<'a> {
    fn new(closed_loop: &ClosedLoop, summary: &'a Summary, events: &'a EventWatch) -> Self {
        let world = &closed_loop.world;
        Self {
            summary,
            r#final: FinalState::of(world),
            events: events.events(),
            mission: closed_loop.mission().map(mission::phases),
        }
    }
}

/// What `--json` prints of several robots.
#[derive(Serialize)]
struct Reports<'a> {
    /// By namespace.
    robots: BTreeMap<&'a str, Report<'a>>,
}

/// What is observed of a robot's run.
struct Observed {
    performance: Performance,
    events: EventWatch,
    /// Since when and why its tip does not converge, if it does not at the end.
    trouble: Option<(f64, ConvergenceFailure)>,
}

/// Reasons for stopping a simulation.
enum Stop {
    Physics(String),
    Bag(BagError),
}

impl Stop {
    /// A line for the user.
    fn describe(self, scenario: &Scenario) -> String {
        match self {
            Self::Physics(problem) => format!("{}: {problem}", scenario.path().display()),
            Self::Bag(problem) => problem.to_string(),
        }
    }
}

impl From<String> for Stop {
    fn from(problem: String) -> Self {
        Self::Physics(problem)
    }
}

impl From<BagError> for Stop {
    fn from(problem: BagError) -> Self {
        Self::Bag(problem)
    }
}

/// Runs the command.
///
/// # Errors
/// [`Failure::Input`] for an invalid scenario or output folder, [`Failure::Runtime`] when the state becomes non-finite or
/// the bag cannot be written.
pub fn run(args: &Args) -> Result<(), Failure> {
    let scenario = Scenario::read(&args.config).map_err(Failure::Input)?;
    scenario.check().map_err(Failure::Input)?;
    if scenario.robots().len() == 1 && scenario.has_several_robots() {
        return Err(Failure::Input(format!(
            "{}: parameter robots of the dynamics node names other robots, but the scenario has no other dynamics node to simulate",
            scenario.path().display()
        )));
    }
    let mut fleet = Fleet::new(&scenario).map_err(Failure::Input)?;
    let path = scenario.path().display();
    for (i, (_, closed_loop)) in fleet.robots().enumerate() {
        if let Some(missing) = closed_loop.world.not_simulated() {
            eprintln!("fuyu: note: {path}: {}", fleet.of_robot(i, missing));
        }
    }
    for warning in scenario.warnings(true) {
        eprintln!("fuyu: warning: {warning}");
    }
    let given = Some(fleet.duration()).filter(|duration| *duration > 0.0);
    let duration = args.duration.or(given).unwrap_or(DEFAULT_DURATION);
    let mut bag = match &args.output {
        None => None,
        Some(folder) => {
            let descriptions = fleet.robots().map(|(namespace, _)| {
                let robot = scenario.of_robot(namespace).dynamics();
                robot.map(|dynamics| dynamics.robot.xml)
            });
            let descriptions: Vec<_> = descriptions
                .collect::<Result<_, _>>()
                .map_err(Failure::Input)?;
            let robots = fleet.robots().zip(&descriptions);
            let robots = robots.map(|((namespace, run), description)| Recorded {
                namespace,
                run,
                description,
            });
            let bag = SimulatedBag::create(folder, &robots.collect::<Vec<_>>());
            Some(bag.map_err(|e| Failure::Input(e.to_string()))?)
        }
    };
    let start = Instant::now();
    let observed = simulate(&mut fleet, duration, bag.as_mut());
    let observed = observed.map_err(|stop| Failure::Runtime(stop.describe(&scenario)))?;
    let wall_time = start.elapsed().as_secs_f64();
    for (i, ((_, closed_loop), observed)) in fleet.robots().zip(&observed).enumerate() {
        let warn = |text: &str| eprintln!("fuyu: warning: {path}: {}", fleet.of_robot(i, text));
        if let Some((time, trouble)) = &observed.trouble {
            warn(&format!("from {time:.2} s on: {trouble}"));
        }
        if let Some((time, excess)) = observed.events.deformation_excess() {
            warn(&format!("from {time:.2} s on: {excess}"));
        }
        let limits = closed_loop.world.default_effort_limits();
        if let (true, Some(limits)) = (closed_loop.was_limited(), limits) {
            warn(&format!("efforts were cut: {limits}"));
        }
    }
    if let Some(bag) = bag {
        bag.finish().map_err(|e| Failure::Runtime(e.to_string()))?;
    }
    let summaries = fleet.robots().zip(&observed);
    let summaries = summaries.map(|((_, closed_loop), observed)| {
        (observed.performance).summary(&closed_loop.world, wall_time)
    });
    let summaries: Vec<_> = summaries.collect();
    print(&match args.json {
        true => json(&fleet, &observed, &summaries).map_err(|e| Failure::Runtime(e.to_string()))?,
        false => text(&scenario.name(), &fleet, &observed, &summaries),
    })
}

fn simulate(
    fleet: &mut Fleet,
    duration: f64,
    mut bag: Option<&mut SimulatedBag>,
) -> Result<Vec<Observed>, Stop> {
    let observed = fleet.robots().map(|(_, closed_loop)| Observed {
        performance: Performance::new(&closed_loop.world),
        events: EventWatch::default(),
        trouble: None,
    });
    let mut observed: Vec<_> = observed.collect();
    let mut frames = Vec::new();
    loop {
        let time = fleet.time();
        if let Some(bag) = bag.as_deref_mut() {
            bag.time(time)?;
        }
        for (i, seen) in observed.iter_mut().enumerate() {
            let Observed {
                performance,
                events,
                trouble,
            } = seen;
            let closed_loop = fleet.robot(i);
            if let Some(bag) = bag.as_deref_mut() {
                bag.state(i, &mut closed_loop.world)?;
            }
            let answered = closed_loop.answer::<Stop>(&mut frames, |world, moment| {
                performance.see(world, moment);
                events.see(world);
                *trouble = moment.trouble().map(|now| {
                    let since = trouble.map_or(time, |(since, _)| since);
                    (since, now)
                });
                match bag.as_deref_mut() {
                    Some(bag) => Ok(bag.moment(i, time, moment)?),
                    None => Ok(()),
                }
            });
            answered.map_err(|stop| match stop {
                Stop::Physics(problem) => Stop::Physics(fleet.of_robot(i, &problem)),
                stop => stop,
            })?;
        }
        if time >= duration - 1e-9 {
            return Ok(observed);
        }
        fleet.advance()?;
    }
}

/// One object of a robot, or one with the robots by namespace if there are several.
fn json(
    fleet: &Fleet,
    observed: &[Observed],
    summaries: &[Summary],
) -> Result<String, serde_json::Error> {
    let runs = fleet.robots().zip(summaries).zip(observed);
    let robots: BTreeMap<_, _> = runs
        .map(|(((namespace, closed_loop), summary), observed)| {
            let report = Report::new(closed_loop, summary, &observed.events);
            (namespace, report)
        })
        .collect();
    let json = match robots.len() {
        1 => serde_json::to_string(&robots.into_values().next()),
        _ => serde_json::to_string(&Reports { robots }),
    };
    Ok(json? + "\n")
}

/// A table per robot, headed by its namespace; by `scenario` if there is only one.
fn text(scenario: &str, fleet: &Fleet, observed: &[Observed], summaries: &[Summary]) -> String {
    let runs = fleet.robots().zip(summaries).zip(observed);
    let tables = runs.map(|(((namespace, closed_loop), summary), observed)| {
        let name = match summaries.len() {
            1 => scenario,
            _ => namespace,
        };
        let parts = table_of_parts(&closed_loop.world, observed.events.events());
        let phases = closed_loop.mission().map(mission::lines);
        table(name, summary) + &parts + &phases.unwrap_or_default()
    });
    tables.collect::<Vec<_>>().join("\n")
}
