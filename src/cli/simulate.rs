//! `fuyu simulate`: a scenario's closed loop without DDS.

mod fleet;

use std::{fmt::Write as _, path::PathBuf, time::Instant};

use serde::Serialize;

use super::{Failure, print};
use crate::{
    bag::BagError,
    control::ConvergenceFailure,
    experiments::{
        ClosedLoop, Event, EventWatch, FinalState, MomentumResidual, Performance, Recorded,
        SimulatedBag, Summary,
    },
    nodes::{
        dynamics::{FreeBody as _, World},
        scenario::Scenario,
    },
};

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
}

impl<'a> Report<'a> {
    fn new(world: &World, summary: &'a Summary, events: &'a EventWatch) -> Self {
        Self {
            summary,
            r#final: FinalState::of(world),
            events: events.events(),
        }
    }
}

/// What a run gives.
struct Outcome {
    performance: Performance,
    events: EventWatch,
    /// Since when the tip has been in trouble, if it is at the end.
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
    if scenario.robots().len() > 1 {
        return fleet::run(args, &scenario);
    }
    if scenario.has_several_robots() {
        return Err(Failure::Input(format!(
            "{}: parameter robots of the dynamics node names other robots, but the scenario has no other dynamics node to simulate",
            scenario.path().display()
        )));
    }
    let mut closed_loop = ClosedLoop::new(&scenario).map_err(Failure::Input)?;
    if let Some(missing) = closed_loop.world.not_simulated() {
        eprintln!("fuyu: note: {}: {missing}", scenario.path().display());
    }
    for warning in scenario.warnings(true) {
        eprintln!("fuyu: warning: {warning}");
    }
    let duration = match args.duration {
        Some(duration) => duration,
        None if closed_loop.duration() > 0.0 => closed_loop.duration(),
        None => 60.0,
    };
    let mut bag = match &args.output {
        None => None,
        Some(folder) => {
            let description = scenario.dynamics().map_err(Failure::Input)?.robot.xml;
            let robot = Recorded {
                namespace: "/",
                run: &closed_loop,
                description: &description,
            };
            let bag = SimulatedBag::create(folder, &[robot]);
            Some(bag.map_err(|e| Failure::Input(e.to_string()))?)
        }
    };
    let start = Instant::now();
    let simulated = simulate(&mut closed_loop, duration, bag.as_mut());
    let Outcome {
        performance,
        events,
        trouble,
    } = simulated.map_err(|stop| Failure::Runtime(stop.describe(&scenario)))?;
    if let Some((time, trouble)) = trouble {
        let path = scenario.path().display();
        eprintln!("fuyu: warning: {path}: from {time:.2} s on: {trouble}");
    }
    if let Some((time, excess)) = events.deformation_excess() {
        let path = scenario.path().display();
        eprintln!("fuyu: warning: {path}: from {time:.2} s on: {excess}");
    }
    if let (true, Some(limits)) = (
        closed_loop.was_limited(),
        closed_loop.world.default_effort_limits(),
    ) {
        let path = scenario.path().display();
        eprintln!("fuyu: warning: {path}: efforts were cut: {limits}");
    }
    let summary = performance.summary(&closed_loop.world, start.elapsed().as_secs_f64());
    if let Some(bag) = bag {
        bag.finish().map_err(|e| Failure::Runtime(e.to_string()))?;
    }
    let text = if args.json {
        let report = Report::new(&closed_loop.world, &summary, &events);
        let json = serde_json::to_string(&report);
        json.map_err(|e| Failure::Runtime(e.to_string()))? + "\n"
    } else {
        table(&scenario.name(), &summary) + &table_of_parts(&closed_loop.world, events.events())
    };
    print(&text)
}

