//! The phase grasp: final approach, grasp, and retreat.

use nalgebra::{Point3, UnitQuaternion, Vector3};

use super::{AfterStop, CaptureConfig, CaptureMission, Gripper, Phase, Stage};
use crate::control::capture::payload::presumed;
use crate::spatial::Pose;

/// Time constant with which a pause stops the final approach \[s\].
const PAUSE: f64 = 0.5;
/// Times of the test pull after the gripper has closed \[s\]: start, full distance, end.
const PULL: [f64; 3] = [1.0, 3.0, 4.5];
/// Longest wait for the gripper's report whether it holds the target \[s\].
const GRIP_TIMEOUT: f64 = 20.0;
/// Longest wait for measured poses of the test pull \[s\].
const PULL_TIMEOUT: f64 = 8.0;

/// Motion of the tip along the approach axis, relative to the grasp frame.
#[derive(Debug, Clone)]
pub(in crate::control::capture) struct Closing {
    /// Distance from the grasp frame at the start and at the end \[m\].
    from: f64,
    to: f64,
    duration: f64,
    /// Elapsed time, which a pause slows down \[s\]; its speed relative to real time; and the rate of that speed
    /// \[1/s\].
    clock: f64,
    speed: f64,
    speed_rate: f64,
    last: f64,
    /// Time since when the tip is at the end \[s\].
    arrived: Option<f64>,
    /// Reason of a retreat: `Some(None)` for another attempt.
    retreat: Option<Option<String>>,
}

impl Closing {
    pub fn begin(config: &CaptureConfig, time: f64, from: f64) -> Self {
        Self {
            from,
            to: 0.0,
            duration: config.final_time,
            clock: 0.0,
            speed: 1.0,
            speed_rate: 0.0,
            last: time,
            arrived: None,
            retreat: None,
        }
    }

    /// A retreat to the distance of the approach; with a reason, the mission then ends.
    pub fn retreat(self, config: &CaptureConfig, reason: Option<String>) -> Self {
        let (now, ..) = self.at();
        Self {
            from: now,
            to: config.standoff,
            duration: 0.5 * config.final_time,
            clock: 0.0,
            speed: 1.0,
            speed_rate: 0.0,
            arrived: None,
            retreat: Some(reason),
            ..self
        }
    }

    pub fn progress(&self) -> f64 {
        (self.clock / self.duration).clamp(0.0, 1.0)
    }

    /// Distance \[m\] with its first two derivatives.
    fn at(&self) -> (f64, f64, f64) {
        let u = self.progress();
        let way = self.to - self.from;
        let rate = self.speed / self.duration;
        let value = u * u * u * (10.0 + u * (-15.0 + 6.0 * u));
        let slope = 30.0 * (u * (1.0 - u)).powi(2);
        let bend = 60.0 * u * (1.0 - u) * (1.0 - 2.0 * u);
        (
            self.from + way * value,
            way * slope * rate,
            way * (bend * rate * rate + slope * self.speed_rate / self.duration),
        )
    }

    fn advance(&mut self, time: f64, is_paused: bool) {
        let dt = (time - self.last).clamp(0.0, 0.5);
        let wanted = if is_paused { 0.0 } else { 1.0 };
        self.speed += (wanted - self.speed) * (dt / PAUSE).min(1.0);
        self.speed_rate = (wanted - self.speed) / PAUSE;
        self.clock += self.speed * dt;
        self.last = time;
    }
}

/// The test pull after the gripper has closed.
#[derive(Debug, Clone)]
pub(in crate::control::capture) struct Pull {
    begin: f64,
    /// Deviation of position and angle when the gripper closed.
    closed_at: (f64, f64),
    way: f64,
}

impl Pull {
    pub fn progress(&self, time: f64) -> f64 {
        ((time - self.begin) / PULL[2]).clamp(0.0, 1.0)
    }

    /// A retreat to the distance of the approach, from the tip's position at `time` \[s\].
    pub fn retreat(self, config: &CaptureConfig, time: f64, reason: Option<String>) -> Closing {
        Closing::begin(config, time, self.at(config, time).0).retreat(config, reason)
    }

    /// Distance pulled at `time` \[m\], with its first two derivatives; zero if the gripper reports whether it holds.
    fn at(&self, config: &CaptureConfig, time: f64) -> (f64, f64, f64) {
        if config.reports_grip {
            return (0.0, 0.0, 0.0);
        }
        let T = PULL[1] - PULL[0];
        let u = ((time - self.begin - PULL[0]) / T).clamp(0.0, 1.0);
        (
            self.way * u * u * u * (10.0 + u * (-15.0 + 6.0 * u)),
            self.way * 30.0 * (u * (1.0 - u)).powi(2) / T,
            self.way * 60.0 * u * (1.0 - u) * (1.0 - 2.0 * u) / (T * T),
        )
    }
}

/// A pose from its position and rotation vector.
fn pose_of((p, turn): (Vector3<f64>, Vector3<f64>)) -> Pose {
    let turn = UnitQuaternion::from_scaled_axis(turn);
    Pose::from_parts(p.into(), turn.to_rotation_matrix())
}

