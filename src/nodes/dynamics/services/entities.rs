//! The robot and the free bodies as entities: names, descriptions and states.

use nalgebra::{Isometry3, UnitQuaternion};

use super::entity_filters::Filters;
use crate::{
    model::Model,
    msg::{
        geometry_msgs::{Accel, Twist as TwistMsg},
        simulation_interfaces::{
            EntityCategory, EntityFilters, EntityInfo, EntityState, Result as Outcome,
            services::{
                GetEntitiesRequest, GetEntitiesResponse, GetEntitiesStatesRequest,
                GetEntitiesStatesResponse, GetEntityInfoRequest, GetEntityInfoResponse,
                GetEntityStateRequest, GetEntityStateResponse,
            },
        },
    },
    nodes::{
        dynamics::{
            free_body::FreeBody,
            messages::{WORLD, header},
            world::World,
        },
        geometry::{pose_to_msg, vector_to_msg},
    },
    ros::Time,
    spatial::Pose,
};

impl World {
    /// Names of all entities, the robot's first.
    pub(super) fn entities(&self) -> impl Iterator<Item = &str> {
        let targets = self.targets.iter().map(|t| t.name.as_str());
        std::iter::once(self.robot.model().name()).chain(targets)
    }

    /// The body of the entity called `entity`.
    pub(super) fn body(&mut self, entity: &str) -> Result<&mut dyn FreeBody, Outcome> {
        if self.robot.model().name() == entity {
            return Ok(&mut self.robot);
        }
        match self.target_index(entity) {
            Ok(index) => Ok(&mut self.targets[index].body),
            Err(_) => Err(self.unknown(entity)),
        }
    }

    /// Error for a name that no entity has.
    pub(super) fn unknown(&self, entity: &str) -> Outcome {
        let known: Vec<_> = self.entities().collect();
        Outcome::new(
            Outcome::NOT_FOUND,
            format!(
                "no entity is called '{entity}'; there is {}",
                known.join(", ")
            ),
        )
    }

    fn info(&self, entity: &str) -> Result<EntityInfo, Outcome> {
        let model = self.robot.model();
        if model.name() == entity {
            return Ok(EntityInfo {
                category: EntityCategory {
                    category: EntityCategory::CATEGORY_ROBOT,
                },
                description: format!(
                    "free-floating robot: {} bodies, {} joints, {} kg",
                    model.bodies().len(),
                    model.dof(),
                    self.robot.total_mass()
                ),
                tags: vec!["robot".to_owned()],
            });
        }
        let index = self.target_index(entity);
        let target = index.map(|i| &self.targets[i]);
        let target = target.map_err(|_| self.unknown(entity))?;
        let mut tags = vec!["target".to_owned()];
        if target.spawned {
            tags.push("spawned".to_owned());
        }
        Ok(EntityInfo {
            category: EntityCategory {
                category: EntityCategory::CATEGORY_DYNAMIC_OBJECT,
            },
            description: summary(target.body.model()),
            tags,
        })
    }

    /// Pose in the world of the frame called `frame`: the world, an entity, or a link of the robot or of a target.
    ///
    /// # Errors
    /// If there is no such frame.
    pub(super) fn frame(&self, frame: &str) -> Result<Isometry3<f64>, Outcome> {
        let of = |body: &dyn FreeBody| isometry(&body.X_WB());
        if frame.is_empty() || frame == WORLD {
            return Ok(Isometry3::identity());
        }
        if frame == self.robot.model().name() {
            return Ok(of(&self.robot));
        }
        if let Ok(index) = self.target_index(frame) {
            return Ok(of(&self.targets[index].body));
        }
        let links = self.targets.iter().map(|t| (t, t.frames.find(frame)));
        if let Some((target, link)) = links.filter_map(|(t, link)| Some((t, link?))).next() {
            let X_BF = isometry(&target.body.workspace().X_BF(link));
            return Ok(of(&target.body) * X_BF);
        }
        let link = self.robot.model().frame(frame).ok_or_else(|| {
            Outcome::new(
                Outcome::NOT_FOUND,
                format!(
                    "frame_id is '{frame}'; give world, the name of an entity, a link of the robot or TARGET/LINK"
                ),
            )
        })?;
        let X_BF = isometry(&self.robot.X_BF(link));
        Ok(of(&self.robot) * X_BF)
    }

