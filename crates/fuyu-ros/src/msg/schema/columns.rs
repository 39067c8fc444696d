//! Messages as rows of a table: the column of each value.

use std::collections::{BTreeMap, HashMap};

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

/// The columns of a table whose rows are messages of one type. Sequences have as many columns as the longest
/// one that was met; those in the order of the fields.
#[derive(Debug)]
pub struct Layout {
    schema: Schema,
    /// Elements of a sequence that get columns.
    limit: u32,
    /// By place in the message: index of field, index of element, and so on inwards.
    columns: BTreeMap<Vec<u32>, Column>,
    /// By lengths of the sequences of a message: the places of its values, `None` beyond the limit.
    places: HashMap<Vec<u32>, Vec<Option<Vec<u32>>>>,
    /// The same by number of the column, once all messages were met.
    numbers: HashMap<Vec<u32>, Vec<Option<usize>>>,
    cut: u64,
}

impl Layout {
    /// No message was met yet. Of a sequence the first `limit` elements get columns.
    pub fn new(schema: Schema, limit: u32) -> Self {
        let mut layout = Self {
            schema,
            limit,
            columns: BTreeMap::new(),
            places: HashMap::new(),
            numbers: HashMap::new(),
            cut: 0,
        };
        // Columns without messages: all but those of sequences.
        layout.walk(&[]);
        layout
    }

    /// The type of the messages.
    pub fn schema(&self) -> &Schema {
        &self.schema
    }

    /// Makes room for a message with sequences of these lengths.
    pub fn meet(&mut self, lengths: &[u32]) {
        if !self.places.contains_key(lengths) {
            let places = self.walk(lengths);
            self.places.insert(lengths.to_vec(), places);
        }
        if self.places[lengths].contains(&None) {
            self.cut += 1;
        }
    }

    /// How many messages had sequences beyond the limit.
    pub fn cut(&self) -> u64 {
        self.cut
    }

    /// Number of columns so far.
    pub fn width(&self) -> usize {
        self.columns.len()
    }

    /// All columns. No further message may be met.
    pub fn columns(&mut self) -> Vec<Column> {
        let number: HashMap<&Vec<u32>, usize> = self
            .columns
            .keys()
            .enumerate()
            .map(|(i, k)| (k, i))
            .collect();
        let to_numbers = |places: &Vec<Option<Vec<u32>>>| {
            let of = |place: &Option<Vec<u32>>| place.as_ref().and_then(|p| number.get(p).copied());
            places.iter().map(of).collect()
        };
        self.numbers = self
            .places
            .iter()
            .map(|(lengths, places)| (lengths.clone(), to_numbers(places)))
            .collect();
        self.columns.values().cloned().collect()
    }

    /// The number of the column of every value of a message that was met; `None` for one beyond the limit.
    pub fn numbers(&self, lengths: &[u32]) -> &[Option<usize>] {
        self.numbers.get(lengths).map_or(&[], Vec::as_slice)
    }

    fn walk(&mut self, lengths: &[u32]) -> Vec<Option<Vec<u32>>> {
        let mut walk = Walk {
            schema: &self.schema,
            limit: self.limit,
            lengths: lengths.iter(),
            columns: &mut self.columns,
            places: Vec::new(),
            place: Vec::new(),
            beyond: 0,
        };
        walk.structure(0, "");
        walk.places
    }
}

struct Walk<'a> {
    schema: &'a Schema,
    limit: u32,
    lengths: std::slice::Iter<'a, u32>,
    columns: &'a mut BTreeMap<Vec<u32>, Column>,
    places: Vec<Option<Vec<u32>>>,
    place: Vec<u32>,
    /// How many sequences around the present value are beyond their limit.
    beyond: u32,
}

impl Walk<'_> {
    fn structure(&mut self, index: usize, prefix: &str) {
        let schema = self.schema;
        for (i, field) in schema.structs[index].fields.iter().enumerate() {
            let name = match prefix {
                "" => field.name.clone(),
                prefix => format!("{prefix}.{}", field.name),
            };
            self.place.push(i as u32);
            let many = match field.shape {
                Shape::One => None,
                _ if field.is_bytes() => None,
                Shape::Array(n) => Some(n as u32),
                Shape::Sequence => Some(self.lengths.next().copied().unwrap_or(0)),
            };
            match many {
                None if field.is_bytes() => self.value(name, ColumnKind::Bytes),
                None => self.element(field.base, name),
                Some(n) => {
                    for j in 0..n {
                        self.place.push(j);
                        let outside = u32::from(j >= self.limit);
                        self.beyond += outside;
                        self.element(field.base, format!("{name}[{j}]"));
                        self.beyond -= outside;
                        self.place.pop();
                    }
                }
            }
            self.place.pop();
        }
    }

    fn element(&mut self, base: Base, name: String) {
        let kind = match base {
            Base::Bool => ColumnKind::Bool,
            Base::Int(_) => ColumnKind::Int,
            Base::Uint(_) => ColumnKind::Uint,
            Base::Float32 => ColumnKind::Float32,
            Base::Float64 => ColumnKind::Float64,
            Base::Text => ColumnKind::Text,
            Base::Struct(inner) => return self.structure(inner, &name),
        };
        self.value(name, kind);
    }

    fn value(&mut self, name: String, kind: ColumnKind) {
        if self.beyond > 0 {
            self.places.push(None);
            return;
        }
        let column = || Column { name, kind };
        self.columns
            .entry(self.place.clone())
            .or_insert_with(column);
        self.places.push(Some(self.place.clone()));
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
            let numbers = layout.numbers(&reading.lengths);
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
        let numbers = layout.numbers(&reading.lengths);
        let position = numbers.iter().position(|n| *n == Some(5)).unwrap();
        assert_eq!(reading.values[position], Value::Float64(0.5));
    }
}
