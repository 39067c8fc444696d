//! Scenarios: ROS 2 parameter files that name the nodes of a run.

mod declared;
mod several_robots;

use std::{
    path::{Path, PathBuf},
    sync::Arc,
};

use super::{
    attitude::{AttitudeLoop, AttitudeParams},
    camera::{
        CameraParams, camera_frame,
        images::{Body, ImageParams, ImageScene, Imager, checked_shape},
    },
    controller::{ControllerParams, second_tip},
    dynamics::{DynamicsParams, World},
    estimator::EstimatorParams,
    mission::MissionParams,
    recorder::RecorderParams,
    resource,
    sampled_loop::{self, Delay},
    teleop::TeleopParams,
    tip_frame,
    tracker::TrackerParams,
    views::ViewsParams,
};
use crate::{
    input_file::LARGEST_YAML,
    model::Model,
    ros::{
        Declare, NodeName, ParameterValue, ParamsFile, RosArgs,
        args::ParameterSource,
        names::{self, Remap},
        params::{ParameterStore, USE_SIM_TIME},
    },
};

pub use declared::Declared;
pub use several_robots::OtherBody;

/// A scenario: a parameter file, with the ROS arguments of the command line.
#[derive(Clone)]
pub struct Scenario {
    path: PathBuf,
    file: ParamsFile,
    nodes: Vec<NodeName>,
    args: RosArgs,
}

/// Checks that cameras are valid and all meshes of drawn bodies can be loaded.
fn check_images(
    images: &ImageParams,
    dynamics: &DynamicsParams,
    world: &World,
) -> Result<(), String> {
    Imager::new(images)?;
    let shape = checked_shape(&dynamics.robot.xml, "robot")?;
    let robot = Body::new(world.robot.model().clone(), &shape);
    ImageScene::new(images, robot, Vec::new())?;
    for target in &world.targets {
        if images.bodies.contains(&target.name) {
            checked_shape(&target.description, &target.name)?;
        }
    }
    Ok(())
}

impl Scenario {
    /// Reads the scenario `name`: a path, or `package://fuyu/config/NAME.yaml`; see [`resource::resolve`].
    ///
    /// # Errors
    /// A line with file, line and field.
    pub fn read(name: &str) -> Result<Self, String> {
        let found = resource::resolve(name)?;
        Self::parse(found.path(), &found.text(LARGEST_YAML)?)
    }

