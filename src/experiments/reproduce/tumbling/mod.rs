//! Chapter 3 of Masutani 1995: the estimation of tumbling motions, judged.
//!
//! The thesis prints its tables of models, but its errors only as pictures of surfaces, whose values cannot be
//! read. So the error maps are held to what the text says of them and, where an independent implementation
//! (Python, numpy and scipy) of the same method is known, to its medians. Beside the thesis's method stands bundle
//! adjustment on the same images.

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

/// Maps over isotropy and momentum.
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
