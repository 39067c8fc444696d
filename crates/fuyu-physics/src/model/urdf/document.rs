//! Checks of the XML document before urdf-rs parses it.
//!
//! urdf-rs fills in defaults for missing elements, ignores unknown elements and text that is not a number, and keeps no line
//! numbers. This pass over the same text rejects what urdf-rs would accept silently, and records what it would lose.

use std::collections::HashMap;

use nalgebra::{Quaternion, UnitQuaternion};
use roxmltree::{Document, Node};

use super::error::{UrdfError, UrdfProblem};
use crate::model::Spring;

/// Deepest nesting of elements: URDF needs five levels, extensions of plugins a few more.
const DEEPEST: usize = 64;

/// Facts about the document that urdf-rs does not keep: links and joints in document order, and springs.
#[derive(Default)]
pub(super) struct Facts {
    pub links: Vec<ElementFacts>,
    pub joints: Vec<ElementFacts>,
    /// Springs by the names of their joints.
    pub springs: HashMap<String, Spring>,
}

/// Position of a link or joint in the document, and which optional parts it has.
pub(super) struct ElementFacts {
    /// Byte offset, for the line number of a message.
    pub at: usize,
    /// Whether it has an `<inertial>` (link) or `<limit>` (joint); without, urdf-rs fills in zeros.
    pub stated: bool,
    /// Orientation of the `<origin>` if given as a quaternion (URDF 1.1), which urdf-rs converts to angles
    /// with an error of up to 5e-3 rad near the singularity.
    pub quaternion: Option<UnitQuaternion<f64>>,
}

/// A robot description being checked. Creates errors with line numbers.
pub(super) struct Source<'a> {
    pub name: &'a str,
    doc: Document<'a>,
}

pub(super) type Checked<T> = Result<T, UrdfError>;

impl<'a> Source<'a> {
    /// Parses the XML.
    pub fn parse(xml: &'a str, name: &'a str) -> Checked<Self> {
        let doc = Document::parse(xml).map_err(|e| UrdfError {
            source_name: name.to_owned(),
            line: Some(e.pos().row),
            element: None,
            problem: Box::new(UrdfProblem::Xml(e.to_string())),
        })?;
        Ok(Self { name, doc })
    }

    /// An error at byte offset `at`, about `element`.
    pub fn error_at(&self, at: usize, element: Option<String>, problem: UrdfProblem) -> UrdfError {
        UrdfError {
            source_name: self.name.to_owned(),
            line: Some(self.line(at)),
            element,
            problem: Box::new(problem),
        }
    }

    /// The line that holds byte offset `at`, counted from 1.
    pub fn line(&self, at: usize) -> u32 {
        self.doc.text_pos_at(at).row
    }

    fn error(&self, node: Node, problem: UrdfProblem) -> UrdfError {
        let element = node
            .ancestors()
            .find(|n| matches!(n.tag_name().name(), "link" | "joint") && n.has_attribute("name"));
        let element = element.map(|n| {
            let name = n.attribute("name").unwrap_or_default();
            subject(n.tag_name().name(), name)
        });
        self.error_at(node.range().start, element, problem)
    }

    /// All checks that need no typed description.
    pub fn check(&self) -> Checked<Facts> {
        let robot = self.doc.root_element();
        for node in self.doc.descendants().filter(Node::is_element) {
            let tag = node.tag_name();
            if tag.namespace().is_some_and(|ns| ns.contains("xacro")) {
                let name = format!("xacro:{}", tag.name());
                return Err(self.error(node, UrdfProblem::Xacro(name)));
            }
            if node.ancestors().nth(DEEPEST + 1).is_some() {
                let problem = UrdfProblem::TooDeep {
                    element: tag.name().to_owned(),
                    limit: DEEPEST,
                };
                return Err(self.error(robot, problem));
            }
        }
        if robot.tag_name().name() != "robot" {
            let problem = UrdfProblem::NotARobot(robot.tag_name().name().to_owned());
            return Err(self.error(robot, problem));
        }
        let version = version(robot);
        let mut facts = Facts::default();
        for node in robot.children().filter(Node::is_element) {
            match node.tag_name().name() {
                "link" => facts.links.push(self.check_link(node, version)?),
                "joint" => facts.joints.push(self.check_joint(node, version)?),
                _ => {}
            }
        }
        facts.springs = self.springs(robot)?;
        if facts.links.is_empty() {
            return Err(self.error(robot, UrdfProblem::NoLinks));
        }
        Ok(facts)
    }

