//! Notes and warnings about a simulation for its user, one line each.

use super::{Fleet, simulation::Observed};
use crate::nodes::scenario::Scenario;

/// Refuses a scenario with one of several robots if the others are simulated elsewhere.
///
/// # Errors
/// A line that names the file.
pub fn check_robots(scenario: &Scenario) -> Result<(), String> {
    if scenario.robots().len() != 1 || !scenario.has_several_robots() {
        return Ok(());
    }
    Err(format!(
        "{}: parameter robots of the dynamics node names other robots, but the scenario has no other dynamics node to simulate",
        scenario.path().display()
    ))
}

/// Parts of the scenario that are not simulated.
pub fn notes(scenario: &Scenario, fleet: &Fleet) -> Vec<String> {
    let path = scenario.path().display();
    let robots = fleet.robots().enumerate();
    let notes = robots.filter_map(|(i, (_, closed_loop))| {
        let missing = closed_loop.world.not_simulated()?;
        Some(format!("{path}: {}", fleet.of_robot(i, missing)))
    });
    notes.collect()
}

/// Warnings about a run.
pub fn warnings(scenario: &Scenario, fleet: &Fleet, observed: &[Observed]) -> Vec<String> {
    let path = scenario.path().display();
    let mut warnings = Vec::new();
    for (i, ((_, closed_loop), observed)) in fleet.robots().zip(observed).enumerate() {
        let mut warn = |text: &str| warnings.push(format!("{path}: {}", fleet.of_robot(i, text)));
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
    warnings
}
