//! What has been seen of the target, and what follows from it.

use super::{
    EstimatorParams, Topics,
    belief::{Batch, Belief, Loss},
    camera_attitude::CameraAttitude,
    health,
    messages::Moment,
    solver::{Job, Solved, Solver},
};
use crate::{
    estimation::{Tracks, bundle},
    nodes::{camera::CAMERA_FRAME, features::pinhole_from_msg},
    ros::{Node, Status, Time},
    vision::{Pinhole, Sighting},
};

/// Without frames for so many of their intervals the motion is told without them.
const MISSED: f64 = 3.0;

/// While there is no motion yet, batches follow each other at least this fast \[s\].
const RETRY: f64 = 2.0;

/// From frames to what is published.
pub struct Observer {
    params: EstimatorParams,
    camera: Option<Pinhole>,
    /// Name of the camera's optical frame.
    pub camera_frame: String,
    attitude: CameraAttitude,
    /// Beginnings of that when the newest frame came.
    beginnings: u32,
    tracks: Tracks,
    solver: Solver,
    /// Time of the newest frame when the last job was given \[s\].
    solved_at: Option<f64>,
    belief: Option<Belief>,
    /// Stamp of the newest frame \[s\], and when it came.
    newest: Option<(f64, Time)>,
    /// From the frame before to that one \[s\].
    interval: f64,
    /// Time of the motion that was published last \[s\].
    told_at: Option<f64>,
    /// Why the last batch has no solution.
    unsolved: Option<String>,
    /// Why what was known was given up, if it was.
    anew: Option<String>,
    camera_status: Status,
    motion_status: Status,
}

impl Observer {
    /// Nothing seen yet.
    pub fn new(params: EstimatorParams, node: &Node) -> Self {
        let motion_status = node.diagnostics().status("motion");
        motion_status.warn("not estimated yet: no frames");
        Self {
            camera: params.camera,
            camera_frame: CAMERA_FRAME.to_owned(),
            attitude: CameraAttitude::default(),
            beginnings: 0,
            tracks: Tracks::default(),
            solver: Solver::start(),
            solved_at: None,
            belief: None,
            newest: None,
            interval: 0.0,
            told_at: None,
            unsolved: None,
            anew: None,
            camera_status: node.diagnostics().status("camera"),
            motion_status,
            params,
        }
    }

