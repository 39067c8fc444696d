//! Detection of a tip that does not converge to its goal, and escape from singular positions.

use std::f64::consts::PI;

use nalgebra::DVector;

use super::gains::{ConfigError, check_not_negative, check_positive};
use super::{Gains, LyapunovFunction, PoseError};

/// Conditions and size of the motion by which the arm leaves a singular position in which it has come to rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SingularityEscapeConfig {
    /// Amplitude of the escape motion: the joint rate that its efforts would hold against `K_V` \[rad/s or m/s\]; zero
    /// disables it.
    pub rate: f64,
    /// Time for which the arm must have rested before \[s\].
    pub delay: f64,
}

impl Default for SingularityEscapeConfig {
    /// An escape motion of about a tenth of a radian, after 2 s at rest.
    fn default() -> Self {
        Self {
            rate: 0.1,
            delay: 2.0,
        }
    }
}

impl SingularityEscapeConfig {
    /// Refuses settings of the wrong sign or that are not finite.
    ///
    /// # Errors
    /// [`ConfigError`] names the setting.
    pub fn check(&self) -> Result<(), ConfigError> {
        check_not_negative("singularity_escape.rate", self.rate)?;
        check_positive("singularity_escape.delay", self.delay)
    }
}

/// Why the tip does not converge to its goal.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum ConvergenceFailure {
    /// No posture reaches the goal.
    #[error(
        "the goal is {excess:.3} m farther from the system's centre of mass than the tip can come: the arm will rest stretched towards it"
    )]
    OutOfWorkspace {
        /// Distance of the goal beyond the workspace \[m\].
        excess: f64,
    },
    /// The wrench on the tip moves no joint: a singular position, eq. (5.4).
    #[error(
        "the tip rests {position:.3} m and {angle:.3} rad from the goal in a singular position, where the control law moves no joint; {escapes} escape motions did not free it"
    )]
    AtSingularity {
        /// Distance from the goal \[m\].
        position: f64,
        /// Angle to the goal \[rad\].
        angle: f64,
        /// Number of escape motions so far.
        escapes: u32,
    },
    /// The tip moves, but not towards the goal.
    #[error(
        "the deviation has not decreased for {seconds:.0} s: {position:.3} m and {angle:.3} rad remain"
    )]
    NoProgress {
        /// Time without a decrease \[s\].
        seconds: f64,
        /// Distance from the goal \[m\].
        position: f64,
        /// Angle to the goal \[rad\].
        angle: f64,
    },
}

/// Deviation below which the tip has arrived \[m, rad\]: a camera's noise is of this size.
const ARRIVED: (f64, f64) = (0.02, 0.035);
/// Duration of an escape motion \[s\].
const ESCAPE_DURATION: f64 = 2.0;
/// Number of escape motions after which the arm is left at rest.
const MAX_ESCAPES: u32 = 3;
/// Efforts that would take longer than this to decrease the potential are treated as zero \[s\].
const SLOWEST_DECREASE: f64 = 300.0;
/// Time without progress after which it is reported \[s\].
const PROGRESS_TIMEOUT: f64 = 20.0;
/// Distance outside the workspace that may still be due to the camera's error \[m\].
const WORKSPACE_TOLERANCE: f64 = 0.01;

/// Checks whether the deviation decreases, and starts an escape motion where the arm rests in a singular position.
///
/// The thesis leaves such a position by "an input added for a while" (section 5.3). Here the input is half a sine of
/// joint efforts, at most `k_v · rate`, with other signs in every escape motion. It adds at most `ESCAPE_DURATION rate²
/// Σ k_v / 8` to the Lyapunov function, and there are at most [`MAX_ESCAPES`] motions until the potential is lower than
/// before: the arm comes to rest again.
#[derive(Debug, Clone)]
pub(super) struct ConvergenceMonitor {
    pub config: SingularityEscapeConfig,
    /// The lowest potential so far, and when it was reached.
    lowest: Option<(f64, f64)>,
    resting_since: Option<f64>,
    /// When the present escape motion began.
    escape_start: Option<f64>,
    escapes: u32,
}

