//! The views node: publishes `markers` of quantities that RViz and Foxglove cannot display by themselves.
//!
//! It uses ground truth. No other node reads `markers`.

mod appendages;
mod draw;

use std::time::Duration;

use super::{geometry::pose_from_msg, topics};
use crate::{
    msg::{
        fuyu_msgs::{AppendageOutlines, AppendageStates},
        nav_msgs::Odometry,
        std_msgs::Header,
        visualization_msgs::MarkerArray,
    },
    ros::{Declare, Node, NodeError, Subscription, Time},
};
use draw::{arrow, axes, curve};

/// Parameters of the views node; read once, at the start.
#[derive(Debug, Clone)]
pub struct ViewsParams {
    /// Rate at which markers are published \[Hz\].
    pub rate: f64,
    /// Names of the targets, as in the dynamics node.
    pub targets: Vec<String>,
    /// Length of the axes of targets and goals \[m\].
    pub size: f64,
    /// Arrow length per linear momentum \[m/(N s)\].
    pub linear_scale: f64,
    /// Arrow length per angular momentum \[m/(N m s)\].
    pub angular_scale: f64,
    /// Arrow length per angular velocity \[m/(rad/s)\].
    pub rate_scale: f64,
    /// Distance in front of the camera at which the prediction is drawn \[m\].
    pub prediction_distance: f64,
}

impl ViewsParams {
    /// Declares and reads the parameters. The caller must call `declare.finish`.
    pub fn declare(declare: &mut Declare) -> Self {
        let mut length = |name: &str, default: f64, description: &str| {
            let declaration = declare.param(name, default, description);
            declaration.range(0.0, 1e6).read_only().value()
        };
        let size = length("size", 0.5, "Length of the axes of targets and goals [m]");
        let linear_scale = length(
            "linear_scale",
            0.01,
            "Arrow length per linear momentum [m/(N s)]",
        );
        let angular_scale = length(
            "angular_scale",
            0.01,
            "Arrow length per angular momentum [m/(N m s)]",
        );
        let rate_scale = length(
            "rate_scale",
            5.0,
            "Arrow length per angular velocity [m/(rad/s)]",
        );
        let prediction_distance = length(
            "prediction_distance",
            5.0,
            "Distance in front of the camera at which the prediction is drawn [m]",
        );
        let rate = declare
            .param("rate", 10.0, "How often markers are published [Hz]")
            .range(0.1, 60.0)
            .read_only()
            .value();
        let targets = declare
            .param(
                "targets",
                vec!["target".to_owned()],
                "Names of the targets, as in the dynamics node",
            )
            .read_only()
            .value();
        Self {
            rate,
            targets,
            size,
            linear_scale,
            angular_scale,
            rate_scale,
            prediction_distance,
        }
    }
}

/// The node's program.
///
/// # Errors
/// For invalid parameters, or when DDS reports an error.
pub fn program(node: &Node) -> Result<(), NodeError> {
    let mut declare = node.declare();
    let params = ViewsParams::declare(&mut declare);
    declare.finish()?;
    let period = Duration::from_secs_f64(1.0 / params.rate);
    let mut scene = Scene::new(node, params)?;
    let markers = topics::MARKERS.advertise(node)?;
    let status = node.diagnostics().status("markers");
    while node.ok() {
        let array = scene.draw();
        status.set("markers", array.markers.len());
        if !array.markers.is_empty() {
            markers.publish(&array);
        }
        std::thread::sleep(period);
    }
    Ok(())
}

/// Subscriptions, and the data kept between two drawings.
struct Scene {
    params: ViewsParams,
    goal: Subscription<crate::msg::geometry_msgs::PoseStamped>,
    measured_goal: Subscription<crate::msg::geometry_msgs::PoseStamped>,
    momentum: Subscription<crate::msg::fuyu_msgs::Momentum>,
    odometry: Subscription<Odometry>,
    prediction: Subscription<crate::msg::nav_msgs::Path>,
    targets: Vec<Subscription<Odometry>>,
    appendages: Subscription<AppendageStates>,
    outlines: Subscription<AppendageOutlines>,
    /// The last outlines received.
    known_outlines: Option<AppendageOutlines>,
    base: Option<Odometry>,
    /// Stamp of the last odometry.
    last: Time,
}

