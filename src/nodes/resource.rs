//! Resources: finding and reading files named by parameters, commands and other nodes, such as `package://fuyu/...`.

use std::path::{Component, Path, PathBuf};

use include_dir::{Dir, include_dir};

use crate::input_file::{self, LARGEST_URDF};

/// Files that come with fuyu, embedded so that a copied executable finds them.
const EMBEDDED: [(&str, Dir); 4] = [
    ("config", include_dir!("$CARGO_MANIFEST_DIR/config")),
    ("launch", include_dir!("$CARGO_MANIFEST_DIR/launch")),
    ("urdf", include_dir!("$CARGO_MANIFEST_DIR/urdf")),
    ("views", include_dir!("$CARGO_MANIFEST_DIR/views")),
];

const OURS: &str = "fuyu";

/// A file that was found.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Resource {
    /// A file on disk.
    File(PathBuf),
    /// A file embedded in this executable.
    Embedded {
        /// `package://fuyu/PATH`.
        name: String,
        /// Content.
        bytes: &'static [u8],
    },
}

impl Resource {
    /// Path of the file, or `package://fuyu/PATH` of an embedded one.
    pub fn path(&self) -> PathBuf {
        match self {
            Self::File(path) => path.clone(),
            Self::Embedded { name, .. } => PathBuf::from(name),
        }
    }

    /// The content, of at most `limit` bytes.
    ///
    /// # Errors
    /// A line that names the file and says why it cannot be read.
    pub fn bytes(&self, limit: u64) -> Result<Vec<u8>, String> {
        match self {
            Self::File(path) => input_file::read(path, limit).map_err(|e| e.to_string()),
            Self::Embedded { bytes, .. } => Ok(bytes.to_vec()),
        }
    }

    /// The content as text, of at most `limit` bytes.
    ///
    /// # Errors
    /// As [`Self::bytes`].
    pub fn text(&self, limit: u64) -> Result<String, String> {
        match self {
            Self::File(path) => input_file::read_text(path, limit).map_err(|e| e.to_string()),
            Self::Embedded { bytes, .. } => Ok(String::from_utf8_lossy(bytes).into_owned()),
        }
    }
}

/// Where files are searched for, in addition to the ROS environment.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Lookup {
    /// Base folder of relative paths, such as the folder of the parameter file that has the path. Files that are not
    /// there are searched for in the working directory.
    pub folder: Option<PathBuf>,
    /// Folders with ROS packages, searched before those of the environment. A folder may also be a package itself.
    pub packages: Vec<PathBuf>,
}

/// [`Lookup::resolve`] with the ROS environment alone, and paths relative to the working directory.
///
/// # Errors
/// As [`Lookup::resolve`].
pub fn resolve(name: &str) -> Result<Resource, String> {
    Lookup::default().resolve(name)
}

impl Lookup {
    /// Finds `name`: a path, or `package://PACKAGE/PATH`. Packages are searched for in the folders of
    /// [`Lookup::packages`], in the share folders of the ROS environment (`AMENT_PREFIX_PATH`), and in and below the
    /// folders of `ROS_PACKAGE_PATH`. The package `fuyu` is then searched for in the install space of the executable,
    /// in the working directory, in the sources from which this program was built, and in the executable, in this
    /// order. A relative path that does not exist, such as `config/servicing.yaml`, is searched for in the executable
    /// only.
    ///
    /// # Errors
    /// A line that lists the searched places.
    pub fn resolve(&self, name: &str) -> Result<Resource, String> {
        let Some(rest) = name.strip_prefix("package://") else {
            return self.resolve_path(name);
        };
        let (package, file) = rest.split_once('/').unwrap_or((rest, ""));
        if package.is_empty() || file.is_empty() || !is_below(file) || !is_below(package) {
            return Err(format!(
                "{name}: expected package://PACKAGE/PATH, without '..', or the path of a file"
            ));
        }
        let folders = self.search_folders(package);
        let found = folders
            .iter()
            .map(|folder| folder.join(file))
            .find(|path| path.exists())
            .map(Resource::File);
        let found = found.or_else(|| (package == OURS).then(|| embedded(file)).flatten());
        found.ok_or_else(|| {
            if folders.is_empty() {
                return format!(
                    "{name}: no package {package} in AMENT_PREFIX_PATH, ROS_PACKAGE_PATH or the given folders; source the workspace that has it, or name the folder that it is in"
                );
            }
            let searched: Vec<_> = folders.iter().map(|p| p.display().to_string()).collect();
            format!("{name}: not found in {}", searched.join(", "))
        })
    }

