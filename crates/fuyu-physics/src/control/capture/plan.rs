//! Plans of a rendezvous: joint motions as polynomials, and the reasons why a rendezvous has no plan.

use nalgebra::{DVector, UnitQuaternion};

use super::clearance::Distances;
use crate::control::commander::JointPoint;
use crate::dynamics::State;

/// Least singular value of the tip's Jacobian at the arrival; lengths are in m.
pub(super) const SINGULAR: f64 = 0.05;

/// Objective that a plan minimises.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Objective {
    /// Rotation of the base during the motion.
    #[default]
    BaseReaction,
    /// Time until the arrival.
    Time,
    /// Effective mass of the tip in an impact along the approach axis at the arrival.
    Impact,
}

impl Objective {
    /// All by name.
    pub const NAMES: [(&'static str, Self); 3] = [
        ("base_reaction", Self::BaseReaction),
        ("time", Self::Time),
        ("impact", Self::Impact),
    ];
}

/// Start of a plan: the motion of the robot in I.
#[derive(Debug, Clone)]
pub struct Start {
    /// The robot's state: attitude of the base, momentum; its positions and rates are not used.
    pub state: State,
    /// Position, rate and acceleration of each joint's reference.
    pub joints: Vec<JointPoint>,
}

/// Limits that a plan respects.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointLimitsShare {
    /// Share of the joints' velocity limits that a plan uses.
    pub velocity: f64,
    /// Largest rate of a joint whose description gives no limit \[rad/s or m/s\].
    pub default_velocity: f64,
    /// Largest acceleration of a joint \[rad/s² or m/s²\].
    pub acceleration: f64,
    /// Share of the joints' effort limits that a plan uses.
    pub effort: f64,
}

impl Default for JointLimitsShare {
    fn default() -> Self {
        Self {
            velocity: 0.8,
            default_velocity: 0.3,
            acceleration: 0.2,
            effort: 0.7,
        }
    }
}

/// Reserve that a plan keeps from the limits, for later plans that replace it during the approach.
#[derive(Debug, Clone, Copy)]
pub(super) struct Reserve {
    /// Share of the joints' limits of rate, acceleration and effort.
    pub share: f64,
    /// Distance \[m\].
    pub distance: f64,
}

impl Reserve {
    /// Reserve of the first plan.
    pub const FIRST: Self = Self {
        share: 0.1,
        distance: 0.02,
    };
    /// Reserve of the plans that replace it.
    pub const NONE: Self = Self {
        share: 0.0,
        distance: 0.0,
    };
}

/// Why there is no plan.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PlanError {
    /// The tip does not reach the target.
    #[error(
        "the tip does not reach the target at {arrival:.1} s: {position:.3} m and {angle:.3} rad are left at best"
    )]
    NotReached {
        /// Time of the arrival \[s\].
        arrival: f64,
        /// Remaining distance \[m\].
        position: f64,
        /// Remaining angle \[rad\].
        angle: f64,
    },
    /// No posture of the arm reaches the target with the base at its present pose.
    #[error("no posture of the arm reaches the target at {0:.1} s")]
    NoPosture(f64),
    /// The arm would be nearly singular at the arrival.
    #[error(
        "the arm is nearly singular where it meets the target at {arrival:.1} s (singular value {value:.3}, least {SINGULAR})"
    )]
    Singular {
        /// Time of the arrival \[s\].
        arrival: f64,
        /// Smallest singular value of the generalized Jacobian.
        value: f64,
    },
    /// A joint would exceed a limit.
    #[error("joint '{joint}' would exceed its limit of {what}: {value:.3}, limit {limit:.3}")]
    Joint {
        /// The joint.
        joint: String,
        /// The limited quantity.
        what: &'static str,
        /// The value \[SI\].
        value: f64,
        /// The limit \[SI\].
        limit: f64,
    },
    /// The arm would come too close to something.
    #[error("the arm would come within {distance:.3} m of {what}")]
    Clearance {
        /// The objects that are too close.
        what: &'static str,
        /// The distance \[m\], negative inside.
        distance: f64,
    },
    /// The target's motion is not known up to this arrival time.
    #[error("the target's motion is not known until {0:.1} s")]
    Unknown(f64),
}

