//! Masutani 1995, chapter 7: straight paths.

use std::fmt::Write;

use nalgebra::{DVector, Point3};

use super::Report;
use crate::control::Shaping;
use crate::dynamics::Workspace;
use crate::experiments::masutani_ch7::{FIG_7_3, Outcome, Steering, config, model, tasks};
use crate::experiments::{PlaneFigure, Series};
use crate::spatial::Pose;

const STEERINGS: [(Steering, &str); 3] = [
    (Steering::Plain, "plain"),
    (Steering::Straight(Shaping::Rotation), "rotation"),
    (Steering::Straight(Shaping::Damping), "damping"),
];

/// Duration of a task \[s\].
const DURATION: f64 = 60.0;

/// The example with and without rotation, and twelve tasks.
pub(super) fn fig_7_3(mut report: Report) -> Report {
    let all: Vec<[Outcome; 3]> = tasks()
        .iter()
        .map(|task| STEERINGS.map(|(steering, _)| task.run(config(steering), DURATION)))
        .collect();
    let [plain, rotated, damped] = &all[0];
    report.holds(
        "(a) largest deviation from the straight line [m]",
        plain.deviation,
        plain.deviation > 0.3,
    );
    report.holds(
        "(b) with rotation it is below a fifth of that [m]",
        rotated.deviation,
        rotated.deviation < 0.2 * plain.deviation,
    );
    report.holds(
        "(a) length of the path over the straight line",
        plain.path_ratio,
        plain.path_ratio > 1.1,
    );
    report.holds(
        "(b) with rotation, below 1.01",
        rotated.path_ratio,
        rotated.path_ratio < 1.01,
    );
    report.near("(b) distance left at 60 s [m]", 0.0, rotated.left, 0.01);
    let count = |holds: fn(&[Outcome; 3]) -> bool| all.iter().filter(|o| holds(o)).count() as f64;
    let straighter = count(|[plain, rotated, _]| rotated.deviation < plain.deviation);
    report.holds(
        "twelve tasks: straighter with rotation than without",
        straighter,
        straighter == 12.0,
    );
    let quick = count(|[_, _, damped]| damped.settled.is_some_and(|t| t < 30.0));
    report.holds(
        "twelve tasks: within 5 cm after less than 30 s with damping (not in the thesis)",
        quick,
        quick == 12.0,
    );
    let straight = count(|[plain, _, damped]| damped.deviation < 0.3 * plain.deviation);
    report.holds(
        "twelve tasks: with damping, below 0.3 of the plain law's deviation",
        straight,
        straight == 12.0,
    );
    report.listings.push(table(&all));
    report.note(
        "The thesis shows pictures only; start and goal of Fig. 7.3 are recovered ones, the gains are printed. The \
         eleven other tasks are drawn at random. Rotation keeps the proof of stability but crawls where the arm \
         hardly yields along the turned pull; damping of the tip across the line instead of damping of the joints \
         keeps the proof as well, and its pace does not depend on the posture.",
    );
    report.note(
        "At rest the rotation is not defined, and P = I. As soon as the tip moves the pull jumps, so that the path \
         of (b) depends on how the first instants are computed, by some centimetres over a run.",
    );
    let outcomes = [
        (plain, "(a) plain"),
        (rotated, "(b) rotation"),
        (damped, "(c) damping"),
    ];
    for ((outcome, title), letter) in outcomes.into_iter().zip(['a', 'b', 'c']) {
        let figure = picture(outcome, title);
        report
            .planes
            .push((format!("masutani-fig-7.3-{letter}"), figure));
    }
    report
}

fn table(all: &[[Outcome; 3]]) -> String {
    let mut out = "      largest deviation [m]        path / line               time to 5 cm [s]\n"
        .to_owned();
    out.push_str("task");
    for _ in 0..3 {
        for (_, name) in STEERINGS {
            let _ = write!(out, " {name:>8}");
        }
        out.push_str("  ");
    }
    out.push('\n');
    for (number, outcomes) in all.iter().enumerate() {
        let _ = write!(out, "{:4}", number + 1);
        for outcome in outcomes {
            let _ = write!(out, " {:8.3}", outcome.deviation);
        }
        out.push_str("  ");
        for outcome in outcomes {
            let _ = write!(out, " {:8.3}", outcome.path_ratio);
        }
        out.push_str("  ");
        for outcome in outcomes {
            let time = (outcome.settled).map_or_else(|| "> 60".to_owned(), |t| format!("{t:.1}"));
            let _ = write!(out, " {time:>8}");
        }
        out.push('\n');
    }
    out
}

/// The arm every 3 s in the y-z plane, in which it moves.
fn picture(outcome: &Outcome, title: &str) -> PlaneFigure {
    let model = model();
    let mut workspace = Workspace::new(&model);
    let mut posture = |(q, X_WB): &(DVector<f64>, Pose)| -> Vec<(f64, f64)> {
        workspace.set_positions(q);
        let arm = |name: &str| name.starts_with("link") || name == "tool0";
        let frames = model.frames().iter().filter(|f| arm(&f.name));
        let origins = frames.map(|f| X_WB * workspace.X_BF(f));
        let poses = std::iter::once(*X_WB).chain(origins);
        let points = poses.map(|X| X * Point3::origin()).map(|p| (p.y, p.z));
        points.chain([(f64::NAN, f64::NAN)]).collect()
    };
    let series = |name: &str, points| Series {
        name: name.to_owned(),
        points,
    };
    let path = outcome.path.iter().map(|p| (p.y, p.z)).collect();
    let start = outcome.path[0];
    let line = vec![(start.y, start.z), (FIG_7_3.goal[1], FIG_7_3.goal[2])];
    PlaneFigure {
        title: format!("Masutani 1995 Fig. 7.3, every 3 s: {title}"),
        x_label: "y [m]".to_owned(),
        y_label: "z [m]".to_owned(),
        series: vec![
            series(
                "base and arm",
                outcome.postures.iter().flat_map(&mut posture).collect(),
            ),
            series("path of the tip", path),
            series("straight line", line),
        ],
        ..PlaneFigure::default()
    }
}
