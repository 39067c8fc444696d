//! The services.

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
            /// Features.
            features: SimulatorFeatures,
        }
    }

    /// Whether time runs.
    service GetSimulationState {
        GetSimulationStateRequest {
            /// ROS sends one octet for an empty message.
            structure_needs_at_least_one_member: u8,
        }
        GetSimulationStateResponse {
            /// State.
            state: SimulationState,
            /// Outcome.
            result: Result,
        }
    }

    /// Lets time run or stand still.
    service SetSimulationState {
        SetSimulationStateRequest {
            /// State.
            state: SimulationState,
        }
        SetSimulationStateResponse {
            /// Outcome.
            result: Result,
        }
    }

    /// Steps a paused simulation; answered when that is done.
    service StepSimulation {
        StepSimulationRequest {
            /// How many steps.
            steps: u64 = 1,
        }
        StepSimulationResponse {
            /// Outcome.
            result: Result,
        }
    }

    /// Goes back to the start.
    service ResetSimulation {
        ResetSimulationRequest {
            /// Sum of this type's constants.
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
            /// Which.
            filters: EntityFilters,
        }
        GetEntitiesResponse {
            /// Outcome.
            result: Result,
            /// Names.
            entities: Vec<String>,
        }
    }

    /// States of entities.
    service GetEntitiesStates {
        GetEntitiesStatesRequest {
            /// Which.
            filters: EntityFilters,
        }
        GetEntitiesStatesResponse {
            /// Outcome.
            result: Result,
            /// Names.
            entities: Vec<String>,
            /// One for each name.
            states: Vec<EntityState>,
        }
    }

    /// State of an entity.
    service GetEntityState {
        GetEntityStateRequest {
            /// Name.
            entity: String,
        }
        GetEntityStateResponse {
            /// Outcome.
            result: Result,
            /// State, if that is well.
            state: EntityState,
        }
    }

    /// Puts an entity somewhere else, or lets it move otherwise.
    service SetEntityState {
        SetEntityStateRequest {
            /// Name.
            entity: String,
            /// New state; its stamp is ignored.
            state: EntityState,
            /// Whether the pose is to be set.
            set_pose: bool,
            /// Whether the twist is.
            set_twist: bool,
            /// Whether the acceleration is.
            set_acceleration: bool,
        }
        SetEntityStateResponse {
            /// Outcome.
            result: Result,
        }
    }

    /// What an entity is.
    service GetEntityInfo {
        GetEntityInfoRequest {
            /// Name.
            entity: String,
        }
        GetEntityInfoResponse {
            /// Outcome.
            result: Result,
            /// What it is, if that is well.
            info: EntityInfo,
        }
    }

    /// Adds an entity.
    service SpawnEntity {
        SpawnEntityRequest {
            /// Its name; if empty, that of the resource.
            name: String,
            /// Whether a name that is taken or empty may be replaced.
            allow_renaming: bool,
            /// What it is.
            entity_resource: Resource,
            /// Namespace of its topics.
            entity_namespace: String,
            /// Where it starts.
            initial_pose: PoseStamped,
        }
        SpawnEntityResponse {
            /// Outcome; its numbers are those of `SpawnResult`.
            result: Result,
            /// Its name.
            entity_name: String,
        }
    }

    /// Adds entities.
    service SpawnEntities {
        SpawnEntitiesRequest {
            /// Which.
            spawn_requests: Vec<SpawnRequest>,
        }
        SpawnEntitiesResponse {
            /// Outcome of all.
            result: Result,
            /// Outcome of each.
            results: Vec<SpawnResult>,
        }
    }

    /// Removes an entity.
    service DeleteEntity {
        DeleteEntityRequest {
            /// Name.
            entity: String,
        }
        DeleteEntityResponse {
            /// Outcome.
            result: Result,
        }
    }

    /// What can be added.
    service GetSpawnables {
        GetSpawnablesRequest {
            /// More places to look in.
            sources: Vec<String>,
        }
        GetSpawnablesResponse {
            /// Outcome.
            result: Result,
            /// What was found.
            spawnables: Vec<Spawnable>,
        }
    }
}

impl SetSimulationStateResponse {
    /// It is in that state already.
    pub const ALREADY_IN_TARGET_STATE: u8 = 101;
    /// It could not get there.
    pub const STATE_TRANSITION_ERROR: u8 = 102;
    /// There is no way there.
    pub const INCORRECT_TRANSITION: u8 = 103;
}

impl ResetSimulationRequest {
    /// All.
    pub const SCOPE_DEFAULT: u8 = 0;
    /// Time begins at zero again.
    pub const SCOPE_TIME: u8 = 1;
    /// Everything is where it was at the start and moves so.
    pub const SCOPE_STATE: u8 = 2;
    /// What was spawned is removed.
    pub const SCOPE_SPAWNED: u8 = 4;
    /// As if launched again.
    pub const SCOPE_ALL: u8 = 255;
}

impl SetEntityStateResponse {
    /// Not a pose.
    pub const INVALID_POSE: u8 = 101;
}

impl SpawnEntitiesResponse {
    /// At least one could not be added.
    pub const ENTITIES_SPAWN_FAILED: u8 = 150;
}
