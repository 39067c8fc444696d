//! The phases detumble and identify, with a held target.

use nalgebra::Vector3;

use super::{AfterStop, CaptureMission, Gripper, Phase, Stage};
use crate::control::capture::excitation_load;
use crate::control::capture::payload::{presumed, with_payload};
use crate::control::capture::plan::{quintic, quintic_at};
use crate::control::capture::{Excitation, inertial_state, payload};
use crate::control::commander::{JointPoint, JointSpline};
use crate::dynamics::Workspace;
use crate::estimation::inertia::{GyroSample, identify};
use crate::spatial::RigidInertia;

/// Time constant of the final phase of detumbling \[s\].
pub(super) const TIME_CONSTANT: f64 = 3.0;
/// Time for which the rotation must have been slow \[s\].
const CALM: f64 = 1.0;
/// Time between two samples for the identification \[s\].
const SAMPLING: f64 = 0.01;

/// Detumbling.
#[derive(Debug, Clone)]
pub(in crate::control::capture) struct Detumbling {
    begin: f64,
    /// Polynomials by which the joints come to rest.
    settling: Vec<[f64; 6]>,
    settle_time: f64,
    /// Angular velocity at the start, and now \[rad/s\].
    rates: (f64, f64),
    limit: f64,
    calm_since: Option<f64>,
}

impl Detumbling {
    /// Progress on a logarithmic scale of the rate.
    pub fn progress(&self) -> f64 {
        let (first, now) = self.rates;
        match first > self.limit && now > 0.0 {
            true => (first / now).ln() / (first / self.limit).ln(),
            false => 1.0,
        }
    }
}

/// Accuracy of the joints: sums of squares of their errors and of the motion of their references.
#[derive(Debug, Clone, Copy, Default)]
pub(in crate::control::capture) struct Accuracy {
    errors: f64,
    motion: f64,
}

impl Accuracy {
    fn add(&mut self, error: f64, motion: f64) {
        self.errors += error * error;
        self.motion += motion * motion;
    }

    /// Root mean square of the errors, divided by that of the motion.
    fn relative(&self) -> f64 {
        match self.motion > 0.0 {
            true => (self.errors / self.motion).sqrt(),
            false => 0.0,
        }
    }
}

/// Identification: an excitation, and a second one sized for the inertia identified from the first.
#[derive(Debug, Clone)]
pub(in crate::control::capture) struct Identifying {
    excitation: Excitation,
    begin: f64,
    samples: Vec<GyroSample>,
    /// Number of samples from the previous excitation.
    earlier: usize,
    sampled: f64,
    accuracy: Accuracy,
    /// The body for which the excitation is sized.
    body: RigidInertia,
    is_again: bool,
    /// Motion by which the joints come to rest in a pause.
    rest: Option<Box<JointSpline>>,
}

impl Identifying {
    pub fn progress(&self, time: f64) -> f64 {
        let part = (time - self.begin) / (self.excitation.end() - self.begin);
        0.5 * (part.clamp(0.0, 1.0) + if self.is_again { 1.0 } else { 0.0 })
    }
}

impl CaptureMission {
    pub(super) fn begin_detumbling(&mut self, time: f64) -> Stage {
        let T = self.config.settle_time;
        let rest = |from: &JointPoint| {
            let to = JointPoint {
                position: from.position + 0.5 * T * from.rate,
                ..JointPoint::default()
            };
            quintic(from, &to, T)
        };
        let settling = self.measured().iter().map(rest).collect();
        let rate = self.own.w_IB_B().norm();
        self.report().set("angular velocity before", rate, "rad/s");
        Stage::Detumble(Detumbling {
            begin: time,
            settling,
            settle_time: T,
            rates: (rate, rate),
            limit: self.config.final_rate,
            calm_since: None,
        })
    }

