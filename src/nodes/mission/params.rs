//! Parameters of the mission node.

use nalgebra::Vector3;

use super::actuators::Actuators;
use crate::{
    control::capture::{
        CaptureConfig, CaptureMission, ClearanceConfig, DetumbleLimits, GripWatch, Gripper,
        JointLimitsShare, Objective, TipLaw, TrackConfig,
    },
    model::Model,
    nodes::{
        camera::camera_frame,
        choice,
        named_lists::declare_each,
        placement::{declare_orientation, declare_vector},
        tip::{declare_tip_link, tip_frame},
    },
    ros::Declare,
    spatial::Pose,
};

/// Parameters of the mission node, read at the start.
#[derive(Debug, Clone)]
pub struct MissionParams {
    /// Link whose frame is the tip.
    pub tip_link: String,
    /// Whether a mission begins automatically.
    pub autostart: bool,
    /// How the grasp is closed and opened.
    pub grip: Grip,
    /// Wheels and thrusters.
    pub actuators: Actuators,
    /// Settings of a mission.
    pub config: CaptureConfig,
}

/// How the grasp is closed and opened.
#[derive(Debug, Clone, PartialEq)]
pub enum Grip {
    /// A latch that closes automatically; the arm pulls to find out whether it holds.
    Automatic,
    /// The services `attach` and `detach` of the dynamics node.
    Services,
    /// A gripper with fingers.
    Fingers(Fingers),
}

/// A gripper with fingers, described by its action and its joint.
#[derive(Debug, Clone, PartialEq)]
pub struct Fingers {
    /// Name of the gripper: its action is `NAME/gripper_cmd`.
    pub name: String,
    /// The joint that moves the fingers.
    pub joint: String,
    /// Joint position when the gripper is open \[m or rad\].
    pub open: f64,
    /// Joint position when the gripper has closed without an object \[m or rad\].
    pub closed: f64,
    /// Largest effort with which it closes \[N or N m\]; 0 for the gripper's own limit.
    pub effort: f64,
    /// How long the fingers must be at rest until the gripper presses with that effort, and counts as holding \[s\].
    pub press_time: f64,
}

impl Fingers {
    /// Declares and reads the parameters of the gripper; `None` if it has no name.
    fn declare(declare: &mut Declare) -> Option<Self> {
        let mut text = |name: &str, text: &str| {
            let parameter = declare.param(name, String::new(), text);
            parameter.read_only().value()
        };
        let name = text(
            "gripper",
            "Gripper with fingers that grasps, by its action NAME/gripper_cmd; empty is a latch",
        );
        let joint = text(
            "gripper_joint",
            "Joint that moves the fingers of the gripper",
        );
        let mut number = |name: &str, default: f64, range: (f64, f64), text: &str| {
            let parameter = declare.param(name, default, text);
            parameter.range(range.0, range.1).read_only().value()
        };
        let fingers = Self {
            joint,
            open: number(
                "gripper_open",
                0.0,
                (-10.0, 10.0),
                "Position of that joint when the gripper is open [m or rad]",
            ),
            closed: number(
                "gripper_closed",
                0.06,
                (-10.0, 10.0),
                "Position of that joint when it has closed on nothing [m or rad]",
            ),
            effort: number(
                "gripper_effort",
                0.0,
                (0.0, 1e6),
                "Largest effort with which the gripper closes [N or N m]; 0 is its own",
            ),
            press_time: number(
                "gripper_press_time",
                4.0,
                (0.1, 10.0),
                "How long the fingers must have stood still until the gripper presses with its whole effort, and holds [s]",
            ),
            name,
        };
        (!fingers.name.is_empty()).then_some(fingers)
    }

    /// Joint position for a gripper command \[m or rad\].
    pub fn position(&self, command: Gripper) -> f64 {
        match command {
            Gripper::Open => self.open,
            Gripper::Close => self.closed,
        }
    }

    /// A monitor of its joint, which detects whether the gripper holds.
    pub fn watch(&self) -> GripWatch {
        GripWatch::new(self.open, self.closed, self.press_time)
    }
}

/// Names of the tip's control laws; true for impedance control.
const TIP_LAWS: [(&str, bool); 2] = [("impedance", true), ("transpose", false)];

/// Declares and reads the pose of a grasp frame in the measured frame.
fn declare_grasp_frame(declare: &mut Declare, name: String) -> Result<Pose, String> {
    let position = declare_vector(
        declare,
        &format!("{name}.position"),
        "Position of the grasp frame in the frame that the camera measures [m]",
    );
    let rotation = declare_orientation(
        declare,
        &format!("{name}.orientation"),
        "Attitude of the grasp frame in the frame that the camera measures (x, y, z, w)",
    )?;
    Ok(Pose::from_parts(
        position.into(),
        rotation.to_rotation_matrix(),
    ))
}