impl CaptureMission {
    /// Drives the tip to a distance (with its derivatives) from the grasp frame. Returns the tip's deviation; `None` if
    /// the target's motion is unknown.
    fn drive_tip(&mut self, time: f64, (s, ds, dds): (f64, f64, f64)) -> Option<(f64, f64)> {
        let goal = self.goal(time)?;
        let axis = self.config.approach_axis.normalize();
        let goal = goal.with_offset(&(axis * -s), &(axis * -ds), &(axis * -dds));
        let (efforts, off) = self.impedance.efforts(self.own.state(), &goal);
        self.efforts.copy_from(efforts);
        self.reference = self.measured();
        Some((off.position_error.norm(), off.rotation_error.norm()))
    }

    pub(super) fn close_in(&mut self, time: f64, mut closing: Closing) -> Stage {
        closing.advance(time, self.is_paused && closing.retreat.is_none());
        let Some(off) = self.drive_tip(time, closing.at()) else {
            self.track_reference();
            let reason = "the target's motion is not known any more".to_owned();
            return self.stop(AfterStop::Abort(reason));
        };
        if closing.retreat.is_none()
            && let Some(lost) = self.lost(time)
        {
            return Stage::Close(closing.retreat(&self.config, Some(lost)));
        }
        if closing.progress() < 1.0 || self.is_paused && closing.retreat.is_none() {
            return Stage::Close(closing);
        }
        match closing.retreat.take() {
            Some(Some(reason)) => {
                self.gripper = Gripper::Open;
                self.stop(AfterStop::Abort(reason))
            }
            Some(None) => {
                self.attempt += 1;
                Stage::Close(Closing::begin(&self.config, time, self.config.standoff))
            }
            None => self.close_gripper(time, closing, off),
        }
    }

    /// Closes the gripper once the tip is close enough.
    fn close_gripper(&mut self, time: f64, mut closing: Closing, off: (f64, f64)) -> Stage {
        let arrived = *closing.arrived.get_or_insert(time);
        let (distance, angle) = self.config.close_within;
        if off.0 <= distance && off.1 <= angle {
            self.gripper = Gripper::Close;
            let report = self.report();
            report.set("tip off the prediction", off.0, "m");
            report.set("tip turned off the prediction", off.1, "rad");
            return Stage::Pull(Pull {
                begin: time,
                closed_at: off,
                way: self.config.pull,
            });
        }
        if time - arrived > self.config.close_timeout {
            let reason = format!(
                "the tip stays {:.3} m and {:.3} rad off the grasp frame; {distance} m and {angle} rad are needed",
                off.0, off.1
            );
            return self.missed(closing, reason);
        }
        Stage::Close(closing)
    }

    /// A grasp has failed: retreat, then try again or give up.
    fn missed(&mut self, closing: Closing, reason: String) -> Stage {
        self.gripper = Gripper::Open;
        let attempts = self.config.attempts;
        let attempt = f64::from(self.attempt);
        self.report().set("failed attempts", attempt, "");
        let reason = (self.attempt >= attempts)
            .then(|| format!("not grasped in {attempts} attempts: {reason}"));
        Stage::Close(closing.retreat(&self.config, reason))
    }

    pub(super) fn pull(&mut self, time: f64, pull: Pull) -> Stage {
        let way = pull.at(&self.config, time);
        if self.drive_tip(time, way).is_none() {
            self.track_reference();
        }
        let since = time - pull.begin;
        let closing = Closing::begin(&self.config, time, way.0);
        match self.grip {
            Some(true) => {
                let X_EG = self.mean_relative(time - 1.0, time).map(pose_of);
                return self.grasped(time, &pull, X_EG);
            }
            Some(false) if since > PULL[0] => {
                return self.missed(closing, "the gripper holds nothing".to_owned());
            }
            None if self.config.reports_grip => {
                if since < GRIP_TIMEOUT {
                    return Stage::Pull(pull);
                }
                let reason = format!(
                    "the gripper has not reported within {GRIP_TIMEOUT} s whether it holds"
                );
                return self.missed(closing, reason);
            }
            _ => {}
        }
        let seen = self.relative.back().map_or(f64::NEG_INFINITY, |(t, _)| *t);
        if seen < pull.begin + PULL[2] && since < PULL_TIMEOUT {
            return Stage::Pull(pull);
        }
        let before = self.mean_relative(pull.begin - 1.0, pull.begin + PULL[0]);
        let after = self.mean_relative(pull.begin + PULL[1], pull.begin + PULL[2]);
        let Some((before, after)) = before.zip(after) else {
            let reason = "the target was not seen while the arm pulled".to_owned();
            return self.missed(closing, reason);
        };
        let moved = (after.0 - before.0).norm();
        self.report()
            .set("motion in the grasp while pulled", moved, "m");
        if moved < 0.5 * pull.way {
            return self.grasped(time, &pull, Some(pose_of(after)));
        }
        let reason = format!("the target moved {moved:.3} m in the grasp when it was pulled");
        self.missed(closing, reason)
    }