    /// Parses `text`; errors refer to it as `path`. Files named in it are relative to the folder of `path`.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn parse(path: PathBuf, text: &str) -> Result<Self, String> {
        let file = ParamsFile::parse(&path, text).map_err(|e| e.to_string())?;
        let nodes = file.nodes();
        if nodes.is_empty() {
            return Err(format!(
                "{}: names no node; expected `dynamics:` with `ros__parameters:` below it",
                path.display()
            ));
        }
        if let Some(unknown) = nodes.iter().find(|n| super::by_name(n.name()).is_none()) {
            let known: Vec<_> = super::NODES.iter().map(|(name, _)| *name).collect();
            return Err(format!(
                "{}: names the node '{}'; fuyu has {}",
                path.display(),
                unknown.name(),
                known.join(", ")
            ));
        }
        let args = RosArgs::default().with_scenario(file.clone());
        Ok(Self {
            path,
            file,
            nodes,
            args,
        })
    }

    /// Adds the ROS arguments of a command line, which take precedence over the file.
    #[must_use]
    pub fn with_args(mut self, args: RosArgs) -> Self {
        self.args = args.with_scenario(self.file.clone());
        self
    }

    /// Sets one parameter of one node. This takes precedence over file and command line.
    pub fn set(&mut self, node: &str, name: &str, value: ParameterValue) {
        self.args.parameters.push(ParameterSource::Value {
            node: Some(node.to_owned()),
            name: name.to_owned(),
            value,
        });
    }

    /// For several robots with the same frame names: moves `/tf` and `/tf_static` to the namespace of each robot.
    pub fn separate_transforms(&mut self) {
        for topic in ["tf", "tf_static"] {
            self.args.remaps.push(Remap {
                node: None,
                target: names::Target::Name {
                    from: format!("/{topic}"),
                    topics: true,
                    services: false,
                },
                to: topic.to_owned(),
            });
        }
    }

    /// The ROS arguments: file, command line, and values set by the program.
    pub fn args(&self) -> &RosArgs {
        &self.args
    }

    /// The file; `package://fuyu/PATH` if it is embedded in the executable.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Name of the scenario: the file name without extension.
    pub fn name(&self) -> String {
        self.path
            .file_stem()
            .map_or_else(String::new, |s| s.to_string_lossy().into_owned())
    }

    /// The nodes that the file names.
    pub fn nodes(&self) -> &[NodeName] {
        &self.nodes
    }

    /// Whether the file names the node called `node`.
    pub fn has(&self, node: &str) -> bool {
        self.nodes.iter().any(|n| n.name() == node)
    }

    /// Namespaces of the dynamics nodes, one per robot.
    pub fn robots(&self) -> Vec<&str> {
        let dynamics = self.nodes.iter().filter(|n| n.name() == "dynamics");
        dynamics.map(NodeName::namespace).collect()
    }

    /// The body of another robot given by an absolute name, `/NAMESPACE/base_link` or `/NAMESPACE/TARGET`.
    ///
    /// # Errors
    /// A line that lists the known bodies.
    pub fn other_body(&self, name: &str) -> Result<OtherBody, String> {
        several_robots::other_body(self, name)
    }

    /// Whether its robots share a world with other robots, of this scenario or of another process.
    pub fn has_several_robots(&self) -> bool {
        let params = self
            .robots()
            .into_iter()
            .filter_map(|robot| self.dynamics_of(robot));
        params.into_iter().any(|params| !params.robots.is_empty())
    }

    /// The same scenario with the nodes of one namespace only.
    #[must_use]
    pub fn of_robot(&self, namespace: &str) -> Self {
        let nodes = self.nodes.iter();
        let nodes = nodes.filter(|n| n.namespace() == namespace).cloned();
        Self {
            path: self.path.clone(),
            file: self.file.clone(),
            nodes: nodes.collect(),
            args: self.args.clone(),
        }
    }

    /// Checks before a run that every node can start with its parameters, and, if the scenario names the dynamics node,
    /// with its robot.
    ///
    /// # Errors
    /// One line per invalid parameter.
    pub fn check(&self) -> Result<(), String> {
        let problems = self
            .nodes
            .iter()
            .filter_map(|name| self.check_node(name).err());
        let problems: Vec<_> = problems.collect();
        if problems.is_empty() {
            several_robots::check(self)
        } else {
            Err(problems.join("\n"))
        }
    }

    fn check_node(&self, name: &NodeName) -> Result<(), String> {
        let at = |e: String| format!("{}: node {name}: {e}", self.path.display());
        let parameter = |e: String| at(format!("parameter {e}"));
        match name.name() {
            "dynamics" => {
                let params = self.parameters_of(name, DynamicsParams::declare)?;
                World::new(&params).map(drop).map_err(at)
            }
            "camera" => {
                let params = self.parameters_of(name, CameraParams::declare)?;
                let Some(dynamics) = self.dynamics_of(name.namespace()) else {
                    return Ok(());
                };
                let imperfections = [
                    ("rate", params.quality.rate),
                    ("latency", params.quality.latency),
                    ("dropout", params.quality.dropout),
                ];
                // Every state would wait for a frame that is late or missing.
                if let (true, Some((name, value))) = (
                    dynamics.lockstep,
                    imperfections.iter().find(|(_, value)| *value > 0.0),
                ) {
                    return Err(parameter(format!(
                        "{name} is {value}; in lockstep every state needs its frame at once, so give 0"
                    )));
                }
                if let Ok(robot) = dynamics.robot.compile() {
                    tip_frame(&robot, &params.tip_link).map_err(parameter)?;
                    second_tip(&robot, &params.second_tip_link).map_err(parameter)?;
                    if params.features.is_some() {
                        camera_frame(&robot).map_err(at)?;
                    }
                }
                let Ok(world) = World::new(&dynamics) else {
                    return Ok(());
                };
                let check_target = |key: &str, target: Option<&String>| {
                    let Some(target) = target else {
                        return Ok(());
                    };
                    let found = match target.starts_with('/') {
                        true => self.other_body(target).map(drop),
                        false => world.target_index(target).map(drop),
                    };
                    found.map_err(|e| parameter(format!("{key}: {e}")))
                };
                check_target(
                    "features.target",
                    params.features.as_ref().map(|f| &f.target),
                )?;
                check_target("goal.frame", params.goal_target.as_ref())?;
                let Some(images) = &params.images else {
                    return Ok(());
                };
                for body in &images.bodies {
                    check_target("images.bodies", Some(body))?;
                }
                check_images(images, &dynamics, &world).map_err(at)
            }
            "controller" => {
                let params = self.parameters_of(name, |d| Ok(ControllerParams::declare(d)))?;
                let robot = self.robot(name.namespace());
                robot.map_or(Ok(()), |robot| {
                    let tip = tip_frame(&robot, &params.tip_link).map_err(parameter)?;
                    second_tip(&robot, &params.second_tip_link).map_err(parameter)?;
                    let config = params.complete(params.config.clone(), &robot, &tip);
                    let gains = config.map_err(parameter)?.check(robot.dof());
                    gains.map_err(|e| parameter(e.to_string()))
                })
            }
            "attitude" => {
                let params = self.parameters_of(name, AttitudeParams::declare)?;
                let Some(dynamics) = self.dynamics_of(name.namespace()) else {
                    return Ok(());
                };
                let (Ok(robot), Ok(world)) = (dynamics.robot.compile(), World::new(&dynamics))
                else {
                    return Ok(());
                };
                let mut attitude = AttitudeLoop::new(&params, &robot).map_err(at)?;
                let q = world.robot.state().q.as_slice();
                attitude.design(q).map_err(at)
            }
            "teleop" => {
                let params = self.parameters_of(name, TeleopParams::declare)?;
                self.refuse_next_to(name, &["controller"], "commands the same joints")
                    .map_err(at)?;
                let robot = self.robot(name.namespace());
                robot.map_or(Ok(()), |robot| {
                    let tip = tip_frame(&robot, &params.tip_link);
                    tip.map(drop).map_err(parameter)
                })
            }
            "mission" => {
                let params = self.parameters_of(name, MissionParams::declare)?;
                self.refuse_next_to(name, &["controller", "teleop"], "commands the same joints")
                    .map_err(at)?;
                // Motion plans of the arm assume a freely floating base.
                let reason = "holds the base, which must float freely";
                self.refuse_next_to(name, &["attitude"], reason)
                    .map_err(at)?;
                let robot = self.robot(name.namespace());
                robot.map_or(Ok(()), |robot| params.mission(&robot).map(drop).map_err(at))
            }
            "estimator" => self.parameters_of(name, EstimatorParams::declare).map(drop),
            "tracker" => self.parameters_of(name, TrackerParams::declare).map(drop),
            "views" => {
                let params = self.parameters_of(name, |d| Ok(ViewsParams::declare(d)));
                params.map(drop)
            }
            _ => {
                let params = self.parameters_of(name, |d| Ok(RecorderParams::declare(d)));
                params.map(drop)
            }
        }
    }

    /// Warnings on valid settings that will not work, one line each: control loops destabilised by sampling, and two
    /// nodes that publish `camera/features`. `in_one_thread` means a run of `fuyu simulate`, in which every state is
    /// answered at once; then there is also one line per kind of repair in each robot description.
    pub fn warnings(&self, in_one_thread: bool) -> Vec<String> {
        let controllers = self.nodes.iter().filter(|n| n.name() == "controller");
        let warning = |name: &NodeName| {
            let dynamics = self.dynamics_of(name.namespace())?;
            let controller = self.parameters_of(name, |d| Ok(ControllerParams::declare(d)));
            let delay = match in_one_thread || dynamics.lockstep {
                true => Delay::None,
                false => Delay::UpToPeriod,
            };
            let found = sampled_loop::instability(&dynamics, &controller.ok()?, delay);
            let found = found.ok()??;
            Some(format!("{}: node {name}: {found}", self.path.display()))
        };
        let attitudes = self.nodes.iter().filter(|n| n.name() == "attitude");
        let of_attitude = |name: &NodeName| {
            let dynamics = self.dynamics_of(name.namespace())?;
            let params = self.parameters_of(name, AttitudeParams::declare).ok()?;
            let world = World::new(&dynamics).ok()?;
            let mut attitude = AttitudeLoop::new(&params, world.robot.model()).ok()?;
            let delay = match in_one_thread || dynamics.lockstep {
                true => 0.0,
                false => 1.0 / dynamics.state_rate,
            };
            let found = attitude.instability(world.robot.state().q.as_slice(), delay);
            let found = found.ok()??;
            Some(format!("{}: node {name}: {found}", self.path.display()))
        };
        // In a launch, the dynamics node itself warns of repairs.
        let of_robots = self.nodes.iter();
        let of_robots = of_robots.filter(|n| in_one_thread && n.name() == "dynamics");
        let repairs = of_robots.flat_map(|name| {
            let dynamics = self.dynamics_of(name.namespace());
            dynamics.map_or_else(Vec::new, |dynamics| dynamics.repairs())
        });
        let trackers = self.nodes.iter().filter(|n| n.name() == "tracker");
        let of_tracker = |name: &NodeName| {
            let cameras = (self.nodes.iter()).filter(|n| n.name() == "camera");
            let mut cameras = cameras.filter(|n| n.namespace() == name.namespace());
            let camera = cameras.next()?;
            let params = self.parameters_of(camera, CameraParams::declare).ok()?;
            let both = params.features.is_some_and(|features| !features.is_truth);
            both.then(|| {
                format!(
                    "{}: nodes {camera} and {name} both publish camera/features; set features.ground_truth of the camera to true, or features.target to ''",
                    self.path.display()
                )
            })
        };
        (repairs.chain(controllers.filter_map(warning)))
            .chain(attitudes.filter_map(of_attitude))
            .chain(trackers.filter_map(of_tracker))
            .collect()
    }

    /// An error if one of the nodes `others` is in the namespace of `name`; `reason` says what it does.
    fn refuse_next_to(&self, name: &NodeName, others: &[&str], reason: &str) -> Result<(), String> {
        let is_other =
            |n: &&NodeName| others.contains(&n.name()) && n.namespace() == name.namespace();
        match self.nodes.iter().find(is_other) {
            Some(other) => Err(format!("{other} {reason}; name one of the two")),
            None => Ok(()),
        }
    }

    /// The robot that the dynamics node of a namespace simulates, if there is one and it is valid.
    fn robot(&self, namespace: &str) -> Option<Model> {
        self.dynamics_of(namespace)?.robot.compile().ok()
    }

    /// Parameters of the dynamics node of a namespace, if there is one and they are valid.
    pub(super) fn dynamics_of(&self, namespace: &str) -> Option<DynamicsParams> {
        let dynamics = self
            .nodes
            .iter()
            .find(|n| n.name() == "dynamics" && n.namespace() == namespace)?;
        self.parameters_of(dynamics, DynamicsParams::declare).ok()
    }

    /// Reads the parameters of the first node called `node`.
    fn parameters<T>(
        &self,
        node: &str,
        declare: impl FnOnce(&mut Declare) -> Result<T, String>,
    ) -> Result<T, String> {
        let name = (self.nodes.iter())
            .find(|n| n.name() == node)
            .ok_or_else(|| format!("{}: does not name the node '{node}'", self.path.display()))?;
        self.parameters_of(name, declare)
    }

    /// Reads a node's parameters as the node would, without DDS.
    fn parameters_of<T>(
        &self,
        name: &NodeName,
        declare: impl FnOnce(&mut Declare) -> Result<T, String>,
    ) -> Result<T, String> {
        self.store_of(name, declare).map(|(value, _)| value)
    }

    /// As [`Self::parameters_of`], with the store of all the node's parameters.
    fn store_of<T>(
        &self,
        name: &NodeName,
        declare: impl FnOnce(&mut Declare) -> Result<T, String>,
    ) -> Result<(T, Arc<ParameterStore>), String> {
        let overrides = self
            .args
            .overrides(name, name.name())
            .map_err(|e| e.to_string())?;
        let store = Arc::new(ParameterStore::new(name.clone(), overrides));
        let mut declaring = Declare::new(Arc::clone(&store));
        declaring
            .param(USE_SIM_TIME, false, "Take the time from /clock")
            .value();
        let declared = declare(&mut declaring);
        declaring
            .finish()
            .map_err(|e| self.with_place(&e.to_string()))?;
        let value = declared.map_err(|e| format!("{}: node {name}: {e}", self.path.display()))?;
        Ok((value, store))
    }

    /// Adds the file to error lines on missing parameters, which have no line in the file.
    fn with_place(&self, errors: &str) -> String {
        let place = |line: &str| match line.starts_with("node ") {
            true => format!("{}: {line}", self.path.display()),
            false => line.to_owned(),
        };
        errors.lines().map(place).collect::<Vec<_>>().join("\n")
    }

    /// Parameters of the dynamics node.
    ///
    /// # Errors
    /// One line per invalid parameter.
    pub fn dynamics(&self) -> Result<DynamicsParams, String> {
        self.parameters("dynamics", DynamicsParams::declare)
    }

    /// Parameters of the camera node.
    ///
    /// # Errors
    /// One line per invalid parameter.
    pub fn camera(&self) -> Result<CameraParams, String> {
        self.parameters("camera", CameraParams::declare)
    }

    /// Parameters of the controller node.
    ///
    /// # Errors
    /// One line per invalid parameter.
    pub fn controller(&self) -> Result<ControllerParams, String> {
        self.parameters("controller", |d| Ok(ControllerParams::declare(d)))
    }

    /// Parameters of the attitude node.
    ///
    /// # Errors
    /// One line per invalid parameter.
    pub fn attitude(&self) -> Result<AttitudeParams, String> {
        self.parameters("attitude", AttitudeParams::declare)
    }

    /// Parameters of the teleop node.
    ///
    /// # Errors
    /// One line per invalid parameter.
    pub fn teleop(&self) -> Result<TeleopParams, String> {
        self.parameters("teleop", TeleopParams::declare)
    }

    /// Parameters of the mission node.
    ///
    /// # Errors
    /// One line per invalid parameter.
    pub fn mission(&self) -> Result<MissionParams, String> {
        self.parameters("mission", MissionParams::declare)
    }

    /// Parameters of the estimator node.
    ///
    /// # Errors
    /// One line per invalid parameter.
    pub fn estimator(&self) -> Result<EstimatorParams, String> {
        self.parameters("estimator", EstimatorParams::declare)
    }

    /// Parameters of the recorder node.
    ///
    /// # Errors
    /// One line per invalid parameter.
    pub fn recorder(&self) -> Result<RecorderParams, String> {
        self.parameters("recorder", |d| Ok(RecorderParams::declare(d)))
    }
}
