//! Reproducible Parquet tables: equal rows give equal bytes.

use std::{
    fs::{self, File},
    io::Write,
    path::{Path, PathBuf},
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering},
    },
};

use parquet::{
    basic::{Compression, LogicalType, Repetition, Type as Physical},
    data_type::{BoolType, ByteArray, ByteArrayType, DataType, DoubleType, Int64Type},
    errors::ParquetError,
    file::{
        properties::WriterProperties,
        reader::{FileReader, SerializedFileReader},
        writer::{SerializedFileWriter, SerializedRowGroupWriter},
    },
    record::Field,
    schema::types::Type,
};

use super::row::{Cell, Column, ColumnKind};

/// Writes a table atomically, so that an incomplete table never exists.
///
/// # Errors
/// A line with the file.
pub(super) fn write(path: &Path, columns: &[Column], rows: &[Vec<Cell>]) -> Result<(), String> {
    let bytes = bytes(columns, rows).map_err(|e| format!("{}: {e}", path.display()))?;
    replace(path, &bytes)
}

/// Replaces the content of a file atomically, also if the process is killed or the disk is full.
///
/// # Errors
/// A line with the file.
pub(super) fn replace(path: &Path, bytes: &[u8]) -> Result<(), String> {
    static COUNT: AtomicU64 = AtomicU64::new(0);
    let at = |e: std::io::Error| format!("{}: cannot be written: {e}", path.display());
    let folder = path.parent().unwrap_or(Path::new("."));
    fs::create_dir_all(folder).map_err(at)?;
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let count = COUNT.fetch_add(1, Ordering::Relaxed);
    let draft = folder.join(format!(".{name}.{}.{count}", std::process::id()));
    let written = write_synced(&draft, bytes).and_then(|()| fs::rename(&draft, path));
    if written.is_err() {
        // The error of writing is reported, not this one.
        let _ = fs::remove_file(&draft);
    }
    written.map_err(at)
}

fn write_synced(path: &PathBuf, bytes: &[u8]) -> std::io::Result<()> {
    let mut file = File::create(path)?;
    file.write_all(bytes)?;
    file.sync_all()
}

fn bytes(columns: &[Column], rows: &[Vec<Cell>]) -> Result<Vec<u8>, ParquetError> {
    let mut fields = Vec::with_capacity(columns.len());
    for column in columns {
        let (physical, logical) = match column.kind {
            ColumnKind::Number => (Physical::DOUBLE, None),
            ColumnKind::Integer => (Physical::INT64, None),
            ColumnKind::Bool => (Physical::BOOLEAN, None),
            ColumnKind::Text => (Physical::BYTE_ARRAY, Some(LogicalType::String)),
        };
        let field = Type::primitive_type_builder(&column.name, physical)
            .with_repetition(Repetition::OPTIONAL)
            .with_logical_type(logical)
            .build()?;
        fields.push(Arc::new(field));
    }
    let schema = Type::group_type_builder("run")
        .with_fields(fields)
        .build()?;
    let properties = WriterProperties::builder()
        .set_compression(Compression::SNAPPY)
        .set_created_by(concat!("fuyu ", env!("CARGO_PKG_VERSION")).to_owned())
        .build();
    let mut writer = SerializedFileWriter::new(Vec::new(), Arc::new(schema), Arc::new(properties))?;
    let mut group = writer.next_row_group()?;
    for (i, column) in columns.iter().enumerate() {
        let cells = rows.iter().map(|row| &row[i]);
        match column.kind {
            ColumnKind::Number => {
                put::<DoubleType>(&mut group, cells, |cell| cell.number())?;
            }
            ColumnKind::Integer => put::<Int64Type>(&mut group, cells, |cell| match cell {
                Cell::Integer(i) => Some(*i),
                _ => None,
            })?,
            ColumnKind::Bool => put::<BoolType>(&mut group, cells, |cell| match cell {
                Cell::Bool(b) => Some(*b),
                _ => None,
            })?,
            ColumnKind::Text => put::<ByteArrayType>(&mut group, cells, |cell| match cell {
                Cell::Text(text) => Some(ByteArray::from(text.as_str())),
                _ => None,
            })?,
        }
    }
    group.close()?;
    writer.into_inner()
}

