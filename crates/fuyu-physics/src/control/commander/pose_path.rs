//! Timed poses of the tip, and the smooth path through them.

use nalgebra::{Translation3, UnitQuaternion, Vector3};

use crate::spatial::{Pose, Twist, exp_so3, rotation_vector_rate};

/// Largest distance of a pose from its frame's origin \[m\], and latest time \[s\].
const LARGEST: f64 = 1e6;

/// Frame in which a path is given.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PathFrame {
    /// The inertial frame: the tip follows the path while the base drifts.
    World,
    /// The base's frame: the path moves with the base.
    Base,
}

/// A desired pose of the tip at a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TimedPose {
    /// Time since the start of the path \[s\].
    pub time: f64,
    /// Pose of the tip in the path's frame.
    pub pose: Pose,
}

/// Why a path is refused. Poses are counted from 1.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum PathError {
    /// The path has no poses.
    #[error("has no poses; give at least one")]
    NoPose,
    /// A position is not finite or too far away.
    #[error("pose {pose} is not at a finite position within 1e6 m")]
    Position {
        /// Number of the pose.
        pose: usize,
    },
    /// A rotation is not finite.
    #[error("pose {pose} has an orientation that is not finite")]
    Orientation {
        /// Number of the pose.
        pose: usize,
    },
    /// A time is negative, not finite or too large.
    #[error("pose {pose} is at {time} s; times must be 0 to 1e6 s from the start")]
    Time {
        /// Number of the pose.
        pose: usize,
        /// Its time.
        time: f64,
    },
    /// Times do not increase.
    #[error(
        "pose {pose} is at {time} s, not after the pose before it at {before} s; times must increase"
    )]
    Order {
        /// Number of the pose.
        pose: usize,
        /// Its time.
        time: f64,
        /// The time before.
        before: f64,
    },
    /// The path is over already.
    #[error(
        "ends at {end:.3} s, but it is {now:.3} s already; leave the stamp of the path zero to start at once"
    )]
    Past {
        /// Its end.
        end: f64,
        /// The present time.
        now: f64,
    },
}

/// A checked list of timed poses.
#[derive(Debug, Clone, PartialEq)]
pub struct PosePath {
    frame: PathFrame,
    poses: Vec<TimedPose>,
}

impl PosePath {
    /// A path through `poses` in `frame`.
    ///
    /// # Errors
    /// [`PathError`] that names the first invalid pose.
    pub fn new(frame: PathFrame, poses: Vec<TimedPose>) -> Result<Self, PathError> {
        if poses.is_empty() {
            return Err(PathError::NoPose);
        }
        let mut before = None;
        for (i, TimedPose { time, pose }) in poses.iter().enumerate() {
            let (number, time) = (i + 1, *time);
            if !(0.0..=LARGEST).contains(&time) {
                return Err(PathError::Time { pose: number, time });
            }
            if let Some(before) = before.filter(|before| time <= *before) {
                return Err(PathError::Order {
                    pose: number,
                    time,
                    before,
                });
            }
            before = Some(time);
            let is_valid = pose.translation.vector.norm() <= LARGEST;
            if !is_valid {
                return Err(PathError::Position { pose: number });
            }
            if !pose
                .rotation
                .matrix()
                .iter()
                .all(|element| element.is_finite())
            {
                return Err(PathError::Orientation { pose: number });
            }
        }
        Ok(Self { frame, poses })
    }

    /// The path's frame.
    pub fn frame(&self) -> PathFrame {
        self.frame
    }

    /// Time from the path's start to its end \[s\].
    pub fn duration(&self) -> f64 {
        self.poses.last().map_or(0.0, |last| last.time)
    }