fn simulate(
    closed_loop: &mut ClosedLoop,
    duration: f64,
    mut bag: Option<&mut SimulatedBag>,
) -> Result<Outcome, Stop> {
    let mut performance = Performance::new(&closed_loop.world);
    let mut events = EventWatch::default();
    let mut trouble = None;
    let mut frames = Vec::new();
    loop {
        if let Some(bag) = bag.as_deref_mut() {
            bag.time(closed_loop.world.time())?;
            bag.state(0, &mut closed_loop.world)?;
        }
        closed_loop.answer::<Stop>(&mut frames, |world, moment| {
            performance.see(world, moment);
            events.see(world);
            let since = trouble.map_or(world.time(), |(since, _)| since);
            trouble = moment.trouble().map(|now| (since, now));
            if let Some(bag) = bag.as_deref_mut() {
                bag.moment(0, world.time(), moment)?;
            }
            Ok(())
        })?;
        if closed_loop.world.time() >= duration - 1e-9 {
            return Ok(Outcome {
                performance,
                events,
                trouble,
            });
        }
        closed_loop.advance()?;
    }
}

fn table(name: &str, s: &Summary) -> String {
    let time = |t: Option<f64>| t.map_or("not reached".to_owned(), |t| format!("{t:.2} s"));
    let [x, y, z] = s.base_displacement;
    let [roll, pitch, yaw] = s.base_attitude_rpy.map(f64::to_degrees);
    let mut out = String::new();
    let mut row = |label: &str, value: String| {
        // Writing to a string cannot fail.
        let _ = writeln!(out, "{:<32}{value}", format!("{label} "));
    };
    row(
        name,
        format!(
            "{} s simulated in {:.3} s ({:.0} x real time)",
            s.duration,
            s.wall_time,
            s.duration / s.wall_time
        ),
    );
    if let Some(position) = s.tip_position_error {
        row("tip position error", format!("{position:.3e} m"));
        if let Some(attitude) = s.tip_attitude_error {
            row("tip attitude error", format!("{attitude:.3e} rad"));
        }
        row("within 1 cm after", time(s.time_to_1cm));
        if s.tip_attitude_error.is_some() {
            row("within 2 degrees after", time(s.time_to_2deg));
        }
    }
    row("base displacement", format!("{x:.4}, {y:.4}, {z:.4} m"));
    row(
        "base roll, pitch, yaw",
        format!("{roll:.3}, {pitch:.3}, {yaw:.3} deg"),
    );
    row(
        "momentum residual",
        format!(
            "{:.1e} linear, {:.1e} angular",
            s.momentum_residual.linear, s.momentum_residual.angular
        ),
    );
    row("energy residual", format!("{:.1e}", s.energy_residual));
    for (target, t) in &s.targets {
        let MomentumResidual { linear, angular } = t.momentum_residual;
        row(
            &format!("{target}: momentum residual"),
            format!("{linear:.1e} linear, {angular:.1e} angular"),
        );
        row(
            &format!("{target}: energy residual"),
            format!("{:.1e}", t.energy_residual),
        );
    }
    if let Some(gap) = s.loop_gap {
        row("largest loop gap", format!("{gap:.1e} m or rad"));
    }
    if let (Some(speed), Some(acceleration)) = (s.max_tip_speed, s.max_tip_acceleration) {
        row("largest tip speed", format!("{speed:.3} m/s"));
        row(
            "largest tip acceleration",
            format!("{acceleration:.3} m/s2"),
        );
    }
    row(
        "largest base acceleration",
        format!("{:.4} rad/s2", s.max_base_angular_acceleration),
    );
    out
}

/// Deflections, wheels and events of a run.
fn table_of_parts(world: &World, events: &[Event]) -> String {
    let mut out = String::new();
    let mut row = |label: &str, value: String| {
        // Writing to a string cannot fail.
        let _ = writeln!(out, "{label:<32}{value}");
    };
    if let Some(robot) = world.robot.flexible() {
        let (system, state) = (robot.system(), robot.state());
        for (i, body) in system.modal_bodies().iter().enumerate() {
            if !body.appendage.outputs.is_empty() {
                let tip = robot.workspace().deflection(state, i, 0);
                let label = format!("{} tip deflection", body.name());
                row(
                    &label,
                    format!("{:.4}, {:.4}, {:.4} m", tip.x, tip.y, tip.z),
                );
            }
        }
        for (wheel, speed) in system.wheels().iter().zip(state.wheel_speeds()) {
            row(
                &format!("wheel {}", wheel.name),
                format!("{speed:.4} rad/s"),
            );
        }
        row(
            "strain energy",
            format!("{:.3e} J", world.robot.strain_energy()),
        );
    }
    for event in events {
        row(&format!("{:.2} s", event.time), event.what.clone());
    }
    out
}
