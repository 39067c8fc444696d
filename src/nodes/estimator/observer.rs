//! Observer: collects frames and gyro samples, runs batch solver and motion tracker, and publishes the motion.

use super::{
    EstimatorParams, Topics,
    batch_schedule::BatchSchedule,
    camera_attitude::CameraAttitude,
    frame_queue::FrameQueue,
    health,
    messages::Snapshot,
    monotonic::Monotonic,
    params::RETRY_PERIOD,
    ranges::Ranges,
    solver::{Job, Solved, Solver},
};
use std::time::Instant;

use crate::{
    estimation::{BatchSolution, GYRO_GAP, MotionTracker, TrackLoss, Tracks},
    nodes::{
        camera::CAMERA_FRAME,
        features::{camera_from_msg, rectified},
    },
    ros::{Node, Status, Time},
    vision::{Distortion, FeatureFrame, Pinhole},
};

/// Silence, in frame intervals, after which the motion is extrapolated.
const MISSED_INTERVALS: f64 = 3.0;

/// State of the estimator node.
pub struct Observer {
    params: EstimatorParams,
    camera: Option<Pinhole>,
    lens: Option<Distortion>,
    /// Name of the camera's optical frame.
    pub camera_frame: String,
    attitude: CameraAttitude,
    /// Number of restarts of the gyro integration when the newest frame arrived.
    gyro_restarts: u32,
    /// Frames that wait for a gyro sample.
    queue: FrameQueue,
    tracks: Tracks,
    ranges: Ranges,
    solver: Solver,
    schedule: BatchSchedule,
    tracker: Option<MotionTracker>,
    /// Stamp of the newest frame \[s\], and its arrival time.
    newest: Option<(f64, Time)>,
    /// Interval between the last two frames \[s\].
    interval: f64,
    /// Stamp of the last published motion \[s\]; `None` after a reset of the motion.
    published_at: Option<f64>,
    /// Latest published time stamp.
    published: Monotonic,
    /// Why the last batch has no solution.
    failure: Option<String>,
    /// Why the motion was last reset, if it was.
    reset_reason: Option<String>,
    camera_status: Status,
    motion_status: Status,
}

impl Observer {
    /// An observer without frames.
    pub fn new(params: EstimatorParams, node: &Node) -> Self {
        let motion_status = node.diagnostics().status("motion");
        motion_status.warn("not estimated yet: no frames");
        Self {
            camera: params.camera,
            lens: None,
            camera_frame: CAMERA_FRAME.to_owned(),
            attitude: CameraAttitude::default(),
            gyro_restarts: 0,
            queue: FrameQueue::default(),
            tracks: Tracks::default(),
            ranges: Ranges::default(),
            solver: Solver::start(),
            schedule: BatchSchedule::default(),
            tracker: None,
            newest: None,
            interval: 0.0,
            published_at: None,
            published: Monotonic::default(),
            failure: None,
            reset_reason: None,
            camera_status: node.diagnostics().status("camera"),
            motion_status,
            params,
        }
    }

    /// Processes received messages on the camera: calibration, mounting and gyro.
    pub fn update_camera(&mut self, topics: &Topics) {
        let restarts = self.attitude.gyro.restarts();
        if let Some(received) = topics.camera_info.latest()
            && self.params.camera.is_none()
        {
            match camera_from_msg(&received.message) {
                Ok((camera, lens)) => (self.camera, self.lens) = (Some(camera), lens),
                Err(problem) => {
                    let topic = topics.camera_info.topic();
                    self.camera_status.error(format!("{topic}: {problem}"));
                }
            }
        }
        while let Some(received) = topics.tf_static.take() {
            if let Err(problem) = self.attitude.take_static_transforms(received.message) {
                let topic = topics.tf_static.topic();
                self.camera_status.warn(format!("{topic}: {problem}"));
            }
        }
        while let Some(received) = topics.imu.take() {
            if !self.params.use_imu {
                continue;
            }
            let taken = self
                .attitude
                .take_imu(&received.message, &self.camera_frame);
            if let Err(problem) = taken {
                let topic = topics.imu.topic();
                self.camera_status.warn(format!("{topic}: {problem}"));
            }
        }
        if self.attitude.gyro.restarts() != restarts {
            self.reset_motion("the gyro has just started, or had a gap");
        }
        match (&self.camera, self.attitude.gyro.known_since()) {
            (None, _) => self.camera_status.warn(format!(
                "{} has not arrived, and camera.fx is not given",
                topics.camera_info.topic()
            )),
            (Some(_), Some(_)) => match self.gyro_silence() {
                Some(seconds) => self.camera_status.warn(format!(
                    "{} ends {seconds:.1} s before the newest frame; the camera's rotation since then is extrapolated",
                    topics.imu.topic()
                )),
                None => self
                    .camera_status
                    .ok("calibrated; its rotation is known from the gyro"),
            },
            (Some(_), None) if self.params.use_imu => self.camera_status.ok(format!(
                "calibrated; assumed not to rotate, because nothing has arrived on {}",
                topics.imu.topic()
            )),
            (Some(_), None) => self.camera_status.ok("calibrated; assumed not to rotate"),
        }
    }

