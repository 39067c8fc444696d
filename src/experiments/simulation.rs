//! Simulation of a scenario without DDS, from its first to its last state, for `fuyu simulate` and campaigns.

use std::{collections::BTreeMap, path::Path};

use serde::Serialize;

use super::{
    ClosedLoop, Event, EventWatch, Figures, FinalState, Fleet, MissionSummary, Performance,
    Recorded, SimulatedBag, SimulatedImages, Summary,
};
use crate::{
    bag::BagError, control::ConvergenceFailure, nodes::scenario::Scenario, vision::PoseFrame,
};

/// Time simulated after the end of the last mission, here and by `fuyu launch` \[s\].
pub const AFTER_MISSIONS: f64 = 2.0;
/// Simulated time of a scenario without a duration \[s\].
const DEFAULT_DURATION: f64 = 60.0;

/// Observations of a robot during a run.
pub struct Observed {
    /// Its figures.
    pub performance: Performance,
    /// Its events; empty if they are not collected.
    pub events: EventWatch,
    wants_events: bool,
    /// If the tip does not converge at the end: since when \[s\], and why.
    pub trouble: Option<(f64, ConvergenceFailure)>,
}

/// Reasons for ending a simulation early.
#[derive(Debug)]
pub enum Stop {
    /// The motion cannot be continued, for the given reason.
    Physics(String),
    /// The bag cannot be written.
    Bag(BagError),
    /// The watcher has ended the simulation, for the given reason.
    Watcher(String),
}

