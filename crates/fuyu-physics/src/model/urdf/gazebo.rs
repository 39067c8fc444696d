//! Joint springs from Gazebo's extension of URDF, which itself has none.
//!
//! `<gazebo reference="JOINT"><springStiffness>K</springStiffness><springReference>Q0</springReference></gazebo>`
//! is read by Gazebo Classic and gz-sim. Everything else in `<gazebo>` is ignored.

use std::collections::HashMap;

use roxmltree::Node;

use super::document::{Checked, Source, subject};
use super::error::{UrdfError, UrdfProblem};
use super::repair::RepairKind;
use crate::model::Spring;

/// Element with a spring's stiffness.
const STIFFNESS: &str = "springStiffness";
/// Element with its rest position.
const REFERENCE: &str = "springReference";

impl Source<'_> {
    /// The springs of all joints, by the joint's name.
    pub(super) fn springs(&self, robot: Node) -> Checked<HashMap<String, Spring>> {
        let children = |tag| {
            let elements = robot.children().filter(Node::is_element);
            elements.filter(move |n| n.tag_name().name() == tag)
        };
        let joints: HashMap<&str, &str> = children("joint")
            .map(|j| {
                let stated = |name| j.attribute(name).unwrap_or_default();
                (stated("name"), stated("type"))
            })
            .collect();
        let mut springs = HashMap::new();
        for gazebo in children("gazebo") {
            let stiffness = self.only_number(gazebo, STIFFNESS)?;
            let rest = self.only_number(gazebo, REFERENCE)?;
            let Some(at) = stiffness.or(rest).map(|(node, _)| node) else {
                continue;
            };
            let joint = gazebo.attribute("reference").unwrap_or_default();
            let fail = |problem| Err(self.spring_error(gazebo, at, problem));
            let problem = match joints.get(joint) {
                None => {
                    let mut known: Vec<_> = joints.keys().copied().collect();
                    known.sort_unstable();
                    Some(UrdfProblem::SpringOfNoJoint {
                        name: joint.to_owned(),
                        known: known.join(", "),
                    })
                }
                Some(&"fixed") => Some(UrdfProblem::SpringOfFixedJoint),
                Some(_) => None,
            };
            if let Some(problem) = problem {
                let refused = || self.spring_error(gazebo, at, problem);
                self.repair_at(at.range().start, joint, RepairKind::Spring, refused)?;
                continue;
            }
            let Some((node, stiffness)) = stiffness else {
                return fail(UrdfProblem::Missing {
                    element: "gazebo".to_owned(),
                    missing: "<springStiffness>..</springStiffness> next to its <springReference>",
                });
            };
            if stiffness < 0.0 {
                let problem = text_problem(node, "zero or positive");
                return Err(self.spring_error(gazebo, node, problem));
            }
            let spring = Spring {
                stiffness,
                rest: rest.map_or(0.0, |(_, rest)| rest),
            };
            if springs.insert(joint.to_owned(), spring).is_some() {
                return fail(UrdfProblem::Repeated(STIFFNESS));
            }
        }
        Ok(springs)
    }

    /// The number in the only `tag` of `gazebo`.
    fn only_number<'n, 'i>(
        &self,
        gazebo: Node<'n, 'i>,
        tag: &'static str,
    ) -> Checked<Option<(Node<'n, 'i>, f64)>> {
        let mut found = gazebo.children().filter(|n| n.tag_name().name() == tag);
        let Some(node) = found.next() else {
            return Ok(None);
        };
        if let Some(second) = found.next() {
            return Err(self.spring_error(gazebo, second, UrdfProblem::Repeated(tag)));
        }
        let number = node.text().and_then(|text| text.trim().parse().ok());
        match number.filter(|x: &f64| x.is_finite()) {
            Some(number) => Ok(Some((node, number))),
            None => Err(self.spring_error(gazebo, node, text_problem(node, "a finite number"))),
        }
    }

    fn spring_error(&self, gazebo: Node, at: Node, problem: UrdfProblem) -> UrdfError {
        let joint = gazebo.attribute("reference").unwrap_or_default();
        self.error_at(at.range().start, Some(subject("joint", joint)), problem)
    }
}

fn text_problem(node: Node, wanted: &'static str) -> UrdfProblem {
    UrdfProblem::Text {
        element: node.tag_name().name().to_owned(),
        value: node.text().unwrap_or_default().trim().to_owned(),
        wanted,
    }
}
