//! Folders for bags requested by other nodes: any node can call the service `record`, which creates folders.

use std::path::{Component, Path, PathBuf, absolute};

/// Folders below which the service `record` may create bags.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RecordFolders(Vec<String>);

impl RecordFolders {
    /// Relative folders are relative to the working directory.
    pub fn new(folders: Vec<String>) -> Self {
        Self(folders)
    }

    /// The folder that a caller names with `uri`, if it is below an allowed folder, also after resolving symbolic
    /// links.
    ///
    /// # Errors
    /// A line that lists the allowed folders.
    pub fn allow(&self, uri: &str) -> Result<PathBuf, String> {
        let path = PathBuf::from(uri.strip_prefix("file://").unwrap_or(uri));
        match self
            .0
            .iter()
            .any(|folder| is_below(&path, Path::new(folder)))
        {
            true => Ok(path),
            false => Err(format!(
                "{uri}: this recorder creates bags only below {}; its parameter record_folders allows others",
                self.0.join(", ")
            )),
        }
    }
}

fn is_below(path: &Path, folder: &Path) -> bool {
    let (Ok(path), Ok(folder)) = (absolute(path), absolute(folder)) else {
        return false;
    };
    let climbs = path.components().any(|c| c == Component::ParentDir);
    if climbs || path == folder || !path.starts_with(&folder) {
        return false;
    }
    // The existing part of the path must not lead outside by a symbolic link.
    let existing = path.ancestors().find(|p| p.symlink_metadata().is_ok());
    match existing {
        Some(existing) if existing.starts_with(&folder) => {
            match (existing.canonicalize(), folder.canonicalize()) {
                (Ok(existing), Ok(folder)) => existing.starts_with(folder),
                _ => false,
            }
        }
        _ => true,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bags_stay_below_the_folders() {
        let dir = tempfile::tempdir().unwrap();
        let bags = dir.path().join("bags");
        let outside = dir.path().join("outside");
        std::fs::create_dir_all(bags.join("old")).unwrap();
        std::fs::create_dir(&outside).unwrap();
        std::os::unix::fs::symlink(&outside, bags.join("link")).unwrap();
        let later = dir.path().join("later");
        let folders = RecordFolders::new([&bags, &later].map(|f| f.display().to_string()).to_vec());
        let allowed = |path: PathBuf| folders.allow(&path.display().to_string()).is_ok();
        assert!(allowed(bags.join("run")));
        assert!(allowed(bags.join("old/run")));
        assert!(
            allowed(later.join("run")),
            "a folder that is created with the bag"
        );
        for path in [
            bags.clone(),
            bags.join("../outside/run"),
            bags.join("link/run"),
            bags.join("link"),
            outside.join("run"),
            dir.path().join("bagsrun"),
            PathBuf::from("/tmp/x"),
        ] {
            assert!(!allowed(path.clone()), "{}", path.display());
        }
        let default = RecordFolders::new(vec!["bags".to_owned()]);
        assert!(default.allow("bags/run").is_ok());
        let error = default.allow("/etc/x").unwrap_err();
        assert!(error.contains("only below bags"), "{error}");
    }
}
