//! The simulations of Masutani 1995 chapter 3: a grid of motions, watched under a condition, estimated, and judged
//! by their prediction.

mod motions;
mod published;

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

use nalgebra::Translation3;

use super::errors::{PredictionError, parameter_error, prediction_error};
use super::free_body::FreeRotation;
use super::masutani1995::{self, Analysis, EstimateError, Rate, mean_rate};
use super::{MotionEstimate, MotionModel, Tracks};
use crate::spatial::Pose;
use crate::vision::{BodyPoint, FeatureCamera, FeatureCameraConfig, Pinhole};

pub use motions::{ISOTROPIES, MOMENTA, Motion, grid};
pub use published::{ModelTable, TABLE_3_2, TABLE_3_3, TABLE_3_4, TABLE_3_5, TABLE_3_6, TABLE_3_7};

/// Interval between frames \[s\], table 3.1.
pub const INTERVAL: f64 = 0.6;
/// Intervals observed: 360 s.
pub const INTERVALS: u32 = 600;
/// How far ahead a prediction is judged \[s\].
pub const HORIZON: f64 = 30.0;
/// Instants at which it is.
const INSTANTS: u32 = 101;
/// Width of the image plane over the focal length: 10 mm over 8 mm.
const WIDTH: f64 = 10.0 / 8.0;
/// Distance of the body from the camera and radius of the sphere that carries its points \[m\].
const DISTANCE: f64 = 0.9;
const RADIUS: f64 = 0.45;

/// What the estimation gets (Fig. 3.17).
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Condition<'a> {
    /// True angular velocities, one for each interval, at its beginning.
    TrueRates,
    /// True rotations between the frames.
    TrueRotations,
    /// Whole pixels of points on a sphere, all of them seen in each frame.
    Images {
        /// Pixels along each side of the image.
        resolution: u32,
        /// The points.
        points: &'a [BodyPoint],
    },
}

/// What came of one motion.
#[derive(Debug, Clone, PartialEq)]
pub struct Cell {
    /// The model chosen; `None` if the data allowed no choice.
    pub model: Option<MotionModel>,
    /// Errors of the estimate, or why there is none.
    pub result: Result<CellErrors, EstimateError>,
}

/// Errors of one estimate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CellErrors {
    /// Relative error `r` of the dynamic parameters.
    pub parameters: f64,
    /// Errors `Theta` and `Phi` of the prediction over [`HORIZON`] after the observation \[rad\].
    pub prediction: PredictionError,
}

/// The camera of table 3.1.
pub fn camera(resolution: u32) -> Pinhole {
    Pinhole::square(resolution, WIDTH)
}

/// Points on the sphere of table 3.1, which are others for every `seed`.
pub fn points(count: usize, seed: u64) -> Vec<BodyPoint> {
    BodyPoint::on_sphere(count, RADIUS, seed)
}

/// The tracks that the camera of table 3.1 makes of a motion about a fixed centre on its axis.
pub fn tracks(motion: &FreeRotation, resolution: u32, points: &[BodyPoint]) -> Tracks {
    let config = FeatureCameraConfig {
        quantised: true,
        ..FeatureCameraConfig::ideal(resolution, WIDTH)
    };
    let mut camera = FeatureCamera::new(config, points.to_vec());
    let mut tracks = Tracks::default();
    for i in 0..=INTERVALS {
        let time = INTERVAL * f64::from(i);
        let centre = Translation3::new(0.0, 0.0, DISTANCE);
        let attitude = motion.attitude(time).to_rotation_matrix();
        camera.show(time, &Pose::from_parts(centre, attitude));
        if let Some(sighting) = camera.deliver(time) {
            // Its times increase, its pixels are finite, its ids differ.
            let _ = tracks.push(sighting);
        }
    }
    tracks
}

/// The angular velocities that the estimation gets under a condition.
///
/// # Errors
/// [`EstimateError`] if the images show too little.
pub fn rates(motion: &FreeRotation, condition: Condition<'_>) -> Result<Vec<Rate>, EstimateError> {
    let time = |i: u32| INTERVAL * f64::from(i);
    let at = |i: u32| (time(i), motion.attitude(time(i)));
    Ok(match condition {
        Condition::TrueRates => (0..INTERVALS)
            .map(|i| (time(i), motion.angular_velocity(time(i))))
            .collect(),
        Condition::TrueRotations => (0..INTERVALS)
            .map(|i| mean_rate(at(i), at(i + 1)))
            .collect(),
        Condition::Images { resolution, points } => {
            let tracks = tracks(motion, resolution, points);
            masutani1995::rates_from_tracks(&tracks, &camera(resolution))?
        }
    })
}

/// The algorithm's options in chapter 3, which does without the aperiodic model.
pub fn options() -> masutani1995::Options {
    masutani1995::Options {
        aperiodic: false,
        ..Default::default()
    }
}

/// Estimates one motion by the thesis's method.
pub fn cell(motion: &FreeRotation, condition: Condition<'_>) -> Cell {
    let options = options();
    let analysis =
        rates(motion, condition).and_then(|rates| Ok((Analysis::new(&rates, &options)?, rates)));
    match analysis {
        Err(error) => Cell {
            model: None,
            result: Err(error),
        },
        Ok((analysis, rates)) => Cell {
            model: Some(analysis.model),
            result: (analysis.solve(&rates, &options))
                .map(|(estimate, _)| judge(&estimate, motion)),
        },
    }
}

/// The errors of an estimate after the whole observation.
pub fn judge(estimate: &MotionEstimate, truth: &FreeRotation) -> CellErrors {
    let end = INTERVAL * f64::from(INTERVALS);
    CellErrors {
        parameters: parameter_error(estimate, truth).unwrap_or(f64::NAN),
        prediction: prediction_error(estimate.rotation(), truth, end, HORIZON, INSTANTS),
    }
}

/// Does `work` for each of `items` on `threads` threads; the results are in the order of the items and do not
/// depend on the number of threads.
pub fn in_parallel<T: Sync, R: Send>(
    items: &[T],
    threads: usize,
    work: impl Fn(&T) -> R + Sync,
) -> Vec<R> {
    let next = AtomicUsize::new(0);
    let done = Mutex::new(Vec::with_capacity(items.len()));
    std::thread::scope(|scope| {
        for _ in 0..threads.clamp(1, items.len().max(1)) {
            scope.spawn(|| {
                while let Some((i, item)) = {
                    let i = next.fetch_add(1, Ordering::Relaxed);
                    items.get(i).map(|item| (i, item))
                } {
                    let result = work(item);
                    let mut done = done.lock().unwrap_or_else(PoisonError::into_inner);
                    done.push((i, result));
                }
            });
        }
    });
    let mut done = done.into_inner().unwrap_or_else(PoisonError::into_inner);
    done.sort_by_key(|(i, _)| *i);
    done.into_iter().map(|(_, result)| result).collect()
}
