//! Models made from other models: two robots joined by a joint, and a robot with some of its joints locked.

use nalgebra::{Rotation3, Translation3, Unit, Vector3};

use super::{Joint, JointKind, JointLimits, Model, ModelBuilder, Spring};
use crate::spatial::{Pose, RigidInertia};

/// How [`Model::joined`] connects the second model's base.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Connection {
    /// By a fixed joint.
    Weld,
    /// By three revolute joints whose axes intersect, the first about z, then y, then x. They are a spherical joint
    /// unless the second one is at ±90°.
    Cardan,
}

/// Axes of [`Connection::Cardan`], the one next to the first model first.
const CARDAN: [(&str, usize); 3] = [("z", 2), ("y", 1), ("x", 0)];

/// Two models joined to one ([`Model::joined`]), with maps of their coordinates.
#[derive(Debug, Clone)]
pub struct Joined {
    /// The joined model.
    pub model: Model,
    /// Coordinate of the joined model for each coordinate of the first.
    pub first: Vec<usize>,
    /// Coordinate of the joined model for each coordinate of the second.
    pub second: Vec<usize>,
    /// Coordinates of the connection: none, or three.
    pub connection: Vec<usize>,
}

/// Destination of a copied body: body `body` of the copy, or part of it at pose `X_BO` of the original's frame.
#[derive(Clone, Copy)]
struct Place {
    body: usize,
    X_BO: Pose,
    /// Whether the copied body is the whole destination body, which then has its name.
    is_own: bool,
}

impl Place {
    fn own(body: usize) -> Self {
        Self {
            body,
            X_BO: Pose::identity(),
            is_own: true,
        }
    }

    fn part(body: usize, X_BO: Pose) -> Self {
        Self {
            body,
            X_BO,
            is_own: false,
        }
    }
}

/// Copies the bodies of models, one by one, to a new model.
struct Copier {
    builder: ModelBuilder,
}

impl Copier {
    /// Begins with the base of `model`.
    fn new(model: &Model) -> Self {
        let base = &model.bodies()[0];
        Self {
            builder: ModelBuilder::new(model.name(), &base.name, base.inertia),
        }
    }

    /// Copies body `b` of `model`, whose parent is at `parent`.
    fn copy(&mut self, model: &Model, b: usize, parent: Place, prefix: &str) -> Place {
        let body = &model.bodies()[b];
        let mut joint = model.tree_joint(b - 1).clone();
        joint.name.insert_str(0, prefix);
        joint.X_PJ = parent.X_BO * joint.X_PJ;
        let link = parent_link(model, b, prefix);
        let name = format!("{prefix}{}", body.name);
        Place::own((self.builder).joint_on_link(&name, parent.body, &link, joint, body.inertia))
    }

    /// Adds three joints with intersecting axes on `body`; returns the place after them of a body at pose `X_JO` in
    /// their common frame.
    fn cardan(
        &mut self,
        body: usize,
        mount: &str,
        X_BJ: &Pose,
        X_JO: &Pose,
        prefix: &str,
    ) -> Place {
        let (mut parent, mut link, mut X_PJ) = (body, mount.to_owned(), *X_BJ);
        for (axis, i) in CARDAN {
            let joint = free_joint(format!("{prefix}grasp_{axis}"), Vector3::ith_axis(i), X_PJ);
            let name = format!("{prefix}grasp_{axis}_link");
            parent =
                (self.builder).joint_on_link(&name, parent, &link, joint, RigidInertia::zero());
            (link, X_PJ) = (name, Pose::identity());
        }
        Place::part(parent, *X_JO)
    }

    /// Welds body `b` of `model` at `place`.
    fn weld(&mut self, model: &Model, b: usize, place: Place) {
        let inertia = model.bodies()[b].inertia.expressed_in(&place.X_BO);
        self.builder.weld(place.body, &inertia);
    }

    /// Adds the remaining frames of `model`, and its mimic joints, after its bodies have been copied to `places`. The
    /// base is on the link `mount`, if that is given.
    fn finish(&mut self, model: &Model, places: &[Place], prefix: &str, mount: Option<&str>) {
        for frame in model.frames() {
            let place = places[frame.body];
            if place.is_own && frame.name == model.bodies()[frame.body].name {
                continue;
            }
            let parent = frame
                .parent
                .as_ref()
                .map(|parent| format!("{prefix}{parent}"));
            let parent = parent.or_else(|| mount.map(str::to_owned));
            let name = format!("{prefix}{}", frame.name);
            (self.builder).frame(&name, place.body, parent, place.X_BO * frame.X_BF);
        }
        for mimic in model.mimics() {
            let coupling = &mimic.coupling;
            let (follower, leader) = (
                places[mimic.body],
                places[model.joint_body(coupling.coordinate)],
            );
            if follower.is_own && leader.is_own {
                (self.builder).mimic(follower.body, leader.body, coupling.ratio, coupling.offset);
            }
        }
    }
}
/// Link on which the joint that moves body `b` is mounted.
fn parent_link(model: &Model, b: usize, prefix: &str) -> String {
    let name = &model.bodies()[b].name;
    let frame = model
        .frames()
        .iter()
        .find(|f| f.body == b && f.name == *name);
    let parent = frame.and_then(|f| f.parent.as_deref());
    format!("{prefix}{}", parent.unwrap_or_default())
}