impl Scene {
    fn new(node: &Node, params: ViewsParams) -> Result<Self, NodeError> {
        Ok(Self {
            goal: topics::GOAL.subscribe(node)?,
            measured_goal: topics::MEASURED_GOAL.subscribe(node)?,
            momentum: topics::MOMENTUM.subscribe(node)?,
            odometry: topics::ODOMETRY.subscribe(node)?,
            prediction: topics::PREDICTION.subscribe(node)?,
            targets: (params.targets.iter())
                .map(|target| topics::TARGET_ODOMETRY.subscribe(node, target))
                .collect::<Result<_, _>>()?,
            appendages: topics::APPENDAGES.subscribe(node)?,
            outlines: topics::APPENDAGE_OUTLINES.subscribe(node)?,
            known_outlines: None,
            base: None,
            last: Time::ZERO,
            params,
        })
    }

    /// Markers for all new messages. Viewers keep the other markers.
    fn draw(&mut self) -> MarkerArray {
        let p = &self.params;
        let mut markers = Vec::new();
        for (id, goal) in (0..).zip([&self.goal, &self.measured_goal]) {
            if let Some(received) = goal.latest() {
                let message = received.message;
                markers.push(axes("goal", id, message.header, message.pose, p.size));
            }
        }
        for (name, target) in p.targets.iter().zip(&self.targets) {
            if let Some(received) = target.latest() {
                let Odometry {
                    header,
                    pose,
                    twist,
                    ..
                } = received.message;
                let group = format!("target {name}");
                // The twist is in the target's axes.
                let Ok(X_WT) = pose_from_msg(&pose.pose) else {
                    continue;
                };
                let w_T = super::geometry::vector_from_msg(&twist.twist.angular);
                let from = X_WT.translation.vector;
                let to = from + X_WT.rotation * w_T * p.rate_scale;
                markers.push(arrow(&group, 1, header.clone(), [from, to], draw::ORANGE));
                markers.push(axes(&group, 0, header, pose.pose, p.size));
            }
        }
        if let Some(received) = self.odometry.latest() {
            let stamp = Time::from(&received.message.header.stamp);
            if stamp < self.last {
                // Time was reset: delete the prediction of the previous run.
                let deleted = |id| {
                    let header = received.message.header.clone();
                    curve("prediction", id, header, std::iter::empty(), draw::BLUE)
                };
                markers.extend((0..3).map(deleted));
            }
            self.last = stamp;
            self.base = Some(received.message);
        }
        if let (Some(received), Some(base)) = (self.momentum.latest(), &self.base) {
            let momentum = received.message;
            if let Ok(X_WB) = pose_from_msg(&base.pose.pose) {
                let from = X_WB.translation.vector;
                for (id, vector, scale, colour) in [
                    (0, &momentum.linear, p.linear_scale, draw::BLUE),
                    (1, &momentum.angular, p.angular_scale, draw::ORANGE),
                ] {
                    let to = from + super::geometry::vector_from_msg(vector) * scale;
                    let header = Header {
                        frame_id: base.header.frame_id.clone(),
                        ..momentum.header.clone()
                    };
                    markers.push(arrow("momentum", id, header, [from, to], colour));
                }
            }
        }
        if let Some(received) = self.prediction.latest() {
            let path = received.message;
            let attitudes: Vec<_> = path
                .poses
                .iter()
                .filter_map(|pose| Some(pose_from_msg(&pose.pose).ok()?.rotation))
                .collect();
            for (id, colour) in (0..).zip([draw::RED, draw::GREEN, draw::BLUE]) {
                let axis = nalgebra::Vector3::ith_axis(id as usize).into_inner() * p.size;
                let centre = nalgebra::Vector3::z() * p.prediction_distance;
                let points = attitudes.iter().map(|R| centre + R * axis);
                markers.push(curve("prediction", id, path.header.clone(), points, colour));
            }
        }
        if let Some(received) = self.outlines.latest() {
            self.known_outlines = Some(received.message);
        }
        if let (Some(received), Some(outlines)) = (self.appendages.latest(), &self.known_outlines) {
            markers.extend(appendages::markers(outlines, &received.message));
        }
        MarkerArray { markers }
    }
}
