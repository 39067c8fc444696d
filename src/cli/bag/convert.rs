//! `fuyu bag convert`.

use std::fmt::Write;
use std::path::PathBuf;

use super::super::{Failure, print};
use super::{failure, json};
use crate::bag::{Bag, BagError, ELEMENTS, MOST_COLUMNS, TableFormat, convert};

/// Write every topic, of any type, to a table: one row per message, one column per value
///
/// Types are read from the schemas in the bag. log_time is the time of recording and publish_time the time of
/// sending, in nanoseconds. Sequences become columns NAME[0], NAME[1], ..., as many as the longest one has elements.
#[derive(Debug, clap::Args)]
pub struct ConvertArgs {
    /// Folder or .mcap file
    bag: PathBuf,
    /// File format of the tables
    #[arg(long, value_name = "FORMAT")]
    to: Format,
    /// Folder for the tables, created if needed; default: next to the bag
    #[arg(long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Topics; default: all
    #[arg(long, value_name = "TOPIC", num_args = 1.., value_delimiter = ',')]
    topics: Vec<String>,
    /// One JSON object on stdout
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum Format {
    Csv,
    Parquet,
}

/// Runs the command.
pub fn run(args: &ConvertArgs) -> Result<(), Failure> {
    let bag = Bag::open(&args.bag).map_err(failure)?;
    let (format, suffix) = match args.to {
        Format::Csv => (TableFormat::Csv, "csv"),
        Format::Parquet => (TableFormat::Parquet, "parquet"),
    };
    let folder = args
        .output
        .clone()
        .unwrap_or_else(|| super::next_to(&args.bag, suffix));
    let takes = |topic: &str| args.topics.is_empty() || args.topics.iter().any(|t| t == topic);
    let made = convert(&bag, &folder, format, takes).map_err(|e| match e {
        BagError::Exists(path) => Failure::Input(format!(
            "{}: a file of this name already exists; move it away or choose another --output",
            path.display()
        )),
        e => Failure::Runtime(e.to_string()),
    })?;
    if made.tables.is_empty() {
        let why = made.left_out.values().next();
        return Err(Failure::Input(format!(
            "bag {}: cannot be converted: {}",
            args.bag.display(),
            why.map_or("it has no messages of these topics", String::as_str)
        )));
    }
    for damage in &made.damage {
        eprintln!("fuyu: warning: {damage}");
    }
    for (topic, why) in &made.left_out {
        eprintln!("fuyu: warning: {topic} is omitted: {why}");
    }
    for table in &made.tables {
        let topic = &table.topic;
        if table.cut > 0 {
            eprintln!(
                "fuyu: warning: {topic}: {} messages have sequences of more than {ELEMENTS} elements, or more than {MOST_COLUMNS} columns; the excess is omitted",
                table.cut
            );
        }
        if table.undecoded > 0 {
            eprintln!(
                "fuyu: warning: {topic}: {} messages are not valid {} and are omitted",
                table.undecoded, table.type_name
            );
        }
    }
    if args.json {
        return print(&json(&made)?);
    }
    let mut text = String::new();
    for table in &made.tables {
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "{}  {} rows, {} columns",
            table.path.display(),
            table.rows,
            table.columns
        );
    }
    print(&text)
}
