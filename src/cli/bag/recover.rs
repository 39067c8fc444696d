//! `fuyu bag recover`.

use std::fmt::Write;
use std::path::PathBuf;

use super::super::{Failure, print};
use super::{failure, json};
use crate::bag::{Bag, WriterOptions, recover};

/// Write an intact bag from a truncated or damaged one, with new metadata.yaml, summary and index
///
/// Copies all readable messages and reports what is lost. The damaged bag is not changed. Exit code 0 whether or
/// not something is lost.
#[derive(Debug, clap::Args)]
pub struct RecoverArgs {
    /// Folder or .mcap file; its metadata.yaml is ignored
    bag: PathBuf,
    /// New folder for the bag; default: BAG_recovered
    #[arg(long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// One JSON object on stdout
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(args: &RecoverArgs) -> Result<(), Failure> {
    let bag = Bag::open_files(&args.bag).map_err(failure)?;
    let folder = args
        .output
        .clone()
        .unwrap_or_else(|| super::next_to(&args.bag, "recovered"));
    let recovery = recover(&bag, folder, WriterOptions::default()).map_err(failure)?;
    if args.json {
        return print(&json(&recovery)?);
    }
    let mut text = String::new();
    // Writing to a string cannot fail.
    let _ = writeln!(
        text,
        "{}: {} messages",
        recovery.path.display(),
        recovery.messages
    );
    match recovery.damage.as_slice() {
        [] => text += "nothing is lost\n",
        damage => {
            text += "data was lost here:\n";
            for place in damage {
                let _ = writeln!(text, "  {place}");
            }
        }
    }
    for (topic, why) in &recovery.left_out {
        let _ = writeln!(text, "{topic}: {why}");
    }
    print(&text)
}