    /// The target is held: start detumbling.
    fn grasped(&mut self, time: f64, pull: &Pull, X_EG: Option<Pose>) -> Stage {
        let q = self.own.state().q.clone();
        let axis = self.config.approach_axis.normalize();
        let along = self.own.X_BE().rotation * axis;
        let mass = self.impedance.effective_mass(&q, &along);
        let attempt = f64::from(self.attempt);
        let report = self.report();
        report.set("effective mass of the tip", mass, "kg");
        report.set("attempts", attempt, "");
        report.set("time of the grasp", pull.begin, "s");
        report.set("distance at the grasp", pull.closed_at.0, "m");
        let com = self
            .track
            .center_in_grasp_frame()
            .map_or_else(Vector3::zeros, |p_GT| {
                (self.X_GK().inverse() * Point3::from(p_GT)).coords
            });
        let (mass, gyration) = self.config.presumed;
        // Tip and grasp frame coincide.
        if self.take(presumed(mass, com, gyration), false).is_err() {
            return self.stop(AfterStop::Abort(
                "the presumed payload is no body".to_owned(),
            ));
        }
        if let Some(held) = &mut self.held {
            held.X_EG = X_EG;
        }
        self.enter(time, Phase::Detumble, "the target is held");
        self.begin_detumbling(time)
    }

    /// The reason why the target has slipped, if it has: the mean of its pose in the grasp over the last second.
    pub(super) fn slipped(&self, time: f64) -> Option<String> {
        if self.grip == Some(false) {
            return Some("the gripper has lost the target".to_owned());
        }
        let at_grasp = self.held.as_ref()?.X_EG?;
        let (p, turn) = self.mean_relative(time - 1.2, time)?;
        let moved = (p - at_grasp.translation.vector).norm();
        let turn = UnitQuaternion::from_scaled_axis(turn);
        let turned = turn.angle_to(&UnitQuaternion::from(at_grasp.rotation));
        let (distance, angle) = self.config.slip;
        (moved > distance || turned > angle)
            .then(|| format!("the target has slipped by {moved:.3} m and {turned:.3} rad"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Cycle \[s\].
    const DT: f64 = 0.01;

    fn config(reports_grip: bool) -> CaptureConfig {
        CaptureConfig {
            reports_grip,
            ..CaptureConfig::default()
        }
    }

    // A retreat that starts at the end of a pull that did not take place, or at time and place of its start, jumps by
    // centimetres.
    #[test]
    fn the_tip_does_not_jump_when_a_pull_ends_in_a_retreat() {
        for reports_grip in [true, false] {
            let config = config(reports_grip);
            for end in [0.5, 1.7, 2.0, 4.0] {
                let pull = Pull {
                    begin: 100.0,
                    closed_at: (0.0, 0.0),
                    way: 0.03,
                };
                let (mut time, mut before, mut largest) = (100.0, 0.0, 0.0_f64);
                while time < 100.0 + end {
                    let now = pull.at(&config, time).0;
                    largest = largest.max((now - before).abs());
                    (time, before) = (time + DT, now);
                }
                let mut closing = pull.retreat(&config, time, None);
                while closing.progress() < 1.0 {
                    closing.advance(time, false);
                    let now = closing.at().0;
                    largest = largest.max((now - before).abs());
                    (time, before) = (time + DT, now);
                }
                assert!((before - config.standoff).abs() < 1e-9);
                // The largest rate of a quintic is 15/8 of its mean.
                let pulled = 0.03 / (PULL[1] - PULL[0]);
                let retreated = config.standoff / (0.5 * config.final_time);
                let fastest = 15.0 / 8.0 * pulled.max(retreated) * DT;
                assert!(
                    largest <= 1.01 * fastest,
                    "{reports_grip} {end}: {largest} {fastest}"
                );
            }
        }
    }

    // The acceleration is the derivative of the rate while a pause slows the approach down; without the derivative of
    // the speed, the part due to the pause is missing.
    #[test]
    fn derivatives_hold_while_pausing() {
        let config = config(false);
        let dt = 1e-4;
        let mut closing = Closing::begin(&config, 0.0, config.standoff);
        let mut before = closing.at();
        let mut largest = 0.0_f64;
        for k in 1..100_000 {
            let time = f64::from(k) * dt;
            let is_paused = time > 0.4 * config.final_time && time < 0.5 * config.final_time;
            let was = closing.speed_rate;
            closing.advance(time, is_paused);
            let now = closing.at();
            assert!(((now.0 - before.0) / dt - now.1).abs() < 1e-4);
            // Not where the pause begins or ends.
            if (closing.speed_rate - was).abs() < 0.1 {
                let slope = (now.1 - before.1) / dt;
                largest = largest.max(now.2.abs());
                assert!((slope - now.2).abs() < 1e-3 * config.standoff, "{time}");
            }
            before = now;
        }
        assert!(largest > 0.01 * config.standoff);
    }
}
