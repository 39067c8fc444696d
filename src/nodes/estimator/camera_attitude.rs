//! How the camera turns, from the gyro of the base that carries it.

use std::collections::BTreeMap;

use nalgebra::{UnitQuaternion, Vector3};

use crate::{
    estimation::bundle::{CameraMotion, attitude_at, rotation_between},
    msg::{sensor_msgs::Imu, tf2_msgs::TFMessage},
    nodes::geometry::{unit_quaternion, vector_from_msg},
    ros::Time,
};

/// The camera's attitude over time, gathered from `imu` and `/tf_static`. Its axes G are inertial: the
/// camera's at the first measurement since the last gap.
#[derive(Debug, Default)]
pub struct CameraAttitude {
    mounts: StaticRotations,
    /// `R_GC` over time.
    attitudes: Vec<(f64, UnitQuaternion<f64>)>,
    /// Time and angular velocity of the last measurement, in the camera's own axes.
    last: Option<(f64, Vector3<f64>)>,
    /// How often G has changed.
    beginnings: u32,
}

/// Samples further apart than this \[s\] say nothing about the time between.
const GAP: f64 = 0.5;

impl CameraAttitude {
    /// Takes in frames that do not move.
    ///
    /// # Errors
    /// Names a frame whose rotation is none.
    pub fn take_frames(&mut self, message: TFMessage) -> Result<(), String> {
        self.mounts.take(message)
    }

    /// Takes in a measurement, for a camera with the optical frame `camera`.
    ///
    /// # Errors
    /// Says what is wrong with it, or that nobody says how the camera sits on the unit.
    pub fn take_imu(&mut self, imu: &Imu, camera: &str) -> Result<(), String> {
        let unit = &imu.header.frame_id;
        let R_UC = self.mounts.rotation(unit, camera).ok_or_else(|| {
            format!("no frame on /tf_static tells how {camera} is turned in {unit}")
        })?;
        let w_U = vector_from_msg(&imu.angular_velocity);
        if !w_U.iter().all(|w| w.is_finite()) {
            return Err("angular_velocity is not finite".to_owned());
        }
        let time = Time::from(&imu.header.stamp).as_secs_f64();
        let sample = (time, R_UC.inverse() * w_U);
        match self.last.replace(sample) {
            Some(last) if time <= last.0 && time >= last.0 - GAP => self.last = Some(last),
            Some(last) if time > last.0 && time <= last.0 + GAP => {
                let mut R_GC =
                    attitude_at(&self.attitudes, last.0) * rotation_between(&last, &sample);
                R_GC.renormalize();
                self.attitudes.push((time, R_GC));
            }
            _ => {
                self.attitudes = vec![(time, UnitQuaternion::identity())];
                self.beginnings += 1;
            }
        }
        Ok(())
    }

    /// Forgets all but the frames that do not move.
    pub fn clear(&mut self) {
        self.attitudes.clear();
        self.last = None;
    }

    /// Forgets what is older than `time` \[s\].
    pub fn forget_before(&mut self, time: f64) {
        // The sample before is needed to know the attitude at `time`.
        let old = self.attitudes.partition_point(|(t, _)| *t <= time);
        self.attitudes.drain(..old.saturating_sub(1));
    }

    /// How often the inertial axes G have changed: whatever was stated in them before is void.
    pub fn beginnings(&self) -> u32 {
        self.beginnings
    }

    /// Since when the camera's attitude is known without a gap \[s\].
    pub fn known_since(&self) -> Option<f64> {
        self.attitudes.first().map(|(time, _)| *time)
    }

    /// `R_GC` at `time` \[s\]; no turn if nothing measures it.
    pub fn R_GC(&self, time: f64) -> UnitQuaternion<f64> {
        attitude_at(&self.attitudes, time)
    }

    /// What is known, for an estimate.
    pub fn motion(&self) -> CameraMotion {
        match self.attitudes.len() {
            0 => CameraMotion::Fixed,
            _ => CameraMotion::Attitudes(self.attitudes.clone()),
        }
    }
}

/// How frames that never move are turned in their parents.
#[derive(Debug, Default)]
pub struct StaticRotations(BTreeMap<String, (String, UnitQuaternion<f64>)>);

impl StaticRotations {
    /// Takes in frames.
    ///
    /// # Errors
    /// Names a frame whose rotation is none.
    pub fn take(&mut self, message: TFMessage) -> Result<(), String> {
        for t in message.transforms {
            let q = &t.transform.rotation;
            let R_PC = unit_quaternion(q.x, q.y, q.z, q.w)
                .map_err(|e| format!("frame {}: {e}", t.child_frame_id))?;
            self.0.insert(t.child_frame_id, (t.header.frame_id, R_PC));
        }
        Ok(())
    }

    /// How `frame` is turned in its ancestor `root`.
    pub fn rotation(&self, root: &str, frame: &str) -> Option<UnitQuaternion<f64>> {
        let (mut at, mut R) = (frame, UnitQuaternion::identity());
        // A chain is not longer than there are frames; a loop ends there.
        for _ in 0..=self.0.len() {
            if at == root {
                return Some(R);
            }
            let (parent, R_PC) = self.0.get(at)?;
            (at, R) = (parent, R_PC * R);
        }
        None
    }
}
