//! Services that play, pause, stop, quit and reset the simulation.

use std::time::Duration;

use super::{check_active, check_owns_time};
use crate::{
    msg::simulation_interfaces::{
        Result as Outcome, SimulationState,
        services::{
            GetSimulationStateResponse, ResetSimulationRequest as Reset, ResetSimulationResponse,
            SetSimulationStateRequest, SetSimulationStateResponse as Set,
        },
    },
    nodes::dynamics::{clock::Phase, simulation::Simulation, target::Target, world::World},
};

/// Numbers and names of the states of `simulation_interfaces`; each number is its index.
const NAMES: [(u8, &str); 4] = [
    (SimulationState::STATE_STOPPED, "stopped"),
    (SimulationState::STATE_PLAYING, "playing"),
    (SimulationState::STATE_PAUSED, "paused"),
    (SimulationState::STATE_QUITTING, "quitting"),
];

/// Time between attempts to follow a reset that has failed.
const RETRY_PERIOD: Duration = Duration::from_secs(1);

impl Phase {
    fn number(self) -> u8 {
        match self {
            Self::Stopped => SimulationState::STATE_STOPPED,
            Self::Playing => SimulationState::STATE_PLAYING,
            Self::Paused => SimulationState::STATE_PAUSED,
        }
    }

    pub(super) fn name(self) -> &'static str {
        NAMES[usize::from(self.number())].1
    }
}

/// The state of the simulation.
pub fn get(simulation: &Simulation) -> GetSimulationStateResponse {
    // The owner of the time decides whether time advances.
    let is_stopped = (simulation.shared_time).stands_still(simulation.world.time());
    let phase = match is_stopped {
        true => Phase::Paused,
        false => simulation.clock.phase(),
    };
    GetSimulationStateResponse {
        state: SimulationState {
            state: phase.number(),
        },
        result: Outcome::ok(),
    }
}

/// Plays, pauses, stops or quits.
pub fn set(simulation: &mut Simulation, request: &SetSimulationStateRequest) -> Set {
    let result = enter(simulation, request.state.state);
    Set {
        result: result.err().unwrap_or_else(Outcome::ok),
    }
}

fn enter(simulation: &mut Simulation, state: u8) -> Result<(), Outcome> {
    let Some((_, name)) = NAMES.iter().find(|(number, _)| *number == state) else {
        let known = NAMES.map(|(number, name)| format!("{number} ({name})"));
        return Err(Outcome::new(
            Set::INCORRECT_TRANSITION,
            format!(
                "state {state} cannot be set; give one of {}",
                known.join(", ")
            ),
        ));
    };
    check_active(simulation)?;
    if state != SimulationState::STATE_QUITTING {
        check_owns_time(simulation)?;
    }
    if state == SimulationState::STATE_PAUSED && simulation.steps.is_pending() {
        simulation.steps.end("the simulation was paused");
        simulation.pause(Phase::Paused);
        return Ok(());
    }
    if state == simulation.clock.phase().number() {
        return Err(Outcome::new(
            Set::ALREADY_IN_TARGET_STATE,
            format!("the simulation is {name} already"),
        ));
    }
    match state {
        SimulationState::STATE_PLAYING => play(simulation),
        SimulationState::STATE_PAUSED => {
            simulation.pause(Phase::Paused);
            Ok(())
        }
        SimulationState::STATE_STOPPED => stop(simulation),
        _ => {
            stop(simulation)?;
            simulation.services.quit_requested = true;
            Ok(())
        }
    }
}

fn play(simulation: &mut Simulation) -> Result<(), Outcome> {
    if simulation.steps.is_pending() {
        return Err(Outcome::new(
            Outcome::INCORRECT_STATE,
            "steps are being simulated; wait for their end, or pause to end them",
        ));
    }
    let clock = &mut simulation.clock;
    if clock.is_over(simulation.world.time()) {
        return Err(Outcome::new(
            Set::STATE_TRANSITION_ERROR,
            format!(
                "the duration of {} s is over; reset the simulation, or give duration 0",
                clock.duration()
            ),
        ));
    }
    clock.set_phase(Phase::Playing);
    Ok(())
}

fn stop(simulation: &mut Simulation) -> Result<(), Outcome> {
    simulation.steps.end("the simulation was stopped");
    reset_all(simulation)?;
    simulation.pause(Phase::Stopped);
    Ok(())
}

