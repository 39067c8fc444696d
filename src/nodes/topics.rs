//! The topics of the graph: name, type and quality of service, each stated once.
//!
//! Names are relative, so that namespaces work; `/clock`, `/tf` and `/tf_static` are those of all ROS.

use std::marker::PhantomData;

use crate::{
    msg::{
        Interface,
        fuyu_msgs::{ControllerState, FeatureTracks, Momentum, MotionEstimate},
        geometry_msgs::{PoseStamped, TwistStamped, Vector3Stamped},
        nav_msgs::{Odometry, Path},
        rosgraph_msgs::Clock,
        sensor_msgs::{CameraInfo, Imu, JointState, Joy},
        std_msgs::String as Text,
        tf2_msgs::TFMessage,
        visualization_msgs::MarkerArray,
    },
    ros::{Node, NodeError, Publisher, Qos, Subscription},
};

/// A topic of messages `M`.
pub struct Topic<M> {
    /// Name, relative to the node's namespace unless it begins with a slash.
    pub name: &'static str,
    /// What publishers offer and subscriptions request.
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

    /// Publishes on it.
    ///
    /// # Errors
    /// When the node cannot publish.
    pub fn advertise(&self, node: &Node) -> Result<Publisher<M>, NodeError> {
        node.advertise(self.name, self.qos)
    }

    /// Subscribes to it.
    ///
    /// # Errors
    /// When the node cannot subscribe.
    pub fn subscribe(&self, node: &Node) -> Result<Subscription<M>, NodeError> {
        node.subscribe(self.name, self.qos)
    }

    /// Subscribes to it with room for `depth` messages that wait, for who needs every one of them.
    ///
    /// # Errors
    /// When the node cannot subscribe.
    pub fn subscribe_deep(&self, node: &Node, depth: usize) -> Result<Subscription<M>, NodeError> {
        node.subscribe(self.name, self.qos.depth(depth))
    }

    /// What somebody needs who knows its type by name only.
    pub fn described(&self) -> Described {
        Described {
            name: self.name,
            type_name: M::DEFINITION.type_name(),
            qos: self.qos,
        }
    }
}

/// A topic with its type by name.
pub struct Described {
    /// Name.
    pub name: &'static str,
    /// ROS type, `pkg/msg/Name`.
    pub type_name: String,
    /// Quality of service.
    pub qos: Qos,
}

/// Simulated time.
pub const CLOCK: Topic<Clock> = Topic::new("/clock", Qos::CLOCK);
/// The robot as URDF.
pub const ROBOT_DESCRIPTION: Topic<Text> = Topic::new("robot_description", Qos::LATCHED);
/// Joint positions, rates and efforts.
pub const JOINT_STATES: Topic<JointState> = Topic::new("joint_states", Qos::RELIABLE);
/// Joint efforts to apply, or rates to drive to.
pub const JOINT_COMMANDS: Topic<JointState> = Topic::new("joint_commands", Qos::RELIABLE);
/// Frames that move.
pub const TF: Topic<TFMessage> = Topic::new("/tf", Qos::TF);
/// Frames that do not.
pub const TF_STATIC: Topic<TFMessage> = Topic::new("/tf_static", Qos::TF_STATIC);
/// True pose and twist of the base.
pub const ODOMETRY: Topic<Odometry> = Topic::new("ground_truth/odom", Qos::RELIABLE);
/// True momentum and energy.
pub const MOMENTUM: Topic<Momentum> = Topic::new("ground_truth/momentum", Qos::RELIABLE);
/// What the base's inertial measurement unit measures.
pub const IMU: Topic<Imu> = Topic::new("imu", Qos::RELIABLE);
/// Tip as the camera sees it, in the base frame.
pub const TIP_POSE: Topic<PoseStamped> = Topic::new("camera/tip_pose", Qos::RELIABLE);
/// Goal object as the camera sees it, in the base frame.
pub const SEEN_GOAL: Topic<PoseStamped> = Topic::new("camera/goal_pose", Qos::RELIABLE);
/// Second tip as the camera sees it, in the base frame.
pub const SECOND_TIP_POSE: Topic<PoseStamped> = Topic::new("camera/second/tip_pose", Qos::RELIABLE);
/// The second tip's goal as the camera sees it, in the base frame.
pub const SECOND_SEEN_GOAL: Topic<PoseStamped> =
    Topic::new("camera/second/goal_pose", Qos::RELIABLE);
/// Calibration of the camera.
pub const CAMERA_INFO: Topic<CameraInfo> = Topic::new("camera/camera_info", Qos::LATCHED);
/// Feature points of the target in the image.
pub const FEATURES: Topic<FeatureTracks> = Topic::new("camera/features", Qos::SENSOR_DATA);
/// Where the goal object is in the world.
pub const GOAL: Topic<PoseStamped> = Topic::new("goal_pose", Qos::RELIABLE);
/// The operator's joystick.
pub const JOY: Topic<Joy> = Topic::new("joy", Qos::RELIABLE);
/// Twists of the tip that an operator asks for.
pub const CMD_VEL: Topic<TwistStamped> = Topic::new("cmd_vel", Qos::RELIABLE);
/// What the controller saw, decided and sent.
pub const CONTROLLER_STATE: Topic<ControllerState> = Topic::new("controller/state", Qos::RELIABLE);
/// Angular velocity of the target.
pub const TARGET_RATE: Topic<Vector3Stamped> =
    Topic::new("estimator/angular_velocity", Qos::RELIABLE);
/// How the target tumbles.
pub const TARGET_MOTION: Topic<MotionEstimate> = Topic::new("estimator/motion", Qos::RELIABLE);
/// Attitude of the target over the time to come.
pub const PREDICTION: Topic<Path> = Topic::new("estimator/prediction", Qos::RELIABLE);

/// Things to draw, for people.
pub const MARKERS: Topic<MarkerArray> = Topic::new("markers", Qos::RELIABLE);

/// All of them but those of targets, whose names scenarios choose.
pub fn all() -> Vec<Described> {
    vec![
        CLOCK.described(),
        ROBOT_DESCRIPTION.described(),
        JOINT_STATES.described(),
        JOINT_COMMANDS.described(),
        TF.described(),
        TF_STATIC.described(),
        ODOMETRY.described(),
        MOMENTUM.described(),
        IMU.described(),
        TIP_POSE.described(),
        SEEN_GOAL.described(),
        SECOND_TIP_POSE.described(),
        SECOND_SEEN_GOAL.described(),
        CAMERA_INFO.described(),
        FEATURES.described(),
        GOAL.described(),
        JOY.described(),
        CMD_VEL.described(),
        CONTROLLER_STATE.described(),
        TARGET_RATE.described(),
        TARGET_MOTION.described(),
        PREDICTION.described(),
        MARKERS.described(),
    ]
}
