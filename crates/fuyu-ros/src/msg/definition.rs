//! ROS definition of a message: its `.msg` text and the schema that bags carry.

use std::fmt::Write as _;

use super::{Base, FieldType, type_hash};

/// Name of the dummy field of an empty message: part of its CDR and of its type hash, but not of its `.msg` text.
pub(super) const EMPTY_MEMBER: &str = "structure_needs_at_least_one_member";

/// Name, constants and fields of a message.
#[derive(Debug)]
pub struct Definition {
    /// ROS package, `geometry_msgs`.
    pub package: &'static str,
    /// Kind of interface file that declares the type.
    pub kind: Kind,
    /// Name within the package, `Pose`.
    pub name: &'static str,
    /// Comment lines.
    pub comment: &'static [&'static str],
    /// Constants in the order of their declaration.
    pub constants: &'static [Constant],
    /// Fields in the order of their declaration, which is their order in CDR.
    pub fields: &'static [FieldDefinition],
}

/// Kind of interface file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// A `.msg` file.
    Msg,
    /// A `.srv` file; the type is its request or response.
    Srv,
    /// An `.action` file; the type is one of the messages, or a request or response of one of the services, that make
    /// up the action.
    Action,
}

impl Kind {
    /// The middle part of a type name, `msg`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Msg => "msg",
            Self::Srv => "srv",
            Self::Action => "action",
        }
    }
}

/// A constant of a message.
#[derive(Debug)]
pub struct Constant {
    /// Name, `OK`.
    pub name: &'static str,
    /// Type.
    pub ty: FieldType,
    /// Prints the value.
    pub value: fn() -> String,
    /// Comment lines.
    pub comment: &'static [&'static str],
}

/// A field of a message.
#[derive(Debug)]
pub struct FieldDefinition {
    /// Name, `frame_id`.
    pub name: &'static str,
    /// Type.
    pub ty: FieldType,
    /// Prints the default value, if the definition states one.
    pub default: Option<fn() -> String>,
    /// Comment lines.
    pub comment: &'static [&'static str],
}

impl Definition {
    /// Full ROS name, `geometry_msgs/msg/Pose`.
    pub fn type_name(&self) -> String {
        format!("{}/{}/{}", self.package, self.kind.name(), self.name)
    }

    /// The text of the `.msg` file: comments, constants, fields; other messages with their package.
    pub fn msg_text(&self) -> String {
        let mut out = String::new();
        comment(&mut out, self.comment);
        if !self.constants.is_empty() {
            separate(&mut out);
        }
        for c in self.constants {
            comment(&mut out, c.comment);
            let _ = writeln!(out, "{} {}={}", c.ty, c.name, (c.value)());
        }
        separate(&mut out);
        for f in self.fields.iter().filter(|f| f.name != EMPTY_MEMBER) {
            comment(&mut out, f.comment);
            let _ = write!(out, "{} {}", f.ty, f.name);
            if let Some(default) = f.default {
                let _ = write!(out, " {}", default());
            }
            out.push('\n');
        }
        out
    }

    /// The `ros2msg` schema of a bag: this message's text, then the text of every message it contains, each after a
    /// line of 80 `=` and a line `MSG: pkg/Name`.
    pub fn schema_text(&self) -> String {
        let mut out = self.msg_text();
        for d in self.dependencies() {
            let _ = write!(
                out,
                "{}\nMSG: {}/{}\n{}",
                "=".repeat(80),
                d.package,
                d.name,
                d.msg_text()
            );
        }
        out
    }

    /// Every message that this one contains, directly or indirectly, each once, in order of first appearance.
    pub fn dependencies(&self) -> Vec<&'static Definition> {
        fn visit(d: &Definition, seen: &mut Vec<&'static Definition>) {
            for f in d.fields {
                if let Base::Message(inner) = f.ty.base
                    && !seen
                        .iter()
                        .any(|s| (s.package, s.name) == (inner.package, inner.name))
                {
                    seen.push(inner);
                    visit(inner, seen);
                }
            }
        }
        let mut seen = Vec::new();
        visit(self, &mut seen);
        seen
    }

    /// RIHS01 hash of the type (REP-2011): `RIHS01_` and 64 hexadecimal digits. Equal definitions have equal hashes.
    pub fn type_hash(&self) -> String {
        type_hash::rihs01(self)
    }
}

