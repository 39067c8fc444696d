//! Action servers: long-running goals with feedback, a result and cancellation.
//!
//! In the ROS graph an action consists of three services and two topics below `NAME/_action/`, as in rcl_action.

use std::{
    collections::VecDeque,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
    time::{Duration, Instant},
};

use super::{
    Clock, Node, NodeError, Publisher, Qos,
    service::{Reply, ServiceServer},
};
use crate::msg::{
    Action,
    action_msgs::{
        GoalInfo, GoalStatus, GoalStatusArray,
        services::{CancelGoal, CancelGoalRequest, CancelGoalResponse},
    },
    unique_identifier_msgs::UUID,
};

/// How long the result of a goal is kept after its end, as in rcl.
const KEPT: Duration = Duration::from_secs(15 * 60);
/// Largest number of goals, running and ended, that are remembered. Beyond it the goal that ended first is discarded;
/// if none has ended, new goals are rejected.
const KNOWN: usize = 64;
/// Largest number of pending requests for the result of a goal that has not ended.
const MAX_RESULT_REQUESTS: usize = 64;

/// Serves an action until it is dropped. Goals wait in a queue until the program takes them; a new goal wakes the
/// program.
pub struct ActionServer<A: Action> {
    shared: Arc<Shared<A>>,
    _services: [ServiceServer; 3],
}

struct Shared<A: Action> {
    goals: Mutex<Vec<Known<A>>>,
    /// Accepted goals that the program has not taken yet.
    waiting: Mutex<VecDeque<(UUID, A::Goal)>>,
    /// Goals that the program has not accepted or rejected yet.
    requests: Mutex<VecDeque<Request<A>>>,
    feedback: Publisher<A::FeedbackMessage>,
    status: Publisher<GoalStatusArray>,
    clock: Clock,
}

type Request<A> = (UUID, <A as Action>::Goal, Reply<<A as Action>::SendGoal>);

/// A goal that clients may refer to: running, or ended a short time ago.
struct Known<A: Action> {
    info: GoalInfo,
    status: i8,
    outcome: Option<A::Outcome>,
    ended: Option<Instant>,
    result_requests: Vec<Reply<A::GetResult>>,
}

impl<A: Action> ActionServer<A> {
    /// Serves the action `name`, which is expanded and remapped.
    ///
    /// # Errors
    /// [`NodeError::Name`] for a name against the rules, [`NodeError::Dds`] if DDS refuses.
    pub fn new(node: &Node, name: &str) -> Result<Self, NodeError> {
        Self::serve(node, name, false)
    }

    /// As [`Self::new`], but the program decides which goals are accepted: it takes them by [`Self::take_request`].
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn with_requests(node: &Node, name: &str) -> Result<Self, NodeError> {
        Self::serve(node, name, true)
    }

    fn serve(node: &Node, name: &str, is_asked: bool) -> Result<Self, NodeError> {
        // As in rcl, a remap rule for the action's name applies to all of its services and topics.
        let name = node.core.names.service(name)?;
        let below = |part: &str| format!("{name}/_action/{part}");
        let shared = Arc::new(Shared {
            goals: Mutex::default(),
            waiting: Mutex::default(),
            requests: Mutex::default(),
            feedback: node.advertise(&below("feedback"), Qos::RELIABLE)?,
            status: node.advertise(&below("status"), Qos::LATCHED)?,
            clock: node.clock().clone(),
        });
        let send = {
            let (shared, events) = (Arc::downgrade(&shared), Arc::clone(&node.core.events));
            node.serve_later::<A::SendGoal>(&below("send_goal"), move |request, reply| {
                if let Some(shared) = shared.upgrade() {
                    let (id, goal) = A::goal_of(request);
                    match is_asked {
                        true => shared.ask_program(id, goal, reply),
                        false => {
                            let stamp = shared.accept(&id, goal);
                            respond::<A>(reply, stamp);
                        }
                    }
                    events.notify();
                }
            })?
        };
        let cancel = {
            let (shared, events) = (Arc::downgrade(&shared), Arc::clone(&node.core.events));
            node.serve_later::<CancelGoal>(&below("cancel_goal"), move |request, reply| {
                if let Some(shared) = shared.upgrade() {
                    reply.send(&shared.cancel(&request));
                    events.notify();
                }
            })?
        };
        let result = {
            let shared = Arc::downgrade(&shared);
            node.serve_later::<A::GetResult>(&below("get_result"), move |request, reply| {
                if let Some(shared) = shared.upgrade() {
                    shared.ask(&A::requested_goal(request), reply);
                }
            })?
        };
        Ok(Self {
            shared,
            _services: [send, cancel, result],
        })
    }