    fn entity_state(&mut self, entity: &str) -> Result<EntityState, Outcome> {
        let stamp = Time::from_secs_f64(self.time());
        let body = self.body(entity)?;
        let (X_WB, V_B, A_B) = (body.X_WB(), body.V_WB_B(), body.A_WB_B());
        let in_world = |v: &nalgebra::Vector3<f64>| vector_to_msg(&(X_WB.rotation * v));
        Ok(EntityState {
            header: header(stamp, WORLD),
            pose: pose_to_msg(&X_WB),
            twist: TwistMsg {
                linear: in_world(&V_B.linear),
                angular: in_world(&V_B.angular),
            },
            acceleration: Accel {
                linear: in_world(&A_B.linear),
                angular: in_world(&A_B.angular),
            },
        })
    }
}

/// Short description of a free body: mass, and, if it has joints, the numbers of bodies and joints.
pub(super) fn summary(model: &Model) -> String {
    let mass = model.total_mass();
    match model.dof() {
        0 => format!("free body, {mass} kg"),
        joints => format!(
            "free body, {mass} kg, {} bodies, {joints} joints",
            model.bodies().len()
        ),
    }
}

/// The same pose, with its rotation as a quaternion.
pub(super) fn isometry(X: &Pose) -> Isometry3<f64> {
    Isometry3::from_parts(
        X.translation,
        UnitQuaternion::from_rotation_matrix(&X.rotation),
    )
}

/// Names of the entities that pass the filters.
fn filtered(world: &World, filters: &EntityFilters) -> Result<Vec<String>, Outcome> {
    let filters = Filters::new(filters)?;
    let mut names = Vec::new();
    for name in world.entities() {
        let origin = world.frame(name)?.translation.vector;
        if filters.pass(name, &world.info(name)?, &origin) {
            names.push(name.to_owned());
        }
    }
    Ok(names)
}

/// Names of the entities that pass the filters of a request.
pub fn names(world: &World, request: &GetEntitiesRequest) -> GetEntitiesResponse {
    match filtered(world, &request.filters) {
        Ok(entities) => GetEntitiesResponse {
            result: Outcome::ok(),
            entities,
        },
        Err(result) => GetEntitiesResponse {
            result,
            ..Default::default()
        },
    }
}

/// Names and states of the entities that pass the filters of a request.
pub fn states(world: &mut World, request: &GetEntitiesStatesRequest) -> GetEntitiesStatesResponse {
    let found = filtered(world, &request.filters).and_then(|names| {
        let states = names.iter().map(|name| world.entity_state(name));
        let states = states.collect::<Result<_, _>>()?;
        Ok((names, states))
    });
    match found {
        Ok((entities, states)) => GetEntitiesStatesResponse {
            result: Outcome::ok(),
            entities,
            states,
        },
        Err(result) => GetEntitiesStatesResponse {
            result,
            ..Default::default()
        },
    }
}

/// Category, description and tags of an entity.
pub fn info(world: &World, request: &GetEntityInfoRequest) -> GetEntityInfoResponse {
    match world.info(&request.entity) {
        Ok(info) => GetEntityInfoResponse {
            result: Outcome::ok(),
            info,
        },
        Err(result) => GetEntityInfoResponse {
            result,
            ..Default::default()
        },
    }
}

/// Pose, twist and acceleration of an entity.
pub fn state(world: &mut World, request: &GetEntityStateRequest) -> GetEntityStateResponse {
    match world.entity_state(&request.entity) {
        Ok(state) => GetEntityStateResponse {
            result: Outcome::ok(),
            state,
        },
        Err(result) => GetEntityStateResponse {
            result,
            ..Default::default()
        },
    }
}
