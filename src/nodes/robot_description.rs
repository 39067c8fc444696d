//! The robot from `robot_description`, for all nodes except dynamics.

use std::time::Duration;

use crate::{
    model::{Frame, Model},
    msg::std_msgs,
    nodes::{tip::tip_frame, topics},
    ros::{Node, NodeError, Status, Subscription},
};

/// Subscription to `robot_description`, which may arrive late and may change.
pub struct RobotDescription {
    topic: Subscription<std_msgs::String>,
    status: Status,
    tip_link: String,
    last: String,
}

/// A robot and its tip.
pub struct Robot {
    /// The compiled description.
    pub model: Model,
    /// The tip's frame.
    pub tip: Frame,
}

impl RobotDescription {
    /// Subscribes. The tip is the link `tip_link`, or the base if that is empty.
    ///
    /// # Errors
    /// When the node cannot subscribe.
    pub fn new(node: &Node, tip_link: String) -> Result<Self, NodeError> {
        let topic = topics::ROBOT_DESCRIPTION.subscribe(node)?;
        let status = node.diagnostics().status("robot");
        status.warn("no robot_description has arrived yet");
        Ok(Self {
            topic,
            status,
            tip_link,
            last: String::new(),
        })
    }

    /// Text of the last description.
    pub fn text(&self) -> &str {
        &self.last
    }

    /// Reports why the last description cannot be used.
    pub fn refuse(&self, problem: &str) {
        tracing::error!(
            "{}: {problem}; the previous robot is kept",
            self.topic.topic()
        );
        self.status
            .error(format!("{problem}; the previous robot is kept"));
    }

    /// The robot, if a new valid description has arrived; an invalid one is reported.
    pub fn changed(&mut self) -> Option<Robot> {
        let text = self.topic.latest()?.message.data;
        if text == self.last {
            return None;
        }
        let robot = self.compile(&text);
        self.last = text;
        match robot {
            Ok(robot) => {
                self.status.ok(format!(
                    "{}: {} joints",
                    robot.model.name(),
                    robot.model.dof()
                ));
                Some(robot)
            }
            Err(problem) => {
                tracing::error!("{problem}");
                self.status.error(problem);
                None
            }
        }
    }

    fn compile(&self, text: &str) -> Result<Robot, String> {
        let source = self.topic.topic();
        // The dynamics node, which publishes the description, has already warned of repairs or refused them.
        let repaired = Model::repaired_from_urdf(text, source).map_err(|e| e.to_string())?;
        let model = repaired.model;
        let tip = match self.tip_link.is_empty() {
            true => model.frames()[0].clone(),
            false => tip_frame(&model, &self.tip_link).map_err(|e| format!("{source}: {e}"))?,
        };
        Ok(Robot { model, tip })
    }

    /// Waits for the first description; `None` if the node must stop.
    pub fn wait(&mut self, node: &Node) -> Option<Robot> {
        loop {
            if let Some(robot) = self.changed() {
                return Some(robot);
            }
            if !node.wait_for(Duration::from_millis(100)) {
                return None;
            }
        }
    }
}