    fn resolve_path(&self, name: &str) -> Result<Resource, String> {
        let path = PathBuf::from(name);
        if let Some(folder) = self.folder.as_ref().filter(|_| path.is_relative()) {
            // Folders of embedded files are named package://fuyu/FOLDER.
            let candidate = folder.join(&path);
            let found = match candidate.to_str() {
                Some(inside) if inside.starts_with("package://") => resolve(inside).ok(),
                _ => candidate.exists().then_some(Resource::File(candidate)),
            };
            if let Some(found) = found {
                return Ok(found);
            }
        }
        if path.exists() {
            return Ok(Resource::File(path));
        }
        embedded(name).ok_or_else(|| match &self.folder {
            Some(folder) if path.is_relative() && !folder.as_os_str().is_empty() => format!(
                "{name}: no such file in {} or the working directory",
                folder.display()
            ),
            _ => format!("{name}: no such file"),
        })
    }

    /// Reads a robot description that a parameter names. Returns the text and its path.
    ///
    /// # Errors
    /// A line that names the file and says why it cannot be read.
    pub fn read(&self, name: &str) -> Result<(String, String), String> {
        let found = self.resolve(name)?;
        Ok((
            found.text(LARGEST_URDF)?,
            found.path().display().to_string(),
        ))
    }

    /// Candidates for the share folder of `package`.
    fn search_folders(&self, package: &str) -> Vec<PathBuf> {
        let mut folders = Vec::new();
        for folder in &self.packages {
            find_package(folder, package, &mut folders);
        }
        let share = |prefix: &Path| prefix.join("share").join(package);
        let paths = |variable: &str| -> Vec<PathBuf> {
            let value = std::env::var_os(variable).unwrap_or_default();
            let paths = std::env::split_paths(&value);
            paths.filter(|p| !p.as_os_str().is_empty()).collect()
        };
        folders.extend(paths("AMENT_PREFIX_PATH").iter().map(|p| share(p)));
        for folder in paths("ROS_PACKAGE_PATH") {
            find_package(&folder, package, &mut folders);
        }
        if package != OURS {
            return folders;
        }
        // PREFIX/lib/fuyu/EXECUTABLE and PREFIX/bin/EXECUTABLE belong to PREFIX/share/fuyu.
        if let Ok(executable) = std::env::current_exe() {
            folders.extend(executable.ancestors().skip(2).take(2).map(share));
        }
        folders.push(PathBuf::from("."));
        folders.push(Path::new(env!("CARGO_MANIFEST_DIR")).to_owned());
        folders
    }
}

/// Depth below a folder to which packages are searched.
const DEEPEST: usize = 4;
/// Maximum number of folders searched, in case a path names a whole disk.
const MOST_FOLDERS: usize = 20_000;

/// Adds the folders called `package` in `folder`, or `folder` itself. Below the first level, only folders with a
/// `package.xml` count, and packages are not searched for nested packages.
fn find_package(folder: &Path, package: &str, found: &mut Vec<PathBuf>) {
    let is_called = |path: &Path| path.file_name().is_some_and(|name| name == package);
    if is_called(folder) && folder.join("package.xml").is_file() {
        found.push(folder.to_owned());
        return;
    }
    let mut level = vec![folder.to_owned()];
    let mut visited = 0;
    for depth in 0..DEEPEST {
        let mut next = Vec::new();
        for folder in level {
            let Ok(entries) = folder.read_dir() else {
                continue;
            };
            let mut inside: Vec<PathBuf> = entries
                .filter_map(|entry| Some(entry.ok()?.path()))
                .filter(|path| path.is_dir())
                .collect();
            inside.sort();
            for path in inside {
                visited += 1;
                if visited > MOST_FOLDERS {
                    return;
                }
                let is_package = path.join("package.xml").is_file();
                if is_called(&path) && (is_package || depth == 0) {
                    found.push(path);
                } else if !is_package {
                    next.push(path);
                }
            }
        }
        level = next;
    }
}

/// Whether a relative path stays below its base folder.
fn is_below(path: &str) -> bool {
    let mut components = Path::new(path).components();
    components.all(|c| matches!(c, Component::Normal(_) | Component::CurDir))
}

/// The embedded file at `path`, such as `config/servicing.yaml`.
fn embedded(path: &str) -> Option<Resource> {
    let (folder, name) = path.split_once('/')?;
    let (_, dir) = EMBEDDED.iter().find(|(known, _)| *known == folder)?;
    Some(Resource::Embedded {
        name: format!("package://{OURS}/{path}"),
        bytes: dir.get_file(name)?.contents(),
    })
}

