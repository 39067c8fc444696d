//! Mimic joints: joints whose position is a linear function of another joint's position.
//!
//! A model with mimic joints has fewer coordinates than moving joints. With `q_t` the positions of all joints of the
//! tree and `q` the coordinates, `q_t = S q + b`, where every row of `S` has one entry. Rates and accelerations follow
//! with the same `S`, and efforts with its transpose, since both sides have the same power: `τ = Sᵀ τ_t`. Spring,
//! damper and friction of a mimic joint therefore act on its coordinate, scaled by the square (friction: the magnitude)
//! of the ratio. They are added to the coordinate when the model is built.

use super::tree::Parts;
use super::{Joint, JointKind, JointLimits, Model, Spring};

/// Position of a joint of the tree as a function of the model's coordinates: `ratio * q[coordinate] + offset`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coupling {
    /// Index of the coordinate in every joint vector.
    pub coordinate: usize,
    /// Motion of the joint per motion of the coordinate; 1 for a joint with its own coordinate.
    pub ratio: f64,
    /// Position of the joint when the coordinate is zero \[rad or m\].
    pub offset: f64,
}

/// A joint of the tree that follows another one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mimic<'a> {
    /// The joint. Its spring, damper and friction are zero: they are part of the joint that it follows.
    pub joint: &'a Joint,
    /// Index of the body that the joint moves.
    pub body: usize,
    /// Coupling to the leading joint's coordinate.
    pub coupling: Coupling,
}

/// A joint of the tree.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct TreeJoint {
    pub(super) coupling: Coupling,
    /// The joint, if it is a mimic joint; the others are in [`Parts::joints`].
    pub(super) mimic: Option<Joint>,
}

/// The joints of the tree of a model with mimic joints.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Couplings {
    /// All joints; joint `k` moves body `k + 1`.
    pub(super) tree: Vec<TreeJoint>,
    /// For each coordinate, the joints that it moves and their ratios, its own joint first.
    pub(super) members: Vec<Vec<(usize, f64)>>,
}

/// Joint `follower` of the tree moves `ratio` times as far as `leader`, from `offset`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Follow {
    pub(super) follower: usize,
    pub(super) leader: usize,
    pub(super) ratio: f64,
    pub(super) offset: f64,
}

impl Follow {
    /// The coupling of each of `count` joints to the joint at the end of its chain of leaders, whose index in the tree
    /// is `coordinate`. The error is a joint that leads back to itself.
    pub(super) fn resolve(count: usize, follows: &[Self]) -> Result<Vec<Coupling>, usize> {
        let mut next = vec![None; count];
        for follow in follows {
            next[follow.follower] = Some(follow);
        }
        let mut resolved: Vec<Option<Coupling>> = vec![None; count];
        let mut is_on_chain = vec![false; count];
        for joint in 0..count {
            // Follow the chain to its end or to a joint that is resolved already, then resolve it backwards.
            let (mut chain, mut at) = (Vec::new(), joint);
            let end = loop {
                if let Some(coupling) = resolved[at] {
                    break coupling;
                }
                let Some(follow) = next[at] else {
                    break Coupling::own(at);
                };
                if std::mem::replace(&mut is_on_chain[at], true) {
                    return Err(at);
                }
                chain.push((at, follow));
                at = follow.leader;
            };
            resolved[at] = Some(end);
            let mut leader = end;
            for (follower, follow) in chain.into_iter().rev() {
                leader = Coupling {
                    coordinate: leader.coordinate,
                    ratio: follow.ratio * leader.ratio,
                    offset: follow.ratio * leader.offset + follow.offset,
                };
                resolved[follower] = Some(leader);
            }
        }
        Ok(resolved.into_iter().flatten().collect())
    }
}

impl Coupling {
    /// Coupling of a joint with its own coordinate.
    fn own(coordinate: usize) -> Self {
        Self {
            coordinate,
            ratio: 1.0,
            offset: 0.0,
        }
    }
}

