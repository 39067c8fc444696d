//! The estimator of a target's motion in one thread, without DDS.

use nalgebra::{UnitQuaternion, Vector3};

use crate::{
    estimation::{BatchSolution, GyroAttitude, MotionTracker, Tracks, bundle, estimate},
    msg::nav_msgs::Path,
    nodes::{
        camera::CAMERA_FRAME,
        estimator::{EstimatorParams, Snapshot},
    },
    vision::{FeatureFrame, Pinhole},
};

/// Longest time between two batches while there is no motion yet \[s\].
const RETRY_PERIOD: f64 = 2.0;

/// What the estimator node does with features and gyro, with batch solutions that take no time: the first frame after
/// the one that completes a window sees the new solution.
pub struct EstimationLoop {
    params: EstimatorParams,
    camera: Pinhole,
    /// Attitude of the camera in the base.
    R_BC: UnitQuaternion<f64>,
    gyro: GyroAttitude,
    tracks: Tracks,
    tracker: Option<MotionTracker>,
    solved_at: Option<f64>,
    published_at: Option<f64>,
}

impl EstimationLoop {
    /// For a camera with attitude `R_BC` in the base.
    pub fn new(params: EstimatorParams, camera: Pinhole, R_BC: UnitQuaternion<f64>) -> Self {
        Self {
            camera: params.camera.unwrap_or(camera),
            params,
            R_BC,
            gyro: GyroAttitude::default(),
            tracks: Tracks::default(),
            tracker: None,
            solved_at: None,
            published_at: None,
        }
    }

    /// Adds a sample of the gyro (base axes).
    pub fn add_gyro(&mut self, time: f64, w_B: &Vector3<f64>) {
        self.gyro.add(time, self.R_BC.inverse() * w_B);
    }

    /// Adds a frame. Returns the prediction that is published for it, if one is due.
    pub fn add_frame(&mut self, frame: FeatureFrame) -> Option<Path> {
        let time = frame.time;
        if self.tracks.push(frame).is_err() {
            return None;
        }
        let oldest = time - self.params.window;
        self.tracks.forget_before(oldest);
        self.gyro.forget_before(oldest);
        let R_IC = self.gyro.R_GC(time);
        let lost = match (&mut self.tracker, self.tracks.frames().last()) {
            (Some(tracker), Some(frame)) => tracker.update(frame, &R_IC).is_some(),
            _ => false,
        };
        if lost {
            self.tracker = None;
            self.published_at = None;
        }
        self.solve(time);
        let tracker = self.tracker.as_ref()?;
        let period = self.params.prediction_period;
        if (self.published_at).is_some_and(|at| time <= at + period - 1e-6) {
            return None;
        }
        self.published_at = Some(time);
        let snapshot = Snapshot {
            tracker,
            time,
            camera: CAMERA_FRAME,
            R_IC,
        };
        Some(snapshot.prediction(self.params.horizon, self.params.prediction_rate))
    }

    /// Solves a batch, if one is due.
    fn solve(&mut self, time: f64) {
        let period = match &self.tracker {
            Some(_) => self.params.solve_period,
            None => self.params.solve_period.min(RETRY_PERIOD),
        };
        if (self.solved_at).is_some_and(|at| time < at + period) {
            return;
        }
        self.solved_at = Some(time);
        let options = bundle::Options {
            pixel_noise: self.params.pixel_noise,
            estimate_focal_length: self.params.estimate_focal_length,
            camera_motion: self.gyro.motion(),
            ..bundle::Options::default()
        };
        let Ok(estimated) = estimate(self.params.method, &self.tracks, &self.camera, &options)
        else {
            return;
        };
        let batch = BatchSolution {
            estimated,
            frames: self.tracks.frames().len(),
            span: self.tracks.span().unwrap_or_default(),
        };
        let disturbance = self.params.filter_disturbance();
        let next = MotionTracker::new(batch, disturbance, std::iter::empty());
        self.tracker = Some(match self.tracker.take() {
            Some(before) => before.replaced_by(next, time, self.params.horizon),
            None => next,
        });
    }
}
