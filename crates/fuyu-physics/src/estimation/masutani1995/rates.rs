//! Angular velocity from consecutive views: Masutani 1995 eq. (2.4).

use nalgebra::{UnitQuaternion, Vector3};

use super::MasutaniError;
use crate::estimation::Tracks;
use crate::estimation::two_view::{common_rays, two_view_motion};
use crate::vision::Pinhole;

/// An angular velocity \[rad/s\] in camera axes, and its time \[s\].
pub type Rate = (f64, Vector3<f64>);

/// The mean angular velocity between two attitudes, stamped at the middle of the interval. The text does not
/// specify the stamp; stamps at its beginning increase the error of the predicted direction by a factor of five.
pub fn mean_rate(
    (before, R_before): (f64, UnitQuaternion<f64>),
    (after, R_after): (f64, UnitQuaternion<f64>),
) -> Rate {
    let turned = (R_after * R_before.inverse()).scaled_axis();
    (0.5 * (before + after), turned / (after - before))
}

/// Angular velocities from all pairs of consecutive frames that determine one.
///
/// # Errors
/// [`MasutaniError::Empty`] without frames; [`MasutaniError::TwoView`], that of the first pair, if no pair
/// determines a motion.
pub fn rates_from_tracks(tracks: &Tracks, camera: &Pinhole) -> Result<Vec<Rate>, MasutaniError> {
    let mut rates = Vec::new();
    let mut first_failure = None;
    for pair in tracks.frames().windows(2) {
        let (before, after) = (pair[0].time, pair[1].time);
        match two_view_motion(&common_rays(camera, &pair[0], &pair[1])) {
            Ok(motion) => {
                let turned = UnitQuaternion::from_rotation_matrix(&motion.R);
                let start = (before, UnitQuaternion::identity());
                rates.push(mean_rate(start, (after, turned)));
            }
            Err(reason) => {
                first_failure.get_or_insert(MasutaniError::TwoView {
                    before,
                    after,
                    reason,
                });
            }
        }
    }
    match first_failure {
        Some(failure) if rates.is_empty() => Err(failure),
        None if rates.is_empty() => Err(MasutaniError::Empty),
        _ => Ok(rates),
    }
}