fn comment(out: &mut String, lines: &[&str]) {
    for line in lines {
        // Doc comments escape brackets, which .msg files need not.
        let line = line.replace("\\[", "[").replace("\\]", "]");
        let _ = writeln!(out, "#{}", line.trim_end());
    }
}

fn separate(out: &mut String) {
    if !out.is_empty() {
        out.push('\n');
    }
}

/// The ROS name of a Rust field: `type` for `r#type`.
#[doc(hidden)]
pub const fn ros_name(rust: &'static str) -> &'static str {
    match rust.as_bytes() {
        [b'r', b'#', ..] => rust.split_at(2).1,
        _ => rust,
    }
}

#[cfg(test)]
mod tests {
    use crate::msg::*;

    #[test]
    fn text_has_constants_defaults_and_full_names() {
        let text = diagnostic_msgs::DiagnosticStatus::DEFINITION.msg_text();
        assert!(text.contains("byte OK=0\n"), "{text}");
        assert!(
            text.contains("diagnostic_msgs/KeyValue[] values\n"),
            "{text}"
        );
        let text = geometry_msgs::Quaternion::DEFINITION.msg_text();
        assert!(text.contains("float64 w 1\n"), "{text}");
        let text = rcl_interfaces::ParameterDescriptor::DEFINITION.msg_text();
        assert!(text.contains("uint8 type\n"), "{text}");
        assert!(
            text.contains("rcl_interfaces/IntegerRange[<=1] integer_range\n"),
            "{text}"
        );
        let text = geometry_msgs::PoseWithCovariance::DEFINITION.msg_text();
        assert!(text.contains("float64[36] covariance\n"), "{text}");
        assert!(!std_msgs::Empty::DEFINITION.msg_text().contains("member"));
    }

    #[test]
    fn schema_holds_every_dependency_once() {
        let schema = nav_msgs::Odometry::DEFINITION.schema_text();
        let names: Vec<&str> = schema
            .lines()
            .filter_map(|l| l.strip_prefix("MSG: "))
            .collect();
        let mut unique = names.clone();
        unique.sort();
        unique.dedup();
        assert_eq!(names.len(), unique.len());
        assert_eq!(names.len(), 9, "{names:?}");
        assert!(names.contains(&"builtin_interfaces/Time"));
        let rule = "=".repeat(80);
        assert_eq!(schema.lines().filter(|l| *l == rule).count(), names.len());
    }

    #[test]
    fn types_are_found_by_name_and_named_once() {
        let names: Vec<String> = definitions().map(|d| d.type_name()).collect();
        for name in &names {
            assert_eq!(&find(name).unwrap().type_name(), name);
        }
        assert_eq!(
            names.iter().filter(|n| *n == "std_msgs/msg/String").count(),
            1
        );
        for wrong in [
            "",
            "sensor_msgs/JointState",
            "sensor_msgs/msg/Jointstate",
            "std_msgs/msg/String/x",
        ] {
            assert!(find(wrong).is_none(), "{wrong}");
        }
    }

    #[test]
    fn a_bounded_sequence_holds_no_more_than_its_bound() {
        let range = rcl_interfaces::IntegerRange::default();
        assert!(Bounded::<_, 1>::try_from(vec![range.clone()]).is_ok());
        let error = Bounded::<_, 1>::try_from(vec![range.clone(), range.clone()]).unwrap_err();
        assert_eq!(error.to_string(), "2 elements where at most 1 are allowed");
        // Bytes from a peer are checked as well: two elements are rejected.
        #[derive(Debug, Clone, Default, serde::Serialize, serde::Deserialize)]
        struct Two(Vec<rcl_interfaces::IntegerRange>);
        let bytes =
            cdr_encoding::to_vec::<_, byteorder::LittleEndian>(&Two(vec![range; 2])).unwrap();
        type OneAtMost = Bounded<rcl_interfaces::IntegerRange, 1>;
        assert!(cdr_encoding::from_bytes::<OneAtMost, byteorder::LittleEndian>(&bytes).is_err());
    }
}
