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
//! 3. `attitude_fit`: the torque-free motion nearest to the attitudes. Tracks too short for stage 1 give rotations
//!    between neighbouring frames instead, and `relative_rotation` fits the motion to those.
//! 4. `global_adjustment`: bundle adjustment of points and motion together, over all frames (`model_fit`). The centre of
//!    mass moves on a straight line (`pose_model::linear_com_motion`) or, where the images contradict this, has an
//!    independent position in each frame (`pose_model::free_positions`). For pixels that are whole numbers, the
//!    likelihood of rounding refines the result (`pixel_likelihood`). After a short rotation other depths are tried
//!    (`ambiguity`).
//!
//! If that fails, tracks with reused ids are split (`reused_track_ids`), and the solver starts again.
//!
//! The result is a [`Solution`]: motion with covariance, shape, poses, and a diagnosis of what the data do not determine.
//! The motion is represented by inertia and momentum, without principal axes, so spheres, symmetric bodies and spins
//! about one axis need no special cases; what is not determined for them is reported.
//!
//! Masutani 1995 ([`super::masutani1995`]) estimates from angular velocities alone; this uses every image point.

mod adjust;
mod ambiguity;
mod attitude_fit;
mod camera_motion;
mod envelope;
mod five_point;
mod frames;
mod free_motion;
mod global_adjustment;
mod inlier_gate;
mod intrinsics;
mod key_frames;
mod known_rotation;
mod linear_inertia;
mod model_fit;
mod pixel_likelihood;
mod pose_model;
mod relative_pose;
mod relative_rotation;
mod resection;
mod reused_track_ids;
mod rotations;
mod scene;
mod schur;
mod sensitivity_propagation;
mod solve;
mod structure;
mod transferred_structure;
mod uncertainty;

use nalgebra::{Matrix3, SMatrix, UnitQuaternion, Vector3};

pub use camera_motion::{CameraMotion, rotation_between};

pub(super) use camera_motion::attitude_at;
pub(super) use free_motion::{FreeMotion, PARAMETERS, shape_basis, shape_times};
pub(super) use uncertainty::derivatives;

use super::{EstimateError, MotionEstimate, Tracks};
use crate::vision::Pinhole;

/// Least number of points that neighbouring frames must share.
const MIN_POINTS: usize = 8;

/// Least number of frames with features.
const MIN_FRAMES: usize = 8;

/// Options of the estimation, and what is known besides the tracks.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Standard deviation of an image coordinate \[px\]. The default is that of rounding to whole pixels (0.29,
    /// rounded up); it is increased if the tracks are noisier.
    pub pixel_noise: f64,
    /// Whether the focal length is estimated as well, starting from the camera's value.
    pub estimate_focal_length: bool,
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
            estimate_focal_length: false,
            camera_motion: CameraMotion::Fixed,
            points_per_frame: 60,
            seed: 1,
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
}

/// Pose of the body in one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BodyPose {
    /// Time \[s\].
    pub time: f64,
    /// Body axes in the camera's axes of that frame.
    pub R_CB: UnitQuaternion<f64>,
    /// The body's origin in the camera's axes, in units of the mean depth: the centre of mass if that moves on
    /// a straight line, otherwise an arbitrary point of the body.
    pub t_C: Vector3<f64>,
}

/// Result of bundle adjustment.
#[derive(Debug, Clone, PartialEq)]
pub struct Solution {
    /// The motion, in inertial axes: the camera's, or those of [`Options::camera_motion`].
    pub motion: MotionEstimate,
    /// The body's feature points.
    pub points: Vec<BodyPoint>,
    /// Pose of the body in all frames that show enough points.
    pub poses: Vec<BodyPose>,
    /// The camera, with the estimated focal length if [`Options::estimate_focal_length`] is set.
    pub camera: Pinhole,
    /// Standard deviation of the estimated focal length, relative to its value.
    pub focal_deviation: Option<f64>,
    /// Outliers as a share of all image points.
    pub outliers: f64,
    /// Remarks for the user, one line each; empty if everything is well determined.
    pub diagnosis: Vec<String>,
    /// The fitted motion.
    pub(super) free: FreeMotion,
    /// Covariance of the fitted motion's eight parameters.
    pub(super) covariance: SMatrix<f64, PARAMETERS, PARAMETERS>,
}

impl Solution {
    /// Covariance of the rotation from `from` to `to` \[s\] as given by [`Solution::motion`]: of the rotation vector of its
    /// error, in body axes at `to` \[rad²\]. With both times after the last frame it is that of a prediction.
    pub fn turn_covariance(&self, from: f64, to: f64) -> Matrix3<f64> {
        let (first, last) = (from.min(to), from.max(to));
        let attitudes = self.free.attitudes_and_sensitivities(&[first, last]);
        let (R_first, S_first) = attitudes[0];
        let (R_last, S_last) = attitudes[1];
        let turn = R_last.inverse() * R_first;
        let across = S_last - turn.to_rotation_matrix() * S_first;
        let covariance = across * self.covariance * across.transpose();
        if from <= to {
            return covariance;
        }
        let back = turn.inverse().to_rotation_matrix();
        back * covariance * back.transpose()
    }
}

/// Estimates the motion of the rigid body that `tracks` show.
///
/// # Errors
/// [`EstimateError`] if the tracks contain too little data, do not move, or are not those of a freely rotating rigid body.
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