impl Stop {
    /// A line that describes the reason to the user.
    pub fn describe(&self, scenario: &Scenario) -> String {
        match self {
            Self::Physics(problem) => format!("{}: {problem}", scenario.path().display()),
            Self::Bag(problem) => problem.to_string(),
            Self::Watcher(problem) => problem.clone(),
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

/// Output of `fuyu simulate --json` for a robot.
#[derive(Serialize)]
struct Report<'a> {
    #[serde(flatten)]
    summary: &'a Summary,
    r#final: FinalState,
    events: &'a [Event],
    #[serde(skip_serializing_if = "Option::is_none")]
    mission: Option<MissionSummary>,
}

impl<'a> Report<'a> {
    fn new(closed_loop: &ClosedLoop, summary: &'a Summary, events: &'a EventWatch) -> Self {
        let world = &closed_loop.world;
        let capturing = closed_loop.capturing();
        Self {
            summary,
            r#final: FinalState::of(world),
            events: events.events(),
            mission: capturing.map(|capturing| MissionSummary::new(capturing, world)),
        }
    }
}

/// Output of `fuyu simulate --json` for several robots.
#[derive(Serialize)]
struct Reports<'a> {
    /// Reports by namespace.
    robots: BTreeMap<&'a str, Report<'a>>,
}

/// Simulated time \[s\]: `given`, or otherwise the scenario's.
pub fn duration_of(fleet: &Fleet, given: Option<f64>) -> f64 {
    let own = Some(fleet.duration()).filter(|duration| *duration > 0.0);
    given.or(own).unwrap_or(DEFAULT_DURATION)
}

/// Creates the bag of a run in a new folder.
///
/// # Errors
/// A line that names the parameter or the folder.
pub fn create_bag(
    scenario: &Scenario,
    fleet: &Fleet,
    folder: &Path,
) -> Result<SimulatedBag, String> {
    let descriptions = fleet.robots().map(|(namespace, _)| {
        let robot = scenario.of_robot(namespace).dynamics();
        robot.map(|dynamics| dynamics.robot.xml)
    });
    let descriptions: Vec<_> = descriptions.collect::<Result<_, _>>()?;
    let robots = fleet.robots().zip(&descriptions);
    let robots = robots.map(|((namespace, run), description)| {
        Ok(Recorded {
            namespace,
            run,
            description,
            images: images(&scenario.of_robot(namespace), run, description)?,
        })
    });
    let bag = SimulatedBag::create(folder, robots.collect::<Result<_, String>>()?);
    bag.map_err(|e| e.to_string())
}

/// The images rendered by the scenario's camera.
fn images(
    scenario: &Scenario,
    run: &ClosedLoop,
    description: &str,
) -> Result<Option<SimulatedImages>, String> {
    if !scenario.has("camera") {
        return Ok(None);
    }
    let Some(params) = scenario.camera()?.images else {
        return Ok(None);
    };
    let images = SimulatedImages::new(&params, run, description);
    let at = |e: String| format!("{}: node camera: {e}", scenario.path().display());
    images.map(Some).map_err(at)
}

/// Simulates up to and including the state at `duration` \[s\]. `watch` is called with every state after it was
/// answered.
///
/// # Errors
/// The reason for ending early.
pub fn simulate(
    fleet: &mut Fleet,
    duration: f64,
    mut bag: Option<&mut SimulatedBag>,
    mut watch: impl FnMut(&Fleet, &[Observed]) -> Result<(), Stop>,
) -> Result<Vec<Observed>, Stop> {
    let mut observed = Observed::all(fleet, Figures::ALL);
    let mut frames = Vec::new();
    loop {
        answer(fleet, &mut observed, &mut frames, bag.as_deref_mut())?;
        watch(fleet, &observed)?;
        if is_over(fleet, duration) {
            return Ok(observed);
        }
        fleet.advance()?;
    }
}

/// Whether the current state is the last one: the duration has passed, or there are missions and all of them ended at
/// least [`AFTER_MISSIONS`] ago.
pub(super) fn is_over(fleet: &Fleet, duration: f64) -> bool {
    let missions = fleet.robots().filter_map(|(_, run)| run.capturing());
    let ends = missions.map(|capturing| capturing.mission().ended());
    let last = ends.reduce(|a, b| Some(a?.max(b?))).flatten();
    let end = last.map_or(duration, |last| duration.min(last + AFTER_MISSIONS));
    fleet.time() >= end - 1e-9
}

impl Observed {
    /// Initial observations of all robots, with the selected `figures`.
    pub(super) fn all(fleet: &Fleet, figures: Figures) -> Vec<Self> {
        let observed = fleet.robots().map(|(_, closed_loop)| Self {
            performance: Performance::new(&closed_loop.world, figures),
            wants_events: figures.events,
            events: EventWatch::default(),
            trouble: None,
        });
        observed.collect()
    }
}

/// Lets cameras and controllers answer the current state of all robots.
///
/// # Errors
/// The reason why the simulation cannot continue.
pub(super) fn answer(
    fleet: &mut Fleet,
    observed: &mut [Observed],
    frames: &mut Vec<PoseFrame>,
    mut bag: Option<&mut SimulatedBag>,
) -> Result<(), Stop> {
    let time = fleet.time();
    if let Some(bag) = bag.as_deref_mut() {
        bag.time(time)?;
    }
    for (i, seen) in observed.iter_mut().enumerate() {
        let Observed {
            performance,
            events,
            wants_events,
            trouble,
        } = seen;
        let closed_loop = fleet.robot(i);
        if let Some(bag) = bag.as_deref_mut() {
            bag.state(i, &mut closed_loop.world)?;
            bag.images::<Stop>(i, &closed_loop.world)?;
        }
        let answered = closed_loop.answer::<Stop>(frames, |world, moment| {
            performance.see(world, moment);
            if *wants_events {
                events.see(world);
            }
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
    Ok(())
}

/// The performance figures of each robot. `wall_time` is the duration of the run \[s\].
pub fn summaries(fleet: &Fleet, observed: &[Observed], wall_time: f64) -> Vec<Summary> {
    let of_robots = fleet.robots().zip(observed);
    let of_robots = of_robots.map(|((_, closed_loop), observed)| {
        (observed.performance).summary(&closed_loop.world, wall_time)
    });
    of_robots.collect()
}

/// The results as JSON: one object for a single robot, otherwise an object with the robots by namespace.
///
/// # Errors
/// None with the present types; serde's in general.
pub fn results(
    fleet: &Fleet,
    observed: &[Observed],
    summaries: &[Summary],
) -> Result<serde_json::Value, serde_json::Error> {
    with_reports(fleet, observed, summaries, |reports| {
        match reports.robots.len() {
            1 => serde_json::to_value(reports.robots.values().next()),
            _ => serde_json::to_value(reports),
        }
    })
}

/// As [`results`], as text in the order of the types' fields.
///
/// # Errors
/// As [`results`].
pub fn results_text(
    fleet: &Fleet,
    observed: &[Observed],
    summaries: &[Summary],
) -> Result<String, serde_json::Error> {
    with_reports(fleet, observed, summaries, |reports| {
        match reports.robots.len() {
            1 => serde_json::to_string(&reports.robots.values().next()),
            _ => serde_json::to_string(reports),
        }
    })
}

fn with_reports<T>(
    fleet: &Fleet,
    observed: &[Observed],
    summaries: &[Summary],
    use_them: impl FnOnce(&Reports<'_>) -> T,
) -> T {
    let runs = fleet.robots().zip(summaries).zip(observed);
    let robots = runs.map(|(((namespace, closed_loop), summary), observed)| {
        let report = Report::new(closed_loop, summary, &observed.events);
        (namespace, report)
    });
    use_them(&Reports {
        robots: robots.collect(),
    })
}
