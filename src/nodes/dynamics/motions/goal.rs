//! Goals of the action `follow_joint_trajectory`, from acceptance to result.

use super::{begin as begin_motion, check_free, engage, messages, spline, stop, trajectory_motion};
use crate::{
    control::commander::{GoalMonitor, JointPoint, Progress, Violation},
    msg::{
        control_msgs::follow_joint_trajectory::{Feedback, FollowJointTrajectory, Outcome},
        trajectory_msgs::JointTrajectoryPoint,
    },
    nodes::dynamics::{
        command_arbiter::Commander, messages::header, simulation::Simulation, world::World,
    },
    ros::{Goal, GoalRequest, Time},
};

/// Simulated time between two feedback messages \[s\], the same as in `joint_trajectory_controller`.
const FEEDBACK_PERIOD: f64 = 0.05;

/// A goal that is being executed.
pub struct ActiveGoal {
    goal: Goal<FollowJointTrajectory>,
    monitor: GoalMonitor,
    /// Indices of its joints.
    joints: Vec<usize>,
    start: f64,
    /// Time of the last step, and the desired and actual joint rates then.
    before: Option<(f64, Vec<f64>, Vec<f64>)>,
    feedback_due: f64,
}

/// Desired and actual motion of the joints, and tracking errors.
struct Comparison {
    desired: Vec<JointPoint>,
    actual: Vec<JointPoint>,
    errors: Vec<JointPoint>,
}

impl ActiveGoal {
    /// Whether a client has asked to cancel it.
    pub fn is_canceling(&self) -> bool {
        self.goal.is_canceling()
    }

    /// Ends the goal as cancelled.
    pub fn canceled(self, text: String) {
        self.goal.canceled(outcome(Outcome::SUCCESSFUL, text));
    }

    /// Aborts the goal, because its motion was ended from outside.
    pub fn abort(self, reason: &str) {
        tracing::warn!("follow_joint_trajectory: aborted, {reason}");
        let reason = reason.to_owned();
        self.goal.abort(outcome(Outcome::INVALID_GOAL, reason));
    }

    /// Compares the joints with the trajectory; `None` if the motion has ended. Accelerations are means since the last
    /// step.
    fn compare(&mut self, world: &World) -> Option<Comparison> {
        let (state, time) = (world.robot.state(), world.time());
        let references: Vec<JointPoint> = world.drive().references()?.collect();
        let rates = |of: &dyn Fn(usize) -> f64| -> Vec<f64> {
            self.joints.iter().map(|&j| of(j)).collect()
        };
        let now = (
            time,
            rates(&|j| references[j].rate),
            rates(&|j| state.qd[j]),
        );
        let before = self.before.replace(now.clone());
        let mean = |rates: &[f64], earlier: Option<&Vec<f64>>, k: usize| match (&before, earlier) {
            (Some((then, ..)), Some(earlier)) if time > *then => {
                (rates[k] - earlier[k]) / (time - then)
            }
            _ => 0.0,
        };
        let mut found = Comparison {
            desired: Vec::new(),
            actual: Vec::new(),
            errors: Vec::new(),
        };
        for (k, &j) in self.joints.iter().enumerate() {
            let desired = JointPoint {
                position: references[j].position,
                rate: now.1[k],
                acceleration: mean(&now.1, before.as_ref().map(|b| &b.1), k),
            };
            let actual = JointPoint {
                position: state.q[j],
                rate: now.2[k],
                acceleration: mean(&now.2, before.as_ref().map(|b| &b.2), k),
            };
            found.errors.push(JointPoint {
                position: desired.position - actual.position,
                rate: desired.rate - actual.rate,
                acceleration: desired.acceleration - actual.acceleration,
            });
            found.desired.push(desired);
            found.actual.push(actual);
        }
        Some(found)
    }

    fn send_feedback(&mut self, world: &World, found: &Comparison) {
        let time = world.time();
        if time < self.feedback_due {
            return;
        }
        self.feedback_due = time + FEEDBACK_PERIOD - 1e-9;
        let since = time - self.start;
        let stamp = Time::from_secs_f64(time);
        let base = &world.robot.model().frames()[0].name;
        self.goal.feedback(Feedback {
            header: header(stamp, base),
            joint_names: self.goal.goal.trajectory.joint_names.clone(),
            desired: point(&found.desired, since),
            actual: point(&found.actual, since),
            error: point(&found.errors, since),
            ..Feedback::default()
        });
    }

    fn describe(&self, what: &str, violation: &Violation) -> String {
        let name = &self.goal.goal.trajectory.joint_names[violation.joint];
        let Violation {
            quantity,
            error,
            tolerance,
            ..
        } = violation;
        format!(
            "joint '{name}': {quantity} error {error:.6} exceeds the {what} tolerance {tolerance}"
        )
    }
}

