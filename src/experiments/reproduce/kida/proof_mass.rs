//! Figs. 4.4 to 4.10: rate feedback by a proof-mass actuator.

use fuyu_lti::kida1993::proof_mass::{
    FREQUENCIES_HZ, FROM_FIRST_AND_THIRD, FROM_SECOND_AND_THIRD, PRINTED_LIMITS,
    STRUCTURAL_DAMPING, Unprinted, actuators, compensated, impulse, limits, root_locus as locus,
    structure,
};
use fuyu_lti::{Complex, LtiError};
use std::f64::consts::TAU;

use super::diagrams::{branches, marks, over_time, pole_map, sampled, series, time_figure, upper};
use super::{completed, number};
use crate::experiments::Mark;
use crate::experiments::reproduce::Report;

const CONTRADICTION: &str = "The arm's length and the mode's shape at the actuator are not printed. Any two of the \
    printed limits d = 1, 21 and 32 determine them (with the first mode, as the text says higher ones hardly matter), \
    and the third is then another: 9.6 instead of 21, or 2.15 instead of 1. So one of the three cannot be \
    reproduced.";

const SITUATIONS: [&str; 3] = ["on the ground", "ten times the damping", "without gravity"];

/// The root locus of one of three situations, chosen by the figure's number in the report's name.
pub(super) fn root_locus(report: Report) -> Report {
    completed(report, |report| {
        let figure = number(report).to_owned();
        let which: usize = figure.trim_start_matches("4.").parse::<usize>()? - 4;
        // Unprinted parameters that meet this figure's limit; the second set also meets the third figure's limit.
        let unprinted = if which == 1 {
            FROM_SECOND_AND_THIRD
        } else {
            FROM_FIRST_AND_THIRD
        };
        let other = if which == 1 {
            FROM_FIRST_AND_THIRD
        } else {
            FROM_SECOND_AND_THIRD
        };
        let found = limits(&unprinted)?;
        report.near(
            &format!(
                "{}: gain d at which the loop becomes unstable",
                SITUATIONS[which]
            ),
            PRINTED_LIMITS[which],
            found[which],
            1e-2,
        );
        let quantity = format!(
            "the same with the data that meet the other two limits, {} printed",
            PRINTED_LIMITS[which]
        );
        let apart = limits(&other)?[which];
        match which {
            2 => report.near("with the other set of data", PRINTED_LIMITS[2], apart, 1e-2),
            _ => report.not_reproduced(
                &quantity,
                apart,
                (apart - PRINTED_LIMITS[which]).abs() > 0.5,
            ),
        }
        report.holds(
            "more damping allows more gain, and less stiffness still more: limit without gravity over that on the \
             ground",
            found[2] / found[0],
            found[0] < found[1] && found[1] < found[2],
        );
        let structure = structure(&unprinted)?;
        let actuator = actuators(&unprinted)?[which];
        let gains: Vec<f64> = (0..=2700)
            .map(|i| 1e-3 * 10f64.powf(f64::from(i) / 300.0))
            .collect();
        let paths = locus(&structure, &actuator, &gains)?;
        let last = &paths[paths.len() - 1].1;
        let inner = last
            .iter()
            .map(|p| p.norm())
            .filter(|w| *w < TAU * FREQUENCIES_HZ[0])
            .count();
        report.near(
            "poles that tend to the origin for high gain: a triple zero",
            3.0,
            inner as f64,
            0.0,
        );
        if which == 0 {
            let half = locus(&structure, &actuator, &[0.5 * found[which]])?
                .remove(0)
                .1;
            let damping = structural(&half);
            report.holds(
                "damping ratio of the first mode at half that gain, .003 of the structure alone: above .03",
                damping,
                damping > 10.0 * STRUCTURAL_DAMPING,
            );
        }
        if which == 2 {
            report.near(
                "gain over that of Fig. 4.4, 'thirty times'",
                30.0,
                found[2] / found[0],
                3.0,
            );
        }
        report.note(CONTRADICTION);
        let at_limit = locus(&structure, &actuator, &[found[which]])?.remove(0).1;
        let start = locus(&structure, &actuator, &[0.0])?.remove(0).1;
        let mut map = pole_map(
            &format!(
                "Kida 1993 Fig. {figure}: root locus of the proof mass, {}",
                SITUATIONS[which]
            ),
            vec![
                marks("d = 0", Mark::Cross, upper(&start)),
                marks(
                    &format!("d = {}, limit", PRINTED_LIMITS[which]),
                    Mark::Plus,
                    upper(&at_limit),
                ),
                marks("zeros", Mark::Ring, vec![(0.0, 0.0)]),
            ],
            Some([(-26.0, 6.0), (-0.5, 28.0)]),
        );
        map.series.push(series("0 < d < 1e6", branches(&paths)));
        report.planes.push((format!("kida-fig-{figure}"), map));
        Ok(())
    })
}

