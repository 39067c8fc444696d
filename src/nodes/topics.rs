//! The topics of the graph, each declared once: name, type, quality of service, publishers and subscribers.
//!
//! The constants, [`all`], and the tables in `ARCHITECTURE.md` and in [`nodes`](super) are derived from the
//! declarations below ([`Declaration`]); a test writes those tables. Names are relative to the node's namespace, except
//! `/clock`, `/tf` and `/tf_static`, which are absolute in ROS.

use std::marker::PhantomData;

use crate::{
    msg::{
        Interface,
        fuyu_msgs::{
            AppendageOutlines, AppendageStates, AttitudeState, ControllerState, ExternalImpulse,
            FeatureTracks, MissionState, Momentum, MotionEstimate, ThrusterCommands,
        },
        geometry_msgs::{
            PoseStamped, QuaternionStamped, TwistStamped, Vector3Stamped, WrenchStamped,
        },
        nav_msgs::{Odometry, Path},
        ros_gz_interfaces::Contacts,
        rosgraph_msgs::Clock,
        sensor_msgs::{CameraInfo, CompressedImage, Image, Imu, JointState, Joy, PointCloud2},
        std_msgs::{Float64, String as Text},
        tf2_msgs::TFMessage,
        trajectory_msgs::JointTrajectory,
        visualization_msgs::MarkerArray,
    },
    ros::{Node, NodeError, Publisher, Qos, Subscription},
};

/// Placeholder for the name of a target in topic names.
const NAME: &str = "NAME";

/// Declares topics: `CONSTANT: Kind<Message> = "name", QOS, [writers] => [readers];`. The kind is [`Topic`], or
/// [`TargetTopic`] for names with `NAME` in them. The comment of a declaration is its description in the tables.
macro_rules! topics {
    ($(
        #[doc = $description:literal]
        $constant:ident: $kind:ident<$message:ty> =
            $name:literal, $qos:ident, [$($writer:literal),*] => [$($reader:literal),*];
    )*) => {
        $(
            #[doc = $description]
            pub const $constant: $kind<$message> = $kind::new($name, Qos::$qos);
        )*

        /// All declarations, in their order.
        pub fn declarations() -> Vec<Declaration> {
            vec![$(
                Declaration {
                    constant: stringify!($constant),
                    name: $name,
                    type_name: <$message as Interface>::DEFINITION.type_name(),
                    qos: Qos::$qos,
                    qos_name: stringify!($qos),
                    writers: &[$($writer),*],
                    readers: &[$($reader),*],
                    description: $description,
                },
            )*]
        }
    };
}

