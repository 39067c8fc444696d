//! Play, pause, stop, quit and reset.

use crate::{
    msg::simulation_interfaces::{
        Result as Outcome, SimulationState,
        services::{
            GetSimulationStateResponse, ResetSimulationRequest as Reset, ResetSimulationResponse,
            SetSimulationStateRequest, SetSimulationStateResponse as Set,
        },
    },
    nodes::dynamics::{
        simulation::{Phase, Simulation},
        world::World,
    },
};

const NAMES: [(u8, &str); 4] = [
    (SimulationState::STATE_STOPPED, "stopped"),
    (SimulationState::STATE_PLAYING, "playing"),
    (SimulationState::STATE_PAUSED, "paused"),
    (SimulationState::STATE_QUITTING, "quitting"),
];

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

impl Simulation<'_> {
    pub(super) fn get_simulation_state(&self) -> GetSimulationStateResponse {
        GetSimulationStateResponse {
            state: SimulationState {
                state: self.phase.number(),
            },
            result: Outcome::ok(),
        }
    }

    pub(super) fn set_simulation_state(&mut self, request: &SetSimulationStateRequest) -> Set {
        let result = self.go_to(request.state.state);
        Set {
            result: result.err().unwrap_or_else(Outcome::ok),
        }
    }

    fn go_to(&mut self, state: u8) -> Result<(), Outcome> {
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
        self.check_active()?;
        if state == self.phase.number() {
            return Err(Outcome::new(
                Set::ALREADY_IN_TARGET_STATE,
                format!("the simulation is {name} already"),
            ));
        }
        match state {
            SimulationState::STATE_PLAYING => {
                if self.stepping.is_some() {
                    return Err(Outcome::new(
                        Outcome::INCORRECT_STATE,
                        "steps are being simulated; wait for their end, cancel them or stop",
                    ));
                }
                if self.is_over() {
                    return Err(Outcome::new(
                        Set::STATE_TRANSITION_ERROR,
                        format!(
                            "the duration of {} s is over; reset the simulation, or give duration 0",
                            self.params.duration
                        ),
                    ));
                }
                self.phase = Phase::Playing;
            }
            SimulationState::STATE_PAUSED => self.pause(Phase::Paused),
            SimulationState::STATE_STOPPED => self.stop()?,
            _ => {
                self.stop()?;
                self.quitting = true;
            }
        }
        Ok(())
    }

    fn stop(&mut self) -> Result<(), Outcome> {
        self.end_steps("the simulation was stopped");
        self.begin_world_anew()?;
        self.pause(Phase::Stopped);
        Ok(())
    }

    pub(super) fn reset_simulation(&mut self, request: &Reset) -> ResetSimulationResponse {
        let result = self.reset(request.scope);
        ResetSimulationResponse {
            result: result.err().unwrap_or_else(Outcome::ok),
        }
    }

    fn reset(&mut self, scope: u8) -> Result<(), Outcome> {
        self.check_active()?;
        let known = Reset::SCOPE_TIME | Reset::SCOPE_STATE | Reset::SCOPE_SPAWNED;
        if scope & !known != 0 && scope != Reset::SCOPE_ALL {
            return Err(Outcome::new(
                Outcome::FEATURE_UNSUPPORTED,
                format!(
                    "scope {scope} is not known; give a sum of 1 (time), 2 (state) and 4 (spawned), or 255 (all)"
                ),
            ));
        }
        self.end_steps("the simulation was reset");
        if scope == Reset::SCOPE_DEFAULT || scope == Reset::SCOPE_ALL {
            return self.begin_world_anew();
        }
        if scope & Reset::SCOPE_SPAWNED != 0 {
            self.world.targets.retain(|target| !target.spawned);
            self.outputs.forget_targets(&self.world);
        }
        if scope & Reset::SCOPE_STATE != 0 {
            self.world.reset_state();
        }
        if scope & Reset::SCOPE_TIME != 0 {
            self.world.reset_time();
        }
        if scope & (Reset::SCOPE_TIME | Reset::SCOPE_STATE) != 0 {
            self.begin_anew();
        }
        self.changed = true;
        Ok(())
    }

    /// As if the node had just begun.
    fn begin_world_anew(&mut self) -> Result<(), Outcome> {
        let failed = |e: String| Outcome::new(Outcome::OPERATION_FAILED, e);
        self.world = World::new(self.params).map_err(failed)?;
        (self.outputs)
            .follow_targets(self.node, &self.world)
            .map_err(|e| failed(e.to_string()))?;
        self.begin_anew();
        self.changed = true;
        Ok(())
    }

    /// Refuses what needs an active node.
    pub(super) fn check_active(&self) -> Result<(), Outcome> {
        match self.is_active() {
            true => Ok(()),
            false => Err(Outcome::new(
                Outcome::INCORRECT_STATE,
                "the node is inactive; activate it by ~/change_state first",
            )),
        }
    }
}
