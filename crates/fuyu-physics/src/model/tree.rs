//! The compiled model: bodies, joints, frames.

use std::any::Any;
use std::sync::{Arc, OnceLock};

use nalgebra::{Unit, Vector3};

use super::coupling::Couplings;
use crate::spatial::{Pose, RigidInertia, SpatialInertia};

/// How a joint moves along its axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JointKind {
    /// Rotation about the axis, within limits.
    Revolute,
    /// Rotation about the axis, without limits.
    Continuous,
    /// Translation along the axis.
    Prismatic,
}

impl JointKind {
    /// Whether the joint's coordinate is an angle.
    pub fn is_rotational(self) -> bool {
        self != Self::Prismatic
    }
}

/// Limits of the joint and its actuator; infinite where the description gives none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointLimits {
    /// Lowest position \[rad or m\].
    pub lower: f64,
    /// Highest position \[rad or m\].
    pub upper: f64,
    /// Largest speed \[rad/s or m/s\].
    pub velocity: f64,
    /// Largest effort \[N m or N\].
    pub effort: f64,
}

impl JointLimits {
    /// No limits.
    pub const NONE: Self = Self {
        lower: f64::NEG_INFINITY,
        upper: f64::INFINITY,
        velocity: f64::INFINITY,
        effort: f64::INFINITY,
    };
}

/// A joint with one degree of freedom between a body and its parent.
#[derive(Debug, Clone, PartialEq)]
pub struct Joint {
    /// Name in the robot description.
    pub name: String,
    /// Type of motion.
    pub kind: JointKind,
    /// Axis in the moved body's frame. It has the same components in the joint frame.
    pub axis: Unit<Vector3<f64>>,
    /// Pose of the joint frame J in the parent body's frame P; the moved body's frame coincides with J
    /// at position zero.
    pub X_PJ: Pose,
    /// Limits.
    pub limits: JointLimits,
    /// Viscous damping \[N m s/rad or N s/m\]: `c_i` of Masutani 1995 eq. (4.50).
    pub damping: f64,
    /// Coulomb friction \[N m or N\].
    pub friction: f64,
    /// Spring in parallel with the actuator.
    pub spring: Spring,
}

impl Joint {
    /// Effort \[N m or N\] of spring and damper at position `q` and rate `qd`: TR-942 eq. (2.2.20).
    #[inline]
    pub fn passive_effort(&self, q: f64, qd: f64) -> f64 {
        self.spring.stiffness * (self.spring.rest - q) - self.damping * qd
    }
}

/// A linear spring that pulls a joint towards a position.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Spring {
    /// Effort per displacement \[N m/rad or N/m\]; zero means no spring.
    pub stiffness: f64,
    /// Rest position, at which the spring exerts no effort \[rad or m\].
    pub rest: f64,
}

/// One rigid body: a moved link, with all links that fixed joints weld to it.
#[derive(Debug, Clone, PartialEq)]
pub struct Body {
    /// Name of the moved link (the root link for body 0).
    pub name: String,
    /// Index of the parent body; `None` for the base.
    pub parent: Option<usize>,
    /// One past the last body of this body's subtree: the subtree is `index..subtree_end`.
    pub subtree_end: usize,
    /// Mass properties in the body frame.
    pub inertia: RigidInertia,
    /// Mass properties about the body frame's origin.
    pub spatial_inertia: SpatialInertia,
}

/// A named frame fixed to a body: every link of the robot description is one.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// Name of the link.
    pub name: String,
    /// Index of the body to which the frame is fixed.
    pub body: usize,
    /// Name of the frame's parent link; `None` for the root.
    pub parent: Option<String>,
    /// Pose of the frame F in its body's frame B.
    pub X_BF: Pose,
}

/// An immutable robot: a tree of rigid bodies on a free-floating base. Clones share one copy, so cloning is
/// cheap.
#[derive(Debug, Clone)]
pub struct Model {
    shared: Arc<Shared>,
}

#[derive(Debug)]
struct Shared {
    parts: Parts,
    /// See [`Model::compiled`].
    compiled: OnceLock<Arc<dyn Any + Send + Sync>>,
}

