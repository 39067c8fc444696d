//! `fuyu files`: the files that come with fuyu.

use std::fs::{self, OpenOptions};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

use super::{Failure, print};
use crate::nodes::resource;

/// List the scenarios, robots, launch files and layouts in this executable, or write them to a folder
///
/// fuyu reads them as package://fuyu/PATH without the folder, so this is for programs that need files (RViz, Foxglove,
/// ros2 launch) and for making variants of a scenario.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Folder to write them to, created if needed; existing files are not changed
    #[arg(long, value_name = "DIR")]
    output: Option<PathBuf>,
}

/// Runs the command.
///
/// # Errors
/// [`Failure::Input`] if a file exists with other content, [`Failure::Runtime`] if one cannot be written.
pub fn run(args: &Args) -> Result<(), Failure> {
    let mut files: Vec<_> = resource::embedded_files().collect();
    files.sort();
    let Some(folder) = &args.output else {
        let list: String = files.iter().map(|(path, _)| format!("{path}\n")).collect();
        return print(&list);
    };
    let mut list = String::new();
    for (path, bytes) in files {
        let path = folder.join(path);
        write(&path, bytes)?;
        list += &format!("{}\n", path.display());
    }
    print(&list)
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    let failed = |e: std::io::Error| {
        let path = path.display();
        match e.kind() {
            ErrorKind::AlreadyExists => Failure::Input(format!(
                "{path}: exists with other content; choose another --output or move it away"
            )),
            _ => Failure::Runtime(format!("{path}: cannot be written: {e}")),
        }
    };
    if fs::read(path).is_ok_and(|known| known == bytes) {
        return Ok(());
    }
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder).map_err(failed)?;
    }
    let created = OpenOptions::new().write(true).create_new(true).open(path);
    created
        .and_then(|mut file| file.write_all(bytes))
        .map_err(failed)
}
