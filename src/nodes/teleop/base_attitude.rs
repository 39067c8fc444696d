//! Attitude of the base in the world, integrated from its gyro.

use nalgebra::{UnitQuaternion, Vector3};

use crate::{
    estimation::bundle::rotation_between, msg::sensor_msgs::Imu, nodes::geometry::vector_from_msg,
    ros::Time,
};

/// Longest interval between measurements over which rates are integrated \[s\].
const MAX_GAP: f64 = 0.5;

/// The base's attitude: a given attitude at the first measurement, since a gyro measures rotation only, and integration
/// since.
#[derive(Debug)]
pub struct BaseAttitude {
    initial: UnitQuaternion<f64>,
    R_WB: UnitQuaternion<f64>,
    /// Time and angular velocity (base axes) of the last measurement.
    last: Option<(f64, Vector3<f64>)>,
    lost: Option<String>,
}

impl BaseAttitude {
    /// `initial` is the attitude at the first measurement.
    pub fn new(initial: UnitQuaternion<f64>) -> Self {
        Self {
            initial,
            R_WB: initial,
            last: None,
            lost: None,
        }
    }

    /// Adds a gyro measurement, which must be in the axes of the frame `base`.
    ///
    /// # Errors
    /// The reason why it is refused.
    pub fn take(&mut self, imu: &Imu, base: &str) -> Result<(), String> {
        let unit = &imu.header.frame_id;
        if unit != base {
            return Err(format!("frame_id is '{unit}'; expected {base}"));
        }
        let w = vector_from_msg(&imu.angular_velocity);
        if !w.iter().all(|w| w.is_finite()) {
            return Err("angular_velocity is not finite".to_owned());
        }
        let sample = (Time::from(&imu.header.stamp).as_secs_f64(), w);
        match self.last {
            // Repeated or out of order.
            Some(last) if sample.0 <= last.0 && sample.0 >= last.0 - MAX_GAP => return Ok(()),
            Some(last) if sample.0 > last.0 => {
                let gap = sample.0 - last.0;
                if gap > MAX_GAP {
                    self.lost = Some(format!(
                        "{gap:.1} s without imu: the world's axes are lost until the node restarts"
                    ));
                }
                self.R_WB *= rotation_between(&last, &sample);
                self.R_WB.renormalize();
            }
            // The first measurement, or a restarted simulation.
            _ => *self = Self::new(self.initial),
        }
        self.last = Some(sample);
        Ok(())
    }

    /// The current attitude.
    ///
    /// # Errors
    /// The reason why it is unknown.
    pub fn R_WB(&self) -> Result<UnitQuaternion<f64>, String> {
        match (&self.lost, self.last) {
            (Some(lost), _) => Err(lost.clone()),
            (None, None) => {
                Err("no imu has arrived yet, so the world's axes are unknown".to_owned())
            }
            (None, Some(_)) => Ok(self.R_WB),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nodes::geometry::vector_to_msg;

    fn imu(time: f64, w: Vector3<f64>) -> Imu {
        let mut imu = Imu {
            angular_velocity: vector_to_msg(&w),
            ..Imu::default()
        };
        imu.header.stamp = Time::from_secs_f64(time).into();
        imu.header.frame_id = "base_link".to_owned();
        imu
    }

    #[test]
    fn rotations_are_integrated_from_the_initial_attitude() {
        let initial = UnitQuaternion::from_euler_angles(0.3, 0.0, 1.0);
        let mut attitude = BaseAttitude::new(initial);
        assert!(attitude.R_WB().unwrap_err().contains("no imu"));
        let w = Vector3::new(0.1, -0.2, 0.05);
        for i in 0..=100 {
            for _ in 0..2 {
                attitude
                    .take(&imu(f64::from(i) * 0.01, w), "base_link")
                    .unwrap();
            }
        }
        let expected = initial * UnitQuaternion::from_scaled_axis(w);
        assert!(attitude.R_WB().unwrap().angle_to(&expected) < 1e-9);
    }

    #[test]
    fn an_unknown_attitude_is_an_error() {
        let mut attitude = BaseAttitude::new(UnitQuaternion::identity());
        let still = Vector3::zeros();
        let wrong = attitude.take(&imu(0.0, still), "hull").unwrap_err();
        assert!(wrong.contains("'base_link'; expected hull"), "{wrong}");
        let nan = attitude.take(&imu(0.0, Vector3::repeat(f64::NAN)), "base_link");
        assert!(nan.unwrap_err().contains("finite"));
        attitude.take(&imu(10.0, still), "base_link").unwrap();
        attitude.take(&imu(11.0, still), "base_link").unwrap();
        assert!(attitude.R_WB().unwrap_err().contains("1.0 s without imu"));
        // A jump back in time starts a new run.
        attitude.take(&imu(0.0, still), "base_link").unwrap();
        assert!(attitude.R_WB().is_ok());
    }
}
