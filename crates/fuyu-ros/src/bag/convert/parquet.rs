//! Tables as Apache Parquet.

use std::fs::File;
use std::io;
use std::sync::Arc;

use parquet::basic::{Compression, LogicalType, Repetition, TimeUnit, Type as Physical};
use parquet::data_type::{
    BoolType, ByteArray, ByteArrayType, DataType, DoubleType, FloatType, Int64Type,
};
use parquet::errors::ParquetError;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::schema::types::Type;

use super::Rows;
use crate::msg::schema::{Column, ColumnKind, Value};

/// Number of buffered cells before they are written.
const GROUP: usize = 1 << 21;
/// Number of buffered bytes of text and octets before they are written.
const GROUP_BYTES: usize = 64 << 20;

pub(super) struct Parquet {
    writer: SerializedFileWriter<File>,
    times: [Vec<i64>; 2],
    columns: Vec<Cells>,
    bytes: usize,
}

/// Buffered cells of a column.
struct Cells {
    values: Values,
    /// Definition levels: 1 where there is a value, 0 where there is none.
    present: Vec<i16>,
}

enum Values {
    Bool(Vec<bool>),
    Int(Vec<i64>),
    Float32(Vec<f32>),
    Float64(Vec<f64>),
    Bytes(Vec<ByteArray>),
}

impl Parquet {
    pub fn start(file: File, columns: &[Column]) -> io::Result<Self> {
        let time = Some(LogicalType::timestamp(true, TimeUnit::NANOS));
        let mut fields = Vec::with_capacity(columns.len() + 2);
        for name in ["log_time", "publish_time"] {
            let field = Type::primitive_type_builder(name, Physical::INT64)
                .with_repetition(Repetition::REQUIRED)
                .with_logical_type(time.clone())
                .build();
            fields.push(Arc::new(field.map_err(io_error)?));
        }
        for column in columns {
            let (physical, logical) = match column.kind {
                ColumnKind::Bool => (Physical::BOOLEAN, None),
                ColumnKind::Int => (Physical::INT64, None),
                ColumnKind::Uint => (Physical::INT64, Some(LogicalType::integer(64, false))),
                ColumnKind::Float32 => (Physical::FLOAT, None),
                ColumnKind::Float64 => (Physical::DOUBLE, None),
                ColumnKind::Text => (Physical::BYTE_ARRAY, Some(LogicalType::String)),
                ColumnKind::Bytes => (Physical::BYTE_ARRAY, None),
            };
            let field = Type::primitive_type_builder(&column.name, physical)
                .with_repetition(Repetition::OPTIONAL)
                .with_logical_type(logical)
                .build();
            fields.push(Arc::new(field.map_err(io_error)?));
        }
        let schema = Type::group_type_builder("message")
            .with_fields(fields)
            .build();
        let properties = WriterProperties::builder()
            .set_compression(Compression::SNAPPY)
            .set_created_by(concat!("fuyu ", env!("CARGO_PKG_VERSION")).to_owned())
            .build();
        let schema = Arc::new(schema.map_err(io_error)?);
        let writer =
            SerializedFileWriter::new(file, schema, Arc::new(properties)).map_err(io_error)?;
        Ok(Self {
            writer,
            times: Default::default(),
            columns: columns.iter().map(|c| Cells::new(c.kind)).collect(),
            bytes: 0,
        })
    }

    fn write_group(&mut self) -> io::Result<()> {
        let mut group = self.writer.next_row_group().map_err(io_error)?;
        for times in &mut self.times {
            write_column::<Int64Type>(&mut group, times, None).map_err(io_error)?;
            times.clear();
        }
        for column in &mut self.columns {
            column.write(&mut group).map_err(io_error)?;
        }
        group.close().map_err(io_error)?;
        self.bytes = 0;
        Ok(())
    }
}

