//! Settings of a capture mission.

use nalgebra::Vector3;

use crate::control::capture::{
    ClearanceConfig, DetumbleLimits, JointLimitsShare, Objective, TipLaw, TrackConfig,
};
use crate::control::gains::ConfigError;
use crate::spatial::{Pose, RigidInertia, SpatialInertia};

/// Settings of a [`CaptureMission`](super::CaptureMission).
#[derive(Debug, Clone, PartialEq)]
pub struct CaptureConfig {
    /// Noise of the measured poses of the grasp frame.
    pub track: TrackConfig,
    /// Shortest time of observation \[s\].
    pub observe_time: f64,
    /// Time after which a mission that has not started its approach is aborted \[s\].
    pub observe_timeout: f64,
    /// Largest standard deviation of the predicted position of the grasp frame at the rendezvous \[m\].
    pub position_limit: f64,
    /// Largest standard deviation of the predicted attitude of the grasp frame at the rendezvous \[rad\].
    pub attitude_limit: f64,
    /// Candidate durations of the approach \[s\].
    pub approach_times: Vec<f64>,
    /// Objective that selects among them.
    pub objective: Objective,
    /// Distance from the grasp frame at which the approach ends \[m\].
    pub standoff: f64,
    /// Candidate grasp frames, as poses in the measured grasp frame.
    pub grasps: Vec<Pose>,
    /// Direction of the final approach in the grasp frame.
    pub approach_axis: Vector3<f64>,
    /// Duration of the final approach \[s\].
    pub final_time: f64,
    /// Time between two replannings during the approach \[s\].
    pub replan_period: f64,
    /// Sizes of the shapes for clearance checks.
    pub clearance: ClearanceConfig,
    /// Limits of the joints' motion.
    pub limits: JointLimitsShare,
    /// Law of the tip in the final approach.
    pub tip_law: TipLaw,
    /// Natural frequency of the joints' servo \[rad/s\].
    pub joint_bandwidth: f64,
    /// Time without a measured pose after which the target counts as lost \[s\].
    pub lost_timeout: f64,
    /// Predicted distance and angle between tip and grasp frame at which the gripper closes \[m, rad\].
    pub close_within: (f64, f64),
    /// Longest time from the end of the final approach to the closing of the gripper \[s\].
    pub close_timeout: f64,
    /// Whether the gripper reports if it holds the target
    /// ([`CaptureMission::set_grip`](super::CaptureMission::set_grip)); otherwise the arm tests the grasp by pulling.
    pub reports_grip: bool,
    /// Lowest rotational stiffness of the grip \[N m/rad\]; infinite for a rigid grip.
    pub grip_stiffness: f64,
    /// Distance of the test pull \[m\].
    pub pull: f64,
    /// Largest number of attempts to grasp.
    pub attempts: u32,
    /// Largest motion of the target in the grasp before it counts as slipped \[m, rad\].
    pub slip: (f64, f64),
    /// Assumed mass of the target \[kg\] and radius of gyration \[m\], until they are identified.
    pub presumed: (f64, f64),
    /// Mass \[kg\] and radius of gyration \[m\] of the heaviest possible target: the first excitation keeps the load on
    /// the grasp within its limits even for this body.
    pub heaviest: (f64, f64),
    /// Time in which the joints come to rest after the grasp \[s\].
    pub settle_time: f64,
    /// Limits for detumbling.
    pub detumble: DetumbleLimits,
    /// Angular velocity of the base below which robot and target count as stopped \[rad/s\].
    pub final_rate: f64,
    /// Time after which detumbling is aborted \[s\].
    pub detumble_timeout: f64,
    /// Duration of the excitation \[s\].
    pub excitation_time: f64,
    /// Amplitude of each joint in the excitation \[rad or m\]. A single value is the amplitude of the last three
    /// joints, and an eighth of it that of the others, which move the target much further. The limits at the grasp may
    /// reduce all amplitudes, or allow up to twice as much.
    pub excitation: Vec<f64>,
    /// Standard deviation of the gyro's noise \[rad/s\].
    pub gyro_noise: f64,
    /// Largest condition number for which an identification is accepted.
    pub condition_limit: f64,
}

impl Default for CaptureConfig {
    fn default() -> Self {
        Self {
            track: TrackConfig::default(),
            observe_time: 12.0,
            observe_timeout: 240.0,
            position_limit: 0.02,
            attitude_limit: 0.03,
            approach_times: vec![14.0, 18.0, 22.0, 27.0, 33.0, 40.0],
            objective: Objective::BaseReaction,
            standoff: 0.4,
            grasps: vec![Pose::identity()],
            approach_axis: Vector3::x(),
            final_time: 8.0,
            replan_period: 1.0,
            clearance: ClearanceConfig::default(),
            limits: JointLimitsShare::default(),
            tip_law: TipLaw::Impedance {
                frequency: 2.0,
                damping: 1.0,
            },
            joint_bandwidth: 5.0,
            lost_timeout: 3.0,
            close_within: (0.01, 0.03),
            close_timeout: 10.0,
            reports_grip: false,
            grip_stiffness: f64::INFINITY,
            pull: 0.03,
            attempts: 2,
            slip: (0.03, 0.1),
            presumed: (170.0, 0.7),
            heaviest: (600.0, 1.0),
            settle_time: 4.0,
            detumble: DetumbleLimits::default(),
            final_rate: 5e-4,
            detumble_timeout: 300.0,
            excitation_time: 35.0,
            excitation: vec![0.4],
            gyro_noise: 1e-4,
            condition_limit: 1e3,
        }
    }
}

