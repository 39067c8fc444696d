//! Theorems 2.1 to 2.6.

use super::completed;
use crate::experiments::kida1993::zero_theorems::{Checked, collocated, not_collocated, uniform};
use crate::experiments::reproduce::Report;
use crate::experiments::{Dots, Figure, Panel};

/// Number of random structures for each theorem.
const COUNT: usize = 200;

/// Largest difference for collocated sensors and actuators.
const COLLOCATED: f64 = 1e-9;
/// Largest difference otherwise: without collocation zeros may be very large, where the general solver is less
/// accurate.
const ELSEWHERE: f64 = 1e-6;

pub(super) fn theorems(report: Report) -> Report {
    completed(report, |report| {
        let (uniform, collocated) = (uniform(COUNT)?, collocated(COUNT)?);
        let elsewhere = not_collocated(COUNT)?;
        let (exact, diagonal) = collocated.split_at(4);
        for checked in uniform.iter().chain(exact) {
            row(report, checked, COLLOCATED);
        }
        for checked in &elsewhere {
            row(report, checked, ELSEWHERE);
        }
        let right: usize = (uniform.iter().chain(exact))
            .map(|c| c.not_minimum_phase)
            .sum();
        report.holds(
            "Properties 2.2, 2.4: collocated systems that are not of minimum phase: none",
            right as f64,
            right == 0,
        );
        let [measured, _, driven, _] = &elsewhere;
        for (checked, where_) in [(measured, "sensors"), (driven, "actuators")] {
            report.holds(
                &format!(
                    "Property 2.5: {where_} elsewhere, not of minimum phase, of {COUNT}: some"
                ),
                checked.not_minimum_phase as f64,
                checked.not_minimum_phase > 20,
            );
        }
        report.holds(
            "2.4(b) with diagonal damping, as the book writes it, is not exact: largest difference, above 1e-3",
            diagonal[0].worst(),
            diagonal[0].worst() > 1e-3,
        );
        report.note(
            "Largest relative difference of a zero or pole from that of a solver for any linear system (reduction of \
             the system matrix, Emami-Naeini and Van Dooren 1982), which knows neither modes nor structure. The book \
             proves the theorems and gives no such numbers. In theorem 2.4(a) it prints J for the identity, in 2.6(a) \
             a transpose.",
        );
        let all = uniform.iter().chain(exact).chain(&elsewhere);
        let by_theorem = |digit: &str| -> Vec<f64> {
            let of_theorem = all.clone().filter(|c| c.theorem.starts_with(digit));
            let mut errors = vec![0.0_f64; COUNT];
            for checked in of_theorem {
                for (worst, error) in errors.iter_mut().zip(&checked.errors) {
                    *worst = worst.max(*error);
                }
            }
            // Errors of exactly zero cannot be drawn on a logarithmic axis.
            errors.iter().map(|e| e.max(1e-17)).collect()
        };
        let dots = ["2.1", "2.2", "2.3", "2.4", "2.5", "2.6"].map(|name| Dots {
            name: format!("theorem {name}"),
            points: (1..).map(f64::from).zip(by_theorem(name)).collect(),
            deviations: Vec::new(),
        });
        let (first, second) = dots.split_at(4);
        let panel = |dots: &[Dots]| Panel {
            y_label: "relative difference".to_owned(),
            dots: dots.to_vec(),
            log: true,
            ..Panel::default()
        };
        let figure = Figure {
            title: "Kida 1993 Theorems 2.1-2.6 against a general solver".to_owned(),
            x_label: "random structure".to_owned(),
            panels: vec![panel(first), panel(second)],
            ..Figure::default()
        };
        report.figures.push(("kida-theorems-2".to_owned(), figure));
        Ok(())
    })
}

fn row(report: &mut Report, checked: &Checked, limit: f64) {
    let what = if checked.theorem.ends_with("(a)") && checked.theorem < "2.5" {
        "poles"
    } else {
        "zeros"
    };
    let quantity = format!(
        "Theorem {}: {what} of {} structures, largest difference, below {limit:.0e}",
        checked.theorem,
        checked.errors.len()
    );
    report.holds(&quantity, checked.worst(), checked.worst() < limit);
}
