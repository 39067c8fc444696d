//! Scenarios: ROS 2 parameter files that name the nodes of a run.

use std::{
    path::{Path, PathBuf},
    sync::Arc,
};

use super::{
    camera::CameraParams,
    controller::ControllerParams,
    dynamics::{DynamicsParams, World},
    recorder::RecorderParams,
    resource, tip_frame,
};
use crate::{
    model::Model,
    ros::{
        Declare, NodeName, ParamsFile, RosArgs,
        params::{ParameterStore, USE_SIM_TIME},
    },
};

/// A parameter file, read.
pub struct Scenario {
    path: PathBuf,
    file: ParamsFile,
    /// The file, and what the command line says of it.
    arguments: RosArgs,
}

impl Scenario {
    /// Reads the scenario `name`: a path, or `package://fuyu/config/NAME.yaml`.
    ///
    /// # Errors
    /// A line that names file, line and field.
    pub fn read(name: &str) -> Result<Self, String> {
        let path = resource::resolve(name)?;
        let file = ParamsFile::read(&path).map_err(|e| e.to_string())?;
        let arguments = RosArgs::default().with_scenario(&path);
        let scenario = Self {
            path,
            file,
            arguments,
        };
        if scenario.file.nodes().is_empty() {
            return Err(format!(
                "{}: names no node; expected `dynamics:` with `ros__parameters:` below it",
                scenario.path.display()
            ));
        }
        for node in scenario.file.nodes() {
            if super::by_name(node.name()).is_none() {
                let known: Vec<_> = super::NODES.iter().map(|(name, _)| *name).collect();
                return Err(format!(
                    "{}: names the node '{}'; fuyu has {}",
                    scenario.path.display(),
                    node.name(),
                    known.join(", ")
                ));
            }
        }
        Ok(scenario)
    }

    /// The same with ROS arguments, whose parameters win over the file's.
    #[must_use]
    pub fn with_arguments(mut self, given: RosArgs) -> Self {
        self.arguments = given.with_scenario(&self.path);
        self
    }

    /// The file and what the command line says of it, as its nodes get them.
    pub fn arguments(&self) -> &RosArgs {
        &self.arguments
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Name of the scenario: the file's without its ending.
    pub fn name(&self) -> String {
        self.path
            .file_stem()
            .map_or_else(String::new, |s| s.to_string_lossy().into_owned())
    }

    /// The nodes that the file names.
    pub fn nodes(&self) -> Vec<NodeName> {
        self.file.nodes()
    }

    /// Whether every node would start with its parameters, and with its robot where the scenario has
    /// it: what can be known before anything runs.
    ///
    /// # Errors
    /// A line per wrong parameter.
    pub fn check(&self) -> Result<(), String> {
        let nodes = self.nodes();
        let problems = nodes.iter().filter_map(|name| self.check_node(name).err());
        let problems: Vec<_> = problems.collect();
        if problems.is_empty() {
            Ok(())
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
                let robot = self.robot(name.namespace());
                robot.map_or(Ok(()), |robot| {
                    let tip = tip_frame(&robot, &params.tip_link);
                    tip.map(drop).map_err(parameter)
                })
            }
            "controller" => {
                let params = self.parameters_of(name, |d| Ok(ControllerParams::declare(d)))?;
                let robot = self.robot(name.namespace());
                robot.map_or(Ok(()), |robot| {
                    tip_frame(&robot, &params.tip_link).map_err(parameter)?;
                    let gains = params.config.check(robot.dof());
                    gains.map_err(|e| parameter(e.to_string()))
                })
            }
            _ => {
                let params = self.parameters_of(name, |d| Ok(RecorderParams::declare(d)));
                params.map(drop)
            }
        }
    }

    /// The robot that the dynamics node of a namespace simulates, if there is one and it is sound.
    fn robot(&self, namespace: &str) -> Option<Model> {
        let nodes = self.nodes();
        let dynamics = nodes
            .iter()
            .find(|n| n.name() == "dynamics" && n.namespace() == namespace)?;
        let params = self.parameters_of(dynamics, DynamicsParams::declare).ok()?;
        params.robot.compile().ok()
    }

    /// Reads the parameters of the first node that the program calls `node`.
    fn parameters<T>(
        &self,
        node: &str,
        declare: impl FnOnce(&mut Declare) -> Result<T, String>,
    ) -> Result<T, String> {
        let nodes = self.file.nodes();
        let name = nodes
            .iter()
            .find(|n| n.name() == node)
            .ok_or_else(|| format!("{}: does not name the node '{node}'", self.path.display()))?;
        self.parameters_of(name, declare)
    }

    /// Reads a node's parameters as the node itself would, without a graph.
    fn parameters_of<T>(
        &self,
        name: &NodeName,
        declare: impl FnOnce(&mut Declare) -> Result<T, String>,
    ) -> Result<T, String> {
        let overrides = self.arguments.overrides(name, name.name());
        let overrides = overrides.map_err(|e| e.to_string())?;
        let store = Arc::new(ParameterStore::new(name.clone(), overrides));
        let mut declaring = Declare::new(store);
        declaring
            .param(USE_SIM_TIME, false, "Take the time from /clock")
            .value();
        let declared = declare(&mut declaring);
        declaring.finish().map_err(|e| e.to_string())?;
        declared.map_err(|e| format!("{}: node {name}: {e}", self.path.display()))
    }

    /// Parameters of the dynamics node.
    ///
    /// # Errors
    /// A line per wrong parameter.
    pub fn dynamics(&self) -> Result<DynamicsParams, String> {
        self.parameters("dynamics", DynamicsParams::declare)
    }

    /// Parameters of the camera node.
    ///
    /// # Errors
    /// A line per wrong parameter.
    pub fn camera(&self) -> Result<CameraParams, String> {
        self.parameters("camera", CameraParams::declare)
    }

    /// Parameters of the controller node.
    ///
    /// # Errors
    /// A line per wrong parameter.
    pub fn controller(&self) -> Result<ControllerParams, String> {
        self.parameters("controller", |d| Ok(ControllerParams::declare(d)))
    }

    /// Parameters of the recorder node.
    ///
    /// # Errors
    /// A line per wrong parameter.
    pub fn recorder(&self) -> Result<RecorderParams, String> {
        self.parameters("recorder", |d| Ok(RecorderParams::declare(d)))
    }
}