/// Coordinates of `whole` that belong to the joints of `part`, by name.
fn coordinates(whole: &Model, part: &Model, prefix: &str) -> Vec<usize> {
    let index = |joint: &Joint| whole.joint_index(&format!("{prefix}{}", joint.name));
    part.joints().iter().filter_map(index).collect()
}

impl Model {
    /// This robot with the base of `other` connected to its body `body`, at pose `X_BO` of the other's base frame. All
    /// names of `other` get `prefix`, which must make them different from this robot's. With [`Connection::Cardan`],
    /// the axes intersect at the origin of frame J, at pose `X_BJ` in the body; the axes of J are those of the joints
    /// at zero positions, at which the other's base is at `X_BO`.
    ///
    /// # Panics
    /// If there is no such body, or if a name occurs twice.
    pub fn joined(
        &self,
        body: usize,
        other: &Self,
        connection: Connection,
        X_BJ: &Pose,
        X_BO: &Pose,
        prefix: &str,
    ) -> Joined {
        for link in other.frames() {
            let name = format!("{prefix}{}", link.name);
            assert!(
                self.frame(&name).is_none(),
                "both models have a link `{name}`"
            );
        }
        let bodies = self.bodies();
        let mount = &bodies[body].name;
        let mut copier = Copier::new(self);
        let mut places = vec![Place::own(0); bodies.len()];
        let mut others = Vec::new();
        for b in 0..bodies.len() {
            if b > 0 {
                places[b] = copier.copy(self, b, places[self.tree_parent(b - 1)], "");
            }
            if b + 1 != bodies[body].subtree_end {
                continue;
            }
            // All bodies and frames that this robot has on `body` are copied: the other robot comes next.
            let place = places[body];
            others.push(match connection {
                Connection::Weld => Place::part(place.body, *X_BO),
                Connection::Cardan => {
                    copier.cardan(place.body, mount, X_BJ, &(X_BJ.inverse() * X_BO), prefix)
                }
            });
            copier.weld(other, 0, others[0]);
            for o in 1..other.bodies().len() {
                let parent = others[other.tree_parent(o - 1)];
                others.push(copier.copy(other, o, parent, prefix));
            }
        }
        copier.finish(self, &places, "", None);
        copier.finish(other, &others, prefix, Some(mount));
        let model = copier.builder.build();
        let axes = CARDAN.map(|(axis, _)| model.joint_index(&format!("{prefix}grasp_{axis}")));
        Joined {
            first: coordinates(&model, self, ""),
            second: coordinates(&model, other, prefix),
            connection: axes.into_iter().flatten().collect(),
            model,
        }
    }

    /// This robot with the joints `locked` held at their positions in `q` \[rad or m\]: the bodies that they move are
    /// welded to their parents. The remaining joints keep their order and names.
    ///
    /// # Panics
    /// If `q` or `locked` does not have one element per coordinate.
    #[must_use]
    pub fn with_locked_joints(&self, q: &[f64], locked: &[bool]) -> Self {
        assert_eq!(
            (q.len(), locked.len()),
            (self.dof(), self.dof()),
            "q and locked must have one element per joint"
        );
        let mut copier = Copier::new(self);
        let mut places = vec![Place::own(0); self.bodies().len()];
        for b in 1..self.bodies().len() {
            let (joint, coupling) = (self.tree_joint(b - 1), self.coupling(b - 1));
            let parent = places[self.tree_parent(b - 1)];
            places[b] = if locked[coupling.coordinate] {
                let position = coupling.ratio * q[coupling.coordinate] + coupling.offset;
                let X_BO = parent.X_BO * joint.X_PJ * motion(joint.kind, joint.axis, position);
                let place = Place::part(parent.body, X_BO);
                copier.weld(self, b, place);
                place
            } else {
                copier.copy(self, b, parent, "")
            };
        }
        copier.finish(self, &places, "", None);
        copier.builder.build()
    }
}

/// A continuous joint without damping, friction or limits.
fn free_joint(name: String, axis: Unit<Vector3<f64>>, X_PJ: Pose) -> Joint {
    Joint {
        name,
        kind: JointKind::Continuous,
        axis,
        X_PJ,
        limits: JointLimits::NONE,
        damping: 0.0,
        friction: 0.0,
        spring: Spring::default(),
    }
}

/// Pose of the moved body in the joint frame at position `q`.
fn motion(kind: JointKind, axis: Unit<Vector3<f64>>, q: f64) -> Pose {
    if kind == JointKind::Prismatic {
        Pose::from_parts(Translation3::from(*axis * q), Rotation3::identity())
    } else {
        Pose::from_parts(
            Translation3::identity(),
            Rotation3::from_axis_angle(&axis, q),
        )
    }
}