/// Splits the joints of a tree into coordinates and mimic joints.
///
/// # Panics
/// If a joint follows itself, directly or through other joints.
pub(super) fn couple(joints: Vec<Joint>, follows: &[Follow]) -> (Vec<Joint>, Option<Couplings>) {
    if follows.is_empty() {
        return (joints, None);
    }
    let resolved = Follow::resolve(joints.len(), follows)
        .unwrap_or_else(|j| panic!("joint `{}` follows itself", joints[j].name));
    let is_free = |k: usize| resolved[k].coordinate == k;
    // Coordinates are numbered in the order of their joints.
    let number: Vec<usize> = (0..joints.len())
        .scan(0, |count, k| {
            let number = *count;
            *count += usize::from(is_free(k));
            Some(number)
        })
        .collect();
    let mut coordinates: Vec<Joint> = Vec::new();
    let mut members: Vec<Vec<(usize, f64)>> = Vec::new();
    for (k, joint) in joints.iter().enumerate().filter(|(k, _)| is_free(*k)) {
        coordinates.push(joint.clone());
        members.push(vec![(k, 1.0)]);
    }
    let mut tree = Vec::new();
    for (k, (mut joint, resolved)) in joints.into_iter().zip(&resolved).enumerate() {
        let coupling = Coupling {
            coordinate: number[resolved.coordinate],
            ..*resolved
        };
        let is_mimic = resolved.coordinate != k;
        if is_mimic {
            add_mimic(&mut coordinates[coupling.coordinate], &joint, &coupling);
            members[coupling.coordinate].push((k, coupling.ratio));
            (joint.damping, joint.friction) = (0.0, 0.0);
            joint.spring = Spring::default();
        }
        tree.push(TreeJoint {
            coupling,
            mimic: is_mimic.then_some(joint),
        });
    }
    (coordinates, Some(Couplings { tree, members }))
}

/// Adds spring, damper, friction and limits of a mimic joint to the joint that it follows.
fn add_mimic(leader: &mut Joint, mimic: &Joint, coupling: &Coupling) {
    let Coupling { ratio, offset, .. } = *coupling;
    leader.damping += ratio * ratio * mimic.damping;
    leader.friction += ratio.abs() * mimic.friction;
    let (own, added) = (&leader.spring, &mimic.spring);
    let stiffness = own.stiffness + ratio * ratio * added.stiffness;
    if stiffness != 0.0 {
        // Sum of the efforts of both at q = 0, divided by the common stiffness.
        let effort = own.stiffness * own.rest + ratio * added.stiffness * (added.rest - offset);
        let rest = effort / stiffness;
        leader.spring = Spring { stiffness, rest };
    }
    if let Some(limits) = common_limits(&leader.limits, &mimic.limits, coupling) {
        leader.limits = limits;
        if leader.kind == JointKind::Continuous && limits.lower > f64::NEG_INFINITY {
            leader.kind = JointKind::Revolute;
        }
    }
}

/// Limits of a joint narrowed by those of a mimic joint: positions and rates, but not the effort, which is that of the
/// only actuator. `None` if no position is within both ranges.
pub(super) fn common_limits(
    leader: &JointLimits,
    mimic: &JointLimits,
    coupling: &Coupling,
) -> Option<JointLimits> {
    let Coupling { ratio, offset, .. } = *coupling;
    if ratio == 0.0 {
        let held = mimic.lower <= offset && offset <= mimic.upper;
        return held.then_some(*leader);
    }
    let ends = [mimic.lower, mimic.upper].map(|end| (end - offset) / ratio);
    let lower = leader.lower.max(ends[0].min(ends[1]));
    let upper = leader.upper.min(ends[0].max(ends[1]));
    (lower <= upper).then(|| JointLimits {
        lower,
        upper,
        velocity: leader.velocity.min(mimic.velocity / ratio.abs()),
        ..*leader
    })
}

