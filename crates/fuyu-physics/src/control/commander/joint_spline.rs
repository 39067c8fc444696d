//! Piecewise polynomials of joint positions.

use crate::model::Model;

/// Position, rate and acceleration of a joint \[rad or m; per s; per s²\].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct JointPoint {
    /// Position \[rad or m\].
    pub position: f64,
    /// Rate \[rad/s or m/s\].
    pub rate: f64,
    /// Acceleration \[rad/s² or m/s²\].
    pub acceleration: f64,
}

/// A polynomial in the time since its start, of degree 5 at most.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Segment {
    start: f64,
    duration: f64,
    coefficients: [f64; 6],
}

impl Segment {
    /// Between two positions with a constant rate.
    pub fn linear(start: f64, duration: f64, from: f64, to: f64) -> Self {
        Self {
            start,
            duration,
            coefficients: [from, (to - from) / duration, 0.0, 0.0, 0.0, 0.0],
        }
    }

    /// From a moving joint to a position: the polynomial of [`Segment::linear`], plus a term for the excess of the
    /// joint's rate at the start, which vanishes at the end.
    pub fn linear_from(start: f64, duration: f64, from: &JointPoint, to: f64) -> Self {
        let T = duration;
        let slope = (to - from.position) / T;
        // δ(t) = (v_0 - slope) t (1 - t/T)²
        let excess = from.rate - slope;
        Self {
            start,
            duration,
            coefficients: [
                from.position,
                from.rate,
                -2.0 * excess / T,
                excess / T.powi(2),
                0.0,
                0.0,
            ],
        }
    }

    /// Between two positions and rates: the cubic Hermite polynomial.
    pub fn cubic(start: f64, duration: f64, from: &JointPoint, to: &JointPoint) -> Self {
        let T = duration;
        let way = to.position - from.position;
        let (v0, v1) = (from.rate, to.rate);
        let second = (3.0 * way - (2.0 * v0 + v1) * T) / T.powi(2);
        let third = ((v0 + v1) * T - 2.0 * way) / T.powi(3);
        Self {
            start,
            duration,
            coefficients: [from.position, v0, second, third, 0.0, 0.0],
        }
    }

    /// Between two positions, rates and accelerations: the quintic Hermite polynomial.
    pub fn quintic(start: f64, duration: f64, from: &JointPoint, to: &JointPoint) -> Self {
        let T = duration;
        let (v0, a0) = (from.rate, from.acceleration);
        // The remaining difference at the end from the parabola that continues the motion at the start.
        let way = to.position - (from.position + T * (v0 + 0.5 * a0 * T));
        let rate = (to.rate - (v0 + a0 * T)) * T;
        let bend = (to.acceleration - a0) * T * T;
        Self {
            start,
            duration,
            coefficients: [
                from.position,
                v0,
                0.5 * a0,
                (10.0 * way - 4.0 * rate + 0.5 * bend) / T.powi(3),
                (-15.0 * way + 7.0 * rate - bend) / T.powi(4),
                (6.0 * way - 3.0 * rate + 0.5 * bend) / T.powi(5),
            ],
        }
    }

    fn end(&self) -> f64 {
        self.start + self.duration
    }

    fn at(&self, time: f64) -> JointPoint {
        let t = (time - self.start).clamp(0.0, self.duration);
        let [c0, c1, c2, c3, c4, c5] = self.coefficients;
        JointPoint {
            position: c0 + t * (c1 + t * (c2 + t * (c3 + t * (c4 + t * c5)))),
            rate: c1 + t * (2.0 * c2 + t * (3.0 * c3 + t * (4.0 * c4 + t * 5.0 * c5))),
            acceleration: 2.0 * c2 + t * (6.0 * c3 + t * (12.0 * c4 + t * 20.0 * c5)),
        }
    }
}

/// Positions of all joints of a robot as functions of time. Before the start a joint rests at the beginning of its
/// first polynomial; after the end it rests at the end of its last one.
#[derive(Debug, Clone, PartialEq)]
pub struct JointSpline {
    /// Polynomials of each joint, in order of time.
    joints: Vec<Vec<Segment>>,
    end: f64,
}

/// Largest acceleration \[rad/s² or m/s²\] and shortest time \[s\] for stopping joints that no trajectory moves.
const STOP: (f64, f64) = (2.0, 0.2);
/// Shortest time for stopping a joint before its position limit \[s\].
const STOP_AT_LIMIT: f64 = 0.02;

