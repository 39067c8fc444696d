//! Services that add free bodies to the world and remove them.

use std::{collections::BTreeSet, path::Path};

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
            FrameTree,
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

/// Maximum number of movable joints of a body that a caller adds: memory and time per step grow with its square.
const MAX_JOINTS: usize = 200;

/// Maximum number of free bodies in the world, above which callers cannot add more.
const MAX_ENTITIES: usize = 1000;

/// Maximum number of files and folders in a request for spawnables.
const MAX_SOURCES: usize = 64;

/// Maximum number of links of a body that a caller adds.
const MAX_LINKS: usize = 2000;

/// Longest description that a caller may send \[bytes\].
const LARGEST_TEXT: usize = 4 << 20;

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
    if simulation.world.targets.len() >= MAX_ENTITIES {
        let message = format!("there are {MAX_ENTITIES} entities already; delete one first");
        return Err(Outcome::new(Outcome::OPERATION_FAILED, message));
    }
    let (world, params) = (&mut simulation.world, simulation.params);
    let description = read(&request.entity_resource, &params.resource_folders)?;
    let parsed = |e: String| Outcome::new(Code::RESOURCE_PARSE_ERROR, e);
    let model = description.compile().map_err(parsed)?;
    check_size(&description.source, &model)?;
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
    let target = Target::of_model(&target, model, params.method, &params.joint_physics);
    let mut target = target.map_err(invalid)?;
    target.spawned = true;
    world.targets.push(target);
    if let Err(e) = world.check_shapes() {
        world.targets.pop();
        let message = format!("entity_resource: contact cannot be simulated: {e}");
        return Err(Outcome::new(Code::RESOURCE_PARSE_ERROR, message));
    }
    if let Err(e) = simulation.outputs.replace_targets(simulation.node, world) {
        world.targets.pop();
        return Err(Outcome::new(Outcome::OPERATION_FAILED, e.to_string()));
    }
    simulation.outputs.invalidate();
    Ok(name)
}

/// Refuses a body that would need too much memory or time.
fn check_size(source: &str, model: &Model) -> Result<(), Outcome> {
    let (joints, links) = (model.dof(), model.frames().len());
    match joints <= MAX_JOINTS && links <= MAX_LINKS {
        true => Ok(()),
        false => Err(Outcome::new(
            Code::UNSUPPORTED_ASSETS,
            format!(
                "{source} has {joints} joints that move and {links} links; a body that is added may have at most {MAX_JOINTS} \
                 and {MAX_LINKS}"
            ),
        )),
    }
}

/// The name for a new entity, with its namespace.
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
        return Ok(numbered(world, &full("entity"), model));
    }
    let name = full(wanted);
    match (taken_frame(world, &name, model), request.allow_renaming) {
        (None, _) => Ok(name),
        (Some(_), true) => Ok(numbered(world, &name, model)),
        (Some(frame), false) => {
            let what = match frame == name {
                true => format!("name '{name}' is taken"),
                false => format!("a link of '{name}' would be called '{frame}', which is taken"),
            };
            Err(Outcome::new(
                Code::NAME_NOT_UNIQUE,
                format!("{what}; give another name, or allow_renaming"),
            ))
        }
    }
}

/// For a new entity called `name`: the first of its frame names that is taken already, by the world, an entity or a
/// link.
fn taken_frame(world: &World, name: &str, model: &Model) -> Option<String> {
    let links = model.frames().iter();
    let mut frames = links.map(|link| FrameTree::name_in_target(name, model, &link.name));
    frames.find(|frame| world.frame(frame).is_ok())
}

