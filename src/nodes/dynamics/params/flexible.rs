//! Flexible parts, wheels and thrusters of the robot, and the flexible system that results.

use std::collections::BTreeSet;

use super::{
    appendages::AppendageParams,
    elastic_joints::declare_elastic_joints,
    elastic_links::{ElasticLinkParams, declare_elastic_links},
    package_folders::PackageFolders,
    thrusters::ThrusterParams,
    wheels::WheelParams,
};
use crate::{
    dynamics::{
        State,
        flexible::{ElasticJoint, FlexibleError, FlexibleState, FlexibleSystem},
    },
    model::{Frame, Model},
    nodes::resource::Lookup,
    ros::Declare,
};

/// Flexible parts, wheels and thrusters of the robot.
#[derive(Debug, Clone, Default)]
pub struct FlexibleParams {
    /// Deformable bodies.
    pub appendages: Vec<AppendageParams>,
    /// Elastic links.
    pub links: Vec<ElasticLinkParams>,
    /// Elastic joints.
    pub joints: Vec<ElasticJoint>,
    /// Reaction wheels.
    pub wheels: Vec<WheelParams>,
    /// Thrusters.
    pub thrusters: Vec<ThrusterParams>,
}

impl FlexibleParams {
    /// Declares and reads `appendages`, `links`, `joints`, `wheels`, `thrusters` and the parameters of each. `lookup`
    /// finds files relative to the file of a parameter.
    ///
    /// # Errors
    /// A line that names a parameter, its value, and the allowed values.
    pub fn declare(
        declare: &mut Declare,
        lookup: &dyn Fn(&Declare, &str) -> Lookup,
    ) -> Result<Self, String> {
        let mut list = |name: &str, what: &str| {
            (declare.param(
                name,
                Vec::<String>::new(),
                &format!("Names of the robot's {what}"),
            ))
            .read_only()
            .value()
        };
        let lists = [
            ("appendages", list("appendages", "deformable appendages")),
            ("wheels", list("wheels", "reaction wheels")),
            ("thrusters", list("thrusters", "thrusters")),
        ];
        let mut known = BTreeSet::new();
        let mut twice = None;
        let [appendages, wheels, thrusters] = lists.map(|(list, names)| {
            let mut once = Vec::new();
            for name in names {
                if known.insert(name.clone()) {
                    once.push(name);
                } else {
                    twice = twice.take().or(Some((list, name)));
                }
            }
            once
        });
        // All are declared before the first error is returned, so that no parameter is reported as unknown.
        let appendages: Vec<_> = (appendages.iter())
            .map(|name| AppendageParams::declare(declare, name, lookup))
            .collect();
        let wheels: Vec<_> = (wheels.iter())
            .map(|name| WheelParams::declare(declare, name))
            .collect();
        let thrusters: Vec<_> = (thrusters.iter())
            .map(|name| ThrusterParams::declare(declare, name))
            .collect();
        let joints = declare_elastic_joints(declare);
        let links = declare_elastic_links(declare);
        if let Some((list, name)) = twice {
            return Err(format!(
                "parameter {list}: '{name}' is given twice; appendages, wheels and thrusters need different names"
            ));
        }
        Ok(Self {
            appendages: appendages.into_iter().collect::<Result<_, _>>()?,
            links: links?,
            joints,
            wheels,
            thrusters,
        })
    }

    /// [`FlexibleParams::declare`] with the parameter `package_folders`, for nodes that need no other files.
    ///
    /// # Errors
    /// A line that names a parameter, its value, and the allowed values.
    pub fn declare_with_packages(declare: &mut Declare) -> Result<Self, String> {
        let packages = PackageFolders::declare(declare);
        Self::declare(declare, &|declare, name| packages.lookup(declare, name))
    }

    /// Whether there are none of these parts: then the robot is rigid.
    pub fn is_empty(&self) -> bool {
        let Self {
            appendages,
            links,
            joints,
            wheels,
            thrusters,
        } = self;
        let has_deformable = !appendages.is_empty() || !links.is_empty() || !joints.is_empty();
        !has_deformable && wheels.is_empty() && thrusters.is_empty()
    }

    /// The flexible system of `model` with these parts.
    ///
    /// # Errors
    /// A line that names the parameter or part, and the allowed values.
    pub fn system(&self, model: &Model) -> Result<FlexibleSystem, String> {
        let mut builder = FlexibleSystem::builder(model);
        for params in &self.appendages {
            if model.frame(&params.body.name).is_some() {
                return Err(format!(
                    "parameter appendages: '{}' is the name of a link; an appendage needs another one, which names its frame",
                    params.body.name
                ));
            }
            let link = link(model, &params.body.name, &params.link)?;
            builder = builder.appendage(link, params.X_FA, params.body.clone());
        }
        for link in &self.links {
            builder = builder.elastic_link(&link.body.name, link.X_LA, link.body.clone(), 0);
        }
        for joint in &self.joints {
            builder = builder.elastic_joint(joint.clone());
        }
        for params in &self.wheels {
            let link = link(model, &params.wheel.name, &params.link)?;
            builder = builder.wheel(link, params.wheel.clone());
        }
        for params in &self.thrusters {
            let link = link(model, &params.thruster.name, &params.link)?;
            builder = builder.thruster(link, params.thruster.clone());
        }
        builder.build().map_err(|e| match e {
            FlexibleError::Part { part, problem } if part == model.name() => {
                format!("the robot {part} {problem}")
            }
            e => e.to_string(),
        })
    }

    /// The initial state of `system`: joints as in `joints`, deformation and wheel speeds from these parameters, base
    /// from the description. Elastic joints are unloaded, and their motors move with the joints.
    pub fn start(&self, system: &FlexibleSystem, joints: &State) -> FlexibleState {
        let mut state = FlexibleState::at_rest_with(system, &joints.q);
        state.tree.qd.copy_from(&joints.qd);
        for (e, joint) in system.elastic_joints().iter().enumerate() {
            if let Some(j) = system.model().joint_index(&joint.joint) {
                state.motor_rates_mut()[e] = joints.qd[j];
            }
        }
        let of_appendages = self.appendages.iter().map(|params| &params.initial);
        let initial = of_appendages.chain(self.links.iter().map(|params| &params.initial));
        for (initial, body) in initial.zip(system.modal_bodies()) {
            if !initial.mu.is_empty() {
                state.mu_mut()[body.range()].copy_from_slice(&initial.mu);
            }
            if !initial.mud.is_empty() {
                state.mu_dot_mut()[body.range()].copy_from_slice(&initial.mud);
            }
        }
        for (params, speed) in self.wheels.iter().zip(state.wheel_speeds_mut()) {
            *speed = params.initial_speed;
        }
        state
    }
}

/// The link that carries the part `name`; an empty `link` is the root link.
fn link<'a>(model: &'a Model, name: &str, link: &str) -> Result<&'a Frame, String> {
    if link.is_empty() {
        return Ok(&model.frames()[0]);
    }
    model.frame(link).ok_or_else(|| {
        let links: Vec<_> = model.frames().iter().map(|f| f.name.as_str()).collect();
        format!(
            "parameter {name}.link is '{link}', which is not a link of the robot; it must be one of {}",
            links.join(", ")
        )
    })
}
