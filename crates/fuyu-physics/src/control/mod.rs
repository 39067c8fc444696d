//! Control laws: from joint states and base-frame measurements to joint efforts.
//!
//! No law here ever sees the pose of the base. A [`Measurement`] is all there is: joint positions and
//! rates from encoders, tip and goal poses as a sensor on the base sees them.
//!
//! A [`Law`] says how the joints are pulled. A [`Controller`] runs one of them, adds damping of the joints,
//! and hands over from law to law and from gains to gains without a step in the efforts.

mod bumpless_transfer;
mod config;
mod control_loop;
mod controller;
mod feed_forward;
mod gains;
mod inverse_kinematics;
mod joint_pd;
mod latency_compensation;
mod law;
mod linearised;
mod lyapunov;
mod measurement;
mod operability;
mod operational_space;
mod operator;
mod pose_error;
pub mod prediction;
mod resolved_rate;
mod singularity_escape;
mod straight_path;
mod task_priority;
mod transpose_jacobian;
mod velocity_servo;
mod virtual_tip_inertia;
mod workspace_radius;

pub use config::ControllerConfig;
pub use control_loop::{
    ControlLoop, ControlLoopConfig, ControlMode, InputError, InputStatus, LoopReport, Stamp,
    StampPairs,
};
pub use controller::Controller;
pub use feed_forward::{FeedForward, MovingGoal};
pub use gains::{GainError, Gains};
pub use inverse_kinematics::{IkError, inverse_kinematics};
pub use joint_pd::{JointPd, JointPdGains};
pub use law::{ControlReport, Law, LawError, LawKind, Manipulator};
pub use linearised::LinearisedLoop;
pub use lyapunov::LyapunovFunction;
pub use measurement::{GoalRate, Measurement, Present, TipMeasurement};
pub use operability::{MapError, MapPoint, Mapping, Operability, OperabilityMap};
pub use operational_space::{BaseTask, OperationalConfig, OperationalSpace, TipTask};
pub use operator::{Operator, OperatorConfig};
pub use pose_error::{HALF_TURN_CAP, PoseError, Saturation};
pub use resolved_rate::{
    Limited, RateLimits, Resolution, Resolved, ResolvedRate, ResolvedRateConfig, limit_twist,
};
pub use singularity_escape::{ConvergenceFailure, SingularityEscapeConfig};
pub use straight_path::{Shaping, StraightPath, StraightPathConfig};
pub use task_priority::{Rows, TASK_DAMPING, TaskPriority};
pub use transpose_jacobian::{JacobianKind, TransposeJacobian};
pub use velocity_servo::{ServoGains, VelocityServo, VelocityServoConfig};
pub use virtual_tip_inertia::VirtualTipInertia;
pub use workspace_radius::workspace_radius;
