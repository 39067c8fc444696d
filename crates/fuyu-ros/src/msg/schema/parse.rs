//! Parser of `ros2msg` text into a [`Schema`].

use std::collections::HashMap;

use super::{Base, Field, Schema, Shape, Struct};

/// A text that is not a valid schema.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum SchemaError {
    /// A line that is neither a field nor a constant.
    #[error("{type_name}: '{line}' is not a field of a message")]
    Line {
        /// Type in whose definition it stands.
        type_name: String,
        /// The line.
        line: String,
    },
    /// A type that is used but not defined.
    #[error("{type_name}: field {field} is of type {missing}, whose definition is missing")]
    Missing {
        /// Type that uses it.
        type_name: String,
        /// Field.
        field: String,
        /// Name of the missing type.
        missing: String,
    },
    /// A type that contains itself, exceeds a limit, or cannot be read by fuyu.
    #[error("{type_name}: {what}")]
    Unsupported {
        /// Type.
        type_name: String,
        /// Why the type is not supported.
        what: String,
    },
}

/// Type of a field as written in the text.
struct Written {
    base: String,
    shape: Shape,
}

impl Schema {
    /// Parses the definition of `type_name` (`pkg/msg/Name` or `pkg/Name`) at the beginning of `text`; definitions of
    /// other types follow, each after a line of `=` and a line `MSG: pkg/Name`.
    ///
    /// # Errors
    /// [`SchemaError`] names the type and the line or field.
    pub fn parse(type_name: &str, text: &str) -> Result<Self, SchemaError> {
        let mut sections = vec![(short(type_name), Vec::new())];
        let mut lines = text.lines();
        while let Some(line) = lines.next() {
            if line.len() >= 3 && line.bytes().all(|b| b == b'=') {
                let name = lines.next().and_then(|l| l.trim().strip_prefix("MSG:"));
                let Some(name) = name else {
                    return Err(SchemaError::Line {
                        type_name: sections[0].0.clone(),
                        line: line.to_owned(),
                    });
                };
                sections.push((short(name.trim()), Vec::new()));
            } else if let Some((_, lines)) = sections.last_mut() {
                lines.push(line);
            }
        }
        // Of two definitions of a type, the first one counts.
        let names: HashMap<String, usize> = sections
            .iter()
            .enumerate()
            .rev()
            .map(|(i, (name, _))| (name.clone(), i))
            .collect();
        let read = |(name, lines): (String, Vec<&str>)| {
            let fields = lines
                .iter()
                .filter_map(|line| field(&name, line, &names).transpose())
                .collect::<Result<_, _>>()?;
            Ok(Struct { name, fields })
        };
        let structs = sections.into_iter().map(read).collect::<Result<_, _>>()?;
        let schema = Self { structs };
        schema.count(0, 0, &mut vec![Count::Unknown; schema.structs.len()])?;
        Ok(schema)
    }

    /// Smallest number of values of a struct, with empty sequences. Rejects types that contain themselves, and those
    /// with more than [`MOST_VALUES`] values, which only malicious schemas have.
    fn count(&self, at: usize, depth: usize, known: &mut [Count]) -> Result<usize, SchemaError> {
        let refused = |what: &str| SchemaError::Unsupported {
            type_name: self.structs[at].name.clone(),
            what: what.to_owned(),
        };
        match known[at] {
            Count::Done(count) => return Ok(count),
            Count::Begun => return Err(refused("it contains itself")),
            Count::Unknown => known[at] = Count::Begun,
        }
        if depth >= DEEPEST {
            return Err(refused(&format!(
                "types are nested more than {DEEPEST} deep"
            )));
        }
        let mut total = 0usize;
        for field in &self.structs[at].fields {
            let one = match field.base {
                Base::Struct(inner) => self.count(inner, depth + 1, known)?,
                _ => 1,
            };
            total = total.saturating_add(match field.shape {
                Shape::Array(n) if !field.is_bytes() => one.saturating_mul(n),
                _ => one,
            });
        }
        // Elements without values are visited, too.
        let total = total.max(1);
        if total > MOST_VALUES {
            return Err(refused("it has more than a million values"));
        }
        known[at] = Count::Done(total);
        Ok(total)
    }
}

