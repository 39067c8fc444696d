//! Layout of a table whose rows are messages: the column of each value.

use std::borrow::Cow;
use std::collections::{BTreeMap, HashMap};
use std::fmt::Write;

use super::{Base, Schema, Shape};

/// Type of the values in a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ColumnKind {
    /// [`Value::Bool`](super::Value::Bool).
    Bool,
    /// [`Value::Int`](super::Value::Int).
    Int,
    /// [`Value::Uint`](super::Value::Uint).
    Uint,
    /// [`Value::Float32`](super::Value::Float32).
    Float32,
    /// [`Value::Float64`](super::Value::Float64).
    Float64,
    /// [`Value::Text`](super::Value::Text).
    Text,
    /// [`Value::Bytes`](super::Value::Bytes).
    Bytes,
}

/// A column of a table.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Column {
    /// `pose.position.x`, `effort[2]`.
    pub name: String,
    /// Type of its values.
    pub kind: ColumnKind,
}

/// Largest number of columns of a table; only sequences within sequences exceed it.
pub const MOST_COLUMNS: usize = 10_000;

/// Limit of the memory of [`Layout`]: column numbers of all distinct shapes (lengths of sequences) of messages.
const MOST_REMEMBERED: usize = 1 << 22;

/// Columns of a table whose rows are messages of one type. A sequence has as many columns as its longest instance in
/// the messages so far. Columns are in the order of the fields.
#[derive(Debug)]
pub struct Layout {
    schema: Schema,
    /// Largest number of elements of a sequence that get columns.
    limit: u32,
    /// Columns by path in the message (index of field, index of element, and so on inwards), each with its number in
    /// order of creation.
    columns: BTreeMap<Vec<u32>, (Column, usize)>,
    /// Cache, by the lengths of a message's sequences: the creation number of the column of each value, `None` for a
    /// value without a column. It is bounded, so very many distinct lengths are not all in it.
    known: HashMap<Vec<u32>, Vec<Option<usize>>>,
    remembered: usize,
    /// Position in the table of each column by its creation number, once all messages have been seen.
    numbers: Vec<usize>,
    cut: u64,
}

impl Layout {
    /// The layout before the first message. Only the first `limit` elements of a sequence get columns.
    pub fn new(schema: Schema, limit: u32) -> Self {
        let mut layout = Self {
            schema,
            limit,
            columns: BTreeMap::new(),
            known: HashMap::new(),
            remembered: 0,
            numbers: Vec::new(),
            cut: 0,
        };
        // The columns that do not belong to sequences exist without any message.
        layout.add(&[]);
        layout
    }

    /// The type of the messages.
    pub fn schema(&self) -> &Schema {
        &self.schema
    }

    /// Adds the columns of a message with sequences of these lengths.
    pub fn meet(&mut self, lengths: &[u32]) {
        let is_cut = match self.known.get(lengths) {
            Some(columns) => columns.contains(&None),
            None => {
                let columns = self.add(lengths);
                let is_cut = columns.contains(&None);
                if self.remembered + columns.len() <= MOST_REMEMBERED {
                    self.remembered += columns.len();
                    self.known.insert(lengths.to_vec(), columns);
                }
                is_cut
            }
        };
        self.cut += u64::from(is_cut);
    }

    /// Number of messages with values that have no column: beyond the limit of a sequence or beyond [`MOST_COLUMNS`].
    pub fn cut(&self) -> u64 {
        self.cut
    }

    /// Number of columns so far.
    pub fn width(&self) -> usize {
        self.columns.len()
    }

    /// All columns, in the order of the table. No message may be added afterwards.
    pub fn columns(&mut self) -> Vec<Column> {
        self.numbers = vec![0; self.columns.len()];
        for (number, (_, discovered)) in self.columns.values().enumerate() {
            self.numbers[*discovered] = number;
        }
        self.columns.values().map(|(c, _)| c.clone()).collect()
    }

    /// Position in the table of every value of a message that was added; `None` for a value without a column.
    pub fn numbers(&self, lengths: &[u32]) -> impl Iterator<Item = Option<usize>> {
        let found = match self.known.get(lengths) {
            Some(columns) => Cow::Borrowed(columns.as_slice()),
            None => {
                let mut columns = Vec::new();
                self.walk(lengths, |place| {
                    let column = place.and_then(|p| self.columns.get(p.at));
                    columns.push(column.map(|(_, discovered)| *discovered));
                });
                Cow::Owned(columns)
            }
        };
        (0..found.len()).map(move |i| found[i].and_then(|c| self.numbers.get(c).copied()))
    }

