//! The world as messages.

use super::{target::Target, world::World};
use crate::{
    dynamics::Floating,
    model::{Frame, Model},
    msg::{fuyu_msgs, geometry_msgs, nav_msgs, sensor_msgs, std_msgs, tf2_msgs},
    nodes::geometry::{pose_to_msg, transform_to_msg, vector_to_msg},
    ros::Time,
    spatial::Pose,
};

/// Name of the inertial frame.
pub const WORLD: &str = "world";

/// The robot's frames, sorted by what moves them.
pub struct FrameTree {
    /// Frames that joints move, each with the frame that it hangs from.
    moving: Vec<(Frame, Frame)>,
    fixed: Vec<(Frame, Frame)>,
    base: String,
}

impl FrameTree {
    /// The frames of `model`.
    pub fn new(model: &Model) -> Self {
        let parent = |frame: &Frame| {
            frame
                .parent
                .as_deref()
                .and_then(|name| model.frame(name))
                .cloned()
        };
        let hanging = model
            .frames()
            .iter()
            .filter_map(|f| Some((f.clone(), parent(f)?)));
        let (fixed, moving) = hanging.partition(|(frame, parent)| frame.body == parent.body);
        Self {
            moving,
            fixed,
            base: model.frames()[0].name.clone(),
        }
    }

    /// Name of the base frame.
    pub fn base(&self) -> &str {
        &self.base
    }

    /// What `/tf_static` holds beside these targets.
    pub fn static_transforms(&self, targets: &[Target]) -> tf2_msgs::TFMessage {
        let robots = self.fixed.iter().map(|(frame, parent)| {
            let X_PF = parent.X_BF.inverse() * frame.X_BF;
            transform(Time::ZERO, &parent.name, &frame.name, &X_PF)
        });
        let targets = targets.iter().flat_map(|target| {
            let frames = target.fixed_frames();
            frames.map(|(name, X_TF)| transform(Time::ZERO, &target.name, &name, &X_TF))
        });
        tf2_msgs::TFMessage {
            transforms: robots.chain(targets).collect(),
        }
    }

    /// What `/tf` holds at `stamp`.
    pub fn transforms(&self, stamp: Time, world: &World) -> tf2_msgs::TFMessage {
        let workspace = world.robot.workspace();
        let mut transforms = Vec::with_capacity(1 + self.moving.len() + world.targets.len());
        let X_WB = world.robot.state().X_WB(workspace);
        transforms.push(transform(stamp, WORLD, &self.base, &X_WB));
        for (frame, parent) in &self.moving {
            let X_PF = workspace.X_BF(parent).inverse() * workspace.X_BF(frame);
            transforms.push(transform(stamp, &parent.name, &frame.name, &X_PF));
        }
        for target in &world.targets {
            let X_WT = target.body.state().X_WB(target.body.workspace());
            transforms.push(transform(stamp, WORLD, &target.name, &X_WT));
        }
        tf2_msgs::TFMessage { transforms }
    }
}

pub(super) fn header(stamp: Time, frame_id: &str) -> std_msgs::Header {
    std_msgs::Header {
        stamp: stamp.into(),
        frame_id: frame_id.to_owned(),
    }
}

fn transform(stamp: Time, parent: &str, child: &str, X: &Pose) -> geometry_msgs::TransformStamped {
    geometry_msgs::TransformStamped {
        header: header(stamp, parent),
        child_frame_id: child.to_owned(),
        transform: transform_to_msg(X),
    }
}

/// Joint positions, rates, and the mean efforts since the state before.
pub fn joint_states(stamp: Time, base: &str, world: &World) -> sensor_msgs::JointState {
    let state = world.robot.state();
    let joints = world.robot.model().joints();
    sensor_msgs::JointState {
        header: header(stamp, base),
        name: joints.iter().map(|j| j.name.clone()).collect(),
        position: state.q.as_slice().to_vec(),
        velocity: state.qd.as_slice().to_vec(),
        effort: world.mean_efforts().to_vec(),
    }
}

/// Pose in the world and twist in the body's own axes, as `nav_msgs/Odometry` wants it.
pub fn odometry(stamp: Time, child: &str, body: &Floating) -> nav_msgs::Odometry {
    let X_WB = body.state().X_WB(body.workspace());
    let V_WB_B = body.workspace().V_WB_B();
    let mut message = nav_msgs::Odometry {
        header: header(stamp, WORLD),
        child_frame_id: child.to_owned(),
        ..nav_msgs::Odometry::default()
    };
    message.pose.pose = pose_to_msg(&X_WB);
    message.twist.twist.linear = vector_to_msg(&V_WB_B.linear);
    message.twist.twist.angular = vector_to_msg(&V_WB_B.angular);
    message
}

/// Momentum and energy as the bodies carry them, world axes.
pub fn momentum(stamp: Time, robot: &Floating) -> fuyu_msgs::Momentum {
    let (model, workspace) = (robot.model(), robot.workspace());
    let carried = workspace.carried_momentum();
    let R_WB = robot.state().R_WB;
    fuyu_msgs::Momentum {
        header: header(stamp, WORLD),
        linear: vector_to_msg(&(R_WB * carried.linear)),
        angular: vector_to_msg(&(R_WB * carried.angular)),
        kinetic_energy: workspace.kinetic_energy(),
    }
}
