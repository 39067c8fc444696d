//! Figs. 3.16 to 3.25: the truss with three inputs and outputs, on a surrogate geometry.

use fuyu_lti::kida1993::truss::{
    ACTUATED, DESIGN_MODES, Design, PLANT_MODES, Response, Weights, bars, design, modes, nodes,
    plant, size,
};
use std::f64::consts::TAU;

use super::diagrams::{
    FREQUENCY, decibel, gain_panel, over_time, sampled, series, singular_values, time_figure,
};
use super::{Outcome, completed};
use crate::experiments::reproduce::Report;
use crate::experiments::{Figure, ShapeFigure, ShapePanel};

const SURROGATE: &str = "Fig. 3.16 with the truss's geometry is lost. The surrogate has what the text says (99 bars, \
    45 nodes, 90 degrees of freedom, 3 rigid modes, 15 modes in the plant, 4 in the design model, 3 collocated pairs \
    of force and displacement), with mass and stiffness for which the book's weights act among the vibration modes. \
    Verdicts carry over, numbers do not.";

/// Frequencies of the figures \[rad/s\].
const RANGE: (f64, f64) = (0.1, 1000.0);

pub(super) fn fig_3_17(report: Report) -> Report {
    completed(report, |report| {
        let (nodes_found, bars_found, freedom) = size();
        for (what, printed, found) in [
            ("bars", 99.0, bars_found),
            ("nodes", 45.0, nodes_found),
            ("degrees of freedom", 90.0, freedom),
        ] {
            report.near(what, printed, found as f64, 0.0);
        }
        let modes = modes()?;
        let rigid = modes.frequencies.iter().filter(|w| **w == 0.0).count();
        report.near("rigid modes", 3.0, rigid as f64, 0.0);
        report.near(
            "modes in the plant",
            15.0,
            modes.frequencies.len() as f64,
            0.0,
        );
        report.note(SURROGATE);
        let (points, rods) = (nodes(), bars());
        let lines = |at: &[(f64, f64)]| -> Vec<Vec<(f64, f64)>> {
            rods.iter().map(|(i, j)| vec![at[*i], at[*j]]).collect()
        };
        let panel = |k: usize| {
            let shape = modes.shapes.column(k);
            let factor = 1.5 / shape.amax();
            let moved: Vec<_> = (points.iter().enumerate())
                .map(|(i, p)| (p.0 + factor * shape[2 * i], p.1 + factor * shape[2 * i + 1]))
                .collect();
            let arrow = |dof: usize| {
                let along = if dof.is_multiple_of(2) {
                    (1.0, 0.0)
                } else {
                    (0.0, 1.0)
                };
                [points[dof / 2], along]
            };
            ShapePanel {
                title: format!("{:.2} Hz", modes.frequencies[k] / TAU),
                reference: lines(&points),
                shape: lines(&moved),
                nodes: Vec::new(),
                arrows: ACTUATED.map(arrow).to_vec(),
            }
        };
        let figure = ShapeFigure {
            title: "Kida 1993 Fig. 3.17: modes of the truss (surrogate), forces as arrows"
                .to_owned(),
            columns: 3,
            panels: (0..PLANT_MODES).map(panel).collect(),
        };
        report.shapes.push(("kida-fig-3.17".to_owned(), figure));
        Ok(())
    })
}

pub(super) fn fig_3_18(report: Report) -> Report {
    completed(report, |report| {
        let (full, model) = (plant(PLANT_MODES)?, plant(DESIGN_MODES)?);
        let error = design(Weights::Standard)?.error;
        // Eq. (3.29): plant = model + error.
        let mut off = 0.0_f64;
        for w in [0.3, 3.0, 30.0, 300.0] {
            let difference = full.response(w)? - model.response(w)? - error.response(w)?;
            off = off.max(difference.camax() / full.response(w)?.camax());
        }
        report.holds(
            "eq. (3.29): plant - model - error, relative, below 1e-9",
            off,
            off < 1e-9,
        );
        let (mut low, mut highest) = (f64::NAN, 0.0_f64);
        for w in error.frequency_grid(0.3, RANGE.1, 60)? {
            let part = error.singular_values(w)?[0] / model.singular_values(w)?[0];
            low = if low.is_nan() { part } else { low };
            highest = highest.max(part);
        }
        report.holds(
            "model error over model at .3 rad/s: small, below .01",
            low,
            low < 0.01,
        );
        report.holds(
            "largest model error over model, at a mode that the model lacks: above 1",
            highest,
            highest > 1.0,
        );
        report.note(SURROGATE);
        let panel = |label: &str, system| {
            singular_values(system, RANGE).map(|curves| gain_panel(label, curves, (-60.0, 120.0)))
        };
        let figure = Figure {
            title: "Kida 1993 Fig. 3.18: singular values of the truss (surrogate)".to_owned(),
            x_label: FREQUENCY.to_owned(),
            log_x: true,
            panels: vec![
                panel("15 modes [dB]", &full)?,
                panel("4 modes [dB]", &model)?,
                panel("error [dB]", &error)?,
            ],
        };
        report.figures.push(("kida-fig-3.18".to_owned(), figure));
        Ok(())
    })
}

