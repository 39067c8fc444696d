//! Building a [`Model`] body by body.

use nalgebra::{Unit, Vector3};

use super::coupling::{Follow, couple};
use super::tree::Parts;
use super::{Body, Frame, Joint, JointKind, JointLimits, Model, Spring};
use crate::spatial::{Pose, RigidInertia, SpatialInertia};

/// Builds a tree body by body, depth first: a body's parent is the body added last or one of that body's ancestors.
///
/// ```
/// use fuyu_physics::model::{JointKind, ModelBuilder};
/// use fuyu_physics::spatial::{Pose, RigidInertia};
/// use nalgebra::{Matrix3, Vector3};
///
/// let ball = RigidInertia { mass: 1.0, com: Vector3::zeros(), about_com: Matrix3::identity() };
/// let mut robot = ModelBuilder::new("pair", "base", ball);
/// robot.body("arm", 0, JointKind::Continuous, Vector3::z_axis(), Pose::identity(), ball);
/// let model = robot.build();
/// assert_eq!(model.dof(), 1);
/// ```
pub struct ModelBuilder {
    /// Parts of the model, with all joints of the tree as independent joints.
    parts: Parts,
    follows: Vec<Follow>,
}

impl ModelBuilder {
    /// Starts with the base.
    pub fn new(name: &str, base: &str, inertia: RigidInertia) -> Self {
        let parts = Parts {
            name: name.to_owned(),
            bodies: Vec::new(),
            joints: Vec::new(),
            frames: Vec::new(),
            couplings: None,
        };
        let follows = Vec::new();
        let mut builder = Self { parts, follows };
        builder.push_body(base, None, None, inertia);
        builder
    }

    fn push_body(
        &mut self,
        name: &str,
        parent: Option<usize>,
        parent_link: Option<&str>,
        inertia: RigidInertia,
    ) -> usize {
        let index = self.parts.bodies.len();
        self.parts.bodies.push(Body {
            name: name.to_owned(),
            parent,
            subtree_end: index + 1,
            inertia,
            spatial_inertia: SpatialInertia::from(&inertia),
        });
        let parent_link = parent_link.map(str::to_owned);
        self.frame(name, index, parent_link, Pose::identity());
        index
    }

    /// Adds a body named `name` moved by the joint `joint_<name>` without limits, damping or friction;
    /// returns its index. [`ModelBuilder::joint`] takes a whole [`Joint`].
    ///
    /// # Panics
    /// If `parent` is not on the path from the base to the body added last.
    pub fn body(
        &mut self,
        name: &str,
        parent: usize,
        kind: JointKind,
        axis: Unit<Vector3<f64>>,
        X_PJ: Pose,
        inertia: RigidInertia,
    ) -> usize {
        let joint = Joint {
            name: format!("joint_{name}"),
            kind,
            axis,
            X_PJ,
            limits: JointLimits::NONE,
            damping: 0.0,
            friction: 0.0,
            spring: Spring::default(),
        };
        self.joint(name, parent, joint, inertia)
    }

    /// Adds a body named `name` moved by `joint`; returns its index.
    ///
    /// # Panics
    /// If `parent` is not on the path from the base to the body added last.
    pub fn joint(
        &mut self,
        name: &str,
        parent: usize,
        joint: Joint,
        inertia: RigidInertia,
    ) -> usize {
        let parent_link = self.parts.bodies[parent].name.clone();
        self.joint_on_link(name, parent, &parent_link, joint, inertia)
    }

    /// [`ModelBuilder::joint`] for a joint whose parent link is `parent_link`, fixed to body `parent`.
    pub(super) fn joint_on_link(
        &mut self,
        name: &str,
        parent: usize,
        parent_link: &str,
        joint: Joint,
        inertia: RigidInertia,
    ) -> usize {
        let last = self.parts.bodies.len() - 1;
        let mut ancestors = std::iter::successors(Some(last), |&b| self.parts.bodies[b].parent);
        assert!(
            ancestors.any(|b| b == parent),
            "bodies must be added depth first: {parent} is no ancestor of {last}"
        );
        self.parts.joints.push(joint);
        let index = self.push_body(name, Some(parent), Some(parent_link), inertia);
        let mut above = Some(parent);
        while let Some(b) = above {
            self.parts.bodies[b].subtree_end = index + 1;
            above = self.parts.bodies[b].parent;
        }
        index
    }

    /// Makes the joint that moves body `follower` a mimic joint: its position is `ratio` times that of the joint that moves
    /// body `leader`, plus `offset` \[rad or m\]. A leader may itself follow another joint.
    ///
    /// # Panics
    /// If one of the bodies does not exist or is the base, or if the follower already follows a joint.
    pub fn mimic(&mut self, follower: usize, leader: usize, ratio: f64, offset: f64) {
        let count = self.parts.joints.len();
        let joint = |body: usize| body.checked_sub(1).filter(|k| *k < count);
        let (Some(follower), Some(leader)) = (joint(follower), joint(leader)) else {
            panic!("bodies {follower} and {leader} must be moved by joints");
        };
        let mut others = self.follows.iter();
        assert!(
            others.all(|other| other.follower != follower),
            "joint `{}` already follows another",
            self.parts.joints[follower].name
        );
        self.follows.push(Follow {
            follower,
            leader,
            ratio,
            offset,
        });
    }

    /// Adds a named frame, fixed to body `body` with pose `X_BF`; `parent` is the name of the frame's parent link.
    pub fn frame(&mut self, name: &str, body: usize, parent: Option<String>, X_BF: Pose) {
        self.parts.frames.push(Frame {
            name: name.to_owned(),
            body,
            parent,
            X_BF,
        });
    }

    /// Welds `inertia` (in body `body`'s frame) to body `body`.
    pub fn weld(&mut self, body: usize, inertia: &RigidInertia) {
        let b = &mut self.parts.bodies[body];
        b.inertia = b.inertia.merged_with(inertia);
        b.spatial_inertia = SpatialInertia::from(&b.inertia);
    }

    /// The model.
    ///
    /// # Panics
    /// If a joint follows itself, directly or through other joints.
    pub fn build(self) -> Model {
        let Self { mut parts, follows } = self;
        (parts.joints, parts.couplings) = couple(parts.joints, &follows);
        parts.into()
    }
}
