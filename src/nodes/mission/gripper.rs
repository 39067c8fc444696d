//! The gripper behind the services `attach` and `detach` of the dynamics node.

use crate::{
    control::capture::Gripper,
    msg::std_srvs::{Trigger, TriggerRequest},
    ros::{Node, NodeError, PendingCall, ServiceClient},
};

/// Follows the mission's commands to the gripper.
pub(super) struct GripperServices {
    attach: ServiceClient<Trigger>,
    detach: ServiceClient<Trigger>,
    wanted: Gripper,
    pending: Option<PendingCall<Trigger>>,
    holds: Option<bool>,
}

impl GripperServices {
    /// Clients of the services.
    ///
    /// # Errors
    /// When DDS refuses.
    pub fn new(node: &Node) -> Result<Self, NodeError> {
        Ok(Self {
            attach: node.client("dynamics/attach")?,
            detach: node.client("dynamics/detach")?,
            wanted: Gripper::Open,
            pending: None,
            holds: None,
        })
    }

    /// Calls the service that `wanted` needs, once. Returns whether the gripper holds, if it has answered.
    pub fn follow(&mut self, wanted: Gripper) -> Option<bool> {
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
