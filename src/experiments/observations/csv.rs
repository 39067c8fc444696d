//! Observations from CSV tables with the columns `t,id,u,v` or `t,wx,wy,wz`, named in the first line.

use std::{collections::BTreeMap, io::Read, path::Path};

use ::csv::{ReaderBuilder, StringRecord, Trim};
use nalgebra::Vector3;

use super::{Observations, ObservedTracks};
use crate::{
    estimation::Tracks,
    input_file::{self, LARGEST_CSV},
    vision::{Feature, FeatureFrame},
};

const TRACKS: [&str; 4] = ["t", "id", "u", "v"];
const RATES: [&str; 4] = ["t", "wx", "wy", "wz"];

const COLUMNS: &str = "its first line must name the columns: t,id,u,v for feature tracks (s and px) or t,wx,wy,wz for \
                       angular velocity (s and rad/s)";

/// Reads a table. Columns may be in any order; other columns are ignored.
///
/// # Errors
/// A line that names file, line and column.
pub(super) fn read(path: &Path) -> Result<Observations, String> {
    let at = |e: String| format!("{}: {e}", path.display());
    let file = input_file::open(path, LARGEST_CSV).map_err(|e| e.to_string())?;
    parse(file).map_err(at)
}

fn parse(file: impl Read) -> Result<Observations, String> {
    let mut reader = ReaderBuilder::new()
        .comment(Some(b'#'))
        .trim(Trim::All)
        // Rows of other lengths are refused below with a clearer message.
        .flexible(true)
        .from_reader(file);
    let names = reader.headers().map_err(|e| e.to_string())?.clone();
    if names.iter().all(str::is_empty) {
        return Err(format!("is empty; {COLUMNS}"));
    }
    let columns = |wanted: [&'static str; 4]| -> Option<[Column; 4]> {
        let find = |name| {
            let index = names.iter().position(|n| n.eq_ignore_ascii_case(name));
            index.map(|index| Column { name, index })
        };
        let found: Vec<_> = wanted.into_iter().map_while(find).collect();
        found.try_into().ok()
    };
    let found = || names.iter().collect::<Vec<_>>().join(",");
    match (columns(TRACKS), columns(RATES)) {
        (Some(columns), None) => tracks(rows(reader, names.len()), columns),
        (None, Some(columns)) => rates(rows(reader, names.len()), columns),
        (Some(_), Some(_)) => Err(format!(
            "its first line is '{}': feature tracks and angular velocity; leave out u,v or wx,wy,wz",
            found()
        )),
        (None, None) => Err(format!("its first line is '{}'; {COLUMNS}", found())),
    }
}

/// A column of the table.
#[derive(Clone, Copy)]
struct Column {
    name: &'static str,
    index: usize,
}

/// One row, with its line number.
struct Row {
    record: StringRecord,
    line: u64,
}

impl Row {
    fn text(&self, column: Column) -> &str {
        self.record.get(column.index).unwrap_or("")
    }

    fn error(&self, column: Column, right: &str) -> String {
        let (name, text) = (column.name, self.text(column));
        format!("line {}: {name} is '{text}'; it must be {right}", self.line)
    }

    /// The error of a row that is earlier than the previous one.
    fn early(&self, column: Column, before: f64) -> String {
        let right = format!("{before}, the time of the row before, or later; sort the rows by it");
        self.error(column, &right)
    }

    fn number(&self, column: Column) -> Result<f64, String> {
        match self.text(column).parse::<f64>() {
            Ok(x) if x.is_finite() => Ok(x),
            _ => Err(self.error(column, "a finite number")),
        }
    }
}

/// The rows after the header line, which names `columns` columns.
fn rows<R: Read>(
    reader: ::csv::Reader<R>,
    columns: usize,
) -> impl Iterator<Item = Result<Row, String>> {
    reader.into_records().map(move |record| {
        let record = record.map_err(|e| e.to_string())?;
        let line = record.position().map_or(0, ::csv::Position::line);
        if record.len() != columns {
            return Err(format!(
                "line {line} has {} values, but the first line names {columns} columns",
                record.len()
            ));
        }
        Ok(Row { record, line })
    })
}

fn tracks(
    rows: impl Iterator<Item = Result<Row, String>>,
    [t, id, u, v]: [Column; 4],
) -> Result<Observations, String> {
    let mut frames: Vec<FeatureFrame> = Vec::new();
    // Ids of the newest frame, with their line numbers.
    let mut lines = BTreeMap::new();
    for row in rows {
        let row = row?;
        let time = row.number(t)?;
        let feature = Feature {
            id: (row.text(id).parse()).map_err(|_| row.error(id, "a whole number from 0"))?,
            u: row.number(u)?,
            v: row.number(v)?,
        };
        match frames.last_mut() {
            Some(frame) if time < frame.time => return Err(row.early(t, frame.time)),
            Some(frame) if time == frame.time => frame.features.push(feature),
            _ => {
                lines.clear();
                frames.push(FeatureFrame::new(time, vec![feature]));
            }
        }
        if let Some(line) = lines.insert(feature.id, row.line) {
            let right = format!("different from that on line {line}, which has the same t");
            return Err(row.error(id, &right));
        }
    }
    if frames.is_empty() {
        return Err("holds no feature".to_owned());
    }
    Ok(Observations::Tracks(ObservedTracks {
        tracks: Tracks::new(frames).map_err(|e| e.to_string())?,
        camera: None,
        distortion: None,
        w_WC_C: Vec::new(),
        gyro_noise: None,
        ranges: Vec::new(),
        ignored_clouds: None,
    }))
}

