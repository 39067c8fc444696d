//! Grippers that close and open the grasp: services of the dynamics node, or the action of a gripper with fingers.

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
    ros::{ActionClient, Node, NodeError, PendingCall, PendingGoal, ServiceClient},
};

/// Time after which an unconfirmed command is sent again \[s\].
const RETRY_PERIOD: f64 = 1.0;

/// Maximum number of unanswered calls; another call replaces the oldest one.
const MOST_CALLS: usize = 8;

/// Executes the mission's gripper commands.
pub(super) enum GripperDriver {
    /// A latch that closes automatically; commands are not needed.
    Automatic,
    /// The services `attach` and `detach`.
    Services(GripperServices),
    /// A gripper with fingers.
    Fingers(Box<FingerGripper>),
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
            Grip::Fingers(fingers) => Self::Fingers(Box::new(FingerGripper::new(node, fingers)?)),
        })
    }

    /// Executes the command `wanted`, once. Returns whether the gripper holds, if known. `joints` is the joint state at
    /// `time` \[s\].
    pub fn follow(&mut self, wanted: Gripper, time: f64, joints: &JointState) -> Option<bool> {
        match self {
            Self::Automatic => None,
            Self::Services(services) => services.follow(wanted, time),
            Self::Fingers(fingers) => fingers.follow(wanted, time, joints),
        }
    }
}

/// A command sent but not confirmed, and the time of sending \[s\].
struct Sent<T> {
    pending: T,
    time: f64,
}

impl<T> Sent<T> {
    fn is_overdue(&self, time: f64) -> bool {
        time - self.time > RETRY_PERIOD
    }
}

/// Client of the services `attach` and `detach` of the dynamics node.
pub(super) struct GripperServices {
    attach: ServiceClient<Trigger>,
    detach: ServiceClient<Trigger>,
    wanted: Gripper,
    /// Unanswered calls for the wanted state; `None` after the outcome is known. All are kept, since an early call may
    /// take effect although its response is late, and a repeated call then fails.
    sent: Option<Sent<Vec<PendingCall<Trigger>>>>,
    holds: Option<bool>,
}

impl GripperServices {
    fn new(node: &Node) -> Result<Self, NodeError> {
        Ok(Self {
            attach: node.client("dynamics/attach")?,
            detach: node.client("dynamics/detach")?,
            wanted: Gripper::Open,
            sent: None,
            holds: None,
        })
    }

    fn follow(&mut self, wanted: Gripper, time: f64) -> Option<bool> {
        if wanted != self.wanted {
            self.wanted = wanted;
            self.holds = None;
            self.sent = None;
            self.send(time);
        }
        let Some(sent) = &mut self.sent else {
            return self.holds;
        };
        let mut answered = None;
        sent.pending.retain(|call| match call.take() {
            Some(response) => {
                if !response.success {
                    tracing::warn!("gripper: {}", response.message);
                }
                answered = Some(answered.unwrap_or(false) || response.success);
                false
            }
            None => true,
        });
        match answered {
            Some(success) if success || sent.pending.is_empty() => {
                self.sent = None;
                self.holds = (wanted == Gripper::Close).then_some(success);
            }
            _ if sent.is_overdue(time) => self.send(time),
            _ => {}
        }
        self.holds
    }

    fn send(&mut self, time: f64) {
        let client = match self.wanted {
            Gripper::Close => &self.attach,
            Gripper::Open => &self.detach,
        };
        let call = client.send(&TriggerRequest::default());
        let call = call.inspect_err(|e| tracing::warn!("gripper: {e}"));
        let sent = self.sent.take();
        let mut pending = sent.map_or_else(Vec::new, |sent| sent.pending);
        pending.extend(call.ok());
        let excess = pending.len().saturating_sub(MOST_CALLS);
        pending.drain(..excess);
        self.sent = Some(Sent { pending, time });
    }
}

/// A gripper with fingers: goals of its action close and open it; the motion of its joint shows whether it holds.
pub(super) struct FingerGripper {
    action: ActionClient<GripperCommand>,
    fingers: Fingers,
    watch: GripWatch,
    wanted: Gripper,
    /// Unconfirmed goal; `None` after it was accepted. The result of the goal is not awaited: the joint's motion shows
    /// when the fingers stall, and when they slip later.
    sent: Option<Sent<Option<PendingGoal<GripperCommand>>>>,
}

impl FingerGripper {
    fn new(node: &Node, fingers: &Fingers) -> Result<Self, NodeError> {
        Ok(Self {
            action: ActionClient::new(node, &format!("{}/gripper_cmd", fingers.name))?,
            fingers: fingers.clone(),
            watch: fingers.watch(),
            wanted: Gripper::Open,
            sent: None,
        })
    }

    fn follow(&mut self, wanted: Gripper, time: f64, joints: &JointState) -> Option<bool> {
        if wanted != self.wanted {
            self.wanted = wanted;
            self.watch.restart();
            self.send(time);
        }
        if let Some(sent) = &mut self.sent {
            match sent.pending.as_ref().and_then(PendingGoal::is_accepted) {
                Some(true) => self.sent = None,
                Some(false) => {
                    tracing::warn!("gripper: {} rejects its goal", self.fingers.name);
                    sent.pending = None;
                }
                None if sent.is_overdue(time) => self.send(time),
                None => {}
            }
        }
        if self.wanted == Gripper::Open {
            return None;
        }
        let at = joints.name.iter().position(|n| *n == self.fingers.joint)?;
        let (position, rate) = (joints.position.get(at)?, joints.velocity.get(at)?);
        self.watch.see(time, *position, *rate)
    }

    fn send(&mut self, time: f64) {
        let command = Command {
            position: self.fingers.position(self.wanted),
            max_effort: self.fingers.effort,
        };
        let pending = self.action.begin_goal(Goal { command });
        let pending = pending.inspect_err(|e| tracing::warn!("gripper: {e}"));
        self.sent = Some(Sent {
            pending: pending.ok(),
            time,
        });
    }
}
