//! Kinematics, momentum, generalized Jacobian and forward dynamics of a free-floating tree of bodies.
//!
//! Momentum is part of the state. A [`State`] contains the joint positions and rates, the base attitude, the system's
//! centre of mass and its linear and angular momentum. The base twist follows from them algebraically (Masutani 1995
//! eq. (4.23), with the momentum term that the thesis omits because it assumes zero momentum). So free motion conserves
//! momentum up to rounding errors at any step size; only external wrenches change it.
//!
//! [`Workspace::set_positions`] computes all quantities that depend on joint positions alone: fixed-base and
//! generalized Jacobians, base map, reduced inertia and frame poses can then be read. [`Workspace::set_motion`] adds
//! quantities that depend on rates and momentum: body twists, energy, and momentum summed over the bodies. Forward
//! dynamics is a [`Formulation`] ([`FormulationKind`] lists them; the default, the articulated-body algorithm, is the
//! fastest); [`InverseDynamics`] is the inverse. [`Integrator`] steps a state. [`Floating`] combines them for one
//! robot, `Batch` for thousands of states of one robot. [`Loops`] adds closed loops. Steps and evaluations do not
//! allocate.
//!
//! # Conventions
//!
//! - Twists, wrenches and accelerations are structs with named parts; constructors take the angular part first
//!   ([`Twist::new`](crate::spatial::Twist::new)). Jacobians and the base map are 6 × n matrices with the linear rows
//!   first, as in the thesis.
//! - Vectors of joints have the order of [`Model::joints`](crate::model::Model::joints).
//! - Everything is made from a [`Model`](crate::model::Model) and keeps it; all objects share one copy of the model and
//!   of its compiled kinematic tree. Arguments are references, unless the callee keeps them; results are values or written to
//!   `out`.
//! - A vector of the wrong length, or an object of another robot, is a programming error: it panics with a message
//!   that names the argument. Errors in the data (a description, closures that cannot be closed) are `Result`s.
//!
//! ```
//! use fuyu_physics::dynamics::{Input, IntegrationMethod, Integrator, State, Workspace};
//! use fuyu_physics::model::{JointKind, ModelBuilder};
//! use fuyu_physics::spatial::{Pose, RigidInertia};
//! use nalgebra::{Matrix3, Translation3, Vector3};
//!
//! let box_ = RigidInertia { mass: 10.0, com: Vector3::zeros(), about_com: Matrix3::identity() };
//! let arm = RigidInertia { mass: 1.0, com: Vector3::new(0.5, 0.0, 0.0), about_com: Matrix3::identity() * 0.1 };
//! let mut robot = ModelBuilder::new("boom", "base_link", box_);
//! robot.body("arm", 0, JointKind::Continuous, Vector3::z_axis(), Translation3::new(0.5, 0.0, 0.0).into(), arm);
//! let model = robot.build();
//!
//! let mut state = State::at_rest(&model);
//! let mut workspace = Workspace::new(&model);
//! let mut integrator = Integrator::new(&model, IntegrationMethod::Rk4);
//! let mut push = |_t: f64, _state: &State, input: &mut Input| input.efforts[0] = 1.0; // N m
//! for _ in 0..100 {
//!     integrator.step(&mut state, &mut workspace, 0.01, &mut push);
//! }
//! // The arm has turned, and the base has turned the other way.
//! assert!(state.q[0] > 0.0 && state.R_WB.axis().unwrap().z < 0.0);
//! ```

mod articulated_body;
mod axis;
#[cfg(feature = "batch")]
mod batch;
pub mod capture;
mod checks;
pub mod contact;
mod expanded_motion;
pub mod flexible;
mod floating;
mod formulation;
mod forward;
mod instruction_set;
mod integrator;
mod inverse;
mod jacobian;
mod joint_physics;
mod kane;
pub mod kernel;
mod loops;
#[cfg(test)]
mod mimic_tests;
mod momentum;
pub mod newton_euler;
mod rate;
mod reduced;
mod runge_kutta;
mod scratch_memory;
#[cfg(test)]
mod simd_equivalence;
mod state;
mod state_row;
mod tableau;
mod transmitted_wrench;
mod vector_state;
mod workspace;

pub use articulated_body::ArticulatedBody;
#[cfg(feature = "batch")]
pub use batch::{Batch, EffortRows, SimdGroup};
pub use floating::Floating;
pub use formulation::{
    Evaluation, Formulation, FormulationKind, ForwardDynamics, TreeAcceleration, TreeMotion,
};
pub use forward::Input;
pub use instruction_set::InstructionSets;
pub use integrator::{Forcing, IntegrationMethod, Integrator};
pub use inverse::InverseDynamics;
pub use joint_physics::JointPhysics;
pub use kane::{BaseSpeed, CutError, CutHinge, Kane};
pub use loops::{Direction, LoopClosure, LoopError, LoopGap, Loops};
pub use reduced::Reduced;
pub use runge_kutta::RungeKutta;
pub use state::{Dissipated, Momentum, State};
pub use state_row::{RowError, StateRow};
pub use tableau::Tableau;
pub use vector_state::VectorState;
pub use workspace::Workspace;