topics! {
    /// Simulated time.
    CLOCK: Topic<Clock> = "/clock", CLOCK, ["dynamics"] => ["dynamics", "all with `use_sim_time`"];
    /// The robot's URDF.
    ROBOT_DESCRIPTION: Topic<Text> = "robot_description", LATCHED, ["dynamics"] => ["attitude", "camera", "controller", "mission", "teleop"];
    /// Joint positions, joint rates and mean joint efforts.
    JOINT_STATES: Topic<JointState> = "joint_states", RELIABLE, ["dynamics"] => ["attitude", "camera", "controller", "mission", "teleop"];
    /// Frames that move.
    TF: Topic<TFMessage> = "/tf", TF, ["dynamics"] => ["recorder"];
    /// Frames that do not move in their parent frame.
    TF_STATIC: Topic<TFMessage> = "/tf_static", TF_STATIC, ["dynamics"] => ["estimator"];
    /// True pose and twist of the base.
    ODOMETRY: Topic<Odometry> = "ground_truth/odom", RELIABLE, ["dynamics"] => ["camera", "views"];
    /// True pose and twist of a target.
    TARGET_ODOMETRY: TargetTopic<Odometry> = "ground_truth/NAME/odom", RELIABLE, ["dynamics"] => ["camera", "views"];
    /// A target's URDF, with links named as its frames.
    TARGET_DESCRIPTION: TargetTopic<Text> = "ground_truth/NAME/robot_description", LATCHED, ["dynamics"] => ["camera", "viewers"];
    /// Joint positions and rates of a target that has joints.
    TARGET_JOINT_STATES: TargetTopic<JointState> =
        "ground_truth/NAME/joint_states", RELIABLE, ["dynamics"] => ["camera", "viewers"];
    /// True momentum and kinetic energy of a target that has joints.
    TARGET_MOMENTUM: TargetTopic<Momentum> = "ground_truth/NAME/momentum", RELIABLE, ["dynamics"] => ["recorder"];
    /// Angular velocity and acceleration of the base, as measured.
    IMU: Topic<Imu> = "imu", RELIABLE, ["dynamics"] => ["attitude", "controller", "estimator", "mission", "teleop"];
    /// Attitude of the base in the world, as measured by the star tracker at the time of the stamp.
    STAR_TRACKER: Topic<QuaternionStamped> = "star_tracker", RELIABLE, ["dynamics"] => ["attitude"];
    /// True momentum and kinetic energy.
    MOMENTUM: Topic<Momentum> = "ground_truth/momentum", RELIABLE, ["dynamics"] => ["views"];
    /// True deformation of appendages and elastic joints.
    APPENDAGES: Topic<AppendageStates> = "ground_truth/appendages", RELIABLE, ["dynamics"] => ["views"];
    /// Points of the appendages, and how modes move them.
    APPENDAGE_OUTLINES: Topic<AppendageOutlines> = "ground_truth/appendage_outlines", LATCHED, ["dynamics"] => ["views"];
    /// Angles, speeds and mean motor torques of the wheels.
    WHEEL_STATES: Topic<JointState> = "wheel_states", RELIABLE, ["dynamics"] => ["attitude", "mission"];
    /// What external wrenches, thrusters, grasps and contacts have changed of the robot; from the first one on.
    EXTERNAL_IMPULSE: Topic<ExternalImpulse> = "ground_truth/external_impulse", RELIABLE, ["dynamics"] => ["recorder"];
    /// What the links beyond a joint exert on the rest of the robot, as its force and torque sensor measures it.
    WRIST_WRENCH: Topic<WrenchStamped> = "wrist/wrench", RELIABLE, ["dynamics"] => ["you"];
    /// Points at which links touch, with forces; if there is contact.
    CONTACTS: Topic<Contacts> = "contacts", RELIABLE, ["dynamics"] => ["you"];
    /// Joint efforts to hold, joint rates to drive to, or joint positions to hold.
    JOINT_COMMANDS: Topic<JointState> = "joint_commands", RELIABLE, ["controller", "mission", "teleop"] => ["dynamics"];
    /// How long after the state that they answer efforts act \[s\]; where time does not wait for answers.
    COMMAND_DELAY: Topic<Float64> = "command_delay", RELIABLE, ["dynamics"] => ["controller"];
    /// Motor torques of the wheels to hold, as efforts.
    WHEEL_COMMANDS: Topic<JointState> = "wheel_commands", RELIABLE, ["attitude", "mission"] => ["dynamics"];
    /// How long thrusters are on.
    THRUSTER_COMMANDS: Topic<ThrusterCommands> = "thruster_commands", RELIABLE, ["attitude", "mission"] => ["dynamics"];
    /// Reference of the base's attitude in the world.
    ATTITUDE_TARGET: Topic<QuaternionStamped> = "attitude_target", RELIABLE, ["you"] => ["attitude"];
    /// A trajectory for some of the joints.
    JOINT_TRAJECTORY: Topic<JointTrajectory> = "joint_trajectory", RELIABLE, ["you"] => ["dynamics"];
    /// Timed poses that the tip follows.
    CARTESIAN_PATH: Topic<Path> = "cartesian_path", RELIABLE, ["you"] => ["dynamics"];
    /// Twists of the tip in inertial space, as MoveIt Servo takes them.
    TWIST_COMMANDS: Topic<TwistStamped> = "delta_twist_cmds", RELIABLE, ["you"] => ["dynamics"];
    /// A wrench on the link that `frame_id` names.
    WRENCH: Topic<WrenchStamped> = "wrench", RELIABLE, ["mission", "you"] => ["dynamics"];
    /// Measured pose of the tip in the base frame.
    TIP_POSE: Topic<PoseStamped> = "camera/tip_pose", RELIABLE, ["camera"] => ["controller"];
    /// Measured pose of the goal in the base frame.
    MEASURED_GOAL: Topic<PoseStamped> = "camera/goal_pose", RELIABLE, ["camera"] => ["controller", "mission", "views"];
    /// Measured pose of the second tip in the base frame.
    SECOND_TIP_POSE: Topic<PoseStamped> = "camera/second/tip_pose", RELIABLE, ["camera"] => ["controller"];
    /// Measured pose of the second tip's goal in the base frame.
    SECOND_MEASURED_GOAL: Topic<PoseStamped> = "camera/second/goal_pose", RELIABLE, ["camera"] => ["controller"];
    /// Calibration of the camera.
    CAMERA_INFO: Topic<CameraInfo> = "camera/camera_info", LATCHED, ["camera"] => ["estimator"];
    /// Feature points of the target in the image.
    FEATURES: Topic<FeatureTracks> = "camera/features", SENSOR_DATA, ["camera", "tracker"] => ["estimator"];
    /// The same from the truth, if a tracker publishes what it finds in images.
    TRUE_FEATURES: Topic<FeatureTracks> = "ground_truth/features", SENSOR_DATA, ["camera"] => ["recorder"];
    /// Points of the target's surface in the camera's optical frame, from a stereo pair, a depth camera or a lidar.
    POINTS: Topic<PointCloud2> = "camera/points", SENSOR_DATA, ["you"] => ["estimator"];
    /// What the camera sees.
    IMAGE: Topic<Image> = "camera/image_raw", SENSOR_DATA, ["camera"] => ["tracker"];
    /// The same, compressed.
    COMPRESSED_IMAGE: Topic<CompressedImage> = "camera/image_raw/compressed", SENSOR_DATA, ["camera"] => ["you"];
    /// Distance along the optical axis in every pixel.
    DEPTH: Topic<Image> = "camera/depth", SENSOR_DATA, ["camera"] => ["you"];
    /// Which body every pixel sees.
    SEGMENTATION: Topic<Image> = "camera/segmentation", SENSOR_DATA, ["camera"] => ["tracker"];
    /// Calibration of the left camera of a pair.
    LEFT_CAMERA_INFO: Topic<CameraInfo> = "camera/left/camera_info", LATCHED, ["camera"] => ["you"];
    /// What the left camera of a pair sees.
    LEFT_IMAGE: Topic<Image> = "camera/left/image_raw", SENSOR_DATA, ["camera"] => ["you"];
    /// The same, compressed; left.
    LEFT_COMPRESSED_IMAGE: Topic<CompressedImage> = "camera/left/image_raw/compressed", SENSOR_DATA, ["camera"] => ["you"];
    /// Calibration of the right camera of a pair, with the baseline.
    RIGHT_CAMERA_INFO: Topic<CameraInfo> = "camera/right/camera_info", LATCHED, ["camera"] => ["you"];
    /// What the right camera of a pair sees.
    RIGHT_IMAGE: Topic<Image> = "camera/right/image_raw", SENSOR_DATA, ["camera"] => ["you"];
    /// The same, compressed; right.
    RIGHT_COMPRESSED_IMAGE: Topic<CompressedImage> = "camera/right/image_raw/compressed", SENSOR_DATA, ["camera"] => ["you"];
    /// Pose of the goal in the world, or in the frame of a target.
    GOAL: Topic<PoseStamped> = "goal_pose", RELIABLE, ["you"] => ["camera", "views"];
    /// The operator's joystick.
    JOY: Topic<Joy> = "joy", RELIABLE, ["you"] => ["teleop"];
    /// Twist of the tip that an operator commands.
    CMD_VEL: Topic<TwistStamped> = "cmd_vel", RELIABLE, ["you"] => ["teleop"];
    /// Measurements, law and efforts of the controller.
    CONTROLLER_STATE: Topic<ControllerState> = "controller/state", RELIABLE, ["controller"] => ["recorder"];
    /// Estimates, torques and momentum of the attitude controller.
    ATTITUDE_STATE: Topic<AttitudeState> = "attitude/state", RELIABLE, ["attitude"] => ["recorder"];
    /// State of a capture mission, with what its phases have done so far.
    MISSION_STATE: Topic<MissionState> = "mission/state", RELIABLE, ["mission"] => ["recorder"];
    /// Estimated angular velocity of the target.
    TARGET_RATE: Topic<Vector3Stamped> = "estimator/angular_velocity", RELIABLE, ["estimator"] => ["controller"];
    /// Estimated motion and inertia of the target.
    TARGET_MOTION: Topic<MotionEstimate> = "estimator/motion", RELIABLE, ["estimator"] => ["recorder"];
    /// Predicted attitudes of the target.
    PREDICTION: Topic<Path> = "estimator/prediction", RELIABLE, ["estimator"] => ["mission", "views"];
    /// Markers for RViz and Foxglove.
    MARKERS: Topic<MarkerArray> = "markers", RELIABLE, ["views"] => ["you"];
}

