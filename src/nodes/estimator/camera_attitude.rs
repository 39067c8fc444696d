//! Attitude of the camera from the messages `imu` and `/tf_static`.

use std::collections::BTreeMap;

use nalgebra::UnitQuaternion;

use crate::{
    estimation::GyroAttitude,
    msg::{sensor_msgs::Imu, tf2_msgs::TFMessage},
    nodes::geometry::{unit_quaternion, vector_from_msg},
    ros::Time,
};

/// Integrates the gyro on `imu`, rotated to the camera's axes by the mounting on `/tf_static`.
#[derive(Debug, Default)]
pub struct CameraAttitude {
    mounts: StaticRotations,
    /// The camera's attitude.
    pub gyro: GyroAttitude,
}

impl CameraAttitude {
    /// Adds fixed frames.
    ///
    /// # Errors
    /// A line that names the first frame whose quaternion is not a rotation.
    pub fn take_frames(&mut self, message: TFMessage) -> Result<(), String> {
        self.mounts.take(message)
    }

    /// Adds a measurement, for a camera with the optical frame `camera`.
    ///
    /// # Errors
    /// A line that names what is not finite, or the frames without a connection on `/tf_static`.
    pub fn take_imu(&mut self, imu: &Imu, camera: &str) -> Result<(), String> {
        let unit = &imu.header.frame_id;
        let R_UC = self.mounts.rotation(unit, camera).ok_or_else(|| {
            format!(
                "/tf_static does not connect frame {camera} with {unit}, so the gyro is not used"
            )
        })?;
        let w_U = vector_from_msg(&imu.angular_velocity);
        if !w_U.iter().all(|w| w.is_finite()) {
            return Err("angular_velocity is not finite".to_owned());
        }
        let time = Time::from(&imu.header.stamp).as_secs_f64();
        self.gyro.add(time, R_UC.inverse() * w_U);
        Ok(())
    }
}

/// Rotations of fixed frames in their parent frames, from `/tf_static`.
#[derive(Debug, Default)]
pub struct StaticRotations(BTreeMap<String, (String, UnitQuaternion<f64>)>);

impl StaticRotations {
    /// Adds the frames of a message.
    ///
    /// # Errors
    /// A line that names the first frame whose quaternion is not a rotation.
    pub fn take(&mut self, message: TFMessage) -> Result<(), String> {
        for t in message.transforms {
            let q = &t.transform.rotation;
            let R_PC = unit_quaternion(q.x, q.y, q.z, q.w)
                .map_err(|e| format!("frame {}: {e}", t.child_frame_id))?;
            self.0.insert(t.child_frame_id, (t.header.frame_id, R_PC));
        }
        Ok(())
    }

    /// Rotation `R_RF` of `frame` in its ancestor `root`; `None` if the frames are not connected.
    pub fn rotation(&self, root: &str, frame: &str) -> Option<UnitQuaternion<f64>> {
        let (mut at, mut R) = (frame, UnitQuaternion::identity());
        // A chain cannot be longer than the number of frames; this also ends loops.
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
