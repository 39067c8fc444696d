//! Robots with deformable bodies, elastic joints, reaction wheels and thrusters.
//!
//! A [`FlexibleSystem`] is a robot with such parts. Its [`FlexibleState`] contains the total momentum, including modal
//! rates, motor rotors and wheels; the base's twist follows from the momentum as for a rigid robot. So only external
//! wrenches and thrusters change momentum, at any step size; wheels and vibrations only exchange momentum with the
//! bodies. [`FlexibleIntegrator`] uses a fixed step, [`AdaptiveIntegrator`] error control. [`FlexibleWorkspace`] holds
//! poses, twists, energies and momenta of one state; [`FlexibleJacobian`] computes the generalized Jacobian,
//! [`LinearModel`] frequencies; `FlexibleBatch` steps many states in parallel.
//!
//! ```
//! use fuyu_physics::dynamics::{IntegrationMethod, flexible::*};
//! use fuyu_physics::model::ModelBuilder;
//! use fuyu_physics::spatial::{Pose, RigidInertia};
//! use fuyu_structures::PlateStrip;
//! use nalgebra::{Matrix3, Vector3};
//!
//! let box_ = RigidInertia { mass: 2000.0, com: Vector3::zeros(), about_com: Matrix3::identity() * 1400.0 };
//! let model = ModelBuilder::new("satellite", "base_link", box_).build();
//! let base = model.frame("base_link").expect("the root link").clone();
//! let panel = PlateStrip {
//!     length: 8.0, width: 2.0, areal_mass: 3.0, EI: 3000.0, GJ: 800.0,
//!     bending_modes: 3, torsion_modes: 1, damping: 0.005, second_order: false,
//! };
//! let system = FlexibleSystem::builder(&model)
//!     .appendage(&base, Pose::translation(1.2, 0.0, 0.0), panel.appendage("solar_plus")?)
//!     .wheel(&base, Wheel::new("y", Vector3::y_axis(), 0.2))
//!     .build()?;
//!
//! let mut state = FlexibleState::at_rest(&system);
//! let mut workspace = FlexibleWorkspace::new(&system);
//! let mut integrator = FlexibleIntegrator::new(&system, IntegrationMethod::Rk4);
//! let mut spin_up = |_: f64, _: &FlexibleState, input: &mut FlexibleInput| input.wheel_torques[0] = 1.0; // N m
//! for _ in 0..100 {
//!     integrator.step(&mut state, &mut workspace, 0.02, &mut spin_up);
//! }
//! // The wheel turns one way, the base the other, and the panel bends; angular momentum stays exactly zero.
//! assert!(state.wheel_speeds()[0] > 9.0 && workspace.V_WB_B().angular.y < 0.0);
//! assert!(workspace.deflection(&state, 0, 0).z.abs() > 1e-5);
//! assert_eq!(state.tree.momentum_W.angular, Vector3::zeros());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod acceleration;
mod adaptive;
mod base_modes;
#[cfg(feature = "batch")]
mod batch;
mod builder;
mod composite;
mod error;
mod first_order;
mod floating;
mod gyrostat;
mod integrator;
mod jacobian;
mod linear;
mod modal_body;
mod motion;
mod parts;
mod section;
mod stability;
mod state;
mod system;
mod transmitted_wrench;
mod workspace;

pub use adaptive::{AdaptiveIntegrator, Tolerance};
#[cfg(feature = "batch")]
pub use batch::FlexibleBatch;
pub use builder::FlexibleBuilder;
pub use error::FlexibleError;
pub use first_order::{FirstOrderExcess, FirstOrderQuantity};
pub use floating::FlexibleFloating;
pub use integrator::{Accelerations, FlexibleForcing, FlexibleIntegrator};
pub use jacobian::FlexibleJacobian;
pub use linear::LinearModel;
pub use modal_body::ModalBody;
pub use parts::{ElasticJoint, RotorModel, Thruster, Wheel};
pub use state::{FlexibleInput, FlexibleState, Losses, PartialWork};
pub use system::FlexibleSystem;
pub use workspace::FlexibleWorkspace;