/// Largest number of values of a message with empty sequences.
const MOST_VALUES: usize = 1_000_000;
/// Largest nesting depth of types. Messages are read recursively; those of ROS are nested seven deep at most.
const DEEPEST: usize = 32;
/// Largest number of characters of a field's name. Names of columns are composed of names of nested fields.
const LONGEST_NAME: usize = 255;

#[derive(Clone, Copy)]
enum Count {
    Unknown,
    Begun,
    Done(usize),
}

/// Shortens `pkg/msg/Name` to `pkg/Name`.
fn short(type_name: &str) -> String {
    type_name.replacen("/msg/", "/", 1)
}

/// The field that a line declares; `None` for comments, constants and empty lines.
fn field(
    type_name: &str,
    line: &str,
    names: &HashMap<String, usize>,
) -> Result<Option<Field>, SchemaError> {
    let wrong = || SchemaError::Line {
        type_name: type_name.to_owned(),
        line: line.trim().to_owned(),
    };
    // A quoted text may contain a `#`, but comes after type and name.
    let words = line.trim_start();
    if words.is_empty() || words.starts_with('#') {
        return Ok(None);
    }
    let (written, rest) = words.split_once(char::is_whitespace).ok_or_else(wrong)?;
    let rest = rest.trim_start();
    let is_word = |c: char| c.is_ascii_alphanumeric() || c == '_';
    let end = rest.find(|c| !is_word(c)).unwrap_or(rest.len());
    let (name, behind) = rest.split_at(end);
    if name.is_empty() {
        return Err(wrong());
    }
    if behind.trim_start().starts_with('=') {
        return Ok(None);
    }
    if name.len() > LONGEST_NAME {
        return Err(SchemaError::Unsupported {
            type_name: type_name.to_owned(),
            what: format!(
                "the name of field {}... is longer than {LONGEST_NAME} characters",
                &name[..20]
            ),
        });
    }
    let written = written_type(written).ok_or_else(wrong)?;
    let base = match primitive(&written.base) {
        Some(base) => base,
        None if written.base == "wstring" => {
            return Err(SchemaError::Unsupported {
                type_name: type_name.to_owned(),
                what: format!("field {name} is a wstring, whose encoding differs between makers"),
            });
        }
        None => {
            let package = type_name.split('/').next().unwrap_or_default();
            let full = match written.base.as_str() {
                "Header" => "std_msgs/Header".to_owned(),
                base if base.contains('/') => short(base),
                base => format!("{package}/{base}"),
            };
            let place = names.get(&full).copied();
            Base::Struct(place.ok_or_else(|| SchemaError::Missing {
                type_name: type_name.to_owned(),
                field: name.to_owned(),
                missing: full,
            })?)
        }
    };
    Ok(Some(Field {
        name: name.to_owned(),
        base,
        shape: written.shape,
    }))
}

/// Parses types such as `float64[<=3]` and `string<=10[2]`.
fn written_type(text: &str) -> Option<Written> {
    let (base, shape) = match text.strip_suffix(']') {
        None => (text, Shape::One),
        Some(text) => {
            let (base, size) = text.rsplit_once('[')?;
            let shape = match size {
                "" => Shape::Sequence,
                bound if bound.starts_with("<=") => Shape::Sequence,
                size => Shape::Array(size.parse().ok()?),
            };
            (base, shape)
        }
    };
    let base = base.split("<=").next().unwrap_or_default();
    let is_part = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '/';
    let is_name = !base.is_empty() && base.chars().all(is_part);
    is_name.then(|| Written {
        base: base.to_owned(),
        shape,
    })
}

