//! A tip that does not come nearer to its goal: noticed, named, and where it rests in a singular position, pushed on.

use std::f64::consts::PI;

use nalgebra::DVector;

use super::gains::{check_not_negative, check_positive};
use super::{GainError, Gains, LyapunovFunction, Measurement, PoseError};

/// When and how a resting arm is pushed on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SingularityEscapeConfig {
    /// Joint rate that a kick would hold against `K_V` \[rad/s or m/s\]; zero never kicks.
    pub rate: f64,
    /// How long the tip must have rested before \[s\].
    pub delay: f64,
}

impl Default for SingularityEscapeConfig {
    /// A tenth of a radian in all, after 2 s.
    fn default() -> Self {
        Self {
            rate: 0.1,
            delay: 2.0,
        }
    }
}

impl SingularityEscapeConfig {
    /// Refuses what has the wrong sign.
    ///
    /// # Errors
    /// [`GainError`] naming the setting.
    pub fn check(&self) -> Result<(), GainError> {
        check_not_negative("singularity_escape.rate", self.rate)?;
        check_positive("singularity_escape.delay", self.delay)
    }
}

/// Why the tip does not arrive.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum ConvergenceFailure {
    /// No posture reaches the goal.
    #[error(
        "the goal is {excess:.3} m farther from the system's centre of mass than the tip can come: the arm is pulled towards it and will rest stretched"
    )]
    OutOfWorkspace {
        /// By how much \[m\].
        excess: f64,
    },
    /// The pull moves no joint: a singular position, eq. (5.4).
    #[error(
        "the tip rests {position:.3} m and {angle:.3} rad from the goal in a position where the pull moves no joint; {escapes} escape motions did not free it"
    )]
    AtSingularity {
        /// Distance from the goal \[m\].
        position: f64,
        /// Angle to the goal \[rad\].
        angle: f64,
        /// Kicks that were given.
        escapes: u32,
    },
    /// The tip moves, but not towards the goal.
    #[error(
        "the deviation has not fallen for {seconds:.0} s: {position:.3} m and {angle:.3} rad remain"
    )]
    NoProgress {
        /// For how long \[s\].
        seconds: f64,
        /// Distance from the goal \[m\].
        position: f64,
        /// Angle to the goal \[rad\].
        angle: f64,
    },
}

/// Deviations that count as none \[m, rad\]: a camera's noise is of this size.
const NEAR: (f64, f64) = (0.02, 0.035);
/// How long a kick lasts \[s\].
const KICK: f64 = 2.0;
/// Kicks that are tried before the arm is left alone.
const KICKS: u32 = 3;
/// A pull that would take longer than this to bring the potential down moves nothing \[s\].
const FOREVER: f64 = 300.0;
/// Time without progress that is worth a word \[s\].
const LONG: f64 = 20.0;

/// Looks whether the deviation falls, and kicks where the arm rests in a singular position.
///
/// The thesis leaves such a position by "an input added for a while" (section 5.3). Here that is half a sine of joint
/// efforts, `k_v · rate` at most, with other signs for every kick. It adds no more than
/// `KICK rate² Σ k_v / 8` to the Lyapunov function, and at most [`KICKS`] kicks are given until the potential
/// has fallen below what it was: the arm comes to rest again.
#[derive(Debug, Clone)]
pub(super) struct Watch {
    pub config: SingularityEscapeConfig,
    /// The least potential so far, and when it was reached.
    least: Option<(f64, f64)>,
    resting_since: Option<f64>,
    /// When the present kick began.
    kick: Option<f64>,
    kicks: u32,
}

impl Watch {
    pub fn new(config: SingularityEscapeConfig) -> Self {
        Self {
            config,
            least: None,
            resting_since: None,
            kick: None,
            kicks: 0,
        }
    }

    /// Begins anew: other gains, another goal, or no camera.
    pub fn forget(&mut self) {
        *self = Self::new(self.config);
    }

    /// Looks at one instant: the deviation, the pull on the joints, and by how much the goal is out of reach
    /// \[m\].
    pub fn look(
        &mut self,
        seen: &Measurement<'_>,
        gains: &Gains,
        error: &PoseError,
        pull: &DVector<f64>,
        short: Option<f64>,
    ) -> Option<ConvergenceFailure> {
        let (time, angle) = (seen.time, if gains.k_o > 0.0 { error.angle } else { 0.0 });
        let position = error.position.norm();
        let potential = LyapunovFunction::potential_of(gains, error);
        // Time that began anew, or a goal that went elsewhere.
        let new = |(least, at): (f64, f64)| time < at || potential > 2.0 * least + 1e-9;
        if self.kick.is_none() && self.least.is_some_and(new) {
            self.forget();
        }
        if position < NEAR.0 && angle < NEAR.1 {
            self.forget();
            return None;
        }
        let (least, at) = *self.least.get_or_insert((potential, time));
        if potential < 0.99 * least {
            self.least = Some((potential, time));
            self.kicks = 0;
        }
        if self.kick.is_some_and(|began| time - began > KICK) {
            self.kick = None;
            self.resting_since = None;
        }
        if let Some(short) = short {
            return Some(ConvergenceFailure::OutOfWorkspace { excess: short });
        }
        let rests = Self::rests(gains, potential, pull, seen.qd);
        if !rests || self.kick.is_some() {
            self.resting_since = None;
            let seconds = time - at;
            return (seconds > LONG).then_some(ConvergenceFailure::NoProgress {
                seconds,
                position,
                angle,
            });
        }
        let since = *self.resting_since.get_or_insert(time);
        if time - since < self.config.delay {
            return None;
        }
        if self.config.rate > 0.0 && self.kicks < KICKS {
            self.kicks += 1;
            self.kick = Some(time);
            return None;
        }
        Some(ConvergenceFailure::AtSingularity {
            position,
            angle,
            escapes: self.kicks,
        })
    }

    /// Whether neither the pull nor the motion brings the potential down.
    fn rests(gains: &Gains, potential: f64, pull: &DVector<f64>, qd: &DVector<f64>) -> bool {
        let joints = gains.k_v.iter().zip(pull).zip(qd);
        let (pulled, moved) = joints.fold((0.0, 0.0), |(pulled, moved), ((k, pull), qd)| {
            (pulled + pull * pull / k, moved + k * qd * qd)
        });
        pulled.max(moved) * FOREVER < potential
    }

    /// What a kick adds to joint `j` now \[N m or N\].
    pub fn kick(&self, time: f64, j: usize, k_v: f64) -> f64 {
        let Some(began) = self.kick else { return 0.0 };
        let side = if (self.kicks >> (j % 2)) & 1 == 1 {
            1.0
        } else {
            -1.0
        };
        let wave = (PI * ((time - began) / KICK).clamp(0.0, 1.0)).sin();
        side * wave * k_v * self.config.rate
    }
}
