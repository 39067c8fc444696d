//! The dynamics node: integrates the free-floating robot and owns time.
//!
//! A command acts from the moment it arrives: in real time the world is stepped to that moment under the
//! old efforts first. In lockstep it acts from the state that it answers. In between is the usual case: time
//! keeps the pace of the clock, but waits up to `answer_timeout` for a commander that has answered so far.
//!
//! What a command fills decides what it is: `effort` is held as it is, `velocity` is what a servo in the robot's drives
//! ([`VelocityServo`](crate::control::VelocityServo)) drives the joints' rates to, with a bandwidth of its own and no more
//! effort than they have. The last command is for the whole robot: joints that it does not name keep their effort or rate,
//! or get zero if the command before was of the other kind. When commands end, held efforts become zero, which lets the arm
//! coast, and driven rates become zero, which stops it.
//!
//! One publisher commands at a time; others are refused until it ends or is silent for `command_timeout`. Efforts beyond a
//! joint's limit are cut to it, those beyond `max_effort` refused.
//!
//! The node is a managed one ([`Lifecycle`]): configured it has its world and endpoints, active it simulates. Others
//! control the simulation by `simulation_interfaces` (`control`).

mod clock;
mod command_arbiter;
mod command_handling;
mod imu;
mod joint_command;
mod joint_drive;
mod loops;
mod mean_efforts;
mod messages;
mod outputs;
mod params;
mod real_time_pacing;
mod response_tracking;
mod robot_status;
mod services;
mod simulation;
mod step_status;
mod target;
mod tick_time;
mod time_status;
mod world;

pub use imu::{ImuParams, imu};
pub use loops::{EndParams, LoopParams};
pub use messages::{FrameTree, WORLD, joint_states, momentum, odometry};
pub use params::{Description, DynamicsParams, InitialMotion, TargetParams};
pub use target::Target;
pub use world::World;

use crate::ros::{Lifecycle, Node, NodeError, Transition};
use simulation::Simulation;

/// The node's program.
///
/// # Errors
/// For wrong parameters or descriptions, when DDS refuses, or when the state is no longer finite.
pub fn program(node: &Node) -> Result<(), NodeError> {
    let mut declare = node.declare();
    let params = DynamicsParams::declare(&mut declare);
    declare.finish()?;
    let params =
        params.map_err(|e: String| NodeError::Input(format!("node {}: {e}", node.name())))?;
    let lifecycle = Lifecycle::new(node)?;
    let mut simulation = None;
    let pass = |transition, simulation: &mut _| {
        pass(transition, simulation, || {
            Simulation::new(node, &lifecycle, &params)
        })
    };
    if params.autostart {
        lifecycle.start(|transition| pass(transition, &mut simulation))?;
    }
    while node.ok() {
        lifecycle.follow(|transition| pass(transition, &mut simulation));
        match &mut simulation {
            Some(simulation) if lifecycle.is_active() => simulation.run_once()?,
            Some(simulation) => simulation.idle()?,
            None => {
                node.wait();
            }
        }
    }
    Ok(())
}

/// Does what a transition of the node's lifecycle asks for.
fn pass<'a>(
    transition: Transition,
    simulation: &mut Option<Simulation<'a>>,
    new: impl Fn() -> Result<Simulation<'a>, NodeError>,
) -> Result<(), NodeError> {
    match (transition, simulation) {
        (Transition::Configure, simulation) => *simulation = Some(new()?),
        (Transition::Activate, Some(simulation)) => simulation.publish()?,
        (Transition::Deactivate, Some(simulation)) => simulation.deactivate(),
        (Transition::CleanUp | Transition::Shutdown, simulation) => *simulation = None,
        (_, None) => {}
    }
    Ok(())
}
