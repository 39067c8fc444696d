//! Errors of the estimation: the reasons why there is no estimate.

use nalgebra::Vector3;

use crate::estimation::two_view::TwoViewError;

/// Why there is no estimate.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MasutaniError {
    /// No pair of frames.
    #[error("there are fewer than two frames")]
    Empty,
    /// No pair of frames determines a motion.
    #[error(
        "frames at {before} s and {after} s: {reason}; no other two consecutive frames determine a motion either"
    )]
    TwoView {
        /// Time of the first such frame \[s\].
        before: f64,
        /// Time of the frame after it \[s\].
        after: f64,
        /// Why they do not determine a motion.
        reason: TwoViewError,
    },
    /// Too few angular velocities.
    #[error("there are {0} angular velocities; at least {min} are needed", min = super::analysis::MIN_RATES)]
    TooFew(usize),
    /// A time or an angular velocity is NaN or infinite.
    #[error("sample {0}: time and angular velocity must be finite")]
    NotFinite(usize),
    /// Times do not increase.
    #[error(
        "sample {sample}: time is {time} s, but the sample before is at {before} s; times must increase"
    )]
    Order {
        /// Index of the sample, from 0.
        sample: usize,
        /// Its time \[s\].
        time: f64,
        /// The time of the sample before \[s\].
        before: f64,
    },
    /// The body does not turn.
    #[error("the body does not turn: every angular velocity is zero")]
    AtRest,
    /// No invariable plane fits.
    #[error(
        "the angular velocities do not lie in a common plane away from zero, as those of a free body do"
    )]
    NoPlane,
    /// The waveform cannot be fitted.
    #[error("no waveform of a free rotation fits the squared angular velocity (period {period} s)")]
    NoFit {
        /// The period tried \[s\].
        period: f64,
    },
    /// No body has the moments found.
    #[error(
        "the {model} model gives J = ({}, {}, {}) s² with alpha = {alpha} s²: no rigid body has this motion (too much noise, or the wrong model)",
        J.x, J.y, J.z
    )]
    Impossible {
        /// The model's name.
        model: &'static str,
        /// Moments over twice the energy \[s²\].
        J: Vector3<f64>,
        /// `alpha` \[s²\].
        alpha: f64,
    },
}
