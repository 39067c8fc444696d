//! The mission of a recorded run: results of its phases, and plots of its motion.

use super::chart::{Figure, Panel, Series};
use super::recorded::{RecordedRun, seconds_since};
use crate::{control::capture::Phase, msg::fuyu_msgs::MissionState};

/// Largest angular velocity of the base at which a target counts as stopped \[rad/s\]: 0.05 deg/s.
pub const STOPPED_RATE: f64 = 8.726_646_259_971_648e-4;

/// A phase of a recorded mission.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordedPhase<'a> {
    /// Its name.
    pub name: &'a str,
    /// Start \[s\].
    pub start: f64,
    /// End, or time of the last state \[s\].
    pub end: f64,
    /// Its outcome; empty if it has not ended.
    pub outcome: &'a str,
    /// Names, values and units of its figures.
    pub figures: Vec<(&'a str, f64, &'a str)>,
}

impl RecordedPhase<'_> {
    /// A figure by name.
    pub fn figure(&self, name: &str) -> Option<f64> {
        let found = self.figures.iter().find(|(other, ..)| *other == name);
        found.map(|(_, value, _)| *value)
    }
}

/// The phases of a mission in order, as far as the message contains them.
pub fn phases(state: &MissionState) -> Vec<RecordedPhase<'_>> {
    let names = state.phase_name.iter().zip(&state.phase_start);
    let ends = state.phase_end.iter().zip(&state.outcome);
    let mut phases: Vec<_> = (names.zip(ends))
        .map(|((name, start), (end, outcome))| RecordedPhase {
            name,
            start: *start,
            end: *end,
            outcome,
            figures: Vec::new(),
        })
        .collect();
    let figures = state.figure_name.iter().zip(&state.figure_value);
    let figures = figures.zip(state.figure_unit.iter().zip(&state.figure_phase));
    for ((name, value), (unit, phase)) in figures {
        if let Some(phase) = phases.get_mut(*phase as usize) {
            phase.figures.push((name, *value, unit));
        }
    }
    phases
}

/// Whether the mission is over.
pub fn is_over(state: &MissionState) -> bool {
    [Phase::Done, Phase::Aborted]
        .iter()
        .any(|phase| phase.name() == state.phase)
}

/// Angular velocity of the base at the last state up to `time` \[s\], in rad/s.
pub fn base_rate_at(run: &RecordedRun, time: f64) -> Option<f64> {
    let nanos = (time * 1e9).round() as i64;
    let count = run.base.partition_point(|sample| sample.time <= nanos);
    let sample = &run.base[count.checked_sub(1)?];
    Some(sample.V_WB_B.angular.norm())
}

/// Plot over time of the phases, the distance of the tip from the target as measured by the camera, and the base's
/// rate.
pub fn mission_figure(run: &RecordedRun) -> Option<Figure> {
    let phases = phases(run.mission.as_ref()?);
    let start = run.start();
    let origin = start as f64 * 1e-9;
    let names = Phase::IN_ORDER.map(Phase::name);
    let level = |name: &str| names.iter().position(|n| *n == name);
    let steps = phases.iter().filter_map(|phase| {
        let level = level(phase.name)? as f64;
        Some([(phase.start - origin, level), (phase.end - origin, level)])
    });
    let distances = run.seen_tip.iter().filter_map(|tip| {
        let goal = run.seen_goal.binary_search_by_key(&tip.time, |g| g.time);
        let goal = &run.seen_goal[goal.ok()?].pose.translation.vector;
        let distance = (goal - tip.pose.translation.vector).norm();
        Some((seconds_since(start, tip.time), distance))
    });
    let rates = run.base.iter().map(|sample| {
        let rate = sample.V_WB_B.angular.norm().to_degrees();
        (seconds_since(start, sample.time), rate)
    });
    let panel = |y_label: &str, name: &str, points: Vec<(f64, f64)>| Panel {
        y_label: y_label.into(),
        series: vec![Series {
            name: name.into(),
            points,
        }],
        ..Panel::default()
    };
    let panels = vec![
        Panel {
            limits: Some((-0.5, 5.8)),
            marks: (0..).map(f64::from).zip(names.map(String::from)).collect(),
            ..panel("phase", "mission", steps.flatten().collect())
        },
        panel(
            "distance of the tip [m]",
            "from the measured frame",
            distances.collect(),
        ),
        panel("rate [deg/s]", "base", rates.collect()),
    ];
    Figure::over_time("Capture mission", panels)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn phases_have_their_figures_and_a_short_message_loses_only_its_own() {
        let mut state = MissionState {
            phase: "grasp".to_owned(),
            phase_name: vec!["observe".to_owned(), "grasp".to_owned()],
            phase_start: vec![0.0, 20.0],
            phase_end: vec![20.0, 30.0],
            outcome: vec!["seen".to_owned(), String::new()],
            figure_name: vec!["poses".to_owned(), "attempts".to_owned()],
            figure_phase: vec![0, 1],
            figure_value: vec![200.0, 1.0],
            figure_unit: vec![String::new(), String::new()],
            ..MissionState::default()
        };
        let found = phases(&state);
        assert_eq!(found[1].figure("attempts"), Some(1.0));
        assert_eq!(found[0].figure("attempts"), None);
        assert_eq!(
            (found[1].start, found[1].end, found[0].outcome),
            (20.0, 30.0, "seen")
        );
        assert!(!is_over(&state));
        // From an erroneous publisher.
        state.figure_phase = vec![0, 7];
        state.phase_end.pop();
        assert_eq!(phases(&state).len(), 1);
    }
}