/// `name` with the smallest number for which none of the entity's frame names is taken.
fn numbered(world: &World, name: &str, model: &Model) -> String {
    let mut numbered = (1_u32..).map(|i| format!("{name}_{i}"));
    let free = numbered.find(|name| taken_frame(world, name, model).is_none());
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
    if world.held_target() == Some(entity) {
        return Err(Outcome::new(
            Outcome::OPERATION_FAILED,
            format!("the robot holds '{entity}'; detach it first"),
        ));
    }
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

/// The description in a resource that the caller may name, if it is URDF.
fn read(resource: &Resource, allowed: &AllowedFolders) -> Result<Description, Outcome> {
    let unreadable = |e: String| Outcome::new(Code::RESOURCE_PARSE_ERROR, e);
    let (xml, source) = match (resource.uri.as_str(), resource.resource_string.as_str()) {
        ("", "") => {
            return Err(Outcome::new(
                Code::NO_RESOURCE,
                "entity_resource is empty; give a uri or a resource_string with URDF",
            ));
        }
        ("", text) if text.len() > LARGEST_TEXT => {
            return Err(Outcome::new(
                Code::UNSUPPORTED_ASSETS,
                format!(
                    "resource_string has {} bytes; give at most {LARGEST_TEXT}",
                    text.len()
                ),
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

/// Descriptions that can be spawned: those that come with fuyu, and those in `sources` (files and folders).
pub fn spawnables(sources: &[String], allowed: &AllowedFolders) -> GetSpawnablesResponse {
    let sources: BTreeSet<&str> = sources.iter().map(String::as_str).collect();
    if sources.len() > MAX_SOURCES {
        let message = format!(
            "sources: has {} files and folders; at most {MAX_SOURCES} can be searched at a time",
            sources.len()
        );
        return GetSpawnablesResponse {
            result: Outcome::new(Outcome::OPERATION_FAILED, message),
            spawnables: Vec::new(),
        };
    }
    let ours = AllowedFolders::new(vec![DESCRIPTIONS.to_owned()]);
    let named = sources.into_iter().map(|source| (source, allowed));
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

/// The URDF files in `source`, by the names under which they can be spawned.
fn files(source: &str, allowed: &AllowedFolders) -> Result<Vec<String>, String> {
    // The folder of embedded descriptions is not in the file system.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nodes::scenario::Scenario;

    const INERTIAL: &str = r#"<inertial><mass value="1"/>
        <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>"#;

    /// A chain of `joints` joints called `name`, with links l0, l1 and so on.
    fn chain(name: &str, joints: usize) -> String {
        let links = (0..=joints).map(|i| format!(r#"<link name="l{i}">{INERTIAL}</link>"#));
        let joints = (1..=joints).map(|i| {
            format!(
                r#"<joint name="j{i}" type="continuous"><parent link="l{}"/><child link="l{i}"/><axis xyz="0 0 1"/></joint>"#,
                i - 1
            )
        });
        let parts: String = links.chain(joints).collect();
        format!(r#"<robot name="{name}">{parts}</robot>"#)
    }

    fn world() -> World {
        let scenario = Scenario::read("package://fuyu/config/positioning.yaml").unwrap();
        World::new(&scenario.dynamics().unwrap()).unwrap()
    }

    /// Adds a chain with one joint as the services do, without publishing. Returns its name, or the refusal.
    fn add(
        world: &mut World,
        namespace: &str,
        name: &str,
        rename: bool,
    ) -> Result<String, Outcome> {
        let description = Description::new(chain(name, 1), "chain".to_owned(), true);
        let model = description.compile().unwrap();
        let request = SpawnEntity {
            name: name.to_owned(),
            entity_namespace: namespace.to_owned(),
            allow_renaming: rename,
            ..SpawnEntity::default()
        };
        let name = free_name(world, &request, &model)?;
        let target = TargetParams {
            name: name.clone(),
            description,
            motion: InitialMotion {
                pose: nalgebra::Isometry3::identity(),
                velocity_W: Vector3::zeros(),
                angular_velocity_B: Vector3::zeros(),
            },
            joints: InitialJoints::default(),
        };
        let method = crate::dynamics::IntegrationMethod::Rk4;
        let physics = crate::dynamics::JointPhysics::default();
        let target = Target::of_model(&target, model, method, &physics).unwrap();
        world.targets.push(target);
        Ok(name)
    }

    // Would break if only the name of the root were compared: tf would have two frames called sail/l1.
    #[test]
    fn no_two_frames_get_one_name() {
        let refused = |added: Result<String, Outcome>| {
            let refusal = added.unwrap_err();
            assert_eq!(refusal.result, Code::NAME_NOT_UNIQUE);
            refusal.error_message
        };
        let mut first = world();
        add(&mut first, "sail", "l1", false).unwrap();
        let said = refused(add(&mut first, "", "sail", false));
        assert!(said.contains("'sail/l1', which is taken"), "{said}");
        assert_eq!(add(&mut first, "", "sail", true).unwrap(), "sail_1");

        let mut second = world();
        add(&mut second, "", "sail", false).unwrap();
        let said = refused(add(&mut second, "sail", "l1", false));
        assert!(said.contains("name 'sail/l1' is taken"), "{said}");
        assert_eq!(add(&mut second, "", "sail", true).unwrap(), "sail_1");
    }

    // Would break if a peer could fill the memory with one request: matrices of n joints have n x n numbers.
    #[test]
    fn a_body_with_very_many_joints_is_refused() {
        let of = |joints| {
            let text = chain("chain", joints);
            let model = Description::new(text, "chain".to_owned(), true)
                .compile()
                .unwrap();
            check_size("chain", &model)
        };
        assert!(of(MAX_JOINTS).is_ok());
        let refusal = of(MAX_JOINTS + 1).unwrap_err();
        assert_eq!(refusal.result, Code::UNSUPPORTED_ASSETS);
        let said = refusal.error_message;
        assert!(
            said.contains("201 joints") && said.contains("at most 200"),
            "{said}"
        );
        let long = Resource {
            resource_string: " ".repeat(LARGEST_TEXT + 1),
            ..Resource::default()
        };
        let refusal = read(&long, &AllowedFolders::new(Vec::new())).err().unwrap();
        assert_eq!(refusal.result, Code::UNSUPPORTED_ASSETS);
    }
}