impl JointSpline {
    /// Brings joints that are in motion at `time` \[s\] to rest: within 0.2 s, or with at most about 2 rad/s² (m/s²) if
    /// that takes longer. Joints that would reach a position limit stop sooner. Acceleration is continuous unless the
    /// present one is too large to end within that time without a detour.
    ///
    /// # Panics
    /// If `present` does not have one element per joint of the robot.
    pub fn stop(model: &Model, time: f64, present: &[JointPoint]) -> Self {
        assert_eq!(
            present.len(),
            model.dof(),
            "present has one element per joint"
        );
        let fastest = present.iter().map(|p| p.rate.abs()).fold(0.0, f64::max);
        // The polynomial's largest acceleration is 1.5 times its mean.
        let duration = (1.5 * fastest / STOP.0).max(STOP.1);
        let joints = present.iter().zip(model.joints()).map(|(from, joint)| {
            let room = match from.rate > 0.0 {
                true => joint.limits.upper - from.position,
                false => from.position - joint.limits.lower,
            };
            let duration = match 0.5 * from.rate.abs() * duration > room {
                true => (2.0 * room / from.rate.abs()).clamp(STOP_AT_LIMIT, duration),
                false => duration,
            };
            let to = JointPoint {
                position: from.position + 0.5 * from.rate * duration,
                ..JointPoint::default()
            };
            // Four times the mean acceleration of the stop.
            let largest = 4.0 * from.rate.abs() / duration;
            let from = JointPoint {
                acceleration: from.acceleration.clamp(-largest, largest),
                ..*from
            };
            vec![Segment::quintic(time, duration, &from, &to)]
        });
        Self {
            joints: joints.collect(),
            end: time + duration,
        }
    }

    /// Brings the joints in `targets` (index, position \[rad or m\]) from their present motion to rest at these
    /// positions, and the other joints to rest: within their rate limits, and with at most about 2 rad/s² (m/s²).
    pub(super) fn to_rest_at(
        model: &Model,
        time: f64,
        present: &[JointPoint],
        targets: &[(usize, f64)],
    ) -> Self {
        let mut spline = Self::stop(model, time, present);
        // Largest rate and acceleration of the quintic polynomial from rest to rest.
        let (rate, acceleration) = (1.875, 5.774);
        let duration = targets.iter().fold(spline.end - time, |longest, &(j, to)| {
            let way = (to - present[j].position).abs();
            let limit = model.joints()[j].limits.velocity;
            (longest.max(rate * way / limit)).max((acceleration * way / STOP.0).sqrt())
        });
        for &(j, position) in targets {
            let to = JointPoint {
                position,
                ..JointPoint::default()
            };
            let segment = Segment::quintic(time, duration, &present[j], &to);
            spline.set_joint(j, vec![segment], time + duration);
        }
        spline
    }

    /// The same motion with other `segments` for joint `j`, which end at `end` \[s\].
    pub(super) fn set_joint(&mut self, j: usize, segments: Vec<Segment>, end: f64) {
        self.joints[j] = segments;
        self.end = self.end.max(end);
    }

    /// Number of joints.
    pub fn dof(&self) -> usize {
        self.joints.len()
    }

    /// Time after which all joints rest \[s\].
    pub fn end(&self) -> f64 {
        self.end
    }

