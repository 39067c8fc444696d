//! The estimator of a target's motion in a single thread without DDS.

use nalgebra::UnitQuaternion;

use crate::{
    estimation::{BatchSolution, MotionTracker, TrackLoss, Tracks, estimate},
    msg::{nav_msgs::Path, sensor_msgs::Imu},
    nodes::{
        camera::CAMERA_FRAME,
        estimator::{CameraAttitude, EstimatorParams, Snapshot},
    },
    vision::{FeatureFrame, Pinhole},
};

/// The estimator node's processing of features and gyro, with instantaneous batch solutions: the first frame after a
/// complete window uses the new solution.
pub struct EstimationLoop {
    params: EstimatorParams,
    camera: Pinhole,
    attitude: CameraAttitude,
    tracks: Tracks,
    tracker: Option<MotionTracker>,
    solved_at: Option<f64>,
    published_at: Option<f64>,
}

impl EstimationLoop {
    /// For a camera with the attitude `R_BC` in the frame `base`, whose gyro is used.
    pub fn new(
        params: EstimatorParams,
        camera: Pinhole,
        base: &str,
        R_BC: UnitQuaternion<f64>,
    ) -> Self {
        Self {
            camera: params.camera.unwrap_or(camera),
            params,
            attitude: CameraAttitude::mounted(base, CAMERA_FRAME, R_BC),
            tracks: Tracks::default(),
            tracker: None,
            solved_at: None,
            published_at: None,
        }
    }

    /// Adds a sample of the gyro.
    ///
    /// # Errors
    /// A line that names the quantity that is not finite.
    pub fn add_imu(&mut self, imu: &Imu) -> Result<(), String> {
        match self.params.use_imu {
            true => self.attitude.take_imu(imu, CAMERA_FRAME),
            false => Ok(()),
        }
    }

    /// Adds a frame. Returns the prediction published for it, if one is due.
    pub fn add_frame(&mut self, frame: FeatureFrame) -> Option<Path> {
        let time = frame.time;
        self.tracks.push(frame).ok()?;
        let oldest = time - self.params.window;
        self.tracks.forget_before(oldest);
        self.attitude.gyro.forget_before(oldest);
        let R_IC = self.attitude.gyro.R_GC(time);
        let loss = match (&mut self.tracker, self.tracks.frames().last()) {
            (Some(tracker), Some(frame)) => tracker.update(frame, &R_IC),
            _ => None,
        };
        if let Some(loss) = loss {
            if let TrackLoss::MotionChanged(since) = loss {
                self.tracks.forget_before(since);
            }
            (self.tracker, self.published_at, self.solved_at) = (None, None, None);
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
            known_length: self.params.known_length.as_ref(),
            ranges: &[],
        };
        Some(snapshot.prediction(self.params.horizon, self.params.prediction_rate))
    }

    /// Solves a batch, if one is due.
    fn solve(&mut self, time: f64) {
        let period = self.params.batch_period(self.tracker.is_some());
        if (self.solved_at).is_some_and(|at| time < at + period) {
            return;
        }
        self.solved_at = Some(time);
        let options = self.params.batch_options(&self.attitude, false);
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
