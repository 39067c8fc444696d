//! Actions of the robot's grippers.
//!
//! | interface | type |
//! | --- | --- |
//! | action `NAME/gripper_cmd` | control_msgs/GripperCommand |
//! | action `NAME/parallel_gripper_cmd` | control_msgs/ParallelGripperCommand |
//!
//! Goals of both actions move the gripper `NAME`; a new goal replaces the previous one. After a goal is over, the
//! gripper stays at the goal, or keeps pressing. Gripper goals do not depend on which commander holds the arm. Goals
//! are checked and answered by the simulation thread, between two steps, like service calls.

mod goal;

use super::{
    gripper_drive::GripperDrive, params::GripperParams, simulation::Simulation,
    step_status::StepStatus, world::World,
};
use crate::{
    control::{GripperGoal, GripperMonitor, GripperProgress},
    msg::control_msgs::{
        gripper_command::GripperCommand, parallel_gripper_command::ParallelGripperCommand,
    },
    ros::{ActionServer, Node, NodeError},
};
use goal::{ActiveGoal, GripperState, Request};

/// Simulated time between two feedback messages \[s\].
const FEEDBACK_PERIOD: f64 = 0.05;

/// Maximum number of goals per gripper that one call of [`take`] handles, so that a flood cannot stall simulated time.
const MAX_GOALS: usize = 16;

/// The actions of all grippers.
pub struct GripperActions {
    grippers: Vec<Gripper>,
}

/// The actions of one gripper.
struct Gripper {
    params: GripperParams,
    single: ActionServer<GripperCommand>,
    parallel: ActionServer<ParallelGripperCommand>,
    active: Option<Execution>,
    status: StepStatus,
}

/// A goal that is being executed.
struct Execution {
    goal: ActiveGoal,
    monitor: GripperMonitor,
    feedback_due: f64,
}

impl GripperActions {
    /// Offers the actions.
    ///
    /// # Errors
    /// If a name is invalid or DDS reports an error.
    pub fn new(node: &Node, params: &[GripperParams]) -> Result<Self, NodeError> {
        let grippers = params.iter().map(|params| {
            let name = &params.name;
            let status = node.diagnostics().status(&format!("gripper {name}"));
            let mut status = StepStatus::new(status);
            status.ok("no goal was given yet");
            Ok(Gripper {
                single: ActionServer::with_requests(node, &format!("{name}/gripper_cmd"))?,
                parallel: ActionServer::with_requests(
                    node,
                    &format!("{name}/parallel_gripper_cmd"),
                )?,
                params: params.clone(),
                active: None,
                status,
            })
        });
        let grippers = grippers.collect::<Result<_, NodeError>>()?;
        Ok(Self { grippers })
    }

    /// Rejects pending goals.
    pub fn discard(&mut self, reason: &str) {
        for gripper in &mut self.grippers {
            while let Some(request) = gripper.next_request() {
                request.reject();
                gripper.refuse(reason);
            }
        }
    }

    /// Aborts active goals. The grippers keep their motion.
    pub fn abort(&mut self, world: &World, reason: &str) {
        for (i, gripper) in self.grippers.iter_mut().enumerate() {
            if let Some(execution) = gripper.active.take() {
                let state = GripperState::of(world, i, &gripper.params.joint);
                execution.goal.abort(&state, false);
                tracing::warn!("gripper {}: goal aborted, {reason}", gripper.params.name);
            }
        }
    }
}

impl Gripper {
    fn next_request(&self) -> Option<Request> {
        let single = self.single.take_request().map(Request::Single);
        single.or_else(|| self.parallel.take_request().map(Request::Parallel))
    }

    fn refuse(&mut self, problem: &str) {
        let line = format!("goal refused, {problem}");
        tracing::warn!("gripper {}: {line}", self.params.name);
        self.status.warn(line);
    }

    /// Accepts or rejects a goal request. Returns the gripper goal if accepted.
    fn begin(&mut self, request: Request, state: &GripperState, time: f64) -> Option<GripperGoal> {
        let asked = match request.asked(&self.params.joint) {
            Ok(asked) => asked,
            Err(problem) => {
                request.reject();
                self.refuse(&problem);
                return None;
            }
        };
        let goal = request.accept()?;
        if let Some(before) = self.active.take() {
            before.goal.abort(state, false);
        }
        let GripperParams {
            goal_tolerance,
            stall_velocity_threshold,
            stall_timeout,
            ..
        } = self.params;
        self.active = Some(Execution {
            goal,
            monitor: GripperMonitor::new(
                goal_tolerance,
                stall_velocity_threshold,
                stall_timeout,
                time,
            ),
            feedback_due: f64::NEG_INFINITY,
        });
        self.status.ok(format!("moves to {}", asked.position));
        Some(asked)
    }

    /// After a step: sends feedback, and ends the goal if it is reached or the gripper stalls.
    fn follow(&mut self, world: &World, drive: &GripperDrive, state: &GripperState) {
        let Some(mut execution) = self.active.take() else {
            return;
        };
        let time = world.time();
        if time >= execution.feedback_due {
            execution.feedback_due = time + FEEDBACK_PERIOD - 1e-9;
            execution.goal.feedback(state);
        }
        let monitor = &mut execution.monitor;
        let wanted = drive.goal().position;
        match monitor.progress(time, wanted, state.position, state.rate) {
            GripperProgress::Moving => self.active = Some(execution),
            GripperProgress::Reached => {
                self.status.ok(format!("is at {wanted}"));
                execution.goal.succeed(state, false);
            }
            GripperProgress::Stalled => {
                let (position, effort) = (state.position, state.effort);
                let text = format!("does not move at {position:.4}: it presses with {effort:.2}");
                self.status.ok(text);
                match self.params.allow_stalling {
                    true => execution.goal.succeed(state, true),
                    false => execution.goal.abort(state, true),
                }
            }
        }
    }
}

/// Handles pending goals, and cancellations: a gripper whose goal is cancelled holds its position.
pub fn take(simulation: &mut Simulation) {
    let Simulation {
        grippers,
        world,
        clock,
        ..
    } = simulation;
    for (i, gripper) in grippers.grippers.iter_mut().enumerate() {
        let is_cancelled = |execution: &mut Execution| execution.goal.is_canceling();
        if let Some(execution) = gripper.active.take_if(is_cancelled) {
            let state = GripperState::of(world, i, &gripper.params.joint);
            let goal = *world.drive().grippers()[i].goal();
            let position = state.position;
            world.set_gripper_goal(i, GripperGoal { position, ..goal });
            gripper.status.ok("cancelled: it holds its position");
            execution.goal.canceled(&state);
        }
        for _ in 0..MAX_GOALS {
            let Some(request) = gripper.next_request() else {
                break;
            };
            let state = GripperState::of(world, i, &gripper.params.joint);
            if let Some(goal) = gripper.begin(request, &state, world.time()) {
                world.set_gripper_goal(i, goal);
                clock.release();
            }
        }
    }
}

/// After a step: sends feedback, and ends goals that are reached or stalled.
pub fn follow(simulation: &mut Simulation) {
    let Simulation {
        grippers, world, ..
    } = simulation;
    for (i, gripper) in grippers.grippers.iter_mut().enumerate() {
        if gripper.active.is_some() {
            let state = GripperState::of(world, i, &gripper.params.joint);
            gripper.follow(world, &world.drive().grippers()[i], &state);
        }
    }
}
