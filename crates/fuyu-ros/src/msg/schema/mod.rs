//! Messages of which only the schema is known, as in bags: `ros2msg` text with the definitions of all contained types.

mod columns;
mod parse;
mod read;

pub use columns::{Column, ColumnKind, Layout, MOST_COLUMNS};
pub use parse::SchemaError;
pub use read::{Reading, Value};

/// A message type, read from its text.
#[derive(Debug, Clone, PartialEq)]
pub struct Schema {
    /// What refers to another stands before it or after it; the first is the message.
    structs: Vec<Struct>,
}

#[derive(Debug, Clone, PartialEq)]
struct Struct {
    /// `geometry_msgs/Pose`
    name: String,
    fields: Vec<Field>,
}

#[derive(Debug, Clone, PartialEq)]
struct Field {
    name: String,
    base: Base,
    shape: Shape,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Base {
    Bool,
    /// Signed, of as many bytes.
    Int(usize),
    /// Unsigned, of as many bytes.
    Uint(usize),
    Float32,
    Float64,
    Text,
    /// Place of its definition.
    Struct(usize),
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Shape {
    One,
    Array(usize),
    Sequence,
}

impl Field {
    /// Whether it is bytes and not numbers: an image, an identifier.
    fn is_bytes(&self) -> bool {
        self.base == Base::Uint(1) && self.shape != Shape::One
    }
}