    /// Adds the columns of a message with sequences of these lengths; returns the creation number of the column of each
    /// value.
    fn add(&mut self, lengths: &[u32]) -> Vec<Option<usize>> {
        let mut known = std::mem::take(&mut self.columns);
        let mut columns = Vec::new();
        self.walk(lengths, |place| {
            let column = place.and_then(|place| {
                if let Some((_, discovered)) = known.get(place.at) {
                    return Some(*discovered);
                }
                let discovered = known.len();
                (discovered < MOST_COLUMNS).then(|| {
                    let column = Column {
                        name: place.name.to_owned(),
                        kind: place.kind,
                    };
                    known.insert(place.at.to_vec(), (column, discovered));
                    discovered
                })
            });
            columns.push(column);
        });
        self.columns = known;
        columns
    }

    /// Calls `visit` for every value of a message with sequences of these lengths; with `None` for values beyond the
    /// limit.
    fn walk(&self, lengths: &[u32], visit: impl FnMut(Option<Place<'_>>)) {
        let mut walk = Walk {
            schema: &self.schema,
            limit: self.limit,
            lengths: lengths.iter(),
            visit,
            at: Vec::new(),
            name: String::new(),
            beyond: 0,
        };
        walk.structure(0);
    }
}

/// A value within a message.
struct Place<'a> {
    /// Path: index of field, index of element, and so on inwards.
    at: &'a [u32],
    name: &'a str,
    kind: ColumnKind,
}

struct Walk<'a, F> {
    schema: &'a Schema,
    limit: u32,
    lengths: std::slice::Iter<'a, u32>,
    visit: F,
    at: Vec<u32>,
    name: String,
    /// Number of enclosing sequences in which the current element is beyond the limit.
    beyond: u32,
}

