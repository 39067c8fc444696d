//! Control laws: from joint states and base-frame measurements to joint efforts.
//!
//! No law here ever sees the pose of the base. A [`Measurement`] is all there is: joint positions and
//! rates from encoders, tip and goal poses as a sensor on the base sees them.
//!
//! A [`Law`] says how the joints are pulled. A [`Controller`] runs one of them, adds damping of the joints,
//! and hands over from law to law and from gains to gains without a step in the efforts.

mod config;
mod controller;
mod gains;
mod hand_over;
mod inverse_kinematics;
mod joint_pd;
mod law;
mod measurement;
mod pose_error;
mod transpose_jacobian;

pub use config::ControllerConfig;
pub use controller::Controller;
pub use gains::{GainError, Gains};
pub use inverse_kinematics::{IkError, inverse_kinematics};
pub use joint_pd::{JointPd, JointPdGains};
pub use law::{Acted, Arm, Law, LawError, LawKind};
pub use measurement::{Measurement, Sight};
pub use pose_error::{PoseError, Saturation};
pub use transpose_jacobian::{JacobianKind, TransposeJacobian};
