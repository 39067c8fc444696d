//! The world as messages.
//!
//! Messages that are published at every state are made once and updated in place (`update_...`), so that the names in
//! them are not copied again.

use nalgebra::{Rotation3, Translation3};

use super::{
    external_wrenches::ExternalChange, free_body::FreeBody, robot::Robot, target::Target,
    world::World,
};
use crate::{
    dynamics::flexible::{FlexibleFloating, ModalBody},
    model::{Frame, Model},
    msg::{fuyu_msgs, geometry_msgs, nav_msgs, sensor_msgs, std_msgs, tf2_msgs},
    nodes::geometry::{pose_to_msg, transform_to_msg, vector_to_msg},
    ros::Time,
    spatial::Pose,
};

/// Name of the inertial frame.
pub const WORLD: &str = "world";

/// The robot's frames: those that joints move and those fixed to another frame.
pub struct FrameTree {
    /// Frames that joints move, each with its parent frame.
    moving: Vec<(Frame, Frame)>,
    /// Frames that do not move in their parent frame, each with it.
    fixed: Vec<(Frame, Frame)>,
    /// Attachments of deformable bodies.
    attachments: Vec<Attachment>,
    base: String,
}

/// Frames of a deformable body: that of its attachment, with the body's name, and that of its tip.
struct Attachment {
    name: String,
    /// The link that carries it, and the pose of the attachment in that link's frame.
    link: String,
    X_LA: Pose,
    /// Name of the tip's frame; `None` for a body without output points.
    tip: Option<String>,
}

impl Attachment {
    fn of(model: &Model, body: &ModalBody) -> Self {
        let name = body.name().to_owned();
        Self {
            link: model.bodies()[body.body].name.clone(),
            X_LA: body.X_BA,
            tip: (!body.appendage.outputs.is_empty()).then(|| format!("{name}/tip")),
            name,
        }
    }
}

impl FrameTree {
    /// The frames of `robot`.
    pub fn new(robot: &Robot) -> Self {
        let model = robot.model();
        let bodies = robot
            .flexible()
            .map_or(&[][..], |r| r.system().modal_bodies());
        let parent = |frame: &Frame| {
            frame
                .parent
                .as_deref()
                .and_then(|name| model.frame(name))
                .cloned()
        };
        let with_parents = model
            .frames()
            .iter()
            .filter_map(|f| Some((f.clone(), parent(f)?)));
        let (fixed, moving) = with_parents.partition(|(frame, parent)| frame.body == parent.body);
        Self {
            moving,
            fixed,
            attachments: bodies.iter().map(|b| Attachment::of(model, b)).collect(),
            base: model.frames()[0].name.clone(),
        }
    }

    /// Name of the base frame.
    pub fn base(&self) -> &str {
        &self.base
    }

    /// The message on `/tf_static`.
    pub fn static_transforms(&self, targets: &[Target]) -> tf2_msgs::TFMessage {
        let robots = self.fixed.iter().map(|(frame, parent)| {
            let X_PF = parent.X_BF.inverse() * frame.X_BF;
            transform(&parent.name, &frame.name, &X_PF)
        });
        let targets = targets.iter().flat_map(|target| {
            let frames = target.fixed_frames();
            frames.map(|(name, X_TF)| transform(&target.name, &name, &X_TF))
        });
        let attachments = self.attachments.iter();
        let attachments = attachments.map(|a| transform(&a.link, &a.name, &a.X_LA));
        tf2_msgs::TFMessage {
            transforms: robots.chain(attachments).chain(targets).collect(),
        }
    }

    /// The message on `/tf` at `stamp`.
    pub fn transforms(&self, stamp: Time, world: &World) -> tf2_msgs::TFMessage {
        let fixed = Pose::identity();
        let base = std::iter::once((WORLD, self.base.as_str()));
        let links = self.moving.iter();
        let links = links.map(|(frame, parent)| (parent.name.as_str(), frame.name.as_str()));
        let targets = world.targets.iter().map(|t| (WORLD, t.name.as_str()));
        let tips = self.attachments.iter();
        let tips = tips.filter_map(|a| Some((a.name.as_str(), a.tip.as_deref()?)));
        let frames = base.chain(links).chain(tips).chain(targets);
        let mut message = tf2_msgs::TFMessage {
            transforms: frames
                .map(|(parent, child)| transform(parent, child, &fixed))
                .collect(),
        };
        self.update_transforms(&mut message, stamp, world);
        message
    }

