//! The tree of links and joints in a description.

use std::collections::HashMap;

use super::description::Description;
use super::document::{Source, subject};
use super::error::{UrdfError, UrdfProblem};
use super::repair::RepairKind;

/// Parents and children, by index into the description's links and joints.
pub(super) struct LinkTree {
    /// The link without a parent.
    pub root: usize,
    /// For each link, the joints whose parent it is, in document order.
    pub child_joints: Vec<Vec<usize>>,
    /// For each joint, its child link.
    pub child_link: Vec<usize>,
}

impl LinkTree {
    /// Finds the tree, or returns the reason why there is none.
    pub fn find(source: &Source, robot: &Description) -> Result<Self, UrdfError> {
        let joint_error = |j: usize, problem| {
            let element = subject("joint", &robot.joints[j].name);
            source.error_at(robot.joints[j].at, Some(element), problem)
        };

        let mut link_index = HashMap::new();
        for (i, link) in robot.links.iter().enumerate() {
            if let Some(first) = link_index.insert(link.name.as_str(), i) {
                let problem = UrdfProblem::DuplicateName(source.line(robot.links[first].at));
                let element = Some(subject("link", &link.name));
                return Err(source.error_at(robot.links[i].at, element, problem));
            }
        }
        let mut joint_index = HashMap::new();
        for (j, joint) in robot.joints.iter().enumerate() {
            if let Some(first) = joint_index.insert(joint.name.as_str(), j) {
                let problem = UrdfProblem::DuplicateName(source.line(robot.joints[first].at));
                return Err(joint_error(j, problem));
            }
        }

        let mut child_joints = vec![Vec::new(); robot.links.len()];
        let mut child_link = Vec::with_capacity(robot.joints.len());
        let mut moved_by: Vec<Option<usize>> = vec![None; robot.links.len()];
        for (j, joint) in robot.joints.iter().enumerate() {
            let find = |role, name: &str| {
                link_index.get(name).copied().ok_or_else(|| {
                    let problem = UrdfProblem::UnknownLink {
                        role,
                        name: name.to_owned(),
                        known: some_names(robot.links.iter().map(|l| l.name.as_str())),
                    };
                    joint_error(j, problem)
                })
            };
            let parent = find("parent", &joint.parent)?;
            let child = find("child", &joint.child)?;
            if parent == child {
                let link = joint.parent.clone();
                return Err(joint_error(j, UrdfProblem::SelfJoint(link)));
            }
            if let Some(other) = moved_by[child].replace(j) {
                let problem = UrdfProblem::TwoParents {
                    link: joint.child.clone(),
                    other: robot.joints[other].name.clone(),
                };
                return Err(joint_error(j, problem));
            }
            child_joints[parent].push(j);
            child_link.push(child);
        }

        let mut roots: Vec<usize> = (0..robot.links.len())
            .filter(|&i| moved_by[i].is_none())
            .collect();
        if roots.len() > 1 {
            let problem = || {
                let problem = UrdfProblem::SeveralRoots {
                    count: roots.len(),
                    names: some_names(roots.iter().map(|&i| robot.links[i].name.as_str())),
                };
                source.error_at(robot.links[roots[1]].at, None, problem)
            };
            let is_alone = |i: usize| {
                let has_mass = robot.links[i]
                    .inertial
                    .as_ref()
                    .is_some_and(|l| l.mass != 0.0);
                child_joints[i].is_empty() && !has_mass
            };
            let mut connected = roots.iter().copied().filter(|&i| !is_alone(i));
            let (Some(root), None) = (connected.next(), connected.next()) else {
                return Err(problem());
            };
            for &i in roots.iter().filter(|&&i| i != root) {
                let link = &robot.links[i];
                source.repair_at(link.at, &link.name, RepairKind::Unconnected, problem)?;
            }
            roots = vec![root];
        }

        let is_ignored = |i: usize| moved_by[i].is_none() && !roots.contains(&i);
        let mut reached: Vec<bool> = (0..robot.links.len()).map(is_ignored).collect();
        let mut stack = roots.clone();
        while let Some(link) = stack.pop() {
            reached[link] = true;
            stack.extend(child_joints[link].iter().map(|&j| child_link[j]));
        }
        if let Some(unreached) = reached.iter().position(|r| !r) {
            // Every unreached link has a parent, so following parents from one of them ends in a cycle.
            let parent = |i: usize| moved_by[i].map_or(i, |j| link_index[&*robot.joints[j].parent]);
            let mut on_cycle = unreached;
            for _ in 0..robot.links.len() {
                on_cycle = parent(on_cycle);
            }
            let above = |&i: &usize| Some(parent(i)).filter(|&p| p != on_cycle);
            let mut cycle: Vec<usize> = std::iter::successors(Some(on_cycle), above).collect();
            cycle.reverse();
            let first = (0..cycle.len()).min_by_key(|&k| cycle[k]).unwrap_or(0);
            cycle.rotate_left(first);
            cycle.push(cycle[0]);
            let names: Vec<&str> = cycle.iter().map(|&i| &*robot.links[i].name).collect();
            let problem = UrdfProblem::Cycle(names.join(" -> "));
            let element = Some(subject("link", &robot.links[cycle[0]].name));
            return Err(source.error_at(robot.links[cycle[0]].at, element, problem));
        }
        Ok(Self {
            root: roots[0],
            child_joints,
            child_link,
        })
    }
}

/// A list for a message: all names, or the first few.
pub(super) fn some_names<'a>(names: impl ExactSizeIterator<Item = &'a str>) -> String {
    const SHOWN: usize = 12;
    let more = names.len().saturating_sub(SHOWN);
    let mut list = names.take(SHOWN).collect::<Vec<_>>().join(", ");
    if more > 0 {
        list += &format!(" and {more} more");
    }
    list
}