impl MissionParams {
    /// Declares and reads the parameters. The caller must call `declare.finish`.
    ///
    /// # Errors
    /// A line that names the parameter.
    pub fn declare(declare: &mut Declare) -> Result<Self, String> {
        let tip_link = declare_tip_link(declare);
        let default = CaptureConfig::default();
        let objective = choice::declare(
            declare,
            "objective",
            &Objective::NAMES,
            "What the approach minimises",
        );
        let objective = objective.read_only().value();
        let tip_law = choice::declare(
            declare,
            "tip_law",
            &TIP_LAWS,
            "Law of the tip in the final approach",
        );
        let is_impedance = choice::find(&TIP_LAWS, &tip_law.read_only().value()).unwrap_or(true);
        let mut flag = |name: &str, default: bool, text: &str| {
            declare.param(name, default, text).read_only().value()
        };
        let autostart = flag("autostart", false, "Whether a mission begins by itself");
        let uses_services = flag(
            "gripper_services",
            false,
            "Whether the grasp is closed and opened by the dynamics node's attach and detach; otherwise it latches by itself",
        );
        let fingers = Fingers::declare(declare);
        let grip_stiffness = declare
            .param(
                "grip_stiffness",
                0.0,
                "Lowest rotational stiffness of the grip with which the target is held; 0 does not yield [N m/rad]",
            )
            .range(0.0, 1e12)
            .read_only()
            .value();
        let grasps = declare_each(
            declare,
            "grasp_frames",
            "Names of the grasp frames of the target to choose from; without any, the measured frame is the only one",
            declare_grasp_frame,
        );
        let mut list = |name: &str, default: &[f64], text: &str| -> Vec<f64> {
            let parameter = declare.param(name, default.to_vec(), text);
            parameter.range(-1e3, 1e3).read_only().value()
        };
        let axis = list(
            "approach_axis",
            default.approach_axis.as_slice(),
            "Direction of the final approach in the grasp frame",
        );
        let axis = <[f64; 3]>::try_from(axis.as_slice())
            .map_err(|_| format!("parameter approach_axis has {} values; give 3", axis.len()));
        let approach_times = list(
            "approach_times",
            &default.approach_times,
            "Durations of the approach to choose from [s]",
        );
        let excitation = list(
            "excitation",
            &default.excitation,
            "Amplitudes of the joints in the identification [rad or m]; one value is for the last three joints, an eighth of it for the others; the limits at the grasp may make all smaller, or twice as large",
        );
        let mut number = |name: &str, default: f64, text: &str| {
            let parameter = declare.param(name, default, text).range(0.0, 1e6);
            parameter.read_only().value()
        };
        let frequency = number(
            "tip_frequency",
            2.0,
            "Natural frequency of the tip's impedance [rad/s]",
        );
        let damping = number("tip_damping", 1.0, "Damping ratio of the tip's impedance");
        let stiffness = (
            number(
                "tip_stiffness",
                400.0,
                "Stiffness of the transpose law [N/m]",
            ),
            number(
                "tip_angular_stiffness",
                100.0,
                "Angular stiffness of the transpose law [N m/rad]",
            ),
        );
        let transpose_damping = (
            number("tip_damper", 400.0, "Damping of the transpose law [N s/m]"),
            number(
                "tip_angular_damper",
                50.0,
                "Angular damping of the transpose law [N m s/rad]",
            ),
        );
        let d = &default;
        let config = CaptureConfig {
            track: TrackConfig {
                position_noise: number(
                    "position_noise",
                    d.track.position_noise,
                    "Standard deviation of each coordinate of a measured grasp position [m]",
                ),
                attitude_noise: number(
                    "attitude_noise",
                    d.track.attitude_noise,
                    "Standard deviation of each component of a measured grasp attitude [rad]",
                ),
                window: number(
                    "track_window",
                    d.track.window,
                    "Longest time over which measured poses are used [s]",
                ),
            },
            observe_time: number("observe_time", d.observe_time, "Shortest observation [s]"),
            observe_timeout: number(
                "observe_timeout",
                d.observe_timeout,
                "Time after which a mission that has not begun its approach is aborted [s]",
            ),
            position_limit: number(
                "position_limit",
                d.position_limit,
                "Largest standard deviation of the predicted grasp position [m]",
            ),
            attitude_limit: number(
                "attitude_limit",
                d.attitude_limit,
                "Largest standard deviation of the predicted grasp attitude [rad]",
            ),
            approach_times,
            objective: choice::find(&Objective::NAMES, &objective).unwrap_or_default(),
            standoff: number(
                "standoff",
                d.standoff,
                "Distance from the grasp frame at which the approach ends [m]",
            ),
            grasps: d.grasps.clone(),
            reports_grip: false,
            grip_stiffness: f64::INFINITY,
            approach_axis: d.approach_axis,
            final_time: number(
                "final_time",
                d.final_time,
                "Duration of the final approach [s]",
            ),
            replan_period: number(
                "replan_period",
                d.replan_period,
                "Time between two plans on the way [s]",
            ),
            clearance: ClearanceConfig {
                link_radius: number(
                    "link_radius",
                    d.clearance.link_radius,
                    "Radius of the capsules around the links [m]",
                ),
                base_radius: number(
                    "base_radius",
                    d.clearance.base_radius,
                    "Radius of the sphere around the base [m]",
                ),
                keep_out: number(
                    "keep_out",
                    d.clearance.keep_out,
                    "Radius of the sphere around the target's centre of mass that the approach avoids [m]",
                ),
                margin: number(
                    "margin",
                    d.clearance.margin,
                    "Least distance between parts of the robot [m]",
                ),
            },
            limits: JointLimitsShare {
                velocity: number(
                    "velocity_share",
                    d.limits.velocity,
                    "Share of the joints' velocity limits that plans use",
                ),
                default_velocity: number(
                    "default_velocity",
                    d.limits.default_velocity,
                    "Largest rate of joints without a velocity limit [rad/s or m/s]",
                ),
                acceleration: number(
                    "acceleration",
                    d.limits.acceleration,
                    "Largest acceleration of joints in plans [rad/s2 or m/s2]",
                ),
                effort: number(
                    "effort_share",
                    d.limits.effort,
                    "Share of the joints' effort limits that plans use",
                ),
            },
            tip_law: match is_impedance {
                true => TipLaw::Impedance { frequency, damping },
                false => TipLaw::Transpose {
                    stiffness,
                    damping: transpose_damping,
                },
            },
            joint_bandwidth: number(
                "joint_bandwidth",
                d.joint_bandwidth,
                "Natural frequency of the joints' servo [rad/s]",
            ),
            lost_timeout: number(
                "lost_timeout",
                d.lost_timeout,
                "Time without a measured pose after which the target is lost [s]",
            ),
            close_within: (
                number(
                    "close_distance",
                    d.close_within.0,
                    "Distance from the predicted grasp frame at which the gripper closes [m]",
                ),
                number(
                    "close_angle",
                    d.close_within.1,
                    "Angle from the predicted grasp frame at which the gripper closes [rad]",
                ),
            ),
            close_timeout: number(
                "close_timeout",
                d.close_timeout,
                "Longest time at the grasp frame before the gripper closes [s]",
            ),
            pull: number(
                "pull",
                d.pull,
                "How far the arm pulls to find out whether it holds the target [m]",
            ),
            attempts: number("attempts", f64::from(d.attempts), "Attempts to grasp") as u32,
            slip: (
                number(
                    "slip_distance",
                    d.slip.0,
                    "Motion in the grasp that counts as slip [m]",
                ),
                number(
                    "slip_angle",
                    d.slip.1,
                    "Turn in the grasp that counts as slip [rad]",
                ),
            ),
            heaviest: (
                number(
                    "heaviest_mass",
                    d.heaviest.0,
                    "Mass of the heaviest target, for which the first excitation is sized [kg]",
                ),
                number(
                    "heaviest_gyration",
                    d.heaviest.1,
                    "Radius of gyration of the heaviest target [m]",
                ),
            ),
            presumed: (
                number(
                    "presumed_mass",
                    d.presumed.0,
                    "Mass of the target until it is identified [kg]",
                ),
                number(
                    "presumed_gyration",
                    d.presumed.1,
                    "Radius of gyration of the target until it is identified [m]",
                ),
            ),
            settle_time: number(
                "settle_time",
                d.settle_time,
                "Time in which the joints come to rest after the grasp [s]",
            ),
            detumble: DetumbleLimits {
                couple: number(
                    "couple",
                    d.detumble.couple,
                    "Largest couple of the thrusters on the base [N m]",
                ),
                grasp_force: number(
                    "grasp_force",
                    d.detumble.grasp_force,
                    "Largest force at the grasp while detumbling [N]",
                ),
                grasp_torque: number(
                    "grasp_torque",
                    d.detumble.grasp_torque,
                    "Largest torque at the grasp while detumbling [N m]",
                ),
            },
            final_rate: number(
                "final_rate",
                d.final_rate,
                "Angular velocity of the base below which the stack has stopped [rad/s]",
            ),
            detumble_timeout: number(
                "detumble_timeout",
                d.detumble_timeout,
                "Time after which detumbling is aborted [s]",
            ),
            excitation_time: number(
                "excitation_time",
                d.excitation_time,
                "Duration of each of the two excitations [s]",
            ),
            excitation,
            gyro_noise: number(
                "gyro_noise",
                d.gyro_noise,
                "Standard deviation of the gyro's noise [rad/s]",
            ),
            condition_limit: number(
                "condition_limit",
                d.condition_limit,
                "Largest condition number with which an identification is accepted",
            ),
        };
        let actuators = Actuators::declare(declare);
        // Returned after all declarations, so that no parameter is reported as unknown.
        let grasps: Vec<_> = grasps?.into_iter().collect::<Result<_, String>>()?;
        let mut config = CaptureConfig {
            approach_axis: Vector3::from(axis?),
            grip_stiffness: match grip_stiffness {
                0.0 => f64::INFINITY,
                stiffness => stiffness,
            },
            ..config
        };
        if !grasps.is_empty() {
            config.grasps = grasps;
        }
        let grip = match (fingers, uses_services) {
            (Some(fingers), true) => {
                return Err(format!(
                    "parameter gripper is '{}' and gripper_services is true; give one of them",
                    fingers.name
                ));
            }
            (Some(_), false) if config.grip_stiffness.is_infinite() => {
                return Err(
                    "parameter grip_stiffness is not given; a gripper with fingers yields, and the servo must know how much"
                        .to_owned(),
                );
            }
            (Some(fingers), false) => Grip::Fingers(fingers),
            (None, true) => Grip::Services,
            (None, false) => Grip::Automatic,
        };
        config.reports_grip = grip != Grip::Automatic;
        Ok(Self {
            tip_link,
            autostart,
            grip,
            actuators: actuators?,
            config,
        })
    }

