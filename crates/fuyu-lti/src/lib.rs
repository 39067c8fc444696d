//! Linear time-invariant systems, and attitude-control design for flexible spacecraft.
//!
//! Dense real state-space models, the equations and norms of linear control theory, the synthesis of regulators, observers and H-infinity
//! controllers, and direct feedback of structures with collocated actuators and sensors. Only nalgebra is needed; there is no LAPACK.
//! SI units throughout: s, rad/s, rad, N m.
//!
//! # Contents
//!
//! | subject | items |
//! | --- | --- |
//! | models | [`StateSpace`], [`TransferFunction`], [`Structure`]; series, parallel, feedback, linear fractional transformation |
//! | in frequency | [`StateSpace::response`], [`StateSpace::bode`], [`StateSpace::nyquist`], [`StateSpace::sigma`], [`margins`], [`loop_at_input`] |
//! | in time | [`StateSpace::zero_order_hold`], [`StateSpace::zero_order_hold_delayed`], [`StateSpace::tustin`], [`StateSpace::simulate`], [`SampledLoop`] |
//! | analysis | [`eigenvalues`], [`StateSpace::zeros`], [`StateSpace::h2_norm`], [`StateSpace::hinf_norm`], [`is_controllable`], [`positive_real`] |
//! | equations | [`lyapunov`], [`discrete_lyapunov`], [`care`], [`dare`] |
//! | reduction | [`controllability_gramian`], [`hankel_singular_values`], [`balanced_truncation`], [`modal_split`] |
//! | synthesis | [`lqr`], [`steady_kalman`], [`lqg`], [`recovery_observer`], [`shaped_lqr`], [`hinf_controller`], [`hinf_optimal`] |
//! | structures | [`Structure::direct_feedback`], [`Structure::certify`], [`ProofMass`] |
//! | published designs | [`kida1993`] |
//!
//! Every iteration has a limit, and input for which a problem has no solution is refused with an [`LtiError`] that names the reason.
//!
//! # A first design
//!
//! A satellite of 10 kg m2 with a panel mode at 1.2 Hz, damped by half a percent. The regulator is designed on the rigid body alone.
//!
//! ```
//! use fuyu_lti::{Matrix, Structure, StateSpace, lqr, margins, observer_based, recovery_observer};
//!
//! // Mode shapes at the wheel, mass normalised: 1/sqrt(J) for the rigid mode.
//! let shapes = Matrix::from_column_slice(2, 1, &[0.31, -0.37]);
//! let satellite = Structure::modal(&[0.0, 7.2], &[0.0, 0.005], &shapes)?;
//! let plant = satellite.displacement_system()?; // torque -> attitude
//! let rigid = Structure::modal(&[0.0], &[0.0], &shapes.rows(0, 1).into_owned())?.displacement_system()?;
//!
//! let one = Matrix::identity(1, 1);
//! let k = lqr(&rigid, &(rigid.c.transpose() * &rigid.c), &(&one * 1e-3))?.gain;
//! let l = recovery_observer(&rigid, 1e-3)?.gain;
//! let compensator = observer_based(&rigid, &k, &l)?;
//!
//! // It holds the rigid body, and makes the panel vibrate: spillover.
//! assert!(rigid.feedback(&compensator)?.is_stable()?);
//! assert!(!plant.feedback(&compensator)?.is_stable()?);
//! # Ok::<(), fuyu_lti::LtiError>(())
//! ```
//!
//! With a cost that weights fast control, the regulator's gain falls off below the panel's frequency, and the loop is stable:
//!
//! ```
//! # use fuyu_lti::{Matrix, Structure, margins, recovery_observer};
//! # let shapes = Matrix::from_column_slice(2, 1, &[0.31, -0.37]);
//! # let plant = Structure::modal(&[0.0, 7.2], &[0.0, 0.005], &shapes)?.displacement_system()?;
//! # let rigid = Structure::modal(&[0.0], &[0.0], &shapes.rows(0, 1).into_owned())?.displacement_system()?;
//! use fuyu_lti::{ShapedWeights, TransferFunction, shaped_lqr};
//!
//! let lowpass = TransferFunction::second_order_lowpass(1.0, 0.7)?.to_state_space()?;
//! let regulator = shaped_lqr(&rigid, &ShapedWeights {
//!     controlled: rigid.c.clone(),
//!     output_weight: None,
//!     inverse_input_weight: Some(lowpass),
//!     rho: 1e-3,
//! })?;
//! let compensator = regulator.compensator(&recovery_observer(&rigid, 1e-3)?.gain)?;
//! assert!(plant.feedback(&compensator)?.is_stable()?);
//! let m = margins(&plant.series(&compensator)?)?;
//! assert!(m.smallest_gain().unwrap().decibel > 3.0);
//! # Ok::<(), fuyu_lti::LtiError>(())
//! ```
//!
//! Feedback of rate and angle at the place where the torque acts cannot destabilise the panel, whatever its frequency:
//!
//! ```
//! # use fuyu_lti::{Matrix, Structure};
//! # let shapes = Matrix::from_column_slice(2, 1, &[0.31, -0.37]);
//! # let satellite = Structure::modal(&[0.0, 7.2], &[0.0, 0.005], &shapes)?;
//! let one = Matrix::identity(1, 1);
//! let (p, d) = (&one * 10.0, &one * 10.0);
//! satellite.certify(&p, &d)?; // the premises of the theorem
//! let closed = satellite.direct_feedback(&p, &d)?;
//! assert!(closed.is_stable()?);
//!
//! // Sampled every 10 ms, with a computation time of one sample:
//! let sampled = satellite.displacement_and_rate_system()?.zero_order_hold_delayed(0.01, 0.01)?;
//! let gain = fuyu_lti::StateSpace::gain(Matrix::from_row_slice(1, 2, &[10.0, 10.0]));
//! assert!(sampled.feedback(&gain)?.is_stable()?);
//! # Ok::<(), fuyu_lti::LtiError>(())
//! ```
//!
//! # H-infinity
//!
//! Mixed sensitivity for an unstable plant: weights on the output and on the control, noise on the measurement.
//!
//! ```
//! use fuyu_lti::{Matrix, StateSpace, hinf_optimal};
//! // x' = x + w1 + u, z = [x; u], y = x + w2
//! let plant = StateSpace::new(
//!     Matrix::identity(1, 1),
//!     Matrix::from_row_slice(1, 3, &[1.0, 0.0, 1.0]),
//!     Matrix::from_row_slice(3, 1, &[1.0, 0.0, 1.0]),
//!     Matrix::from_row_slice(3, 3, &[0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0]),
//! )?;
//! let design = hinf_optimal(&plant, 1, 1, 1e-6)?;
//! // The norm of the closed loop, by the Hamiltonian matrix and by a sweep, is below the bound.
//! assert!(design.norm.norm < 1.000_001 * design.gamma && design.norm.swept < 1.000_001 * design.gamma);
//! # Ok::<(), fuyu_lti::LtiError>(())
//! ```
//!
//! Accuracy measured, sources and a worked example are in the repository's `docs/attitude_design.md`.

