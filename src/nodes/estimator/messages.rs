//! Conversion of estimates to messages. A message is in the camera's axes C at the time of its stamp.

use nalgebra::{Matrix3, UnitQuaternion, Vector3};

use crate::{
    estimation::{
        MotionState, MotionTracker,
        bundle::{CentreMotion, KnownLength, MeasuredRange, Scale},
    },
    msg::{fuyu_msgs, geometry_msgs, nav_msgs, std_msgs::Header},
    nodes::geometry::{quaternion_to_msg, vector_to_msg},
    ros::Time,
    spatial::unwound,
};

/// The motion estimate at one time, expressed in the camera's axes at that time.
pub struct Snapshot<'a> {
    /// The motion estimate.
    pub tracker: &'a MotionTracker,
    /// The time \[s\].
    pub time: f64,
    /// Name of the camera's optical frame.
    pub camera: &'a str,
    /// Attitude of the camera at that time in the inertial axes of the motion.
    pub R_IC: UnitQuaternion<f64>,
    /// The known length on the target, which gives the scale.
    pub known_length: Option<&'a KnownLength>,
    /// Measured distances of feature points, which also give the scale.
    pub ranges: &'a [MeasuredRange],
}

impl Snapshot<'_> {
    fn header(&self, time: f64) -> Header {
        Header {
            stamp: Time::from_secs_f64(time).into(),
            frame_id: self.camera.to_owned(),
        }
    }

    /// Attitude `R_CF` of the persistent body axes F at `time` \[s\].
    fn attitude(&self, time: f64) -> UnitQuaternion<f64> {
        self.R_IC.inverse() * self.tracker.motion().attitude(time) * self.tracker.R_BF()
    }

    /// Metres per unit of length: from the known length, otherwise from the measured distances; `None` without either.
    fn scale(&self) -> Option<Scale> {
        let solution = self.tracker.batch().estimated.solution.as_ref()?;
        let known = self.known_length.and_then(|l| solution.scale(l).ok());
        known.or_else(|| solution.scale_of_ranges(self.ranges))
    }

    /// Motion of the centre of mass at this time, and its unit of length.
    fn centre(&self) -> Option<(CentreMotion, &'static str)> {
        let centre = self.tracker.centre(self.time)?;
        Some(match self.scale() {
            Some(scale) => (centre.in_metres(&scale), "m"),
            None => (centre, "depth"),
        })
    }

    fn w_C(&self) -> Vector3<f64> {
        self.R_IC.inverse() * self.tracker.motion().angular_velocity(self.time)
    }

    /// `estimator/motion`, with the covariances of the rotation over `horizon` \[s\] at `rate` \[Hz\].
    pub fn motion(&self, horizon: f64, rate: f64) -> fuyu_msgs::MotionEstimate {
        let motion = self.tracker.motion();
        let J = motion.J().unwrap_or_default();
        let mut covariance = [0.0; 16];
        if let Some(known) = motion.covariance() {
            // The matrix is symmetric: order of rows and columns does not matter.
            covariance.copy_from_slice(known.as_slice());
        }
        let direction = self.R_IC.inverse() * motion.momentum_direction();
        let R_CI = *self.R_IC.inverse().to_rotation_matrix().matrix();
        let state = self.tracker.state(self.time);
        let turned = |m: Matrix3<f64>| -> [f64; 9] {
            let m = R_CI * m * R_CI.transpose();
            // The matrix is symmetric: order of rows and columns does not matter.
            std::array::from_fn(|k| m.as_slice()[k])
        };
        let of_state = |get: fn(&MotionState) -> Matrix3<f64>| {
            state.as_ref().map_or([0.0; 9], |s| turned(get(s)))
        };
        let steps = (horizon * rate + 1e-9).floor() as u32;
        let prediction_times: Vec<f64> = (1..=steps).map(|k| f64::from(k) / rate).collect();
        let times: Vec<f64> = prediction_times.iter().map(|t| self.time + t).collect();
        let spreads = state.as_ref().map(|s| s.turn_covariances(&times));
        let turn_covariances = spreads.into_iter().flatten().flat_map(turned);
        let centre = self.centre();
        let of_centre = |get: fn(&CentreMotion) -> Vector3<f64>| {
            let vector = centre.as_ref().map(|(c, _)| get(c));
            vector_to_msg(&vector.unwrap_or_default())
        };
        let of_centre_spread = |from: usize| -> [f64; 9] {
            let spread = centre
                .as_ref()
                .map(|(c, _)| c.covariance.fixed_view::<3, 3>(from, from).into_owned());
            // The matrix is symmetric: order of rows and columns does not matter.
            spread.map_or([0.0; 9], |m| std::array::from_fn(|k| m.as_slice()[k]))
        };
        fuyu_msgs::MotionEstimate {
            position: of_centre(|c| c.position),
            velocity: of_centre(|c| c.velocity),
            position_covariance: of_centre_spread(0),
            velocity_covariance: of_centre_spread(3),
            centre_unit: centre.as_ref().map_or("", |(_, unit)| unit).to_owned(),
            attitude_covariance: of_state(MotionState::attitude_covariance),
            angular_velocity_covariance: of_state(|s| s.angular_velocity().1),
            momentum_direction_covariance: of_state(MotionState::momentum_direction_covariance),
            turn_covariances: turn_covariances.collect(),
            prediction_times: match state {
                Some(_) => prediction_times,
                None => Vec::new(),
            },
            header: self.header(self.time),
            method: self.tracker.method().name().to_owned(),
            model: motion.model().name().to_owned(),
            j_x: J.x,
            j_y: J.y,
            j_z: J.z,
            alpha: motion.alpha(),
            reference_attitude: quaternion_to_msg(&self.attitude(self.time)),
            phase: motion.rotation().phase_at(self.time),
            angular_velocity: vector_to_msg(&self.w_C()),
            momentum_direction: vector_to_msg(&direction),
            residual: motion.rms(),
            covariance,
            frames: u32::try_from(self.tracker.frames()).unwrap_or(u32::MAX),
            duration: self.tracker.corrected() - self.tracker.batch().span.0,
        }
    }

    /// `estimator/angular_velocity`.
    pub fn angular_velocity(&self) -> geometry_msgs::Vector3Stamped {
        geometry_msgs::Vector3Stamped {
            header: self.header(self.time),
            vector: vector_to_msg(&self.w_C()),
        }
    }

    /// `estimator/prediction`: attitudes of F from this time over `horizon` \[s\], at `rate` \[Hz\], in the camera's
    /// axes at this time. Positions are those of the centre of mass: in metres if the scale is known, otherwise in
    /// units of its depth at the beginning of the batch; zero if the method gives no positions.
    pub fn prediction(&self, horizon: f64, rate: f64) -> nav_msgs::Path {
        let metres = self.scale().map_or(1.0, |scale| scale.metres);
        let steps = (horizon * rate + 1e-9).floor() as u32;
        let time = |k: u32| self.time + f64::from(k) / rate;
        let attitudes = (0..=steps).map(|k| self.attitude(time(k)));
        let poses = (0..).zip(unwound(attitudes)).map(|(k, R_CF)| {
            let mut pose = geometry_msgs::PoseStamped {
                header: self.header(time(k)),
                ..geometry_msgs::PoseStamped::default()
            };
            pose.pose.orientation = quaternion_to_msg(&R_CF);
            if let Some(position) = self.tracker.position(time(k)).map(|p| p * metres) {
                (pose.pose.position.x, pose.pose.position.y) = (position.x, position.y);
                pose.pose.position.z = position.z;
            }
            pose
        });
        nav_msgs::Path {
            header: self.header(self.time),
            poses: poses.collect(),
        }
    }
}