impl<F: FnMut(Option<Place<'_>>)> Walk<'_, F> {
    fn structure(&mut self, index: usize) {
        let schema = self.schema;
        let outer = self.name.len();
        for (i, field) in schema.structs[index].fields.iter().enumerate() {
            if outer > 0 {
                self.name.push('.');
            }
            self.name.push_str(&field.name);
            self.at.push(i as u32);
            let many = match field.shape {
                Shape::One => None,
                _ if field.is_bytes() => None,
                Shape::Array(n) => Some(n as u32),
                Shape::Sequence => Some(self.lengths.next().copied().unwrap_or(0)),
            };
            match many {
                None if field.is_bytes() => self.value(ColumnKind::Bytes),
                None => self.element(field.base),
                Some(n) => self.elements(field.base, n),
            }
            self.at.pop();
            self.name.truncate(outer);
        }
    }

    fn elements(&mut self, base: Base, n: u32) {
        let outer = self.name.len();
        for j in 0..n {
            self.at.push(j);
            let outside = u32::from(j >= self.limit);
            self.beyond += outside;
            if self.beyond == 0 {
                // Writing to a string cannot fail.
                let _ = write!(self.name, "[{j}]");
            }
            self.element(base);
            self.name.truncate(outer);
            self.beyond -= outside;
            self.at.pop();
        }
    }

    fn element(&mut self, base: Base) {
        let kind = match base {
            Base::Bool => ColumnKind::Bool,
            Base::Int(_) => ColumnKind::Int,
            Base::Uint(_) => ColumnKind::Uint,
            Base::Float32 => ColumnKind::Float32,
            Base::Float64 => ColumnKind::Float64,
            Base::Text => ColumnKind::Text,
            Base::Struct(inner) => return self.structure(inner),
        };
        self.value(kind);
    }

    fn value(&mut self, kind: ColumnKind) {
        let place = Place {
            at: &self.at,
            name: &self.name,
            kind,
        };
        (self.visit)((self.beyond == 0).then_some(place));
    }
}

#[cfg(test)]
mod tests {
    use super::super::Value;
    use super::*;
    use crate::msg::{Interface, cdr, sensor_msgs, tf2_msgs};

    fn schema<M: Interface>() -> Schema {
        let definition = M::DEFINITION;
        Schema::parse(&definition.type_name(), &definition.schema_text()).unwrap()
    }

    #[test]
    fn every_message_is_read_to_its_end_and_has_a_place_for_every_value() {
        fn check<M: Interface>(message: &M) {
            let bytes = cdr::encode(message);
            let schema = schema::<M>();
            let reading = schema.read(&bytes).unwrap();
            assert!(schema.read(&bytes[..bytes.len() - 1]).is_err());
            let mut layout = Layout::new(schema.clone(), 100);
            layout.meet(&reading.lengths);
            let columns = layout.columns();
            let numbers: Vec<_> = layout.numbers(&reading.lengths).collect();
            assert_eq!(numbers.len(), reading.values.len());
            // In the order of the fields, if there is but one message.
            assert!(numbers.iter().map(|n| n.unwrap()).eq(0..columns.len()));
        }
        let transform = crate::msg::geometry_msgs::TransformStamped::default();
        check(&tf2_msgs::TFMessage {
            transforms: vec![transform; 3],
        });
        check(&sensor_msgs::CameraInfo::default());
        check(&crate::msg::rcl_interfaces::ParameterEvent::default());
        check(&crate::msg::fuyu_msgs::ControllerState::default());
    }

    #[test]
    fn sequences_get_columns_side_by_side_and_no_more_than_the_limit() {
        let joints = |n: usize| sensor_msgs::JointState {
            name: vec!["j".into(); n],
            position: vec![0.5; n],
            ..Default::default()
        };
        let mut layout = Layout::new(schema::<sensor_msgs::JointState>(), 2);
        let bytes: Vec<_> = [1, 3].map(|n| cdr::encode(&joints(n))).into();
        for bytes in &bytes {
            let lengths = layout.schema().read(bytes).unwrap().lengths;
            layout.meet(&lengths);
        }
        let names: Vec<_> = layout.columns().into_iter().map(|c| c.name).collect();
        assert_eq!(
            names,
            [
                "header.stamp.sec",
                "header.stamp.nanosec",
                "header.frame_id",
                "name[0]",
                "name[1]",
                "position[0]",
                "position[1]"
            ]
        );
        assert_eq!(layout.cut(), 1);
        let reading = layout.schema().read(&bytes[0]).unwrap();
        let mut numbers = layout.numbers(&reading.lengths);
        let position = numbers.position(|n| n == Some(5)).unwrap();
        assert_eq!(reading.values[position], Value::Float64(0.5));
    }

    #[test]
    fn sequences_within_sequences_get_no_more_columns_than_allowed() {
        let text = "Row[] rows\n===\nMSG: a/Row\nfloat64[] cells\n";
        let schema = Schema::parse("a/msg/Table", text).unwrap();
        let mut layout = Layout::new(schema, 1000);
        // 300 rows of 300 cells, 90,000 columns without the limit.
        let mut lengths = vec![300];
        lengths.extend([300; 300]);
        layout.meet(&lengths);
        assert_eq!(layout.columns().len(), MOST_COLUMNS);
        assert_eq!(layout.cut(), 1);
        let numbers: Vec<_> = layout.numbers(&lengths).collect();
        assert_eq!(numbers.len(), 90_000);
        assert!(numbers[..MOST_COLUMNS].iter().all(Option::is_some));
        assert!(numbers[MOST_COLUMNS..].iter().all(Option::is_none));
    }

    #[test]
    fn messages_of_many_different_lengths_are_not_all_remembered() {
        let schema = Schema::parse("a/msg/Two", "float64[] a\nfloat64[] b\n").unwrap();
        let mut layout = Layout::new(schema, 100_000);
        let shapes: Vec<[u32; 2]> = (0..50).map(|i| [4000 + i, 100_000]).collect();
        shapes.iter().for_each(|s| layout.meet(s));
        layout.columns();
        assert!(layout.remembered <= MOST_REMEMBERED && layout.known.len() < shapes.len());
        // The columns of a shape are the same whether it is remembered or not.
        let numbers: Vec<_> = layout.numbers(&shapes[49]).collect();
        assert_eq!(numbers.len(), 104_049);
        layout.known.clear();
        let again: Vec<_> = layout.numbers(&shapes[49]).collect();
        assert_eq!(numbers, again);
    }
}
