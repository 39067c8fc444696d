//! `fuyu simulate` of a scenario with several robots.

use std::{collections::BTreeMap, time::Instant};

use serde::Serialize;

use super::{Args, Report, Stop, table, table_of_parts};
use crate::{
    cli::{Failure, print},
    control::ConvergenceFailure,
    experiments::{EventWatch, Fleet, Performance, Recorded, SimulatedBag},
    nodes::scenario::Scenario,
};

/// The figures of all robots, as JSON.
#[derive(Serialize)]
struct Reports<'a> {
    /// By namespace.
    robots: BTreeMap<&'a str, Report<'a>>,
}

/// What is known of a robot's run.
struct Observed {
    performance: Performance,
    events: EventWatch,
    /// Since when and why its tip does not converge, if it does not at the end.
    trouble: Option<(f64, ConvergenceFailure)>,
}

/// Simulates all robots of `scenario`.
///
/// # Errors
/// As [`super::run`].
pub fn run(args: &Args, scenario: &Scenario) -> Result<(), Failure> {
    let mut fleet = Fleet::new(scenario).map_err(Failure::Input)?;
    let path = scenario.path().display();
    for (namespace, closed_loop) in fleet.robots() {
        if let Some(missing) = closed_loop.world.not_simulated() {
            eprintln!("fuyu: note: {path}: {namespace}: {missing}");
        }
    }
    for warning in scenario.warnings(true) {
        eprintln!("fuyu: warning: {warning}");
    }
    // The owner of the time may be any of them; one that has a duration ends the run.
    let durations = fleet
        .robots()
        .map(|(_, closed_loop)| closed_loop.duration());
    let given = durations
        .filter(|duration| *duration > 0.0)
        .reduce(f64::min);
    let duration = args.duration.or(given).unwrap_or(60.0);
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
    let observed = observed.map_err(|stop| Failure::Runtime(stop.describe(scenario)))?;
    let wall_time = start.elapsed().as_secs_f64();
    for ((namespace, closed_loop), observed) in fleet.robots().zip(&observed) {
        if let Some((time, trouble)) = &observed.trouble {
            eprintln!("fuyu: warning: {path}: {namespace}: from {time:.2} s on: {trouble}");
        }
        if let Some((time, excess)) = observed.events.deformation_excess() {
            eprintln!("fuyu: warning: {path}: {namespace}: from {time:.2} s on: {excess}");
        }
        let limits = closed_loop.world.default_effort_limits();
        if let (true, Some(limits)) = (closed_loop.was_limited(), limits) {
            eprintln!("fuyu: warning: {path}: {namespace}: efforts were cut: {limits}");
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
    let runs = fleet.robots().zip(&summaries).zip(&observed);
    print(&match args.json {
        true => {
            let reports = runs.map(|(((namespace, closed_loop), summary), observed)| {
                let report = Report::new(&closed_loop.world, summary, &observed.events);
                (namespace, report)
            });
            let robots = reports.collect();
            let json = serde_json::to_string(&Reports { robots });
            json.map_err(|e| Failure::Runtime(e.to_string()))? + "\n"
        }
        false => {
            let tables = runs.map(|(((namespace, closed_loop), summary), observed)| {
                let events = observed.events.events();
                table(namespace, summary) + &table_of_parts(&closed_loop.world, events)
            });
            tables.collect::<Vec<_>>().join("\n")
        }
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
    let mut time = 0.0;
    loop {
        if let Some(bag) = bag.as_deref_mut() {
            bag.time(time)?;
        }
        for (
            i,
            Observed {
                performance,
                events,
                trouble,
            },
        ) in observed.iter_mut().enumerate()
        {
            let closed_loop = fleet.robot(i);
            if let Some(bag) = bag.as_deref_mut() {
                bag.state(i, &mut closed_loop.world)?;
            }
            closed_loop.answer::<Stop>(&mut frames, |world, moment| {
                performance.see(world, moment);
                events.see(world);
                time = world.time();
                *trouble = moment.trouble().map(|now| {
                    let since = trouble.map_or(time, |(since, _)| since);
                    (since, now)
                });
                match bag.as_deref_mut() {
                    Some(bag) => Ok(bag.moment(i, time, moment)?),
                    None => Ok(()),
                }
            })?;
        }
        if time >= duration - 1e-9 {
            return Ok(observed);
        }
        fleet.advance()?;
        time = fleet.robot(0).world.time();
    }
}