fn put<'a, T: DataType>(
    group: &mut SerializedRowGroupWriter<'_, Vec<u8>>,
    cells: impl Iterator<Item = &'a Cell>,
    value: impl Fn(&Cell) -> Option<T::T>,
) -> Result<(), ParquetError> {
    let cells: Vec<Option<T::T>> = cells.map(value).collect();
    // Definition levels: 1 for a value, 0 for null.
    let present: Vec<i16> = cells.iter().map(|cell| i16::from(cell.is_some())).collect();
    let values: Vec<T::T> = cells.into_iter().flatten().collect();
    let column = group.next_column()?;
    let mut column = column.ok_or_else(|| ParquetError::General("a column too many".into()))?;
    column
        .typed::<T>()
        .write_batch(&values, Some(&present), None)?;
    column.close()
}

/// Reads a table written by [`write`].
///
/// # Errors
/// A line with the file.
pub(super) fn read(path: &Path) -> Result<(Vec<String>, Vec<Vec<Cell>>), String> {
    let at = |e: String| format!("{}: cannot be read: {e}", path.display());
    let file = File::open(path).map_err(|e| at(e.to_string()))?;
    let reader = SerializedFileReader::new(file).map_err(|e| at(e.to_string()))?;
    let schema = reader.metadata().file_metadata().schema_descr();
    let names = schema
        .columns()
        .iter()
        .map(|c| c.name().to_owned())
        .collect();
    let mut rows = Vec::new();
    for row in reader.get_row_iter(None).map_err(|e| at(e.to_string()))? {
        let row = row.map_err(|e| at(e.to_string()))?;
        let cells = row.get_column_iter().map(|(_, field)| match field {
            Field::Double(x) => Cell::Number(*x),
            Field::Long(i) => Cell::Integer(*i),
            Field::Bool(b) => Cell::Bool(*b),
            Field::Str(text) => Cell::Text(text.clone()),
            _ => Cell::Null,
        });
        rows.push(cells.collect());
    }
    Ok((names, rows))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_survives_the_file_and_has_the_same_bytes_each_time() {
        let kinds = [
            ColumnKind::Number,
            ColumnKind::Integer,
            ColumnKind::Bool,
            ColumnKind::Text,
        ];
        let columns: Vec<_> = kinds
            .into_iter()
            .enumerate()
            .map(|(i, kind)| Column {
                name: format!("a.b[{i}]"),
                kind,
            })
            .collect();
        let rows = vec![
            vec![
                Cell::Number(0.1),
                Cell::Integer(1 << 60),
                Cell::Bool(true),
                Cell::Text("ä".into()),
            ],
            vec![Cell::Null, Cell::Null, Cell::Null, Cell::Null],
            vec![
                Cell::Number(f64::INFINITY),
                Cell::Integer(-1),
                Cell::Bool(false),
                Cell::Text(String::new()),
            ],
        ];
        let folder = tempfile::tempdir().unwrap();
        let paths = ["a", "b"].map(|name| folder.path().join(name));
        for path in &paths {
            write(path, &columns, &rows).unwrap();
        }
        assert_eq!(fs::read(&paths[0]).unwrap(), fs::read(&paths[1]).unwrap());
        let (names, again) = read(&paths[0]).unwrap();
        assert_eq!(
            names,
            columns.iter().map(|c| c.name.clone()).collect::<Vec<_>>()
        );
        assert_eq!(again, rows);
        assert_eq!(
            fs::read_dir(folder.path()).unwrap().count(),
            2,
            "drafts remain"
        );
    }
}
