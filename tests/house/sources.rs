//! The sources as text.

use std::{
    fs,
    path::{Path, PathBuf},
};

/// The folder of the workspace.
pub fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// A file, by its path below the folder of the workspace.
pub fn read(path: impl AsRef<Path>) -> String {
    let path = root().join(path);
    fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// Names of the packages of the workspace and their folders.
pub const PACKAGES: [(&str, &str); 8] = [
    ("fuyu", ""),
    ("fuyu-campaign", "crates/fuyu-campaign"),
    ("fuyu-lti", "crates/fuyu-lti"),
    ("fuyu-physics", "crates/fuyu-physics"),
    ("fuyu-render", "crates/fuyu-render"),
    ("fuyu-ros", "crates/fuyu-ros"),
    ("fuyu-structures", "crates/fuyu-structures"),
    ("fuyu-track", "crates/fuyu-track"),
];

/// One Rust file below the `src` of a package.
pub struct Source {
    /// The package's name.
    pub package: &'static str,
    /// Relative to the package's `src`, such as `nodes/dynamics/mod.rs`.
    pub path: PathBuf,
    /// Its text.
    pub text: String,
}

impl Source {
    /// Package and path, for messages.
    pub fn location(&self) -> String {
        format!("{} src/{}", self.package, self.path.display())
    }

    /// The module below the crate's root, such as `nodes`; `lib`, `main` or `bin` for the roots.
    pub fn module(&self) -> String {
        let first = self.path.iter().next().unwrap().to_string_lossy();
        first.trim_end_matches(".rs").to_owned()
    }

    /// How many `super` lead from the file's module to the crate's root.
    fn depth(&self) -> usize {
        let folders = self.path.components().count() - 1;
        folders + usize::from(self.path.file_name().unwrap() != "mod.rs")
    }

    /// The items that the file names directly below `root` (`crate` or `std`), including grouped imports:
    /// `use crate::{model::Model, ros}` names `model` and `ros`.
    pub fn names_below(&self, root: &str) -> Vec<String> {
        let code = self.code();
        let mut names = Vec::new();
        for (at, _) in code.match_indices(&format!("{root}::")) {
            let part_of_a_word = code[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_');
            if !part_of_a_word {
                names.extend(first_names(&code[at + root.len() + 2..]));
            }
        }
        if root == "crate" {
            let to_root = "super::".repeat(self.depth());
            for (at, _) in code.match_indices(&to_root) {
                names.extend(first_names(&code[at + to_root.len()..]));
            }
        }
        names
    }

    /// The text without comments.
    fn code(&self) -> String {
        let uncommented = self
            .text
            .lines()
            .map(|l| l.split("//").next().unwrap_or(""));
        uncommented.collect::<Vec<_>>().join("\n")
    }
}

/// The leading name of a path, or those of a group in braces.
fn first_names(code: &str) -> Vec<String> {
    let word = |s: &str| -> String {
        let end = s.find(|c: char| !c.is_alphanumeric() && c != '_');
        s[..end.unwrap_or(s.len())].to_owned()
    };
    let Some(group) = code.strip_prefix('{') else {
        return vec![word(code)];
    };
    let (mut names, mut depth, mut start) = (Vec::new(), 0, 0);
    for (i, c) in group.char_indices() {
        match c {
            '{' => depth += 1,
            '}' if depth > 0 => depth -= 1,
            ',' | '}' if depth == 0 => {
                names.push(word(group[start..i].trim_start()));
                start = i + 1;
                if c == '}' {
                    break;
                }
            }
            _ => {}
        }
    }
    names
}

/// Every Rust file below the `src` of every package.
pub fn sources() -> Vec<Source> {
    let mut sources = Vec::new();
    for (package, folder) in PACKAGES {
        let src = root().join(folder).join("src");
        sources.extend(rust_files(&src).into_iter().map(|path| Source {
            package,
            text: fs::read_to_string(&path).unwrap(),
            path: path.strip_prefix(&src).unwrap().to_owned(),
        }));
    }
    sources
}

/// Every Rust file below a folder, in order.
pub fn rust_files(folder: &Path) -> Vec<PathBuf> {
    let mut folders = vec![folder.to_owned()];
    let mut files = Vec::new();
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e == "rs") {
                files.push(path);
            }
        }
    }
    files.sort();
    files
}

// The layer tests rely on this search: it must find every spelling of an import.
#[test]
fn names_are_found_in_every_spelling() {
    let source = |path: &str, text: &str| Source {
        package: "fuyu",
        path: path.into(),
        text: text.to_owned(),
    };
    let text = "
        use crate::{model::{Model, Frame}, ros, // crate::bag
            msg::{a, b},};
        use std::{fs, io::{self, Write}};
        fn f(x: crate::nodes::World) -> std::env::Args {}
        use super::super::vision::Camera;
        use super::helper;
    ";
    let deep = source("control/law.rs", text);
    let expected = ["model", "ros", "msg", "", "nodes", "vision"];
    assert_eq!(deep.names_below("crate"), expected);
    assert_eq!(deep.names_below("std"), ["fs", "io", "env"]);
    let shallow = source("control/mod.rs", "use super::bag::Bag;");
    assert_eq!(shallow.names_below("crate"), ["bag"]);
}