    pub(super) fn detumble(&mut self, time: f64, mut detumbling: Detumbling) -> Stage {
        let since = time - detumbling.begin;
        let (T, n) = (detumbling.settle_time, self.reference.len());
        for j in 0..n {
            self.reference[j] = quintic_at(&detumbling.settling[j], since / T, T);
        }
        self.track_reference();
        if let Some(reason) = self.slipped(time) {
            return self.let_go(reason);
        }
        let w = *self.own.w_IB_B();
        let rate = w.norm();
        detumbling.rates = (detumbling.rates.0.max(rate), rate);
        self.report()
            .raise("largest angular velocity", rate, "rad/s");
        if self.is_paused {
            detumbling.calm_since = None;
            return Stage::Detumble(detumbling);
        }
        self.oppose_momentum(&w);
        let is_calm = rate < self.config.final_rate && since > T;
        match is_calm {
            true => _ = detumbling.calm_since.get_or_insert(time),
            false => detumbling.calm_since = None,
        }
        let has_stopped = detumbling.calm_since.is_some_and(|t| time - t >= CALM);
        if has_stopped || (self.skips && since > T) {
            let outcome = match has_stopped {
                true => "robot and target have been stopped",
                false => "skipped by the operator",
            };
            self.report().set("angular velocity after", rate, "rad/s");
            self.enter(time, Phase::Identify, outcome);
            let com = (self.held.as_ref()).map_or_else(Vector3::zeros, |held| held.payload.com);
            let heaviest = self.heaviest(&com);
            return self.excite(time, heaviest, Vec::new());
        }
        if since > self.config.detumble_timeout {
            let reason = format!("still {rate:.5} rad/s after {since:.0} s of detumbling");
            return self.stop(AfterStop::Abort(reason));
        }
        Stage::Detumble(detumbling)
    }

    /// Sets the couple that opposes the angular momentum of robot and target.
    fn oppose_momentum(&mut self, w: &Vector3<f64>) {
        let own = self.own.state();
        let attitude = (own.R_WB, self.own.w_IB_B());
        let Some(held) = &mut self.held else {
            return;
        };
        let whole = inertial_state(&mut held.workspace, own.time, attitude, (&own.q, &own.qd));
        let momentum = (whole.momentum_W).expressed_in(&whole.R_WB).angular;
        let stack = payload::stack(&held.workspace, &self.tip, &held.payload);
        let speeds = &self.wheel_speeds;
        let shared = self.detumbler.couple(&stack, w, &momentum, speeds);
        self.couple = shared.thrusters;
        self.p_BC = stack.com;
        let of_wheels = self.detumbler.wheel_momentum(speeds);
        let report = self.report();
        report.raise("largest angular momentum", momentum.norm(), "N m s");
        report.raise(
            "largest predicted force at the grasp",
            shared.grasp.force.norm(),
            "N",
        );
        report.raise(
            "largest predicted torque at the grasp",
            shared.grasp.torque.norm(),
            "N m",
        );
        report.raise("largest couple", shared.thrusters.norm(), "N m");
        if of_wheels != Vector3::zeros() {
            report.raise("largest momentum of the wheels", of_wheels.norm(), "N m s");
        }
    }

    /// Opens the gripper after a slip, and stops.
    fn let_go(&mut self, reason: String) -> Stage {
        self.gripper = Gripper::Open;
        self.held = None;
        self.stop(AfterStop::Abort(reason))
    }

    /// The heaviest possible target, with its centre of mass at `com` in the tip's frame.
    pub(super) fn heaviest(&self, com: &Vector3<f64>) -> RigidInertia {
        let (mass, gyration) = self.config.heaviest;
        presumed(mass, *com, gyration)
    }

    /// Starts an excitation, as large as the limits at the grasp allow with `body`.
    fn excite(&mut self, time: f64, body: RigidInertia, samples: Vec<GyroSample>) -> Stage {
        let n = self.reference.len();
        let positions: Vec<f64> = self.reference.iter().map(|p| p.position).collect();
        let limits = &self.config.detumble;
        let whole = match with_payload(&self.model, &self.tip, &body) {
            Ok(whole) => whole,
            Err(e) => return self.stop(AfterStop::Abort(format!("not identified: {e}"))),
        };
        let excitation = excitation_load::sized(
            (&self.model, &mut Workspace::new(&whole)),
            (&self.tip, &body),
            (time, self.config.excitation_time),
            (&positions, &self.config.amplitudes(n)),
            (limits.grasp_force, limits.grasp_torque),
        );
        Stage::Identify(Identifying {
            excitation,
            begin: time,
            is_again: !samples.is_empty(),
            earlier: samples.len(),
            samples,
            sampled: f64::NEG_INFINITY,
            accuracy: Accuracy::default(),
            body,
            rest: None,
        })
    }

