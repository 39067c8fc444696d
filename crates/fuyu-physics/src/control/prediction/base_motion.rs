//! How the base moves beside the system's centre of mass.

use std::collections::VecDeque;

use nalgebra::{Rotation3, Translation3, UnitQuaternion, Vector3};

use crate::spatial::{Pose, exp_so3};

/// Samples kept: 20 s at 100 Hz, more than any sensor is late.
const KEPT: usize = 2000;

/// Samples further apart than this \[s\] say nothing about the time between.
const GAP: f64 = 0.5;

/// The robot at one time, as it knows itself.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moment {
    /// Time \[s\].
    pub time: f64,
    /// Attitude of the base in I.
    pub R_IB: UnitQuaternion<f64>,
    /// Base frame's origin from the system's centre of mass, axes of I \[m\].
    pub p_IB: Vector3<f64>,
    /// Angular velocity of the base, base axes \[rad/s\].
    pub w_IB_B: Vector3<f64>,
    /// Tip pose by the encoders.
    pub X_BE: Pose,
}

impl Moment {
    /// Pose of the base in I.
    pub fn X_IB(&self) -> Pose {
        Pose::from_parts(
            Translation3::from(self.p_IB),
            self.R_IB.to_rotation_matrix(),
        )
    }
}

/// The last seconds of the base's motion in I, the frame that does not turn and moves with the system's centre
/// of mass. Its axes are those of the base at the first sample; they drift with the gyro, slowly, which nothing
/// here heeds since only differences over a sensor's latency are used.
#[derive(Debug, Clone)]
pub struct BaseMotion {
    moments: VecDeque<Moment>,
}

impl Default for BaseMotion {
    fn default() -> Self {
        Self {
            moments: VecDeque::with_capacity(KEPT),
        }
    }
}

impl BaseMotion {
    /// Goes on to `time` \[s\]. `w_IB_B` is what the gyro measures then \[rad/s\], `p_BC` the system's centre of
    /// mass and `X_BE` the tip in the base frame, by the encoders. Attitude is summed up by the fourth-order
    /// Magnus expansion for a rate that changes evenly. Time that runs backwards or leaps begins a new frame I;
    /// returns whether it did.
    pub fn advance(
        &mut self,
        time: f64,
        w_IB_B: &Vector3<f64>,
        p_BC: &Vector3<f64>,
        X_BE: &Pose,
    ) -> bool {
        let last = self.moments.back().copied();
        let last = last.filter(|last| time >= last.time && time - last.time <= GAP);
        let mut R_IB = UnitQuaternion::identity();
        if let Some(last) = last {
            let h = time - last.time;
            let w = &last.w_IB_B;
            R_IB =
                last.R_IB * exp_so3(&((w + w_IB_B) * (0.5 * h) + w.cross(w_IB_B) * (h * h / 12.0)));
            R_IB.renormalize();
            if h == 0.0 {
                self.moments.pop_back();
            }
        } else {
            self.moments.clear();
        }
        if self.moments.len() == KEPT {
            self.moments.pop_front();
        }
        self.moments.push_back(Moment {
            time,
            R_IB,
            p_IB: -(R_IB * p_BC),
            w_IB_B: *w_IB_B,
            X_BE: *X_BE,
        });
        last.is_none()
    }

    /// Forgets all.
    pub fn clear(&mut self) {
        self.moments.clear();
    }

    /// The newest sample.
    pub fn now(&self) -> Option<&Moment> {
        self.moments.back()
    }

    /// The robot at `time` \[s\], between samples by even motion; `None` for a time before the first sample or
    /// after the last.
    pub fn at(&self, time: f64) -> Option<Moment> {
        const SLACK: f64 = 1e-6;
        let (first, last) = (self.moments.front()?, self.moments.back()?);
        if time < first.time - SLACK || time > last.time + SLACK {
            return None;
        }
        let after = self.moments.partition_point(|m| m.time < time - SLACK);
        let b = self.moments.get(after).unwrap_or(last);
        if (b.time - time).abs() <= SLACK || after == 0 {
            return Some(*b);
        }
        let a = &self.moments[after - 1];
        let s = (time - a.time) / (b.time - a.time);
        let tip = a.X_BE.rotation.rotation_to(&b.X_BE.rotation);
        let tip = exp_so3(&(UnitQuaternion::from(tip).scaled_axis() * s)).to_rotation_matrix();
        let position = a
            .X_BE
            .translation
            .vector
            .lerp(&b.X_BE.translation.vector, s);
        Some(Moment {
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
    fn attitude_is_that_of_a_coning_base_and_lasts_between_samples() {
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
            let seen = base.at(t).unwrap();
            // The rate does not change quite evenly: 6e-9 rad a sample, and 2e-6 between samples.
            assert!(seen.R_IB.angle_to(&truth(t)) < 6e-6, "{t}");
            assert!((seen.p_IB + truth(t) * Vector3::x()).norm() < 1e-5);
            assert!((seen.X_BE.translation.x - t).abs() < 1e-12);
            assert!(seen.X_BE.rotation.angle_to(&tip(t, t).rotation) < 1e-7);
        }
        assert!(base.now().unwrap().R_IB.angle_to(&truth(5.0)) < 4e-6);
    }

    #[test]
    fn what_was_not_sampled_is_not_known() {
        let mut base = BaseMotion::default();
        let (w, p) = (Vector3::zeros(), Vector3::zeros());
        assert!(base.at(0.0).is_none());
        assert!(base.advance(1.0, &w, &p, &tip(1.0, 0.0)));
        assert!(!base.advance(1.1, &w, &p, &tip(1.1, 0.0)));
        assert!(base.at(0.9).is_none() && base.at(1.2).is_none());
        assert!(base.advance(3.0, &w, &p, &tip(3.0, 0.0)), "a leap");
        assert!(base.at(1.05).is_none());
        assert!(base.advance(2.0, &w, &p, &tip(2.0, 0.0)), "a new run");
        assert!(!base.advance(2.0, &w, &p, &tip(2.5, 0.0)), "told again");
        assert_eq!(base.now().unwrap().X_BE.translation.x, 2.5);
    }
}
