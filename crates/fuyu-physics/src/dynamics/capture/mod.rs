//! Capture: floating systems that join at an instant, move as one, and separate.
//!
//! [`close_latches`] computes the impulse at which latches close: total momentum does not change, energy does.
//! [`Captured`] represents robot and target after that: one floating system, in which the target's links are part of the
//! robot's tree. A second arm that grasps the target closes a loop. [`Captured::release`] separates robot and target.
//! [`CapturedGyrostat`] is the counterpart for a robot with reaction wheels and thrusters.
//!
//! ```
//! use fuyu_physics::dynamics::capture::{Captured, Grasp, JointReaction, Latch};
//! use fuyu_physics::dynamics::{Floating, IntegrationMethod, State};
//! use fuyu_physics::model::{Frame, ModelBuilder};
//! use fuyu_physics::spatial::{Pose, RigidInertia};
//! use nalgebra::{Matrix3, Vector3};
//!
//! // A ball of 1 kg at 1 m/s meets one of 3 kg at rest; they stay together.
//! let ball = |mass| RigidInertia { mass, com: Vector3::zeros(), about_com: Matrix3::identity() };
//! let [robot, target] = [3.0, 1.0].map(|mass| {
//!     let model = ModelBuilder::new("ball", "base_link", ball(mass)).build();
//!     let mut state = State::at_rest(&model);
//!     state.momentum_W.linear.x = if mass == 1.0 { 1.0 } else { 0.0 };
//!     Floating::new(model, state, IntegrationMethod::Dop8)
//! });
//! let grasp = Grasp {
//!     robot: robot.model().frames()[0].clone(),
//!     target: robot.model().frames()[0].clone(),
//!     latch: Latch::Weld,
//!     joints: JointReaction::Free,
//! };
//! let (mut both, impulse) = Captured::new(&robot, &target, &grasp, IntegrationMethod::Dop8)?;
//! assert!((impulse.energy_lost - 0.375).abs() < 1e-15);
//! both.step(0.01, 100);
//! assert!((both.floating().state().p_WC.x - 0.25).abs() < 1e-15);
//! # Ok::<(), fuyu_physics::dynamics::capture::CaptureError>(())
//! ```

mod captured;
mod grasp;
mod gyrostat;
mod impulse;
mod parts;
mod release;

pub use captured::Captured;
pub use grasp::{CaptureError, Grasp};
pub use gyrostat::{CapturedGyrostat, ReleasedGyrostat};
pub use impulse::{
    JointReaction, Latch, LatchImpulses, LatchPair, System, close_latches, push_apart,
};
pub use release::{ReleaseSpring, Released};