/// A joint motion to the rendezvous.
#[derive(Debug, Clone)]
pub struct Plan {
    /// Time of the start \[s\].
    pub start: f64,
    /// Time of the arrival \[s\].
    pub arrival: f64,
    /// Joint positions at the arrival.
    pub q: DVector<f64>,
    /// Root mean square of the base's angular velocity during the motion \[rad/s\].
    pub base_rate: f64,
    /// Rotation angle of the base from start to arrival \[rad\].
    pub base_turn: f64,
    /// Effective mass of the tip at the arrival along the approach axis \[kg\].
    pub effective_mass: f64,
    /// The least distances during the motion.
    pub distances: Distances,
    /// Attitude of the base in I at the arrival.
    pub R_IB: UnitQuaternion<f64>,
    /// Coefficients of each joint's polynomial in `s`, from 0 to 1.
    pub(super) polynomials: Vec<[f64; 6]>,
    pub(super) bumps: DVector<f64>,
}

impl Plan {
    /// Cost that a planner minimises among joint paths of the same duration.
    pub(super) fn cost(&self, objective: Objective) -> f64 {
        match objective {
            Objective::BaseReaction | Objective::Time => self.base_rate,
            Objective::Impact => self.effective_mass,
        }
    }

    /// Position, rate and acceleration of joint `j` at `time` \[s\]. Before the start they are those at the start, and
    /// after the arrival those at the arrival: the position then stays constant, although the rate may not be zero.
    pub fn at(&self, j: usize, time: f64) -> JointPoint {
        point(
            &self.polynomials[j],
            self.bumps[j],
            (time - self.start) / (self.arrival - self.start),
            self.arrival - self.start,
        )
    }
}

/// The polynomial with coefficients `c` plus a bump, at the fraction `s` of the duration `T` \[s\].
pub(super) fn point(c: &[f64; 6], bump: f64, s: f64, T: f64) -> JointPoint {
    let s = s.clamp(0.0, 1.0);
    let value = |c: &[f64]| c.iter().rev().fold(0.0, |sum, c| sum * s + c);
    let first: [f64; 5] = std::array::from_fn(|k| (k + 1) as f64 * c[k + 1]);
    let second: [f64; 4] = std::array::from_fn(|k| (k + 1) as f64 * first[k + 1]);
    let r = s * (1.0 - s);
    let (dr, ddr) = (1.0 - 2.0 * s, -2.0);
    let (b, db, ddb) = (
        r.powi(3),
        3.0 * r * r * dr,
        6.0 * r * dr * dr + 3.0 * r * r * ddr,
    );
    let bump = 64.0 * bump;
    JointPoint {
        position: value(c) + bump * b,
        rate: (value(&first) + bump * db) / T,
        acceleration: (value(&second) + bump * ddb) / (T * T),
    }
}

/// The polynomial with coefficients `c` at the fraction `s` of the duration `T` \[s\].
pub(super) fn quintic_at(c: &[f64; 6], s: f64, T: f64) -> JointPoint {
    point(c, 0.0, s, T)
}

/// Coefficients in `s` of the quintic between two points, `T` \[s\] apart.
pub(super) fn quintic(from: &JointPoint, to: &JointPoint, T: f64) -> [f64; 6] {
    let (v0, a0) = (from.rate * T, from.acceleration * T * T);
    let way = to.position - from.position - v0 - 0.5 * a0;
    let (rate, bend) = (to.rate * T - v0 - a0, to.acceleration * T * T - a0);
    [
        from.position,
        v0,
        0.5 * a0,
        10.0 * way - 4.0 * rate + 0.5 * bend,
        -15.0 * way + 7.0 * rate - bend,
        6.0 * way - 3.0 * rate + 0.5 * bend,
    ]
}

/// Rank of an error: how close to a feasible plan the failure is.
pub(super) fn rank(error: &PlanError) -> u8 {
    match error {
        PlanError::Unknown(_) => 0,
        PlanError::NoPosture(_) | PlanError::NotReached { .. } => 1,
        PlanError::Singular { .. } => 2,
        PlanError::Clearance { .. } => 3,
        PlanError::Joint { .. } => 4,
    }
}
