//! Recorded estimates of tumbling targets, and the targets' true motion.

use nalgebra::{UnitQuaternion, Vector3};
use std::collections::BTreeMap;

use crate::bag::Message;
use crate::msg::fuyu_msgs::MotionEstimate;
use crate::msg::geometry_msgs::{self, Vector3Stamped};
use crate::msg::nav_msgs::{Odometry, Path};
use crate::nodes::geometry::{unit_quaternion, vector_from_msg};

/// Estimates of one robot, and the targets of its simulation. Times are stamps in nanoseconds.
#[derive(Debug, Default)]
pub struct RecordedEstimation {
    /// `ground_truth/NAME/odom` by name.
    pub targets: BTreeMap<String, Vec<Turning>>,
    /// Attitude of the base over time, from `ground_truth/odom`.
    pub base: Vec<Turning>,
    /// The base frame.
    pub base_frame: String,
    /// `estimator/angular_velocity`: times and values in camera axes at that time \[rad/s\].
    pub rates: Vec<(i64, Vector3<f64>)>,
    /// `estimator/motion`.
    pub motions: Vec<RecordedMotion>,
    /// `estimator/prediction`.
    pub predictions: Vec<RecordedPrediction>,
    /// The camera's optical frame.
    pub camera_frame: String,
}

/// A true attitude and angular velocity in the world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Turning {
    /// Stamp \[ns\].
    pub time: i64,
    /// Attitude in the world.
    pub R_WB: UnitQuaternion<f64>,
    /// Angular velocity in world axes \[rad/s\].
    pub w_WB_W: Vector3<f64>,
}

/// The part of an estimated motion needed for `|w|²`.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordedMotion {
    /// Stamp \[ns\], the reference time of the motion.
    pub time: i64,
    /// Moments divided by twice the energy \[s²\]; zero if unknown.
    pub J: Vector3<f64>,
    /// Squared momentum divided by four times the squared energy \[s²\].
    pub alpha: f64,
    /// Argument of the elliptic functions at the stamp \[rad\].
    pub phase: f64,
    /// Direction of the momentum in camera axes at that time.
    pub momentum_direction: Vector3<f64>,
    /// Angular velocity in camera axes at that time \[rad/s\].
    pub w_C: Vector3<f64>,
    /// Times \[ns\] and standard deviations of the predicted rotations since the stamp, root sum square of the axes
    /// \[rad\].
    pub deviations: Vec<(i64, f64)>,
}

/// A predicted attitude over time, in the camera's axes at its stamp.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordedPrediction {
    /// Stamp \[ns\].
    pub time: i64,
    /// Times \[ns\] and attitudes of arbitrary body-fixed axes.
    pub R_CB: Vec<(i64, UnitQuaternion<f64>)>,
}

type Take = fn(&mut RecordedEstimation, &Message);

/// Topics below a namespace. Undecodable messages are reported by the topic check.
const TOPICS: [(&str, Take); 4] = [
    ("/ground_truth/odom", |estimation, m| {
        if let Ok(odom) = m.decode::<Odometry>() {
            estimation.base.extend(turning(&odom));
            estimation.base_frame = odom.child_frame_id;
        }
    }),
    ("/estimator/angular_velocity", |estimation, m| {
        if let Ok(rate) = m.decode::<Vector3Stamped>() {
            let time = rate.header.stamp.nanos();
            estimation.rates.push((time, vector_from_msg(&rate.vector)));
            estimation.camera_frame = rate.header.frame_id;
        }
    }),
    ("/estimator/motion", |estimation, m| {
        if let Ok(motion) = m.decode::<MotionEstimate>() {
            let stamp = motion.header.stamp.nanos();
            let each = motion
                .prediction_times
                .iter()
                .zip(motion.turn_covariances.chunks_exact(9));
            let deviations = each.map(|(t, c)| {
                let variance = c[0] + c[4] + c[8];
                (
                    stamp.saturating_add((t * 1e9) as i64),
                    variance.max(0.0).sqrt(),
                )
            });
            estimation.motions.push(RecordedMotion {
                time: stamp,
                deviations: deviations.collect(),
                J: Vector3::new(motion.j_x, motion.j_y, motion.j_z),
                alpha: motion.alpha,
                phase: motion.phase,
                momentum_direction: vector_from_msg(&motion.momentum_direction),
                w_C: vector_from_msg(&motion.angular_velocity),
            });
            estimation.camera_frame = motion.header.frame_id;
        }
    }),
    ("/estimator/prediction", |estimation, m| {
        if let Ok(path) = m.decode::<Path>() {
            let poses = path.poses.iter().filter_map(|pose| {
                let attitude = attitude(&pose.pose.orientation)?;
                Some((pose.header.stamp.nanos(), attitude))
            });
            estimation.predictions.push(RecordedPrediction {
                time: path.header.stamp.nanos(),
                R_CB: poses.collect(),
            });
            estimation.camera_frame = path.header.frame_id;
        }
    }),
];

impl RecordedEstimation {
    /// The namespace and the handler of the message, if it is on one of these topics.
    pub fn accept<'a>(message: &'a Message, robot: impl FnOnce(&'a str) -> &'a mut Self) {
        let name = message.topic.name.as_str();
        for (suffix, take) in TOPICS {
            if let Some(namespace) = name.strip_suffix(suffix) {
                return take(robot(namespace), message);
            }
        }
        let inner = name
            .strip_suffix("/odom")
            .and_then(|n| n.rsplit_once("/ground_truth/"));
        if let Some((namespace, target)) = inner
            && let Ok(odom) = message.decode::<Odometry>()
        {
            let targets = &mut robot(namespace).targets;
            let known = targets.entry(target.to_owned()).or_default();
            known.extend(turning(&odom));
        }
    }

    /// Whether there is an estimate to plot.
    pub fn is_empty(&self) -> bool {
        self.rates.is_empty() && self.motions.is_empty() && self.predictions.is_empty()
    }
}

fn turning(odom: &Odometry) -> Option<Turning> {
    let R_WB = attitude(&odom.pose.pose.orientation)?;
    // Twists of odometry are in the moving frame.
    let w_WB_W = R_WB * vector_from_msg(&odom.twist.twist.angular);
    Some(Turning {
        time: odom.header.stamp.nanos(),
        R_WB,
        w_WB_W,
    })
}

fn attitude(q: &geometry_msgs::Quaternion) -> Option<UnitQuaternion<f64>> {
    unit_quaternion(q.x, q.y, q.z, q.w).ok()
}

/// The attitude at `time` \[ns\], interpolated along the shortest path between neighbouring samples; `None` outside.
pub fn attitude_at(samples: &[Turning], time: i64) -> Option<UnitQuaternion<f64>> {
    let after = samples.partition_point(|s| s.time < time);
    let next = samples.get(after)?;
    if next.time == time {
        return Some(next.R_WB);
    }
    let last = samples.get(after.checked_sub(1)?)?;
    let part = (time - last.time) as f64 / (next.time - last.time) as f64;
    Some(last.R_WB.slerp(&next.R_WB, part))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn attitudes_lie_between_their_neighbours_and_nowhere_else() {
        let at = |time, angle| Turning {
            time,
            R_WB: UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle),
            w_WB_W: Vector3::zeros(),
        };
        let samples = [at(100, 0.0), at(200, 0.2), at(300, 0.6)];
        let angle = |time| attitude_at(&samples, time).map(|R| R.angle());
        assert!((angle(150).unwrap() - 0.1).abs() < 1e-12);
        assert!((angle(300).unwrap() - 0.6).abs() < 1e-12);
        assert_eq!((angle(99), angle(301)), (None, None));
    }
}
