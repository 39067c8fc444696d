//! Parameters of grippers: their joints, limits, and the criteria for the end of a goal.

use super::numbers::{limit, not_negative, scheduled_time};
use crate::{nodes::named_lists::declare_each, ros::Declare};

/// Parameters of a gripper.
#[derive(Debug, Clone, PartialEq)]
pub struct GripperParams {
    /// Its name, below which its actions are.
    pub name: String,
    /// The joint that moves it; other joints may follow it by `mimic`.
    pub joint: String,
    /// Largest effort \[N or N m\]; infinite for the limit of the joint.
    pub max_effort: f64,
    /// Largest rate \[m/s or rad/s\].
    pub max_velocity: f64,
    /// Natural frequency of the servo \[rad/s\].
    pub bandwidth: f64,
    /// Largest distance from a goal at which the goal counts as reached \[m or rad\].
    pub goal_tolerance: f64,
    /// Rate below which the gripper counts as not moving \[m/s or rad/s\].
    pub stall_velocity_threshold: f64,
    /// Time without motion after which it counts as stalled \[s\].
    pub stall_timeout: f64,
    /// Whether a goal succeeds if the gripper stalls on the way.
    pub allow_stalling: bool,
    /// Time at which it closes \[s\]; `None` if it closes on command only.
    pub close_at: Option<f64>,
    /// Position to which it closes then \[m or rad\].
    pub closed_position: f64,
}

/// Declares `grippers` and the parameters of each, and reads them.
///
/// # Errors
/// A line that names the parameter.
pub(super) fn declare_grippers(declare: &mut Declare) -> Result<Vec<GripperParams>, String> {
    let description = "Names of the robot's grippers";
    let all = declare_each(declare, "grippers", description, GripperParams::declare)?;
    for (i, gripper) in all.iter().enumerate() {
        if let Some(other) = all[..i].iter().find(|other| other.joint == gripper.joint) {
            return Err(format!(
                "parameter {}.joint: '{}' is the joint of gripper '{}' already; give each gripper its own joint",
                gripper.name, gripper.joint, other.name
            ));
        }
    }
    Ok(all)
}

impl GripperParams {
    fn declare(declare: &mut Declare, name: String) -> Self {
        let key = |parameter: &str| format!("{name}.{parameter}");
        let joint = declare
            .required(
                &key("joint"),
                "Joint that moves the gripper; other fingers follow it by mimic",
            )
            .read_only()
            .value();
        let max_effort = limit(
            declare,
            &key("max_effort"),
            "Largest effort of the gripper's joint, below that of its description [N or N m]",
        );
        let max_velocity = declare
            .param(
                &key("max_velocity"),
                0.05,
                "Rate at which the gripper opens and closes [m/s or rad/s]",
            )
            .range(1e-6, 1e3)
            .read_only()
            .value();
        let bandwidth = declare
            .param(
                &key("bandwidth"),
                20.0,
                "Natural frequency of the gripper's servo [rad/s]",
            )
            .range(1e-2, 1e4)
            .read_only()
            .value();
        let goal_tolerance = not_negative(
            declare,
            &key("goal_tolerance"),
            0.01,
            "Largest distance from a goal at which it is reached [m or rad]",
        );
        let stall_velocity_threshold = not_negative(
            declare,
            &key("stall_velocity_threshold"),
            0.001,
            "Rate below which the gripper does not move [m/s or rad/s]",
        );
        let stall_timeout = not_negative(
            declare,
            &key("stall_timeout"),
            1.0,
            "How long the gripper must not move, away from its goal, to stall [s]",
        );
        let allow_stalling = declare
            .param(
                &key("allow_stalling"),
                false,
                "A goal succeeds if the gripper stalls; otherwise it is aborted. The gripper presses on in both cases",
            )
            .read_only()
            .value();
        let close_at = scheduled_time(
            declare,
            &key("close_at"),
            "Time at which the gripper closes, with max_effort",
        );
        let closed_position = declare
            .param(
                &key("closed_position"),
                0.0,
                "Position of the joint to which the gripper closes at close_at [m or rad]",
            )
            .range(-1e6, 1e6)
            .read_only()
            .value();
        Self {
            joint,
            max_effort,
            max_velocity,
            bandwidth,
            goal_tolerance,
            stall_velocity_threshold,
            stall_timeout,
            allow_stalling,
            close_at,
            closed_position,
            name,
        }
    }
}
