//! Diagnostics of the attitude node, updated at each control step.

use std::time::{Duration, Instant};

use crate::{
    control::{
        InputStatus,
        attitude::{AttitudeMode, AttitudeReport},
    },
    ros::{Node, Status},
};

/// How long diagnostics report a refused message.
const REFUSAL_SHOWN: Duration = Duration::from_secs(5);

/// The last refused message, reported for some seconds with priority over other reports.
#[derive(Debug, Default)]
pub(super) struct Refusals(Option<(Instant, String)>);

impl Refusals {
    /// Records that a message was refused for this reason.
    pub(super) fn note(&mut self, reason: String) {
        self.0 = Some((Instant::now(), reason));
    }

    /// Reports the last refusal, if it is recent.
    pub(super) fn report(&self, status: &Status) {
        if let Some((at, reason)) = &self.0
            && at.elapsed() < REFUSAL_SHOWN
        {
            status.warn(reason.as_str());
        }
    }
}

/// The statuses `control`, `law`, `star tracker` and `wheels`.
pub(super) struct Health {
    /// Control mode, and problems with the inputs.
    pub control: Status,
    /// The active law, and whether it is stable in the current posture.
    pub law: Status,
    star_tracker: Status,
    wheels: Status,
}

impl Health {
    pub(super) fn new(node: &Node) -> Self {
        let status = |name: &str, text: &str| {
            let status = node.diagnostics().status(name);
            status.warn(text);
            status
        };
        Self {
            control: status("control", "no joint_states have arrived yet"),
            law: status("law", "no joint_states have arrived yet"),
            star_tracker: status("star tracker", "no attitude has arrived yet"),
            wheels: status("wheels", "no wheel_states have arrived yet"),
        }
    }

    pub(super) fn report(&self, report: &AttitudeReport) {
        match (report.mode, report.gyro) {
            (AttitudeMode::ZeroTorque, InputStatus::Stale { age }) => self.control.error(format!(
                "the last imu message is {age:.2} s old: zero torque"
            )),
            (AttitudeMode::ZeroTorque, _) => {
                self.control
                    .error("no imu message has arrived yet: zero torque");
            }
            (AttitudeMode::RateDamping, _) => {
                self.control
                    .warn("the attitude is not known: only the rate is damped");
            }
            (AttitudeMode::Law, _) if !report.joints.is_used() => {
                self.control
                    .warn("joint_states are missing: no feed-forward of the arm");
            }
            (AttitudeMode::Law, _) => self.control.ok("holding the attitude"),
        }
        let deviation = report
            .estimate
            .as_ref()
            .map_or(f64::INFINITY, |e| e.attitude_deviation().to_degrees());
        match report.star_tracker {
            InputStatus::Missing => self.star_tracker.warn("no attitude has arrived yet"),
            InputStatus::Stale { age } => self.star_tracker.warn(format!(
                "the last attitude is {age:.1} s old: the gyro alone carries it on, to {deviation:.3} deg (1 sigma)"
            )),
            InputStatus::Used { .. } | InputStatus::Ignored => self.star_tracker.ok(format!(
                "attitude known to {deviation:.4} deg (1 sigma), {} outliers",
                report.outliers
            )),
        }
        let regulator = report.regulator.as_ref();
        let load = regulator
            .and_then(|r| r.wheel_load)
            .map(|load| load * 100.0);
        match (report.wheels.is_used(), regulator) {
            (false, _) => self
                .wheels
                .warn("wheel_states are missing: momentum limits are not known"),
            (true, Some(r)) if r.wheels.saturated > 0 => self.wheels.warn(format!(
                "{} wheels are at a limit; the fullest has {:.0} % of its momentum",
                r.wheels.saturated,
                load.unwrap_or(0.0)
            )),
            (true, Some(r)) => self.wheels.ok(format!(
                "the fullest has {:.0} % of its momentum{}",
                load.unwrap_or(0.0),
                match r.is_unloading {
                    true => "; thrusters unload them",
                    false => "",
                }
            )),
            (true, None) => self.wheels.ok("zero torque"),
        }
    }
}
