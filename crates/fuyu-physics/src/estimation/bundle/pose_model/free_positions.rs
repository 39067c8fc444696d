//! Torque-free rotation with an independent position in every frame.
//!
//! Unknowns: the motion's eight parameters, the points, and the position of the body's origin in each frame. The
//! positions are independent on purpose: neither the orbit nor the camera's path need be known, at little loss of
//! accuracy.

use std::borrow::Cow;

use nalgebra::{SMatrix, SVector, UnitQuaternion, Vector3};

use super::super::free_motion::{FreeMotion, PARAMETERS, SHAPE_SPREAD, Sensitivity, shape_of};
use super::super::intrinsics::{Intrinsics, focal_prior_weight};
use super::{FramePose, PoseModel, TumblingModel};

/// Number of common unknowns: the motion's parameters and the focal length.
pub const COMMON: usize = PARAMETERS + 1;

/// A torque-free rotation, with a position in each frame.
#[derive(Debug, Clone, PartialEq)]
pub struct FreePositions<'a> {
    /// The rotation.
    pub motion: FreeMotion,
    /// The body's origin in camera axes, in each frame.
    pub t_C: Vec<Vector3<f64>>,
    /// Logarithm of the focal length over its nominal value.
    pub log_focal: f64,
    times: Cow<'a, [f64]>,
    R_WC: Cow<'a, [UnitQuaternion<f64>]>,
    attitudes: Vec<(UnitQuaternion<f64>, Sensitivity)>,
    focal_deviation: f64,
    noise: f64,
    /// Standard deviation of the prior on the inertia's shape; small for a body that is taken to be a sphere.
    pub shape_spread: f64,
}

impl<'a> FreePositions<'a> {
    /// `motion` for frames at `times` (ascending) of a camera with attitudes `R_WC`; `focal_deviation` is the relative
    /// standard deviation of the nominal focal length, zero to hold it.
    pub fn new(
        motion: FreeMotion,
        t_C: Vec<Vector3<f64>>,
        times: &'a [f64],
        R_WC: &'a [UnitQuaternion<f64>],
        noise: f64,
        log_focal: f64,
        focal_deviation: f64,
    ) -> Self {
        Self {
            attitudes: motion.attitudes_and_sensitivities(times),
            motion,
            t_C,
            times: Cow::Borrowed(times),
            R_WC: Cow::Borrowed(R_WC),
            log_focal,
            focal_deviation,
            noise,
            shape_spread: SHAPE_SPREAD,
        }
    }

    /// The frames' times \[s\].
    pub fn times(&self) -> &[f64] {
        &self.times
    }
}

