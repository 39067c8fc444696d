//! Kinematics, momentum, generalized Jacobian and forward dynamics of the free-floating tree.
//!
//! Momentum is state, not a consequence. A [`State`] holds the joint positions and rates, the base
//! attitude, the system's centre of mass and its linear and angular momentum; the base twist follows
//! from them algebraically (Masutani 1995 eq. (4.23), with the momentum term that the thesis drops
//! because it assumes zero). So free motion conserves momentum to rounding at any step size, and
//! external wrenches change momentum and nothing else does.
//!
//! Everything that depends on joint positions alone is computed once by [`Workspace::set_positions`]
//! and then read: fixed-base and generalized Jacobians, base map, reduced inertia, frame poses.
//! [`Workspace::set_motion`] adds what depends on rates and momentum: body twists, energy, momentum as
//! the bodies carry it. [`Workspace::accelerations`] is the forward dynamics of the reduced system,
//! eq. (4.49). [`FormulationKind`] names the others; the default, by articulated bodies, is the fastest.
//! [`InverseDynamics`] goes the other way. [`Integrator`] steps a state. None of them allocates.
//! [`Loops`] hold bodies of the tree to
//! each other: closed loops.
//!
//! ```
//! use fuyu::dynamics::{Input, Integrator, Method, State, Workspace};
//! use fuyu::model::{JointKind, ModelBuilder};
//! use fuyu::spatial::{Pose, RigidInertia};
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
//! let mut integrator = Integrator::new(&model, Method::Rk4);
//! let mut push = |_t: f64, _state: &State, input: &mut Input| input.efforts[0] = 1.0; // N m
//! for _ in 0..100 {
//!     integrator.step(&model, &mut state, &mut workspace, 0.01, &mut push);
//! }
//! // The arm has turned, and the base has turned the other way.
//! assert!(state.q[0] > 0.0 && state.R_WB.axis().unwrap().z < 0.0);
//! ```

mod articulated_body;
mod axis;
#[cfg(feature = "batch")]
mod batch;
mod floating;
mod formulation;
mod forward;
mod integrator;
mod inverse;
mod jacobian;
mod kane;
pub mod kernel;
mod loops;
mod momentum;
pub mod newton_euler;
mod rate;
mod reduced;
mod runge_kutta;
mod state;
mod tableau;
mod vector_state;
#[cfg(test)]
mod widths;
mod workspace;

pub use articulated_body::ArticulatedBody;
#[cfg(feature = "batch")]
pub use batch::Batch;
pub use floating::Floating;
pub use formulation::{
    Formulation, FormulationKind, ForwardDynamics, TreeAcceleration, TreeMotion,
};
pub use forward::Input;
pub use integrator::{Forcing, Integrator, Method};
pub use inverse::InverseDynamics;
pub use kane::{BaseSpeed, CutError, CutHinge, Kane};
pub use loops::{Direction, LoopClosure, LoopError, LoopGap, Loops};
pub use reduced::Reduced;
pub use runge_kutta::RungeKutta;
pub use state::{Momentum, State};
pub use tableau::Tableau;
pub use vector_state::VectorState;
pub use workspace::Workspace;
