//! The robot and the free bodies as entities: what they are, where they are, and putting them elsewhere.

use nalgebra::{Isometry3, UnitQuaternion};

use super::entity_filters::Filters;
use crate::{
    dynamics::{Floating, Workspace},
    msg::{
        geometry_msgs::{Accel, Twist as TwistMsg},
        simulation_interfaces::{
            EntityCategory, EntityInfo, EntityState, Result as Outcome,
            services::{
                GetEntitiesRequest, GetEntitiesResponse, GetEntitiesStatesRequest,
                GetEntitiesStatesResponse, GetEntityInfoRequest, GetEntityInfoResponse,
                GetEntityStateRequest, GetEntityStateResponse, SetEntityStateRequest,
                SetEntityStateResponse as Set,
            },
        },
    },
    nodes::{
        dynamics::{
            messages::{WORLD, header},
            simulation::Simulation,
            world::World,
        },
        geometry::{pose_from_msg, pose_to_msg, vector_from_msg, vector_to_msg},
    },
    ros::Time,
    spatial::Twist,
};

impl World {
    /// Names of all entities, the robot's first.
    pub(super) fn entities(&self) -> impl Iterator<Item = &str> {
        let targets = self.targets.iter().map(|t| t.name.as_str());
        std::iter::once(self.robot.model().name()).chain(targets)
    }

    fn body(&mut self, entity: &str) -> Result<&mut Floating, Outcome> {
        if self.robot.model().name() == entity {
            return Ok(&mut self.robot);
        }
        match self.target_index(entity) {
            Ok(index) => Ok(&mut self.targets[index].body),
            Err(_) => Err(self.unknown(entity)),
        }
    }

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
                    model.total_mass()
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
            description: format!("free body: {} kg", target.body.model().total_mass()),
            tags,
        })
    }

    /// Where the frame called `frame` is: the world, an entity or a link of the robot.
    ///
    /// # Errors
    /// If there is none.
    pub(super) fn frame(&self, frame: &str) -> Result<Isometry3<f64>, Outcome> {
        let of = |body: &Floating| isometry(&body.state().X_WB(body.workspace()));
        if frame.is_empty() || frame == WORLD {
            return Ok(Isometry3::identity());
        }
        if frame == self.robot.model().name() {
            return Ok(of(&self.robot));
        }
        if let Ok(index) = self.target_index(frame) {
            return Ok(of(&self.targets[index].body));
        }
        let link = self.robot.model().frame(frame).ok_or_else(|| {
            Outcome::new(
                Outcome::NOT_FOUND,
                format!(
                    "frame_id is '{frame}'; give world, the name of an entity or a link of the robot"
                ),
            )
        })?;
        let X_BF = isometry(&self.robot.workspace().X_BF(link));
        Ok(of(&self.robot) * X_BF)
    }

    fn entity_state(&mut self, entity: &str) -> Result<EntityState, Outcome> {
        let stamp = Time::from_secs_f64(self.time());
        let body = self.body(entity)?;
        body.accelerations();
        let (model, workspace) = (body.model(), body.workspace());
        let X_WB = body.state().X_WB(workspace);
        let (V_B, A_B) = (workspace.V_WB_B(), workspace.A_WF_B(&model.frames()[0]));
        let turned = |v: &nalgebra::Vector3<f64>| vector_to_msg(&(X_WB.rotation * v));
        Ok(EntityState {
            header: header(stamp, WORLD),
            pose: pose_to_msg(&X_WB),
            twist: TwistMsg {
                linear: turned(&V_B.linear),
                angular: turned(&V_B.angular),
            },
            acceleration: Accel {
                linear: turned(&A_B.linear),
                angular: turned(&A_B.angular),
            },
        })
    }
}

fn isometry(X: &crate::spatial::Pose) -> Isometry3<f64> {
    Isometry3::from_parts(
        X.translation,
        UnitQuaternion::from_rotation_matrix(&X.rotation),
    )
}

