//! Mobility of the joints of a description: mimic joints and their leaders, and joints that are held because they move
//! no mass.

use std::collections::HashMap;

use nalgebra::Vector3;

use super::Compiler;
use super::description::Kind;
use super::document::{Checked, subject};
use super::error::UrdfProblem;
use super::repair::RepairKind;
use crate::model::coupling::Follow;
use crate::model::{Coupling, JointKind};
use crate::spatial::Pose;

/// Largest number of joints of a cycle that an error names.
const MOST_NAMED: usize = 12;

/// Mobility of the joints of a description, by joint index.
pub(super) struct Mobility {
    /// Coupling of each joint to its leader, whose joint index is `coordinate`; a joint without a leader is its own.
    pub couplings: Vec<Coupling>,
    /// For a held joint, the position at which it is held.
    pub held: Vec<Option<f64>>,
    /// For each joint, those that follow it, and itself unless it follows another one.
    group: Vec<Vec<usize>>,
}

/// Links welded to each other, and the moving joints from them.
struct Welded {
    mass: f64,
    /// Moving joints, and the poses of their frames in the frame of the first link.
    joints: Vec<(usize, Pose)>,
}

impl Compiler<'_> {
    /// Determines the mobility of the joints; `mass` is the mass of each link.
    pub(super) fn mobility(&self, mass: &[f64]) -> Checked<Mobility> {
        let joints = &self.robot.joints;
        let couplings = self.couplings()?;
        let mut held: Vec<Option<f64>> = vec![None; joints.len()];
        for (j, joint) in joints.iter().enumerate() {
            if joint.kind == Kind::Fixed {
                held[j] = Some(0.0);
            }
        }
        let mut group = vec![Vec::new(); joints.len()];
        for (j, coupling) in couplings.iter().enumerate() {
            group[coupling.coordinate].push(j);
        }
        let mut mobility = Mobility {
            couplings,
            held,
            group,
        };
        for j in 0..joints.len() {
            let leader = mobility.couplings[j].coordinate;
            if leader != j && mobility.held[leader].is_some() && mobility.held[j].is_none() {
                mobility.held[j] = Some(mobility.couplings[j].offset);
                self.note(j, RepairKind::Immobile);
            }
        }
        if self.source.repairs() {
            self.hold_locked(&mut mobility);
            self.hold_massless(&mut mobility, mass);
            self.hold_massless_root(&mut mobility, mass)?;
            self.check_carriers(&mobility, mass)?;
        }
        for (j, joint) in joints.iter().enumerate() {
            if let (Kind::Several(name), None) = (&joint.kind, mobility.held[j]) {
                let problem = UrdfProblem::UnsupportedJoint(name.clone());
                return Err(self.joint_error(j, problem));
            }
        }
        Ok(mobility)
    }

    /// The coupling of each joint to its leader.
    fn couplings(&self) -> Checked<Vec<Coupling>> {
        let joints = &self.robot.joints;
        let mut follows = Vec::new();
        let index = joints
            .iter()
            .enumerate()
            .map(|(j, joint)| (joint.name.as_str(), j));
        let index: HashMap<&str, usize> = index.collect();
        for (follower, joint) in joints.iter().enumerate() {
            let Some(mimic) = joint.mimic.as_ref().filter(|_| joint.kind != Kind::Fixed) else {
                continue;
            };
            let Some(&leader) = index.get(mimic.joint.as_str()) else {
                let problem = UrdfProblem::MimicOfNoJoint {
                    name: mimic.joint.clone(),
                    known: super::link_tree::some_names(joints.iter().map(|j| j.name.as_str())),
                };
                let element = Some(subject("joint", &joint.name));
                return Err(self.source.error_at(mimic.at, element, problem));
            };
            follows.push(Follow {
                follower,
                leader,
                ratio: mimic.ratio,
                offset: mimic.offset,
            });
        }
        Follow::resolve(joints.len(), &follows).map_err(|start| {
            let next: HashMap<usize, usize> =
                follows.iter().map(|f| (f.follower, f.leader)).collect();
            let chain = std::iter::successors(Some(start), |j| next.get(j).copied());
            let mut cycle: Vec<usize> = Vec::new();
            for (k, j) in chain.enumerate() {
                cycle.push(j);
                if k > 0 && j == start || k > MOST_NAMED {
                    break;
                }
            }
            let names: Vec<&str> = cycle.iter().map(|&j| joints[j].name.as_str()).collect();
            self.joint_error(start, UrdfProblem::MimicCycle(names.join(" -> ")))
        })
    }

    /// Records a repair of a joint for a deviation that strict mode accepts.
    pub(super) fn note(&self, joint: usize, kind: RepairKind) {
        let element = &self.robot.joints[joint];
        self.source.note_at(element.at, &element.name, kind);
    }

    /// Holds a joint together with its leader and all joints with the same leader.
    fn hold(&self, mobility: &mut Mobility, joint: usize, kind: RepairKind) {
        let leader = mobility.couplings[joint].coordinate;
        let limits = self.robot.joints[leader].limits;
        let position = match limits {
            Some(limits) if limits.lower <= limits.upper => {
                0.0_f64.clamp(limits.lower, limits.upper)
            }
            _ => 0.0,
        };
        for &j in &mobility.group[leader] {
            if mobility.held[j].is_none() {
                let coupling = &mobility.couplings[j];
                mobility.held[j] = Some(coupling.ratio * position + coupling.offset);
                self.note(j, kind.clone());
            }
        }
    }

    /// Holds joints whose range is a single position other than zero.
    fn hold_locked(&self, mobility: &mut Mobility) {
        for (j, joint) in self.robot.joints.iter().enumerate() {
            let has_range = matches!(
                joint.kind,
                Kind::Moving(JointKind::Revolute | JointKind::Prismatic)
            );
            let is_locked = |limits: &crate::model::JointLimits| {
                limits.lower == limits.upper && limits.lower != 0.0
            };
            let follows = mobility.couplings[j].coordinate != j;
            if has_range
                && !follows
                && mobility.held[j].is_none()
                && joint.limits.as_ref().is_some_and(is_locked)
            {
                self.hold(mobility, j, RepairKind::Immobile);
            }
        }
    }

    /// Holds joints that, together with those that follow them, move no mass: their motion would be undetermined.
    fn hold_massless(&self, mobility: &mut Mobility, mass: &[f64]) {
        let moved = self.moved_mass(mass);
        let mut of_coordinate = vec![0.0; moved.len()];
        for (j, coupling) in mobility.couplings.iter().enumerate() {
            of_coordinate[coupling.coordinate] += moved[j];
        }
        for j in 0..moved.len() {
            if mobility.held[j].is_none() && of_coordinate[mobility.couplings[j].coordinate] == 0.0
            {
                self.hold(mobility, j, RepairKind::MovesNoMass);
            }
        }
    }

    /// Mass that each joint moves.
    fn moved_mass(&self, mass: &[f64]) -> Vec<f64> {
        let mut outward = vec![self.tree.root];
        let mut joints = Vec::new();
        let mut next = 0;
        while next < outward.len() {
            for &joint in &self.tree.child_joints[outward[next]] {
                outward.push(self.tree.child_link[joint]);
                joints.push((outward[next], joint));
            }
            next += 1;
        }
        let mut of_subtree = mass.to_vec();
        let mut moved = vec![0.0; self.robot.joints.len()];
        for (parent, joint) in joints.into_iter().rev() {
            moved[joint] = of_subtree[self.tree.child_link[joint]];
            of_subtree[parent] += moved[joint];
        }
        moved
    }

    /// While the root has no mass, holds the only joint from it: that joint's motion is the motion of the floating
    /// base.
    fn hold_massless_root(&self, mobility: &mut Mobility, mass: &[f64]) -> Checked<()> {
        let (mut stack, mut moving, mut root_mass) = (vec![self.tree.root], Vec::new(), 0.0);
        loop {
            while let Some(link) = stack.pop() {
                root_mass += mass[link];
                for &joint in &self.tree.child_joints[link] {
                    match mobility.held[joint] {
                        Some(_) => stack.push(self.tree.child_link[joint]),
                        None => moving.push(joint),
                    }
                }
            }
            if root_mass > 0.0 {
                return Ok(());
            }
            match moving[..] {
                [] => return Err(self.link_error(self.tree.root, UrdfProblem::NoMass)),
                [joint] => {
                    self.hold(mobility, joint, RepairKind::MasslessRoot);
                    moving.clear();
                    stack.push(self.tree.child_link[joint]);
                }
                _ => {
                    moving.sort_unstable();
                    let names = moving.iter().map(|&j| self.robot.joints[j].name.as_str());
                    let names = super::link_tree::some_names(names);
                    let problem = UrdfProblem::MasslessRoot(names);
                    return Err(self.link_error(self.tree.root, problem));
                }
            }
        }
    }

    /// Refuses two joints in line with a body without mass between them; records other bodies without mass.
    fn check_carriers(&self, mobility: &Mobility, mass: &[f64]) -> Checked<()> {
        for (j, joint) in self.robot.joints.iter().enumerate() {
            if mobility.held[j].is_some() || mobility.couplings[j].coordinate != j {
                continue;
            }
            let moved = self.welded(self.tree.child_link[j], mobility, mass);
            if moved.mass > 0.0 {
                continue;
            }
            if let [(next, X_LJ)] = &moved.joints[..] {
                let outer = &self.robot.joints[*next];
                let (a, b) = (joint.axis, X_LJ.rotation * outer.axis);
                let p = X_LJ.translation.vector;
                let off_axis =
                    |v: Vector3<f64>| a.cross(&v).norm() > 1e-9 * a.norm() * v.norm().max(1.0);
                let slides = |kind: &Kind| *kind == Kind::Moving(JointKind::Prismatic);
                let same_kind = slides(&joint.kind) == slides(&outer.kind);
                let follows = mobility.couplings[*next].coordinate != *next;
                if same_kind && !follows && !off_axis(b) && (slides(&joint.kind) || !off_axis(p)) {
                    let problem = UrdfProblem::NoInertiaBetween(outer.name.clone());
                    return Err(self.joint_error(j, problem));
                }
            }
            if !moved.joints.is_empty() {
                self.note(j, RepairKind::MasslessCarrier);
            }
        }
        Ok(())
    }

    /// All links that are welded to `link` by joints that do not move.
    fn welded(&self, link: usize, mobility: &Mobility, mass: &[f64]) -> Welded {
        let mut welded = Welded {
            mass: 0.0,
            joints: Vec::new(),
        };
        let mut stack = vec![(link, Pose::identity())];
        while let Some((link, X_BL)) = stack.pop() {
            welded.mass += mass[link];
            for &joint in &self.tree.child_joints[link] {
                let X_BJ = X_BL * self.robot.joints[joint].X_LJ;
                match mobility.held[joint] {
                    Some(q) => {
                        let X_BC = X_BJ * self.moved_by(joint, q);
                        stack.push((self.tree.child_link[joint], X_BC));
                    }
                    None => welded.joints.push((joint, X_BJ)),
                }
            }
        }
        welded.joints.sort_by_key(|(joint, _)| *joint);
        welded
    }
}
