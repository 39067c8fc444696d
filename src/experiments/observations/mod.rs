//! Observations of a tumbling body, from a bag or a CSV file.

mod bag;
mod csv;
mod images;

use std::path::Path;

use nalgebra::Vector3;

use crate::{
    estimation::Tracks,
    nodes::tracker::TrackerParams,
    vision::{Distortion, Pinhole},
};

/// Observations of one body.
#[derive(Debug, Clone, PartialEq)]
pub enum Observations {
    /// Image points over time.
    Tracks(ObservedTracks),
    /// Angular velocity over time: time \[s\] and components in the camera's axes \[rad/s\].
    AngularVelocity(Vec<(f64, Vector3<f64>)>),
}

/// Image points of one body, with calibration and rotation of the camera.
#[derive(Debug, Clone, PartialEq)]
pub struct ObservedTracks {
    /// The points.
    pub tracks: Tracks,
    /// The camera, if the recording has its calibration.
    pub camera: Option<Pinhole>,
    /// Its lens distortion, if the recording has it.
    pub distortion: Option<Distortion>,
    /// The camera's own angular velocity over time, in its own axes \[rad/s\]; empty if it was not
    /// measured.
    pub w_WC_C: Vec<(f64, Vector3<f64>)>,
    /// Random walk of the integrated gyro \[rad/√s\], from the covariance that its messages give.
    pub gyro_noise: Option<f64>,
}

impl Observations {
    /// Reads a bag (a folder or a `.mcap` file) or, any other file, a CSV table.
    ///
    /// # Errors
    /// A line that names the file, and topic or line and column.
    pub fn read(path: &Path) -> Result<Self, String> {
        let is_bag = path.is_dir() || path.extension().is_some_and(|e| e == "mcap");
        if is_bag {
            bag::read(path, None).map(Self::Tracks)
        } else {
            csv::read(path)
        }
    }

    /// Tracks points through the images on `camera/image_raw` (or `camera/image_raw/compressed`) of a bag, or through the PNG files of a
    /// folder, which `frame_rate` \[Hz\] gives times; without it, their names do.
    ///
    /// # Errors
    /// A line that names the file, and topic and field.
    pub fn track(
        path: &Path,
        params: &TrackerParams,
        frame_rate: Option<f64>,
    ) -> Result<Self, String> {
        match images::is_folder_of_images(path) {
            true => images::read(path, params, frame_rate),
            false => bag::read(path, Some(params)),
        }
        .map(Self::Tracks)
    }
}
