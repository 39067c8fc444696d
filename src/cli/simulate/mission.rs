//! Phases of a mission as text and JSON.

use std::{collections::BTreeMap, fmt::Write as _};

use serde::Serialize;

use crate::control::capture::CaptureMission;

/// A phase for `--json`.
#[derive(Serialize)]
pub(super) struct PhaseSummary {
    phase: &'static str,
    start: f64,
    end: Option<f64>,
    outcome: String,
    /// By name, SI units.
    figures: BTreeMap<&'static str, f64>,
}

/// The phases of a mission.
pub(super) fn phases(mission: &CaptureMission) -> Vec<PhaseSummary> {
    let reports = mission.reports().iter();
    let phase = reports.map(|report| PhaseSummary {
        phase: report.phase.name(),
        start: report.start,
        end: report.end,
        outcome: report.outcome.clone(),
        figures: report.figures.iter().map(|f| (f.name, f.value)).collect(),
    });
    phase.collect()
}

/// The same as lines.
pub(super) fn lines(mission: &CaptureMission) -> String {
    let mut out = String::new();
    for report in mission.reports() {
        let end = report
            .end
            .map_or("...".to_owned(), |end| format!("{end:.2} s"));
        let span = format!("{:.2} s to {end}", report.start);
        // Writing to a string cannot fail.
        let _ = writeln!(out, "{:<32}{span}: {}", report.phase.name(), report.outcome);
        for f in &report.figures {
            let value = format!("{:.4} {}", f.value, f.unit);
            let _ = writeln!(out, "  {:<46}{}", f.name, value.trim_end());
        }
    }
    if !mission.waits_for().is_empty() {
        let _ = writeln!(out, "  waits: {}", mission.waits_for());
    }
    out
}