impl CaptureConfig {
    /// Refuses settings that are not finite, of the wrong sign, or that contradict each other.
    ///
    /// # Errors
    /// [`ConfigError`] names the setting.
    pub fn check(&self, joints: usize) -> Result<(), ConfigError> {
        use crate::control::gains::{check_not_negative, check_positive};
        let law = match self.tip_law {
            TipLaw::Impedance { frequency, damping } => [frequency, damping],
            TipLaw::Transpose { stiffness, damping } => {
                [stiffness.0.min(stiffness.1), damping.0.min(damping.1)]
            }
        };
        for (name, value) in [
            ("position_noise", self.track.position_noise),
            ("attitude_noise", self.track.attitude_noise),
            ("observe_time", self.observe_time),
            ("observe_timeout", self.observe_timeout),
            ("position_limit", self.position_limit),
            ("attitude_limit", self.attitude_limit),
            ("standoff", self.standoff),
            ("final_time", self.final_time),
            ("replan_period", self.replan_period),
            ("tip_law", law[0]),
            ("tip_damping", law[1]),
            ("joint_bandwidth", self.joint_bandwidth),
            ("lost_timeout", self.lost_timeout),
            ("close_distance", self.close_within.0),
            ("close_angle", self.close_within.1),
            ("close_timeout", self.close_timeout),
            ("pull", self.pull),
            // Infinite is allowed: a rigid grip.
            (
                "grip_stiffness",
                if self.grip_stiffness == f64::INFINITY {
                    1.0
                } else {
                    self.grip_stiffness
                },
            ),
            ("slip_distance", self.slip.0),
            ("slip_angle", self.slip.1),
            ("presumed_mass", self.presumed.0),
            ("presumed_gyration", self.presumed.1),
            ("heaviest_mass", self.heaviest.0),
            ("heaviest_gyration", self.heaviest.1),
            ("settle_time", self.settle_time),
            ("grasp_force", self.detumble.grasp_force),
            ("grasp_torque", self.detumble.grasp_torque),
            ("final_rate", self.final_rate),
            ("detumble_timeout", self.detumble_timeout),
            ("excitation_time", self.excitation_time),
            ("gyro_noise", self.gyro_noise),
            ("condition_limit", self.condition_limit),
            ("track_window", self.track.window),
            ("link_radius", self.clearance.link_radius),
            ("base_radius", self.clearance.base_radius),
            ("keep_out", self.clearance.keep_out),
            ("margin", self.clearance.margin),
            ("velocity_share", self.limits.velocity),
            ("default_velocity", self.limits.default_velocity),
            ("acceleration", self.limits.acceleration),
            ("effort_share", self.limits.effort),
            ("attempts", f64::from(self.attempts)),
        ] {
            check_positive(name, value)?;
        }
        check_not_negative("couple", self.detumble.couple)?;
        check_positive("approach_axis", self.approach_axis.norm())?;
        for time in &self.approach_times {
            check_positive("approach_times", *time)?;
        }
        if self.approach_times.is_empty() {
            check_positive("approach_times", 0.0)?;
        }
        if self.grasps.is_empty() {
            check_positive("grasps", 0.0)?;
        }
        let count = self.excitation.len();
        if count != 1 && count != joints {
            return Err(ConfigError::Length {
                name: "excitation",
                got: count,
                joints,
            });
        }
        Ok(())
    }

    /// Lowest natural frequency \[rad/s\] of a body (in the tip's frame) on the grip, with a fixed tip: that of a
    /// rotation about the tip, with the body's largest moment of inertia. `None` for a rigid grip.
    pub(super) fn grip_frequency(&self, body: &RigidInertia) -> Option<f64> {
        let about_tip = SpatialInertia::from(body).about_origin.to_matrix();
        let largest = about_tip.symmetric_eigenvalues().max();
        (self.grip_stiffness.is_finite() && largest > 0.0)
            .then(|| (self.grip_stiffness / largest).sqrt())
    }

    /// Amplitude of each of `joints` joints in the excitation.
    pub(super) fn amplitudes(&self, joints: usize) -> Vec<f64> {
        match self.excitation.as_slice() {
            [one] if joints > 1 => {
                let moves = |j: usize| j + 3 >= joints;
                (0..joints)
                    .map(|j| if moves(j) { *one } else { one / 8.0 })
                    .collect()
            }
            all => all.to_vec(),
        }
    }
}
