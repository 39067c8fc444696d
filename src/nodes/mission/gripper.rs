//! What closes and opens the grasp: the dynamics node's services, or the action of a gripper.

use std::time::Duration;

use super::params::{Fingers, Grip};
use crate::{
    control::capture::{GripWatch, Gripper},
    msg::{
        control_msgs::{
            GripperCommand as Command,
            gripper_command::{Goal, GripperCommand},
        },
        sensor_msgs::JointState,
        std_srvs::{Trigger, TriggerRequest},
    },
    ros::{ActionClient, Node, NodeError, PendingCall, ServiceClient},
};

/// Longest wait for a gripper to accept a goal, wall time.
const PATIENCE: Duration = Duration::from_secs(2);

/// Follows the mission's commands to the gripper.
pub(super) enum GripperDriver {
    /// A latch that works by itself.
    Automatic,
    /// The services `attach` and `detach`.
    Services(GripperServices),
    /// A gripper with fingers.
    Fingers(FingerGripper),
}

impl GripperDriver {
    /// The driver with its clients.
    ///
    /// # Errors
    /// When DDS refuses.
    pub fn new(node: &Node, grip: &Grip) -> Result<Self, NodeError> {
        Ok(match grip {
            Grip::Automatic => Self::Automatic,
            Grip::Services => Self::Services(GripperServices::new(node)?),
            Grip::Fingers(fingers) => Self::Fingers(FingerGripper::new(node, fingers)?),
        })
    }

    /// Does what is `wanted`, once. Returns whether the gripper holds, if that is known. `joints` are those at `time` \[s\].
    pub fn follow(&mut self, wanted: Gripper, time: f64, joints: &JointState) -> Option<bool> {
        match self {
            Self::Automatic => None,
            Self::Services(services) => services.follow(wanted),
            Self::Fingers(fingers) => fingers.follow(wanted, time, joints),
        }
    }
}

/// The gripper behind the services `attach` and `detach` of the dynamics node.
pub(super) struct GripperServices {
    attach: ServiceClient<Trigger>,
    detach: ServiceClient<Trigger>,
    wanted: Gripper,
    pending: Option<PendingCall<Trigger>>,
    holds: Option<bool>,
}

impl GripperServices {
    fn new(node: &Node) -> Result<Self, NodeError> {
        Ok(Self {
            attach: node.client("dynamics/attach")?,
            detach: node.client("dynamics/detach")?,
            wanted: Gripper::Open,
            pending: None,
            holds: None,
        })
    }

    fn follow(&mut self, wanted: Gripper) -> Option<bool> {
        if wanted != self.wanted {
            self.wanted = wanted;
            self.holds = None;
            let client = match wanted {
                Gripper::Close => &self.attach,
                Gripper::Open => &self.detach,
            };
            match client.send(&TriggerRequest::default()) {
                Ok(pending) => self.pending = Some(pending),
                Err(e) => tracing::warn!("{e}"),
            }
        }
        if let Some(response) = self.pending.as_ref().and_then(PendingCall::take) {
            self.pending = None;
            if !response.success {
                tracing::warn!("gripper: {}", response.message);
            }
            self.holds = (self.wanted == Gripper::Close).then_some(response.success);
        }
        self.holds
    }
}

/// A gripper with fingers: goals of its action close and open it, its joint tells whether it holds.
pub(super) struct FingerGripper {
    action: ActionClient<GripperCommand>,
    fingers: Fingers,
    watch: GripWatch,
    wanted: Gripper,
}

impl FingerGripper {
    fn new(node: &Node, fingers: &Fingers) -> Result<Self, NodeError> {
        Ok(Self {
            action: ActionClient::new(node, &format!("{}/gripper_cmd", fingers.name))?,
            fingers: fingers.clone(),
            watch: fingers.watch(),
            wanted: Gripper::Open,
        })
    }

    fn follow(&mut self, wanted: Gripper, time: f64, joints: &JointState) -> Option<bool> {
        if wanted != self.wanted {
            self.wanted = wanted;
            self.watch.restart();
            let command = Command {
                position: match wanted {
                    Gripper::Close => self.fingers.closed,
                    Gripper::Open => self.fingers.open,
                },
                max_effort: self.fingers.effort,
            };
            // Its result says when fingers stall; its joint says so, too, and when they slip later.
            match self.action.send_goal(Goal { command }, PATIENCE) {
                Ok(Some(_)) => {}
                Ok(None) => tracing::warn!("gripper: {} rejects its goal", self.fingers.name),
                Err(e) => tracing::warn!("gripper: {e}"),
            }
        }
        if self.wanted == Gripper::Open {
            return None;
        }
        let at = joints.name.iter().position(|n| *n == self.fingers.joint)?;
        let (position, rate) = (joints.position.get(at)?, joints.velocity.get(at)?);
        self.watch.see(time, *position, *rate)
    }
}