mod eigen;
mod error;
mod frequency;
mod gramians;
mod hinf;
pub mod kida1993;
mod lqr;
mod lyapunov;
mod margins;
mod matrix;
mod modes;
mod norms;
mod positive_real;
mod proof_mass;
mod reduction;
mod riccati;
mod sampling;
mod shaped_lqr;
mod simulation;
mod state_space;
mod structure;
mod transfer_function;
mod zeros;

pub use eigen::{eigenvalues, spectral_abscissa, spectral_radius};
pub use error::LtiError;
pub use frequency::{BodePoint, SigmaPoint};
pub use gramians::{controllability_gramian, hankel_singular_values, observability_gramian};
pub use hinf::{HinfDesign, hinf_controller, hinf_optimal};
pub use lqr::{
    Lqg, SteadyKalman, closed_loop, lqg, lqr, observer_based, recovery_observer, steady_kalman,
    tracking_loop,
};
pub use lyapunov::{LyapunovSolution, discrete_lyapunov, lyapunov};
pub use margins::{GainMargin, Margins, PhaseMargin, loop_at_input, margins};
pub use matrix::{Complex, ComplexMatrix, Matrix};
pub use modes::{is_controllable, is_observable};
pub use norms::HinfNorm;
pub use positive_real::{PositiveReal, positive_real, storage_matrix};
pub use proof_mass::{ProofMass, ProofMassRatios};
pub use reduction::{BalancedTruncation, balanced_truncation, modal_split};
pub use riccati::{RiccatiSolution, care, care_with_cross_weight, dare, dare_with_cross_weight};
pub use shaped_lqr::{ShapedRegulator, ShapedWeights, shaped_lqr};
pub use simulation::{SampledLoop, SampledRun, StepFigures, step_figures};
pub use state_space::StateSpace;
pub use structure::Structure;
pub use transfer_function::TransferFunction;
