//! Flexible structures for spacecraft: modes, transmission zeros, and deformable bodies for multibody dynamics.
//!
//! Solar panels, booms and elastic links are computed from their dimensions, or from the text of a modes file that
//! a finite-element program wrote. The result is an [`Appendage`]: rigid mass properties, modal matrices and the mass integrals
//! that the nonlinear equations of motion need. Linear models of a vehicle with appendages ([`Vehicle`], [`HybridModel`])
//! have poles and transmission zeros, as in Kida 1993, "Control of large space structures" (in Japanese), whose chapter 2 this library
//! reproduces ([`kida1993`]). The library parses texts, which the caller reads from files, and starts no threads.
//!
//! # A solar panel
//!
//! ```
//! use fuyu_structures::PlateStrip;
//!
//! let panel = PlateStrip {
//!     length: 8.0, width: 2.0, areal_mass: 3.0, // m, m, kg/m²
//!     EI: 3000.0, GJ: 800.0,                    // N m²
//!     bending_modes: 3, torsion_modes: 1, damping: 0.005, second_order: false,
//! }
//! .appendage("solar_plus")?;
//!
//! let first = panel.frequencies()?[0] / std::f64::consts::TAU;
//! assert!((first - 0.195_513_122_67).abs() < 1e-11); // Hz
//! let moved = panel.effective_mass(0)[2] / panel.invariants.mass();
//! assert!((moved - 0.613).abs() < 1e-3); // 61 % of the mass follows the first mode when the root is shaken along z
//! # Ok::<(), fuyu_structures::StructureError>(())
//! ```
//!
//! # The panel on a vehicle
//!
//! With a free base, the frequencies depend on the vehicle's inertia; the zeros from torques to attitude do not:
//!
//! ```
//! use fuyu_structures::{Attachment, PlateStrip, Vehicle};
//! use nalgebra::{DMatrix, Rotation3, Vector3};
//! # let panel = PlateStrip { length: 8.0, width: 2.0, areal_mass: 3.0, EI: 3000.0, GJ: 800.0,
//! #     bending_modes: 3, torsion_modes: 1, damping: 0.005, second_order: false }.appendage("solar_plus")?;
//! let attachment = Attachment::on_base(&panel, &Rotation3::identity(), &Vector3::new(1.2, 0.0, 0.0), 6);
//! // A base of 2000 kg and 2000 kg m², and the undeformed panel about the base's origin.
//! let mut M = DMatrix::from_diagonal_element(6, 6, 2000.0);
//! M += attachment.jacobian.transpose() * panel.rigid_mass_matrix() * &attachment.jacobian;
//!
//! let vehicle = Vehicle::new(M, &[attachment])?;
//! assert!(vehicle.frequencies_hz()?[0] > 0.22); // higher than 0.1955 Hz of the clamped panel
//! let zeros = fuyu_structures::frequencies_hz(&vehicle.wrench_zeros()?);
//! assert!((zeros[0] - 0.1955).abs() < 1e-4);
//! # Ok::<(), fuyu_structures::StructureError>(())
//! ```
//!
//! # Equations of motion
//!
//! [`Kinetics`] has mass matrix and convective forces of a deformed body whose attachment moves arbitrarily:
//!
//! ```
//! use fuyu_structures::{Kinetics, PlateStrip};
//! use nalgebra::Vector3;
//! # let panel = PlateStrip { length: 8.0, width: 2.0, areal_mass: 3.0, EI: 3000.0, GJ: 800.0,
//! #     bending_modes: 3, torsion_modes: 1, damping: 0.005, second_order: false }.appendage("solar_plus")?;
//! let mut kinetics = Kinetics::new(&panel);
//! let (mu, mu_dot) = ([0.1, 0.0, 0.0, 0.0], [0.0, 0.02, 0.0, 0.0]);
//! kinetics.update(&panel, &mu, &mu_dot, &Vector3::new(0.0, 0.05, 0.0));
//! assert_eq!(kinetics.mass_matrix.shape(), (10, 10)); // velocity, angular velocity, modal rates
//! assert!(kinetics.bias[6] < 0.0); // the centrifugal force pulls the panel further out
//! # Ok::<(), fuyu_structures::StructureError>(())
//! ```
//!
//! # Modes of other programs
//!
//! [`modes_file`] reads and writes frequencies, damping and mass integrals as YAML or CSV. [`NodalModel`] reduces mass and
//! stiffness matrices.
//!
//! ```
//! use fuyu_structures::modes_file;
//!
//! let text = "
//! name: antenna
//! mass: 12.0
//! first_moment: [6.0, 0, 0]
//! inertia: [0.5, 4.0, 4.0, 0, 0, 0]
//! modes:
//!   - {name: bending, frequency_hz: 1.7, damping: 0.01, S: [0, 0, 2.5], N: [0, 0, 1.8, 0, 0, 0, 0, 0, 0]}
//! ";
//! let antenna = modes_file::from_yaml(text, "antenna.yaml")?;
//! assert_eq!(antenna.coupling()[(0, 4)], -1.8); // ∫ X × ψ dm about y
//!
//! let error = modes_file::from_yaml(&text.replace("1.7", "-1.7"), "antenna.yaml").unwrap_err();
//! assert_eq!(
//!     error.to_string(),
//!     "antenna.yaml, line 7, mode bending, frequency_hz: is -1.7; it must be positive [Hz]"
//! );
//! # Ok::<(), fuyu_structures::StructureError>(())
//! ```
//!
//! # Conventions
//!
//! - SI units, radians. Angular frequencies \[rad/s\] unless a name ends in `_hz`.
//! - The attachment frame A is fixed to the rigid body; x leads from root to tip. Rows and columns of six are
//!   translation x, y, z, then rotation x, y, z.
//! - Modes are mass-normalised and positive at the tip (+z, or about +x in torsion). Trusses and nodal models: the largest entry is
//!   positive.
//! - Coupling P has one row for each mode: `(∫ ψ dm, ∫ X × ψ dm)`, about the attachment, in its axes.
//! - Names contain frames in monogram notation: `R_BA` takes components in frame A to components in frame B.

// Matrices have the names of the equations.
#![allow(clippy::many_single_char_names)]

mod appendage;
mod beam;
mod cantilever;
mod eigen;
mod error;
mod hybrid;
pub mod kida1993;
mod line;
mod link;
mod matrices;
pub mod modes_file;
mod nodal;
mod outline;
mod pencil;
mod quadrature;
mod strip;
mod truss;
mod uniform;
mod vehicle;

pub use self::{
    appendage::{
        Appendage, FIRST_ORDER_DEFLECTION, FIRST_ORDER_RATE, FirstOrderLimits, Invariants,
        Kinetics, MassPoint, OutputPoint, cross_moment, pair_index,
    },
    beam::{Beam, BeamElement, Deflection, End, NodeBody, QuadraticRod},
    cantilever::{Cantilever, Shaft},
    eigen::{Eigen, generalized_eigen, lowest_modes},
    error::StructureError,
    hybrid::{HybridModel, UnconstrainedModel},
    link::ElasticLink,
    matrices::{Matrices, Modes},
    nodal::{Axis, NodalModel},
    outline::Outline,
    pencil::{frequencies_hz, quadratic_roots},
    strip::{Boom, PlateStrip},
    truss::{Rod, Truss},
    uniform::{FemModel, ModalModel},
    vehicle::{Attachment, Vehicle},
};

/// Compiles the example of the README.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