    /// Position, rate and acceleration of joint `j` at `time` \[s\].
    pub fn at(&self, j: usize, time: f64) -> JointPoint {
        let segments = &self.joints[j];
        let last = segments.len() - 1;
        let index = segments.partition_point(|s| s.end() <= time).min(last);
        let segment = &segments[index];
        let point = segment.at(time);
        match time >= segment.end() {
            true => JointPoint {
                position: point.position,
                ..JointPoint::default()
            },
            false => point,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(position: f64, rate: f64, acceleration: f64) -> JointPoint {
        JointPoint {
            position,
            rate,
            acceleration,
        }
    }

    fn assert_near(a: JointPoint, b: JointPoint) {
        let off = (a.position - b.position).abs() + (a.rate - b.rate).abs();
        let off = off + (a.acceleration - b.acceleration).abs();
        assert!(off < 1e-12, "{a:?} is not {b:?}");
    }

    // Polynomials of degree 1, 3 and 5 are reproduced exactly from their values at the ends. Fails with any wrong
    // coefficient.
    #[test]
    fn polynomials_are_reproduced() {
        let c = [0.3, -0.7, 1.1, 0.4, -0.9, 0.25];
        let of_degree = |n: usize, t: f64| {
            let power = |k: usize, d: usize| -> f64 {
                match k < d {
                    true => 0.0,
                    false => {
                        (0..d).map(|i| (k - i) as f64).product::<f64>() * t.powi((k - d) as i32)
                    }
                }
            };
            let sum = |d: usize| -> f64 { (0..=n).map(|k| c[k] * power(k, d)).sum() };
            point(sum(0), sum(1), sum(2))
        };
        let (start, duration) = (2.0, 1.7);
        for t in [0.0, 0.2, 0.9, 1.69] {
            let ends = |n| (of_degree(n, 0.0), of_degree(n, duration));
            let (from, to) = ends(1);
            let linear = Segment::linear(start, duration, from.position, to.position);
            assert_near(linear.at(start + t), of_degree(1, t));
            let (from, to) = ends(3);
            let cubic = Segment::cubic(start, duration, &from, &to);
            assert_near(cubic.at(start + t), of_degree(3, t));
            // With the mean rate as final rate, the cubic polynomial equals the linear one with a decaying excess.
            let slope = (to.position - from.position) / duration;
            let to = point(to.position, slope, 0.0);
            let same = Segment::cubic(start, duration, &from, &to).at(start + t);
            let joined = Segment::linear_from(start, duration, &from, to.position);
            assert_near(joined.at(start + t), same);
            let (from, to) = ends(5);
            let quintic = Segment::quintic(start, duration, &from, &to);
            assert_near(quintic.at(start + t), of_degree(5, t));
        }
    }

    // A sample one rounding error before the start equals that at the start: time is a multiple of a period that is not
    // exact in binary.
    #[test]
    fn a_motion_begins_with_its_rate() {
        let xml = include_str!("../../../../../urdf/seven_joints.urdf");
        let model = Model::from_urdf(xml, "seven_joints").unwrap();
        let present = vec![point(0.3, 0.8, 0.0); 7];
        let stop = JointSpline::stop(&model, 10.0, &present);
        assert_near(stop.at(0, 10.0f64.next_down()), present[0]);
    }

    // The acceleration of a sharp corner would swing the joint far beyond where it can stop.
    #[test]
    fn a_large_acceleration_causes_no_detour() {
        let xml = include_str!("../../../../../urdf/seven_joints.urdf");
        let model = Model::from_urdf(xml, "seven_joints").unwrap();
        let mut present = vec![point(0.0, 0.0, 0.0); 7];
        present[0] = point(0.0, 1.0, 100.0);
        present[1] = point(0.0, 0.0, -100.0);
        let stop = JointSpline::stop(&model, 0.0, &present);
        for i in 0..=1000 {
            let t = f64::from(i) * 1e-3;
            assert!((-1e-9..0.45).contains(&stop.at(0, t).position));
            assert_near(stop.at(1, t), point(0.0, 0.0, 0.0));
        }
    }

    #[test]
    fn a_stop_is_smooth_and_bounded() {
        let xml = include_str!("../../../../../urdf/seven_joints.urdf");
        let model = Model::from_urdf(xml, "seven_joints").unwrap();
        let mut present = vec![point(0.0, 0.0, 0.0); 7];
        present[0] = point(1.0, 0.8, -0.5);
        present[1] = point(-2.0, 0.0, 0.0);
        // Its upper limit is 2.9 rad.
        present[2] = point(2.85, 0.8, 0.0);
        let stop = JointSpline::stop(&model, 10.0, &present);
        assert_near(stop.at(0, 10.0), present[0]);
        assert!((stop.end() - 10.6).abs() < 1e-12);
        let mut position = 1.0;
        for i in 0..=1000 {
            let now = stop.at(0, 10.0 + i as f64 * 0.001);
            assert!(now.acceleration.abs() < 2.5, "{now:?}");
            assert!(now.position >= position - 1e-12);
            position = now.position;
            assert!(stop.at(2, 10.0 + i as f64 * 0.001).position < 2.9 + 1e-12);
        }
        assert!((stop.at(2, 10.2).position - 2.9).abs() < 1e-12);
        assert_eq!(stop.at(0, 11.0), point(stop.at(0, 11.0).position, 0.0, 0.0));
        assert_near(stop.at(1, 10.1), point(-2.0, 0.0, 0.0));
    }
}
