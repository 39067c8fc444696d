//! Summary of a capture mission, as reported by `fuyu simulate`.

use std::{collections::BTreeMap, fmt::Write as _};

use serde::Serialize;

use super::Capturing;
use crate::{
    control::capture::{Phase, PhaseReport},
    nodes::dynamics::{FreeBody as _, World},
};

/// Result of a mission. Mass error, base rate and grasp load are computed from true values, which the mission does not
/// know. SI units.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MissionSummary {
    /// Whether the target is held and all phases have ended.
    pub captured: bool,
    /// The last phase; `done` or `aborted` if the mission is over.
    pub phase: &'static str,
    /// Result of the last phase, or the condition for which it waits.
    pub reason: String,
    /// End \[s\]; `None` if the mission is not over.
    pub end: Option<f64>,
    /// Identified mass \[kg\]; `None` unless the target is captured.
    pub mass: Option<f64>,
    /// Relative error of the identified mass.
    pub mass_error: Option<f64>,
    /// True angular velocity of the base \[rad/s\]; `None` unless the target is captured.
    pub final_rate: Option<f64>,
    /// Largest force on the target at the grasp, averaged over a state's period \[N\]; zero if it was never held.
    pub grasp_force: f64,
    /// Largest torque at the grasp \[N m\].
    pub grasp_torque: f64,
    /// The phases in their order.
    pub phases: Vec<PhaseSummary>,
}

/// Result of a phase.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PhaseSummary {
    /// Its name.
    pub phase: &'static str,
    /// Start \[s\].
    pub start: f64,
    /// End \[s\]; `None` if it is not over.
    pub end: Option<f64>,
    /// Its outcome.
    pub outcome: String,
    /// Figures by name.
    pub figures: BTreeMap<&'static str, f64>,
}

impl PhaseSummary {
    fn of(report: &PhaseReport) -> Self {
        Self {
            phase: report.phase.name(),
            start: report.start,
            end: report.end,
            outcome: report.outcome.clone(),
            figures: report.figures.iter().map(|f| (f.name, f.value)).collect(),
        }
    }
}

impl MissionSummary {
    /// The summary of the mission in `world`.
    pub fn new(capturing: &Capturing, world: &World) -> Self {
        let mission = capturing.mission();
        let last = mission.reports().last();
        let phase = mission.phase();
        let captured = phase == Phase::Done;
        let identified = captured && mission.is_identified();
        let payload = mission.payload().filter(|_| identified);
        let mass = payload.map(|payload| payload.mass);
        let truth = world.targets[capturing.target()].body.model().total_mass();
        let (grasp_force, grasp_torque) = capturing.load().largest();
        Self {
            captured,
            phase: phase.name(),
            reason: match phase.is_over() {
                true => last.map_or_else(String::new, |last| last.outcome.clone()),
                false => mission.waits_for().to_owned(),
            },
            end: mission.ended(),
            mass,
            mass_error: mass.map(|mass| (mass / truth - 1.0).abs()),
            final_rate: captured.then(|| world.robot.V_WB_B().angular.norm()),
            grasp_force,
            grasp_torque,
            phases: mission.reports().iter().map(PhaseSummary::of).collect(),
        }
    }

    /// The reason why the mission did not capture its target, if it did not.
    pub fn failure(&self) -> Option<String> {
        match self.phase {
            "done" => None,
            "aborted" => Some(format!("the mission was aborted: {}", self.reason)),
            phase => Some(match self.reason.as_str() {
                "" => format!("the mission has not ended, it is in phase {phase}"),
                reason => {
                    format!("the mission has not ended, it is in phase {phase} and waits: {reason}")
                }
            }),
        }
    }
}

/// The mission's phases as lines.
pub fn mission_lines(capturing: &Capturing, world: &World) -> String {
    let mut out = String::new();
    let summary = MissionSummary::new(capturing, world);
    for report in capturing.mission().reports() {
        let span = match report.end {
            Some(end) if end > report.start => format!("{:.2} s to {end:.2} s", report.start),
            Some(_) => format!("{:.2} s", report.start),
            None => format!("from {:.2} s on", report.start),
        };
        // Writing to a string cannot fail.
        let _ = match report.outcome.as_str() {
            "" => writeln!(out, "{:<32}{span}", report.phase.name()),
            outcome => writeln!(out, "{:<32}{span}: {outcome}", report.phase.name()),
        };
        for f in &report.figures {
            let value = format!("{} {}", short(f.value), f.unit);
            let _ = writeln!(out, "  {:<54}{}", f.name, value.trim_end());
        }
    }
    if summary.grasp_force > 0.0 {
        let _ = writeln!(
            out,
            "{:<32}{} N, {} N m",
            "largest load on the grasp",
            short(summary.grasp_force),
            short(summary.grasp_torque)
        );
    }
    if let Some(rate) = summary.final_rate {
        let _ = writeln!(out, "{:<32}{} rad/s", "true rate at the end", short(rate));
    }
    if let Some(error) = summary.mass_error {
        let _ = writeln!(out, "{:<32}{} %", "error of the mass", short(100.0 * error));
    }
    out
}

/// A number with four digits; whole numbers without a decimal point.
fn short(value: f64) -> String {
    match value.abs() {
        0.0 => "0".to_owned(),
        x if x.fract() == 0.0 && x < 1e6 => format!("{value:.0}"),
        x if x < 1e-3 => format!("{value:.2e}"),
        x if x < 10.0 => format!("{value:.4}"),
        _ => format!("{value:.2}"),
    }
}
