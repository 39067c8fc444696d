//! Tables as CSV.

use std::fmt::Write as _;
use std::fs::File;
use std::io;

use super::Rows;
use crate::msg::schema::{Column, Value};

pub(super) struct Csv {
    writer: csv::Writer<File>,
    cell: String,
}

impl Csv {
    pub fn start(file: File, columns: &[Column]) -> io::Result<Self> {
        let mut writer = csv::Writer::from_writer(file);
        let names = columns.iter().map(|c| c.name.as_str());
        writer.write_record(["log_time", "publish_time"].into_iter().chain(names))?;
        Ok(Self {
            writer,
            cell: String::new(),
        })
    }
}

impl Rows for Csv {
    fn row(&mut self, times: [u64; 2], cells: &[Option<&Value<'_>>]) -> io::Result<()> {
        for time in times {
            self.writer.write_field(time.to_string())?;
        }
        for cell in cells {
            self.cell.clear();
            if let Some(value) = cell {
                write_value(&mut self.cell, value);
            }
            self.writer.write_field(&self.cell)?;
        }
        // Ends the record.
        self.writer.write_record(None::<&[u8]>)?;
        Ok(())
    }

    fn finish(mut self: Box<Self>) -> io::Result<()> {
        self.writer.flush()
    }
}

/// Numbers with the fewest digits that parse to the same value.
fn write_value(cell: &mut String, value: &Value<'_>) {
    // Writing to a string cannot fail.
    let _ = match value {
        Value::Bool(v) => write!(cell, "{v}"),
        Value::Int(v) => write!(cell, "{v}"),
        Value::Uint(v) => write!(cell, "{v}"),
        Value::Float32(v) => write!(cell, "{v:?}"),
        Value::Float64(v) => write!(cell, "{v:?}"),
        Value::Text(v) => write!(cell, "{v}"),
        Value::Bytes(v) => v.iter().try_for_each(|byte| write!(cell, "{byte:02x}")),
    };
}