/// Name of the main camera, which sees the features; the prefix of its topics.
pub const CAMERA: &str = "camera";

/// The base link's name: last part of an absolute body name such as `/chaser/base_link`, the base of the robot in that
/// namespace.
pub const BASE: &str = "base_link";

/// A topic of messages `M`.
pub struct Topic<M> {
    /// Name, relative to the node's namespace unless it begins with a slash.
    pub name: &'static str,
    /// QoS that publishers offer and subscriptions request.
    pub qos: Qos,
    message: PhantomData<fn() -> M>,
}

impl<M: Interface> Topic<M> {
    const fn new(name: &'static str, qos: Qos) -> Self {
        Self {
            name,
            qos,
            message: PhantomData,
        }
    }

    /// Advertises it.
    ///
    /// # Errors
    /// When the node cannot publish.
    pub fn advertise(&self, node: &Node) -> Result<Publisher<M>, NodeError> {
        node.advertise(self.name, self.qos)
    }

    /// Name of the corresponding topic of the camera called `name`: `wrist/depth` for `camera/depth`.
    pub fn of_camera(&self, name: &str) -> String {
        match self.name.strip_prefix(CAMERA) {
            Some(rest) => format!("{name}{rest}"),
            None => self.name.to_owned(),
        }
    }

    /// Subscribes to it.
    ///
    /// # Errors
    /// When the node cannot subscribe.
    pub fn subscribe(&self, node: &Node) -> Result<Subscription<M>, NodeError> {
        node.subscribe(self.name, self.qos)
    }

