//! The XML document of a robot description: elements, attributes and numbers, with errors that name lines.

use std::borrow::Cow;
use std::cell::RefCell;

use roxmltree::{Document, Node};

use super::error::{UrdfError, UrdfProblem};
use super::repair::{Repair, RepairKind};

/// Deepest nesting of elements: URDF needs five levels, extensions of plugins a few more.
const DEEPEST: usize = 64;

/// A robot description being read. Creates errors with line numbers.
pub(super) struct Source<'a> {
    pub name: &'a str,
    doc: Document<'a>,
    /// Byte offset at which each line after the first starts.
    line_starts: Vec<usize>,
    /// Repairs so far; `None` if repairs are not allowed.
    repairs: Option<RefCell<Vec<Repair>>>,
}

pub(super) type Checked<T> = Result<T, UrdfError>;

/// The text of a robot description without non-XML text that other programs accept: blank lines before the declaration,
/// and text after the last element. Lines keep their numbers.
/// [`Model::repaired_from_urdf`](crate::model::Model::repaired_from_urdf) does this itself; programs that forward the
/// text need this function.
pub fn without_surroundings(xml: &str) -> Cow<'_, str> {
    let (start, end) = (xml.find("<?xml"), xml.rfind("</robot>"));
    let mut text = Cow::Borrowed(xml);
    if let Some(end) = end.map(|at| at + "</robot>".len())
        && !xml[end..].trim().is_empty()
        && !xml[end..].contains('<')
    {
        text.to_mut().truncate(end);
    }
    let Some(start) = start.filter(|&at| at > 0 && xml[..at].trim().is_empty()) else {
        return text;
    };
    if let Some(length) = text[start..].find("?>") {
        let declaration = start..start + length + 2;
        let blank = " ".repeat(declaration.len());
        text.to_mut().replace_range(declaration, &blank);
    }
    text
}

impl<'a> Source<'a> {
    /// Parses the XML. With `repairs`, repairable mistakes are not errors.
    pub fn parse(xml: &'a str, name: &'a str, repairs: bool) -> Checked<Self> {
        let doc = Document::parse(xml).map_err(|e| UrdfError {
            source_name: name.to_owned(),
            line: Some(e.pos().row),
            element: None,
            problem: Box::new(UrdfProblem::Xml(e.to_string())),
        })?;
        let repairs = repairs.then(RefCell::default);
        let breaks = xml.bytes().enumerate().filter(|(_, byte)| *byte == b'\n');
        Ok(Self {
            name,
            doc,
            line_starts: breaks.map(|(at, _)| at + 1).collect(),
            repairs,
        })
    }

    /// Whether repairs are allowed.
    pub fn repairs(&self) -> bool {
        self.repairs.is_some()
    }

    /// Records the repair `kind` of the link or joint `name` at byte offset `at`; an error if repairs are not allowed.
    pub fn repair_at(
        &self,
        at: usize,
        name: &str,
        kind: RepairKind,
        or: impl FnOnce() -> UrdfError,
    ) -> Checked<()> {
        if self.repairs.is_none() {
            return Err(or());
        }
        self.note_at(at, name, kind);
        Ok(())
    }

    /// Records a repair for a deviation that strict mode accepts, if repairs are made.
    pub fn note_at(&self, at: usize, name: &str, kind: RepairKind) {
        if let Some(repairs) = &self.repairs {
            repairs.borrow_mut().push(Repair {
                line: self.line(at),
                name: name.to_owned(),
                kind,
            });
        }
    }

    /// [`Source::repair_at`] for an element inside of a link or joint.
    pub fn repair(&self, node: Node, kind: RepairKind, or: UrdfProblem) -> Checked<()> {
        let name = holder(node).and_then(|n| n.attribute("name"));
        let at = node.range().start;
        self.repair_at(at, name.unwrap_or_default(), kind, || self.error(node, or))
    }