fn outcome(error_code: i32, error_string: String) -> Outcome {
    Outcome {
        error_code,
        error_string,
    }
}

/// Motion of the joints as a message, `since` \[s\] after the trajectory's start.
fn point(joints: &[JointPoint], since: f64) -> JointTrajectoryPoint {
    let list = |of: fn(&JointPoint) -> f64| joints.iter().map(of).collect();
    let nanos = (since.max(0.0) * 1e9).round() as i64;
    JointTrajectoryPoint {
        positions: list(|p| p.position),
        velocities: list(|p| p.rate),
        accelerations: list(|p| p.acceleration),
        effort: Vec::new(),
        time_from_start: crate::msg::builtin_interfaces::Duration {
            sec: (nanos / 1_000_000_000) as i32,
            nanosec: (nanos % 1_000_000_000) as u32,
        },
    }
}

/// Accepts and begins a goal, or rejects it. An accepted goal replaces the active one.
pub fn begin(simulation: &mut Simulation, request: GoalRequest<FollowJointTrajectory>) {
    let prepared =
        check_free(simulation, Commander::Action).and_then(|()| prepare(simulation, &request));
    let (motion, monitor, joints, start) = match prepared {
        Ok(prepared) => prepared,
        Err(problem) => {
            request.reject();
            let motions = &mut simulation.motions;
            (motions.refusals).report(&mut motions.status, "follow_joint_trajectory", &problem);
            return;
        }
    };
    let Some(goal) = request.accept() else {
        return;
    };
    // Cannot fail: checked above.
    if let Err(problem) = engage(simulation, Commander::Action) {
        return goal.abort(outcome(Outcome::INVALID_GOAL, problem));
    }
    if let Some(before) = simulation.motions.goal.take() {
        before.abort("it is replaced by another goal");
    }
    begin_motion(simulation, motion);
    let count = joints.len();
    simulation.motions.goal = Some(ActiveGoal {
        goal,
        monitor,
        joints,
        start,
        before: None,
        feedback_due: f64::NEG_INFINITY,
    });
    (simulation.motions.status).ok(format!(
        "a goal of follow_joint_trajectory for {count} joints"
    ));
}

type Prepared = (
    crate::control::commander::ArmMotion,
    GoalMonitor,
    Vec<usize>,
    f64,
);

fn prepare(
    simulation: &Simulation,
    request: &GoalRequest<FollowJointTrajectory>,
) -> Result<Prepared, String> {
    let of = |problem: String| format!("it {problem}");
    let goal = &request.goal;
    let world = &simulation.world;
    let (trajectory, start) =
        messages::trajectory(&goal.trajectory, world.robot.model(), world.time()).map_err(of)?;
    let tolerances =
        messages::tolerances(goal, world.robot.model(), &simulation.params.motions).map_err(of)?;
    let (spline, end) = spline(simulation, &trajectory, start)?;
    let motion = trajectory_motion(simulation, spline)?;
    let monitor = GoalMonitor::new(tolerances, end);
    Ok((motion, monitor, trajectory.joints().to_vec(), start))
}

/// After a step: sends feedback, and ends the goal if it is reached or a tolerance is violated.
pub fn follow(simulation: &mut Simulation) {
    let Some(mut active) = simulation.motions.goal.take() else {
        return;
    };
    let world = &simulation.world;
    let Some(found) = active.compare(world) else {
        return active.abort("the motion has ended");
    };
    active.send_feedback(world, &found);
    let time = world.time();
    match active.monitor.progress(time, &found.errors) {
        Progress::Running => simulation.motions.goal = Some(active),
        Progress::Succeeded => {
            simulation.motions.begun = None;
            simulation.commands.end_motion();
            let text = format!("the goal was reached at {time:.3} s");
            simulation.motions.status.ok(text.clone());
            active.goal.succeed(outcome(Outcome::SUCCESSFUL, text));
        }
        Progress::PathViolated(violation) => {
            let text = active.describe("path", &violation);
            fail(simulation, active, Outcome::PATH_TOLERANCE_VIOLATED, text);
        }
        Progress::GoalViolated(violation) => {
            let text = active.describe("goal", &violation);
            fail(simulation, active, Outcome::GOAL_TOLERANCE_VIOLATED, text);
        }
    }
}

/// Stops the joints and ends the goal as aborted.
fn fail(simulation: &mut Simulation, active: ActiveGoal, code: i32, text: String) {
    stop(simulation);
    let line = format!("follow_joint_trajectory: aborted, {text}; the joints are stopped");
    tracing::warn!("{line}");
    simulation.motions.status.warn(line);
    active.goal.abort(outcome(code, text));
}
