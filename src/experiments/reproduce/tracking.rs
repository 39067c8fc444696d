//! Tracking of a tumbling grasp point, and tolerated camera latency: simulated runs compared with fuyu's bounds.

use super::Report;
use crate::control::{LawKind, prediction::Prediction};
use crate::experiments::tracking::{LATENCIES, Moment, Run, Setup, angle_left, latency_margin};
use crate::experiments::{Figure, Panel, Series};

const DURATION: f64 = 60.0;

const LAW: LawKind = LawKind::TransposeJacobian;

const PREDICTIONS: [(&str, Prediction); 3] = [
    ("prediction none", Prediction::None),
    ("prediction latency", Prediction::Latency),
    ("prediction motion", Prediction::Motion),
];

/// Largest position error \[mm\] and attitude error \[deg\] in the last 20 s.
fn steady(run: &[Moment]) -> (f64, f64) {
    let late = run.iter().filter(|m| m.time >= DURATION - 20.0);
    late.fold((0.0, 0.0), |(p, a), m| {
        let (position, angle) = (m.error.position.norm() * 1e3, m.error.angle.to_degrees());
        (f64::max(p, position), f64::max(a, angle))
    })
}

/// The runs, the bounds of their steady-state errors, and the latencies at which the tip settles.
pub(super) fn tracking(mut report: Report) -> Report {
    let run = |setup: Setup| Run::new(setup).moments(DURATION);
    let ideal = PREDICTIONS.map(|(name, p)| (name, run(Setup::ideal(p))));
    let late = PREDICTIONS.map(|(name, p)| (name, run(Setup::late(p))));
    for (sensing, runs, bounds) in [
        ("ideal sensing", &ideal, (5.0, 0.5)),
        ("10 Hz, 150 ms, 1 px", &late, (20.0, 1.0)),
    ] {
        for (name, moments) in runs {
            let (position, angle) = steady(moments);
            let (p, a) = (
                format!("{sensing}, {name}: position [mm]"),
                format!("{sensing}, {name}: attitude [deg]"),
            );
            if *name == PREDICTIONS[2].0 {
                report.near(&p, 0.0, position, bounds.0);
                report.near(&a, 0.0, angle, bounds.1);
            } else {
                report.holds(&p, position, position > bounds.0);
                report.holds(&a, angle, angle > bounds.1);
            }
        }
    }
    let bare = latency_margin(Prediction::None, LAW, 0.0).unwrap_or(f64::INFINITY);
    report.holds(
        "latency at which the tip no longer settles, not compensated [s]",
        bare,
        bare < 0.05,
    );
    let last = LATENCIES[LATENCIES.len() - 1];
    let settles = latency_margin(Prediction::Latency, LAW, 10.0).is_none();
    report.holds(
        "it settles at all latencies to, compensated [s]",
        last,
        settles,
    );
    report.note(
        "The servicer of Masutani 1995 with its gains follows a point on a body that tumbles at 3 deg/s; the point moves \
         at 5 cm/s relative to the servicer's centre of mass, and the servicer has momentum. Steady state: 40 s to 60 s. \
         A pixel is what it makes of a pose 5 m away, fitted to 20 points on a body of 1 m (vision::PoseAccuracy). \
         The bounds are fuyu's own.",
    );
    report
        .figures
        .push(("tracking-error".to_owned(), errors(&ideal, &late)));
    report
        .figures
        .push(("tracking-latency".to_owned(), latencies()));
    report
}

fn errors(ideal: &[(&str, Vec<Moment>)], late: &[(&str, Vec<Moment>)]) -> Figure {
    let panel = |label: &str, runs: &[(&str, Vec<Moment>)], of: fn(&Moment) -> f64| Panel {
        y_label: label.to_owned(),
        series: runs
            .iter()
            .map(|(name, run)| Series {
                name: (*name).to_owned(),
                // Smaller errors are drawn at a hundredth of a millimetre or degree on the logarithmic axis.
                points: run
                    .iter()
                    .step_by(10)
                    .map(|m| (m.time, of(m).max(1e-2).log10()))
                    .collect(),
            })
            .collect(),
        ..Panel::default()
    };
    let position = |m: &Moment| m.error.position.norm() * 1e3;
    let angle = |m: &Moment| m.error.angle.to_degrees();
    Figure {
        title: "Tip off a tumbling grasp point: ideal sensing, and 10 Hz, 150 ms, 1 px".to_owned(),
        x_label: "time [s]".to_owned(),
        panels: vec![
            panel("ideal, log10 of mm", ideal, position),
            panel("ideal, log10 of deg", ideal, angle),
            panel("late, log10 of mm", late, position),
            panel("late, log10 of deg", late, angle),
        ],
        ..Figure::default()
    }
}

fn latencies() -> Figure {
    let curve = |name: &str, prediction: Prediction, rate: f64| Series {
        name: name.to_owned(),
        points: LATENCIES
            .into_iter()
            .map(|latency| {
                let left = angle_left(prediction, LAW, rate, latency).to_degrees();
                (latency * 1e3, left.min(180.0))
            })
            .collect(),
    };
    Figure {
        title: "How late a camera may be: a goal at rest, the gains of Masutani 1995".to_owned(),
        x_label: "latency [ms]".to_owned(),
        panels: vec![Panel {
            y_label: "tip off the goal after 40 s [deg]".to_owned(),
            series: vec![
                curve("not compensated, 100 Hz", Prediction::None, 0.0),
                curve("not compensated, 30 Hz", Prediction::None, 30.0),
                curve("not compensated, 10 Hz", Prediction::None, 10.0),
                curve("compensated, 10 Hz", Prediction::Latency, 10.0),
            ],
            ..Panel::default()
        }],
        ..Figure::default()
    }
}
