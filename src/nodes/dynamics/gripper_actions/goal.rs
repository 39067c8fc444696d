//! Goals of both gripper action types, and the messages on a gripper's state.

use crate::{
    control::GripperGoal,
    msg::{
        control_msgs::{
            gripper_command::{self, GripperCommand},
            parallel_gripper_command::{self, ParallelGripperCommand},
        },
        sensor_msgs::JointState,
    },
    nodes::dynamics::{messages::header, world::World},
    ros::{Goal, GoalRequest, Time},
};

/// Current state of a gripper.
#[derive(Debug, Clone)]
pub struct GripperState {
    joint: String,
    /// Simulated time \[s\].
    time: f64,
    /// Position of its joint \[m or rad\].
    pub position: f64,
    /// Its rate \[m/s or rad/s\].
    pub rate: f64,
    /// Its effort \[N or N m\].
    pub effort: f64,
}

impl GripperState {
    /// The state of gripper `i`, whose joint is called `joint`.
    pub fn of(world: &World, i: usize, joint: &str) -> Self {
        let gripper = &world.drive().grippers()[i];
        let state = world.robot.state();
        Self {
            joint: joint.to_owned(),
            time: world.time(),
            position: state.q[gripper.joint()],
            rate: state.qd[gripper.joint()],
            effort: gripper.effort(),
        }
    }

    fn message(&self) -> JointState {
        JointState {
            header: header(Time::from_secs_f64(self.time), ""),
            name: vec![self.joint.clone()],
            position: vec![self.position],
            velocity: vec![self.rate],
            effort: vec![self.effort],
        }
    }
}

/// A goal that waits to be accepted or rejected.
pub enum Request {
    /// Of `gripper_cmd`.
    Single(GoalRequest<GripperCommand>),
    /// Of `parallel_gripper_cmd`.
    Parallel(GoalRequest<ParallelGripperCommand>),
}

impl Request {
    /// The requested gripper goal; `joint` is the name of the gripper's joint.
    ///
    /// # Errors
    /// A line that names the field, its value, and what would be right.
    pub fn asked(&self, joint: &str) -> Result<GripperGoal, String> {
        match self {
            Self::Single(request) => {
                let command = &request.goal.command;
                Ok(GripperGoal {
                    position: finite("position", command.position)?,
                    max_effort: limit("max_effort", command.max_effort)?,
                    max_rate: f64::INFINITY,
                })
            }
            Self::Parallel(request) => parallel(&request.goal.command, joint),
        }
    }

    /// Rejects the request.
    pub fn reject(self) {
        match self {
            Self::Single(request) => request.reject(),
            Self::Parallel(request) => request.reject(),
        }
    }

    /// Accepts the request; `None` if it is rejected: its identity is not new, or too many goals are active.
    pub fn accept(self) -> Option<ActiveGoal> {
        match self {
            Self::Single(request) => request.accept().map(ActiveGoal::Single),
            Self::Parallel(request) => request.accept().map(ActiveGoal::Parallel),
        }
    }
}

/// Position, rate and effort of a goal of `parallel_gripper_cmd`.
fn parallel(command: &JointState, joint: &str) -> Result<GripperGoal, String> {
    if let Some(other) = command.name.iter().find(|name| *name != joint) {
        return Err(format!(
            "command.name has '{other}'; the gripper's joint is '{joint}'"
        ));
    }
    let &[position] = command.position.as_slice() else {
        return Err(format!(
            "command.position has {} numbers; give one, for joint '{joint}'",
            command.position.len()
        ));
    };
    let optional = |field: &str, values: &[f64]| match *values {
        [] => Ok(f64::INFINITY),
        [value] => limit(field, value),
        _ => Err(format!(
            "command.{field} has {} numbers; give one, or none for the gripper's own limit",
            values.len()
        )),
    };
    Ok(GripperGoal {
        position: finite("position", position)?,
        max_effort: optional("effort", &command.effort)?,
        max_rate: optional("velocity", &command.velocity)?,
    })
}

fn finite(field: &str, value: f64) -> Result<f64, String> {
    match value.is_finite() {
        true => Ok(value),
        false => Err(format!("command.{field} is {value}; it must be finite")),
    }
}

