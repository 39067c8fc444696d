//! Control of the simulation by others: the services and the action of `simulation_interfaces`.
//!
//! They are private names of the node (`/dynamics/step_simulation`), as those of Gazebo's server are, so that
//! several simulations in one graph do not clash. Calls are answered by the thread that simulates, in between steps.

mod entities;
mod entity_filters;
mod spawn;
mod states;
mod steps;

pub use steps::Stepping;

use super::simulation::Simulation;
use crate::{
    msg::{
        Service,
        simulation_interfaces::{
            SimulatorFeatures,
            services::{
                DeleteEntity, GetEntities, GetEntitiesStates, GetEntityInfo, GetEntityState,
                GetSimulationState, GetSimulatorFeatures, GetSimulatorFeaturesResponse,
                GetSpawnables, ResetSimulation, SetEntityState, SetSimulationState, SpawnEntities,
                SpawnEntity, StepSimulation,
            },
            simulate_steps::SimulateSteps,
        },
    },
    ros::{ActionServer, Calls, Node, NodeError, ServiceServer},
};

/// Endpoints by which others control the simulation.
pub struct Control {
    get_state: Calls<GetSimulationState>,
    set_state: Calls<SetSimulationState>,
    step: Calls<StepSimulation>,
    steps: ActionServer<SimulateSteps>,
    reset: Calls<ResetSimulation>,
    entities: Calls<GetEntities>,
    entities_states: Calls<GetEntitiesStates>,
    entity_info: Calls<GetEntityInfo>,
    entity_state: Calls<GetEntityState>,
    set_entity_state: Calls<SetEntityState>,
    spawn: Calls<SpawnEntity>,
    spawn_all: Calls<SpawnEntities>,
    delete: Calls<DeleteEntity>,
    /// What no simulation is needed for.
    _always: [ServiceServer; 2],
}

impl Control {
    /// Makes them.
    ///
    /// # Errors
    /// When DDS refuses.
    pub fn new(node: &Node) -> Result<Self, NodeError> {
        Ok(Self {
            get_state: node.serve_calls("~/get_simulation_state")?,
            set_state: node.serve_calls("~/set_simulation_state")?,
            step: node.serve_calls("~/step_simulation")?,
            steps: ActionServer::new(node, "~/simulate_steps")?,
            reset: node.serve_calls("~/reset_simulation")?,
            entities: node.serve_calls("~/get_entities")?,
            entities_states: node.serve_calls("~/get_entities_states")?,
            entity_info: node.serve_calls("~/get_entity_info")?,
            entity_state: node.serve_calls("~/get_entity_state")?,
            set_entity_state: node.serve_calls("~/set_entity_state")?,
            spawn: node.serve_calls("~/spawn_entity")?,
            spawn_all: node.serve_calls("~/spawn_entities")?,
            delete: node.serve_calls("~/delete_entity")?,
            _always: [
                node.serve::<GetSimulatorFeatures>("~/get_simulator_features", |_| {
                    GetSimulatorFeaturesResponse {
                        features: features(),
                    }
                })?,
                node.serve::<GetSpawnables>("~/get_spawnables", |request| {
                    spawn::spawnables(&request.sources)
                })?,
            ],
        })
    }
}

impl Simulation<'_> {
    /// ResponseTracker the calls that wait.
    ///
    /// # Errors
    /// When the state is no longer finite.
    pub(super) fn attend(&mut self) -> Result<(), NodeError> {
        self.answer(|c| &c.get_state, |s, _| s.get_simulation_state())?;
        self.answer(|c| &c.set_state, |s, r| s.set_simulation_state(&r))?;
        self.attend_steps();
        self.answer(|c| &c.reset, |s, r| s.reset_simulation(&r))?;
        self.answer(|c| &c.entities, |s, r| s.get_entities(&r))?;
        self.answer(|c| &c.entities_states, |s, r| s.get_entities_states(&r))?;
        self.answer(|c| &c.entity_info, |s, r| s.get_entity_info(&r))?;
        self.answer(|c| &c.entity_state, |s, r| s.get_entity_state(&r))?;
        self.answer(|c| &c.set_entity_state, |s, r| s.set_entity_state(&r))?;
        self.answer(|c| &c.spawn, |s, r| s.spawn_entity(r))?;
        self.answer(|c| &c.spawn_all, |s, r| s.spawn_entities(r))?;
        self.answer(|c| &c.delete, |s, r| s.delete_entity(&r))?;
        if self.quitting {
            self.node.request_stop();
        }
        Ok(())
    }

    /// ResponseTracker the calls of one service. A world that one of them changes is published before the answer.
    fn answer<S: Service>(
        &mut self,
        calls: impl Fn(&Control) -> &Calls<S>,
        work: impl Fn(&mut Self, S::Request) -> S::Response,
    ) -> Result<(), NodeError> {
        while let Some(call) = calls(&self.control).take() {
            let response = work(self, call.request);
            if std::mem::take(&mut self.changed) {
                self.expect_answer();
                self.publish()?;
            }
            call.reply.send(&response);
        }
        Ok(())
    }
}

fn features() -> SimulatorFeatures {
    use SimulatorFeatures as F;
    let features = [
        F::SPAWNING,
        F::DELETING,
        F::ENTITY_TAGS,
        F::ENTITY_BOUNDS_BOX,
        F::ENTITY_CATEGORIES,
        F::SPAWNING_RESOURCE_STRING,
        F::ENTITY_STATE_GETTING,
        F::ENTITY_STATE_SETTING,
        F::ENTITY_INFO_GETTING,
        F::SPAWNABLES,
        F::SIMULATION_RESET,
        F::SIMULATION_RESET_TIME,
        F::SIMULATION_RESET_STATE,
        F::SIMULATION_RESET_SPAWNED,
        F::SIMULATION_STATE_GETTING,
        F::SIMULATION_STATE_SETTING,
        F::SIMULATION_STATE_PAUSE,
        F::STEP_SIMULATION_SINGLE,
        F::STEP_SIMULATION_MULTIPLE,
        F::STEP_SIMULATION_ACTION,
        F::SPAWNING_ENTITIES,
    ];
    SimulatorFeatures {
        features: features.map(u16::from).to_vec(),
        spawn_formats: vec!["urdf".to_owned()],
        custom_info: format!(
            "fuyu {}, simulation_interfaces 2.1. A step leads to the next state that is published. \
             Single bodies can be spawned; bounds are compared with the origins of entities.",
            env!("CARGO_PKG_VERSION")
        ),
    }
}