    /// Subscribes to it with a queue of `depth` messages, for subscribers that need every message.
    ///
    /// # Errors
    /// When the node cannot subscribe.
    pub fn subscribe_deep(&self, node: &Node, depth: usize) -> Result<Subscription<M>, NodeError> {
        node.subscribe(self.name, self.qos.depth(depth))
    }
}

/// A topic of messages `M` that exists for each target.
pub struct TargetTopic<M> {
    /// Name, with `NAME` as a placeholder for the target's name.
    pattern: &'static str,
    /// QoS that publishers offer and subscriptions request.
    pub qos: Qos,
    message: PhantomData<fn() -> M>,
}

impl<M: Interface> TargetTopic<M> {
    const fn new(pattern: &'static str, qos: Qos) -> Self {
        Self {
            pattern,
            qos,
            message: PhantomData,
        }
    }

    /// Name of the topic of `target`, in the target's namespace if it has one. An absolute name refers to a body of
    /// another robot: a target, `/chaser/debris`, or its base, `/chaser/base_link`.
    pub fn of(&self, target: &str) -> String {
        match target.rsplit_once('/') {
            Some((namespace, BASE)) if target.starts_with('/') => {
                let of_robot = self.pattern.replace(&format!("{NAME}/"), "");
                format!("{namespace}/{of_robot}")
            }
            Some((namespace, name)) => format!("{namespace}/{}", self.pattern.replace(NAME, name)),
            None => self.pattern.replace(NAME, target),
        }
    }

    /// Advertises the topic of `target`.
    ///
    /// # Errors
    /// When the node cannot publish.
    pub fn advertise(&self, node: &Node, target: &str) -> Result<Publisher<M>, NodeError> {
        node.advertise(&self.of(target), self.qos)
    }

    /// Subscribes to the topic of `target`.
    ///
    /// # Errors
    /// When the node cannot subscribe.
    pub fn subscribe(&self, node: &Node, target: &str) -> Result<Subscription<M>, NodeError> {
        node.subscribe(&self.of(target), self.qos)
    }
}

/// Declared properties of a topic.
pub struct Declaration {
    /// Constant in this module.
    pub constant: &'static str,
    /// Name; `NAME` in it is a placeholder for the name of a target.
    pub name: &'static str,
    /// ROS type, `pkg/msg/Name`.
    pub type_name: String,
    /// Quality of service.
    pub qos: Qos,
    /// Name of the constant of [`Qos`].
    pub qos_name: &'static str,
    /// Nodes that publish on it; `you` stands for the user.
    pub writers: &'static [&'static str],
    /// Nodes that subscribe to it, or other programs and users. The recorder, which can record every topic, is listed
    /// only where it is the only one.
    pub readers: &'static [&'static str],
    /// Description of the messages.
    pub description: &'static str,
}

/// The topics with fixed names: all but those of targets.
pub fn all() -> Vec<Declaration> {
    let mut declarations = declarations();
    declarations.retain(|topic| !topic.name.contains(NAME));
    declarations
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn topics_of_a_target_are_in_its_namespace() {
        assert_eq!(TARGET_ODOMETRY.of("debris"), "ground_truth/debris/odom");
        assert_eq!(
            TARGET_DESCRIPTION.of("far/debris"),
            "far/ground_truth/debris/robot_description"
        );
        for (body, topic) in [
            ("debris", "ground_truth/debris/odom"),
            ("/base_link", "/ground_truth/odom"),
            ("/chaser/base_link", "/chaser/ground_truth/odom"),
            ("/chaser/debris", "/chaser/ground_truth/debris/odom"),
        ] {
            assert_eq!(TARGET_ODOMETRY.of(body), topic);
        }
    }

    #[test]
    fn names_are_declared_once() {
        let mut names: Vec<_> = declarations().iter().map(|t| t.name).collect();
        names.sort_unstable();
        let count = names.len();
        names.dedup();
        assert_eq!(names.len(), count);
    }
}
