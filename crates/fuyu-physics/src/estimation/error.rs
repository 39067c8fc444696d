//! Errors of the estimation.

use crate::vision::PinholeError;

/// Why tracks do not determine a motion. Each message is one line that names the fault and the remedy.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum EstimateError {
    /// The camera's calibration is invalid.
    #[error(transparent)]
    Camera(#[from] PinholeError),
    /// The camera's own motion is invalid.
    #[error("camera motion: {0}")]
    CameraMotion(String),
    /// There are too few frames.
    #[error("too few frames show features: {have}; at least {need} are needed")]
    TooFewFrames {
        /// Number of frames with features.
        have: usize,
        /// Number of frames that are needed.
        need: usize,
    },
    /// No two frames share enough points.
    #[error(
        "no two neighbouring frames have more than {most} points in common; at least {need} are needed"
    )]
    TooFewPoints {
        /// Largest number of common points.
        most: usize,
        /// Number of points that are needed.
        need: usize,
    },
    /// All points lie on a line.
    #[error("the points lie on a line in every frame; they must spread in two directions")]
    Collinear,
    /// No point moves.
    #[error("the view is constant: no point moves by more than {largest:.2} px")]
    Constant {
        /// The largest movement \[px\].
        largest: f64,
    },
    /// No rigid body explains the images.
    #[error(
        "no rotating rigid body explains the tracks ({consistent} of {frames} frames fit together); check the ids, the \
         camera's focal length, the noise of the images (--pixel-noise), and that the body turns by less than half a turn \
         between frames"
    )]
    NotRigid {
        /// Number of frames that fit together.
        consistent: usize,
        /// Number of all frames.
        frames: usize,
    },
    /// The body is rigid, but its motion is not torque-free.
    #[error(
        "the images are those of a rigid body, but torque-free rotation leaves residuals of {rms:.1} px: are they noisier \
         than assumed (--pixel-noise), does the body turn by more than half a turn between frames, does the camera \
         rotate (--gyro), or was the body pushed?"
    )]
    NotFree {
        /// Root mean square of the residuals \[px\].
        rms: f64,
    },
    /// There are too few angular velocities.
    #[error("there are {have} angular velocities; at least {need} are needed")]
    TooFewRates {
        /// Number of samples.
        have: usize,
        /// Number of samples that are needed.
        need: usize,
    },
    /// Angular velocities are not a series in time.
    #[error("angular velocities: {0}")]
    Rates(String),
    /// No torque-free motion has these angular velocities.
    #[error(
        "torque-free rotation leaves residuals of {rms:.2e} rad/s of at most {size:.2e} rad/s: are these the angular \
         velocities of a free rigid body in inertial axes, sampled often enough?"
    )]
    NotFreeRates {
        /// Root mean square of the residuals \[rad/s\].
        rms: f64,
        /// Largest angular velocity \[rad/s\].
        size: f64,
    },
    /// Other motions explain the images equally well.
    #[error(
        "the body has turned by only {turn:.2} rad: angular rates from {:.3} to {:.3} rad/s, with different depths of the \
         body, explain the images equally well; observe longer, or from nearer",
        .rates[0], .rates[1]
    )]
    Ambiguous {
        /// Angle that the body turned in the best of these motions \[rad\].
        turn: f64,
        /// Smallest and largest angular rate \[rad/s\].
        rates: [f64; 2],
    },
}
