//! Estimation of the motion of an unknown tumbling body from feature tracks, by bundle adjustment with torque-free
//! rotation as the model.
//!
//! The stages; each gives the initial values for the next:
//!
//! 1. `structure`: shape of the body and its pose in each frame, without dynamics. Rotations between key frames
//!    (`relative_pose`: Weng's linear method, five points with RANSAC for wrong correspondences), linear structure
//!    (`known_rotation`), resection of further frames (`resection`), bundle adjustment (`adjust`, on the block solver
//!    `schur`).
//! 2. `linear_inertia`: inertia and momentum from the attitudes by linear least squares, since momentum is constant.
//! 3. `attitude_fit`: the torque-free motion that fits the attitudes best. Where tracks are too short for stage 1,
//!    `relative_rotation` fits the motion to rotations between neighbouring frames instead.
//! 4. `global_adjustment`: bundle adjustment of points and motion together, over all frames (`model_fit`). The centre
//!    of mass moves on a straight line (`pose_model::linear_com_motion`) or, where the images contradict this, has an
//!    independent position in each frame (`pose_model::free_positions`). For pixels that are whole numbers, the
//!    likelihood of rounding refines the result (`pixel_likelihood`). After a short rotation other depths are tried
//!    (`ambiguity`).
//! 5. `disturbed_fit`: the same adjustment with torques, errors of gyro and calibration, and a curved path as further
//!    unknowns with priors; the evidence of the images selects the prior widths (`prior_scales`). Its normal equations give
//!    the covariance of the state at the last frame. Where the images do not determine the inertia, samples of other bodies
//!    show how differently they move, and whether one of them is more probable (`body_samples`).
//!
//! If these stages fail, tracks with reused ids are split (`reused_track_ids`), and the solver starts again.
//!
//! The result is a [`Solution`]: motion with covariance, shape, poses, and a diagnosis of what the data do not
//! determine. The motion is represented by inertia and momentum, without principal axes, so spheres, symmetric bodies
//! and spins about one axis need no special cases; the diagnosis reports what their motion leaves undetermined.
//!
//! Masutani 1995 ([`super::masutani1995`]) estimates from angular velocities alone; bundle adjustment uses every image
//! point.

mod adjust;
mod ambiguity;
mod attitude_fit;
mod autocorrelation_factor;
mod body_samples;
mod camera_motion;
mod disturbed_fit;
mod envelope;
mod five_point;
mod frames;
mod free_motion;
mod global_adjustment;
mod information;
mod inlier_gate;
mod intrinsics;
mod key_frames;
mod known_rotation;
mod linear_inertia;
mod model_fit;
mod pixel_likelihood;
mod pose_model;
mod prior_scales;
mod rate_search;
mod relative_pose;
mod relative_rotation;
mod resection;
mod reused_track_ids;
mod rotations;
mod scale;
mod scene;
mod schur;
mod sensitivity_propagation;
mod solve;
mod structure;
mod transferred_structure;
mod uncertainty;
mod white_noise;

use nalgebra::{Matrix3, SMatrix, UnitQuaternion, Vector3};

pub use camera_motion::{CameraMotion, rotation_between};

pub(super) use camera_motion::attitude_at;

pub use free_motion::FreeMotion;
pub use pose_model::disturbed::{Orbit, Widths};
pub use scale::{KnownLength, MeasuredRange, Scale, ScaleError};

pub(super) use attitude_fit::{SegmentAttitude, fit_attitudes};
pub(super) use free_motion::{PARAMETERS, SHAPE_SPREAD, shape_of, shape_times};
pub(super) use intrinsics::Intrinsics;
pub(super) use linear_inertia::{
    AttitudeSample, BodyRate, fastest_tumbling, fit_inertia_and_momentum,
};
pub(super) use pose_model::responses;
pub(super) use uncertainty::{derivatives, report_of_state};

use super::{EstimateError, MotionEstimate, MotionState, Tracks};
use crate::vision::Pinhole;

/// Least number of points that neighbouring frames must share for initialisation from their relative poses.
const MIN_POINTS: usize = 8;

/// Least number of points that neighbouring frames must share.
const LEAST_SHARED: usize = 4;

/// Least number of frames with features.
const MIN_FRAMES: usize = 8;