impl Parts {
    fn coupling(&self, k: usize) -> Coupling {
        let couplings = self.couplings.as_ref();
        couplings.map_or(Coupling::own(k), |c| c.tree[k].coupling)
    }

    pub(super) fn tree_joint(&self, k: usize) -> &Joint {
        let Some(couplings) = &self.couplings else {
            return &self.joints[k];
        };
        let joint = &couplings.tree[k];
        let own = &self.joints[joint.coupling.coordinate];
        joint.mimic.as_ref().unwrap_or(own)
    }
}

impl Model {
    /// Whether the robot has mimic joints.
    pub fn has_mimics(&self) -> bool {
        self.parts().couplings.is_some()
    }

    /// The mimic joints, in the order of the bodies that they move.
    pub fn mimics(&self) -> impl Iterator<Item = Mimic<'_>> {
        let tree = self.parts().couplings.iter().flat_map(|c| &c.tree);
        tree.enumerate().filter_map(|(k, joint)| {
            Some(Mimic {
                joint: joint.mimic.as_ref()?,
                body: k + 1,
                coupling: joint.coupling,
            })
        })
    }

    /// All moving joints of the tree, including mimic joints: joint `k` moves body `k + 1`.
    pub fn tree_joints(&self) -> impl DoubleEndedIterator<Item = &Joint> + ExactSizeIterator {
        (0..self.bodies().len() - 1).map(|k| self.parts().tree_joint(k))
    }

    /// The joint of the tree that moves body `k + 1`.
    ///
    /// # Panics
    /// If there is no such joint.
    pub fn tree_joint(&self, k: usize) -> &Joint {
        self.parts().tree_joint(k)
    }

    /// Coupling to the coordinates of the joint of the tree that moves body `k + 1`.
    ///
    /// # Panics
    /// If there is no such joint.
    pub fn coupling(&self, k: usize) -> Coupling {
        self.parts().coupling(k)
    }

    /// The body that joint `j` moves (not those that its mimic joints move).
    ///
    /// # Panics
    /// If there is no such joint.
    pub fn joint_body(&self, j: usize) -> usize {
        let couplings = self.parts().couplings.as_ref();
        couplings.map_or(j, |c| c.members[j][0].0) + 1
    }

    /// The joints of the tree that coordinate `j` moves, by index, and their ratios; its own joint first.
    pub(crate) fn members(&self, j: usize) -> &[(usize, f64)] {
        let couplings = self.parts().couplings.as_ref();
        couplings.map_or(&[], |c| &c.members[j])
    }

    /// Positions of the tree's joints at coordinates `q`, `S q + b`, into `out`, if the robot has mimic joints.
    pub(crate) fn expand_positions(&self, q: &[f64], out: &mut [f64]) {
        let tree = self.parts().couplings.iter().flat_map(|c| &c.tree);
        for (out, TreeJoint { coupling, .. }) in out.iter_mut().zip(tree) {
            *out = coupling.ratio * q[coupling.coordinate] + coupling.offset;
        }
    }

    /// Rates or accelerations of the tree's joints, `S q̇`, into `out`, if the robot has mimic joints.
    pub(crate) fn expand_rates(&self, rates: &[f64], out: &mut [f64]) {
        let tree = self.parts().couplings.iter().flat_map(|c| &c.tree);
        for (out, TreeJoint { coupling, .. }) in out.iter_mut().zip(tree) {
            *out = coupling.ratio * rates[coupling.coordinate];
        }
    }

    /// Efforts along the coordinates, `Sᵀ τ`, from those of the tree's joints, into `out`, if the robot has mimic joints.
    pub(crate) fn gather_efforts(&self, efforts: &[f64], out: &mut [f64]) {
        let members = self.parts().couplings.iter().flat_map(|c| &c.members);
        for (out, members) in out.iter_mut().zip(members) {
            *out = members.iter().map(|&(k, ratio)| ratio * efforts[k]).sum();
        }
    }
}
