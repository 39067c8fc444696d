//! Diagnostics of the controller node, updated at each control step.

use crate::{
    control::{ControlMode, InputStatus, LoopReport},
    ros::{Node, Status},
};

/// The statuses `control` and `gyro`.
pub(super) struct Health {
    /// Control mode of the arm, and problems with the inputs.
    pub control: Status,
    gyro: Status,
}

impl Health {
    pub(super) fn new(node: &Node) -> Self {
        let status = |name: &str| {
            let status = node.diagnostics().status(name);
            status.warn("no joint_states have arrived yet");
            status
        };
        Self {
            control: status("control"),
            gyro: status("gyro"),
        }
    }

    /// Reports a control step; `timeout` is the parameter `measurement_timeout` \[s\].
    pub(super) fn report(&self, report: &LoopReport, timeout: f64) {
        self.report_control(report, timeout);
        const FALLBACK: &str = "the base's rate is computed for zero angular momentum";
        match report.gyro {
            InputStatus::Missing => {
                (self.gyro).warn(format!("no imu message has arrived yet: {FALLBACK}"));
            }
            InputStatus::Stale { age } => self.gyro.warn(format!(
                "the last imu message is {age:.2} s old (measurement_timeout is {timeout} s): {FALLBACK}"
            )),
            InputStatus::Used { .. } | InputStatus::Ignored => {
                self.gyro.ok("measuring the base's rate");
            }
        }
    }

    fn report_control(&self, report: &LoopReport, timeout: f64) {
        let status = &self.control;
        let drives = match report.mode {
            ControlMode::Law => "the law goes on without it",
            ControlMode::DampingOnly => "only damping",
            ControlMode::ZeroEfforts => "zero efforts",
        };
        match (&report.control, report.tip) {
            (Err(e), _) => status.error(format!("the law gives no efforts: {e}; {drives}")),
            (Ok(_), _) if report.mode == ControlMode::ZeroEfforts => {
                status.error("the controller's efforts are not finite; zero efforts");
            }
            (Ok(_), InputStatus::Missing) => {
                status.warn(format!("no camera measurement has come yet: {drives}"));
            }
            (Ok(_), InputStatus::Stale { age }) => status.warn(format!(
                "the last camera measurement is {age:.2} s old (measurement_timeout is {timeout} s): {drives}"
            )),
            (Ok(control), _) => match (control.convergence_failure, report.second_tip) {
                (Some(failure), _) => status.warn(failure.to_string()),
                (None, Some(InputStatus::Missing | InputStatus::Stale { .. })) => {
                    status.warn(
                        "the second tip has no camera measurement: only the first is steered",
                    );
                }
                (None, _) => status.ok("steering the tip to the goal"),
            },
        }
    }
}