/// Options of the estimation, and prior knowledge.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Standard deviation of an image coordinate \[px\]. The default is that of rounding to whole pixels (0.29,
    /// rounded up); it is increased if the tracks are noisier.
    pub pixel_noise: f64,
    /// Prior standard deviations of the disturbances: torques, curvature of the path, errors of gyro and calibration.
    /// All disturbances are estimated.
    pub widths: Widths,
    /// The relative orbit, if its directions are known: the centre of mass then moves by the Clohessy-Wiltshire
    /// equations instead of on a straight line.
    pub orbit: Option<Orbit>,
    /// Whether the covariances of the points are computed.
    pub with_points: bool,
    /// Rotation of the camera.
    pub camera_motion: CameraMotion,
    /// Largest number of points that are used per frame; the longest tracks are preferred.
    pub points_per_frame: usize,
    /// Seed of the random samples. The same tracks and the same seed give the same answer.
    pub seed: u64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            pixel_noise: 0.3,
            widths: Widths::default(),
            orbit: None,
            with_points: false,
            camera_motion: CameraMotion::Fixed,
            points_per_frame: 60,
            seed: 1,
        }
    }
}

impl Options {
    /// Options for a free rotation before a camera whose calibration is exact, as in a simulation.
    pub fn undisturbed() -> Self {
        Self {
            widths: Widths::NONE,
            ..Self::default()
        }
    }
}

/// A feature point on the body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BodyPoint {
    /// The id of its track.
    pub id: u64,
    /// Position in body axes, in units of the mean depth of all points.
    pub p_B: Vector3<f64>,
    /// Covariance of the position, if [`Options::with_points`] is set.
    pub covariance: Option<Matrix3<f64>>,
}

/// Pose of the body in one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BodyPose {
    /// Time \[s\].
    pub time: f64,
    /// Body axes in the camera's axes of that frame.
    pub R_CB: UnitQuaternion<f64>,
    /// The body's origin in the camera's axes, in units of the mean depth: the centre of mass if its path is smooth,
    /// otherwise an arbitrary point of the body.
    pub t_C: Vector3<f64>,
}

/// Motion of the body's centre of mass at the last frame, in the axes of a camera that does not rotate. The unit of
/// length is the depth of the centre in the first frame, which the images do not determine.
#[derive(Debug, Clone, PartialEq)]
pub struct CentreMotion {
    /// Position.
    pub position: Vector3<f64>,
    /// Velocity \[1/s\].
    pub velocity: Vector3<f64>,
    /// Covariance of position and velocity.
    pub covariance: SMatrix<f64, 6, 6>,
}

/// Result of bundle adjustment.
#[derive(Debug, Clone, PartialEq)]
pub struct Solution {
    /// The motion, in inertial axes: those of the camera, or of [`Options::camera_motion`].
    pub motion: MotionEstimate,
    /// The body's feature points.
    pub points: Vec<BodyPoint>,
    /// Pose of the body in all frames that show enough points.
    pub poses: Vec<BodyPose>,
    /// The camera, with the estimated focal length and principal point.
    pub camera: Pinhole,
    /// First coefficient of the radial distortion that remains, as `k1` of `plumb_bob`.
    pub radial: f64,
    /// Standard deviation of the estimated focal length, relative to its value; `None` if it was given as exact.
    pub focal_deviation: Option<f64>,
    /// Outliers as a share of all image points.
    pub outliers: f64,
    /// Remarks for the user, one line each; empty if everything is well determined.
    pub diagnosis: Vec<String>,
    /// The state at the last frame.
    pub state: MotionState,
    /// The centre of mass at the last frame. `None` if its path is not smooth or the camera rotates: the images then do
    /// not determine which point of the body is the centre of mass.
    pub centre: Option<CentreMotion>,
}

impl Solution {
    /// Covariance of the error of the rotation from `from` to `to` \[s\] given by [`Solution::motion`]: of the rotation
    /// vector `error` in inertial axes \[rad²\], where `estimate = exp(error) truth`. With both times after the last
    /// frame it is the covariance of a prediction.
    pub fn turn_covariance(&self, from: f64, to: f64) -> Matrix3<f64> {
        self.state.covariance_between(from, to)
    }
}

/// Estimates the motion of the rigid body that `tracks` show.
///
/// # Errors
/// [`EstimateError`] if the tracks contain too little data, do not move, or are not those of a freely rotating rigid
/// body.
pub fn estimate(
    tracks: &Tracks,
    camera: &Pinhole,
    options: &Options,
) -> Result<Solution, EstimateError> {
    camera.check()?;
    if let Some(fault) = options.camera_motion.fault() {
        return Err(EstimateError::CameraMotion(fault));
    }
    solve::solve(tracks, camera, options)
}
