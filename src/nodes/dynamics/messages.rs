//! Conversion of the world's state to messages.
//!
//! Messages that are published at every state are created once and updated in place (`update_...`), so that names in
//! them are not copied for every state.

use nalgebra::{Rotation3, Translation3};

use super::{
    external_wrenches::ExternalChange, free_body::FreeBody, robot::Robot, target::Target,
    world::World,
};
use crate::{
    dynamics::{
        State,
        flexible::{FlexibleFloating, ModalBody},
    },
    model::{Frame, Model},
    msg::{fuyu_msgs, geometry_msgs, nav_msgs, sensor_msgs, std_msgs, tf2_msgs},
    nodes::geometry::{pose_to_msg, transform_to_msg, vector_to_msg},
    ros::Time,
    spatial::Pose,
};

/// Name of the inertial frame.
pub const WORLD: &str = "world";

/// The frames of the robot or of a target, divided into moving frames (`/tf`) and fixed ones (`/tf_static`).
pub struct FrameTree {
    /// Frames moved by joints, each with its parent frame.
    moving: Vec<(Frame, Frame)>,
    /// Frames fixed to their parent frames, each with its parent frame.
    fixed: Vec<(Frame, Frame)>,
    /// Attachment frames of deformable bodies.
    attachments: Vec<Attachment>,
    base: String,
}

/// Frames of a deformable body: its attachment frame, which has the body's name, and its tip frame.
struct Attachment {
    name: String,
    /// The link that carries the body, and the pose of the attachment in that link's frame.
    link: String,
    X_LA: Pose,
    /// Name of the tip frame; `None` for a body without output points.
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
        let flexible = robot.flexible();
        let bodies = flexible.map_or(&[][..], |r| r.system().modal_bodies());
        Self {
            attachments: (bodies.iter().filter(|b| b.section.is_none()))
                .map(|b| Attachment::of(model, b))
                .collect(),
            ..Self::named(model, str::to_owned)
        }
    }

    /// The frames of a target: `target` for its root link, `target/L` for any other link L.
    pub fn of_target(target: &str, model: &Model) -> Self {
        Self::named(model, |link| Self::name_in_target(target, model, link))
    }

    /// Name of the frame of a target's link.
    pub(super) fn name_in_target(target: &str, model: &Model, link: &str) -> String {
        match link == model.frames()[0].name {
            true => target.to_owned(),
            false => format!("{target}/{link}"),
        }
    }

    /// The frames of `model`, each named by applying `name` to its link's name.
    fn named(model: &Model, name: impl Fn(&str) -> String) -> Self {
        let renamed = |frame: &Frame| Frame {
            name: name(&frame.name),
            ..frame.clone()
        };
        let parent = |frame: &Frame| model.frame(frame.parent.as_deref()?).map(&renamed);
        let frames = model.frames().iter();
        let with_parents = frames.filter_map(|f| Some((renamed(f), parent(f)?)));
        let (fixed, moving) = with_parents.partition(|(frame, parent)| frame.body == parent.body);
        Self {
            moving,
            fixed,
            attachments: Vec::new(),
            base: name(&model.frames()[0].name),
        }
    }

    /// The frame called `name`; never the root frame.
    pub(super) fn find(&self, name: &str) -> Option<&Frame> {
        let all = self.moving.iter().chain(&self.fixed);
        let mut frames = all.map(|(frame, _)| frame);
        frames.find(|frame| frame.name == name)
    }

    /// Transforms of the fixed frames.
    pub(super) fn fixed_transforms(&self) -> Vec<geometry_msgs::TransformStamped> {
        let fixed = self.fixed.iter().map(|(frame, parent)| {
            let X_PF = parent.X_BF.inverse() * frame.X_BF;
            transform(&parent.name, &frame.name, &X_PF)
        });
        fixed.collect()
    }

    /// Parent and child names of the moving frames, beginning with the root frame in the world.
    fn moving_names(&self) -> impl Iterator<Item = (&str, &str)> {
        let links = self.moving.iter();
        let links = links.map(|(frame, parent)| (parent.name.as_str(), frame.name.as_str()));
        std::iter::once((WORLD, self.base.as_str())).chain(links)
    }

    /// Poses of the moving links in their parent frames, in the order of [`Self::moving_names`], without the root.
    /// `X_BF` gives the pose of a frame in the base frame.
    fn link_poses(&self, X_BF: impl Fn(&Frame) -> Pose) -> impl Iterator<Item = Pose> {
        let links = self.moving.iter();
        links.map(move |(frame, parent)| X_BF(parent).inverse() * X_BF(frame))
    }

    /// Name of the base frame.
    pub fn base(&self) -> &str {
        &self.base
    }

    /// The message on `/tf_static`.
    pub fn static_transforms(&self, targets: &[Target]) -> tf2_msgs::TFMessage {
        let targets = targets.iter().flat_map(|t| t.frames.fixed_transforms());
        let attachments = self.attachments.iter();
        let attachments = attachments.map(|a| transform(&a.link, &a.name, &a.X_LA));
        let robot = self.fixed_transforms().into_iter().chain(attachments);
        tf2_msgs::TFMessage {
            transforms: robot.chain(targets).collect(),
        }
    }

    /// The message on `/tf` at `stamp`.
    pub fn transforms(&self, stamp: Time, world: &World) -> tf2_msgs::TFMessage {
        let fixed = Pose::identity();
        let targets = world.targets.iter();
        let targets = targets.flat_map(|target| target.frames.moving_names());
        let tips = self.attachments.iter();
        let tips = tips.filter_map(|a| Some((a.name.as_str(), a.tip.as_deref()?)));
        let frames = self.moving_names().chain(tips).chain(targets);
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
        let links = self.link_poses(|frame| robot.X_BF(frame));
        let tips = robot.flexible().into_iter().flat_map(tip_poses);
        let targets = world.targets.iter().flat_map(|target| {
            let body = &target.body;
            let links = (target.frames).link_poses(|frame| body.workspace().X_BF(frame));
            std::iter::once(body.X_WB()).chain(links)
        });
        let poses = base.chain(links).chain(tips).chain(targets);
        for (transform, X) in message.transforms.iter_mut().zip(poses) {
            transform.header.stamp = stamp.into();
            transform.transform = transform_to_msg(&X);
        }
    }
}