    pub(super) fn identify(&mut self, time: f64, mut identifying: Identifying) -> Stage {
        if self.is_paused {
            return self.pause_identification(time, identifying);
        }
        if identifying.rest.is_some() {
            // Includes the samples of the previous excitation, if there was one.
            let mut kept = identifying.samples;
            kept.truncate(identifying.earlier);
            return self.excite(time, identifying.body, kept);
        }
        if let Some(reason) = self.slipped(time) {
            return self.let_go(reason);
        }
        for j in 0..self.reference.len() {
            self.reference[j] = identifying.excitation.at(j, time);
        }
        self.track_reference();
        for (j, point) in self.reference.iter().enumerate() {
            let error = self.own.state().q[j] - point.position;
            let moved = point.position - identifying.excitation.at(j, 0.0).position;
            identifying.accuracy.add(error, moved);
        }
        if time >= identifying.sampled + SAMPLING - 1e-9 {
            let state = self.own.state();
            identifying.samples.push(GyroSample {
                R_WB: state.R_WB,
                w_WB_B: *self.own.w_IB_B(),
                q: state.q.clone(),
                qd: state.qd.clone(),
                wheels: self.detumbler.wheel_momentum(&self.wheel_speeds),
            });
            identifying.sampled = time;
        }
        if self.skips {
            self.enter(time, Phase::Done, "captured; identification was skipped");
            self.hold_here();
            return Stage::Rest;
        }
        if time < identifying.excitation.end() {
            return Stage::Identify(identifying);
        }
        let accuracy = identifying.accuracy.relative();
        let (name, is_again) = match identifying.is_again {
            true => ("joint error over motion with the identified inertia", true),
            false => ("joint error over motion with the presumed inertia", false),
        };
        self.report().set(name, accuracy, "");
        match (self.evaluate(&identifying.samples), is_again) {
            // For the same force, a light target may be moved further.
            (Ok(body), false) => self.excite(time, body, identifying.samples),
            (Ok(_), true) => {
                self.enter(time, Phase::Done, "captured, stopped and identified");
                Stage::Rest
            }
            (Err(reason), _) => self.stop(AfterStop::Abort(format!("not identified: {reason}"))),
        }
    }

    /// A pause: the joints come to rest; the excitation restarts afterwards.
    fn pause_identification(&mut self, time: f64, identifying: Identifying) -> Stage {
        let mut identifying = identifying;
        let rest = identifying
            .rest
            .get_or_insert_with(|| Box::new(JointSpline::stop(&self.model, time, &self.reference)));
        for (j, point) in self.reference.iter_mut().enumerate() {
            *point = rest.at(j, time);
        }
        self.track_reference();
        Stage::Identify(identifying)
    }

    /// Identifies the target from the samples, and uses the result from now on. Returns its inertia in the tip's frame.
    fn evaluate(&mut self, samples: &[GyroSample]) -> Result<RigidInertia, String> {
        let noise = self.config.gyro_noise;
        let found = identify(&self.model, &self.tip, samples, None, noise);
        let found = found.map_err(|e| e.to_string())?;
        let rigid = found.inertia.rigid();
        let report = self.report();
        report.set("samples", samples.len() as f64, "");
        report.set("rank", found.excitation.rank as f64, "");
        report.set("condition", found.excitation.condition, "");
        report.set("residual of the gyro", found.residual, "rad/s");
        report.set("mass", rigid.mass, "kg");
        report.set(
            "standard deviation of the mass",
            found.covariance.mass(),
            "kg",
        );
        let limit = self.config.condition_limit;
        if found.excitation.condition > limit {
            return Err(format!(
                "the condition number is {:.0}, above {limit}: move more joints, or further",
                found.excitation.condition
            ));
        }
        let valid = match rigid.check() {
            Ok(()) => rigid,
            // Noise may break the triangle inequality of a flat body.
            Err(e) => rigid
                .nearest_valid()
                .map(|(valid, _)| valid)
                .ok_or_else(|| e.to_string())?,
        };
        self.take(valid, true).map_err(|e| e.to_string())?;
        Ok(valid)
    }
}
