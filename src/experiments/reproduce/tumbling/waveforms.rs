//! Figs. 3.27 to 3.30: oscillation of `|w|²`, and motions for which noise hides it.

use super::study::{SEED, Source, Study};
use super::{Report, map, number};
use crate::estimation::free_body::{DynamicParameters, FreeRotation};
use crate::estimation::masutani1995::Analysis;
use crate::experiments::masutani_ch3::{self as chapter, Condition, TumblingMotion};
use crate::experiments::{Figure, MapPanel, MapScale, Panel, Series};

/// A quantity of the closed form over the grid of motions.
fn closed_form(
    report: &mut Report,
    label: &str,
    value: fn(&DynamicParameters) -> f64,
) -> Vec<(TumblingMotion, f64)> {
    let study = Study::of(Source::TrueRates);
    let values = study.motions().into_iter().map(|motion| {
        let truth = motion.rotation().ok();
        let value = truth.and_then(|t| t.parameters().map(value));
        (motion, value.filter(|v| v.is_finite()).unwrap_or(f64::NAN))
    });
    let values: Vec<_> = values.collect();
    let picture = map(
        format!("Masutani 1995 Fig. {}: {label}", number(report)),
        &study.grid(),
        MapScale::Logarithms(label.to_owned()),
        vec![MapPanel {
            title: "closed form, beta = 0.8".to_owned(),
            values: values.iter().map(|(_, v)| *v).collect(),
            crosses: Vec::new(),
            grid: None,
        }],
    );
    report.maps.push((report.name.clone(), picture));
    values
}

/// Fraction of neighbouring pairs along one axis of the grid for which `first` and `second` are in the expected order.
fn share(
    values: &[(TumblingMotion, f64)],
    next: impl Fn(&TumblingMotion, &TumblingMotion) -> bool,
    ordered: impl Fn(f64, f64) -> bool,
) -> f64 {
    let pairs = values
        .iter()
        .flat_map(|a| values.iter().map(move |b| (a, b)));
    let finite = pairs.filter(|(a, b)| next(&a.0, &b.0) && a.1.is_finite() && b.1.is_finite());
    let orders: Vec<_> = finite.map(|(a, b)| ordered(a.1, b.1)).collect();
    orders.iter().filter(|o| **o).count() as f64 / orders.len() as f64
}

/// Oscillating motions: neither a sphere, nor a single-axis rotation, nor the separatrix.
fn swings(m: &TumblingMotion) -> bool {
    m.e < 0.99 && m.s_alpha.abs() < 0.99 && m.s_alpha.abs() > 0.01
}

fn rounder(a: &TumblingMotion, b: &TumblingMotion) -> bool {
    swings(a) && swings(b) && a.s_alpha == b.s_alpha && b.e - a.e > 0.01 && b.e - a.e < 0.06
}

pub(super) fn period_map(mut report: Report) -> Report {
    let values = closed_form(&mut report, "T [s]", DynamicParameters::period);
    let longer = 100.0 * share(&values, rounder, |a, b| b > a);
    report.holds(
        "small e, short period: neighbours in that order, all [%]",
        longer,
        longer >= 100.0,
    );
    let inner = |a: &TumblingMotion, b: &TumblingMotion| {
        let closer = a.s_alpha.abs() - b.s_alpha.abs();
        let same_side = a.s_alpha * b.s_alpha > 0.0;
        swings(a)
            && swings(b)
            && a.e == b.e
            && same_side
            && closer > 0.01
            && closer < 0.11
            && b.s_alpha.abs() < 0.45
    };
    let longer = 100.0 * share(&values, inner, |a, b| b > a);
    report.holds(
        "long period near s_alpha = 0 (k near 1): neighbours within 0.5 of it in that order, all [%]",
        longer,
        longer >= 100.0,
    );
    report.note("Grey: no period, on the separatrix (s_alpha = 0) and for a sphere (e = 1).");
    report
}

pub(super) fn amplitude_map(mut report: Report) -> Report {
    let values = closed_form(&mut report, "beta - gamma [rad²/s²]", |p| {
        let amplitude = p.beta() - p.gamma();
        // Treat rounding errors as zero.
        match amplitude > 1e-12 * p.beta() {
            true => amplitude,
            false => f64::NAN,
        }
    });
    let smaller = 100.0 * share(&values, rounder, |a, b| b < a);
    report.holds(
        "large e, small amplitude: neighbours in that order, all [%]",
        smaller,
        smaller >= 100.0,
    );
    report.note("Grey: no swing, about one axis (|s_alpha| = 1) and for a sphere (e = 1).");
    report
}