/// Pose of each appendage's tip, or first output point, in its attachment frame. Elastic links are left out: the link's
/// own frame is at the tip.
fn tip_poses(robot: &FlexibleFloating) -> impl Iterator<Item = Pose> + '_ {
    let appendages = robot.system().modal_bodies().iter();
    let appendages = appendages.filter(|body| body.section.is_none());
    appendages.filter_map(|body| {
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

/// A transform with a zero stamp.
fn transform(parent: &str, child: &str, X: &Pose) -> geometry_msgs::TransformStamped {
    geometry_msgs::TransformStamped {
        header: header(Time::ZERO, parent),
        child_frame_id: child.to_owned(),
        transform: transform_to_msg(X),
    }
}

/// Joint positions, joint rates, and the mean joint efforts between the last two states.
pub fn joint_states(stamp: Time, base: &str, world: &World) -> sensor_msgs::JointState {
    let mut message = joint_state_message(world.robot.model(), base);
    update_joint_states(&mut message, stamp, world);
    message
}

/// Joint positions and rates of a target. Its joints have no drives: efforts are zero.
pub fn target_joint_states(stamp: Time, target: &Target) -> sensor_msgs::JointState {
    let mut message = joint_state_message(target.body.model(), &target.name);
    update_target_joint_states(&mut message, stamp, target);
    message
}

/// Updates a message of [`target_joint_states`].
pub(super) fn update_target_joint_states(
    message: &mut sensor_msgs::JointState,
    stamp: Time,
    target: &Target,
) {
    update_joint_motion(message, stamp, target.body.state());
}

/// Template of a joint states message for a model with the root frame `base`.
fn joint_state_message(model: &Model, base: &str) -> sensor_msgs::JointState {
    let zeros = vec![0.0; model.dof()];
    sensor_msgs::JointState {
        header: header(Time::ZERO, base),
        name: model.joints().iter().map(|j| j.name.clone()).collect(),
        position: zeros.clone(),
        velocity: zeros.clone(),
        effort: zeros,
    }
}

fn update_joint_motion(message: &mut sensor_msgs::JointState, stamp: Time, state: &State) {
    message.header.stamp = stamp.into();
    message.position.copy_from_slice(state.q.as_slice());
    message.velocity.copy_from_slice(state.qd.as_slice());
}

/// Updates a message of [`joint_states`].
pub(super) fn update_joint_states(
    message: &mut sensor_msgs::JointState,
    stamp: Time,
    world: &World,
) {
    update_joint_motion(message, stamp, world.robot.state());
    message.effort.copy_from_slice(world.mean_efforts());
}

/// Pose in the world, and twist in the body's own axes as `nav_msgs/Odometry` defines it.
pub fn odometry(stamp: Time, child: &str, body: &impl FreeBody) -> nav_msgs::Odometry {
    let mut message = odometry_message(child);
    update_odometry(&mut message, stamp, body);
    message
}

/// Template of an odometry message for the frame `child`.
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
pub fn momentum(stamp: Time, body: &impl FreeBody) -> fuyu_msgs::Momentum {
    let mut message = momentum_message();
    update_momentum(&mut message, stamp, body);
    message
}

/// Template of a momentum message.
pub(super) fn momentum_message() -> fuyu_msgs::Momentum {
    fuyu_msgs::Momentum {
        header: header(Time::ZERO, WORLD),
        ..fuyu_msgs::Momentum::default()
    }
}

/// Updates a message of [`momentum_message`].
pub(super) fn update_momentum(
    message: &mut fuyu_msgs::Momentum,
    stamp: Time,
    body: &impl FreeBody,
) {
    let carried = body.carried_momentum();
    message.header.stamp = stamp.into();
    message.linear = vector_to_msg(&carried.linear);
    message.angular = vector_to_msg(&carried.angular);
    message.kinetic_energy = body.kinetic_energy();
    message.dissipated_energy = body.state().dissipated.total() + body.lost_energy();
}

/// External impulse and work on the robot since the start.
pub fn external_impulse(stamp: Time, change: &ExternalChange) -> fuyu_msgs::ExternalImpulse {
    let mut message = external_impulse_message();
    update_external_impulse(&mut message, stamp, change);
    message
}

/// Template of an external impulse message.
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
