//! Messages that are known by their schema only, as in bags: `ros2msg` text with the definitions of all contained
//! types.

mod columns;
mod parse;
mod read;

pub use columns::{Column, ColumnKind, Layout, MOST_COLUMNS};
pub use parse::SchemaError;
pub use read::{Reading, Value};

/// A message type, read from its text.
#[derive(Debug, Clone, PartialEq)]
pub struct Schema {
    /// Definitions of the message (first) and of all types it contains, in the order of the text.
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
    /// Signed integer of this many bytes.
    Int(usize),
    /// Unsigned integer of this many bytes.
    Uint(usize),
    Float32,
    Float64,
    Text,
    /// Index of the definition in [`Schema::structs`].
    Struct(usize),
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Shape {
    One,
    Array(usize),
    Sequence,
}

impl Field {
    /// Whether the field is an array or sequence of bytes, such as an image or an identifier, which is one value.
    fn is_bytes(&self) -> bool {
        self.base == Base::Uint(1) && self.shape != Shape::One
    }
}
