//! Control laws: joint efforts from joint states and measurements in the base frame.
//!
//! No [`Law`] uses the pose of the base in the world. A [`Measurement`] consists of joint positions and rates from encoders, of tip and
//! goal poses from a camera on the base, and of the base's angular velocity from a gyro.
//!
//! A [`Law`] computes joint efforts. A [`Controller`] runs one law: it compensates the latency of the camera, adds
//! joint damping, and changes law or gains without a step in the efforts.
//!
//! [`attitude`] holds the base by wheels and thrusters.
//!
//! [`capture`] plans and runs the capture of a free target.
//!
//! [`commander`] executes motions that another program commands: joint trajectories, paths and twists of the tip. For
//! motions of the tip in the world it uses the base's true pose.

pub mod attitude;
mod auto_gains;
mod bumpless_transfer;
mod camera_latency_compensation;
pub mod capture;
pub mod commander;
mod computed_torque;
mod config;
mod control_loop;
mod controller;
mod damped_descent;
pub mod detumbling;
mod effort_delay_compensation;
mod effort_limits;
mod feed_forward;
#[cfg(test)]
mod fixtures;
mod floating_inverse_kinematics;
mod gains;
mod gripper_servo;
mod inverse_kinematics;
mod joint_pd;
mod law;
mod law_config;
mod linearised;
mod lyapunov;
mod manipulator;
mod measurement;
mod operability;
mod operational_space;
mod operator;
mod pose_error;
pub mod prediction;
mod reach;
mod report;
mod resolved_rate;
mod sampled_damping;
mod singularity_escape;
mod straight_path;
mod task_priority;
mod transpose_jacobian;
mod unreachable_goal;
mod velocity_servo;
mod virtual_tip_inertia;
mod workspace_radius;

pub use auto_gains::AutoGains;
pub use computed_torque::{ComputedTorque, ComputedTorqueConfig};
pub use config::ControllerConfig;
pub use control_loop::{
    ControlLoop, ControlLoopConfig, ControlMode, InputError, InputStatus, LoopReport, Stamp,
    StampPairs,
};
pub use controller::Controller;
pub use effort_delay_compensation::{DelayError, DelayStatus};
pub use effort_limits::{outstretched_inertia, with_default_effort_limits};
pub use feed_forward::{FeedForward, MovingGoal};
pub use floating_inverse_kinematics::FloatingInverseKinematics;
pub use gains::{ConfigError, Gains};
pub use gripper_servo::{
    GripperGoal, GripperMonitor, GripperProgress, GripperServo, GripperServoConfig,
};
pub use inverse_kinematics::{IkError, inverse_kinematics};
pub use joint_pd::{JointPd, JointPdConfig};
pub use law::{Law, LawInput, LawStatus};
pub use law_config::{LawConfig, LawKind};
pub use linearised::LinearisedLoop;
pub use lyapunov::LyapunovFunction;
pub use manipulator::Manipulator;
pub use measurement::{GoalRate, Measurement, TipMeasurement};
pub use operability::{MapError, MapPoint, Mapping, Operability, OperabilityMap};
pub use operational_space::{BaseTask, OperationalSpace, OperationalSpaceConfig, TipTask};
pub use operator::{Operator, OperatorConfig};
pub use pose_error::{HALF_TURN_CAP, PoseError, SaturatedError, Saturation};
pub use reach::{ReachError, ReachGoal, Reached, free_floating_reach};
pub use report::{ControlError, ControlReport, LawError};
pub use resolved_rate::{
    Limited, RateLimits, Resolution, Resolved, ResolvedRate, ResolvedRateConfig, limit_twist,
};
pub use sampled_damping::SampledDamping;
pub use singularity_escape::{ConvergenceFailure, SingularityEscapeConfig};
pub use straight_path::{Shaping, StraightPath, StraightPathConfig};
pub use task_priority::{Rows, TaskPriority};
pub use transpose_jacobian::{JacobianKind, TransposeJacobian, TransposeJacobianConfig};
pub use velocity_servo::{ServoGains, VelocityServo, VelocityServoConfig};
pub use virtual_tip_inertia::VirtualTipInertia;
use workspace_radius::workspace_radius;