/// Resets time, state or spawned bodies, or everything.
pub fn reset(simulation: &mut Simulation, request: &Reset) -> ResetSimulationResponse {
    let result = reset_scope(simulation, request.scope);
    ResetSimulationResponse {
        result: result.err().unwrap_or_else(Outcome::ok),
    }
}

fn reset_scope(simulation: &mut Simulation, scope: u8) -> Result<(), Outcome> {
    check_active(simulation)?;
    let known = Reset::SCOPE_TIME | Reset::SCOPE_STATE | Reset::SCOPE_SPAWNED;
    if scope & !known != 0 && scope != Reset::SCOPE_ALL {
        return Err(Outcome::new(
            Outcome::FEATURE_UNSUPPORTED,
            format!(
                "scope {scope} is not known; give a sum of 1 (time), 2 (state) and 4 (spawned), or 255 (all)"
            ),
        ));
    }
    if scope == Reset::SCOPE_DEFAULT || scope & Reset::SCOPE_TIME != 0 {
        check_owns_time(simulation)?;
    }
    if simulation.shared_time.is_shared()
        && let Some(problem) = splits_robots(scope)
    {
        return Err(Outcome::new(Outcome::FEATURE_UNSUPPORTED, problem));
    }
    simulation.steps.end("the simulation was reset");
    if scope == Reset::SCOPE_DEFAULT || scope == Reset::SCOPE_ALL {
        return reset_all(simulation);
    }
    let world = &mut simulation.world;
    if scope & Reset::SCOPE_SPAWNED != 0 {
        let is_held = |target: &Target| world.held_target() == Some(target.name.as_str());
        if (world.targets.iter()).any(|target| target.spawned && is_held(target)) {
            world.release_without_spring();
        }
        world.targets.retain(|target| !target.spawned);
        simulation.outputs.remove_targets(world);
    }
    if scope & Reset::SCOPE_STATE != 0 {
        world.reset_state();
    }
    if scope & Reset::SCOPE_TIME != 0 {
        world.reset_time();
    }
    if scope & (Reset::SCOPE_TIME | Reset::SCOPE_STATE) != 0 {
        simulation.restart();
    }
    simulation.outputs.invalidate();
    Ok(())
}

/// Resets everything to the start of the node.
fn reset_all(simulation: &mut Simulation) -> Result<(), Outcome> {
    let failed = |e: String| Outcome::new(Outcome::OPERATION_FAILED, e);
    simulation.world = World::new(simulation.params).map_err(failed)?;
    (simulation.outputs)
        .replace_targets(simulation.node, &simulation.world)
        .map_err(|e| failed(e.to_string()))?;
    simulation.restart();
    simulation.outputs.invalidate();
    Ok(())
}

/// Why a reset in this `scope` is refused with several robots: robots that follow the time are always reset with their
/// state.
fn splits_robots(scope: u8) -> Option<String> {
    let time_alone = scope & Reset::SCOPE_TIME != 0 && scope & Reset::SCOPE_STATE == 0;
    time_alone.then(|| {
        format!(
            "scope {scope} resets time without state, but the other robots, which follow this time, are reset with their \
             state; give {}, or 255 (all)",
            scope | Reset::SCOPE_STATE
        )
    })
}

/// Resets this robot after a reset of the node that owns the time.
pub fn follow_reset(simulation: &mut Simulation) {
    let leader = simulation.shared_time.leader().unwrap_or_default();
    tracing::info!("the robot {leader}, which owns the time, was reset, and so is this one");
    if let Err(failed) = reset_all(simulation) {
        // Unexpected: the same parameters have produced a world before.
        tracing::error!("cannot follow a reset: {}", failed.error_message);
        simulation.node.wait_for(RETRY_PERIOD);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // Would break if a reset of time moved the bodies of all robots but the first one's.
    #[test]
    fn several_robots_are_not_reset_in_time_alone() {
        for scope in [Reset::SCOPE_TIME, Reset::SCOPE_TIME | Reset::SCOPE_SPAWNED] {
            let problem = splits_robots(scope).unwrap();
            assert!(
                problem.contains(&format!("give {}", scope | 2)),
                "{problem}"
            );
        }
        for scope in [
            Reset::SCOPE_DEFAULT,
            Reset::SCOPE_STATE,
            Reset::SCOPE_SPAWNED,
            Reset::SCOPE_TIME | Reset::SCOPE_STATE,
            Reset::SCOPE_ALL,
        ] {
            assert_eq!(splits_robots(scope), None, "{scope}");
        }
    }
}
