//! Table 3.1 and Fig. 3.5: the air table.

use fuyu_lti::kida1993::air_table::{
    DAMPING, FREQUENCIES_HZ, SHAPES, hybrid, plant, table_3_1 as modes_of,
};
use fuyu_lti::{Matrix, Structure};
use std::f64::consts::TAU;

use super::completed;
use super::diagrams::{bode, marks, pole_map, upper};
use crate::experiments::Mark;
use crate::experiments::reproduce::Report;

pub(super) fn table_3_1(report: Report) -> Report {
    completed(report, |report| {
        let model = hybrid()?;
        for (i, row) in modes_of(&model)?.iter().enumerate() {
            let mode = i + 1;
            report.near(
                &format!("mode {mode}: frequency [Hz]"),
                FREQUENCIES_HZ[i],
                row.frequency_hz,
                1e-9,
            );
            report.near(
                &format!("mode {mode}: shape at the axis [kg^-1/2 m^-1]"),
                SHAPES[i],
                row.shape,
                1e-9,
            );
        }
        // The text before Table 3.1: frequencies of the clamped panel.
        for (i, what, printed, tolerance) in [
            (3, "torsion", 11.83, 5e-3),
            (5, "in-plane bending", 17.37, 1.5e-2),
        ] {
            report.near(
                &format!("clamped panel, {what} [Hz], section 3.4"),
                printed,
                model.constrained_hz[i],
                tolerance,
            );
        }
        report.note(
            "Table 3.1 is data: the hybrid model (a base with a clamped panel, eq. (3.17)) is computed from it, and \
             its modes from that model. The clamped panel's frequencies of Fig. 3.4 are lost but for the two in the \
             text; the table's values are corrected by identification, the text says, so the second differs by 0.01 \
             Hz.",
        );
        report.note(&format!(
            "Moment of inertia {:.4} kg m²; clamped frequencies {} Hz.",
            model.inertia,
            model.constrained_hz.map(|f| format!("{f:.3}")).join(", ")
        ));
        Ok(())
    })
}

/// The air table with some modes, numbered from 1 as in Table 3.1.
fn with_modes(modes: &[usize]) -> Result<fuyu_lti::StateSpace, fuyu_lti::LtiError> {
    let frequencies: Vec<f64> = modes.iter().map(|m| TAU * FREQUENCIES_HZ[m - 1]).collect();
    let shapes = Matrix::from_fn(modes.len(), 1, |i, _| SHAPES[modes[i] - 1]);
    let damping = vec![DAMPING; modes.len()];
    Structure::modal(&frequencies, &damping, &shapes)?.displacement_system()
}

pub(super) fn fig_3_5(report: Report) -> Report {
    completed(report, |report| {
        const RANGE: (f64, f64) = (1.0, 200.0);
        let (all, five) = (plant(7)?, with_modes(&[1, 2, 3, 4, 6])?);
        // Largest difference of the gains near the modes that are left out.
        let mut largest = 0.0_f64;
        for f in [FREQUENCIES_HZ[4], FREQUENCIES_HZ[6]] {
            for i in -200..=200 {
                let w = TAU * f * (1.0 + 1e-3 * f64::from(i));
                let [a, b] = [all.response(w)?, five.response(w)?].map(|g| g[(0, 0)].norm());
                largest = largest.max(20.0 * (a / b).log10().abs());
            }
        }
        report.holds(
            "modes 5 and 7 do not appear: what they change in the gain [dB], below 1",
            largest,
            largest < 1.0,
        );
        let zeros = all.zeros()?;
        let right = zeros.iter().filter(|z| z.re >= 0.0).count();
        report.holds(
            "minimum phase: zeros in the right half-plane: none",
            right as f64,
            right == 0,
        );
        // Theorem 2.3(b): the zeros are the clamped panel's modes.
        let model = hybrid()?;
        let mut found: Vec<f64> = upper(&zeros).iter().map(|z| z.0.hypot(z.1) / TAU).collect();
        found.sort_by(f64::total_cmp);
        let pairs = found.iter().zip(model.constrained_hz);
        let off = pairs.map(|(z, f)| (z / f - 1.0).abs()).fold(0.0, f64::max);
        report.holds(
            "zeros at the clamped panel's frequencies: largest relative difference (damped), below 1e-3",
            off,
            off < 1e-3 && found.len() == 6,
        );
        report.note(
            "The figure's curve has no numbers; its frequency axis is not legible in the scan.",
        );
        let figure = bode(
            "Kida 1993 Fig. 3.5: the air table, torque to angle",
            &[("seven modes", &all), ("without 5 and 7", &five)],
            RANGE,
            (-140.0, 20.0),
        )?;
        report.figures.push(("kida-fig-3.5".to_owned(), figure));
        let map = pole_map(
            "The air table: poles and zeros",
            vec![
                marks("poles", Mark::Cross, upper(&all.poles()?)),
                marks("zeros", Mark::Ring, upper(&zeros)),
            ],
            Some([(-0.7, 0.1), (-5.0, 120.0)]),
        );
        report.planes.push(("kida-fig-3.5-map".to_owned(), map));
        Ok(())
    })
}