/// The embedded files in top-level folders and their direct subfolders: paths, such as `config/servicing.yaml`, and
/// contents.
pub fn embedded_files() -> impl Iterator<Item = (String, &'static [u8])> {
    EMBEDDED.iter().flat_map(|(folder, dir)| {
        let name = move |file: &include_dir::File| format!("{folder}/{}", file.path().display());
        let below = dir.dirs().flat_map(Dir::files);
        let files = dir.files().chain(below);
        files.map(move |f| (name(f), f.contents()))
    })
}

/// The files directly in the folder `name`, by names with which they can be read; `name` itself if it is a file.
///
/// # Errors
/// A line that names the folder and says why it cannot be read.
pub fn list(name: &str) -> Result<Vec<String>, String> {
    let of_package = format!("package://{OURS}/");
    let inside = name
        .strip_prefix(&of_package)
        .map(|f| f.trim_end_matches('/'));
    let path = match resolve(name) {
        Ok(Resource::File(path)) if path.is_dir() => path,
        Ok(_) => return Ok(vec![name.to_owned()]),
        Err(e) => {
            let files = embedded_files().map(|(path, _)| path);
            let inside = inside.map(|folder| format!("{folder}/"));
            let mut names: Vec<_> = files
                .filter(|path| {
                    inside
                        .as_ref()
                        .is_some_and(|folder| path.starts_with(folder))
                })
                .map(|path| of_package.clone() + &path)
                .collect();
            names.sort();
            return if names.is_empty() { Err(e) } else { Ok(names) };
        }
    };
    let entries = path
        .read_dir()
        .map_err(|e| format!("{name}: cannot be read: {e}"))?;
    let mut names: Vec<_> = entries
        .filter_map(|entry| Some(PathBuf::from(entry.ok()?.file_name())))
        .map(|file| format!("{}/{}", name.trim_end_matches('/'), file.display()))
        .collect();
    names.sort();
    Ok(names)
}

/// Folders from which other nodes may name files: paths and `package://PACKAGE/FOLDER`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AllowedFolders(Vec<String>);

impl AllowedFolders {
    /// These folders.
    pub fn new(folders: Vec<String>) -> Self {
        Self(folders)
    }

    /// Finds the file or folder `name` (a path, `file://PATH` or `package://PACKAGE/PATH`) if it is in or below an
    /// allowed folder, also after resolving symbolic links.
    ///
    /// # Errors
    /// A line that does not reveal whether a file outside the folders exists.
    pub fn resolve(&self, name: &str) -> Result<Resource, String> {
        let name = name.strip_prefix("file://").unwrap_or(name);
        let refused = || {
            format!(
                "{name}: not below a folder that this node allows: {}",
                self.0.join(", ")
            )
        };
        let found = match resolve(name) {
            Ok(found) => found,
            // Only files inside the folders may be reported as missing.
            Err(missing) if self.0.iter().any(|f| is_inside(name, f)) => return Err(missing),
            Err(_) => return Err(refused()),
        };
        let is_allowed = self.0.iter().any(|folder| match &found {
            Resource::Embedded { name, .. } => is_inside(name, folder),
            Resource::File(path) => match (resolve(folder), path.canonicalize()) {
                (Ok(Resource::File(folder)), Ok(path)) => folder
                    .canonicalize()
                    .is_ok_and(|folder| path.starts_with(folder)),
                _ => false,
            },
        });
        is_allowed.then_some(found).ok_or_else(refused)
    }
}

