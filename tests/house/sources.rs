//! The sources as text.

use std::{
    fs,
    path::{Path, PathBuf},
};

/// The package's folder.
pub fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// A file of the package.
pub fn read(path: impl AsRef<Path>) -> String {
    let path = root().join(path);
    fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// One Rust file below `src`.
pub struct Source {
    /// Relative to `src`, such as `nodes/dynamics/mod.rs`.
    pub path: PathBuf,
    /// Its text.
    pub text: String,
}

impl Source {
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

    /// The items that it names directly below `root` (`crate` or `std`), in grouped imports too:
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

/// Every Rust file below `src`.
pub fn sources() -> Vec<Source> {
    let src = root().join("src");
    let mut folders = vec![src.clone()];
    let mut sources = Vec::new();
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e == "rs") {
                sources.push(Source {
                    text: fs::read_to_string(&path).unwrap(),
                    path: path.strip_prefix(&src).unwrap().to_owned(),
                });
            }
        }
    }
    sources.sort_by(|a, b| a.path.cmp(&b.path));
    sources
}

// The search itself must see what it is meant to forbid.
#[test]
fn names_are_found_in_every_spelling() {
    let source = |path: &str, text: &str| Source {
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