/// Parts of a robot.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Parts {
    pub(super) name: String,
    pub(super) bodies: Vec<Body>,
    /// The joints with a coordinate.
    pub(super) joints: Vec<Joint>,
    pub(super) frames: Vec<Frame>,
    /// All joints of the tree, if there are mimic joints.
    pub(super) couplings: Option<Couplings>,
}

impl PartialEq for Model {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.shared, &other.shared) || self.shared.parts == other.shared.parts
    }
}

impl From<Parts> for Model {
    fn from(parts: Parts) -> Self {
        let compiled = OnceLock::new();
        Self {
            shared: Arc::new(Shared { parts, compiled }),
        }
    }
}

impl Model {
    /// The form into which a higher layer compiles the model: computed at the first call, then shared by all clones.
    ///
    /// # Panics
    /// If two layers request different types.
    pub(crate) fn compiled<T: Any + Send + Sync>(
        &self,
        compile: impl FnOnce(&Self) -> T,
    ) -> Arc<T> {
        let compiled = (self.shared.compiled).get_or_init(|| Arc::new(compile(self)));
        let Ok(compiled) = Arc::clone(compiled).downcast() else {
            panic!("a model has one compiled form");
        };
        compiled
    }

    /// The robot's name.
    pub fn name(&self) -> &str {
        &self.shared.parts.name
    }

    pub(super) fn parts(&self) -> &Parts {
        &self.shared.parts
    }

    /// Number of coordinates `n`: moving joints without the mimic joints.
    pub fn dof(&self) -> usize {
        self.shared.parts.joints.len()
    }

    /// All bodies, base first; body `k + 1` is moved by [`Model::tree_joint`] `k`, which is joint `k` of [`Model::joints`]
    /// unless the robot has mimic joints.
    pub fn bodies(&self) -> &[Body] {
        &self.shared.parts.bodies
    }

    /// The joints that move independently; their order is that of every joint vector. Their springs, dampers, friction
    /// and limits include those of the mimic joints that follow them ([`Model::mimics`]).
    pub fn joints(&self) -> &[Joint] {
        &self.shared.parts.joints
    }

    /// All named frames, one per link of the description.
    pub fn frames(&self) -> &[Frame] {
        &self.shared.parts.frames
    }

    /// The same robot with other effort limits: `limit` gives the limit of each joint \[N m or N\].
    #[must_use]
    pub fn with_effort_limits(&self, limit: impl Fn(usize, &Joint) -> f64) -> Self {
        let mut parts = self.shared.parts.clone();
        for (j, joint) in parts.joints.iter_mut().enumerate() {
            joint.limits.effort = limit(j, joint);
        }
        parts.into()
    }

    /// The same robot with another inertia of body `b`.
    #[must_use]
    pub(crate) fn with_body_inertia(&self, b: usize, inertia: RigidInertia) -> Self {
        let mut parts = self.shared.parts.clone();
        parts.bodies[b].inertia = inertia;
        parts.bodies[b].spatial_inertia = SpatialInertia::from(&inertia);
        parts.into()
    }

    /// The frame of the link called `name`.
    pub fn frame(&self, name: &str) -> Option<&Frame> {
        self.shared.parts.frames.iter().find(|f| f.name == name)
    }

    /// Index of the joint called `name` in every joint vector.
    pub fn joint_index(&self, name: &str) -> Option<usize> {
        self.shared.parts.joints.iter().position(|j| j.name == name)
    }

    /// The parent body of the body that joint `j` moves.
    pub fn joint_parent(&self, j: usize) -> usize {
        self.tree_parent(self.joint_body(j) - 1)
    }

    /// The parent body of body `k + 1`, which joint `k` of the tree moves.
    ///
    /// # Panics
    /// If there is no such joint.
    pub fn tree_parent(&self, k: usize) -> usize {
        self.shared.parts.bodies[k + 1]
            .parent
            .expect("only the base has no parent")
    }

    /// Mass of all bodies together, `m_C` of Masutani 1995 eq. (4.9) \[kg\].
    pub fn total_mass(&self) -> f64 {
        self.shared
            .parts
            .bodies
            .iter()
            .map(|b| b.inertia.mass)
            .sum()
    }
}
