//! Estimates as messages. All of one time are in the camera's axes C as they are at that time.

use nalgebra::UnitQuaternion;

use crate::{
    estimation::Estimated,
    msg::{fuyu_msgs, geometry_msgs, nav_msgs, std_msgs::Header},
    nodes::geometry::{quaternion_to_msg, vector_to_msg},
    ros::Time,
};

/// What an estimate says of one moment, for those who look from a camera there.
pub struct Moment<'a> {
    /// The estimate.
    pub estimated: &'a Estimated,
    /// The time \[s\].
    pub time: f64,
    /// Name of the camera's optical frame.
    pub camera: &'a str,
    /// Attitude of the camera at that time in the axes of the estimate.
    pub R_IC: UnitQuaternion<f64>,
}

impl Moment<'_> {
    fn header(&self, time: f64) -> Header {
        Header {
            stamp: Time::from_secs_f64(time).into(),
            frame_id: self.camera.to_owned(),
        }
    }

    /// `estimator/motion`, found from `frames` frames over `duration` \[s\].
    pub fn motion(&self, frames: usize, duration: f64) -> fuyu_msgs::MotionEstimate {
        let estimated = self.estimated;
        let motion = &estimated.motion;
        let (R_CB, w_C) = estimated.seen_from(&self.R_IC, self.time);
        let J = motion.J().unwrap_or_default();
        let mut covariance = [0.0; 16];
        if let Some(known) = motion.covariance() {
            // Symmetric, so that columns are rows.
            covariance.copy_from_slice(known.as_slice());
        }
        let direction = self.R_IC.inverse() * motion.momentum_direction();
        fuyu_msgs::MotionEstimate {
            header: self.header(self.time),
            method: estimated.method.name().to_owned(),
            model: motion.model().name().to_owned(),
            j_x: J.x,
            j_y: J.y,
            j_z: J.z,
            alpha: motion.alpha(),
            reference_attitude: quaternion_to_msg(&R_CB),
            phase: motion.rotation().phase_at(self.time),
            angular_velocity: vector_to_msg(&w_C),
            momentum_direction: vector_to_msg(&direction),
            residual: motion.rms(),
            covariance,
            frames: u32::try_from(frames).unwrap_or(u32::MAX),
            duration,
        }
    }

    /// `estimator/angular_velocity`.
    pub fn angular_velocity(&self) -> geometry_msgs::Vector3Stamped {
        let (_, w_C) = self.estimated.seen_from(&self.R_IC, self.time);
        geometry_msgs::Vector3Stamped {
            header: self.header(self.time),
            vector: vector_to_msg(&w_C),
        }
    }

    /// `estimator/prediction`: attitudes from this time on over `horizon` \[s\], `rate` of them a second, in
    /// the camera's axes of this time. Positions are not estimated; they are zero.
    pub fn prediction(&self, horizon: f64, rate: f64) -> nav_msgs::Path {
        let steps = (horizon * rate).floor() as u32;
        let poses = (0..=steps).map(|k| {
            let time = self.time + f64::from(k) / rate;
            let (R_CB, _) = self.estimated.seen_from(&self.R_IC, time);
            let mut pose = geometry_msgs::PoseStamped {
                header: self.header(time),
                ..geometry_msgs::PoseStamped::default()
            };
            pose.pose.orientation = quaternion_to_msg(&R_CB);
            pose
        });
        nav_msgs::Path {
            header: self.header(self.time),
            poses: poses.collect(),
        }
    }
}