    /// The smooth path whose time zero is `start` \[s\], from the tip's present pose and twist (in the path's frame and
    /// axes) at `now` \[s\] to rest at the last pose. Poses that are not in the future are skipped.
    ///
    /// Positions are joined by a cubic spline with continuous acceleration. Rotations between two poses follow a cubic
    /// Hermite curve of the rotation vector, `R = R_i exp([θ×])`. The angular velocity at a pose is the mean of those of
    /// the two neighbouring intervals, each weighted by the length of the other, so it is continuous.
    ///
    /// # Errors
    /// [`PathError::Past`] if no pose is in the future.
    pub fn spline(
        &self,
        start: f64,
        now: f64,
        X: &Pose,
        V: &Twist,
    ) -> Result<PoseSpline, PathError> {
        let remaining = (self.poses.iter()).filter(|pose| start + pose.time > now + 1e-9);
        let mut knots = vec![Knot::new(now, X)];
        knots.extend(remaining.map(|pose| Knot::new(start + pose.time, &pose.pose)));
        if knots.len() == 1 {
            let end = start + self.duration();
            return Err(PathError::Past { end, now });
        }
        knots[0].velocity = V.linear;
        knots[0].turning = knots[0].rotation.inverse() * V.angular;
        set_velocities(&mut knots);
        set_turning(&mut knots);
        Ok(PoseSpline {
            frame: self.frame,
            knots,
        })
    }
}

/// A pose on the path with its motion.
#[derive(Debug, Clone, PartialEq)]
struct Knot {
    time: f64,
    position: Vector3<f64>,
    velocity: Vector3<f64>,
    rotation: UnitQuaternion<f64>,
    /// Angular velocity in the tip's axes.
    turning: Vector3<f64>,
}

impl Knot {
    fn new(time: f64, pose: &Pose) -> Self {
        Self {
            time,
            position: pose.translation.vector,
            velocity: Vector3::zeros(),
            rotation: UnitQuaternion::from_rotation_matrix(&pose.rotation),
            turning: Vector3::zeros(),
        }
    }
}

/// Rotation vector from one knot to the next; its components are the same in the axes of both.
fn turn(a: &Knot, b: &Knot) -> Vector3<f64> {
    (a.rotation.inverse() * b.rotation).scaled_axis()
}

/// Sets the velocities at the inner knots for continuous acceleration; those at the ends are given (clamped cubic
/// spline).
fn set_velocities(knots: &mut [Knot]) {
    let last = knots.len() - 1;
    // Thomas's algorithm: `v_i = offset_i - factor_i v_{i+1}`.
    let (mut factors, mut offsets) = (vec![0.0; last + 1], vec![knots[0].velocity; last + 1]);
    for i in 1..last {
        let (h0, h1) = (
            knots[i].time - knots[i - 1].time,
            knots[i + 1].time - knots[i].time,
        );
        let rise = (knots[i].position - knots[i - 1].position) / (h0 * h0)
            + (knots[i + 1].position - knots[i].position) / (h1 * h1);
        let pivot = 2.0 / h0 + 2.0 / h1 - factors[i - 1] / h0;
        factors[i] = 1.0 / (h1 * pivot);
        offsets[i] = (rise * 3.0 - offsets[i - 1] / h0) / pivot;
    }
    for i in (1..last).rev() {
        knots[i].velocity = offsets[i] - knots[i + 1].velocity * factors[i];
    }
}

/// Angular velocities at the inner knots.
fn set_turning(knots: &mut [Knot]) {
    for i in 1..knots.len() - 1 {
        let (h0, h1) = (
            knots[i].time - knots[i - 1].time,
            knots[i + 1].time - knots[i].time,
        );
        let (before, after) = (
            turn(&knots[i - 1], &knots[i]),
            turn(&knots[i], &knots[i + 1]),
        );
        knots[i].turning = (before * (h1 / h0) + after * (h0 / h1)) / (h0 + h1);
    }
}

/// A smooth path of the tip.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseSpline {
    frame: PathFrame,
    knots: Vec<Knot>,
}

impl PoseSpline {
    /// The path's frame.
    pub fn frame(&self) -> PathFrame {
        self.frame
    }

    /// Time of the tip's arrival at the last pose \[s\].
    pub fn end(&self) -> f64 {
        self.knots[self.knots.len() - 1].time
    }

