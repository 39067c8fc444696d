//! ROS package [`simulation_interfaces`](https://github.com/ros-simulation/simulation_interfaces) 2.1, the standard
//! interface to control simulators: the part that the dynamics node serves.

pub mod services;
pub mod simulate_steps;

use super::{
    geometry_msgs::{Accel, Pose, PoseStamped, Twist, Vector3},
    std_msgs::Header,
};

crate::messages! {
    package simulation_interfaces;

    /// Outcome of a call. Services define further codes above 100.
    message Result {
        /// One of the constants below, or of the service.
        result: u8,
        /// What went wrong.
        error_message: String,
    }
    constants {
        /// The simulator does not support this.
        FEATURE_UNSUPPORTED: u8 = 0,
        /// Done.
        OK: u8 = 1,
        /// The named object does not exist.
        NOT_FOUND: u8 = 2,
        /// Not possible in the present state of the simulation.
        INCORRECT_STATE: u8 = 3,
        /// The operation failed.
        OPERATION_FAILED: u8 = 4,
    }

    /// What a simulator can do.
    message SimulatorFeatures {
        /// Supported features: some of the constants below.
        features: Vec<u16>,
        /// Formats that can be spawned, such as `urdf`.
        spawn_formats: Vec<String>,
        /// Further information about the simulator, as text.
        custom_info: String,
    }
    constants {
        /// `SpawnEntity`.
        SPAWNING: u8 = 0,
        /// `DeleteEntity`.
        DELETING: u8 = 1,
        /// Named poses.
        NAMED_POSES: u8 = 2,
        /// Bounds of named poses.
        POSE_BOUNDS: u8 = 3,
        /// Tags in filters.
        ENTITY_TAGS: u8 = 4,
        /// `GetEntityBounds`.
        ENTITY_BOUNDS: u8 = 5,
        /// Boxes as bounds in filters.
        ENTITY_BOUNDS_BOX: u8 = 6,
        /// Convex hulls as bounds in filters.
        ENTITY_BOUNDS_CONVEX: u8 = 7,
        /// Categories in filters.
        ENTITY_CATEGORIES: u8 = 8,
        /// `resource_string` of `SpawnEntity`.
        SPAWNING_RESOURCE_STRING: u8 = 9,
        /// `GetEntityState`.
        ENTITY_STATE_GETTING: u8 = 10,
        /// `SetEntityState`.
        ENTITY_STATE_SETTING: u8 = 11,
        /// `GetEntityInfo`.
        ENTITY_INFO_GETTING: u8 = 12,
        /// `SetEntityInfo`.
        ENTITY_INFO_SETTING: u8 = 13,
        /// `GetSpawnables`.
        SPAWNABLES: u8 = 14,
        /// `ResetSimulation`.
        SIMULATION_RESET: u8 = 20,
        /// Its scope of time.
        SIMULATION_RESET_TIME: u8 = 21,
        /// Its scope of state.
        SIMULATION_RESET_STATE: u8 = 22,
        /// Its scope of spawned entities.
        SIMULATION_RESET_SPAWNED: u8 = 23,
        /// `GetSimulationState`.
        SIMULATION_STATE_GETTING: u8 = 24,
        /// `SetSimulationState`.
        SIMULATION_STATE_SETTING: u8 = 25,
        /// Its state of pause.
        SIMULATION_STATE_PAUSE: u8 = 26,
        /// `StepSimulation` of one step.
        STEP_SIMULATION_SINGLE: u8 = 31,
        /// Several steps by service or action.
        STEP_SIMULATION_MULTIPLE: u8 = 32,
        /// `SimulateSteps`.
        STEP_SIMULATION_ACTION: u8 = 33,
        /// `LoadWorld`.
        WORLD_LOADING: u8 = 40,
        /// Its `resource_string`.
        WORLD_RESOURCE_STRING: u8 = 41,
        /// Tags of worlds.
        WORLD_TAGS: u8 = 42,
        /// `UnloadWorld`.
        WORLD_UNLOADING: u8 = 43,
        /// `GetCurrentWorld`.
        WORLD_INFO_GETTING: u8 = 44,
        /// `GetAvailableWorlds`.
        AVAILABLE_WORLDS: u8 = 45,
        /// `SpawnEntities`.
        SPAWNING_ENTITIES: u8 = 50,
    }

    /// Whether simulated time runs.
    message SimulationState {
        /// One of the constants.
        state: u8,
    }
    constants {
        /// Paused at the start of all.
        STATE_STOPPED: u8 = 0,
        /// Time runs.
        STATE_PLAYING: u8 = 1,
        /// Time stands still.
        STATE_PAUSED: u8 = 2,
        /// It ends.
        STATE_QUITTING: u8 = 3,
        /// It cannot be played yet.
        STATE_INITIALIZING: u8 = 4,
    }

    /// Pose, twist and acceleration of an entity.
    message EntityState {
        /// Reference frame, the world if empty; the time that they belong to.
        header: Header,
        /// Pose in that frame.
        pose: Pose,
        /// Velocities in that frame.
        twist: Twist,
        /// Accelerations in that frame.
        acceleration: Accel,
    }

    /// Kind of an entity.
    message EntityCategory {
        /// One of the constants.
        category: u8,
    }
    constants {
        /// Something.
        CATEGORY_OBJECT: u8 = 0,
        /// A robot.
        CATEGORY_ROBOT: u8 = 1,
        /// A human being.
        CATEGORY_HUMAN: u8 = 2,
        /// Something that moves, and is to be seen and tracked.
        CATEGORY_DYNAMIC_OBJECT: u8 = 4,
        /// Something that does not move.
        CATEGORY_STATIC_OBJECT: u8 = 5,
    }

    /// What an entity is.
    message EntityInfo {
        /// Kind.
        category: EntityCategory,
        /// For people.
        description: String,
        /// For filters.
        tags: Vec<String>,
    }

    /// Entities with some of these tags.
    message TagsFilter {
        /// None is no filter.
        tags: Vec<String>,
        /// One of the constants.
        filter_mode: u8,
    }
    constants {
        /// One tag is enough.
        FILTER_MODE_ANY: u8 = 0,
        /// All tags must be there.
        FILTER_MODE_ALL: u8 = 1,
    }

    /// A region.
    message Bounds {
        /// One of the constants.
        r#type: u8,
        /// Corners of a box; centre of a sphere, and its radius as the x of the second; points of a hull.
        points: Vec<Vector3>,
    }
    constants {
        /// Everywhere.
        TYPE_EMPTY: u8 = 0,
        /// Box.
        TYPE_BOX: u8 = 1,
        /// Convex hull.
        TYPE_CONVEX_HULL: u8 = 2,
        /// Sphere.
        TYPE_SPHERE: u8 = 3,
    }

    /// Which entities are asked for: those that pass all filters.
    message EntityFilters {
        /// Regular expression for names; empty is no filter.
        filter: String,
        /// One of these kinds; none is no filter.
        categories: Vec<EntityCategory>,
        /// Tags.
        tags: TagsFilter,
        /// Region that the entity overlaps with.
        bounds: Bounds,
    }

    /// A file, or what it would hold.
    message Resource {
        /// Path or URI.
        uri: String,
        /// Its content, used if `uri` is empty.
        resource_string: String,
    }

    /// Something that can be spawned.
    message Spawnable {
        /// What to give to `SpawnEntity`.
        entity_resource: Resource,
        /// For people.
        description: String,
        /// Region around it.
        spawn_bounds: Bounds,
    }

    /// One of the entities of `SpawnEntities`.
    message SpawnEntity {
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

    /// What became of one of the entities of `SpawnEntities`.
    message SpawnResult {
        /// Outcome.
        result: Result,
        /// Its name.
        entity_name: String,
    }
    constants {
        /// Another entity has the name.
        NAME_NOT_UNIQUE: u8 = 101,
        /// Not a name.
        NAME_INVALID: u8 = 102,
        /// Not a format that can be read.
        UNSUPPORTED_FORMAT: u8 = 103,
        /// No resource is given.
        NO_RESOURCE: u8 = 104,
        /// Not a namespace.
        NAMESPACE_INVALID: u8 = 105,
        /// The resource cannot be read.
        RESOURCE_PARSE_ERROR: u8 = 106,
        /// A part of the resource is missing.
        MISSING_ASSETS: u8 = 107,
        /// A part of the resource cannot be used.
        UNSUPPORTED_ASSETS: u8 = 108,
        /// Not a pose.
        INVALID_POSE: u8 = 109,
    }
}

impl Result {
    /// Done.
    pub fn ok() -> Self {
        Self::new(Self::OK, "")
    }

    /// An outcome with its reason.
    pub fn new(result: u8, error_message: impl Into<String>) -> Self {
        Self {
            result,
            error_message: error_message.into(),
        }
    }
}
