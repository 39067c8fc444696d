//! Attitude of the camera, integrated from `imu` with the mounting from `/tf_static`.

use std::collections::BTreeMap;

use nalgebra::UnitQuaternion;

use crate::{
    estimation::GyroAttitude,
    msg::{sensor_msgs::Imu, tf2_msgs::TFMessage},
    nodes::geometry::{unit_quaternion, vector_from_msg},
    ros::Time,
};

/// Integrates the gyro rates from `imu`, rotated to camera axes by the mounting from `/tf_static`.
#[derive(Debug, Default)]
pub struct CameraAttitude {
    mounts: StaticRotations,
    /// The integrated attitude of the camera.
    pub gyro: GyroAttitude,
    /// Variance of a gyro sample \[rad²/s²\]; `None` if the messages do not give it.
    variance: Option<f64>,
    /// Stamp of the last sample, and the interval before it \[s\].
    last: Option<(f64, f64)>,
}

impl CameraAttitude {
    /// For a camera with the optical frame `camera`, mounted with the rotation `R_UC` in the gyro's frame `unit`.
    pub fn mounted(unit: &str, camera: &str, R_UC: UnitQuaternion<f64>) -> Self {
        let mount = (camera.to_owned(), (unit.to_owned(), R_UC));
        Self {
            mounts: StaticRotations([mount].into()),
            ..Self::default()
        }
    }

    /// Adds the fixed frames of a message.
    ///
    /// # Errors
    /// A line that names the first frame whose quaternion is not a rotation.
    pub fn take_static_transforms(&mut self, message: TFMessage) -> Result<(), String> {
        self.mounts.take(message)
    }

    /// Angular random walk of the integrated gyro \[rad/√s\]: standard deviation of a sample times the square root of
    /// the sampling interval. `None` if the messages do not give the variance.
    pub fn gyro_noise(&self) -> Option<f64> {
        let (_, interval) = self.last?;
        let noise = (self.variance? * interval).sqrt();
        (noise > 0.0).then_some(noise)
    }

    /// Adds a gyro measurement, for a camera with the optical frame `camera`.
    ///
    /// # Errors
    /// A line that names the quantity that is not finite, or the frames that `/tf_static` does not connect.
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
        self.variance = variance_of(&imu.angular_velocity_covariance);
        self.last = match self.last {
            Some((before, _)) if time > before => Some((time, time - before)),
            Some(last) => Some(last),
            None => Some((time, 0.0)),
        };
        self.gyro.add(time, R_UC.inverse() * w_U);
        Ok(())
    }
}

/// Variance of one component of a gyro sample \[rad²/s²\]: the mean diagonal element of a message's covariance matrix.
/// `None` if unknown: all elements zero, or the first one -1, as defined by `sensor_msgs/Imu`.
pub fn variance_of(covariance: &[f64; 9]) -> Option<f64> {
    let mean = (covariance[0] + covariance[4] + covariance[8]) / 3.0;
    (covariance[0] >= 0.0 && mean.is_finite() && mean > 0.0).then_some(mean)
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
        // The number of frames limits the length of a chain; this also terminates in case of a cycle.
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
