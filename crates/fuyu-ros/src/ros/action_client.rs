//! Action clients: send a goal, follow its feedback, get its result, cancel it.

use std::{
    hash::{BuildHasher, RandomState},
    sync::{Mutex, PoisonError},
    time::Duration,
};

use super::{CallError, Node, NodeError, PendingCall, Qos, ServiceClient, Subscription};
use crate::msg::{
    Action,
    action_msgs::{
        GoalInfo,
        services::{CancelGoal, CancelGoalRequest, CancelGoalResponse},
    },
    unique_identifier_msgs::UUID,
};

/// Largest number of feedback messages that wait for the program; beyond it the oldest are dropped.
const FEEDBACK_DEPTH: usize = 100;

/// Sends goals to an action server of another node.
pub struct ActionClient<A: Action> {
    send_goal: ServiceClient<A::SendGoal>,
    get_result: ServiceClient<A::GetResult>,
    cancel_goal: ServiceClient<CancelGoal>,
    feedback: Subscription<A::FeedbackMessage>,
    /// Received feedback of all goals, in order of arrival.
    received: Mutex<Vec<(UUID, A::Feedback)>>,
}

impl<A: Action> ActionClient<A> {
    /// A client of the action `name`, which is expanded and remapped.
    ///
    /// # Errors
    /// [`NodeError::Name`] for a name against the rules, [`NodeError::Dds`] if DDS refuses.
    pub fn new(node: &Node, name: &str) -> Result<Self, NodeError> {
        let name = node.core.names.service(name)?;
        let below = |part: &str| format!("{name}/_action/{part}");
        Ok(Self {
            feedback: node.subscribe(&below("feedback"), Qos::RELIABLE.depth(FEEDBACK_DEPTH))?,
            get_result: node.client(&below("get_result"))?,
            cancel_goal: node.client(&below("cancel_goal"))?,
            send_goal: node.client(&below("send_goal"))?,
            received: Mutex::default(),
        })
    }

    /// Waits until a server has been discovered, at most `timeout` (wall time). Returns whether one was discovered.
    pub fn wait_for_server(&self, timeout: Duration) -> bool {
        self.send_goal.wait_for_service(timeout)
            && self.get_result.wait_for_service(timeout)
            && self.cancel_goal.wait_for_service(timeout)
    }

    /// Sends a goal and waits for its acceptance, at most `timeout` (wall time). Returns `None` if the server rejects
    /// it.
    ///
    /// # Errors
    /// [`CallError`] if the server does not respond.
    pub fn send_goal(
        &self,
        goal: A::Goal,
        timeout: Duration,
    ) -> Result<Option<GoalHandle<'_, A>>, CallError> {
        let id = random_id();
        let request = A::goal_request(id.clone(), goal);
        let response = self.send_goal.call(&request, timeout)?;
        if !A::is_accepted(&response) {
            return Ok(None);
        }
        if !self.get_result.wait_for_service(timeout) {
            return Err(CallError::Timeout {
                service: self.get_result.name().to_owned(),
                timeout,
            });
        }
        Ok(Some(GoalHandle {
            result: self.get_result.send(&A::result_request(id.clone()))?,
            client: self,
            id,
        }))
    }

    /// Sends a goal without waiting for its acceptance, for programs that do not need the result. The server's response
    /// wakes the node's program.
    ///
    /// # Errors
    /// [`CallError::NotSent`] if the transport does not accept the request.
    pub fn begin_goal(&self, goal: A::Goal) -> Result<PendingGoal<A>, CallError> {
        let request = A::goal_request(random_id(), goal);
        let response = self.send_goal.send(&request)?;
        Ok(PendingGoal { response })
    }

    /// Removes the feedback of one goal from the received messages and returns it.
    fn take_feedback(&self, id: &UUID) -> Vec<A::Feedback> {
        let mut received = self.received.lock().unwrap_or_else(PoisonError::into_inner);
        while let Some(message) = self.feedback.take() {
            received.push(A::feedback_of(message.message));
        }
        let surplus = received.len().saturating_sub(FEEDBACK_DEPTH);
        received.drain(..surplus);
        let (own, others) = received.drain(..).partition(|(goal, _)| goal == id);
        *received = others;
        drop(received);
        let own: Vec<(UUID, A::Feedback)> = own;
        own.into_iter().map(|(_, feedback)| feedback).collect()
    }
}

/// A goal that the server has not accepted or rejected yet, from [`ActionClient::begin_goal`].
pub struct PendingGoal<A: Action> {
    response: PendingCall<A::SendGoal>,
}

impl<A: Action> PendingGoal<A> {
    /// Whether the server accepts the goal: returned once, after its response has arrived.
    pub fn is_accepted(&self) -> Option<bool> {
        self.response
            .take()
            .map(|response| A::is_accepted(&response))
    }
}

/// A goal that the server has accepted. Its feedback and its result wake the node's program.
pub struct GoalHandle<'a, A: Action> {
    client: &'a ActionClient<A>,
    id: UUID,
    result: PendingCall<A::GetResult>,
}

impl<A: Action> GoalHandle<'_, A> {
    /// Id of the goal.
    pub fn id(&self) -> &UUID {
        &self.id
    }

    /// Feedback of the goal since the last call, oldest first.
    pub fn feedback(&self) -> Vec<A::Feedback> {
        self.client.take_feedback(&self.id)
    }

    /// Status (a constant of [`GoalStatus`](crate::msg::action_msgs::GoalStatus)) and result: returned once, after the
    /// goal has ended.
    pub fn result(&self) -> Option<(i8, A::Outcome)> {
        self.result.take().map(A::result_of)
    }

    /// Requests the cancellation of the goal; waits for the server's response, at most `timeout` (wall time).
    ///
    /// # Errors
    /// [`CallError`] if the server does not respond.
    pub fn cancel(&self, timeout: Duration) -> Result<CancelGoalResponse, CallError> {
        let goal_info = GoalInfo {
            goal_id: self.id.clone(),
            ..GoalInfo::default()
        };
        let request = CancelGoalRequest { goal_info };
        self.client.cancel_goal.call(&request, timeout)
    }
}

/// A random UUID of version 4. `RandomState` has random keys.
fn random_id() -> UUID {
    let mut bytes = [0; 16];
    for half in bytes.chunks_mut(8) {
        half.copy_from_slice(&RandomState::new().hash_one(0).to_le_bytes());
    }
    bytes[6] = bytes[6] & 0x0f | 0x40;
    bytes[8] = bytes[8] & 0x3f | 0x80;
    UUID { uuid: bytes }
}
