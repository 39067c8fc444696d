//! The motion of an unknown tumbling body from feature tracks, by bundle adjustment with free rotation as the model.
//!
//! It goes from what needs no start to what needs a good one (Masutani 1995 estimates from angular velocities alone;
//! this uses every image point):
//!
//! 1. `structure`: shape and pose in each frame. Rotations between key frames (`relative_pose`: Weng's
//!    linear method, five points with RANSAC where correspondences are wrong), linear structure
//!    (`known_rotation`), bundle adjustment (`adjust`, on the block solver `schur`).
//! 2. `fit_inertia_and_momentum`: inertia and momentum from the attitudes, linearly, since momentum is constant.
//! 3. `attitude_fit`: the free motion nearest to the attitudes. Tracks too short for 1. give rotations between
//!    neighbouring frames instead, and `relative_rotation` fits the motion to those.
//! 4. `whole`: bundle adjustment of points and motion together, over all frames at once (`fit`): with the centre of
//!    mass on a straight line (`straight`), or, where the images object, anywhere in each frame (`dynamic`). If
//!    pixels are whole numbers, it ends with the likelihood of that (`loss`). A short turn is tried with other depths,
//!    too (`rivals`).
//!
//! Where that fails, tracks whose id was given to another point are cut (`reborn`), and it starts again.
//!
//! What comes out is a [`Solution`]: motion with covariance, shape, poses, and a diagnosis of what the data
//! leave open. The motion is stated as inertia and momentum, without principal axes, so spheres, tops and
//! spins about one axis are no special cases; their ambiguity is told, not hidden.

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

pub use camera_motion::{CameraMotion, attitude_at, rotation_between};

pub(super) use free_motion::{FreeMotion, PARAMETERS, shape_basis, shape_times};
pub(super) use uncertainty::derivatives;

use super::{EstimateError, MotionEstimate, Tracks};
use crate::vision::Pinhole;

/// The fewest points that neighbouring frames must share.
pub const MIN_POINTS: usize = 8;

/// The fewest frames.
pub const MIN_FRAMES: usize = 8;

/// What to estimate, and what is known besides the tracks.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Standard deviation of an image coordinate \[px\]. What rounding to pixels leaves (0.29) unless more is known;
    /// it is raised if the tracks turn out to be noisier.
    pub pixel_noise: f64,
    /// Whether the focal length is estimated, too; the camera's value is then the start.
    pub estimate_focal_length: bool,
    /// How the camera itself turns.
    pub camera_motion: CameraMotion,
    /// Most points of a frame that are used; those of the longest tracks are preferred.
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
    /// Where it is, in body axes; the unit of length is the mean depth of all points seen.
    pub p_B: Vector3<f64>,
}

/// Where the body was in one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BodyPose {
    /// When \[s\].
    pub time: f64,
    /// Body axes in the camera's axes of that frame.
    pub R_CB: UnitQuaternion<f64>,
    /// The body's origin in the camera's axes, in units of the mean depth: its centre of mass if that moves in a
    /// straight line, else some point of the body.
    pub t_C: Vector3<f64>,
}

/// The answer.
#[derive(Debug, Clone, PartialEq)]
pub struct Solution {
    /// The motion, in inertial axes: the camera's, or those of [`Options::camera_motion`].
    pub motion: MotionEstimate,
    /// The shape.
    pub points: Vec<BodyPoint>,
    /// Where the body was, in all frames that show enough of it.
    pub poses: Vec<BodyPose>,
    /// The camera, with the focal length found if that was asked for.
    pub camera: Pinhole,
    /// Standard deviation of that focal length over its value.
    pub focal_deviation: Option<f64>,
    /// Image points that were left out as wrong, of all.
    pub outliers: f64,
    /// What to know about the answer, one line each; empty if all is well determined.
    pub diagnosis: Vec<String>,
    /// The motion as it was fitted.
    pub(super) free: FreeMotion,
    /// Covariance of its eight parameters.
    pub(super) covariance: SMatrix<f64, PARAMETERS, PARAMETERS>,
}

impl Solution {
    /// Covariance of the turn from `from` to `to` \[s\] as [`Solution::motion`] tells it: of the error's rotation
    /// vector, in body axes at `to` \[rad²\]. With both times after the last frame it is that of a prediction.
    pub fn turn_covariance(&self, from: f64, to: f64) -> Matrix3<f64> {
        let (first, last) = (from.min(to), from.max(to));
        let swept = self.free.attitudes_and_sensitivities(&[first, last]);
        let (R_first, S_first) = swept[0];
        let (R_last, S_last) = swept[1];
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

/// Estimates the motion of the one rigid body that `tracks` show.
///
/// # Errors
/// [`EstimateError`] if the tracks hold too little, do not move, or are not those of a freely turning rigid body.
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