    /// Takes the oldest goal that waits to be accepted or rejected ([`Self::with_requests`]).
    pub fn take_request(&self) -> Option<GoalRequest<A>> {
        let requests = &self.shared.requests;
        let next = requests
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .pop_front();
        let (id, goal, reply) = next?;
        Some(GoalRequest {
            goal,
            id,
            reply,
            shared: Arc::clone(&self.shared),
        })
    }

    /// Takes the oldest accepted goal; its status becomes "executing".
    pub fn take(&self) -> Option<Goal<A>> {
        let waiting = &self.shared.waiting;
        let next = waiting
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .pop_front();
        let (id, goal) = next?;
        // A goal that was cancelled while it waited keeps the status "canceling".
        self.shared
            .change(&id, GoalStatus::STATUS_EXECUTING, |status| {
                status == GoalStatus::STATUS_ACCEPTED
            });
        Some(Goal {
            goal,
            id,
            shared: Arc::clone(&self.shared),
            ended: false,
        })
    }
}

/// A goal that the program has to accept or reject. If it is dropped, the client gets no response.
pub struct GoalRequest<A: Action> {
    /// Goal of the client.
    pub goal: A::Goal,
    id: UUID,
    reply: Reply<A::SendGoal>,
    shared: Arc<Shared<A>>,
}

impl<A: Action> GoalRequest<A> {
    /// Accepts the goal; its status becomes "executing". Returns `None` if there are too many goals or the goal's id is
    /// not new: the goal is then rejected.
    pub fn accept(self) -> Option<Goal<A>> {
        let Self {
            goal,
            id,
            reply,
            shared,
        } = self;
        let stamp = shared.register(&id);
        let is_accepted = stamp.is_some();
        respond::<A>(reply, stamp);
        if !is_accepted {
            return None;
        }
        shared.change(&id, GoalStatus::STATUS_EXECUTING, |status| {
            status == GoalStatus::STATUS_ACCEPTED
        });
        Some(Goal {
            goal,
            id,
            shared,
            ended: false,
        })
    }

    /// Rejects the goal.
    pub fn reject(self) {
        respond::<A>(self.reply, None);
    }
}

/// Responds to the client with the time at which its goal was accepted, or with a rejection.
fn respond<A: Action>(
    reply: Reply<A::SendGoal>,
    stamp: Option<crate::msg::builtin_interfaces::Time>,
) {
    let is_accepted = stamp.is_some();
    reply.send(&A::goal_response(is_accepted, stamp.unwrap_or_default()));
}

/// A goal that is being executed. Dropping it before it has ended aborts it.
pub struct Goal<A: Action> {
    /// Goal of the client.
    pub goal: A::Goal,
    id: UUID,
    shared: Arc<Shared<A>>,
    ended: bool,
}

impl<A: Action> Goal<A> {
    /// Publishes feedback.
    pub fn feedback(&self, feedback: A::Feedback) {
        let message = A::feedback_message(self.id.clone(), feedback);
        self.shared.feedback.publish(&message);
    }

    /// Whether a client has requested the cancellation of the goal.
    pub fn is_canceling(&self) -> bool {
        let goals = self.shared.lock();
        let known = goals.iter().find(|k| k.info.goal_id == self.id);
        known.is_some_and(|k| k.status == GoalStatus::STATUS_CANCELING)
    }

    /// Ends the goal as succeeded.
    pub fn succeed(self, outcome: A::Outcome) {
        self.end(GoalStatus::STATUS_SUCCEEDED, outcome);
    }

    /// Ends the goal as canceled, after a client's request.
    pub fn canceled(self, outcome: A::Outcome) {
        self.end(GoalStatus::STATUS_CANCELED, outcome);
    }

    /// Ends the goal as aborted.
    pub fn abort(self, outcome: A::Outcome) {
        self.end(GoalStatus::STATUS_ABORTED, outcome);
    }

    fn end(mut self, status: i8, outcome: A::Outcome) {
        self.ended = true;
        self.shared.end(&self.id, status, outcome);
    }
}

impl<A: Action> Drop for Goal<A> {
    fn drop(&mut self) {
        if !self.ended {
            let outcome = A::Outcome::default();
            self.shared
                .end(&self.id, GoalStatus::STATUS_ABORTED, outcome);
        }
    }
}

impl<A: Action> Shared<A> {
    fn lock(&self) -> MutexGuard<'_, Vec<Known<A>>> {
        self.goals.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds a goal for the program to take. Returns the time of acceptance, or `None` if the goal is rejected.
    fn accept(&self, id: &UUID, goal: A::Goal) -> Option<crate::msg::builtin_interfaces::Time> {
        let stamp = self.register(id)?;
        let mut waiting = self.waiting.lock().unwrap_or_else(PoisonError::into_inner);
        waiting.push_back((id.clone(), goal));
        Some(stamp)
    }

