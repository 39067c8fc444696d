//! Launch plan: the scenario combined with the command line.

use std::{
    net::{IpAddr, Ipv4Addr, SocketAddr},
    path::PathBuf,
};

use super::Args;
use crate::{
    nodes::{self, recorder, scenario::Scenario, topics},
    ros::{NodeName, ParameterValue, RosArgs},
};

/// A scenario combined with command line options.
pub struct Plan {
    /// The scenario with ROS arguments and options applied.
    pub scenario: Scenario,
    /// Nodes in starting order.
    pub nodes: Vec<(NodeName, nodes::Program)>,
    /// Simulated duration \[s\]; zero: unlimited.
    pub duration: f64,
    /// Output folder of the recorder, if there is one.
    pub bag: Option<PathBuf>,
    /// Address of the Foxglove server, if requested.
    pub foxglove: Option<SocketAddr>,
    /// Whether that server also serves the operator's page.
    pub cockpit: bool,
}

/// Where the Foxglove server listens by default.
const FOXGLOVE: SocketAddr = SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), 8765);

impl Plan {
    /// Reads the scenario. Options take precedence over ROS arguments, and these over the file.
    ///
    /// # Errors
    /// A line that names the mistake and the correct form.
    pub fn new(args: &Args, ros_args: RosArgs) -> Result<Self, String> {
        let name = args
            .config
            .as_deref()
            .unwrap_or("package://fuyu/config/capture.yaml");
        let mut scenario = Scenario::read(name)?.with_args(ros_args);
        let path = scenario.path().display().to_string();
        if let Some(duration) = args.duration {
            scenario.set("dynamics", "duration", ParameterValue::Double(duration));
        }
        if args.lockstep {
            scenario.set("dynamics", "lockstep", ParameterValue::Bool(true));
            scenario.set("controller", "lockstep", ParameterValue::Bool(true));
            if scenario.has("attitude") {
                scenario.set("attitude", "lockstep", ParameterValue::Bool(true));
                let mut awaited = vec![topics::WHEEL_COMMANDS.name.to_owned()];
                if scenario.has("controller") {
                    awaited.push(topics::JOINT_COMMANDS.name.to_owned());
                }
                let awaited = ParameterValue::StringArray(awaited);
                scenario.set("dynamics", "lockstep_on", awaited);
            }
            scenario.set("dynamics", "real_time_factor", ParameterValue::Double(0.0));
        }
        if scenario.has_several_robots() {
            scenario.separate_transforms();
        }
        // Check everything before any node starts, so that invalid input leaves no bag behind.
        scenario.check()?;
        let bag = if scenario.has("recorder") {
            let given = args.bag.clone().or(scenario.recorder()?.bag);
            let bag = given.unwrap_or_else(|| recorder::new_folder(&scenario.name()));
            let text = bag.display().to_string();
            scenario.set("recorder", "bag", ParameterValue::String(text));
            Some(bag)
        } else if args.bag.is_some() {
            return Err(format!("--bag: {path} names no recorder to write a bag"));
        } else {
            None
        };
        let mut duration = 0.0;
        if scenario.has("dynamics") {
            let dynamics = scenario.dynamics()?;
            duration = dynamics.duration;
            if dynamics.lockstep && scenario.has("teleop") {
                return Err(format!(
                    "{path}: an operator acts in real time; with the node teleop, lockstep of the dynamics node must be false"
                ));
            }
            if dynamics.lockstep && scenario.has("camera") {
                let quality = scenario.camera()?.quality;
                if quality.rate != 0.0 || quality.latency != 0.0 || quality.dropout != 0.0 {
                    return Err(format!(
                        "{path}: in lockstep the camera must answer every state at once; its rate, latency and dropout must be 0.0"
                    ));
                }
            }
        }
        let mut nodes = Vec::new();
        for (name, program) in nodes::NODES {
            let named = scenario.nodes().iter().filter(|n| n.name() == name);
            nodes.extend(named.map(|n| (n.clone(), program)));
        }
        let foxglove = args.foxglove.or(args.cockpit.then_some(FOXGLOVE));
        if foxglove.is_some() && !scenario.has("views") {
            let namespace = nodes.last().map_or("/", |(name, _)| name.namespace());
            let views = NodeName::new(namespace, "views").map_err(|e| e.to_string())?;
            nodes.insert(0, (views, nodes::views::program));
        }
        Ok(Self {
            scenario,
            nodes,
            duration,
            bag,
            foxglove,
            cockpit: args.cockpit,
        })
    }
}