    /// Pose and twist of the tip at `time` \[s\], in the path's frame and axes; at rest before the start and after the
    /// end.
    pub fn at(&self, time: f64) -> (Pose, Twist) {
        let last = self.knots.len() - 1;
        let next = self.knots.partition_point(|k| k.time <= time);
        if next == 0 || next > last {
            let knot = &self.knots[next.min(last)];
            let pose = Pose::from_parts(
                Translation3::from(knot.position),
                knot.rotation.to_rotation_matrix(),
            );
            return (pose, Twist::new(Vector3::zeros(), Vector3::zeros()));
        }
        let (a, b) = (&self.knots[next - 1], &self.knots[next]);
        let h = b.time - a.time;
        let s = (time - a.time) / h;
        let (p, v) = hermite(&a.position, &b.position, &a.velocity, &b.velocity, s, h);
        let way = turn(a, b);
        let end_rate = rotation_vector_rate(&way, &b.turning);
        let (theta, theta_rate) = hermite(&Vector3::zeros(), &way, &a.turning, &end_rate, s, h);
        let R = a.rotation * exp_so3(&theta);
        let w = R * body_rate(&theta, &theta_rate);
        let pose = Pose::from_parts(Translation3::from(p), R.to_rotation_matrix());
        (pose, Twist::new(w, v))
    }
}

/// The cubic Hermite curve over an interval `h` at its fraction `s`, and its rate.
fn hermite(
    a: &Vector3<f64>,
    b: &Vector3<f64>,
    a_rate: &Vector3<f64>,
    b_rate: &Vector3<f64>,
    s: f64,
    h: f64,
) -> (Vector3<f64>, Vector3<f64>) {
    let way = b - a;
    let second = way * 3.0 - (a_rate * 2.0 + b_rate) * h;
    let third = (a_rate + b_rate) * h - way * 2.0;
    let value = a + (a_rate * h + (second + third * s) * s) * s;
    let rate = a_rate + (second * 2.0 + third * (3.0 * s)) * (s / h);
    (value, rate)
}