/// Damping ratio of the structure's mode: of the oscillating pole nearest to it in frequency.
fn structural(poles: &[Complex]) -> f64 {
    let w = TAU * FREQUENCIES_HZ[0];
    let pairs = poles.iter().filter(|p| p.im > 0.0);
    let mode = pairs.min_by(|a, b| (a.im - w).abs().total_cmp(&(b.im - w).abs()));
    mode.map_or(f64::NAN, |p| -p.re / p.norm())
}

/// As [`structural`], with the compensated actuator at gain d.
fn damping(unprinted: &Unprinted, d: f64) -> Result<f64, LtiError> {
    let structure = structure(unprinted)?;
    Ok(structural(
        &compensated(unprinted)?
            .closed_loop(&structure, d)?
            .poles()?,
    ))
}

pub(super) fn fig_4_9(report: Report) -> Report {
    completed(report, |report| {
        let unprinted = FROM_FIRST_AND_THIRD;
        let structure = structure(&unprinted)?;
        let actuator = compensated(&unprinted)?;
        let ground = actuators(&unprinted)?[0];
        for d in [1.0, 3.0] {
            let margin = actuator.closed_loop(&structure, d)?.stability_margin()?;
            report.holds(
                &format!(
                    "d = {d} with the minor loop: distance from the stability limit [rad/s], stable"
                ),
                margin,
                margin > 0.0,
            );
        }
        let margin = ground.closed_loop(&structure, 1.05)?.stability_margin()?;
        report.holds(
            "d = 1.05 without the minor loop: distance from the stability limit [rad/s], unstable",
            margin,
            margin < 0.0,
        );
        let ratios = [
            damping(&unprinted, 1.0)?,
            damping(&FROM_SECOND_AND_THIRD, 1.0)?,
        ];
        report.holds(
            "damping ratio at d = 1, 0.045 measured, of 0.003: more than a power of ten higher",
            ratios[0],
            ratios[0] > 10.0 * STRUCTURAL_DAMPING,
        );
        report.note(&format!(
            "Computed damping ratios at d = 1: {:.3} with the data recovered from the limits 1 and 32, {:.3} from 21 \
             and 32; the book measured 0.045. {CONTRADICTION}",
            ratios[0], ratios[1]
        ));
        report.note(
            "Minor loop with alpha = .7. With beta = epsilon = .05 as printed, eq. (4.12) leaves the damping \
             unchanged. Figs. 4.11, 4.12 (d = 5, where sampling makes the second mode vibrate) need that mode's shape, \
             which is not printed: they cannot be reproduced.",
        );
        const STEP: f64 = 0.01;
        let free = |d: f64, mass: &fuyu_lti::ProofMass| impulse(&structure, mass, d, STEP, 1001);
        // Without control: the structure alone.
        let alone = structure.rate_system()?.impulse_response(0, STEP, 1001)?;
        let alone = sampled("no actuator", STEP, alone.into_iter().map(|y| y[0]));
        let panel = |label: &str, curve| over_time(label, vec![curve]);
        let figure = time_figure(
            "Kida 1993 Figs. 4.8-4.10: rate at the actuator after an impulse",
            vec![
                panel("no control [m/s]", alone),
                panel(
                    "d = 1 [m/s]",
                    sampled("minor loop", STEP, free(1.0, &actuator)?),
                ),
                panel(
                    "d = 3 [m/s]",
                    sampled("minor loop", STEP, free(3.0, &actuator)?),
                ),
                panel(
                    "d = 1.5 [m/s]",
                    sampled("no minor loop", STEP, free(1.5, &ground)?),
                ),
            ],
        );
        report.figures.push(("kida-fig-4.9".to_owned(), figure));
        Ok(())
    })
}
