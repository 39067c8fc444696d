//! Control of the simulation by services: the services and the action of `simulation_interfaces`, and services of
//! grasps.
//!
//! As in Gazebo, names are private to the node (`/dynamics/step_simulation`), so that several simulations in one graph
//! do not clash. Calls are answered by the simulation thread, between two steps.

mod entities;
mod entity_filters;
mod entity_motion;
mod grasping;
mod spawn;
mod states;
mod steps;

pub use states::follow_reset;
pub use steps::StepRequests;

use super::{clock::Phase, simulation::Simulation};
use crate::{
    msg::{
        Service,
        simulation_interfaces::{
            Result as Outcome, SimulatorFeatures,
            services::{
                DeleteEntity, GetEntities, GetEntitiesStates, GetEntityInfo, GetEntityState,
                GetSimulationState, GetSimulatorFeatures, GetSimulatorFeaturesResponse,
                GetSpawnables, ResetSimulation, SetEntityState, SetSimulationState, SpawnEntities,
                SpawnEntity,
            },
        },
        std_srvs::Trigger,
    },
    nodes::resource::AllowedFolders,
    ros::{Calls, Node, NodeError, ServiceServer},
};

/// Services that respond at once. Requests for steps, which take longer, are handled by [`StepRequests`].
pub struct Services {
    get_state: Calls<GetSimulationState>,
    set_state: Calls<SetSimulationState>,
    reset: Calls<ResetSimulation>,
    entities: Calls<GetEntities>,
    entities_states: Calls<GetEntitiesStates>,
    entity_info: Calls<GetEntityInfo>,
    entity_state: Calls<GetEntityState>,
    set_entity_state: Calls<SetEntityState>,
    spawn: Calls<SpawnEntity>,
    spawn_all: Calls<SpawnEntities>,
    delete: Calls<DeleteEntity>,
    /// `~/attach` and `~/detach`, if the scenario has grasps.
    grasping: Option<[Calls<Trigger>; 2]>,
    /// Whether the node stops after the current call is answered.
    quit_requested: bool,
    /// Services that do not depend on the simulation.
    _stateless: [ServiceServer; 2],
}

impl Services {
    /// Advertises the services; those of grasps only if `can_grasp`. Callers may name files below `resource_folders`
    /// only.
    ///
    /// # Errors
    /// When DDS reports an error.
    pub fn new(
        node: &Node,
        resource_folders: &AllowedFolders,
        can_grasp: bool,
    ) -> Result<Self, NodeError> {
        let resource_folders = resource_folders.clone();
        Ok(Self {
            get_state: node.serve_calls("~/get_simulation_state")?,
            set_state: node.serve_calls("~/set_simulation_state")?,
            reset: node.serve_calls("~/reset_simulation")?,
            entities: node.serve_calls("~/get_entities")?,
            entities_states: node.serve_calls("~/get_entities_states")?,
            entity_info: node.serve_calls("~/get_entity_info")?,
            entity_state: node.serve_calls("~/get_entity_state")?,
            set_entity_state: node.serve_calls("~/set_entity_state")?,
            spawn: node.serve_calls("~/spawn_entity")?,
            spawn_all: node.serve_calls("~/spawn_entities")?,
            delete: node.serve_calls("~/delete_entity")?,
            grasping: match can_grasp {
                true => Some([node.serve_calls("~/attach")?, node.serve_calls("~/detach")?]),
                false => None,
            },
            quit_requested: false,
            _stateless: [
                node.serve::<GetSimulatorFeatures>("~/get_simulator_features", |_| {
                    GetSimulatorFeaturesResponse {
                        features: features(),
                    }
                })?,
                node.serve::<GetSpawnables>("~/get_spawnables", move |request| {
                    spawn::spawnables(&request.sources, &resource_folders)
                })?,
            ],
        })
    }
}

/// Answers pending calls, and accepts or refuses requests for steps.
pub fn answer_calls(simulation: &mut Simulation) {
    let s = simulation;
    answer(s, |c| &c.get_state, |s, _| states::get(s));
    answer(s, |c| &c.set_state, |s, r| states::set(s, &r));
    let active = check_active(s).and_then(|()| check_owns_time(s));
    if s.steps.take_requests(s.clock.phase(), &active) {
        s.pause(Phase::Paused);
    }
    answer(s, |c| &c.reset, |s, r| states::reset(s, &r));
    answer(s, |c| &c.entities, |s, r| entities::names(&s.world, &r));
    answer(
        s,
        |c| &c.entities_states,
        |s, r| entities::states(&mut s.world, &r),
    );
    answer(s, |c| &c.entity_info, |s, r| entities::info(&s.world, &r));
    answer(
        s,
        |c| &c.entity_state,
        |s, r| entities::state(&mut s.world, &r),
    );
    answer(s, |c| &c.set_entity_state, |s, r| entity_motion::set(s, &r));
    answer(s, |c| &c.spawn, spawn::spawn_one);
    answer(s, |c| &c.spawn_all, |s, r| spawn::spawn_all(s, &r));
    answer(s, |c| &c.delete, |s, r| spawn::delete(s, &r));
    answer_if_offered(
        s,
        |c| c.grasping.as_ref().map(|[attach, _]| attach),
        |s, _| grasping::attach(s),
    );
    answer_if_offered(
        s,
        |c| c.grasping.as_ref().map(|[_, detach]| detach),
        |s, _| grasping::detach(s),
    );
    if s.services.quit_requested {
        s.node.request_stop();
    }
}

/// Answers the calls of one service. If a call changes the world, the world is published before the response is sent.
fn answer<S: Service>(
    simulation: &mut Simulation,
    calls: impl Fn(&Services) -> &Calls<S>,
    handler: impl Fn(&mut Simulation, S::Request) -> S::Response,
) {
    answer_if_offered(simulation, |services| Some(calls(services)), handler);
}

/// As [`answer`], for a service that may not be offered.
fn answer_if_offered<S: Service>(
    simulation: &mut Simulation,
    calls: impl Fn(&Services) -> Option<&Calls<S>>,
    handler: impl Fn(&mut Simulation, S::Request) -> S::Response,
) {
    while let Some(call) = calls(&simulation.services).and_then(Calls::take) {
        let response = handler(simulation, call.request);
        if simulation.outputs.is_outdated() {
            simulation.commands.expect_response_again();
            if let Some(inputs) = &mut simulation.actuator_inputs {
                inputs.expect();
            }
            simulation.publish();
        }
        call.reply.send(&response);
    }
}

/// An error if the node is inactive.
fn check_active(simulation: &Simulation) -> Result<(), Outcome> {
    match simulation.is_active() {
        true => Ok(()),
        false => Err(Outcome::new(
            Outcome::INCORRECT_STATE,
            "the node is inactive; activate it by ~/change_state first",
        )),
    }
}

/// An error if another node owns the time of the world.
fn check_owns_time(simulation: &Simulation) -> Result<(), Outcome> {
    match simulation.shared_time.refusal() {
        None => Ok(()),
        Some(refusal) => Err(Outcome::new(Outcome::INCORRECT_STATE, refusal)),
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
             Free bodies can be spawned, also with joints; bounds are compared with the origins of entities.",
            env!("CARGO_PKG_VERSION")
        ),
    }
}