/// Whether `name` is `folder` or below it, judged by the text alone.
fn is_inside(name: &str, folder: &str) -> bool {
    let (name, folder) = (Path::new(name), Path::new(folder));
    let climbs = name.components().any(|c| c == Component::ParentDir);
    name.starts_with(folder) && !climbs
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_file_of_the_package_is_embedded() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR"));
        let mut count = 0;
        for folder in ["config", "config/campaigns", "launch", "urdf", "views"] {
            for entry in root.join(folder).read_dir().unwrap() {
                let path = entry.unwrap().path();
                if path.is_dir() {
                    continue;
                }
                let name = format!("{folder}/{}", path.file_name().unwrap().display());
                let Some(Resource::Embedded { bytes, .. }) = embedded(&name) else {
                    panic!("{name} is not embedded");
                };
                assert_eq!(bytes, std::fs::read(path).unwrap());
                count += 1;
            }
        }
        assert_eq!(embedded_files().count(), count);
    }

    #[test]
    fn package_paths_do_not_leave_the_package() {
        for name in [
            "package://fuyu/../../etc/passwd",
            "package://fuyu/urdf/../../x",
            "package://fuyu//etc/passwd",
            "package://fuyu",
            "package:///urdf/servicer.urdf",
        ] {
            let error = resolve(name).unwrap_err();
            assert!(error.contains("expected package://"), "{error}");
        }
        assert!(resolve("package://fuyu/urdf/servicer.urdf").is_ok());
    }

    fn folder_with(files: &[&str]) -> tempfile::TempDir {
        let dir = tempfile::tempdir().unwrap();
        for file in files {
            let path = dir.path().join(file);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, *file).unwrap();
        }
        dir
    }

    #[test]
    fn relative_paths_are_relative_to_their_file_first() {
        let dir = folder_with(&["robots/arm.urdf", "arm.urdf"]);
        let lookup = Lookup {
            folder: Some(dir.path().join("robots")),
            ..Lookup::default()
        };
        assert_eq!(lookup.read("arm.urdf").unwrap().0, "robots/arm.urdf");
        assert_eq!(lookup.read("../arm.urdf").unwrap().0, "arm.urdf");
        // The tests' working directory is that of the package.
        assert!(lookup.read("urdf/servicer.urdf").is_ok());
        let error = lookup.resolve("none.urdf").unwrap_err();
        assert!(error.contains("robots or the working directory"), "{error}");
        let embedded = Lookup {
            folder: Some(PathBuf::from("package://fuyu/config")),
            ..Lookup::default()
        };
        assert!(embedded.resolve("servicing.yaml").is_ok());
    }

    #[test]
    fn packages_are_found_in_folders_with_packages() {
        let dir = folder_with(&[
            "near/meshes/a.stl",
            "src/arms/deep/package.xml",
            "src/arms/deep/urdf/deep.urdf",
            "src/arms/deep/inner/hidden/package.xml",
            "src/arms/folder/urdf/folder.urdf",
        ]);
        let found = |folder: &Path, name: &str| {
            let lookup = Lookup {
                packages: vec![folder.to_owned()],
                ..Lookup::default()
            };
            lookup.resolve(name).is_ok()
        };
        assert!(found(dir.path(), "package://near/meshes/a.stl"));
        assert!(found(dir.path(), "package://deep/urdf/deep.urdf"));
        let itself = dir.path().join("src/arms/deep");
        assert!(found(&itself, "package://deep/urdf/deep.urdf"));
        // No package.xml, or inside of another package.
        assert!(!found(dir.path(), "package://folder/urdf/folder.urdf"));
        assert!(!found(dir.path(), "package://hidden/package.xml"));
        let error = resolve("package://none/a.urdf").unwrap_err();
        assert!(error.contains("package://none/a.urdf"), "{error}");
    }

    #[test]
    fn peers_cannot_probe_paths() {
        let dir = tempfile::tempdir().unwrap();
        let inside = dir.path().join("inside");
        std::fs::create_dir(&inside).unwrap();
        std::fs::write(inside.join("a.urdf"), "<robot/>").unwrap();
        std::fs::write(dir.path().join("secret"), "x").unwrap();
        std::os::unix::fs::symlink(dir.path().join("secret"), inside.join("link")).unwrap();
        let allowed = AllowedFolders::new(vec![
            inside.display().to_string(),
            "package://fuyu/urdf".to_owned(),
        ]);
        let at = |name: &str| dir.path().join(name).display().to_string();
        assert!(allowed.resolve(&at("inside/a.urdf")).is_ok());
        assert!(
            allowed
                .resolve(&format!("file://{}", at("inside/a.urdf")))
                .is_ok()
        );
        assert!(allowed.resolve("package://fuyu/urdf/target.urdf").is_ok());
        // Responses for existing and missing files outside differ in the name only.
        let kind = |name: &str| {
            let error = allowed.resolve(name).unwrap_err();
            error.replace(name, "NAME")
        };
        let outside = kind(&at("secret"));
        assert!(outside.contains("not below a folder"), "{outside}");
        for name in [
            at("none"),
            at("inside/../secret"),
            at("inside/../none"),
            at("inside/link"),
            "/etc/passwd".to_owned(),
            "/dev/zero".to_owned(),
            "package://fuyu/config/servicing.yaml".to_owned(),
            "package://fuyu/config/none.yaml".to_owned(),
        ] {
            assert_eq!(kind(&name), outside, "{name}");
        }
        assert!(kind(&at("inside/none")).contains("no such file"));
        // A named pipe without a writer does not block.
        let made = std::process::Command::new("mkfifo")
            .arg(at("inside/pipe"))
            .status();
        assert!(made.unwrap().success());
        let pipe = allowed.resolve(&at("inside/pipe")).unwrap();
        assert!(pipe.text(LARGEST_URDF).unwrap_err().contains("named pipe"));
    }
}