impl Simulation<'_> {
    fn filtered(
        &self,
        filters: &crate::msg::simulation_interfaces::EntityFilters,
    ) -> Result<Vec<String>, Outcome> {
        let filters = Filters::new(filters)?;
        let mut names = Vec::new();
        for name in self.world.entities() {
            let origin = self.world.frame(name)?.translation.vector;
            if filters.pass(name, &self.world.info(name)?, &origin) {
                names.push(name.to_owned());
            }
        }
        Ok(names)
    }

    pub(super) fn get_entities(&self, request: &GetEntitiesRequest) -> GetEntitiesResponse {
        match self.filtered(&request.filters) {
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

    pub(super) fn get_entities_states(
        &mut self,
        request: &GetEntitiesStatesRequest,
    ) -> GetEntitiesStatesResponse {
        let found = self.filtered(&request.filters).and_then(|names| {
            let states = names.iter().map(|name| self.world.entity_state(name));
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

    pub(super) fn get_entity_info(&self, request: &GetEntityInfoRequest) -> GetEntityInfoResponse {
        match self.world.info(&request.entity) {
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

    pub(super) fn get_entity_state(
        &mut self,
        request: &GetEntityStateRequest,
    ) -> GetEntityStateResponse {
        match self.world.entity_state(&request.entity) {
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

    pub(super) fn set_entity_state(&mut self, request: &SetEntityStateRequest) -> Set {
        let result = self.put(request).err().unwrap_or_else(|| {
            let mut done = Outcome::ok();
            if request.set_acceleration {
                done.error_message =
                    "the acceleration is ignored: it follows from what acts".to_owned();
            }
            done
        });
        Set { result }
    }

    fn put(&mut self, request: &SetEntityStateRequest) -> Result<(), Outcome> {
        self.check_active()?;
        let frame = request.state.header.frame_id.as_str();
        let X_WR = self.world.frame(frame)?;
        let invalid = |e: String| Outcome::new(Set::INVALID_POSE, e);
        let X_RB = match request.set_pose {
            true => Some(pose_from_msg(&request.state.pose).map_err(invalid)?),
            false => None,
        };
        let twist = &request.state.twist;
        let (v, w) = (
            vector_from_msg(&twist.linear),
            vector_from_msg(&twist.angular),
        );
        if request.set_twist {
            if !frame.is_empty() && frame != WORLD {
                return Err(Outcome::new(
                    Outcome::FEATURE_UNSUPPORTED,
                    format!("a twist in frame '{frame}' is not supported; give it in {WORLD}"),
                ));
            }
            if !v.iter().chain(w.iter()).all(|x| x.is_finite()) {
                return Err(Outcome::new(
                    Outcome::OPERATION_FAILED,
                    "twist has a number that is not finite",
                ));
            }
        }
        let body = self.world.body(&request.entity)?;
        let X_WB = match X_RB {
            Some(X_RB) => X_WR * X_RB,
            None => isometry(&body.state().X_WB(body.workspace())),
        };
        let now_B = body.workspace().V_WB_B();
        // A pose alone changes nothing about how the body moves in the world.
        let R_WB_before = body.state().R_WB;
        let (w_W, v_W) = match request.set_twist {
            true => (w, v),
            false => (R_WB_before * now_B.angular, R_WB_before * now_B.linear),
        };
        let R_BW = X_WB.rotation.inverse();
        let V_WB_B = Twist::new(R_BW * w_W, R_BW * v_W);
        let mut state = body.state().clone();
        state.set_base(
            body.model(),
            &mut Workspace::new(body.model()),
            &X_WB,
            &V_WB_B,
        );
        if !state.is_finite() {
            return Err(Outcome::new(
                Outcome::OPERATION_FAILED,
                "the twist is too fast for its momentum to be a number",
            ));
        }
        body.set_state(state);
        self.changed = true;
        Ok(())
    }
}