    /// Updates a message of [`Self::transforms`] for a world with the same targets.
    pub fn update_transforms(&self, message: &mut tf2_msgs::TFMessage, stamp: Time, world: &World) {
        let robot = &world.robot;
        let base = std::iter::once(robot.X_WB());
        let links = self.moving.iter();
        let links = links.map(|(frame, parent)| robot.X_BF(parent).inverse() * robot.X_BF(frame));
        let targets = world.targets.iter().map(|target| target.body.X_WB());
        let tips = robot.flexible().into_iter().flat_map(tip_poses);
        let poses = base.chain(links).chain(tips).chain(targets);
        for (transform, X) in message.transforms.iter_mut().zip(poses) {
            transform.header.stamp = stamp.into();
            transform.transform = transform_to_msg(&X);
        }
    }
}

/// Pose of each deformable body's tip, or first output point, in the frame of its attachment.
fn tip_poses(robot: &FlexibleFloating) -> impl Iterator<Item = Pose> + '_ {
    robot.system().modal_bodies().iter().filter_map(|body| {
        let tip = body.appendage.outputs.first()?;
        let mu = &robot.state().mu()[body.range()];
        let position = Translation3::from(tip.position + tip.displacement(mu));
        let rotation = Rotation3::from_scaled_axis(tip.rotation(mu));
        Some(Pose::from_parts(position, rotation))
    })
}

/// A header.
pub(super) fn header(stamp: Time, frame_id: &str) -> std_msgs::Header {
    std_msgs::Header {
        stamp: stamp.into(),
        frame_id: frame_id.to_owned(),
    }
}

/// A transform with the stamp zero.
fn transform(parent: &str, child: &str, X: &Pose) -> geometry_msgs::TransformStamped {
    geometry_msgs::TransformStamped {
        header: header(Time::ZERO, parent),
        child_frame_id: child.to_owned(),
        transform: transform_to_msg(X),
    }
}

/// Joint positions, joint rates, and the mean joint efforts between the last two states.
pub fn joint_states(stamp: Time, base: &str, world: &World) -> sensor_msgs::JointState {
    let joints = world.robot.model().joints();
    let zeros = vec![0.0; joints.len()];
    let mut message = sensor_msgs::JointState {
        header: header(stamp, base),
        name: joints.iter().map(|j| j.name.clone()).collect(),
        position: zeros.clone(),
        velocity: zeros.clone(),
        effort: zeros,
    };
    update_joint_states(&mut message, stamp, world);
    message
}

/// Updates a message of [`joint_states`].
pub(super) fn update_joint_states(
    message: &mut sensor_msgs::JointState,
    stamp: Time,
    world: &World,
) {
    let state = world.robot.state();
    message.header.stamp = stamp.into();
    message.position.copy_from_slice(state.q.as_slice());
    message.velocity.copy_from_slice(state.qd.as_slice());
    message.effort.copy_from_slice(world.mean_efforts());
}

/// Pose in the world, and twist in the body's own axes as `nav_msgs/Odometry` defines it.
pub fn odometry(stamp: Time, child: &str, body: &impl FreeBody) -> nav_msgs::Odometry {
    let mut message = odometry_message(child);
    update_odometry(&mut message, stamp, body);
    message
}

/// An odometry message of the frame `child`, to be updated.
pub(super) fn odometry_message(child: &str) -> nav_msgs::Odometry {
    nav_msgs::Odometry {
        header: header(Time::ZERO, WORLD),
        child_frame_id: child.to_owned(),
        ..nav_msgs::Odometry::default()
    }
}

