//! Attitude of a camera from the gyro of the base that carries it.

use nalgebra::{UnitQuaternion, Vector3};

use super::bundle::{CameraMotion, attitude_at, rotation_between};

/// The camera's attitude over time, integrated from its angular velocity. Its reference axes G are inertial: those of
/// the camera at the first sample since the last gap.
#[derive(Debug, Default)]
pub struct GyroAttitude {
    /// `R_GC` over time.
    attitudes: Vec<(f64, UnitQuaternion<f64>)>,
    /// Time \[s\] and angular velocity \[rad/s\] of the last sample, camera axes.
    last: Option<(f64, Vector3<f64>)>,
    restarts: u32,
}

/// Samples further apart than this \[s\] do not determine the rotation between them.
pub const GYRO_GAP: f64 = 0.5;

impl GyroAttitude {
    /// Adds a sample: time \[s\] and the camera's angular velocity in its own axes \[rad/s\]. A sample before the last one
    /// is ignored; one after a gap, or more than a gap before the last one, restarts the integration.
    pub fn add(&mut self, time: f64, w_WC_C: Vector3<f64>) {
        let sample = (time, w_WC_C);
        match self.last.replace(sample) {
            Some(last) if time <= last.0 && time >= last.0 - GYRO_GAP => self.last = Some(last),
            Some(last) if time > last.0 && time <= last.0 + GYRO_GAP => {
                let mut R_GC =
                    attitude_at(&self.attitudes, last.0) * rotation_between(&last, &sample);
                R_GC.renormalize();
                self.attitudes.push((time, R_GC));
            }
            _ => {
                self.attitudes = vec![(time, UnitQuaternion::identity())];
                self.restarts += 1;
            }
        }
    }

    /// Forgets all samples.
    pub fn clear(&mut self) {
        self.attitudes.clear();
        self.last = None;
    }

    /// Discards samples older than `time` \[s\].
    pub fn forget_before(&mut self, time: f64) {
        // The last sample before `time` is needed for the attitude at `time`.
        let old = self.attitudes.partition_point(|(t, _)| *t <= time);
        self.attitudes.drain(..old.saturating_sub(1));
    }

    /// Number of restarts of the integration. Each restart changes the axes G and makes earlier results in G invalid.
    pub fn restarts(&self) -> u32 {
        self.restarts
    }

    /// Time from which the attitude is known without a gap \[s\].
    pub fn known_since(&self) -> Option<f64> {
        self.attitudes.first().map(|(time, _)| *time)
    }

    /// Time of the newest sample \[s\]; attitudes after it are extrapolated.
    pub fn known_until(&self) -> Option<f64> {
        self.last.map(|(time, _)| time)
    }

    /// Attitude `R_GC` at `time` \[s\]; identity without samples.
    pub fn R_GC(&self, time: f64) -> UnitQuaternion<f64> {
        attitude_at(&self.attitudes, time)
    }

    /// The camera's motion for a batch solution.
    pub fn motion(&self) -> CameraMotion {
        match self.attitudes.len() {
            0 => CameraMotion::Fixed,
            _ => CameraMotion::Attitudes(self.attitudes.clone()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn constant(times: impl Iterator<Item = u32>) -> GyroAttitude {
        let mut gyro = GyroAttitude::default();
        times.for_each(|k| gyro.add(0.1 * f64::from(k), Vector3::z() * 0.2));
        gyro
    }

    #[test]
    fn a_constant_rate_is_integrated() {
        let gyro = constant(0..=100);
        let expected = UnitQuaternion::from_scaled_axis(Vector3::z() * 1.0);
        assert!(gyro.R_GC(5.0).angle_to(&expected) < 1e-12);
        assert_eq!((gyro.restarts(), gyro.known_since()), (1, Some(0.0)));
    }

    #[test]
    fn a_gap_restarts_and_a_late_sample_is_ignored() {
        let mut gyro = constant((0..=10).chain([8]).chain(11..=20));
        assert_eq!(gyro.restarts(), 1);
        let expected = UnitQuaternion::from_scaled_axis(Vector3::z() * 0.4);
        assert!(gyro.R_GC(2.0).angle_to(&expected) < 1e-12);
        gyro.add(2.6, Vector3::zeros());
        assert_eq!((gyro.restarts(), gyro.known_since()), (2, Some(2.6)));
        assert_eq!(gyro.R_GC(2.6), UnitQuaternion::identity());
    }

    #[test]
    fn forgetting_keeps_the_attitude_afterwards() {
        let mut gyro = constant(0..=100);
        let before = gyro.R_GC(5.04);
        gyro.forget_before(5.03);
        assert_eq!(gyro.R_GC(5.04), before);
        assert_eq!(
            gyro.motion(),
            CameraMotion::Attitudes(gyro.attitudes.clone())
        );
        gyro.clear();
        assert_eq!(gyro.motion(), CameraMotion::Fixed);
    }
}
