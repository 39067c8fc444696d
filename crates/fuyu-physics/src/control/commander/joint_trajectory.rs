//! Joint trajectories: waypoints from a commander, and splines through them.

use super::joint_spline::{JointPoint, JointSpline, Segment};
use crate::model::{JointKind, Model};

/// Largest magnitude of a number in a waypoint \[SI units\]. It keeps polynomials finite.
const LARGEST: f64 = 1e6;
/// Rate at the end of a trajectory that counts as rest \[rad/s or m/s\].
const REST: f64 = 1e-5;
/// Position beyond a joint's limit that counts as rounding \[rad or m\].
const ROUNDING: f64 = 1e-6;

/// A point of a trajectory. Its lists have one element per joint of the trajectory; velocities and accelerations may be
/// empty.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Waypoint {
    /// Time since the start of the trajectory \[s\].
    pub time: f64,
    /// Positions \[rad or m\].
    pub positions: Vec<f64>,
    /// Rates \[rad/s or m/s\].
    pub velocities: Vec<f64>,
    /// Accelerations \[rad/s² or m/s²\].
    pub accelerations: Vec<f64>,
}

/// Why a trajectory is refused. Points are counted from 1.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TrajectoryError {
    /// The trajectory names no joint.
    #[error("names no joint; expected some of {known}")]
    NoJoint {
        /// The robot's joints.
        known: String,
    },
    /// The robot has no joint of this name.
    #[error("names joint '{name}'; the robot has {known}")]
    UnknownJoint {
        /// The name.
        name: String,
        /// The robot's joints.
        known: String,
    },
    /// A joint is named twice.
    #[error("names joint '{name}' twice")]
    RepeatedJoint {
        /// The name.
        name: String,
    },
    /// The trajectory has no points.
    #[error("has no points; give at least one")]
    NoPoint,
    /// A list of a point has the wrong length.
    #[error("point {point} has {count} {what} for {joints} joints")]
    Length {
        /// Number of the point.
        point: usize,
        /// Name of the list.
        what: &'static str,
        /// Its length.
        count: usize,
        /// Number of joints of the trajectory.
        joints: usize,
    },
    /// A number is not finite or too large.
    #[error(
        "point {point} gives joint '{joint}' {value} in {what}; it must be finite and at most 1e6"
    )]
    Value {
        /// Number of the point.
        point: usize,
        /// Name of the joint.
        joint: String,
        /// Name of the list.
        what: &'static str,
        /// The number.
        value: f64,
    },
    /// A position is beyond the joint's limits.
    #[error("point {point} moves joint '{joint}' to {value}, beyond its limits {lower} to {upper}")]
    BeyondLimit {
        /// Number of the point.
        point: usize,
        /// Name of the joint.
        joint: String,
        /// The position.
        value: f64,
        /// Lower limit.
        lower: f64,
        /// Upper limit.
        upper: f64,
    },
    /// A time is negative, not finite or too large.
    #[error("point {point} is at {time} s; times must be 0 to 1e6 s from the start")]
    Time {
        /// Number of the point.
        point: usize,
        /// Its time.
        time: f64,
    },
    /// Times do not increase.
    #[error(
        "point {point} is at {time} s, not after the point before it at {before} s; times must increase"
    )]
    Order {
        /// Number of the point.
        point: usize,
        /// Its time.
        time: f64,
        /// The time before.
        before: f64,
    },
    /// A joint moves at the end.
    #[error(
        "ends while joint '{joint}' moves at {rate}; the velocities of the last point must be zero"
    )]
    MovesAtEnd {
        /// Name of the joint.
        joint: String,
        /// Its rate.
        rate: f64,
    },
    /// The trajectory is over already.
    #[error(
        "ends at {end:.3} s, but it is {now:.3} s already; leave the stamp zero to start at once"
    )]
    Past {
        /// Its end.
        end: f64,
        /// The present time.
        now: f64,
    },
}

/// A checked trajectory of some of a robot's joints.
#[derive(Debug, Clone, PartialEq)]
pub struct JointTrajectory {
    /// Indices of the trajectory's joints.
    joints: Vec<usize>,
    waypoints: Vec<Waypoint>,
}