fn verdict(report: &mut Report, d: &Design, is_stable: bool) {
    let (sign, word) = if is_stable {
        ("below", "stable")
    } else {
        ("above", "unstable")
    };
    report.holds(
        &format!("condition (3.36): largest singular value of error K (I + G K)^-1, {sign} 1"),
        d.robustness,
        (d.robustness < 1.0) == is_stable,
    );
    report.holds(
        &format!("15 modes, largest real part [rad/s]: {word}"),
        d.largest_real_part,
        (d.largest_real_part < 0.0) == is_stable,
    );
}

fn pictures(report: &mut Report, d: &Design, number: usize, what: &str) -> Outcome {
    const TITLES: [&str; 4] = [
        "(I + G K)^-1 G [dB]",
        "(I + G K)^-1 [dB]",
        "G K (I + G K)^-1 [dB]",
        "K (I + G K)^-1 [dB]",
    ];
    let limits = [(-80.0, 40.0), (-60.0, 20.0), (-80.0, 20.0), (-60.0, 60.0)];
    let mut panels = Vec::new();
    for ((function, title), limits) in d.functions.iter().zip(TITLES).zip(limits) {
        panels.push(gain_panel(title, singular_values(function, RANGE)?, limits));
    }
    // The bound of (3.36) for one noise direction: the inverse of the largest singular value of the error.
    let error = singular_values(&d.error, RANGE)?.into_iter().next();
    let bound = error.map(|curve| {
        let points = curve.points.into_iter().map(|(w, gain)| (w, -gain));
        series("1 / largest error", points.collect())
    });
    panels[3].series.extend(bound);
    let figure = Figure {
        title: format!("Kida 1993 Fig. 3.{number}, surrogate: {what}"),
        x_label: FREQUENCY.to_owned(),
        log_x: true,
        panels,
    };
    report
        .figures
        .push((format!("kida-fig-3.{number}"), figure));
    const STEP: f64 = 0.005;
    let samples = if d.largest_real_part < 0.0 { 801 } else { 1601 };
    let (impulse, step) = (d.impulse(STEP, samples)?, d.step(STEP, samples)?);
    let curves = |response: &Response, first: usize, letter: &str| {
        let curve = |i: usize| {
            let values = response.iter().map(|(_, v)| v[first + i]);
            sampled(&format!("{letter}{}", i + 1), STEP, values)
        };
        (0..3).map(curve).collect::<Vec<_>>()
    };
    let figure = time_figure(
        &format!(
            "Kida 1993 Fig. 3.{}, surrogate: disturbance at the first input, {what}",
            number + 1
        ),
        vec![
            over_time("impulse: y [m]", curves(&impulse, 0, "y")),
            over_time("impulse: u [N]", curves(&impulse, 3, "u")),
            over_time("step: y [m]", curves(&step, 0, "y")),
            over_time("step: u [N]", curves(&step, 3, "u")),
        ],
    );
    report
        .figures
        .push((format!("kida-fig-3.{}", number + 1), figure));
    Ok(())
}

pub(super) fn fig_3_20(report: Report) -> Report {
    completed(report, |report| {
        let d = design(Weights::Standard)?;
        verdict(report, &d, false);
        report.note(SURROGATE);
        pictures(report, &d, 20, "standard regulator")
    })
}

pub(super) fn fig_3_22(report: Report) -> Report {
    completed(report, |report| {
        let (d, standard) = (design(Weights::Control)?, design(Weights::Standard)?);
        verdict(report, &d, true);
        // "Rather worse than Fig. 3.21(b)": the low-frequency gain from disturbance to displacement on the design
        // model.
        let low = |d: &Design| {
            Ok::<_, fuyu_lti::LtiError>(decibel(d.functions[0].singular_values(0.01)?[0]))
        };
        let worse = low(&d)? - low(&standard)?;
        report.holds(
            "static deviation, rather worse than with the standard regulator: gain of (3.32) at .01 rad/s, higher by \
             [dB]",
            worse,
            worse > 0.0,
        );
        report.note(SURROGATE);
        pictures(report, &d, 22, "weight on the forces")
    })
}

pub(super) fn fig_3_24(report: Report) -> Report {
    completed(report, |report| {
        let (d, control) = (design(Weights::Both)?, design(Weights::Control)?);
        verdict(report, &d, true);
        let part = d.static_deviation.abs() / control.static_deviation.abs();
        report.holds(
            "static deviation over that without q: reduced, below .2",
            part,
            part < 0.2,
        );
        let low = |d: &Design| {
            Ok::<_, fuyu_lti::LtiError>(decibel(d.functions[0].singular_values(0.1)?[0]))
        };
        let better = low(&control)? - low(&d)?;
        report.holds(
            "disturbances suppressed at .1 rad/s more than without q, by [dB]",
            better,
            better > 0.0,
        );
        report.note(SURROGATE);
        pictures(report, &d, 24, "both weights")
    })
}