    /// Queues a goal for the program to accept or reject; rejects it at once if too many wait.
    fn ask_program(&self, id: UUID, goal: A::Goal, reply: Reply<A::SendGoal>) {
        let mut requests = self.requests.lock().unwrap_or_else(PoisonError::into_inner);
        if requests.len() < KNOWN {
            requests.push_back((id, goal, reply));
        } else {
            drop(requests);
            respond::<A>(reply, None);
        }
    }

    /// Registers a new goal. Returns the time of acceptance, or `None` if the goal is rejected.
    fn register(&self, id: &UUID) -> Option<crate::msg::builtin_interfaces::Time> {
        let mut goals = self.lock();
        let old = |k: &Known<A>| k.ended.is_some_and(|at| at.elapsed() > KEPT);
        goals.retain(|k| !old(k));
        if goals.iter().any(|k| k.info.goal_id == *id) {
            return None;
        }
        if goals.len() >= KNOWN {
            let ended = goals.iter().position(|k| k.ended.is_some())?;
            goals.remove(ended);
        }
        let stamp: crate::msg::builtin_interfaces::Time = self.clock.now().into();
        goals.push(Known {
            info: GoalInfo {
                goal_id: id.clone(),
                stamp: stamp.clone(),
            },
            status: GoalStatus::STATUS_ACCEPTED,
            outcome: None,
            ended: None,
            result_requests: Vec::new(),
        });
        self.publish(&goals);
        Some(stamp)
    }

    /// Cancels the selected goals. The selection is that of rcl_action: by id, by time, by both, or all goals.
    fn cancel(&self, request: &CancelGoalRequest) -> CancelGoalResponse {
        let (id, until) = (&request.goal_info.goal_id, request.goal_info.stamp.nanos());
        let by_id = *id != UUID::default();
        let mut goals = self.lock();
        let known = goals.iter().find(|k| k.info.goal_id == *id);
        let over = known.is_some_and(|k| k.ended.is_some());
        let unknown = known.is_none();
        let mut canceling = Vec::new();
        for known in goals.iter_mut().filter(|k| k.ended.is_none()) {
            let named = known.info.goal_id == *id;
            let early = until != 0 && known.info.stamp.nanos() <= until;
            if named || early || (!by_id && until == 0) {
                known.status = GoalStatus::STATUS_CANCELING;
                canceling.push(known.info.clone());
            }
        }
        self.publish(&goals);
        let return_code = match (by_id && canceling.is_empty(), unknown, over) {
            (true, true, _) => CancelGoalResponse::ERROR_UNKNOWN_GOAL_ID,
            (true, _, true) => CancelGoalResponse::ERROR_GOAL_TERMINATED,
            _ => CancelGoalResponse::ERROR_NONE,
        };
        CancelGoalResponse {
            return_code,
            goals_canceling: canceling,
        }
    }

    /// Replies with the result of a goal: at once if the goal has ended or is unknown, otherwise when it ends.
    fn ask(&self, id: &UUID, reply: Reply<A::GetResult>) {
        let mut goals = self.lock();
        match goals.iter_mut().find(|k| k.info.goal_id == *id) {
            None => reply.send(&A::result_response(
                GoalStatus::STATUS_UNKNOWN,
                A::Outcome::default(),
            )),
            Some(known) => match &known.outcome {
                Some(outcome) => reply.send(&A::result_response(known.status, outcome.clone())),
                None if known.result_requests.len() < MAX_RESULT_REQUESTS => {
                    known.result_requests.push(reply)
                }
                // Too many requests are pending: a client keeps repeating its request for a result that does not exist
                // yet.
                None => {}
            },
        }
    }

    fn change(&self, id: &UUID, status: i8, from: impl Fn(i8) -> bool) {
        let mut goals = self.lock();
        let known = goals.iter_mut().find(|k| k.info.goal_id == *id);
        if let Some(known) = known.filter(|k| from(k.status)) {
            known.status = status;
            self.publish(&goals);
        }
    }

    fn end(&self, id: &UUID, status: i8, outcome: A::Outcome) {
        let mut goals = self.lock();
        let Some(known) = goals.iter_mut().find(|k| k.info.goal_id == *id) else {
            return;
        };
        known.status = status;
        known.ended = Some(Instant::now());
        for reply in known.result_requests.drain(..) {
            reply.send(&A::result_response(status, outcome.clone()));
        }
        known.outcome = Some(outcome);
        self.publish(&goals);
    }

    fn publish(&self, goals: &[Known<A>]) {
        let statuses = goals.iter().map(|k| GoalStatus {
            goal_info: k.info.clone(),
            status: k.status,
        });
        self.status.publish(&GoalStatusArray {
            status_list: statuses.collect(),
        });
    }
}
