//! Finding the files that parameters name.

use std::path::{Path, PathBuf};

/// Resolves `name`: a path as it stands, or `package://fuyu/PATH`, which is looked for in the share
/// folders of the ROS environment (`AMENT_PREFIX_PATH`), beside the executable's install space, in the
/// working directory and in the sources that this program was built from, in that order.
///
/// # Errors
/// Says where it was looked for.
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
    let places = places();
    let found = places
        .iter()
        .map(|place| place.join(file))
        .find(|path| path.exists());
    found.ok_or_else(|| {
        let looked: Vec<_> = places.iter().map(|p| p.display().to_string()).collect();
        format!("{name}: not found in {}", looked.join(", "))
    })
}

fn places() -> Vec<PathBuf> {
    let mut places = Vec::new();
    if let Some(prefixes) = std::env::var_os("AMENT_PREFIX_PATH") {
        places.extend(std::env::split_paths(&prefixes).map(|p| p.join("share/fuyu")));
    }
    // PREFIX/lib/fuyu/EXECUTABLE and PREFIX/bin/EXECUTABLE both have PREFIX/share/fuyu beside them.
    if let Ok(executable) = std::env::current_exe() {
        places.extend(
            executable
                .ancestors()
                .skip(2)
                .take(2)
                .map(|p| p.join("share/fuyu")),
        );
    }
    places.push(PathBuf::from("."));
    places.push(Path::new(env!("CARGO_MANIFEST_DIR")).to_owned());
    places
}

/// Reads a text file that a parameter names; gives the text and the path it came from.
///
/// # Errors
/// Says which file and why.
pub fn read(name: &str) -> Result<(String, String), String> {
    let path = resolve(name)?;
    let shown = path.display().to_string();
    let text =
        std::fs::read_to_string(&path).map_err(|e| format!("{shown}: cannot be read: {e}"))?;
    Ok((text, shown))
}