impl JointTrajectory {
    /// A trajectory through `waypoints` of the joints `names`, in the order of the names.
    ///
    /// # Errors
    /// [`TrajectoryError`] that names the first invalid joint, point or value.
    pub fn new(
        model: &Model,
        names: &[String],
        waypoints: Vec<Waypoint>,
    ) -> Result<Self, TrajectoryError> {
        let known = || {
            let names: Vec<_> = model.joints().iter().map(|j| j.name.as_str()).collect();
            names.join(", ")
        };
        if names.is_empty() {
            return Err(TrajectoryError::NoJoint { known: known() });
        }
        let mut joints = Vec::with_capacity(names.len());
        for name in names {
            let joint = model
                .joint_index(name)
                .ok_or_else(|| TrajectoryError::UnknownJoint {
                    name: name.clone(),
                    known: known(),
                })?;
            if joints.contains(&joint) {
                return Err(TrajectoryError::RepeatedJoint { name: name.clone() });
            }
            joints.push(joint);
        }
        let trajectory = Self { joints, waypoints };
        trajectory.check(model)?;
        Ok(trajectory)
    }

    /// Indices of the trajectory's joints in the model, in the trajectory's order.
    pub fn joints(&self) -> &[usize] {
        &self.joints
    }

    /// Time from the trajectory's start to its end \[s\].
    pub fn duration(&self) -> f64 {
        self.waypoints.last().map_or(0.0, |last| last.time)
    }

    fn check(&self, model: &Model) -> Result<(), TrajectoryError> {
        let name = |k: usize| model.joints()[self.joints[k]].name.clone();
        let Some(last) = self.waypoints.last() else {
            return Err(TrajectoryError::NoPoint);
        };
        let mut before = None;
        for (i, waypoint) in self.waypoints.iter().enumerate() {
            let (point, time) = (i + 1, waypoint.time);
            if !(0.0..=LARGEST).contains(&time) {
                return Err(TrajectoryError::Time { point, time });
            }
            if let Some(before) = before.filter(|before| time <= *before) {
                return Err(TrajectoryError::Order {
                    point,
                    time,
                    before,
                });
            }
            before = Some(time);
            let lists = [
                ("positions", &waypoint.positions, true),
                ("velocities", &waypoint.velocities, false),
                ("accelerations", &waypoint.accelerations, false),
            ];
            for (what, values, needed) in lists {
                if values.len() != self.joints.len() && (needed || !values.is_empty()) {
                    return Err(TrajectoryError::Length {
                        point,
                        what,
                        count: values.len(),
                        joints: self.joints.len(),
                    });
                }
                let is_valid = |v: &f64| v.abs() <= LARGEST;
                // NaN also violates the limit.
                if let Some(k) = values.iter().position(|v| !is_valid(v)) {
                    return Err(TrajectoryError::Value {
                        point,
                        joint: name(k),
                        what,
                        value: values[k],
                    });
                }
            }
            for (k, &value) in waypoint.positions.iter().enumerate() {
                let limits = &model.joints()[self.joints[k]].limits;
                if value < limits.lower - ROUNDING || value > limits.upper + ROUNDING {
                    return Err(TrajectoryError::BeyondLimit {
                        point,
                        joint: name(k),
                        value,
                        lower: limits.lower,
                        upper: limits.upper,
                    });
                }
            }
        }
        match last.velocities.iter().position(|rate| rate.abs() > REST) {
            Some(k) => Err(TrajectoryError::MovesAtEnd {
                joint: name(k),
                rate: last.velocities[k],
            }),
            None => Ok(()),
        }
    }

