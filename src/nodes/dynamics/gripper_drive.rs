//! Drive of a gripper's joint. Commands and motions of the arm have no effect on this joint.

use super::{params::GripperParams, robot::Robot};
use crate::{
    control::{GripperGoal, GripperServo, GripperServoConfig},
    dynamics::Workspace,
    model::Model,
};

/// A gripper: its joint, its servo, and the closing time from the scenario.
pub struct GripperDrive {
    joint: usize,
    servo: GripperServo,
    /// Initial servo state.
    start: GripperServo,
    /// Effort of the last step \[N or N m\].
    effort: f64,
    /// Closing time \[s\] and the position to close to \[m or rad\].
    closing: Option<(f64, f64)>,
    has_closed: bool,
}

impl GripperDrive {
    /// Drive of a gripper, which holds its initial position. `rigid` is the model of the robot with deformable bodies
    /// undeformed.
    ///
    /// # Errors
    /// A line that names the parameter and the joints that there are.
    pub fn new(params: &GripperParams, robot: &Robot, rigid: &Model) -> Result<Self, String> {
        let model = robot.model();
        let name = &params.name;
        let Some(joint) = model.joint_index(&params.joint) else {
            let joints = model.joints().iter().map(|joint| joint.name.as_str());
            return Err(format!(
                "parameter {name}.joint: the robot has no joint '{}' that moves on its own; it has {}",
                params.joint,
                joints.collect::<Vec<_>>().join(", ")
            ));
        };
        if robot.loops().is_some() {
            return Err(format!(
                "parameter {name}.joint: joints of a robot with loop_closures do not move on their own; remove the gripper or the closures"
            ));
        }
        let limits = &model.joints()[joint].limits;
        let q = robot.state().q[joint];
        let config = GripperServoConfig {
            inertia: moved_inertia(rigid, robot, joint),
            damping: model.joints()[joint].damping,
            bandwidth: params.bandwidth,
            positions: [limits.lower, limits.upper],
            max_effort: params.max_effort.min(limits.effort),
            max_rate: params.max_velocity.min(limits.velocity),
        };
        let servo = GripperServo::new(config, q);
        Ok(Self {
            joint,
            start: servo.clone(),
            servo,
            effort: 0.0,
            closing: params.close_at.map(|at| (at, params.closed_position)),
            has_closed: false,
        })
    }

    /// Index of its joint.
    pub fn joint(&self) -> usize {
        self.joint
    }

    /// The goal, with its position within the limits.
    pub fn goal(&self) -> &GripperGoal {
        self.servo.goal()
    }

    /// Its effort in the last step \[N or N m\].
    pub fn effort(&self) -> f64 {
        self.effort
    }

    /// Longest step for which the servo may hold its effort \[s\].
    pub fn longest_step(&self) -> f64 {
        0.5 / self.servo.config().bandwidth
    }

    /// Moves to a goal from now on.
    pub fn set_goal(&mut self, robot: &Robot, goal: GripperGoal) {
        self.servo.set_goal(goal, robot.state().q[self.joint]);
    }

    /// Begins to close if the closing time has come at `time` \[s\].
    pub fn follow_schedule(&mut self, robot: &Robot, time: f64) {
        if let Some((at, position)) = self.closing
            && time >= at - 1e-9
            && !self.has_closed
        {
            self.has_closed = true;
            self.set_goal(robot, GripperGoal::at(position));
        }
    }

    /// Computes the effort for a step of `dt` \[s\], and sets it in the robot's input.
    pub fn hold_effort(&mut self, robot: &mut Robot, dt: f64) {
        let (q, qd) = (robot.state().q[self.joint], robot.state().qd[self.joint]);
        self.effort = self.servo.effort(q, qd, dt);
        robot.input_mut().efforts[self.joint] = self.effort;
    }

    /// Restores the initial state: the gripper holds its initial position, and will close at its closing time.
    pub fn reset(&mut self) {
        self.servo = self.start.clone();
        self.effort = 0.0;
        self.has_closed = false;
    }
}

/// Inertia that `joint` moves while the other joints are fixed and the base floats freely \[kg or kg m²\].
fn moved_inertia(model: &Model, robot: &Robot, joint: usize) -> f64 {
    let mut workspace = Workspace::new(model);
    workspace.set_positions(&robot.state().q);
    workspace.reduced_inertia()[(joint, joint)]
}
