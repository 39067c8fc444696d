//! Adding free bodies to the world, and removing them.

use std::path::Path;

use nalgebra::Vector3;

use super::{check_active, entities::summary};
use crate::{
    input_file::LARGEST_URDF,
    model::Model,
    msg::simulation_interfaces::{
        Resource, Result as Outcome, SpawnEntity, SpawnResult as Code, Spawnable,
        services::{
            DeleteEntityRequest, DeleteEntityResponse, GetSpawnablesResponse, SpawnEntitiesRequest,
            SpawnEntitiesResponse, SpawnEntityRequest, SpawnEntityResponse,
        },
    },
    nodes::{
        dynamics::{
            params::{Description, InitialJoints, InitialMotion, TargetParams},
            simulation::Simulation,
            target::Target,
            world::World,
        },
        geometry::pose_from_msg,
        resource::{self, AllowedFolders},
    },
};

/// Folder of the descriptions that come with fuyu.
const DESCRIPTIONS: &str = "package://fuyu/urdf";

/// Adds one free body.
pub fn spawn_one(simulation: &mut Simulation, request: SpawnEntityRequest) -> SpawnEntityResponse {
    let request = SpawnEntity {
        name: request.name,
        allow_renaming: request.allow_renaming,
        entity_resource: request.entity_resource,
        entity_namespace: request.entity_namespace,
        initial_pose: request.initial_pose,
    };
    let Code {
        result,
        entity_name,
    } = spawn(simulation, &request);
    SpawnEntityResponse {
        result,
        entity_name,
    }
}

/// Adds several free bodies.
pub fn spawn_all(
    simulation: &mut Simulation,
    request: &SpawnEntitiesRequest,
) -> SpawnEntitiesResponse {
    let requests = request.spawn_requests.iter();
    let results: Vec<Code> = requests.map(|r| spawn(simulation, r)).collect();
    let failed = results.iter().filter(|r| r.result.result != Outcome::OK);
    let result = match failed.count() {
        0 => Outcome::ok(),
        n => Outcome::new(
            SpawnEntitiesResponse::ENTITIES_SPAWN_FAILED,
            format!("{n} of {} entities could not be added", results.len()),
        ),
    };
    SpawnEntitiesResponse { result, results }
}

fn spawn(simulation: &mut Simulation, request: &SpawnEntity) -> Code {
    match add(simulation, request) {
        Ok(entity_name) => Code {
            result: Outcome::ok(),
            entity_name,
        },
        Err(result) => Code {
            result,
            ..Code::default()
        },
    }
}

fn add(simulation: &mut Simulation, request: &SpawnEntity) -> Result<String, Outcome> {
    check_active(simulation)?;
    let (world, params) = (&mut simulation.world, simulation.params);
    let description = read(&request.entity_resource, &params.resource_folders)?;
    let parsed = |e: String| Outcome::new(Code::RESOURCE_PARSE_ERROR, e);
    let model = description.compile().map_err(parsed)?;
    let name = free_name(world, request, &model)?;
    let pose = &request.initial_pose;
    let X_WR = world.frame(&pose.header.frame_id)?;
    let invalid = |e: String| Outcome::new(Code::INVALID_POSE, format!("initial_pose: {e}"));
    let motion = InitialMotion {
        pose: X_WR * pose_from_msg(&pose.pose).map_err(invalid)?,
        velocity_W: Vector3::zeros(),
        angular_velocity_B: Vector3::zeros(),
    };
    let target = TargetParams {
        name: name.clone(),
        description,
        motion,
        joints: InitialJoints::default(),
    };
    let mut target = Target::new(&target, params.method, &params.joint_physics).map_err(invalid)?;
    target.spawned = true;
    world.targets.push(target);
    if let Err(e) = simulation.outputs.replace_targets(simulation.node, world) {
        world.targets.pop();
        return Err(Outcome::new(Outcome::OPERATION_FAILED, e.to_string()));
    }
    simulation.outputs.invalidate();
    Ok(name)
}

/// The name that an entity gets, with its namespace.
fn free_name(world: &World, request: &SpawnEntity, model: &Model) -> Result<String, Outcome> {
    let namespace = request.entity_namespace.trim_matches('/');
    if !namespace.is_empty() && !namespace.split('/').all(is_name) {
        return Err(Outcome::new(
            Code::NAMESPACE_INVALID,
            format!(
                "entity_namespace '{}' must be names of letters, digits and underscores, with slashes between",
                request.entity_namespace
            ),
        ));
    }
    let full = |name: &str| match namespace {
        "" => name.to_owned(),
        namespace => format!("{namespace}/{name}"),
    };
    let wanted = match request.name.as_str() {
        "" => model.name(),
        name => name,
    };
    if !is_name(wanted) {
        if !request.allow_renaming {
            return Err(Outcome::new(
                Code::NAME_INVALID,
                format!(
                    "name '{wanted}' must be letters, digits and underscores, and not begin with a digit; it is part of a topic's"
                ),
            ));
        }
        return Ok(numbered(world, &full("entity")));
    }
    let name = full(wanted);
    match (is_taken(world, &name), request.allow_renaming) {
        (false, _) => Ok(name),
        (true, true) => Ok(numbered(world, &name)),
        (true, false) => Err(Outcome::new(
            Code::NAME_NOT_UNIQUE,
            format!("name '{name}' is taken; give another one, or allow_renaming"),
        )),
    }
}

