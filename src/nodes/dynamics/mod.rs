//! The dynamics node: simulates the free-floating robot and publishes simulated time.
//!
//! # When a command acts
//!
//! In real time a command acts from the moment it arrives: the world is first stepped to that moment under the old
//! efforts. In lockstep it acts from the state that it answers. Without lockstep, time keeps the pace of the computer's
//! clock but waits up to `answer_timeout` for a commander that has answered states so far (`response_tracking`).
//!
//! # What a command does
//!
//! In a message on `joint_commands`, `effort` sets efforts to hold. `velocity` sets rates: a servo in the robot's drives
//! ([`VelocityServo`](crate::control::VelocityServo)) brings the joints to these rates, within its bandwidth and the joints'
//! effort limits. `position` sets positions that a stiff servo holds. Joints that a command does not name keep their
//! command. When commands end, held efforts become zero (the arm coasts), commanded rates become zero (the arm stops), and
//! positions stay held (`joint_drive`).
//!
//! Motions of the whole arm are joint trajectories (topic and action), paths and twists of the tip (`motions`). Each
//! begins with the joints' present motion, and holds the arm when it is over. External wrenches act on any link
//! (`wrench_inputs`, `external_wrenches`). Excitations of the scenario add sine waves and pulses to efforts, wheel torques
//! and wrenches (`excitations`).
//!
//! Torques of wheels are held as joint efforts are, thrusters are on for the time that their command states
//! (`actuator_inputs`).
//!
//! The robot can hold targets: a frame of the robot and a frame of a target latch at a given time, when they are close, or
//! on command; robot and target are one system from then on (`grasps`, `world::grasping`).
//!
//! Grippers are joints that only their actions move (`gripper_actions`, `gripper_drive`).
//!
//! Bodies with `<collision>` elements touch if the scenario has parameters of contact: robot and targets are then
//! stepped together (`contacts`, `touching`, `world::contact`).
//!
//! Several robots in one world have a dynamics node each; one owns the time, the others follow `/clock`
//! (`shared_time`).
//!
//! One commander at a time commands the joints; others are refused until it has left or is silent for `command_timeout`
//! (`command_arbiter`). Efforts beyond a joint's limit are cut to the limit; a command with an effort beyond `max_effort` is
//! refused (`joint_command`).
//!
//! # Parts
//!
//! `simulation` is the loop. It joins the `clock`, `command_handling`, the `world`, the `outputs` and the
//! `services` of `simulation_interfaces`. The node is a managed one ([`Lifecycle`]): configured it has its world and
//! endpoints, active it simulates.

mod actuator_inputs;
mod clock;
mod command_arbiter;
mod command_handling;
mod contact_messages;
mod contacts;
mod divergence;
mod excitations;
mod external_wrenches;
mod flexible_robot;
mod free_body;
mod grasps;
mod gripper_actions;
mod gripper_drive;
mod imu;
mod joint_command;
mod joint_drive;
mod loops;
mod mean_efforts;
mod messages;
mod motions;
mod outputs;
mod params;
mod part_messages;
mod real_time_pacing;
mod response_tracking;
mod robot;
mod robot_status;
mod services;
mod shared_time;
mod simulation;
mod star_tracker;
mod step_status;
mod target;
mod tick_time;
mod time_status;
mod touching;
mod world;
mod wrench_inputs;
mod wrist;

pub use contact_messages::contacts;
pub use external_wrenches::ExternalChange;
pub use free_body::FreeBody;
pub use imu::{ImuParams, gyro, imu};
pub use loops::{EndParams, LoopParams};
pub use messages::{
    FrameTree, WORLD, external_impulse, joint_states, momentum, odometry, target_joint_states,
};
pub use params::{
    AppendageParams, ContactPairParams, ContactParams, Description, DynamicsParams, FlexibleParams,
    GraspParams, GripperParams, InitialJoints, InitialMotion, LockstepOn, TargetParams,
    ThrusterParams, WheelParams,
};
pub use part_messages::{appendage_states, wheel_states};
pub use robot::Robot;
pub use star_tracker::star_tracker_message;
pub use target::Target;
pub use touching::{Label, LinkEvent, Touching};
pub use world::{GraspEvent, HeldTick, LinkContact, World};
pub use wrist::{WristParams, wrist_message};

use crate::ros::{Lifecycle, Node, NodeError, Transition};
use simulation::Simulation;

/// The node's program.
///
/// # Errors
/// For wrong parameters or descriptions, or when DDS refuses.
pub fn program(node: &Node) -> Result<(), NodeError> {
    let mut declare = node.declare();
    let params = DynamicsParams::declare(&mut declare);
    declare.finish()?;
    let params =
        params.map_err(|e: String| NodeError::Input(format!("node {}: {e}", node.name())))?;
    for warning in params.repairs() {
        tracing::warn!("{warning}");
    }
    let lifecycle = Lifecycle::new(node)?;
    let mut simulation = None;
    let follow = |transition, simulation: &mut _| {
        follow(transition, simulation, || {
            Simulation::new(node, &lifecycle, &params)
        })
    };
    if params.autostart {
        lifecycle.start(|transition| follow(transition, &mut simulation))?;
    }
    while node.ok() {
        lifecycle.follow(|transition| follow(transition, &mut simulation));
        match &mut simulation {
            Some(simulation) if lifecycle.is_active() => simulation.run_once(),
            Some(simulation) => simulation.idle(),
            None => {
                node.wait();
            }
        }
    }
    Ok(())
}

/// Carries out a transition of the node's lifecycle.
fn follow<'a>(
    transition: Transition,
    simulation: &mut Option<Simulation<'a>>,
    new: impl Fn() -> Result<Simulation<'a>, NodeError>,
) -> Result<(), NodeError> {
    match (transition, simulation) {
        (Transition::Configure, simulation) => *simulation = Some(new()?),
        (Transition::Activate, Some(simulation)) => simulation.publish(),
        (Transition::Deactivate, Some(simulation)) => simulation.deactivate(),
        (Transition::CleanUp | Transition::Shutdown, simulation) => *simulation = None,
        (_, None) => {}
    }
    Ok(())
}
