//! Camera intrinsics as unknowns: prior on the focal length.

/// Weight that holds the focal length at its nominal value \[px²\].
const FIXED: f64 = 1e14;

/// Standard deviation of the nominal focal length where it is estimated, over its value.
const FOCAL_DEVIATION: f64 = 0.1;

/// Weight of the prior on the logarithm of the focal length \[px²\], for image noise `noise` \[px\].
pub fn focal_prior_weight(is_estimated: bool, noise: f64) -> f64 {
    if is_estimated {
        (noise / FOCAL_DEVIATION).powi(2)
    } else {
        FIXED
    }
}