/// A motion, its measured `|w|²` over time, and its estimate by the thesis's method.
type Seen = (FreeRotation, Vec<(f64, f64)>, Analysis);

/// The motion of Figs. 3.29 and 3.30, or its mirror image with respect to momentum.
fn seen(s_alpha: f64) -> Option<Seen> {
    let motion = TumblingMotion {
        e: 0.9,
        s: 0.0,
        s_alpha,
        beta: 0.8,
    };
    let truth = motion.rotation().ok()?;
    let points = chapter::points(20, SEED);
    let condition = Condition::Images {
        resolution: 1024,
        points: &points,
    };
    let rates = chapter::rates(&truth, condition).ok()?;
    let analysis = Analysis::new(&rates, &chapter::options()).ok()?;
    let squares = rates.iter().map(|(t, w)| (*t, w.norm_squared())).collect();
    Some((truth, squares, analysis))
}

/// Measurements of both motions, and rows common to both figures.
fn buried(report: &mut Report) -> Vec<(f64, Seen)> {
    let all = [-0.8, 0.8].into_iter();
    let all: Vec<_> = all.filter_map(|s| Some((s, seen(s)?))).collect();
    for (s_alpha, (truth, squares, _)) in &all {
        let swing = truth
            .parameters()
            .map_or(f64::NAN, |p| p.beta() - p.gamma());
        let off = squares
            .iter()
            .map(|(t, x)| (x - truth.angular_velocity(*t).norm_squared()).powi(2));
        let noise = (off.sum::<f64>() / squares.len() as f64).sqrt();
        report.holds(
            &format!(
                "s_alpha = {s_alpha:+}: noise (RMS) over the swing that it buries, at least 0.2 [-]"
            ),
            noise / swing,
            noise / swing > 0.2,
        );
    }
    report.note(
        "The text finds no main component at s_alpha = -0.8, but Tables 3.4 and 3.5 print the asymmetric model for \
         that motion, which needs one; for s_alpha = +0.8 they print the axisymmetric one. So both are shown.",
    );
    all
}

pub(super) fn buried_wave(mut report: Report) -> Report {
    let all = buried(&mut report);
    let panels = all.iter().map(|(s_alpha, (truth, squares, _))| {
        let exact = squares
            .iter()
            .map(|(t, _)| (*t, truth.angular_velocity(*t).norm_squared()));
        Panel {
            y_label: format!("|w|² [rad²/s²], {s_alpha:+}"),
            series: vec![
                Series {
                    name: "from images".to_owned(),
                    points: squares.clone(),
                },
                Series {
                    name: "true".to_owned(),
                    points: exact.collect(),
                },
            ],
            ..Panel::default()
        }
    });
    let figure = Figure {
        title: "Masutani 1995 Fig. 3.29: |w|² at e = 0.9, s_alpha = -0.8 and +0.8".to_owned(),
        x_label: "time [s]".to_owned(),
        panels: panels.collect(),
        ..Figure::default()
    };
    report.figures.push((report.name.clone(), figure));
    report
}

pub(super) fn buried_spectrum(mut report: Report) -> Report {
    let all = buried(&mut report);
    for (s_alpha, (_, _, analysis)) in &all {
        let rival = analysis.spectrum.rival;
        report.holds(
            &format!("s_alpha = {s_alpha:+}: another component above 0.333 of the main one: its share [-]"),
            rival,
            rival > 0.333,
        );
    }
    let panels = all.iter().map(|(s_alpha, (_, _, analysis))| {
        let bins = analysis.spectrum.magnitudes.iter().enumerate();
        Panel {
            y_label: format!("|G| [rad²/s²], {s_alpha:+}"),
            series: vec![Series {
                name: "from images".to_owned(),
                points: bins.map(|(k, g)| (k as f64, *g)).collect(),
            }],
            ..Panel::default()
        }
    });
    let figure = Figure {
        title: "Masutani 1995 Fig. 3.30: spectrum at e = 0.9, s_alpha = -0.8 and +0.8".to_owned(),
        x_label: "bin [-]".to_owned(),
        panels: panels.collect(),
        ..Figure::default()
    };
    report.figures.push((report.name.clone(), figure));
    report
}