impl TumblingModel for FreePositions<'_> {
    fn turn(&self) -> f64 {
        let span = self.times.last().zip(self.times.first());
        self.rate().norm() * span.map_or(0.0, |(last, first)| last - first)
    }

    fn rate(&self) -> Vector3<f64> {
        let R_WB = self.attitudes[self.times.len() / 2].0;
        R_WB * self.motion.w_WB_B(&R_WB)
    }

    fn middle_attitude(&self) -> UnitQuaternion<f64> {
        self.pose(self.times.len() / 2).R_CB
    }

    fn with_scaled_depths(&self, factor: f64, centre: &Vector3<f64>) -> Option<Self> {
        let i = self.times.len() / 2;
        let mut rate = self.R_WC[i].inverse() * self.rate();
        rate.x /= factor;
        rate.y /= factor;
        let shape = SVector::<f64, 5>::zeros();
        let (R_WB, time) = (self.attitudes[i].0, self.times[i]);
        let motion = FreeMotion::new(&shape, self.R_WC[i] * rate, time, R_WB)?;
        let shifted = |i: usize| self.pose(i).R_CB * centre + self.t_C[i];
        Some(Self {
            t_C: (0..self.t_C.len()).map(shifted).collect(),
            attitudes: motion.attitudes_and_sensitivities(&self.times),
            motion,
            // Whether a sphere explains the images is not known for this motion.
            shape_spread: SHAPE_SPREAD,
            ..self.clone()
        })
    }

    fn nutation(&self) -> f64 {
        let w = self.motion.R_WB * self.motion.w_WB_B(&self.motion.R_WB);
        w.angle(&self.motion.momentum)
    }

    /// A sphere rotates about its angular momentum at a constant rate.
    fn with_spherical_inertia(&self) -> Option<Self> {
        let w = self.motion.R_WB * self.motion.w_WB_B(&self.motion.R_WB);
        let along = self.motion.momentum.normalize();
        let shape = SVector::<f64, 5>::zeros();
        let momentum = along * along.dot(&w);
        let motion = FreeMotion::new(&shape, momentum, self.motion.time, self.motion.R_WB)?;
        Some(Self {
            attitudes: motion.attitudes_and_sensitivities(&self.times),
            motion,
            shape_spread: 1e-6,
            ..self.clone()
        })
    }

    fn in_frames(&self, chosen: &[usize]) -> Self {
        Self {
            motion: self.motion,
            t_C: chosen.iter().map(|&i| self.t_C[i]).collect(),
            times: chosen.iter().map(|&i| self.times[i]).collect(),
            R_WC: chosen.iter().map(|&i| self.R_WC[i]).collect(),
            attitudes: chosen.iter().map(|&i| self.attitudes[i]).collect(),
            ..*self
        }
    }

    /// Between the frames of `other`, positions are interpolated linearly.
    fn with_motion_of(&self, other: &Self) -> Self {
        let position = |time: &f64| {
            let next = other.times.partition_point(|t| t <= time);
            let next = next.clamp(1, other.times.len() - 1);
            let (before, after) = (other.times[next - 1], other.times[next]);
            let share = (time - before) / (after - before).max(f64::MIN_POSITIVE);
            other.t_C[next - 1].lerp(&other.t_C[next], share)
        };
        Self {
            motion: other.motion,
            t_C: self.times.iter().map(position).collect(),
            attitudes: other.motion.attitudes_and_sensitivities(&self.times),
            log_focal: other.log_focal,
            shape_spread: other.shape_spread,
            ..self.clone()
        }
    }
}

impl PoseModel<3, COMMON> for FreePositions<'_> {
    const CAMERA: usize = 1;

    fn pose(&self, i: usize) -> FramePose {
        FramePose {
            R_CB: self.R_WC[i].inverse() * self.attitudes[i].0,
            t_C: self.t_C[i],
        }
    }

    fn pose_by_common(&self, i: usize) -> SMatrix<f64, 6, COMMON> {
        let mut pose = SMatrix::<f64, 6, COMMON>::zeros();
        pose.fixed_view_mut::<3, PARAMETERS>(0, 0)
            .copy_from(&self.attitudes[i].1);
        pose
    }

    fn intrinsics(&self) -> Intrinsics {
        Intrinsics::of_focal(self.log_focal)
    }

    fn moved(&self, frames: &[SVector<f64, 3>], common: &SVector<f64, COMMON>) -> Option<Self> {
        let step = common.fixed_rows::<PARAMETERS>(0).into_owned();
        let motion = self.motion.moved(&step)?;
        Some(Self {
            attitudes: motion.attitudes_and_sensitivities(&self.times),
            motion,
            t_C: self.t_C.iter().zip(frames).map(|(t, d)| t + d).collect(),
            log_focal: self.log_focal + common[PARAMETERS],
            ..self.clone()
        })
    }

    /// Prior on the inertia's shape: a sphere within [`SHAPE_SPREAD`], which matters where the images do not determine
    /// the shape.
    fn prior(&self) -> (SVector<f64, COMMON>, SVector<f64, COMMON>) {
        let (mut weights, mut distance) = (SVector::zeros(), SVector::zeros());
        let shape = shape_of(&self.motion.inertia);
        for k in 0..5 {
            weights[k] = (self.noise / self.shape_spread).powi(2);
            distance[k] = shape[k];
        }
        weights[PARAMETERS] = focal_prior_weight(self.focal_deviation, self.noise);
        distance[PARAMETERS] = self.log_focal;
        (weights, distance)
    }
}