    /// Takes in what is known of the camera.
    pub fn listen(&mut self, topics: &Topics) {
        let beginnings = self.attitude.beginnings();
        if let Some(received) = topics.camera_info.latest()
            && self.params.camera.is_none()
        {
            match pinhole_from_msg(&received.message) {
                Ok(camera) => self.camera = Some(camera),
                Err(problem) => {
                    let topic = topics.camera_info.topic();
                    self.camera_status.error(format!("{topic}: {problem}"));
                }
            }
        }
        while let Some(received) = topics.tf_static.take() {
            if let Err(problem) = self.attitude.take_frames(received.message) {
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
        if self.attitude.beginnings() != beginnings {
            self.forget_solutions("the gyro has just begun, or had a gap");
        }
        match (&self.camera, self.attitude.known_since()) {
            (None, _) => self.camera_status.warn(format!(
                "{} has not arrived, and camera.fx is not given",
                topics.camera_info.topic()
            )),
            (Some(_), Some(_)) => self
                .camera_status
                .ok("calibrated; its rotation is known from the gyro"),
            (Some(_), None) if self.params.use_imu => self.camera_status.ok(format!(
                "calibrated; taken not to turn, for nothing has arrived on {}",
                topics.imu.topic()
            )),
            (Some(_), None) => self.camera_status.ok("calibrated; taken not to turn"),
        }
    }

    /// Whether there are frames.
    pub fn has_seen(&self) -> bool {
        !self.tracks.sightings().is_empty()
    }

    /// Takes in a frame that came at `now`, and answers it.
    pub fn see(&mut self, sighting: Sighting, now: Time, topics: &Topics) {
        let time = sighting.time;
        match self.tracks.span() {
            Some((_, last)) if time == last => return,
            Some((_, last)) if time < last => {
                tracing::info!("time went back from {last:.3} s to {time:.3} s: starting anew");
                self.restart();
            }
            Some((_, last)) if time > last + self.params.window.max(self.params.horizon) => {
                let gap = format!("the target was out of sight for {:.0} s", time - last);
                tracing::info!("{gap}: starting anew");
                self.tracks = Tracks::default();
                self.forget_solutions(&gap);
            }
            _ => {}
        }
        if let Err(e) = self.tracks.push(sighting) {
            // What is left to be wrong is a time that is not finite.
            topics.status.warn(format!("{e}; the frame is ignored"));
            return;
        }
        self.beginnings = self.attitude.beginnings();
        let before = self.newest.replace((time, now));
        self.interval = before.map_or(0.0, |(last, _)| time - last);
        let oldest = time - self.params.window;
        self.tracks.forget_before(oldest);
        self.attitude.forget_before(oldest);
        if let Some(since) = self.attitude.known_since() {
            // How the camera turned before that is not known.
            self.tracks.forget_before(since.min(time));
        }
        let R_IC = self.attitude.R_GC(time);
        let frame = self.tracks.sightings().last();
        let loss = match (&mut self.belief, frame) {
            (Some(belief), Some(frame)) => belief.see(frame, &R_IC),
            _ => None,
        };
        match loss {
            Some(Loss::Pushed(since)) => {
                tracing::info!("since {since:.3} s the target moves otherwise: starting anew");
                self.tracks.forget_before(since);
                self.forget_solutions(
                    "the target moves otherwise than before; did something touch it?",
                );
            }
            Some(Loss::Unconfirmed) => {
                self.forget_solutions("a first solution did not hold for the frames that followed");
            }
            None => {}
        }
        self.publish(time, topics);
    }

    fn restart(&mut self) {
        self.tracks = Tracks::default();
        // The gyro's measurements may have gone back already, and are needed from the first frame on.
        if self.attitude.beginnings() == self.beginnings {
            self.attitude.clear();
        }
        self.forget_solutions("time went back");
    }

    /// Gives up what was found, and whatever is still being solved.
    fn forget_solutions(&mut self, why: &str) {
        self.belief = None;
        self.unsolved = None;
        self.told_at = None;
        self.solved_at = None;
        self.solver = Solver::start();
        self.motion_status.warn(format!("not estimated yet: {why}"));
        self.anew = Some(why.to_owned());
    }

    /// Publishes the angular velocity at `time` \[s\], and the motion if that is due.
    fn publish(&mut self, time: f64, topics: &Topics) {
        if let Some(moment) = self.moment(time) {
            topics.angular_velocity.publish(&moment.angular_velocity());
        }
        let period = self.params.prediction_period;
        // A frame that is due by rounding is due.
        if self.told_at.is_none_or(|at| time > at + period - 1e-6) {
            self.publish_motion(time, topics);
        }
        if let Some(belief) = &self.belief {
            health::tell(&self.motion_status, belief, time, self.unsolved.as_deref());
        }
    }

    /// Publishes motion and prediction as at `time` \[s\].
    fn publish_motion(&mut self, time: f64, topics: &Topics) {
        let Some(moment) = self.moment(time) else {
            return;
        };
        topics.motion.publish(&moment.motion());
        let (horizon, rate) = (self.params.horizon, self.params.prediction_rate);
        topics.prediction.publish(&moment.prediction(horizon, rate));
        self.told_at = Some(time);
    }

    fn moment(&self, time: f64) -> Option<Moment<'_>> {
        Some(Moment {
            belief: self.belief.as_ref()?,
            time,
            camera: &self.camera_frame,
            R_IC: self.attitude.R_GC(time),
        })
    }

    /// Tells the motion when no frames come, until the last prediction ends. `now` is the node's time.
    pub fn coast(&mut self, now: Time, topics: &Topics) {
        let (Some((stamp, came)), Some(told_at)) = (self.newest, self.told_at) else {
            return;
        };
        let silence = now.since(came).as_secs_f64();
        let time = stamp + silence;
        let period = self.params.prediction_period;
        let missed = silence > (MISSED * self.interval).max(period);
        if missed && silence < self.params.horizon && time >= told_at + period {
            self.publish(time, topics);
        }
    }

    /// Gives the solver the frames of the window, if it is idle and new ones have come.
    pub fn solve(&mut self) {
        let (Some(camera), Some((_, newest))) = (self.camera, self.tracks.span()) else {
            return;
        };
        let period = match &self.belief {
            Some(_) => self.params.solve_period,
            None => self.params.solve_period.min(RETRY),
        };
        let due = self.solved_at.is_none_or(|at| newest >= at + period);
        if self.solver.is_busy() || !due {
            return;
        }
        self.solved_at = Some(newest);
        self.solver.give(Job {
            method: self.params.method,
            tracks: self.tracks.clone(),
            camera,
            options: bundle::Options {
                pixel_noise: self.params.pixel_noise,
                estimate_focal_length: self.params.estimate_focal_length,
                camera_motion: self.attitude.motion(),
                ..bundle::Options::default()
            },
        });
    }

    /// Takes in a solution that has come, and publishes what is held to be the motion then.
    pub fn take_solution(&mut self, topics: &Topics) {
        let solved = match self.solver.take() {
            Ok(None) => return,
            Ok(Some(solved)) => solved,
            Err(problem) => {
                self.motion_status.error(problem);
                return;
            }
        };
        let (Solved { job, result }, Some((newest, _))) = (solved, self.newest) else {
            return;
        };
        let estimated = match result {
            Ok(estimated) => estimated,
            Err(e) => {
                match &self.belief {
                    Some(_) => self.unsolved = Some(e.to_string()),
                    None => self.motion_status.warn(match &self.anew {
                        Some(why) => format!("not estimated yet: {e} (begun anew: {why})"),
                        None => format!("not estimated yet: {e}"),
                    }),
                }
                return;
            }
        };
        let batch = Batch {
            estimated,
            frames: job.tracks.sightings().len(),
            span: job.tracks.span().unwrap_or_default(),
        };
        let sightings = self.tracks.sightings();
        let later = sightings.partition_point(|s| s.time <= batch.span.1);
        let later = sightings[later..].iter();
        let later = later.map(|frame| (frame, self.attitude.R_GC(frame.time)));
        let next = Belief::new(batch, self.params.filter_disturbance(), later);
        self.belief = Some(match self.belief.take() {
            Some(before) => before.or(next, newest, self.params.horizon),
            None => next,
        });
        self.unsolved = None;
        // Coasting may have gone on meanwhile.
        let time = newest.max(self.told_at.unwrap_or(newest));
        self.publish_motion(time, topics);
        if let Some(belief) = &self.belief {
            health::tell(&self.motion_status, belief, time, None);
        }
    }
}
