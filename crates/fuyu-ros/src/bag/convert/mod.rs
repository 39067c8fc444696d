//! Bags as tables: one file per topic, one row per message, one column per value, for any type whose schema is in the
//! bag.

mod csv;
mod file_names;
mod parquet;

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::Serialize;

use super::{Bag, BagError, Damage, Message, RecordedTopic};
use crate::msg::schema::{Column, Layout, Schema, Value};

pub use crate::msg::schema::MOST_COLUMNS;

/// Largest number of elements of a sequence that become columns.
pub const ELEMENTS: u32 = 1000;

/// File format of tables.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TableFormat {
    /// CSV with column names in the first line. Octet arrays are hexadecimal.
    Csv,
    /// Apache Parquet, compressed with Snappy.
    Parquet,
}

impl TableFormat {
    fn extension(self) -> &'static str {
        match self {
            Self::Csv => "csv",
            Self::Parquet => "parquet",
        }
    }
}

/// One table.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Table {
    /// Topic of the messages.
    pub topic: String,
    /// ROS type.
    #[serde(rename = "type")]
    pub type_name: String,
    /// Path of the table.
    pub path: PathBuf,
    /// Number of messages in the table.
    pub rows: u64,
    /// Number of columns, including those of the times.
    pub columns: usize,
    /// Number of messages with values that have no column, because a sequence is longer than [`ELEMENTS`] or the table
    /// has [`MOST_COLUMNS`] columns; these values are omitted.
    pub cut: u64,
    /// Number of messages that cannot be decoded as the topic's type; they are omitted.
    pub undecoded: u64,
}

/// Result of converting a bag.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Conversion {
    /// Tables in the order of their topics' names.
    pub tables: Vec<Table>,
    /// Topics without a table, each with the reason.
    pub left_out: BTreeMap<String, String>,
    /// Damage of the bag.
    pub damage: Vec<Damage>,
}

/// A table being written.
trait Rows {
    /// Adds a message: one cell per column, in their order.
    fn row(&mut self, times: [u64; 2], cells: &[Option<&Value<'_>>]) -> io::Result<()>;

    /// Finishes the table.
    fn finish(self: Box<Self>) -> io::Result<()>;
}

/// A topic being converted.
struct Source {
    topic: Arc<RecordedTopic>,
    layout: Layout,
    undecoded: u64,
    rows: u64,
}

/// Writes the messages of `bag` to tables in `folder`, which is created if needed; `takes` selects the topics.
///
/// # Errors
/// [`BagError::Exists`] if a table exists, [`BagError::Io`] if it cannot be written.
pub fn convert(
    bag: &Bag,
    folder: &Path,
    format: TableFormat,
    takes: impl Fn(&str) -> bool,
) -> Result<Conversion, BagError> {
    // The first pass over the bag determines the columns, the second fills them.
    let mut left_out = BTreeMap::new();
    let mut sources: BTreeMap<String, Source> = BTreeMap::new();
    let mut messages = bag.messages();
    for message in messages.by_ref() {
        let name = &message.topic.name;
        if !takes(name) || left_out.contains_key(name) {
            continue;
        }
        if !sources.contains_key(name) {
            match schema_of(&message.topic) {
                Ok(schema) => {
                    let source = Source {
                        topic: Arc::clone(&message.topic),
                        layout: Layout::new(schema, ELEMENTS),
                        undecoded: 0,
                        rows: 0,
                    };
                    sources.insert(name.clone(), source);
                }
                Err(why) => {
                    left_out.insert(name.clone(), why);
                    continue;
                }
            }
        }
        if let Some(source) = sources.get_mut(name) {
            source.meet(&message);
        }
    }
    let damage = messages.damage();
    fs::create_dir_all(folder).map_err(BagError::io(folder))?;
    let mut open: BTreeMap<String, (PathBuf, usize, Box<dyn Rows>)> = BTreeMap::new();
    let names = file_names::of(sources.keys());
    for ((name, source), stem) in sources.iter_mut().zip(names) {
        let path = folder.join(format!("{stem}.{}", format.extension()));
        let file = match File::create_new(&path) {
            Ok(file) => file,
            Err(e) if e.kind() == io::ErrorKind::AlreadyExists => {
                return Err(BagError::Exists(path));
            }
            // One table that cannot be written is no reason to omit the others.
            Err(e) => {
                let path = path.display();
                left_out.insert(name.clone(), format!("{path} cannot be written: {e}"));
                continue;
            }
        };
        let columns = source.layout.columns();
        let count = columns.len() + 2;
        let rows = start(format, file, &columns).map_err(BagError::io(&path))?;
        open.insert(name.clone(), (path, count, rows));
    }
    for message in bag.messages() {
        let name = &message.topic.name;
        if let (Some(source), Some((path, _, rows))) = (sources.get_mut(name), open.get_mut(name)) {
            source
                .add(&message, rows.as_mut())
                .map_err(BagError::io(path))?;
        }
    }
    let mut tables = Vec::new();
    for (name, source) in sources {
        let Some((path, columns, rows)) = open.remove(&name) else {
            continue;
        };
        rows.finish().map_err(BagError::io(&path))?;
        tables.push(Table {
            type_name: source.topic.type_name.clone(),
            topic: name,
            path,
            rows: source.rows,
            columns,
            cut: source.layout.cut(),
            undecoded: source.undecoded,
        });
    }
    Ok(Conversion {
        tables,
        left_out,
        damage,
    })
}

impl Source {
    fn meet(&mut self, message: &Message) {
        match self.layout.schema().read(&message.data) {
            Ok(reading) if message.topic.type_name == self.topic.type_name => {
                self.layout.meet(&reading.lengths);
            }
            _ => self.undecoded += 1,
        }
    }

    fn add(&mut self, message: &Message, rows: &mut dyn Rows) -> io::Result<()> {
        let Ok(reading) = self.layout.schema().read(&message.data) else {
            return Ok(());
        };
        if message.topic.type_name != self.topic.type_name {
            return Ok(());
        }
        let mut cells = vec![None; self.layout.width()];
        let numbers = self.layout.numbers(&reading.lengths);
        for (value, number) in reading.values.iter().zip(numbers) {
            if let Some(number) = number {
                cells[number] = Some(value);
            }
        }
        self.rows += 1;
        rows.row([message.log_time, message.publish_time], &cells)
    }
}

fn schema_of(topic: &RecordedTopic) -> Result<Schema, String> {
    if topic.encoding != "cdr" {
        return Err(format!(
            "its messages are encoded as {}, not cdr",
            topic.encoding
        ));
    }
    match topic.schema_encoding.as_str() {
        "ros2msg" => {}
        "" => return Err(format!("the bag contains no schema of {}", topic.type_name)),
        other => return Err(format!("its schema format is {other}; fuyu reads ros2msg")),
    }
    let text = String::from_utf8_lossy(&topic.schema);
    Schema::parse(&topic.type_name, &text).map_err(|e| e.to_string())
}

fn start(format: TableFormat, file: File, columns: &[Column]) -> io::Result<Box<dyn Rows>> {
    Ok(match format {
        TableFormat::Csv => Box::new(csv::Csv::start(file, columns)?),
        TableFormat::Parquet => Box::new(parquet::Parquet::start(file, columns)?),
    })
}
