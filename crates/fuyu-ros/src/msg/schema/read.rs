//! Values of a serialized message, read with its schema.

use std::borrow::Cow;

use super::{Base, Field, Schema, Shape};
use crate::msg::scan::Malformed;

/// One value of a message.
#[derive(Debug, Clone, PartialEq)]
pub enum Value<'a> {
    /// A truth value.
    Bool(bool),
    /// A signed number.
    Int(i64),
    /// An unsigned number.
    Uint(u64),
    /// A number of single precision.
    Float32(f32),
    /// A number of double precision.
    Float64(f64),
    /// Text.
    Text(Cow<'a, str>),
    /// All elements of an array of octets.
    Bytes(&'a [u8]),
}

/// The values of a message in the order of its fields, and the lengths of its sequences.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Reading<'a> {
    /// Values; arrays of octets are one value.
    pub values: Vec<Value<'a>>,
    /// Lengths of the sequences in the message, except sequences of octets.
    pub lengths: Vec<u32>,
}

impl Schema {
    /// Reads a message of this type from CDR bytes with their encapsulation header.
    ///
    /// # Errors
    /// [`Malformed`] if the bytes do not hold such a message.
    pub fn read<'a>(&self, cdr: &'a [u8]) -> Result<Reading<'a>, Malformed> {
        let (big_endian, widest, body) = match cdr {
            [0, 0, _, _, body @ ..] => (true, 8, body),
            [0, 1, _, _, body @ ..] => (false, 8, body),
            // Version 2 of the encoding aligns to at most four bytes.
            [0, 6, _, _, body @ ..] => (true, 4, body),
            [0, 7, _, _, body @ ..] => (false, 4, body),
            _ => return Err(Malformed),
        };
        let mut walk = Walk {
            schema: self,
            body,
            at: 0,
            big_endian,
            widest,
            left: MOST_EMPTY.saturating_add(2 * body.len()),
            found: Reading::default(),
        };
        walk.structure(0)?;
        Ok(walk.found)
    }
}

/// Allowed number of fields without bytes (arrays of no elements); only malicious messages repeat them in a sequence.
const MOST_EMPTY: usize = 1_000_000;

struct Walk<'s, 'a> {
    schema: &'s Schema,
    body: &'a [u8],
    at: usize,
    big_endian: bool,
    widest: usize,
    /// Number of fields and elements that may still follow: each has at least one byte, except empty arrays.
    left: usize,
    found: Reading<'a>,
}

impl<'a> Walk<'_, 'a> {
    fn structure(&mut self, index: usize) -> Result<(), Malformed> {
        let schema = self.schema;
        let fields = &schema.structs[index].fields;
        // ROS sends one octet for an empty message.
        if fields.is_empty() {
            self.take(1)?;
        }
        fields.iter().try_for_each(|field| self.field(field))
    }

    fn field(&mut self, field: &Field) -> Result<(), Malformed> {
        self.left = self.left.checked_sub(1).ok_or(Malformed)?;
        let many = match field.shape {
            Shape::One => return self.element(field.base),
            Shape::Array(n) => n,
            Shape::Sequence => u32::from_le_bytes(self.number()?) as usize,
        };
        if field.is_bytes() {
            let bytes = self.take(many)?;
            self.found.values.push(Value::Bytes(bytes));
            return Ok(());
        }
        if field.shape == Shape::Sequence {
            // Every element has at least one octet, so a sequence longer than the message is malformed.
            if many > self.body.len() {
                return Err(Malformed);
            }
            self.found.lengths.push(many as u32);
        }
        (0..many).try_for_each(|_| self.element(field.base))
    }

    fn element(&mut self, base: Base) -> Result<(), Malformed> {
        let value = match base {
            Base::Bool => Value::Bool(self.take(1)?[0] != 0),
            Base::Int(1) => Value::Int(i8::from_le_bytes(self.number()?).into()),
            Base::Int(2) => Value::Int(i16::from_le_bytes(self.number()?).into()),
            Base::Int(4) => Value::Int(i32::from_le_bytes(self.number()?).into()),
            Base::Int(_) => Value::Int(i64::from_le_bytes(self.number()?)),
            Base::Uint(1) => Value::Uint(self.take(1)?[0].into()),
            Base::Uint(2) => Value::Uint(u16::from_le_bytes(self.number()?).into()),
            Base::Uint(4) => Value::Uint(u32::from_le_bytes(self.number()?).into()),
            Base::Uint(_) => Value::Uint(u64::from_le_bytes(self.number()?)),
            Base::Float32 => Value::Float32(f32::from_le_bytes(self.number()?)),
            Base::Float64 => Value::Float64(f64::from_le_bytes(self.number()?)),
            Base::Text => {
                let length = u32::from_le_bytes(self.number()?) as usize;
                let text = self.take(length)?;
                // The length counts a zero at the end, which some writers leave out.
                let text = text.strip_suffix(&[0]).unwrap_or(text);
                Value::Text(String::from_utf8_lossy(text))
            }
            Base::Struct(inner) => return self.structure(inner),
        };
        self.found.values.push(value);
        Ok(())
    }

    fn take(&mut self, n: usize) -> Result<&'a [u8], Malformed> {
        let end = self.at.checked_add(n).ok_or(Malformed)?;
        let bytes = self.body.get(self.at..end).ok_or(Malformed)?;
        self.at = end;
        Ok(bytes)
    }

    /// Little-endian bytes of a number of `N` bytes.
    fn number<const N: usize>(&mut self) -> Result<[u8; N], Malformed> {
        self.at = self.at.next_multiple_of(N.min(self.widest));
        let mut bytes: [u8; N] = self.take(N)?.try_into().map_err(|_| Malformed)?;
        if self.big_endian {
            bytes.reverse();
        }
        Ok(bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn empty_arrays_in_a_sequence_do_not_fill_the_memory() {
        let fields: String = (0..1000).map(|i| format!("uint8[0] a{i}\n")).collect();
        let text = format!("Part[] parts\n===\nMSG: a/Part\nuint8 x\n{fields}");
        let schema = Schema::parse("a/msg/B", &text).unwrap();
        let message = |n: u32| {
            let mut cdr = vec![0, 1, 0, 0];
            cdr.extend(n.to_le_bytes());
            cdr.resize(cdr.len() + n as usize, 0);
            cdr
        };
        let few = message(10);
        assert_eq!(schema.read(&few).unwrap().values.len(), 10_010);
        // A billion values in a message of one megabyte.
        assert_eq!(schema.read(&message(1_000_000)), Err(Malformed));
    }
}