/// Checks a limit; zero stands for the gripper's own limit.
fn limit(field: &str, value: f64) -> Result<f64, String> {
    match value {
        0.0 => Ok(f64::INFINITY),
        value if value > 0.0 && value.is_finite() => Ok(value),
        value => Err(format!(
            "command.{field} is {value}; it must be above 0, or 0 for the gripper's own limit"
        )),
    }
}

/// A goal that is being executed.
pub enum ActiveGoal {
    /// Of `gripper_cmd`.
    Single(Goal<GripperCommand>),
    /// Of `parallel_gripper_cmd`.
    Parallel(Goal<ParallelGripperCommand>),
}

impl ActiveGoal {
    /// Whether a client has asked to cancel it.
    pub fn is_canceling(&self) -> bool {
        match self {
            Self::Single(goal) => goal.is_canceling(),
            Self::Parallel(goal) => goal.is_canceling(),
        }
    }

    /// Publishes feedback.
    pub fn feedback(&self, state: &GripperState) {
        match self {
            Self::Single(goal) => goal.feedback(gripper_command::Feedback {
                position: state.position,
                effort: state.effort,
                stalled: false,
                reached_goal: false,
            }),
            Self::Parallel(goal) => goal.feedback(parallel_gripper_command::Feedback {
                state: state.message(),
            }),
        }
    }

    /// Ends the goal as succeeded: reached, or `stalled`.
    pub fn succeed(self, state: &GripperState, stalled: bool) {
        match self {
            Self::Single(goal) => goal.succeed(single_outcome(state, stalled, !stalled)),
            Self::Parallel(goal) => goal.succeed(parallel_outcome(state, stalled, !stalled)),
        }
    }

    /// Ends the goal as aborted.
    pub fn abort(self, state: &GripperState, stalled: bool) {
        match self {
            Self::Single(goal) => goal.abort(single_outcome(state, stalled, false)),
            Self::Parallel(goal) => goal.abort(parallel_outcome(state, stalled, false)),
        }
    }

    /// Ends the goal as cancelled.
    pub fn canceled(self, state: &GripperState) {
        match self {
            Self::Single(goal) => goal.canceled(single_outcome(state, false, false)),
            Self::Parallel(goal) => goal.canceled(parallel_outcome(state, false, false)),
        }
    }
}

fn single_outcome(
    state: &GripperState,
    stalled: bool,
    reached_goal: bool,
) -> gripper_command::Outcome {
    gripper_command::Outcome {
        position: state.position,
        effort: state.effort,
        stalled,
        reached_goal,
    }
}

fn parallel_outcome(
    state: &GripperState,
    stalled: bool,
    reached_goal: bool,
) -> parallel_gripper_command::Outcome {
    parallel_gripper_command::Outcome {
        state: state.message(),
        stalled,
        reached_goal,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refusal(command: &JointState) -> String {
        parallel(command, "left").unwrap_err()
    }

    #[test]
    fn goals_that_are_wrong_are_refused_with_the_reason() {
        let right = JointState {
            name: vec!["left".to_owned()],
            position: vec![0.02],
            effort: vec![30.0],
            ..JointState::default()
        };
        let expected = GripperGoal {
            position: 0.02,
            max_effort: 30.0,
            max_rate: f64::INFINITY,
        };
        assert_eq!(parallel(&right, "left"), Ok(expected));
        let other = JointState {
            name: vec!["elbow".to_owned()],
            ..right.clone()
        };
        assert!(refusal(&other).contains("'elbow'; the gripper's joint is 'left'"));
        let none = JointState {
            position: Vec::new(),
            ..right.clone()
        };
        assert!(refusal(&none).contains("position has 0 numbers"));
        let nan = JointState {
            position: vec![f64::NAN],
            ..right.clone()
        };
        assert!(refusal(&nan).contains("position is NaN; it must be finite"));
        let negative = JointState {
            effort: vec![-1.0],
            ..right.clone()
        };
        assert!(refusal(&negative).contains("effort is -1; it must be above 0"));
        let many = JointState {
            velocity: vec![0.1, 0.2],
            ..right
        };
        assert!(refusal(&many).contains("velocity has 2 numbers"));
    }
}
