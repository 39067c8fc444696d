//! Frames that are each placed on their own: structure and motion without any dynamics.

use nalgebra::{SMatrix, SVector};

use super::super::adjust::{FramePose, PoseModel};
use crate::spatial::exp_so3;

/// One pose a frame, and the focal length if it is to be found.
#[derive(Debug, Clone, PartialEq)]
pub struct IndependentPoses {
    /// Of each frame.
    pub poses: Vec<FramePose>,
    /// Logarithm of the focal length over its nominal value.
    pub log_focal: f64,
    focal_free: bool,
}

/// Weight that holds the focal length where it is \[px²\].
pub const HELD: f64 = 1e14;

/// How well the nominal focal length is known where it is to be estimated: 10 %.
pub const FOCAL_SPREAD: f64 = 0.1;

impl IndependentPoses {
    /// Placements with the nominal focal length, which is an unknown or not.
    pub fn new(poses: Vec<FramePose>, focal_free: bool) -> Self {
        Self {
            poses,
            log_focal: 0.0,
            focal_free,
        }
    }
}

impl PoseModel<6, 1> for IndependentPoses {
    fn pose(&self, i: usize) -> FramePose {
        self.poses[i]
    }

    fn pose_by_common(&self, _: usize) -> SMatrix<f64, 6, 1> {
        SMatrix::zeros()
    }

    fn log_focal(&self) -> f64 {
        self.log_focal
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
            focal_free: self.focal_free,
        })
    }

    fn prior(&self) -> (SVector<f64, 1>, SVector<f64, 1>) {
        let weight = if self.focal_free {
            // One image error of 0.3 px against 10 %.
            (0.3 / FOCAL_SPREAD).powi(2)
        } else {
            HELD
        };
        (
            SVector::<f64, 1>::new(weight),
            SVector::<f64, 1>::new(self.log_focal),
        )
    }
}
