//! The dynamics node: simulates the free-floating robot and publishes simulated time.
//!
//! # When a command takes effect
//!
//! In real time a command takes effect when it arrives: the world is first stepped to that moment under the previous
//! efforts. In lockstep it takes effect at the state that it answers. Without lockstep, simulated time keeps the pace
//! of the computer's clock, but waits up to `answer_timeout` for a commander that has answered states so far
//! (`response_tracking`).
//!
//! # Effect of a command
//!
//! In a message on `joint_commands`, `effort` sets efforts to hold. `velocity` sets rates: a velocity servo in the
//! robot's drives ([`VelocityServo`](crate::control::VelocityServo)) tracks them, within its bandwidth and the joints'
//! effort limits. `position` sets positions that a stiff servo holds. Joints that a message does not name keep their
//! setpoints. When commands end, held efforts become zero (the arm coasts), commanded rates become zero (the arm
//! stops), and positions stay held (`joint_drive`).
//!
//! Motions of the whole arm are joint trajectories (topic and action), paths and twists of the tip (`motions`). Each
//! begins at the joints' current position and rate, and holds the arm at its end. External wrenches act on any link
//! (`wrench_inputs`, `external_wrenches`). Excitations in the scenario add sine waves and pulses to efforts, wheel
//! torques and wrenches (`excitations`).
//!
//! Wheel torques are held as joint efforts are; thrusters stay on for the time in their command (`actuator_inputs`).
//!
//! The robot can hold targets: a frame of the robot and a frame of a target latch at a given time, when they are close,
//! or on command; from then on robot and target are one system (`rigid_robot`, `world::grasping`).
//!
//! Grippers are joints that only their actions move (`gripper_actions`, `gripper_drive`).
//!
//! Bodies with `<collision>` elements come into contact if the scenario has contact parameters: robot and targets are
//! then integrated together (`contact_builder`, `contact_system`, `world::contact`).
//!
//! Several robots in one world have a dynamics node each; one node owns the time, the others follow `/clock`
//! (`shared_time`).
//!
//! A command arbiter admits one commander of the joints at a time; others are refused until it has left the graph or is
//! silent for `command_timeout` (`command_arbiter`). An effort beyond a joint's limit is clamped to the limit; a
//! command with an effort beyond `max_effort` is refused (`joint_command`).
//!
//! # Parts
//!
//! `simulation` is the main loop. It combines the `clock`, `command_handling`, the `world`, the `outputs` and the
//! `services` of `simulation_interfaces`. The node has a managed lifecycle ([`Lifecycle`]): once configured it has its
//! world and endpoints, while active it simulates.

mod actuator_inputs;
mod clock;
mod command_arbiter;
mod command_handling;
mod contact_builder;
mod contact_messages;
mod contact_system;
mod divergence;
mod excitations;
mod external_wrenches;
mod flexible_robot;
mod free_body;
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
mod rigid_robot;
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
mod world;
mod wrench_inputs;
mod wrist;

pub use contact_messages::contacts;
pub use contact_system::{ContactSystem, Label, LinkEvent};
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
pub use world::{EffortTick, LinkContact, World, WorldEvent};
pub use wrist::{WristParams, wrist_message};

use crate::ros::{Lifecycle, Node, NodeError, Transition};
use simulation::Simulation;

/// The node's program.
///
/// # Errors
/// For invalid parameters or descriptions, or when DDS reports an error.
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
