//! Parameters of the position servo and of motions: trajectories, paths and twists.

use std::sync::Arc;

use crate::{
    control::commander::{KeptTip, StateTolerance, TwistServoConfig},
    nodes::choice,
    ros::{Declare, Param},
};

/// How redundant joints reduce the reaction of the arm's motion on the base.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BaseReaction {
    /// Not at all: the joints move as commanded.
    Free,
    /// They turn the base as little as possible while the tip keeps its commanded motion.
    Least(KeptTip),
}

impl BaseReaction {
    /// All variants by name.
    pub const NAMES: [(&'static str, Self); 3] = [
        ("free", Self::Free),
        ("least_with_tip_pose", Self::Least(KeptTip::Pose)),
        ("least_with_tip_position", Self::Least(KeptTip::Position)),
    ];
}

/// Settings of motions; read once, at the start.
#[derive(Debug, Clone)]
pub struct MotionParams {
    /// Whether other nodes can command motions and wrenches (`commander_interfaces`).
    pub interfaces: bool,
    /// Link whose frame is the tip frame; empty is `tool0`, or the last link if there is no `tool0`.
    pub tip_link: String,
    /// Default path tolerance of trajectories.
    pub path: StateTolerance,
    /// Default goal tolerance of trajectories.
    pub goal: StateTolerance,
    /// Default goal time tolerance: by how much a goal may exceed its trajectory's duration \[s\]; zero for no limit.
    pub goal_time: f64,
    /// Settings of streamed twists.
    pub twist: TwistServoConfig,
    /// How long a wrench from the topic `wrench` acts \[s\].
    pub wrench_timeout: f64,
}

/// Declares `position_servo.bandwidth` and reads it.
pub(super) fn declare_position_servo(declare: &mut Declare) -> f64 {
    declare
        .param(
            "position_servo.bandwidth",
            20.0,
            "Natural frequency of the servo of commanded positions, trajectories, paths and twists, the same in all postures [rad/s]",
        )
        .range(1e-3, 1e4)
        .read_only()
        .value()
}

/// Declares the parameters of motions and reads them.
///
/// # Errors
/// A line that names the invalid parameter of twists.
pub(super) fn declare_motions(declare: &mut Declare) -> Result<MotionParams, String> {
    let tip_link = declare
        .param(
            "tip_link",
            "",
            "Link whose frame is the tip, for paths and twists; empty is tool0, or the robot's last link if it has none",
        )
        .read_only()
        .value();
    let interfaces = declare
        .param(
            "commander_interfaces",
            true,
            "Whether motions and wrenches can be commanded (docs/commanders.md); without, the node needs 56 descriptors less",
        )
        .read_only()
        .value();
    let mut non_negative = |name: &str, default: f64, description: &str| {
        declare
            .param(name, default, description)
            .range(0.0, 1e6)
            .read_only()
            .value()
    };
    let path = non_negative(
        "constraints.trajectory",
        0.0,
        "Largest deviation of any joint from its trajectory, unless a goal has its own [rad or m]; 0 is not checked",
    );
    let goal = non_negative(
        "constraints.goal",
        0.0,
        "Largest deviation of any joint from the end of its trajectory, unless a goal has its own [rad or m]; 0 is not checked",
    );
    let stopped = non_negative(
        "constraints.stopped_velocity_tolerance",
        0.01,
        "Largest joint rate at the end of a trajectory, unless a goal has its own [rad/s or m/s]; 0 is not checked",
    );
    let goal_time = non_negative(
        "constraints.goal_time",
        0.0,
        "How long after the end of its trajectory a goal may be reached, unless it has its own time [s]; 0 is any time",
    );
    let wrench_timeout = non_negative(
        "wrench_timeout",
        0.5,
        "How long a wrench from the topic wrench acts unless another one follows [s]",
    );
    let default = TwistServoConfig::default();
    let mut setting = |name: &str, default: f64, description: &str| {
        declare
            .param(&format!("twist_servo.{name}"), default, description)
            .range(1e-6, 1e6)
            .read_only()
            .value()
    };
    let twist = TwistServoConfig {
        incoming_command_timeout: setting(
            "incoming_command_timeout",
            default.incoming_command_timeout,
            "Age of the last twist at which the joints are halted [s]",
        ),
        lower_singularity_threshold: setting(
            "lower_singularity_threshold",
            default.lower_singularity_threshold,
            "Condition number of the generalized Jacobian above which the tip slows down",
        ),
        hard_stop_singularity_threshold: setting(
            "hard_stop_singularity_threshold",
            default.hard_stop_singularity_threshold,
            "Condition number at which the tip halts",
        ),
        leaving_singularity_threshold_multiplier: setting(
            "leaving_singularity_threshold_multiplier",
            default.leaving_singularity_threshold_multiplier,
            "For motion that leaves a singular position, the range between the thresholds is longer by this factor",
        ),
        max_linear_speed: setting(
            "max_linear_speed",
            default.max_linear_speed,
            "Largest speed of the tip [m/s]",
        ),
        max_angular_speed: setting(
            "max_angular_speed",
            default.max_angular_speed,
            "Largest angular speed of the tip [rad/s]",
        ),
        max_joint_rate: setting(
            "max_joint_rate",
            default.max_joint_rate,
            "Largest rate of any joint, in addition to its own limit [rad/s or m/s]",
        ),
        max_joint_acceleration: setting(
            "max_joint_acceleration",
            default.max_joint_acceleration,
            "Largest change of any joint's rate [rad/s2 or m/s2]",
        ),
    };
    (twist.check()).map_err(|e| format!("parameter twist_servo.{e}"))?;
    let of = |position, rate| StateTolerance {
        position,
        rate,
        acceleration: 0.0,
    };
    Ok(MotionParams {
        interfaces,
        tip_link,
        path: of(path, 0.0),
        goal: of(goal, stopped),
        goal_time,
        twist,
        wrench_timeout,
    })
}

/// The parameter `base_reaction`, which may change at any time.
#[derive(Debug, Clone)]
pub struct LiveBaseReaction(Arc<Param<String>>);

impl LiveBaseReaction {
    /// The current value.
    pub fn get(&self) -> BaseReaction {
        // Any other text is refused by the declaration.
        choice::find(&BaseReaction::NAMES, &self.0.get()).unwrap_or(BaseReaction::Free)
    }
}

/// Declares `base_reaction`.
pub(super) fn declare_base_reaction(declare: &mut Declare) -> LiveBaseReaction {
    let declared = choice::declare(
        declare,
        "base_reaction",
        &BaseReaction::NAMES,
        "What redundant joints do in trajectories and paths that begin from now on; least_... turns the base as little as the tip's motion allows",
    );
    LiveBaseReaction(Arc::new(declared.live()))
}
