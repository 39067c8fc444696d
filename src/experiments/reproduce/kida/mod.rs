//! Kida 1993, "Control of large space structures": its tables, figures and verdicts.
//!
//! The book prints tables in chapters 2 and 3. Its figures are lost or show curves without numbers, so rows on figures
//! compare with the statements of the text, in fuyu's wording. Where the data of a figure are not printed, the
//! notes say what was recovered.

mod air_table;
mod catalogue;
mod designs;
mod diagrams;
mod double_loop;
mod feedback;
mod loop_shaping;
mod proof_mass;
mod servicer;
mod shaping;
mod tables;
mod truss_control;
mod truss_modes;
mod two_degrees;
mod zero_theorems;

pub(super) use catalogue::KIDA;

use super::Report;

/// Result of computing a report. No failure occurs with the published data.
type Outcome = Result<(), Box<dyn std::error::Error>>;

/// Completes a report by `fill`. A failure becomes a row that is not reproduced.
fn completed(mut report: Report, fill: impl FnOnce(&mut Report) -> Outcome) -> Report {
    if let Err(error) = fill(&mut report) {
        report.holds(&error.to_string(), f64::NAN, false);
    }
    report
}

/// The number of a table or figure, such as `3.18`, from the report's name.
fn number(report: &Report) -> &str {
    report.name.rsplit('-').next().unwrap_or_default()
}
