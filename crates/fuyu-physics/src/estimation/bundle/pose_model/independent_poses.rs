//! One independent pose per frame: structure and motion without dynamics.

use nalgebra::{SMatrix, SVector};

use super::super::intrinsics::{Intrinsics, focal_prior_weight};
use super::{FramePose, PoseModel};
use crate::spatial::exp_so3;

/// A pose for each frame, and the focal length.
#[derive(Debug, Clone, PartialEq)]
pub struct IndependentPoses {
    /// By frame.
    pub poses: Vec<FramePose>,
    /// Logarithm of the focal length over its nominal value.
    pub log_focal: f64,
    focal_deviation: f64,
}

/// Image noise for the weight of the focal length's prior \[px\]: rounding to whole pixels.
const NOISE: f64 = 0.3;

impl IndependentPoses {
    /// Poses with the nominal focal length; `focal_deviation` is its relative standard deviation, zero to hold it.
    pub fn new(poses: Vec<FramePose>, focal_deviation: f64) -> Self {
        Self {
            poses,
            log_focal: 0.0,
            focal_deviation,
        }
    }
}

impl PoseModel<6, 1> for IndependentPoses {
    const CAMERA: usize = 1;

    fn pose(&self, i: usize) -> FramePose {
        self.poses[i]
    }

    fn pose_by_common(&self, _: usize) -> SMatrix<f64, 6, 1> {
        SMatrix::zeros()
    }

    fn intrinsics(&self) -> Intrinsics {
        Intrinsics::of_focal(self.log_focal)
    }

    fn moved(&self, frames: &[SVector<f64, 6>], common: &SVector<f64, 1>) -> Option<Self> {
        let moved = self.poses.iter().zip(frames).map(|(pose, step)| {
            let turn = step.fixed_rows::<3>(0).into_owned();
            let mut R_CB = pose.R_CB * exp_so3(&turn);
            R_CB.renormalize_fast();
            let t_C = pose.t_C + step.fixed_rows::<3>(3);
            FramePose { R_CB, t_C }
        });
        Some(Self {
            poses: moved.collect(),
            log_focal: self.log_focal + common[0],
            focal_deviation: self.focal_deviation,
        })
    }

    fn prior(&self) -> (SVector<f64, 1>, SVector<f64, 1>) {
        let weight = focal_prior_weight(self.focal_deviation, NOISE);
        (
            SVector::<f64, 1>::new(weight),
            SVector::<f64, 1>::new(self.log_focal),
        )
    }
}
