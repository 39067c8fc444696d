//! Summary of a launch, computed from its bag.

use std::fmt::Write as _;

use super::{
    monitor::Progress,
    overload::{self, Overload},
    plan::Plan,
};
use crate::{
    bag::Bag,
    experiments::{RecordedRun, RecordedRuns, momentum_residuals, recorded_mission, title_of},
    ros::Node,
    spatial::roll_pitch_yaw_intrinsic,
};

/// Namespace common to all nodes; `None` if it is the root namespace, or there are several.
pub fn robot_of(nodes: &[Node]) -> Option<String> {
    let mut namespaces = nodes.iter().map(|node| node.name().namespace());
    let first = namespaces.next().filter(|first| *first != "/")?;
    namespaces
        .all(|other| other == first)
        .then(|| first.to_owned())
}

/// The summary text, and a line if the result misses the scenario's because the computer was too slow. `robot` is the
/// namespace of the robot, if it has one.
pub fn summary(
    plan: &Plan,
    progress: &Progress,
    overload: &Overload,
    robot: Option<&str>,
) -> (String, Option<String>) {
    let seen = progress.seen();
    let mut out = String::new();
    let mut row = |label: &str, value: String| {
        // Writing to a string cannot fail.
        let _ = writeln!(out, "{:<24}{value}", format!("{label} "));
    };
    let run = if progress.is_over() {
        "done"
    } else {
        "stopped"
    };
    row(
        &plan.scenario.name(),
        match robot {
            None => run.to_owned(),
            Some(robot) => format!("{run}, robot {robot}"),
        },
    );
    if let (Some((t0, w0)), Some((t1, w1))) = (seen.start, seen.last) {
        let wall = w1.duration_since(w0).as_secs_f64();
        let factor = if wall > 0.0 { (t1 - t0) / wall } else { 0.0 };
        row(
            "simulated time",
            format!("{t1:.2} s, real-time factor {factor:.3}"),
        );
    }
    let mut missed = None;
    if let Some(line) = overload.line() {
        if let (true, Some((end, _))) = (progress.is_over(), seen.last) {
            missed = overload::missed(&plan.scenario, &seen.errors, end)
                .map(|missed| format!("{missed}, because the computer was too slow: {line}"));
        }
        row("late or lost", line);
    }
    let Some(folder) = &plan.bag else {
        return (out, missed);
    };
    let bag = match Bag::open(folder) {
        Ok(bag) => bag,
        Err(problem) => {
            row("bag", problem.to_string());
            return (out, missed);
        }
    };
    let mut runs = RecordedRuns::default();
    let mut messages = 0u64;
    for message in bag.messages() {
        messages += 1;
        runs.accept(&message);
    }
    for (namespace, run) in runs.robots() {
        match title_of(namespace).as_str() {
            "" => describe(run, &mut row),
            title => describe(run, &mut |label, value| {
                row(&format!("{title}: {label}"), value)
            }),
        }
    }
    row("bag", format!("{} ({messages} messages)", folder.display()));
    (out, missed)
}

fn describe(run: &RecordedRun, row: &mut dyn FnMut(&str, String)) {
    if let Some(last) = run.controller.last() {
        row(
            "tip position error",
            format!("{:.3e} m", last.position_error),
        );
        row(
            "tip attitude error",
            format!("{:.3e} rad", last.attitude_error),
        );
    }
    if let Some(mission) = &run.mission {
        for phase in recorded_mission::phases(mission) {
            let span = match phase.outcome {
                "" => format!("{:.1} s to {:.1} s, not ended", phase.start, phase.end),
                outcome if phase.end == phase.start => format!("{:.1} s: {outcome}", phase.start),
                outcome => format!("{:.1} s to {:.1} s: {outcome}", phase.start, phase.end),
            };
            row(phase.name, span);
            for (name, value, unit) in phase.figures {
                if name == "mass" {
                    row("identified mass", format!("{value:.2} {unit}"));
                }
            }
        }
    }
    if let (Some(first), Some(last)) = (run.base.first(), run.base.last()) {
        let moved = run.base_com(last) - run.base_com(first);
        row(
            "base displacement",
            format!("{:.4}, {:.4}, {:.4} m", moved.x, moved.y, moved.z),
        );
        let angles = roll_pitch_yaw_intrinsic(&last.X_WB.rotation.to_rotation_matrix());
        let [roll, pitch, yaw] = angles.map(f64::to_degrees);
        row(
            "base roll, pitch, yaw",
            format!("{roll:.3}, {pitch:.3}, {yaw:.3} deg"),
        );
    }
    if let Some(residuals) = momentum_residuals(run) {
        let [linear, angular] = residuals.map(|r| r.values.iter().fold(0.0, |m, v| v.1.max(m)));
        row(
            "momentum residual",
            format!("{linear:.1e} linear, {angular:.1e} angular"),
        );
    }
}
