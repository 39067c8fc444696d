//! `fuyu bag recover`.

use std::fmt::Write;
use std::path::PathBuf;

use super::super::{Failure, print};
use super::{failure, json};
use crate::bag::{Bag, WriterOptions, recover};

/// Make a whole bag of one that was cut off or damaged: metadata.yaml, summary and index anew
///
/// All messages that can be read are copied; what is lost is said. The broken bag stays as it is. Exit code 0
/// whether or not something is lost.
#[derive(Debug, clap::Args)]
pub struct RecoverArgs {
    /// Folder or .mcap file; a metadata.yaml in it is not believed
    bag: PathBuf,
    /// New folder for the bag; BAG_recovered if not given
    #[arg(long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// One JSON object on stdout
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(args: &RecoverArgs) -> Result<(), Failure> {
    let bag = Bag::open_files(&args.bag).map_err(failure)?;
    let folder = args.output.clone().unwrap_or_else(|| {
        let name = args.bag.file_name().unwrap_or_default().to_string_lossy();
        let stem = name.split(".mcap").next().unwrap_or_default();
        args.bag.with_file_name(format!("{stem}_recovered"))
    });
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
            text += "lost is what stood here:\n";
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