impl Rows for Parquet {
    fn row(&mut self, times: [u64; 2], cells: &[Option<&Value<'_>>]) -> io::Result<()> {
        for (column, time) in self.times.iter_mut().zip(times) {
            // Times beyond the year 2262 only occur in corrupt bags.
            column.push(i64::try_from(time).unwrap_or(i64::MAX));
        }
        for (column, cell) in self.columns.iter_mut().zip(cells) {
            self.bytes += column.push(*cell);
        }
        let many = self.times[0].len() * (self.columns.len() + 2);
        if many >= GROUP || self.bytes >= GROUP_BYTES {
            self.write_group()?;
        }
        Ok(())
    }

    fn finish(mut self: Box<Self>) -> io::Result<()> {
        if !self.times[0].is_empty() {
            self.write_group()?;
        }
        self.writer.close().map(|_| ()).map_err(io_error)
    }
}

impl Cells {
    fn new(kind: ColumnKind) -> Self {
        Self {
            values: match kind {
                ColumnKind::Bool => Values::Bool(Vec::new()),
                ColumnKind::Int | ColumnKind::Uint => Values::Int(Vec::new()),
                ColumnKind::Float32 => Values::Float32(Vec::new()),
                ColumnKind::Float64 => Values::Float64(Vec::new()),
                ColumnKind::Text | ColumnKind::Bytes => Values::Bytes(Vec::new()),
            },
            present: Vec::new(),
        }
    }

    /// Adds a cell; returns the bytes that it allocates in addition to the column.
    fn push(&mut self, cell: Option<&Value<'_>>) -> usize {
        self.present.push(cell.is_some().into());
        let octets = match (&mut self.values, cell) {
            (_, None) => return 0,
            (Values::Bool(all), Some(Value::Bool(v))) => return push(all, *v),
            (Values::Int(all), Some(Value::Int(v))) => return push(all, *v),
            // The same bits: the column's logical type is unsigned.
            (Values::Int(all), Some(Value::Uint(v))) => return push(all, *v as i64),
            (Values::Float32(all), Some(Value::Float32(v))) => return push(all, *v),
            (Values::Float64(all), Some(Value::Float64(v))) => return push(all, *v),
            (Values::Bytes(all), Some(Value::Text(v))) => (all, v.as_bytes()),
            (Values::Bytes(all), Some(Value::Bytes(v))) => (all, *v),
            // Columns and values have the same schema.
            (_, Some(_)) => unreachable!("a value of another type than its column"),
        };
        let (all, octets) = octets;
        all.push(ByteArray::from(octets.to_vec()));
        octets.len()
    }

    fn write(
        &mut self,
        group: &mut SerializedRowGroupWriter<'_, File>,
    ) -> Result<(), ParquetError> {
        let present = Some(self.present.as_slice());
        match &mut self.values {
            Values::Bool(v) => write_column::<BoolType>(group, v, present)?,
            Values::Int(v) => write_column::<Int64Type>(group, v, present)?,
            Values::Float32(v) => write_column::<FloatType>(group, v, present)?,
            Values::Float64(v) => write_column::<DoubleType>(group, v, present)?,
            Values::Bytes(v) => write_column::<ByteArrayType>(group, v, present)?,
        }
        self.values.clear();
        self.present.clear();
        Ok(())
    }
}

impl Values {
    fn clear(&mut self) {
        match self {
            Self::Bool(v) => v.clear(),
            Self::Int(v) => v.clear(),
            Self::Float32(v) => v.clear(),
            Self::Float64(v) => v.clear(),
            Self::Bytes(v) => v.clear(),
        }
    }
}

fn push<T>(all: &mut Vec<T>, value: T) -> usize {
    all.push(value);
    0
}

fn write_column<T: DataType>(
    group: &mut SerializedRowGroupWriter<'_, File>,
    values: &[T::T],
    present: Option<&[i16]>,
) -> Result<(), ParquetError> {
    let column = group.next_column()?;
    let mut column = column.ok_or_else(|| ParquetError::General("a column too many".into()))?;
    column.typed::<T>().write_batch(values, present, None)?;
    column.close()
}

fn io_error(error: ParquetError) -> io::Error {
    io::Error::other(error)
}