    /// Model of the arm: the robot with the gripper's joint locked in the open position.
    ///
    /// # Errors
    /// A line that names the parameter and lists the known joints.
    pub fn arm(&self, robot: &Model) -> Result<Model, String> {
        let Grip::Fingers(fingers) = &self.grip else {
            return Ok(robot.clone());
        };
        let Some(joint) = robot.joint_index(&fingers.joint) else {
            let joints = robot.joints().iter().map(|joint| joint.name.as_str());
            return Err(format!(
                "parameter gripper_joint: the robot has no joint '{}' that moves on its own; it has {}",
                fingers.joint,
                joints.collect::<Vec<_>>().join(", ")
            ));
        };
        if fingers.open == fingers.closed {
            return Err(format!(
                "parameters gripper_open and gripper_closed are both {}; they must differ",
                fingers.closed
            ));
        }
        // If the stroke ended before `closed`, an empty gripper would seem to hold an object.
        let limits = &robot.joints()[joint].limits;
        for (name, value) in [
            ("gripper_open", fingers.open),
            ("gripper_closed", fingers.closed),
        ] {
            if !(limits.lower..=limits.upper).contains(&value) {
                return Err(format!(
                    "parameter {name} is {value}; joint {} moves from {} to {}",
                    fingers.joint, limits.lower, limits.upper
                ));
            }
        }
        let locked: Vec<bool> = (0..robot.dof()).map(|j| j == joint).collect();
        let q: Vec<f64> = (locked.iter())
            .map(|locked| if *locked { fingers.open } else { 0.0 })
            .collect();
        Ok(robot.with_locked_joints(&q, &locked))
    }

    /// A mission for the robot's arm.
    ///
    /// # Errors
    /// A line that names the parameter, or the missing link.
    pub fn mission(&self, robot: &Model) -> Result<CaptureMission, String> {
        let arm = self.arm(robot)?;
        let tip = tip_frame(&arm, &self.tip_link).map_err(|e| format!("parameter {e}"))?;
        let camera = camera_frame(&arm)?;
        let mission = CaptureMission::new(&arm, &tip, camera, self.config.clone());
        let fitted = mission
            .map_err(|e| e.to_string())
            .and_then(|mission| self.actuators.fit(mission, robot));
        fitted.map_err(|e| format!("parameter {e}"))
    }
}
