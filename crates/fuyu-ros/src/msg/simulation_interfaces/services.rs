//! Services of `simulation_interfaces`.

use super::{
    EntityFilters, EntityInfo, EntityState, Resource, Result, SimulationState, SimulatorFeatures,
    SpawnEntity as SpawnRequest, SpawnResult, Spawnable,
};
use crate::msg::geometry_msgs::PoseStamped;

crate::services! {
    package simulation_interfaces;

    /// What the simulator can do.
    service GetSimulatorFeatures {
        GetSimulatorFeaturesRequest {
            /// ROS sends one octet for an empty message.
            structure_needs_at_least_one_member: u8,
        }
        GetSimulatorFeaturesResponse {
            /// Supported features and formats.
            features: SimulatorFeatures,
        }
    }

    /// Gets the state of the simulation: playing, paused or stopped.
    service GetSimulationState {
        GetSimulationStateRequest {
            /// ROS sends one octet for an empty message.
            structure_needs_at_least_one_member: u8,
        }
        GetSimulationStateResponse {
            /// State of the simulation.
            state: SimulationState,
            /// Outcome.
            result: Result,
        }
    }

    /// Plays, pauses, stops or quits the simulation.
    service SetSimulationState {
        SetSimulationStateRequest {
            /// State of the simulation.
            state: SimulationState,
        }
        SetSimulationStateResponse {
            /// Outcome.
            result: Result,
        }
    }

    /// Steps a paused simulation; the response is sent after the last step.
    service StepSimulation {
        StepSimulationRequest {
            /// Number of steps.
            steps: u64 = 1,
        }
        StepSimulationResponse {
            /// Outcome.
            result: Result,
        }
    }

    /// Resets the simulation to its start.
    service ResetSimulation {
        ResetSimulationRequest {
            /// What is reset: a sum of the constants of this type.
            scope: u8,
        }
        ResetSimulationResponse {
            /// Outcome.
            result: Result,
        }
    }

    /// Names of entities.
    service GetEntities {
        GetEntitiesRequest {
            /// Conditions that the entities must meet.
            filters: EntityFilters,
        }
        GetEntitiesResponse {
            /// Outcome.
            result: Result,
            /// Names of the entities.
            entities: Vec<String>,
        }
    }

    /// States of entities.
    service GetEntitiesStates {
        GetEntitiesStatesRequest {
            /// Conditions that the entities must meet.
            filters: EntityFilters,
        }
        GetEntitiesStatesResponse {
            /// Outcome.
            result: Result,
            /// Names of the entities.
            entities: Vec<String>,
            /// Their states, in the order of the names.
            states: Vec<EntityState>,
        }
    }

    /// State of an entity.
    service GetEntityState {
        GetEntityStateRequest {
            /// Name of the entity.
            entity: String,
        }
        GetEntityStateResponse {
            /// Outcome.
            result: Result,
            /// State of the entity, valid if the call succeeded.
            state: EntityState,
        }
    }

    /// Sets the pose, twist or acceleration of an entity.
    service SetEntityState {
        SetEntityStateRequest {
            /// Name of the entity.
            entity: String,
            /// New state; its stamp is ignored.
            state: EntityState,
            /// Whether the pose is to be set.
            set_pose: bool,
            /// Whether the twist is to be set.
            set_twist: bool,
            /// Whether the acceleration is to be set.
            set_acceleration: bool,
        }
        SetEntityStateResponse {
            /// Outcome.
            result: Result,
        }
    }

    /// Describes an entity.
    service GetEntityInfo {
        GetEntityInfoRequest {
            /// Name of the entity.
            entity: String,
        }
        GetEntityInfoResponse {
            /// Outcome.
            result: Result,
            /// Description of the entity, valid if the call succeeded.
            info: EntityInfo,
        }
    }

    /// Adds an entity.
    service SpawnEntity {
        SpawnEntityRequest {
            /// Name of the entity; if empty, that of the resource.
            name: String,
            /// Whether the simulator may choose another name if this one is in use or empty.
            allow_renaming: bool,
            /// Description of the entity, such as a URDF.
            entity_resource: Resource,
            /// Namespace of its topics.
            entity_namespace: String,
            /// Pose at which it is added.
            initial_pose: PoseStamped,
        }
        SpawnEntityResponse {
            /// Outcome; its codes are those of `SpawnResult`.
            result: Result,
            /// Name that the entity was given.
            entity_name: String,
        }
    }

    /// Adds entities.
    service SpawnEntities {
        SpawnEntitiesRequest {
            /// The entities to add.
            spawn_requests: Vec<SpawnRequest>,
        }
        SpawnEntitiesResponse {
            /// Outcome of the whole request.
            result: Result,
            /// Outcome for each entity.
            results: Vec<SpawnResult>,
        }
    }

    /// Removes an entity.
    service DeleteEntity {
        DeleteEntityRequest {
            /// Name of the entity.
            entity: String,
        }
        DeleteEntityResponse {
            /// Outcome.
            result: Result,
        }
    }

    /// Lists the resources that can be spawned.
    service GetSpawnables {
        GetSpawnablesRequest {
            /// Additional places to search.
            sources: Vec<String>,
        }
        GetSpawnablesResponse {
            /// Outcome.
            result: Result,
            /// The resources that were found.
            spawnables: Vec<Spawnable>,
        }
    }
}

impl SetSimulationStateResponse {
    /// The simulation is in the requested state already.
    pub const ALREADY_IN_TARGET_STATE: u8 = 101;
    /// The transition to the requested state failed.
    pub const STATE_TRANSITION_ERROR: u8 = 102;
    /// There is no transition from the present to the requested state.
    pub const INCORRECT_TRANSITION: u8 = 103;
}

impl ResetSimulationRequest {
    /// The same as `SCOPE_ALL`.
    pub const SCOPE_DEFAULT: u8 = 0;
    /// Simulated time restarts at zero.
    pub const SCOPE_TIME: u8 = 1;
    /// All entities return to their initial poses and velocities.
    pub const SCOPE_STATE: u8 = 2;
    /// Spawned entities are removed.
    pub const SCOPE_SPAWNED: u8 = 4;
    /// All of these, as after a new launch.
    pub const SCOPE_ALL: u8 = 255;
}

impl SetEntityStateResponse {
    /// The pose is not valid.
    pub const INVALID_POSE: u8 = 101;
}

impl SpawnEntitiesResponse {
    /// At least one entity could not be added.
    pub const ENTITIES_SPAWN_FAILED: u8 = 150;
}