    fn check_link(&self, link: Node, version: (u32, u32)) -> Checked<ElementFacts> {
        self.required(link, "name", "attribute 'name'")?;
        for child in link.children().filter(Node::is_element) {
            let holds_mass = |n: &Node| matches!(n.tag_name().name(), "mass" | "inertia");
            let tag = child.tag_name().name();
            if holds_mass(&child) || (tag != "inertial" && child.children().any(|n| holds_mass(&n)))
            {
                return Err(self.error(child, unknown(link, format!("<{tag}>"), &["inertial"])));
            }
        }
        let inertial = self.only_child(link, "inertial")?;
        let mut quaternion = None;
        if let Some(inertial) = inertial {
            self.only_children(inertial, &["origin", "mass", "inertia"])?;
            quaternion = self.check_origin(inertial, version)?;
            let mass = self.child(inertial, "mass", "<mass value=\"..\"/>")?;
            self.required_number(mass, "value", "attribute 'value'")?;
            let inertia = self.child(inertial, "inertia", "<inertia ixx=\"..\" ../>")?;
            for (moment, missing) in [
                ("ixx", "attribute 'ixx'"),
                ("ixy", "attribute 'ixy'"),
                ("ixz", "attribute 'ixz'"),
                ("iyy", "attribute 'iyy'"),
                ("iyz", "attribute 'iyz'"),
                ("izz", "attribute 'izz'"),
            ] {
                self.required_number(inertia, moment, missing)?;
            }
        }
        Ok(ElementFacts {
            at: link.range().start,
            stated: inertial.is_some(),
            quaternion,
        })
    }

    fn check_joint(&self, joint: Node, version: (u32, u32)) -> Checked<ElementFacts> {
        self.required(joint, "name", "attribute 'name'")?;
        match self.required(joint, "type", "attribute 'type'")? {
            "revolute" | "continuous" | "prismatic" | "fixed" => {}
            known @ ("planar" | "floating" | "spherical") => {
                return Err(self.error(joint, UrdfProblem::UnsupportedJoint(known.to_owned())));
            }
            other => return Err(self.error(joint, UrdfProblem::JointType(other.to_owned()))),
        }
        self.only_children(
            joint,
            &[
                "origin",
                "parent",
                "child",
                "axis",
                "limit",
                "dynamics",
                "calibration",
                "safety_controller",
                "mimic",
            ],
        )?;
        if let Some(mimic) = self.only_child(joint, "mimic")? {
            let master = mimic.attribute("joint").unwrap_or_default();
            return Err(self.error(mimic, UrdfProblem::Mimic(master.to_owned())));
        }
        for (end, missing) in [
            ("parent", "<parent link=\"..\"/>"),
            ("child", "<child link=\"..\"/>"),
        ] {
            let end = self.child(joint, end, missing)?;
            self.required(end, "link", "attribute 'link'")?;
        }
        if let Some(axis) = self.only_child(joint, "axis")? {
            self.required(axis, "xyz", "attribute 'xyz'")?;
            self.numbers::<3>(axis, "xyz", "three finite numbers")?;
        }
        let limit = self.only_child(joint, "limit")?;
        if let Some(limit) = limit {
            self.check_limit(limit, version)?;
        }
        if let Some(dynamics) = self.only_child(joint, "dynamics")? {
            let known = ["damping", "friction"];
            for attribute in known {
                self.numbers::<1>(dynamics, attribute, "a finite number")?;
            }
            // Simulators add attributes of their own, which are accepted next to these, but not instead of them.
            if !known.iter().any(|&a| dynamics.has_attribute(a)) {
                self.only_attributes(dynamics, &known)?;
            }
        }
        Ok(ElementFacts {
            at: joint.range().start,
            stated: limit.is_some(),
            quaternion: self.check_origin(joint, version)?,
        })
    }

    fn check_limit(&self, limit: Node, version: (u32, u32)) -> Checked<()> {
        let known = [
            "lower",
            "upper",
            "effort",
            "velocity",
            "acceleration",
            "deceleration",
            "jerk",
        ];
        self.only_attributes(limit, &known)?;
        for attribute in known {
            self.numbers::<1>(limit, attribute, "a finite number")?;
        }
        // Since URDF 1.2 missing limits mean unlimited; before, effort and velocity are required.
        if version < (1, 2) {
            self.required(limit, "effort", "attribute 'effort'")?;
            self.required(limit, "velocity", "attribute 'velocity'")?;
        }
        Ok(())
    }

    /// Checks the `<origin>` of `parent`; returns its orientation if that is given as a quaternion.
    fn check_origin(
        &self,
        parent: Node,
        version: (u32, u32),
    ) -> Checked<Option<UnitQuaternion<f64>>> {
        let Some(origin) = self.only_child(parent, "origin")? else {
            return Ok(None);
        };
        self.only_attributes(origin, &["xyz", "rpy", "quat_xyzw"])?;
        self.numbers::<3>(origin, "xyz", "three finite numbers")?;
        self.numbers::<3>(origin, "rpy", "three finite numbers")?;
        let Some(q) = self.numbers::<4>(origin, "quat_xyzw", "four finite numbers")? else {
            return Ok(None);
        };
        let quaternion = Quaternion::from(q);
        let reason = if version < (1, 1) {
            "needs <robot version=\"1.1\"> or later; without it, give rpy"
        } else if origin.has_attribute("rpy") {
            "is given together with rpy; keep one of them"
        } else if (quaternion.norm() - 1.0).abs() > 1e-6 {
            "must be a unit quaternion"
        } else {
            return Ok(Some(UnitQuaternion::new_normalize(quaternion)));
        };
        let value = origin.attribute("quat_xyzw").unwrap_or_default().to_owned();
        Err(self.error(origin, UrdfProblem::Quaternion { value, reason }))
    }

