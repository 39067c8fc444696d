//! Messages published by the attitude node: `wheel_commands`, `thruster_commands` and `attitude/state`.

use nalgebra::{UnitQuaternion, Vector3};

use super::AttitudeLoop;
use crate::{
    control::{
        Stamp,
        attitude::{AttitudeMode, AttitudeReport},
    },
    msg::{
        builtin_interfaces,
        fuyu_msgs::{AttitudeState, ThrusterCommands},
        sensor_msgs::JointState,
        std_msgs::Header,
    },
    nodes::geometry::{quaternion_to_msg, vector_to_msg},
    ros::Time,
};

/// Age that is published if nothing has been measured yet \[s\].
const NEVER: f64 = 1e9;

/// The messages of an attitude controller, reused at each step so that names are copied only once.
#[derive(Debug, Clone)]
pub struct AttitudeMessages {
    /// Motor torques of the wheels.
    pub wheels: JointState,
    /// On-times of the thrusters.
    pub thrusters: ThrusterCommands,
    /// Estimates, decisions and commands of the controller.
    pub state: AttitudeState,
}

impl AttitudeMessages {
    /// Messages with the names of the robot's wheels and thrusters.
    pub fn new(attitude: &AttitudeLoop) -> Self {
        let system = attitude.system();
        let header = Header {
            frame_id: system.model().frames()[0].name.clone(),
            ..Header::default()
        };
        Self {
            wheels: JointState {
                header: header.clone(),
                name: system.wheels().iter().map(|w| w.name.clone()).collect(),
                effort: vec![0.0; system.wheels().len()],
                ..JointState::default()
            },
            thrusters: ThrusterCommands {
                header: header.clone(),
                name: system.thrusters().iter().map(|t| t.name.clone()).collect(),
                on_time: vec![0.0; system.thrusters().len()],
            },
            state: AttitudeState {
                header,
                covariance: vec![0.0; 36],
                ..AttitudeState::default()
            },
        }
    }

    /// Writes the torques to hold in answer to the state of `now`, and on-times of thrusters if commanded. Returns
    /// whether there are on-times.
    pub fn write_commands(&mut self, attitude: &AttitudeLoop, now: Stamp) -> bool {
        let stamp: builtin_interfaces::Time = Time::from_nanos(now.as_nanos()).into();
        self.wheels.header.stamp = stamp.clone();
        let torques = attitude.wheel_torques();
        self.wheels.effort.clear();
        self.wheels.effort.extend_from_slice(torques);
        let Some(on_times) = attitude.on_times() else {
            return false;
        };
        self.thrusters.header.stamp = stamp;
        self.thrusters.on_time.clear();
        self.thrusters.on_time.extend_from_slice(on_times);
        true
    }

    /// Writes commands of zero torques and closed valves.
    pub fn write_release(&mut self, now: Stamp) {
        let stamp: builtin_interfaces::Time = Time::from_nanos(now.as_nanos()).into();
        self.wheels.header.stamp = stamp.clone();
        self.wheels.effort.fill(0.0);
        self.thrusters.header.stamp = stamp;
        self.thrusters.on_time.fill(0.0);
    }

    /// Writes the report of a step to `state`.
    pub fn write_report(&mut self, attitude: &AttitudeLoop, report: &AttitudeReport) {
        let state = &mut self.state;
        state.law.clear();
        state.law.push_str(attitude.params().law.name);
        state.header.stamp = Time::from_nanos(report.stamp.as_nanos()).into();
        state.mode.clear();
        state.mode.push_str(match report.mode {
            AttitudeMode::Law => "law",
            AttitudeMode::RateDamping => "rate_damping",
            AttitudeMode::ZeroTorque => "zero_torque",
        });
        let one = UnitQuaternion::identity();
        let zero = Vector3::zeros();
        let estimate = report.estimate.as_ref();
        state.attitude_known = estimate.is_some_and(|e| e.attitude_known);
        state.orientation = quaternion_to_msg(estimate.map_or(&one, |e| &e.R_WB));
        state.angular_velocity = vector_to_msg(estimate.map_or(&zero, |e| &e.w_WB_B));
        state.gyro_bias = vector_to_msg(estimate.map_or(&zero, |e| &e.bias));
        if let Some(estimate) = estimate {
            // The matrix is symmetric: order of rows and columns does not matter.
            state.covariance.clear();
            state
                .covariance
                .extend_from_slice(estimate.covariance.as_slice());
        }
        let target = attitude.controller().and_then(|c| c.target(report.stamp));
        state.target = quaternion_to_msg(target.as_ref().map_or(&one, |t| &t.R_WD));
        let deviation = report.deviation.as_ref();
        state.attitude_error = vector_to_msg(deviation.map_or(&zero, |d| &d.angle));
        state.attitude_error_angle = deviation.map_or(0.0, |d| d.turn());
        let regulator = report.regulator.as_ref();
        state.law_torque = vector_to_msg(regulator.map_or(&zero, |r| &r.law));
        state.feed_forward_torque = vector_to_msg(regulator.map_or(&zero, |r| &r.feed_forward));
        state.wheel_torque = vector_to_msg(regulator.map_or(&zero, |r| &r.wheels.torque));
        let thrusters = regulator.and_then(|r| r.thrusters.as_ref());
        state.thruster_torque = vector_to_msg(thrusters.map_or(&zero, |t| &t.torque));
        let momentum = regulator.and_then(|r| r.wheel_momentum.as_ref());
        state.wheel_momentum = vector_to_msg(momentum.unwrap_or(&zero));
        state.wheel_load = regulator.and_then(|r| r.wheel_load).unwrap_or(0.0);
        let saturated = regulator.map_or(0, |r| r.wheels.saturated);
        state.saturated_wheels = u32::try_from(saturated).unwrap_or(u32::MAX);
        state.unloading = regulator.is_some_and(|r| r.is_unloading);
        state.star_tracker_age = report.star_tracker.age().unwrap_or(NEVER).min(NEVER);
        state.outliers = u32::try_from(report.outliers).unwrap_or(u32::MAX);
    }
}
