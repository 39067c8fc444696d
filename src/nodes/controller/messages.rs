//! Messages that the controller publishes: `joint_commands` and `controller/state`.

use super::super::geometry::vector_to_msg;
use crate::{
    control::{ControlLoop, Controller, LoopReport, PoseError},
    msg::{
        builtin_interfaces, fuyu_msgs::ControllerState, geometry_msgs::Vector3,
        sensor_msgs::JointState, std_msgs::Header,
    },
    ros::Time,
};

/// Age that is published if nothing has been measured yet \[s\].
const NEVER: f64 = 1e9;

/// Position and attitude error of the tip \[m, rad\] in a message of the controller; `None` if nothing was measured,
/// which the message represents by zeros.
pub fn measured_errors(state: &ControllerState) -> Option<(f64, f64)> {
    let errors = (state.position_error_norm, state.attitude_error_angle);
    (errors != (0.0, 0.0)).then_some(errors)
}

/// The two messages of a controller, reused at each step so that joint names are copied only once.
#[derive(Debug, Clone)]
pub struct ControllerMessages {
    /// Efforts to apply, stamped with the joint state that they answer.
    pub command: JointState,
    /// Measurements, decisions and commands of the controller.
    pub state: ControllerState,
}

impl ControllerMessages {
    /// Messages with the joint names and the base frame of the controller's robot.
    pub fn new(controller: &Controller) -> Self {
        let model = controller.model();
        let names: Vec<_> = model.joints().iter().map(|j| j.name.clone()).collect();
        let header = Header {
            frame_id: model.frames()[0].name.clone(),
            ..Header::default()
        };
        Self {
            command: JointState {
                header: header.clone(),
                name: names.clone(),
                ..JointState::default()
            },
            state: ControllerState {
                header,
                joint_names: names,
                ..ControllerState::default()
            },
        }
    }

    /// Writes the results of the last step of `control_loop`, reported by `report`. `state` is unchanged if the law
    /// gave no efforts.
    pub fn write(&mut self, control_loop: &ControlLoop, report: &LoopReport) {
        let stamp: builtin_interfaces::Time = Time::from_nanos(report.stamp.as_nanos()).into();
        let efforts = control_loop.efforts().as_slice();
        let Self { command, state } = self;
        command.header.stamp = stamp.clone();
        replace(&mut command.effort, efforts);
        let Ok(control) = &report.control else {
            return;
        };
        let config = control_loop.controller().config();
        state.header.stamp = stamp;
        state.law.clear();
        state.law.push_str(config.law.name());
        state.position_saturated = control.position_saturated;
        state.orientation_saturated = control.orientation_saturated;
        state.k_p = config.gains.k_p;
        state.k_o = config.gains.k_o;
        replace(&mut state.k_v, &config.gains.k_v);
        replace(&mut state.effort, efforts);
        let age = report.tip.age().unwrap_or(NEVER).min(NEVER);
        (state.tip_pose_age, state.goal_pose_age) = (age, age);
        (
            state.position_error,
            state.orientation_error,
            state.position_error_norm,
            state.attitude_error_angle,
        ) = deviation(control.error.as_ref());
        state.second_tip_seen = control.second_error.is_some();
        (
            state.second_position_error,
            state.second_orientation_error,
            state.second_position_error_norm,
            state.second_attitude_error_angle,
        ) = deviation(control.second_error.as_ref());
    }
}

/// Position and orientation error, norm of the position error \[m\], and rotation angle \[rad\]; zero without a
/// measurement.
fn deviation(error: Option<&PoseError>) -> (Vector3, Vector3, f64, f64) {
    error.map_or_else(Default::default, |error| {
        (
            vector_to_msg(&error.position),
            vector_to_msg(&error.orientation),
            error.position.norm(),
            error.angle,
        )
    })
}

fn replace(list: &mut Vec<f64>, values: &[f64]) {
    list.clear();
    list.extend_from_slice(values);
}
