//! Medians and maxima of sweeps.

use std::fmt::Write;

use super::study::{Cell, Study};
use crate::estimation::{EstimationMethod, MotionModel};
use crate::experiments::reproduce::Report;

/// Median of the finite values; NaN if there are none.
pub(super) fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.filter(|v| v.is_finite()).collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Maximum of the finite values; NaN if there are none.
pub(super) fn largest(values: impl Iterator<Item = f64>) -> f64 {
    let finite = values.filter(|v| v.is_finite());
    finite.fold(f64::NAN, f64::max)
}

/// Lists errors of both methods side by side; bundle adjustment only for image input.
pub(super) fn list_errors(report: &mut Report, study: &Study, methods: &[EstimationMethod]) {
    let mut listing = format!(
        "{:<32}{:>8}{:>22}{:>22}{:>22}\n{:<32}{:>8}{:>22}{:>22}{:>22}\n",
        "method, over cells",
        "cells",
        "r [-]",
        "Theta [deg]",
        "Phi [deg]",
        "",
        "",
        "median / largest",
        "median / largest",
        "median / largest"
    );
    for &method in methods {
        let cells = study.cells(method);
        for (over, model) in [("asymmetric", Some(MotionModel::Asymmetric)), ("all", None)] {
            let belongs = |c: &&Cell| model.is_none() || c.model == model;
            let cells: Vec<_> = cells.iter().filter(belongs).collect();
            let answered = cells.iter().filter(|c| c.estimated()).count();
            let pair = |i: usize, unit: f64| {
                let values = || cells.iter().map(|c| c.errors[i] * unit);
                format!("{:.2e} / {:.2e}", median(values()), largest(values()))
            };
            let degree = 1f64.to_degrees();
            let _ = writeln!(
                listing,
                "{:<32}{answered:>8}{:>22}{:>22}{:>22}",
                format!("{}, {over}", method.name()),
                pair(0, 1.0),
                pair(1, degree),
                pair(2, degree)
            );
        }
    }
    report.listings.push(listing);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_number_does_not_count() {
        let values = [3.0, f64::NAN, 1.0, 2.0, f64::INFINITY];
        assert_eq!(median(values.into_iter()), 2.0);
        assert_eq!(largest(values.into_iter()), 3.0);
        assert!(median(std::iter::empty()).is_nan() && largest(std::iter::empty()).is_nan());
    }
}