fn rates(
    rows: impl Iterator<Item = Result<Row, String>>,
    [t, x, y, z]: [Column; 4],
) -> Result<Observations, String> {
    let mut rates: Vec<(f64, Vector3<f64>)> = Vec::new();
    for row in rows {
        let row = row?;
        let time = row.number(t)?;
        match rates.last() {
            Some((before, _)) if time < *before => return Err(row.early(t, *before)),
            Some((before, _)) if time == *before => {
                let right = format!("later than {before}, the time of the row before");
                return Err(row.error(t, &right));
            }
            _ => {}
        }
        let w = Vector3::new(row.number(x)?, row.number(y)?, row.number(z)?);
        rates.push((time, w));
    }
    if rates.is_empty() {
        return Err("holds no angular velocity".to_owned());
    }
    Ok(Observations::AngularVelocity(rates))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Observations, String> {
        parse(text.as_bytes())
    }

    fn refused(text: &str) -> String {
        read(text).unwrap_err()
    }

    #[test]
    fn rows_of_one_time_are_one_frame() {
        let text = "# made by hand\nid, t, v, u\n3, 0.0, 2.5, 1.5\n1, 0.0, 0, 1\n3, 0.6, 2, 1\n";
        let Ok(Observations::Tracks(observed)) = read(text) else {
            panic!("not tracks");
        };
        let frames = observed.tracks.frames();
        assert_eq!(frames.len(), 2);
        let ids: Vec<_> = frames[0].features.iter().map(|f| f.id).collect();
        assert_eq!(ids, [1, 3]);
        let third = frames[0].feature(3).unwrap();
        assert_eq!((third.u, third.v), (1.5, 2.5));
    }

    #[test]
    fn angular_velocity_is_recognised_by_its_columns() {
        let text = "t,wx,wy,wz\n0,0.1,0.2,0.3\n0.6,-0.1,0.2,0.3\n";
        let Ok(Observations::AngularVelocity(rates)) = read(text) else {
            panic!("not angular velocity");
        };
        assert_eq!(rates[1], (0.6, Vector3::new(-0.1, 0.2, 0.3)));
    }

    #[test]
    fn errors_name_line_and_column() {
        let columns = refused("time,id,u,v\n0,1,2,3\n");
        assert!(columns.contains("first line is 'time,id,u,v'") && columns.contains("t,id,u,v"));
        assert!(refused("").contains("is empty") && refused("\n\n").contains("is empty"));
        let both = refused("t,id,u,v,wx,wy,wz\n0,1,2,3,4,5,6\n");
        assert!(both.contains("leave out u,v or wx,wy,wz"), "{both}");
        assert!(refused("0.0,1,2,3\n").contains("name the columns"));
        assert_eq!(refused("t,id,u,v\n"), "holds no feature");
        assert_eq!(refused("t,wx,wy,wz\n"), "holds no angular velocity");
        assert_eq!(
            refused("t,id,u,v\n0,1,2,NaN\n"),
            "line 2: v is 'NaN'; it must be a finite number"
        );
        assert!(refused("t,id,u,v\n0,1.5,2,3\n").contains("line 2: id is '1.5'"));
        assert!(refused("t,id,u,v\n0,-1,2,3\n").contains("id is '-1'"));
        assert_eq!(
            refused("t,id,u,v\n0,0,2,3\n0,1,2\n"),
            "line 3 has 3 values, but the first line names 4 columns"
        );
        let backwards = refused("t,id,u,v\n1,1,2,3\n1,2,2,3\n0.5,1,2,3\n");
        assert_eq!(
            backwards,
            "line 4: t is '0.5'; it must be 1, the time of the row before, or later; sort the rows by it"
        );
        let twice = refused("t,id,u,v\n1,1,2,3\n1,2,2,3\n1,1,2,4\n");
        assert_eq!(
            twice,
            "line 4: id is '1'; it must be different from that on line 2, which has the same t"
        );
        // In another frame, the same id is allowed: the same feature.
        assert!(read("t,id,u,v\n1,1,2,3\n2,1,2,4\n").is_ok());
        let rates = refused("t,wx,wy,wz\n1,0,0,0\n1,0,0,0\n");
        assert_eq!(
            rates,
            "line 3: t is '1'; it must be later than 1, the time of the row before"
        );
    }
}