    /// The splines of all joints of the robot, for a trajectory whose time zero is `start` \[s\], from the motion
    /// `present` of all joints at `now` \[s\].
    ///
    /// Between two points the polynomial is quintic if both have accelerations and velocities, cubic if both have
    /// velocities, and otherwise linear, as in ros2_control's joint_trajectory_controller. Points that are not in the
    /// future are skipped: the first polynomial leads from the present motion to the first remaining point, so that
    /// position and rate are continuous. If the last skipped point is at `now`, the first polynomial starts with its
    /// acceleration. Continuous joints take the shorter way to the first point. Joints that the trajectory does not
    /// name come to rest.
    ///
    /// # Errors
    /// [`TrajectoryError::Past`] if no point is in the future, unless the trajectory starts now with its only point:
    /// then the joints move there within their rate limits, with at most about 2 rad/s² (m/s²).
    ///
    /// # Panics
    /// If `present` does not have one element per joint of the robot.
    pub fn spline(
        &self,
        model: &Model,
        start: f64,
        now: f64,
        present: &[JointPoint],
    ) -> Result<JointSpline, TrajectoryError> {
        assert_eq!(
            present.len(),
            model.dof(),
            "present has one element per joint"
        );
        let is_over = |waypoint: &Waypoint| start + waypoint.time <= now + 1e-9;
        let first = self.waypoints.partition_point(is_over);
        let remaining = &self.waypoints[first..];
        let Some(next) = remaining.first() else {
            let end = start + self.duration();
            if start < now {
                return Err(TrajectoryError::Past { end, now });
            }
            let last = &self.waypoints[self.waypoints.len() - 1];
            let target = |(k, &j): (usize, &usize)| {
                let turns = turns(model.joints()[j].kind, &present[j], last.positions[k]);
                (j, last.positions[k] + turns)
            };
            let targets: Vec<_> = self.joints.iter().enumerate().map(target).collect();
            return Ok(JointSpline::to_rest_at(model, now, present, &targets));
        };
        let passed = first.checked_sub(1).map(|i| &self.waypoints[i]);
        let at_now = passed.filter(|w| (start + w.time - now).abs() <= 1e-9);
        let end = start + self.duration();
        let mut spline = JointSpline::stop(model, now, present);
        for (k, &j) in self.joints.iter().enumerate() {
            let turns = turns(model.joints()[j].kind, &present[j], next.positions[k]);
            let mut from = present[j];
            if let Some(a) = at_now.and_then(|w| w.accelerations.get(k)) {
                from.acceleration = *a;
            }
            let (mut time, mut has) = (now, Given::ALL);
            let mut segments = Vec::with_capacity(remaining.len());
            for waypoint in remaining {
                let to = JointPoint {
                    position: waypoint.positions[k] + turns,
                    rate: waypoint.velocities.get(k).copied().unwrap_or(0.0),
                    acceleration: waypoint.accelerations.get(k).copied().unwrap_or(0.0),
                };
                let given = Given::of(waypoint);
                let duration = start + waypoint.time - time;
                segments.push(match has.and(given) {
                    Given {
                        rates: true,
                        accelerations: true,
                    } => Segment::quintic(time, duration, &from, &to),
                    Given { rates: true, .. } => Segment::cubic(time, duration, &from, &to),
                    _ if segments.is_empty() => {
                        Segment::linear_from(time, duration, &from, to.position)
                    }
                    _ => Segment::linear(time, duration, from.position, to.position),
                });
                (time, from, has) = (start + waypoint.time, to, given);
            }
            spline.set_joint(j, segments, end);
        }
        Ok(spline)
    }
}

/// Whole turns \[rad\] that bring `position` nearest to the joint's present one, for a continuous joint.
fn turns(kind: JointKind, present: &JointPoint, position: f64) -> f64 {
    let turn = std::f64::consts::TAU;
    match kind {
        JointKind::Continuous => ((present.position - position) / turn).round() * turn,
        _ => 0.0,
    }
}

/// Which derivatives a point contains.
#[derive(Debug, Clone, Copy)]
struct Given {
    rates: bool,
    accelerations: bool,
}

impl Given {
    const ALL: Self = Self {
        rates: true,
        accelerations: true,
    };

    fn of(waypoint: &Waypoint) -> Self {
        Self {
            rates: !waypoint.velocities.is_empty(),
            accelerations: !waypoint.accelerations.is_empty(),
        }
    }

    fn and(self, other: Self) -> Self {
        Self {
            rates: self.rates && other.rates,
            accelerations: self.accelerations && other.accelerations,
        }
    }
}
