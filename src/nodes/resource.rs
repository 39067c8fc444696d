//! Finding the files that parameters name.

use std::path::{Path, PathBuf};

/// Resolves `name`: a path, or `package://fuyu/PATH`. The latter is searched for in the share folders of the ROS
/// environment (`AMENT_PREFIX_PATH`), in that of the executable's install space, in the working directory and in the
/// sources that this program was built from, in that order.
///
/// # Errors
/// A line with the places that were searched.
pub fn resolve(name: &str) -> Result<PathBuf, String> {
    let Some(rest) = name.strip_prefix("package://") else {
        let path = PathBuf::from(name);
        return if path.exists() {
            Ok(path)
        } else {
            Err(format!("{name}: no such file"))
        };
    };
    let (package, file) = rest.split_once('/').unwrap_or((rest, ""));
    if package != "fuyu" || file.is_empty() {
        return Err(format!(
            "{name}: expected package://fuyu/PATH or the path of a file"
        ));
    }
    let folders = search_folders();
    let found = folders
        .iter()
        .map(|folder| folder.join(file))
        .find(|path| path.exists());
    found.ok_or_else(|| {
        let searched: Vec<_> = folders.iter().map(|p| p.display().to_string()).collect();
        format!("{name}: not found in {}", searched.join(", "))
    })
}

/// Folders that may be the share folder of this package.
fn search_folders() -> Vec<PathBuf> {
    let mut folders = Vec::new();
    if let Some(prefixes) = std::env::var_os("AMENT_PREFIX_PATH") {
        folders.extend(std::env::split_paths(&prefixes).map(|p| p.join("share/fuyu")));
    }
    // PREFIX/lib/fuyu/EXECUTABLE and PREFIX/bin/EXECUTABLE belong to PREFIX/share/fuyu.
    if let Ok(executable) = std::env::current_exe() {
        folders.extend(
            executable
                .ancestors()
                .skip(2)
                .take(2)
                .map(|p| p.join("share/fuyu")),
        );
    }
    folders.push(PathBuf::from("."));
    folders.push(Path::new(env!("CARGO_MANIFEST_DIR")).to_owned());
    folders
}

/// Reads a text file that a parameter names. Returns the text and its path.
///
/// # Errors
/// A line with the file and why it cannot be read.
pub fn read(name: &str) -> Result<(String, String), String> {
    let path = resolve(name)?;
    let shown = path.display().to_string();
    let text =
        std::fs::read_to_string(&path).map_err(|e| format!("{shown}: cannot be read: {e}"))?;
    Ok((text, shown))
}