fn primitive(name: &str) -> Option<Base> {
    Some(match name {
        "bool" => Base::Bool,
        "byte" | "char" | "uint8" => Base::Uint(1),
        "int8" => Base::Int(1),
        "int16" => Base::Int(2),
        "uint16" => Base::Uint(2),
        "int32" => Base::Int(4),
        "uint32" => Base::Uint(4),
        "int64" => Base::Int(8),
        "uint64" => Base::Uint(8),
        "float32" => Base::Float32,
        "float64" => Base::Float64,
        "string" => Base::Text,
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::msg;

    #[test]
    fn every_schema_that_fuyu_writes_is_read() {
        for definition in msg::definitions() {
            let name = definition.type_name();
            let schema = Schema::parse(&name, &definition.schema_text());
            let fields = schema.unwrap_or_else(|e| panic!("{name}: {e}")).structs[0]
                .fields
                .len();
            // The dummy octet of an empty message is part of the serialized bytes, but not of the text.
            let in_text = |f: &&msg::FieldDefinition| !f.name.starts_with("structure_needs");
            let expected = definition.fields.iter().filter(in_text).count();
            assert_eq!(fields, expected, "{name}");
        }
    }

    #[test]
    fn what_ros_writes_is_understood() {
        let text = "# Comment = none\nint32 A=1\nstring B = \"x = y\"\nstring<=10[<=4] names  # many\n\
                    uint8[16] id\nstring s \"a=b#c\"\nHeader header\nPart[] parts\n\
                    ================================================================================\n\
                    MSG: acme/Part\nfloat64 x 0.5\n\
                    ================================================================================\n\
                    MSG: std_msgs/Header\nstring frame_id\n";
        let schema = Schema::parse("acme/msg/Thing", text).unwrap();
        let field = |name: &str, base, shape| Field {
            name: name.into(),
            base,
            shape,
        };
        assert_eq!(
            schema.structs[0].fields,
            [
                field("names", Base::Text, Shape::Sequence),
                field("id", Base::Uint(1), Shape::Array(16)),
                field("s", Base::Text, Shape::One),
                field("header", Base::Struct(2), Shape::One),
                field("parts", Base::Struct(1), Shape::Sequence),
            ]
        );
    }

    #[test]
    fn invalid_schemas_are_explained() {
        let error = |text: &str| Schema::parse("a/msg/B", text).unwrap_err().to_string();
        assert!(error("Other x").contains("a/Other"));
        assert!(error("float64").contains("'float64'"));
        assert!(error("B b").contains("contains itself"));
        assert!(error("wstring w").contains("wstring"));
        assert!(error("float64[x] w").contains("float64[x]"));
        assert!(error("float64[99999999999] w").contains("a million values"));
        assert!(error(&format!("float64 {}", "x".repeat(300))).contains("255 characters"));
        // These types contain no value, but visiting them takes as long.
        let nested = "A[4000000000] a\n===\nMSG: a/A\nC[4000000000] c\n===\nMSG: a/C\n";
        assert!(error(nested).contains("a million values"));
        assert!(
            error("A[4000000000] a\n===\nMSG: a/A\nfloat64[0] x\n").contains("a million values")
        );
    }

    #[test]
    fn sixty_thousand_nested_types_are_refused_and_do_not_overflow_the_stack() {
        let chain = |n: usize| {
            let mut text = "T0 a\n".to_owned();
            for i in 0..n {
                let inner = if i + 1 < n {
                    format!("T{}", i + 1)
                } else {
                    "float64".to_owned()
                };
                text += &format!("===\nMSG: a/T{i}\n{inner} a\n");
            }
            Schema::parse("a/msg/B", &text)
        };
        assert!(chain(20).is_ok());
        let error = chain(60_000).unwrap_err().to_string();
        assert!(error.contains("nested more than 32 deep"), "{error}");
    }
}
