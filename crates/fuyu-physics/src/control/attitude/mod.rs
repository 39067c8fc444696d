//! Attitude control of the base by reaction wheels and thrusters.
//!
//! | what | items |
//! | --- | --- |
//! | sensors and estimation | [`GyroErrors`], [`SimulatedGyro`], [`AttitudeFilter`]; the star tracker is [`crate::vision::StarTracker`] |
//! | the robot, linear | [`AttitudePlant`]: poles, and stability of sampled loops with delay; [`spread_postures`] |
//! | laws | [`Dvdfb`], [`Lqr`], [`DoubleLoopLaw`] behind [`AttitudeLaw`]; [`AttitudeLawConfig`] |
//! | feed-forward | [`ArmMomentum`]: the wheels take the arm's momentum |
//! | actuators | [`WheelAllocator`], [`ThrusterAllocator`], [`Unloading`] of the wheels by thrusters |
//! | all together | [`AttitudeRegulator`] from an estimate to commands, [`AttitudeController`] with filter and timeouts |
//!
//! Torques act on the base and are in base axes, except torques of wheel motors, which act on the wheels. Everything is
//! computed once per control period, without allocating memory, and commands are held until the next period.
//!
//! ```
//! use fuyu_physics::control::Stamp;
//! use fuyu_physics::control::attitude::*;
//! use fuyu_physics::dynamics::flexible::{FlexibleSystem, Wheel};
//! use fuyu_physics::model::ModelBuilder;
//! use fuyu_physics::spatial::RigidInertia;
//! use nalgebra::{DVector, Matrix3, UnitQuaternion, Vector3};
//!
//! let inertia = RigidInertia { mass: 500.0, com: Vector3::zeros(), about_com: Matrix3::identity() * 300.0 };
//! let model = ModelBuilder::new("satellite", "base_link", inertia).build();
//! let base = model.frame("base_link").expect("the root link");
//! let mut builder = FlexibleSystem::builder(&model);
//! for (name, axis) in [("x", Vector3::x_axis()), ("y", Vector3::y_axis()), ("z", Vector3::z_axis())] {
//!     builder = builder.wheel(base, Wheel { max_torque: 0.2, max_momentum: 12.0, ..Wheel::new(name, axis, 0.05) });
//! }
//! let system = builder.build()?;
//!
//! // Gains for .1 rad/s and a damping ratio of .7; stable with vibrations of any kind.
//! let law = AttitudeLawConfig::Dvdfb(Dvdfb::diagonal([3.0; 3], [42.0; 3])?);
//! let plant = AttitudePlant::new(&system, &DVector::zeros(0))?;
//! let law = law.law(std::slice::from_ref(&plant), 0.1)?;
//! assert!(plant.sampled_radius(&*law, 0.1, 0.1)? < 1.0); // also with one period of delay
//!
//! let gyro = GyroErrors { angle_random_walk: 1e-6, rate_random_walk: 1e-8, initial_bias: 1e-5 };
//! let filter = AttitudeFilter::new(AttitudeFilterConfig::new(gyro, 5e-5))?;
//! let regulator = AttitudeRegulator::new(&system, law, RegulatorConfig::new(0.1))?;
//! let mut controller = AttitudeController::new(filter, regulator, AttitudeControllerConfig::default())?;
//!
//! // A star tracker, a gyro, and a reference that is .01 rad away about z.
//! let now = Stamp::from_secs_f64(0.0);
//! controller.add_gyro(now, Vector3::zeros())?;
//! controller.add_star_tracker(now, &UnitQuaternion::identity())?;
//! let R_WD = UnitQuaternion::from_scaled_axis(Vector3::z() * 0.01);
//! controller.set_target(now, &AttitudeTarget::fixed(R_WD))?;
//! let report = controller.step(now);
//! assert_eq!(report.mode, AttitudeMode::Law);
//! // .03 N m about z on the base: the motor pushes the wheel the other way.
//! assert!((controller.wheel_torques()[2] + 0.03).abs() < 1e-6);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod arm_momentum;
mod controller;
mod deviation;
mod error;
mod filter;
mod gyro;
mod law;
mod law_config;
mod laws;
mod plant;
mod postures;
mod regulator;
mod span;
mod thrusters;
mod unloading;
mod wheels;

pub use arm_momentum::{ArmMomentum, ArmMotion};
pub use controller::{AttitudeController, AttitudeControllerConfig, AttitudeMode, AttitudeReport};
pub use deviation::{AttitudeDeviation, AttitudeTarget};
pub use error::{AttitudeConfigError, AttitudeInputError};
pub use filter::{AttitudeEstimate, AttitudeFilter, AttitudeFilterConfig, StarTrackerUse};
pub use gyro::{GyroErrors, SimulatedGyro};
pub use law::AttitudeLaw;
pub use law_config::AttitudeLawConfig;
pub use laws::{DoubleLoopConfig, DoubleLoopLaw, Dvdfb, Lqr, LqrWeights};
pub use plant::AttitudePlant;
pub use postures::spread_postures;
pub use regulator::{AttitudeRegulator, RegulatorConfig, RegulatorInput, RegulatorReport};
pub use thrusters::{ThrusterAllocation, ThrusterAllocator};
pub use unloading::{Unloading, UnloadingConfig};
pub use wheels::{WheelAllocation, WheelAllocator};