    /// All repairs, in the order of the document.
    pub fn into_repairs(self) -> Vec<Repair> {
        let mut repairs = self.repairs.map(RefCell::into_inner).unwrap_or_default();
        repairs.sort_by_key(|repair| repair.line);
        repairs
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

    /// The line that contains byte offset `at`, counted from 1.
    pub fn line(&self, at: usize) -> u32 {
        let row = 1 + self.line_starts.partition_point(|&start| start <= at);
        u32::try_from(row).unwrap_or(u32::MAX)
    }

    /// An error at `node`, about the link or joint that contains it.
    pub fn error(&self, node: Node, problem: UrdfProblem) -> UrdfError {
        let element = holder(node).map(|n| {
            let name = n.attribute("name").unwrap_or_default();
            subject(n.tag_name().name(), name)
        });
        self.error_at(node.range().start, element, problem)
    }

    /// The `<robot>`, if the document is a URDF.
    pub fn robot(&self) -> Checked<Node<'_, 'a>> {
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
        match robot.tag_name().name() {
            "robot" => Ok(robot),
            "sdf" => Err(self.error(robot, UrdfProblem::OtherFormat("SDF"))),
            "mujoco" => Err(self.error(robot, UrdfProblem::OtherFormat("MJCF"))),
            other => Err(self.error(robot, UrdfProblem::NotARobot(other.to_owned()))),
        }
    }

    pub fn required<'n>(
        &self,
        node: Node<'n, '_>,
        attribute: &str,
        missing: &'static str,
    ) -> Checked<&'n str> {
        match node.attribute(attribute) {
            Some(value) if !value.trim().is_empty() => Ok(value),
            _ => Err(self.error(node, absent(node, missing))),
        }
    }

    pub fn required_number(&self, node: Node, name: &str, missing: &'static str) -> Checked<f64> {
        self.required(node, name, missing)?;
        Ok(self.number(node, name)?.unwrap_or_default())
    }

    pub fn number(&self, node: Node, attribute: &str) -> Checked<Option<f64>> {
        Ok((self.numbers::<1>(node, attribute, "a finite number")?).map(|[value]| value))
    }

    pub fn numbers<const N: usize>(
        &self,
        node: Node,
        attribute: &str,
        wanted: &'static str,
    ) -> Checked<Option<[f64; N]>> {
        let Some(value) = node.attribute(attribute) else {
            return Ok(None);
        };
        let parsed = |word: &str| word.parse().ok().filter(|x: &f64| x.is_finite());
        let words: Option<Vec<f64>> = value.split_whitespace().map(parsed).collect();
        if let Some(numbers) = words.and_then(|v| v.try_into().ok()) {
            return Ok(Some(numbers));
        }
        let problem = if value.contains("${") || value.contains("$(") {
            UrdfProblem::XacroExpression(value.to_owned())
        } else {
            UrdfProblem::Number {
                element: node.tag_name().name().to_owned(),
                attribute: attribute.to_owned(),
                value: value.to_owned(),
                wanted,
            }
        };
        // Other programs accept commas between several numbers, punctuation after a number, and more numbers than they
        // use.
        let is_separator = |c: char| c.is_whitespace() || (N > 1 && c == ',');
        let words = value.split(is_separator).filter(|word| !word.is_empty());
        let plain = |word: &str| parsed(word.trim_end_matches(['.', ',', ';']));
        let numbers: Option<Vec<f64>> = words.map(plain).collect();
        let first = numbers.as_ref().filter(|v| N > 1 || v.len() == 1);
        let Some(first) = first.and_then(|v| v.first_chunk::<N>()) else {
            return Err(self.error(node, problem));
        };
        let stated = format!("<{}> {attribute}=\"{value}\"", node.tag_name().name());
        self.repair(node, RepairKind::Numbers(stated), problem)?;
        Ok(Some(*first))
    }

    /// The only child `tag`, or the first one if that is a repair.
    pub fn only_child<'n, 'i>(
        &self,
        node: Node<'n, 'i>,
        tag: &'static str,
    ) -> Checked<Option<Node<'n, 'i>>> {
        let mut found = node.children().filter(|n| n.tag_name().name() == tag);
        let first = found.next();
        for second in found {
            let problem = UrdfProblem::Repeated(tag);
            self.repair(second, RepairKind::Repeated(tag), problem)?;
        }
        Ok(first)
    }

    pub fn child<'n, 'i>(
        &self,
        node: Node<'n, 'i>,
        tag: &'static str,
        missing: &'static str,
    ) -> Checked<Node<'n, 'i>> {
        self.only_child(node, tag)?
            .ok_or_else(|| self.error(node, absent(node, missing)))
    }

    /// Ignores or rejects children that `node` cannot hold, except extensions in another namespace.
    pub fn only_children(&self, node: Node, allowed: &[&str]) -> Checked<()> {
        let home = node.tag_name().namespace();
        for child in node.children().filter(Node::is_element) {
            let tag = child.tag_name();
            if tag.namespace() == home && !allowed.contains(&tag.name()) {
                let found = format!("<{}>", tag.name());
                let kind = RepairKind::Ignored(format!("{found} in <{}>", node.tag_name().name()));
                self.repair(child, kind, unknown(node, found, allowed))?;
            }
        }
        Ok(())
    }

    /// Ignores or rejects attributes that `node` cannot have.
    pub fn only_attributes(&self, node: Node, allowed: &[&str]) -> Checked<()> {
        for attribute in node.attributes() {
            if attribute.namespace().is_none() && !allowed.contains(&attribute.name()) {
                let ignored = format!("{} of <{}>", attribute.name(), node.tag_name().name());
                let found = format!("attribute '{}'", attribute.name());
                let kind = RepairKind::Ignored(ignored);
                self.repair(node, kind, unknown(node, found, allowed))?;
            }
        }
        Ok(())
    }
}

/// The link or joint that contains `node`, or `node` itself.
fn holder<'n, 'i>(node: Node<'n, 'i>) -> Option<Node<'n, 'i>> {
    node.ancestors()
        .find(|n| matches!(n.tag_name().name(), "link" | "joint") && n.has_attribute("name"))
}

/// Name of a link or joint in messages.
pub(super) fn subject(tag: &str, name: &str) -> String {
    format!("{tag} '{name}'")
}

pub(super) fn absent(node: Node, missing: &'static str) -> UrdfProblem {
    let element = node.tag_name().name().to_owned();
    UrdfProblem::Missing { element, missing }
}

pub(super) fn unknown(element: Node, found: String, allowed: &[&str]) -> UrdfProblem {
    UrdfProblem::Unknown {
        element: element.tag_name().name().to_owned(),
        found,
        allowed: allowed.join(", "),
    }
}

/// URDF version of `<robot>`; like urdfdom, 1.0 if it is not stated.
pub(super) fn version(robot: Node) -> (u32, u32) {
    let stated = robot.attribute("version").unwrap_or_default();
    let parts = stated.trim().split_once('.');
    parts
        .and_then(|(major, minor)| Some((major.parse().ok()?, minor.parse().ok()?)))
        .unwrap_or((1, 0))
}