/// Angular velocity of `R_0 exp([θ×])` in body axes, from the rate of `θ`: the right differential of the exponential
/// map, the inverse of [`rotation_vector_rate`].
fn body_rate(theta: &Vector3<f64>, rate: &Vector3<f64>) -> Vector3<f64> {
    let square = theta.norm_squared();
    // (1 - cos θ)/θ² and (θ - sin θ)/θ³.
    let (first, second) = match square < 1e-6 {
        true => (0.5 - square / 24.0, 1.0 / 6.0 - square / 120.0),
        false => {
            let angle = square.sqrt();
            (
                (1.0 - angle.cos()) / square,
                (angle - angle.sin()) / (square * angle),
            )
        }
    };
    let cross = theta.cross(rate);
    rate - cross * first + theta.cross(&cross) * second
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose(p: Vector3<f64>, u: Vector3<f64>) -> Pose {
        Pose::from_parts(Translation3::from(p), exp_so3(&u).to_rotation_matrix())
    }

    fn rest() -> Twist {
        Twist::new(Vector3::zeros(), Vector3::zeros())
    }

    fn path(poses: &[(f64, Pose)]) -> PosePath {
        let poses = poses.iter().map(|&(time, pose)| TimedPose { time, pose });
        PosePath::new(PathFrame::World, poses.collect()).unwrap()
    }

    // A cubic polynomial is its own clamped spline for any knots.
    #[test]
    fn a_cubic_motion_is_reproduced() {
        let T = 4.0;
        let (a, b) = (Vector3::new(1.0, -2.0, 0.5), Vector3::new(0.1, 0.7, -0.4));
        // At rest at the end.
        let p = |t: f64| a + b * (t * t * (3.0 * T - 2.0 * t));
        let times = [0.4, 1.1, 1.2, 3.0, T];
        let poses = times.map(|t| (t, pose(p(t), Vector3::zeros())));
        let spline = path(&poses)
            .spline(10.0, 10.0, &pose(p(0.0), Vector3::zeros()), &rest())
            .unwrap();
        for i in 0..=400 {
            let t = f64::from(i) * 0.01;
            let (X, V) = spline.at(10.0 + t);
            assert!((X.translation.vector - p(t)).norm() < 1e-12);
            let v = b * (6.0 * t * (T - t));
            assert!((V.linear - v).norm() < 1e-11 || i == 400, "{t}");
        }
    }

    // A constant-rate rotation about a fixed axis is reproduced between inner knots; poses are reached; and the angular
    // velocity is the derivative of the attitude and continuous.
    #[test]
    fn angular_velocity_is_continuous_and_the_derivative_of_attitude() {
        let axis = Vector3::new(0.3, -0.5, 0.8).normalize();
        let poses: Vec<_> = (1..=6)
            .map(|i| {
                (
                    f64::from(i),
                    pose(Vector3::zeros(), axis * (0.9 * f64::from(i))),
                )
            })
            .collect();
        let start = pose(Vector3::zeros(), Vector3::zeros());
        let spline = path(&poses).spline(0.0, 0.0, &start, &rest()).unwrap();
        for t in [1.3, 2.0, 3.7, 4.99] {
            let (X, V) = spline.at(t);
            let there = exp_so3(&(axis * (0.9 * t))).to_rotation_matrix();
            assert!((X.rotation.matrix() - there.matrix()).norm() < 1e-12, "{t}");
            assert!((V.angular - axis * 0.9).norm() < 1e-12, "{t}");
        }
        let wild = [
            (0.7, pose(Vector3::zeros(), Vector3::new(1.0, 0.4, -0.2))),
            (1.5, pose(Vector3::zeros(), Vector3::new(-0.3, 1.4, 0.9))),
            (3.0, pose(Vector3::zeros(), Vector3::new(0.2, 0.1, 2.9))),
        ];
        let V = Twist::new(Vector3::new(0.2, -0.1, 0.3), Vector3::zeros());
        let spline = path(&wild).spline(0.0, 0.0, &start, &V).unwrap();
        assert!((spline.at(0.0).1.angular - V.angular).norm() < 1e-12);
        let d = 1e-6;
        for i in 1..300 {
            let t = f64::from(i) * 0.01;
            let (before, after) = (spline.at(t - d), spline.at(t + d));
            let turned = after.0.rotation * before.0.rotation.inverse();
            let w = UnitQuaternion::from(turned).scaled_axis() / (2.0 * d);
            assert!((w - spline.at(t).1.angular).norm() < 1e-4, "{t}");
            assert!((after.1.angular - before.1.angular).norm() < 1e-4, "{t}");
        }
        for (t, there) in wild {
            assert!((spline.at(t).0.rotation.matrix() - there.rotation.matrix()).norm() < 1e-12);
        }
    }

    #[test]
    fn invalid_paths_are_refused_with_the_reason() {
        let at = |time: f64, x: f64| TimedPose {
            time,
            pose: pose(Vector3::new(x, 0.0, 0.0), Vector3::zeros()),
        };
        let refusal = |poses: &[TimedPose]| {
            let refused = PosePath::new(PathFrame::Base, poses.to_vec()).unwrap_err();
            refused.to_string()
        };
        assert!(refusal(&[]).contains("no poses"));
        assert!(refusal(&[at(1.0, f64::NAN)]).contains("pose 1 is not at a finite"));
        let mut turned = at(1.0, 0.0);
        turned.pose.rotation = exp_so3(&Vector3::new(0.1, 0.0, f64::NAN)).to_rotation_matrix();
        assert!(refusal(&[turned]).contains("pose 1 has an orientation"));
        assert!(refusal(&[at(2.0, 0.0), at(1.0, 0.0)]).contains("pose 2 is at 1 s, not after"));
        assert!(refusal(&[at(f64::NAN, 0.0)]).contains("at NaN s"));
        let past = PosePath::new(PathFrame::Base, vec![at(1.0, 0.0)]).unwrap();
        let refused = past.spline(0.0, 2.0, &at(0.0, 0.0).pose, &rest());
        assert_eq!(refused, Err(PathError::Past { end: 1.0, now: 2.0 }));
    }
}
