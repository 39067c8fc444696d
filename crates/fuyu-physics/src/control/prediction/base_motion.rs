//! Motion of the base relative to the system's centre of mass.

use std::collections::VecDeque;

use nalgebra::{Rotation3, Translation3, UnitQuaternion, Vector3};

use crate::spatial::{Pose, exp_so3};

/// Number of samples kept: 20 s at 100 Hz, longer than the latency of any sensor.
const CAPACITY: usize = 2000;

/// Largest interval between samples over which the motion is interpolated \[s\].
const MAX_GAP: f64 = 0.5;

/// State of base and tip at one time, from gyro and encoders.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::control) struct BaseState {
    /// Time \[s\].
    pub time: f64,
    /// Attitude of the base in I.
    pub R_IB: UnitQuaternion<f64>,
    /// Position of the base frame's origin relative to the system's centre of mass, axes of I \[m\].
    pub p_IB: Vector3<f64>,
    /// Angular velocity of the base, base axes \[rad/s\].
    pub w_IB_B: Vector3<f64>,
    /// Tip pose from the encoders.
    pub X_BE: Pose,
}

impl BaseState {
    /// Pose of the base in I.
    pub fn X_IB(&self) -> Pose {
        Pose::from_parts(
            Translation3::from(self.p_IB),
            self.R_IB.to_rotation_matrix(),
        )
    }
}

/// The last seconds of the base's motion in I, the non-rotating frame at the system's centre of mass. Its axes are
/// those of the base at the first sample. They drift slowly with the gyro, without effect, because only differences
/// over a sensor's latency are used.
#[derive(Debug, Clone)]
pub(in crate::control) struct BaseMotion {
    samples: VecDeque<BaseState>,
}

impl Default for BaseMotion {
    fn default() -> Self {
        Self {
            samples: VecDeque::with_capacity(CAPACITY),
        }
    }
}

impl BaseMotion {
    /// Adds the sample at `time` \[s\]: `w_IB_B` is the gyro's measurement \[rad/s\]; `p_BC`, the system's centre of
    /// mass, and `X_BE`, the tip in the base frame, are from the encoders. Attitude is integrated by the fourth-order
    /// Magnus expansion for a linearly changing rate. A jump back in time or a gap starts a new frame I; returns
    /// whether it did.
    pub fn advance(
        &mut self,
        time: f64,
        w_IB_B: &Vector3<f64>,
        p_BC: &Vector3<f64>,
        X_BE: &Pose,
    ) -> bool {
        let last = self.samples.back().copied();
        let last = last.filter(|last| time >= last.time && time - last.time <= MAX_GAP);
        let mut R_IB = UnitQuaternion::identity();
        if let Some(last) = last {
            let h = time - last.time;
            let w = &last.w_IB_B;
            R_IB =
                last.R_IB * exp_so3(&((w + w_IB_B) * (0.5 * h) + w.cross(w_IB_B) * (h * h / 12.0)));
            R_IB.renormalize();
            if h == 0.0 {
                self.samples.pop_back();
            }
        } else {
            self.samples.clear();
        }
        if self.samples.len() == CAPACITY {
            self.samples.pop_front();
        }
        self.samples.push_back(BaseState {
            time,
            R_IB,
            p_IB: -(R_IB * p_BC),
            w_IB_B: *w_IB_B,
            X_BE: *X_BE,
        });
        last.is_none()
    }

    /// The newest sample.
    pub fn last(&self) -> Option<&BaseState> {
        self.samples.back()
    }

    /// State of base and tip at `time` \[s\], linearly interpolated; `None` before the first or after the last sample.
    pub fn at(&self, time: f64) -> Option<BaseState> {
        const SLACK: f64 = 1e-6;
        let (first, last) = (self.samples.front()?, self.samples.back()?);
        if time < first.time - SLACK || time > last.time + SLACK {
            return None;
        }
        let after = self.samples.partition_point(|m| m.time < time - SLACK);
        let b = self.samples.get(after).unwrap_or(last);
        if (b.time - time).abs() <= SLACK || after == 0 {
            return Some(*b);
        }
        let a = &self.samples[after - 1];
        let s = (time - a.time) / (b.time - a.time);
        let tip = a.X_BE.rotation.rotation_to(&b.X_BE.rotation);
        let tip = exp_so3(&(UnitQuaternion::from(tip).scaled_axis() * s)).to_rotation_matrix();
        let position = a
            .X_BE
            .translation
            .vector
            .lerp(&b.X_BE.translation.vector, s);
        Some(BaseState {
            time,
            R_IB: a.R_IB * exp_so3(&((a.R_IB.inverse() * b.R_IB).scaled_axis() * s)),
            p_IB: a.p_IB.lerp(&b.p_IB, s),
            w_IB_B: a.w_IB_B.lerp(&b.w_IB_B, s),
            X_BE: Pose::from_parts(
                Translation3::from(position),
                Rotation3::from_matrix_unchecked((tip * a.X_BE.rotation).into_inner()),
            ),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tip(x: f64, angle: f64) -> Pose {
        Pose::from_parts(
            Translation3::new(x, 0.0, 0.0),
            Rotation3::from_euler_angles(0.0, 0.0, angle),
        )
    }

    #[test]
    fn attitude_of_a_coning_base_is_integrated_and_interpolated() {
        // R = Rz(a t) Rx(b t) turns with w = (b, a sin bt, a cos bt) in its own axes.
        let (a, b) = (0.3, 0.5);
        let mut base = BaseMotion::default();
        for k in 0..=500 {
            let t = 0.01 * f64::from(k);
            let w = Vector3::new(b, a * (b * t).sin(), a * (b * t).cos());
            base.advance(t, &w, &Vector3::x(), &tip(t, t));
        }
        let truth = |t: f64| {
            UnitQuaternion::from_axis_angle(&Vector3::z_axis(), a * t)
                * UnitQuaternion::from_axis_angle(&Vector3::x_axis(), b * t)
        };
        for t in [1.0, 2.345, 4.999] {
            let state = base.at(t).unwrap();
            // The rate does not change quite linearly: errors of 6e-9 rad per sample, and 2e-6 between samples.
            assert!(state.R_IB.angle_to(&truth(t)) < 6e-6, "{t}");
            assert!((state.p_IB + truth(t) * Vector3::x()).norm() < 1e-5);
            assert!((state.X_BE.translation.x - t).abs() < 1e-12);
            assert!(state.X_BE.rotation.angle_to(&tip(t, t).rotation) < 1e-7);
        }
        assert!(base.last().unwrap().R_IB.angle_to(&truth(5.0)) < 4e-6);
    }

    #[test]
    fn times_outside_the_samples_have_no_state() {
        let mut base = BaseMotion::default();
        let (w, p) = (Vector3::zeros(), Vector3::zeros());
        assert!(base.at(0.0).is_none());
        assert!(base.advance(1.0, &w, &p, &tip(1.0, 0.0)));
        assert!(!base.advance(1.1, &w, &p, &tip(1.1, 0.0)));
        assert!(base.at(0.9).is_none() && base.at(1.2).is_none());
        assert!(base.advance(3.0, &w, &p, &tip(3.0, 0.0)), "a gap");
        assert!(base.at(1.05).is_none());
        assert!(base.advance(2.0, &w, &p, &tip(2.0, 0.0)), "a new run");
        assert!(
            !base.advance(2.0, &w, &p, &tip(2.5, 0.0)),
            "a repeated sample"
        );
        assert_eq!(base.last().unwrap().X_BE.translation.x, 2.5);
    }
}
