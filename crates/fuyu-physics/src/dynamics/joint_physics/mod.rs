//! Joint damping, Coulomb friction, stops and speed limits, integrated without restriction of the step.
//!
//! All four are forces between the two bodies of a joint, so momentum does not change. They act through the reduced inertia
//! `Ĥ`, and work with every formulation of forward dynamics.
//!
//! - **Damping** `-c q̇` is integrated by exponential collocation ([`collocation::Collocation`]): stable for any coefficient
//!   and step.
//! - **Coulomb friction** is `-F sign q̇` while a joint slides. A joint that rests stays exactly at rest while an effort within
//!   `±F` can hold it: a complementarity problem, without regularisation and without creep. Static and sliding friction are
//!   equal, as in URDF.
//! - **Stops** at the position limits: the time at which a joint reaches one within the step is located to rounding,
//!   and the joint rebounds with the coefficient of restitution `e` (Newton's impact law). In the metric of the reduced inertia the
//!   impact takes the energy `½ (1 - e²) v² / (Ĥ⁻¹)_jj`. Below a rebound of 1e-4 rad/s (or m/s) the joint rests at the stop,
//!   which pushes but does not pull.
//! - **Speed limits**: the drive brakes a joint that would exceed its largest rate, with whatever effort is needed.
//!
//! Between events (a joint stops, slips, reaches or leaves a limit) the motion is smooth. The time of an event is found by
//! bracketing with whole steps of the integrator, so the state at the event is as accurate as any other.

mod collocation;
mod joint_contacts;
mod modes;
mod phi;
mod small_matrix;
mod stepper;

pub(super) use collocation::Acting;
pub(super) use stepper::Stepper;

/// Steps for which an explicit method is not sufficient because of the joints.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum JointSteps {
    /// No step.
    Never,
    /// Steps in which a joint reaches a limit.
    AtLimits,
    /// Every step: damping or friction acts.
    Always,
}

/// Which joint properties of the description are simulated. Damping always is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointPhysics {
    /// Coulomb friction.
    pub friction: bool,
    /// Stops at the position limits.
    pub stops: bool,
    /// Coefficient of restitution of the stops, from 0 (the joint stays at the stop) to 1 (no loss).
    pub restitution: f64,
    /// Limits of the joint rates.
    pub velocity_limits: bool,
}

impl Default for JointPhysics {
    fn default() -> Self {
        Self {
            friction: true,
            stops: true,
            restitution: 0.0,
            velocity_limits: true,
        }
    }
}

impl JointPhysics {
    /// No friction, stops or speed limits: only damping.
    pub const DAMPING_ONLY: Self = Self {
        friction: false,
        stops: false,
        restitution: 0.0,
        velocity_limits: false,
    };
}