    /// Time from the newest gyro sample to the newest frame \[s\], if too long for a known attitude.
    fn gyro_silence(&self) -> Option<f64> {
        let silence = self.tracks.span()?.1 - self.attitude.gyro.known_until()?;
        (silence > GYRO_GAP).then_some(silence)
    }

    /// Whether any frames are in the window.
    pub fn has_frames(&self) -> bool {
        !self.tracks.frames().is_empty()
    }

    /// Adds a frame that arrived at `now` to the queue for [`Observer::update_motion`].
    pub fn queue_frame(&mut self, frame: FeatureFrame, now: Instant) {
        let frame = match &self.camera {
            Some(camera) => rectified(frame, camera, self.lens.as_ref()),
            None => frame,
        };
        self.queue.push(frame, now);
    }

    /// Measures distances of features from received point clouds.
    pub fn update_ranges(&mut self, topics: &Topics) {
        while let Some(received) = topics.points.take() {
            if let Err(problem) = self.ranges.take(&received.message, &self.camera_frame) {
                let topic = topics.points.topic();
                topics
                    .range_status
                    .warn(format!("{topic}: {problem}; the cloud is ignored"));
            }
        }
        if let Some(camera) = &self.camera
            && let Some(found) = self.ranges.measure(self.tracks.frames(), camera)
        {
            topics
                .range_status
                .set("features in the newest cloud", found);
            match found {
                0 => (topics.range_status)
                    .warn("no point of the newest cloud is near a feature in the image"),
                _ => topics.range_status.ok("clouds give the scale of lengths"),
            }
        }
    }

    /// Processes the frames for which gyro samples have arrived, or that have waited too long for one.
    pub fn update_motion(&mut self, now: Time, topics: &Topics) {
        while let Some(frame) = self
            .queue
            .pop(self.attitude.gyro.known_until(), Instant::now())
        {
            self.add_frame(frame, now, topics);
        }
    }

    /// Adds a frame at the time `now`, and publishes the motion at the frame's stamp.
    fn add_frame(&mut self, frame: FeatureFrame, now: Time, topics: &Topics) {
        let time = frame.time;
        match self.tracks.span() {
            Some((_, last)) if time == last => return,
            Some((_, last)) if time < last => {
                tracing::info!("time went back from {last:.3} s to {time:.3} s: restarting");
                self.restart();
            }
            Some((_, last)) if time > last + self.params.window.max(self.params.horizon) => {
                let gap = format!("the target was out of sight for {:.0} s", time - last);
                tracing::info!("{gap}: restarting");
                self.tracks = Tracks::default();
                self.reset_motion(&gap);
            }
            _ => {}
        }
        if let Err(e) = self.tracks.push(frame) {
            // The only remaining error is a stamp that is not finite.
            topics.status.warn(format!("{e}; the frame is ignored"));
            return;
        }
        self.gyro_restarts = self.attitude.gyro.restarts();
        let before = self.newest.replace((time, now));
        self.interval = before.map_or(0.0, |(last, _)| time - last);
        let oldest = time - self.params.window;
        self.tracks.forget_before(oldest);
        self.attitude.gyro.forget_before(oldest);
        self.ranges.forget_before(oldest);
        if let Some(since) = self.attitude.gyro.known_since() {
            // The camera's rotation before that time is unknown.
            self.tracks.forget_before(since.min(time));
        }
        let R_IC = self.attitude.gyro.R_GC(time);
        let frame = self.tracks.frames().last();
        let loss = match (&mut self.tracker, frame) {
            (Some(tracker), Some(frame)) => tracker.update(frame, &R_IC),
            _ => None,
        };
        match loss {
            Some(TrackLoss::MotionChanged(since)) => {
                tracing::info!("the motion of the target has changed at {since:.3} s: restarting");
                self.tracks.forget_before(since);
                self.reset_motion("the motion of the target has changed; did something touch it?");
            }
            Some(TrackLoss::Unconfirmed) => {
                self.reset_motion("the first solution did not fit the following frames");
            }
            None => {}
        }
        self.publish(time, topics);
    }

    fn restart(&mut self) {
        self.tracks = Tracks::default();
        self.ranges = Ranges::default();
        // If the gyro integration has restarted already, its samples are needed from the first frame on.
        if self.attitude.gyro.restarts() == self.gyro_restarts {
            self.attitude.gyro.clear();
        }
        self.published = Monotonic::default();
        self.reset_motion("time went back");
    }

    /// Discards the motion, and aborts a running batch solution.
    fn reset_motion(&mut self, why: &str) {
        self.tracker = None;
        self.failure = None;
        self.published_at = None;
        self.schedule.restart();
        self.solver = Solver::start();
        self.motion_status.warn(format!("not estimated yet: {why}"));
        self.reset_reason = Some(why.to_owned());
    }