/// Whether a frame has this name: the world, an entity, or a link of the robot. Entities and their frames share names.
fn is_taken(world: &World, name: &str) -> bool {
    world.frame(name).is_ok()
}

/// `name` with the first free number.
fn numbered(world: &World, name: &str) -> String {
    let mut numbered = (1_u32..).map(|i| format!("{name}_{i}"));
    let free = numbered.find(|name| !is_taken(world, name));
    free.unwrap_or_else(|| name.to_owned())
}

/// Removes a free body.
pub fn delete(simulation: &mut Simulation, request: &DeleteEntityRequest) -> DeleteEntityResponse {
    let result = remove(simulation, &request.entity);
    DeleteEntityResponse {
        result: result.err().unwrap_or_else(Outcome::ok),
    }
}

fn remove(simulation: &mut Simulation, entity: &str) -> Result<(), Outcome> {
    check_active(simulation)?;
    let world = &mut simulation.world;
    if world.robot.model().name() == entity {
        return Err(Outcome::new(
            Outcome::OPERATION_FAILED,
            format!("'{entity}' is the robot that is simulated; it cannot be deleted"),
        ));
    }
    let index = world.target_index(entity);
    let index = index.map_err(|_| world.unknown(entity))?;
    world.targets.remove(index);
    simulation.outputs.remove_targets(world);
    simulation.outputs.invalidate();
    Ok(())
}

fn is_name(text: &str) -> bool {
    let mut letters = text.chars();
    letters
        .next()
        .is_some_and(|c| c.is_ascii_alphabetic() || c == '_')
        && letters.all(|c| c.is_ascii_alphanumeric() || c == '_')
}

/// The text of a resource that a peer may name, if it is URDF.
fn read(resource: &Resource, allowed: &AllowedFolders) -> Result<Description, Outcome> {
    let unreadable = |e: String| Outcome::new(Code::RESOURCE_PARSE_ERROR, e);
    let (xml, source) = match (resource.uri.as_str(), resource.resource_string.as_str()) {
        ("", "") => {
            return Err(Outcome::new(
                Code::NO_RESOURCE,
                "entity_resource is empty; give a uri or a resource_string with URDF",
            ));
        }
        ("", text) => (text.to_owned(), "resource_string".to_owned()),
        (uri, _) => {
            let file = allowed.resolve(uri).map_err(unreadable)?;
            let text = file.text(LARGEST_URDF).map_err(unreadable)?;
            (text, file.path().display().to_string())
        }
    };
    let other = ["sdf", "mujoco", "mujocoinclude"]
        .into_iter()
        .find(|root| xml.contains(&format!("<{root}")));
    let binary = ["usd", "usda", "usdc", "usdz"]
        .into_iter()
        .find(|suffix| Path::new(&source).extension().is_some_and(|e| e == *suffix));
    match other.or(binary) {
        Some(format) => Err(Outcome::new(
            Code::UNSUPPORTED_FORMAT,
            format!("{source}: '{format}' cannot be read, only urdf"),
        )),
        None => Ok(Description::new(xml, source, false)),
    }
}

/// Descriptions of fuyu and in `sources`: files and folders that peers may name.
pub fn spawnables(sources: &[String], allowed: &AllowedFolders) -> GetSpawnablesResponse {
    let ours = AllowedFolders::new(vec![DESCRIPTIONS.to_owned()]);
    let named = sources.iter().map(|source| (source.as_str(), allowed));
    let mut found = Vec::new();
    let mut missing = Vec::new();
    for (source, allowed) in std::iter::once((DESCRIPTIONS, &ours)).chain(named) {
        match files(source, allowed) {
            Ok(files) => {
                found.extend(files.into_iter().filter_map(|uri| spawnable(uri, allowed)));
            }
            Err(e) => missing.push(e),
        }
    }
    GetSpawnablesResponse {
        result: Outcome::new(Outcome::OK, missing.join("; ")),
        spawnables: found,
    }
}

/// URDF files that `source` names, by the names to spawn them with.
fn files(source: &str, allowed: &AllowedFolders) -> Result<Vec<String>, String> {
    // The embedded folder of descriptions is not a file to resolve.
    if source != DESCRIPTIONS {
        allowed.resolve(source)?;
    }
    let mut names = resource::list(source.strip_prefix("file://").unwrap_or(source))?;
    names.retain(|name| Path::new(name).extension().is_some_and(|e| e == "urdf"));
    Ok(names)
}

fn spawnable(uri: String, allowed: &AllowedFolders) -> Option<Spawnable> {
    let resource = Resource {
        uri,
        ..Resource::default()
    };
    let model = read(&resource, allowed).ok()?.compile().ok()?;
    Some(Spawnable {
        description: format!("{}: {}", model.name(), summary(&model)),
        entity_resource: resource,
        ..Spawnable::default()
    })
}
