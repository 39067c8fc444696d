//! Messages on deformable bodies, elastic joints and wheels, created once and updated in place.

use super::{messages::header, params::AppendageParams, world::World};
use crate::{
    dynamics::flexible::FlexibleSystem,
    msg::{
        fuyu_msgs::{AppendageOutlines, AppendageStates},
        geometry_msgs::{Point, Vector3},
        sensor_msgs::JointState,
    },
    nodes::geometry::vector_to_msg,
    ros::Time,
};

/// Deformation of appendages and elastic joints; `None` for a robot that has neither.
pub fn appendage_states(stamp: Time, base: &str, world: &World) -> Option<AppendageStates> {
    let system = world.robot.flexible()?.system();
    if system.modal_bodies().is_empty() && system.elastic_joints().is_empty() {
        return None;
    }
    let mut message = blank_appendages(base, system);
    update_appendage_states(&mut message, stamp, world);
    Some(message)
}

fn blank_appendages(base: &str, system: &FlexibleSystem) -> AppendageStates {
    let (bodies, joints) = (system.modal_bodies(), system.elastic_joints());
    AppendageStates {
        header: header(Time::ZERO, base),
        name: bodies.iter().map(|b| b.name().to_owned()).collect(),
        modes: (bodies.iter())
            .map(|b| u32::try_from(b.modes()).unwrap_or(u32::MAX))
            .collect(),
        mu: vec![0.0; system.modes()],
        mud: vec![0.0; system.modes()],
        tip_displacement: vec![Vector3::default(); bodies.len()],
        joint_name: joints.iter().map(|j| j.joint.clone()).collect(),
        motor_position: vec![0.0; joints.len()],
        motor_velocity: vec![0.0; joints.len()],
        strain_energy: 0.0,
    }
}

/// Updates a message of [`appendage_states`].
pub(super) fn update_appendage_states(message: &mut AppendageStates, stamp: Time, world: &World) {
    let Some(robot) = world.robot.flexible() else {
        return;
    };
    let (state, workspace) = (robot.state(), robot.workspace());
    message.header.stamp = stamp.into();
    message.mu.copy_from_slice(state.mu());
    message.mud.copy_from_slice(state.mu_dot());
    let bodies = robot.system().modal_bodies().iter().enumerate();
    for ((i, body), tip) in bodies.zip(&mut message.tip_displacement) {
        if !body.appendage.outputs.is_empty() {
            *tip = vector_to_msg(&workspace.deflection(state, i, 0));
        }
    }
    message.motor_position.copy_from_slice(state.motor_angles());
    message.motor_velocity.copy_from_slice(state.motor_rates());
    message.strain_energy = workspace.strain_energy(state);
}

/// Points of the appendages that viewers draw; `None` without appendages.
pub fn appendage_outlines(base: &str, appendages: &[AppendageParams]) -> Option<AppendageOutlines> {
    if appendages.is_empty() {
        return None;
    }
    let mut message = AppendageOutlines {
        header: header(Time::ZERO, base),
        ..AppendageOutlines::default()
    };
    let count = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
    for AppendageParams { body, outline, .. } in appendages {
        message.name.push(body.name.clone());
        message.modes.push(count(body.modes()));
        message.points.push(count(outline.points.len()));
        message.is_surface.push(outline.is_surface);
        for point in &outline.points {
            let p = &point.position;
            message.position.push(Point {
                x: p.x,
                y: p.y,
                z: p.z,
            });
            (message.shape).extend(point.translation.iter().map(vector_to_msg));
        }
    }
    Some(message)
}

/// Angles and speeds of the wheels relative to their links, and the mean torques of their motors between the last two
/// states; `None` for a robot without wheels.
pub fn wheel_states(stamp: Time, base: &str, world: &World) -> Option<JointState> {
    let wheels = world.robot.flexible()?.system().wheels();
    if wheels.is_empty() {
        return None;
    }
    let zeros = vec![0.0; wheels.len()];
    let mut message = JointState {
        header: header(stamp, base),
        name: wheels.iter().map(|wheel| wheel.name.clone()).collect(),
        position: zeros.clone(),
        velocity: zeros.clone(),
        effort: zeros,
    };
    update_wheel_states(&mut message, stamp, world);
    Some(message)
}

/// Updates a message of [`wheel_states`].
pub(super) fn update_wheel_states(message: &mut JointState, stamp: Time, world: &World) {
    let Some(robot) = world.robot.flexible() else {
        return;
    };
    message.header.stamp = stamp.into();
    message
        .position
        .copy_from_slice(robot.state().wheel_angles());
    message
        .velocity
        .copy_from_slice(robot.state().wheel_speeds());
    message.effort.copy_from_slice(world.mean_wheel_torques());
}
