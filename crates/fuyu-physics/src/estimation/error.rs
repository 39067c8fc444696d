//! Why a motion could not be estimated.

use crate::vision::PinholeError;

/// Why tracks do not tell a motion. Each is one line that names what is wrong and what would be right.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum EstimateError {
    /// The camera cannot be.
    #[error(transparent)]
    Camera(#[from] PinholeError),
    /// The camera's own motion cannot be used.
    #[error("camera motion: {0}")]
    CameraMotion(String),
    /// There are too few frames.
    #[error("too few frames show features: {have}; at least {need} are needed")]
    TooFewFrames {
        /// Frames with features.
        have: usize,
        /// Frames that are needed.
        need: usize,
    },
    /// No frames share enough points.
    #[error(
        "no two frames next to each other have more than {most} points in common; at least {need} are needed"
    )]
    TooFewPoints {
        /// The most points that two have in common.
        most: usize,
        /// Points that are needed.
        need: usize,
    },
    /// All points lie on a line.
    #[error("the points lie on a line in every frame; they must spread in two directions")]
    Collinear,
    /// Nothing moves.
    #[error("the view is constant: no point moves by more than {largest:.2} px")]
    Constant {
        /// The largest movement \[px\].
        largest: f64,
    },
    /// No rigid body explains the images.
    #[error(
        "no turning rigid body explains the tracks ({consistent} of {frames} frames fit together); are the ids right, \
         and is the camera's focal length?"
    )]
    NotRigid {
        /// Frames that fit together.
        consistent: usize,
        /// All frames.
        frames: usize,
    },
    /// A rigid body, but its motion is not a free one.
    #[error(
        "the images are those of a rigid body, but free rotation leaves {rms:.1} px; does the camera turn, or a \
         torque act?"
    )]
    NotFree {
        /// Root mean square of the residuals \[px\].
        rms: f64,
    },
    /// Other motions look alike.
    #[error(
        "the body has turned by only {turn:.2} rad: rates from {:.3} to {:.3} rad/s, with other depths of the body, explain \
         the images alike; observe longer, or from nearer",
        .rates[0], .rates[1]
    )]
    Ambiguous {
        /// By how much the body turned in the best of them \[rad\].
        turn: f64,
        /// The least and the largest rate \[rad/s\].
        rates: [f64; 2],
    },
}
