//! Chapter 3 of Masutani 1995: evaluation of the estimation of tumbling motions.
//!
//! The thesis prints its tables of models, but its errors only as surface plots whose values cannot be read. So the error
//! maps are checked against the statements of the text and, where an independent implementation (Python, numpy and scipy)
//! of the same method is known, against its medians. Results of bundle adjustment on the same images are added for
//! comparison.

mod catalogue;
mod claims;
mod error_maps;
mod model_tables;
mod pliers;
mod statistics;
mod study;
mod waveforms;

pub(super) use catalogue::TUMBLING;

use super::Report;
use crate::experiments::{MapFigure, MapPanel, MapScale};

/// The number of a table or figure, such as `3.18`, from the report's name.
fn number(report: &Report) -> &str {
    report.name.rsplit('-').next().unwrap_or_default()
}

/// A figure of panels over the grid of isotropy and momentum.
fn map(title: String, grid: &study::Grid, scale: MapScale, panels: Vec<MapPanel>) -> MapFigure {
    MapFigure {
        title,
        x_label: "isotropy e [-]".to_owned(),
        y_label: "momentum s_alpha [-]".to_owned(),
        x: grid.isotropies.clone(),
        y: grid.momenta.clone(),
        scale,
        panels,
    }
}