/// Input of [`ConvergenceMonitor`] at one instant.
#[derive(Debug)]
pub(super) struct Progress<'a> {
    /// Time \[s\].
    pub time: f64,
    /// Joint rates.
    pub qd: &'a DVector<f64>,
    /// Gains of the law.
    pub gains: &'a Gains,
    /// Deviation of the tip.
    pub error: &'a PoseError,
    /// Efforts of the law, without joint damping.
    pub efforts: &'a DVector<f64>,
    /// Distance of the goal beyond the workspace \[m\]; negative inside, `None` where the workspace is unbounded.
    pub excess: Option<f64>,
}

impl ConvergenceMonitor {
    pub fn new(config: SingularityEscapeConfig) -> Self {
        Self {
            config,
            lowest: None,
            resting_since: None,
            escape_start: None,
            escapes: 0,
        }
    }

    /// Restarts the monitor: when the gains or the goal change, or the camera measurement is missing.
    pub fn reset(&mut self) {
        *self = Self::new(self.config);
    }

    /// Evaluates one instant.
    pub fn update(&mut self, progress: &Progress<'_>) -> Option<ConvergenceFailure> {
        let Progress {
            time, gains, error, ..
        } = *progress;
        let angle = if gains.k_o > 0.0 { error.angle } else { 0.0 };
        let position = error.position.norm();
        let potential = LyapunovFunction::potential_of(gains, error);
        // A jump back in time, or another goal.
        let restarted = |(lowest, at): (f64, f64)| time < at || potential > 2.0 * lowest + 1e-9;
        if self.escape_start.is_none() && self.lowest.is_some_and(restarted) {
            self.reset();
        }
        if position < ARRIVED.0 && angle < ARRIVED.1 {
            self.reset();
            return None;
        }
        let (lowest, at) = *self.lowest.get_or_insert((potential, time));
        if potential < 0.99 * lowest {
            self.lowest = Some((potential, time));
            self.escapes = 0;
        }
        if (self.escape_start).is_some_and(|start| time - start > ESCAPE_DURATION) {
            self.escape_start = None;
            self.resting_since = None;
        }
        if let Some(excess) = progress.excess.filter(|e| *e > WORKSPACE_TOLERANCE) {
            return Some(ConvergenceFailure::OutOfWorkspace { excess });
        }
        if !rests(progress, potential) || self.escape_start.is_some() {
            self.resting_since = None;
            let seconds = time - at;
            return (seconds > PROGRESS_TIMEOUT).then_some(ConvergenceFailure::NoProgress {
                seconds,
                position,
                angle,
            });
        }
        let since = *self.resting_since.get_or_insert(time);
        if time - since < self.config.delay {
            return None;
        }
        if self.config.rate > 0.0 && self.escapes < MAX_ESCAPES {
            self.escapes += 1;
            self.escape_start = Some(time);
            return None;
        }
        Some(ConvergenceFailure::AtSingularity {
            position,
            angle,
            escapes: self.escapes,
        })
    }

    /// Effort of the escape motion on joint `j` \[N m or N\].
    pub fn escape_effort(&self, time: f64, j: usize, k_v: f64) -> f64 {
        let Some(start) = self.escape_start else {
            return 0.0;
        };
        let sign = if (self.escapes >> (j % 2)) & 1 == 1 {
            1.0
        } else {
            -1.0
        };
        let wave = (PI * ((time - start) / ESCAPE_DURATION).clamp(0.0, 1.0)).sin();
        sign * wave * k_v * self.config.rate
    }
}

/// Whether neither the efforts nor the motion decrease the potential.
fn rests(progress: &Progress<'_>, potential: f64) -> bool {
    let joints = progress.gains.k_v.iter().zip(progress.efforts);
    let (driving, dissipated) =
        joints
            .zip(progress.qd)
            .fold((0.0, 0.0), |(driving, dissipated), ((k, effort), qd)| {
                (driving + effort * effort / k, dissipated + k * qd * qd)
            });
    driving.max(dissipated) * SLOWEST_DECREASE < potential
}