/// Updates a message of [`odometry_message`].
pub(super) fn update_odometry(message: &mut nav_msgs::Odometry, stamp: Time, body: &impl FreeBody) {
    let V_WB_B = body.V_WB_B();
    message.header.stamp = stamp.into();
    message.pose.pose = pose_to_msg(&body.X_WB());
    message.twist.twist.linear = vector_to_msg(&V_WB_B.linear);
    message.twist.twist.angular = vector_to_msg(&V_WB_B.angular);
}

/// Momentum and kinetic energy, summed over the bodies, in world axes.
pub fn momentum(stamp: Time, robot: &Robot) -> fuyu_msgs::Momentum {
    let mut message = momentum_message();
    update_momentum(&mut message, stamp, robot);
    message
}

/// A momentum message, to be updated.
pub(super) fn momentum_message() -> fuyu_msgs::Momentum {
    fuyu_msgs::Momentum {
        header: header(Time::ZERO, WORLD),
        ..fuyu_msgs::Momentum::default()
    }
}

/// Updates a message of [`momentum_message`].
pub(super) fn update_momentum(message: &mut fuyu_msgs::Momentum, stamp: Time, robot: &Robot) {
    let carried = robot.carried_momentum();
    message.header.stamp = stamp.into();
    message.linear = vector_to_msg(&carried.linear);
    message.angular = vector_to_msg(&carried.angular);
    message.kinetic_energy = robot.kinetic_energy();
    message.dissipated_energy = robot.state().dissipated.total() + robot.lost_energy();
}

/// A message of what external wrenches have changed, to be updated.
pub(super) fn external_impulse_message() -> fuyu_msgs::ExternalImpulse {
    fuyu_msgs::ExternalImpulse {
        header: header(Time::ZERO, WORLD),
        ..fuyu_msgs::ExternalImpulse::default()
    }
}

/// Updates a message of [`external_impulse_message`].
pub(super) fn update_external_impulse(
    message: &mut fuyu_msgs::ExternalImpulse,
    stamp: Time,
    change: &ExternalChange,
) {
    message.header.stamp = stamp.into();
    message.linear = vector_to_msg(&change.momentum_W.linear);
    message.angular = vector_to_msg(&change.momentum_W.angular);
    message.work = change.work;
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nodes::scenario::Scenario;

    fn world() -> World {
        let scenario = Scenario::read("package://fuyu/config/servicing.yaml").unwrap();
        let mut world = World::new(&scenario.dynamics().unwrap()).unwrap();
        world.hold_efforts([(0, 5.0), (2, -1.0)]);
        world.step_to_tick();
        world
    }

    #[test]
    fn updated_messages_equal_new_ones() {
        let mut world = world();
        let frames = FrameTree::new(&world.robot);
        let body = frames.base().to_owned();
        let of = |stamp: Time, world: &World| {
            (
                joint_states(stamp, &body, world),
                odometry(stamp, &body, &world.robot),
                momentum(stamp, &world.robot),
                frames.transforms(stamp, world),
            )
        };
        let mut updated = of(Time::ZERO, &world);
        world.step_to_tick();
        let stamp = Time::from_secs_f64(world.time());
        update_joint_states(&mut updated.0, stamp, &world);
        update_odometry(&mut updated.1, stamp, &world.robot);
        update_momentum(&mut updated.2, stamp, &world.robot);
        frames.update_transforms(&mut updated.3, stamp, &world);
        assert!(updated == of(stamp, &world));
    }

    // Would break if names were copied for every state.
    #[test]
    fn updates_do_not_allocate() {
        let world = world();
        let frames = FrameTree::new(&world.robot);
        let stamp = Time::from_secs_f64(world.time());
        let mut joints = joint_states(stamp, frames.base(), &world);
        let mut base = odometry(stamp, frames.base(), &world.robot);
        let mut carried = momentum(stamp, &world.robot);
        let mut tf = frames.transforms(stamp, &world);
        let used = allocation_counter::measure(|| {
            update_joint_states(&mut joints, stamp, &world);
            update_odometry(&mut base, stamp, &world.robot);
            update_momentum(&mut carried, stamp, &world.robot);
            frames.update_transforms(&mut tf, stamp, &world);
        });
        assert_eq!(used.count_total, 0);
    }
}