    /// Publishes the angular velocity at `time` \[s\], and the motion if it is due. Nothing is published for a time
    /// before that of an earlier message, as happens when frames arrive after an extrapolation beyond them.
    fn publish(&mut self, time: f64, topics: &Topics) {
        if self.tracker.is_some() && !self.published.advance(time) {
            return;
        }
        if let Some(snapshot) = self.snapshot(time) {
            topics
                .angular_velocity
                .publish(&snapshot.angular_velocity());
        }
        let period = self.params.prediction_period;
        // Tolerance for rounding of stamps.
        if self.published_at.is_none_or(|at| time > at + period - 1e-6) {
            self.publish_motion(time, topics);
        }
        if let Some(tracker) = &self.tracker {
            health::report(&self.motion_status, tracker, time, self.failure.as_deref());
        }
    }

    /// Publishes motion and prediction at `time` \[s\].
    fn publish_motion(&mut self, time: f64, topics: &Topics) {
        let Some(snapshot) = self.snapshot(time) else {
            return;
        };
        let (horizon, rate) = (self.params.horizon, self.params.prediction_rate);
        topics.motion.publish(&snapshot.motion(horizon, rate));
        topics
            .prediction
            .publish(&snapshot.prediction(horizon, rate));
        self.published_at = Some(time);
    }

    fn snapshot(&self, time: f64) -> Option<Snapshot<'_>> {
        Some(Snapshot {
            tracker: self.tracker.as_ref()?,
            time,
            camera: &self.camera_frame,
            R_IC: self.attitude.gyro.R_GC(time),
            known_length: self.params.known_length.as_ref(),
            ranges: self.ranges.measured(),
        })
    }

    /// While no frames arrive: publishes the extrapolated motion, up to the prediction horizon. `now` is the node's
    /// time.
    pub fn coast(&mut self, now: Time, topics: &Topics) {
        let (Some((stamp, arrived)), Some(published_at)) = (self.newest, self.published_at) else {
            return;
        };
        let silence = now.since(arrived).as_secs_f64();
        let time = stamp + silence;
        let period = self.params.prediction_period;
        let missed = silence > (MISSED_INTERVALS * self.interval).max(period);
        if missed && silence < self.params.horizon && time >= published_at + period {
            self.publish(time, topics);
        }
    }

    /// Submits the frames of the window to the solver if it is idle and a batch is due: periodically, with a period
    /// that grows with the duration of a batch, and once after frames have stopped, so that the last batch includes all
    /// frames.
    pub fn solve(&mut self, now: Time) {
        let (Some(camera), Some(span)) = (self.camera, self.tracks.span()) else {
            return;
        };
        let mut period = self.params.batch_period(self.tracker.is_some());
        // The filter can bridge a pause only while it knows most of the points.
        let knows_most_points = |tracker: &MotionTracker| {
            let update = tracker.last_update();
            update.is_none_or(|u| u.used + u.rejected >= u.unknown)
        };
        if self.tracker.as_ref().is_some_and(knows_most_points) {
            period = period.max(self.schedule.pause(self.params.solver_share));
        }
        let stopped = self
            .newest
            .is_some_and(|(_, arrived)| now.since(arrived).as_secs_f64() > RETRY_PERIOD);
        if self.solver.is_busy() || !self.schedule.is_due(span.1, period, stopped) {
            return;
        }
        self.schedule.start(span);
        self.solver.submit(Job {
            method: self.params.method,
            tracks: self.tracks.clone(),
            camera,
            options: self
                .params
                .batch_options(&self.attitude, !self.ranges.measured().is_empty()),
        });
    }

    /// Takes a finished solution, and publishes the motion.
    pub fn take_solution(&mut self, topics: &Topics) {
        let solved = match self.solver.take() {
            Ok(None) => return,
            Ok(Some(solved)) => solved,
            Err(problem) => {
                self.motion_status.error(problem);
                return;
            }
        };
        let Solved {
            job,
            result,
            duration,
        } = solved;
        self.schedule.end(duration);
        let Some((newest, _)) = self.newest else {
            return;
        };
        let estimated = match result {
            Ok(estimated) => estimated,
            Err(e) => {
                match &self.tracker {
                    Some(_) => self.failure = Some(e.to_string()),
                    None => self.motion_status.warn(match &self.reset_reason {
                        Some(why) => format!("not estimated yet: {e} (reset before: {why})"),
                        None => format!("not estimated yet: {e}"),
                    }),
                }
                return;
            }
        };
        let batch = BatchSolution {
            estimated,
            frames: job.tracks.frames().len(),
            span: job.tracks.span().unwrap_or_default(),
        };
        let frames = self.tracks.frames();
        let later = frames.partition_point(|s| s.time <= batch.span.1);
        let later = frames[later..].iter();
        let later = later.map(|frame| (frame, self.attitude.gyro.R_GC(frame.time)));
        let next = MotionTracker::new(batch, self.params.filter_disturbance(), later);
        self.tracker = Some(match self.tracker.take() {
            Some(before) => before.replaced_by(next, newest, self.params.horizon),
            None => next,
        });
        self.failure = None;
        // An extrapolated motion may have been published for a later time.
        let time = self.published.latest().map_or(newest, |at| at.max(newest));
        self.published.advance(time);
        self.publish_motion(time, topics);
        if let Some(tracker) = &self.tracker {
            health::report(&self.motion_status, tracker, time, None);
        }
    }
}
