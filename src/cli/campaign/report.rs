//! The summary of a campaign as text.

use std::fmt::Write;

use crate::{
    cli::table::{number, shown},
    experiments::campaign::{Sensitivity, Summary},
};

/// Maximum number of reasons printed.
const REASONS: usize = 6;

/// Maximum number of rank correlations printed.
const SENSITIVITIES: usize = 12;

/// Largest p-value of a printed rank correlation: of a thousand independent pairs, one is expected to have a smaller
/// one.
const SIGNIFICANT: f64 = 1e-3;

pub(super) fn text(summary: &Summary) -> String {
    let mut out = String::new();
    // Writing to a string cannot fail.
    let _ = writeln!(
        out,
        "{}: {} of {} runs",
        shown(&summary.campaign),
        summary.completed,
        summary.runs
    );
    if let (Some(rate), Some(interval)) = (summary.success_rate, summary.confidence_interval) {
        let _ = writeln!(
            out,
            "  success rate {:.2} %, {} % interval {:.2} to {:.2} % ({})",
            100.0 * rate,
            100.0 * interval.confidence,
            100.0 * interval.lower,
            100.0 * interval.upper,
            interval.method
        );
    }
    let verdicts = summary.verdicts.iter().filter(|(_, count)| **count > 0);
    let verdicts: Vec<_> = verdicts
        .map(|(name, count)| format!("{count} {name}"))
        .collect();
    if !verdicts.is_empty() {
        let _ = writeln!(out, "  {}", verdicts.join(", "));
    }
    if let Some(time) = &summary.wall_time {
        let _ = writeln!(
            out,
            "  wall time per run: median {} s, largest {} s",
            number(time.p50),
            number(time.max)
        );
    }
    if !summary.reasons.is_empty() {
        out.push_str("\nno success because\n");
        for reason in summary.reasons.iter().take(REASONS) {
            let _ = writeln!(
                out,
                "  {:>7}  {} (first: run {})",
                reason.count,
                shown(&reason.reason),
                reason.first_run
            );
        }
    }
    quantiles(&mut out, summary);
    if !summary.worst.is_empty() {
        out.push_str("\nworst runs\n");
        let names: Vec<_> = summary.worst.iter().map(|worst| shown(&worst.by)).collect();
        let left = names.iter().map(|n| n.chars().count()).max().unwrap_or(0);
        for (worst, name) in summary.worst.iter().zip(&names) {
            let value = worst.value.map_or_else(|| "none".to_owned(), number);
            let _ = writeln!(out, "  {name:left$}  run {:<8} {value}", worst.run);
        }
    }
    sensitivities(&mut out, &summary.sensitivities);
    out
}

fn quantiles(out: &mut String, summary: &Summary) {
    if summary.results.is_empty() {
        return;
    }
    let header = ["", "mean", "5 %", "median", "95 %", "99 %", "max", "runs"];
    let mut rows = vec![header.map(str::to_owned)];
    for (name, q) in &summary.results {
        let [mean, p05, p50, p95, p99, max] =
            [q.mean, q.p05, q.p50, q.p95, q.p99, q.max].map(number);
        rows.push([
            shown(name),
            mean,
            p05,
            p50,
            p95,
            p99,
            max,
            q.count.to_string(),
        ]);
    }
    out.push_str("\nresults\n");
    let widths: [usize; 8] = std::array::from_fn(|i| {
        rows.iter()
            .map(|row| row[i].chars().count())
            .max()
            .unwrap_or(0)
    });
    for row in &rows {
        let mut line = format!("  {:w$}", row[0], w = widths[0]);
        for (cell, w) in row.iter().zip(widths).skip(1) {
            let _ = write!(line, "  {cell:>w$}");
        }
        out.push_str(line.trim_end());
        out.push('\n');
    }
}

fn sensitivities(out: &mut String, all: &[Sensitivity]) {
    let significant: Vec<_> = all.iter().filter(|s| s.p_value < SIGNIFICANT).collect();
    if significant.is_empty() {
        return;
    }
    out.push_str("\nrank correlations (Spearman) of results with parameters\n");
    let names: Vec<_> = significant
        .iter()
        .take(SENSITIVITIES)
        .map(|s| shown(&s.result))
        .collect();
    let left = names.iter().map(|n| n.chars().count()).max().unwrap_or(0);
    for (sensitivity, name) in significant.iter().zip(&names) {
        let _ = writeln!(
            out,
            "  {:>6.3}  {name:left$}  {}",
            sensitivity.rho,
            shown(&sensitivity.parameter)
        );
    }
    if significant.len() > SENSITIVITIES {
        let _ = writeln!(
            out,
            "  and {} weaker ones, see --json",
            significant.len() - SENSITIVITIES
        );
    }
}