    fn required<'n>(
        &self,
        node: Node<'n, '_>,
        attribute: &str,
        missing: &'static str,
    ) -> Checked<&'n str> {
        match node.attribute(attribute) {
            Some(value) if !value.trim().is_empty() => Ok(value),
            _ => {
                let element = node.tag_name().name().to_owned();
                Err(self.error(node, UrdfProblem::Missing { element, missing }))
            }
        }
    }

    fn required_number(&self, node: Node, name: &str, missing: &'static str) -> Checked<()> {
        self.required(node, name, missing)?;
        self.numbers::<1>(node, name, "a finite number")?;
        Ok(())
    }

    fn numbers<const N: usize>(
        &self,
        node: Node,
        attribute: &str,
        wanted: &'static str,
    ) -> Checked<Option<[f64; N]>> {
        let Some(value) = node.attribute(attribute) else {
            return Ok(None);
        };
        let words: Option<Vec<f64>> = value
            .split_whitespace()
            .map(|word| word.parse().ok().filter(|x: &f64| x.is_finite()))
            .collect();
        match words.and_then(|v| v.try_into().ok()) {
            Some(numbers) => Ok(Some(numbers)),
            None => {
                let problem = UrdfProblem::Number {
                    element: node.tag_name().name().to_owned(),
                    attribute: attribute.to_owned(),
                    value: value.to_owned(),
                    wanted,
                };
                Err(self.error(node, problem))
            }
        }
    }

    fn only_child<'n, 'i>(
        &self,
        node: Node<'n, 'i>,
        tag: &'static str,
    ) -> Checked<Option<Node<'n, 'i>>> {
        let mut found = node.children().filter(|n| n.tag_name().name() == tag);
        let first = found.next();
        match found.next() {
            Some(second) => Err(self.error(second, UrdfProblem::Repeated(tag))),
            None => Ok(first),
        }
    }

    fn child<'n, 'i>(
        &self,
        node: Node<'n, 'i>,
        tag: &'static str,
        missing: &'static str,
    ) -> Checked<Node<'n, 'i>> {
        self.only_child(node, tag)?.ok_or_else(|| {
            let element = node.tag_name().name().to_owned();
            self.error(node, UrdfProblem::Missing { element, missing })
        })
    }

    /// Rejects children that urdf-rs would ignore, except extensions in another namespace.
    fn only_children(&self, node: Node, allowed: &[&str]) -> Checked<()> {
        let home = node.tag_name().namespace();
        let unexpected = node
            .children()
            .filter(Node::is_element)
            .find(|n| n.tag_name().namespace() == home && !allowed.contains(&n.tag_name().name()));
        unexpected.map_or(Ok(()), |n| {
            let found = format!("<{}>", n.tag_name().name());
            Err(self.error(n, unknown(node, found, allowed)))
        })
    }

    fn only_attributes(&self, node: Node, allowed: &[&str]) -> Checked<()> {
        let unexpected = node
            .attributes()
            .find(|a| a.namespace().is_none() && !allowed.contains(&a.name()));
        unexpected.map_or(Ok(()), |a| {
            let found = format!("attribute '{}'", a.name());
            Err(self.error(node, unknown(node, found, allowed)))
        })
    }

    /// The types of urdf-rs.
    pub fn typed(&self) -> Checked<urdf_rs::Robot> {
        let text = self.doc.input_text();
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        urdf_rs::read_from_string(text).map_err(|whole| {
            // The messages of urdf-rs have no line number: find the first element that it rejects on its own.
            let robot = self.doc.root_element();
            let version = robot.attribute("version").unwrap_or("1.0");
            let rejected_alone = |node: Node| {
                let element = &self.doc.input_text()[node.range()];
                let robot = format!("<robot name=\"r\" version=\"{version}\">{element}</robot>");
                urdf_rs::read_from_string(&robot).err()
            };
            let elements = robot.children().filter(Node::is_element);
            let (node, e) = elements
                .filter(|n| n.tag_name().namespace() == robot.tag_name().namespace())
                .find_map(|n| Some((n, rejected_alone(n)?)))
                .unwrap_or((robot, whole));
            self.error(node, UrdfProblem::Invalid(e.to_string()))
        })
    }
}

/// Name of a link or joint in messages.
pub(super) fn subject(tag: &str, name: &str) -> String {
    format!("{tag} '{name}'")
}

fn unknown(element: Node, found: String, allowed: &[&str]) -> UrdfProblem {
    UrdfProblem::Unknown {
        element: element.tag_name().name().to_owned(),
        found,
        allowed: allowed.join(", "),
    }
}

/// URDF version of `<robot>`; like urdf-rs and urdfdom, 1.0 if it is not stated.
fn version(robot: Node) -> (u32, u32) {
    let stated = robot.attribute("version").unwrap_or_default();
    let parts = stated.trim().split_once('.');
    parts
        .and_then(|(major, minor)| Some((major.parse().ok()?, minor.parse().ok()?)))
        .unwrap_or((1, 0))
}
