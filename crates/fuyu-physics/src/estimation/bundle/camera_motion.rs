//! The camera's own rotation, known from another source; it is removed before the body's motion is fitted.

use nalgebra::{UnitQuaternion, Vector3};

use crate::spatial::exp_so3;

/// Rotation of the camera over time. It also defines the inertial axes of the result.
#[derive(Debug, Clone, PartialEq, Default)]
pub enum CameraMotion {
    /// No rotation: inertial axes are the camera's.
    #[default]
    Fixed,
    /// Attitudes `R_WC` at times \[s\], ascending, with constant angular velocity between them.
    Attitudes(Vec<(f64, UnitQuaternion<f64>)>),
    /// Angular velocities of the camera in its own axes \[rad/s\] at times \[s\], ascending, as a gyroscope
    /// measures them; linear between samples. Inertial axes are the camera's at the first sample.
    Rates(Vec<(f64, Vector3<f64>)>),
}

impl CameraMotion {
    /// The motion as attitudes. Empty for a fixed camera.
    fn attitudes(&self) -> Vec<(f64, UnitQuaternion<f64>)> {
        match self {
            Self::Fixed => Vec::new(),
            Self::Attitudes(all) => all.clone(),
            Self::Rates(rates) => {
                let mut R_WC = UnitQuaternion::identity();
                let mut all: Vec<_> = rates.first().map(|r| (r.0, R_WC)).into_iter().collect();
                for pair in rates.windows(2) {
                    R_WC *= rotation_between(&pair[0], &pair[1]);
                    R_WC.renormalize();
                    all.push((pair[1].0, R_WC));
                }
                all
            }
        }
    }

    /// A description of the first invalid sample, if there is one: times that do not increase, or numbers that are not
    /// finite.
    pub(super) fn fault(&self) -> Option<String> {
        let (times, finite): (Vec<f64>, bool) = match self {
            Self::Fixed => return None,
            Self::Attitudes(all) => (
                all.iter().map(|a| a.0).collect(),
                all.iter().all(|a| a.1.coords.iter().all(|q| q.is_finite())),
            ),
            Self::Rates(all) => (
                all.iter().map(|a| a.0).collect(),
                all.iter().all(|a| a.1.iter().all(|w| w.is_finite())),
            ),
        };
        if !(finite && times.iter().all(|t| t.is_finite())) {
            return Some("a time, attitude or angular velocity is not finite".to_owned());
        }
        if times.is_empty() {
            return Some(
                "it has no samples; a camera that does not rotate is CameraMotion::Fixed"
                    .to_owned(),
            );
        }
        let back = times.windows(2).position(|t| t[1] <= t[0])?;
        Some(format!(
            "sample {} is at {} s, but the sample before is at {} s; times must increase",
            back + 1,
            times[back + 1],
            times[back]
        ))
    }

    /// The attitude `R_WC` as a function of time \[s\]. Beyond the samples the camera continues at the rate between the
    /// last (or first) two.
    pub fn lookup(&self) -> impl Fn(f64) -> UnitQuaternion<f64> {
        let all = self.attitudes();
        move |time| attitude_at(&all, time)
    }
}

/// Rotation from one sample of the angular velocity (time \[s\], body axes \[rad/s\]) to the next, for an angular
/// velocity that changes linearly.
pub fn rotation_between(
    (t0, w0): &(f64, Vector3<f64>),
    (t1, w1): &(f64, Vector3<f64>),
) -> UnitQuaternion<f64> {
    let h = t1 - t0;
    // Fourth-order Magnus expansion for a linear rate: the mean, and a term for the change of the axis.
    exp_so3(&((w0 + w1) * (0.5 * h) + w0.cross(w1) * (h * h / 12.0)))
}

/// The attitude at `time` \[s\] from `samples` in the order of time, with constant angular velocity between samples
/// and, beyond the ends, that of the nearest two. Identity without samples.
pub fn attitude_at(samples: &[(f64, UnitQuaternion<f64>)], time: f64) -> UnitQuaternion<f64> {
    match samples {
        [] => UnitQuaternion::identity(),
        [(_, only)] => *only,
        several => {
            let after = several.partition_point(|(t, _)| *t <= time);
            let after = after.clamp(1, several.len() - 1);
            let ((t0, R0), (t1, R1)) = (several[after - 1], several[after]);
            let turn = (R0.inverse() * R1).scaled_axis();
            R0 * exp_so3(&(turn * ((time - t0) / (t1 - t0))))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_are_integrated_to_the_right_attitude() {
        // The axis moves on a cone, so adding rotation vectors would be wrong.
        let rate = |t: f64| Vector3::new(0.3 * t.cos(), 0.3 * t.sin(), 0.5);
        let sampled = |count: u32| {
            let h = 10.0 / f64::from(count);
            let rates = (0..=count).map(|i| (h * f64::from(i), rate(h * f64::from(i))));
            CameraMotion::Rates(rates.collect()).lookup()(10.0)
        };
        let fine = sampled(20_000);
        assert!(sampled(200).angle_to(&fine) < 2e-4);
        assert!(sampled(400).angle_to(&fine) < 5e-5);
    }

    #[test]
    fn attitudes_are_interpolated_and_extended() {
        let at = |a: f64| UnitQuaternion::from_scaled_axis(Vector3::x() * a);
        let camera = CameraMotion::Attitudes(vec![(1.0, at(0.1)), (2.0, at(0.3))]);
        for (t, angle) in [(1.0, 0.1), (1.5, 0.2), (2.0, 0.3), (3.0, 0.5), (0.5, 0.0)] {
            assert!(camera.lookup()(t).angle_to(&at(angle)) < 1e-12);
        }
        assert_eq!(
            CameraMotion::Fixed.lookup()(7.0),
            UnitQuaternion::identity()
        );
    }

    #[test]
    fn faults_are_named() {
        let camera = CameraMotion::Rates(vec![(1.0, Vector3::x()), (0.5, Vector3::x())]);
        let fault = camera.fault().unwrap();
        assert_eq!(
            fault,
            "sample 1 is at 0.5 s, but the sample before is at 1 s; times must increase"
        );
        assert!(CameraMotion::Rates(vec![]).fault().is_some());
        assert_eq!(CameraMotion::Fixed.fault(), None);
    }
}
