//! Observations of a tumbling body, from a bag or a CSV file.

mod bag;
mod clouds;
mod csv;
mod images;
mod masks;
mod png;

use std::{
    fmt::Write as _,
    path::{Path, PathBuf},
};

use nalgebra::Vector3;

use crate::{
    estimation::{Tracks, bundle::MeasuredRange},
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

/// How points are tracked through recorded images.
#[derive(Debug, Clone, Default)]
pub struct Tracking {
    /// Parameters of the tracker. With `mask_id`, pixels with this value in the masks are the target: in the files of
    /// `mask`, or in `camera/segmentation` of a bag.
    pub params: TrackerParams,
    /// Images per second for a folder of PNG files \[Hz\]; without it, file names are times.
    pub frame_rate: Option<f64>,
    /// A PNG file with the mask of all images; or, for a folder of images, a folder of masks with the same file names.
    /// Pixels that are not 0 are the target.
    pub mask: Option<PathBuf>,
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
    /// Angular random walk of the integrated gyro \[rad/√s\], from the covariance in its messages.
    pub gyro_noise: Option<f64>,
    /// Distances of points from the camera, measured by point clouds of a bag.
    pub ranges: Vec<MeasuredRange>,
    /// The reason why point clouds were ignored, if any were.
    pub ignored_clouds: Option<String>,
}

impl ObservedTracks {
    /// Writes the points to a table that [`Observations::read`] reads: t \[s\], id, u, v \[px\].
    ///
    /// # Errors
    /// A line that names the file.
    pub fn write_csv(&self, path: &Path) -> Result<(), String> {
        let mut table = String::from("t,id,u,v\n");
        for frame in self.tracks.frames() {
            for f in &frame.features {
                // Writing to a string cannot fail.
                let _ = writeln!(table, "{},{},{},{}", frame.time, f.id, f.u, f.v);
            }
        }
        std::fs::write(path, table).map_err(|e| format!("{}: {e}", path.display()))
    }
}

impl Observations {
    /// Reads a bag (a folder or a `.mcap` file), or otherwise a CSV table.
    ///
    /// # Errors
    /// A line that names the file, and the topic, or line and column.
    pub fn read(path: &Path) -> Result<Self, String> {
        let is_bag = path.is_dir() || path.extension().is_some_and(|e| e == "mcap");
        if images::is_folder_of_images(path) {
            let path = path.display();
            Err(format!(
                "{path}: is a folder of PNG files; with --track, points are tracked through them"
            ))
        } else if is_bag {
            bag::read(path, None).map(Self::Tracks)
        } else {
            csv::read(path)
        }
    }

    /// Tracks points through the images on `camera/image_raw` (or `camera/image_raw/compressed`) of a bag, or through the PNG files of a
    /// folder.
    ///
    /// # Errors
    /// A line that names the file, and topic and field.
    pub fn track(path: &Path, tracking: &Tracking) -> Result<Self, String> {
        match images::is_folder_of_images(path) {
            true => images::read(path, tracking),
            false => bag::read(path, Some(tracking)),
        }
        .map(Self::Tracks)
    }
}
