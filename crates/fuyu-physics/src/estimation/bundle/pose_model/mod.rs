//! Models of the body's pose in every frame, whose parameters bundle adjustment estimates.
//!
//! [`independent_poses`]: one pose per frame, no dynamics. [`free_positions`]: torque-free rotation, with an
//! independent position in each frame. [`linear_com_motion`]: torque-free rotation, centre of mass on a straight line.
//! [`disturbed`]: with disturbances. Another motion of the centre of mass is another file here that implements
//! [`PoseModel`] and [`TumblingModel`].

mod disturbance_basis;
pub mod disturbed;
pub mod free_positions;
pub mod independent_poses;
pub mod linear_com_motion;

pub use disturbance_basis::responses;

use nalgebra::{SMatrix, SVector, UnitQuaternion, Vector3};

use super::intrinsics::Intrinsics;

/// Pose of the body in one frame: `x_C = R_CB p_B + t_C`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct FramePose {
    /// Body axes in camera axes.
    pub R_CB: UnitQuaternion<f64>,
    /// The body's origin in camera axes, in units of the mean depth of all points.
    pub t_C: Vector3<f64>,
}

/// The body's pose in every frame as a function of `L` unknowns per frame (the last `L` of rotation and translation;
/// none if the common unknowns determine the pose) and `G` common unknowns, the last of which are intrinsics of the
/// camera.
pub trait PoseModel<const L: usize, const G: usize>: Sized {
    /// Number of intrinsics among the common unknowns, the first ones of [`Intrinsics`].
    const CAMERA: usize;
    /// The body's pose in frame `i`.
    fn pose(&self, i: usize) -> FramePose;
    /// Derivatives of the pose in frame `i` by the common unknowns: rotation (body axes), then translation (camera
    /// axes).
    fn pose_by_common(&self, i: usize) -> SMatrix<f64, 6, G>;
    /// Effective number of common unknowns that the prior determines instead of the images.
    fn held(&self) -> f64 {
        0.0
    }
    /// The camera's intrinsics.
    fn intrinsics(&self) -> Intrinsics;
    /// The model after a step in its unknowns; `None` if the step leads to an invalid model (no such inertia, for
    /// example).
    fn moved(&self, frames: &[SVector<f64, L>], common: &SVector<f64, G>) -> Option<Self>;
    /// Prior on the common unknowns: weights \[px²\], and deviations from the expected values.
    fn prior(&self) -> (SVector<f64, G>, SVector<f64, G>);
}

/// A pose model whose rotation is a torque-free motion, and the variations of it that the same images may allow.
pub trait TumblingModel: Sized {
    /// Angle that the body turns over all frames \[rad\].
    fn turn(&self) -> f64;
    /// Angular velocity in the middle frame, inertial axes \[rad/s\].
    fn rate(&self) -> Vector3<f64>;
    /// Body axes in camera axes in the middle frame.
    fn middle_attitude(&self) -> UnitQuaternion<f64>;
    /// The motion to start from if all depths are multiplied by `factor`: spherical inertia, origin at `centre` (body
    /// axes), and the angular velocity across the line of sight divided by `factor`.
    fn with_scaled_depths(&self, factor: f64, centre: &Vector3<f64>) -> Option<Self>;
    /// Angle between angular velocity and angular momentum \[rad\].
    fn nutation(&self) -> f64;
    /// The same motion with spherical inertia.
    fn with_spherical_inertia(&self) -> Option<Self>;
    /// The same motion in the frames `chosen` alone, ascending, including the first and the last one.
    fn in_frames(&self, chosen: &[usize]) -> Self;
    /// The motion of `other`, a model of some of these frames ([`TumblingModel::in_frames`]), extended to all of them.
    fn with_motion_of(&self, other: &Self) -> Self;
}
