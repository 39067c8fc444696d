//! ROS 2 parameter files.
//!
//! ```yaml
//! dynamics:                # this node, in any namespace
//!   ros__parameters:
//!     time_step: 0.01
//!     target: {mass: 900.0}  # the parameter `target.mass`
//! /chaser/camera:          # this node only
//!   ros__parameters: {rate: 30.0}
//! /**:                     # every node; `/chaser/*` is every node of a namespace
//!   ros__parameters: {use_sim_time: true}
//! ```
//! Later lines override earlier ones. A name without a leading slash matches a node of that name in any namespace, so
//! that one scenario serves several robots; in rclcpp it matches in `/` only.

use serde_saphyr::{Location, Spanned};
use std::{
    fmt,
    path::{Path, PathBuf},
};

use super::{
    NodeName,
    params::{
        Override, ParameterValue, Source,
        yaml::{self, Tree},
    },
};
use crate::input_file::{self, LARGEST_YAML};

const PARAMETERS: &str = "ros__parameters";

/// Error in a ROS 2 parameter file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ParamsFileError {
    file: PathBuf,
    line: Option<u64>,
    field: String,
    problem: String,
}

impl fmt::Display for ParamsFileError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.file.display())?;
        if let Some(line) = self.line {
            write!(f, ":{line}")?;
        }
        if !self.field.is_empty() {
            write!(f, ": {}", self.field)?;
        }
        write!(f, ": {}", self.problem)
    }
}

impl std::error::Error for ParamsFileError {}

/// Parameters of all nodes that match a pattern.
#[derive(Debug, Clone, PartialEq)]
struct Section {
    /// Tokens of the pattern; an absolute pattern starts with an empty token.
    pattern: Vec<String>,
    parameters: Vec<(String, ParameterValue, u64)>,
}

/// A parsed and checked parameter file.
#[derive(Debug, Clone, PartialEq)]
pub struct ParamsFile {
    file: PathBuf,
    sections: Vec<Section>,
}

impl ParamsFile {
    /// Reads a file.
    ///
    /// # Errors
    /// [`ParamsFileError`] with file, line, field and the allowed values.
    pub fn read(path: impl AsRef<Path>) -> Result<Self, ParamsFileError> {
        let path = path.as_ref();
        let text = input_file::read_text(path, LARGEST_YAML).map_err(|e| ParamsFileError {
            file: path.to_owned(),
            line: None,
            field: String::new(),
            problem: e.problem(),
        })?;
        Self::parse(path, &text)
    }

    /// Parses `text`; errors name the file `path`.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn parse(path: impl AsRef<Path>, text: &str) -> Result<Self, ParamsFileError> {
        let mut reader = Reader {
            file: path.as_ref().to_owned(),
            sections: Vec::new(),
        };
        let tree = yaml::parse(text)
            .map_err(|(at, problem)| reader.error(at, "", format!("not valid YAML: {problem}")))?;
        match &tree.value {
            Tree::Null => {}
            Tree::Map(_) => reader.nodes(&[], &tree)?,
            other => {
                let kind = other.kind();
                let problem =
                    format!("expected `node_name:` with `{PARAMETERS}:` below it, found {kind}");
                return Err(reader.error(Some(tree.referenced), "", problem));
            }
        }
        Ok(Self {
            file: reader.file,
            sections: reader.sections,
        })
    }

    /// Parameters of the node `name` in the order of the file; of two with the same name the last one applies.
    pub fn overrides(&self, name: &NodeName) -> Vec<Override> {
        let full = name.full();
        let tokens: Vec<&str> = full[1..].split('/').collect();
        let file = self.file.display().to_string();
        self.sections
            .iter()
            .filter(|s| s.matches(name, &tokens))
            .flat_map(|s| s.parameters.iter().map(|p| (p, s.is_shared())))
            .map(|((name, value, line), shared)| Override {
                shared,
                name: name.clone(),
                value: value.clone(),
                source: Source::File {
                    file: file.clone(),
                    line: *line,
                },
            })
            .collect()
    }

    /// Nodes that the file names without a wildcard, in its order, without repetition.
    pub fn nodes(&self) -> Vec<NodeName> {
        let mut nodes = Vec::new();
        for section in &self.sections {
            let Some((name, namespace)) = section.pattern.split_last() else {
                continue;
            };
            // Patterns with wildcards are invalid node names and are skipped here.
            if let Ok(node) = NodeName::new(&namespace.join("/"), name)
                && !nodes.contains(&node)
            {
                nodes.push(node);
            }
        }
        nodes
    }
}

impl Section {
    fn is_shared(&self) -> bool {
        self.pattern.iter().any(|token| token.contains('*'))
    }

    fn matches(&self, name: &NodeName, tokens: &[&str]) -> bool {
        let pattern: Vec<&str> = self.pattern.iter().map(String::as_str).collect();
        match pattern.as_slice() {
            ["", pattern @ ..] => matches(pattern, tokens),
            [single] if !single.contains('*') => *single == name.name(),
            relative => matches(relative, tokens),
        }
    }
}

/// Whether a pattern matches a node's name: `*` stands for one token, `**` for any number of tokens.
fn matches(pattern: &[&str], tokens: &[&str]) -> bool {
    match (pattern, tokens) {
        ([], []) => true,
        (["**", rest @ ..], _) => {
            (0..=tokens.len()).any(|skipped| matches(rest, &tokens[skipped..]))
        }
        (["*", rest @ ..], [_, others @ ..]) => matches(rest, others),
        ([first, rest @ ..], [token, others @ ..]) => first == token && matches(rest, others),
        _ => false,
    }
}

struct Reader {
    file: PathBuf,
    sections: Vec<Section>,
}

impl Reader {
    fn error(
        &self,
        at: Option<Location>,
        field: impl Into<String>,
        problem: impl Into<String>,
    ) -> ParamsFileError {
        ParamsFileError {
            file: self.file.clone(),
            line: at.map(|l| l.line()).filter(|l| *l > 0),
            field: field.into(),
            problem: problem.into(),
        }
    }

    /// Reads the levels of namespaces and nodes down to `ros__parameters`.
    fn nodes(&mut self, above: &[String], tree: &Spanned<Tree>) -> Result<(), ParamsFileError> {
        let shown = above.join("/");
        let Tree::Map(entries) = &tree.value else {
            let kind = tree.value.kind();
            let problem = format!("expected `{PARAMETERS}:` below a node's name, found {kind}");
            return Err(self.error(Some(tree.referenced), shown, problem));
        };
        for (key, value) in entries {
            let at = Some(key.referenced);
            if key.value == PARAMETERS {
                if above.is_empty() {
                    let problem = "expected a node's name above it, as in `dynamics:`, or `/**:`";
                    return Err(self.error(at, PARAMETERS, problem));
                }
                let mut parameters = Vec::new();
                self.parameters(&shown, "", value, &mut parameters)?;
                self.sections.push(Section {
                    pattern: above.to_vec(),
                    parameters,
                });
                continue;
            }
            let tokens = key.value.split('/').map(str::to_owned);
            let mut path = above.to_vec();
            // Within a namespace, `/camera` and `camera` are the same.
            path.extend(tokens.skip(usize::from(!above.is_empty() && key.value.starts_with('/'))));
            check_pattern(&path).map_err(|problem| self.error(at, key.value.clone(), problem))?;
            if !matches!(value.value, Tree::Map(_)) {
                let problem = match &value.value {
                    Tree::Null => format!("expected `{PARAMETERS}:` below it, found nothing"),
                    other => format!(
                        "expected `{PARAMETERS}:` below it, found {}; a parameter belongs below \
                         `{PARAMETERS}:`",
                        other.kind()
                    ),
                };
                return Err(self.error(at, path.join("/"), problem));
            }
            self.nodes(&path, value)?;
        }
        Ok(())
    }

    /// Reads parameters; nested mappings become dotted names.
    fn parameters(
        &self,
        node: &str,
        prefix: &str,
        tree: &Spanned<Tree>,
        into: &mut Vec<(String, ParameterValue, u64)>,
    ) -> Result<(), ParamsFileError> {
        match &tree.value {
            Tree::Map(entries) => {
                for (key, value) in entries {
                    if key.value.is_empty() {
                        let problem = "a parameter must have a name";
                        return Err(self.error(Some(key.referenced), node, problem));
                    }
                    let name = if prefix.is_empty() {
                        key.value.clone()
                    } else {
                        format!("{prefix}.{}", key.value)
                    };
                    self.parameters(node, &name, value, into)?;
                }
                Ok(())
            }
            // A node without parameters is valid.
            Tree::Null if prefix.is_empty() => Ok(()),
            other if prefix.is_empty() => {
                let problem = format!("expected `name: value` lines, found {}", other.kind());
                let field = format!("{node}: {PARAMETERS}");
                Err(self.error(Some(tree.referenced), field, problem))
            }
            value => {
                let value = value.value(tree.referenced).map_err(|(at, problem)| {
                    self.error(Some(at), format!("{node}: {prefix}"), problem)
                })?;
                into.push((prefix.to_owned(), value, tree.referenced.line()));
                Ok(())
            }
        }
    }
}

/// Checks that the tokens can match a node's name; wildcards must be whole tokens.
fn check_pattern(tokens: &[String]) -> Result<(), String> {
    let absolute = usize::from(tokens.first().is_some_and(String::is_empty));
    for token in &tokens[absolute..] {
        if token != "*" && token != "**" {
            NodeName::new("/", token)
                .map_err(|e| format!("{e}; or `*` for one name, `**` for any number"))?;
        }
    }
    Ok(())
}

#[cfg(test)]
#[path = "params_file_tests.rs"]
mod tests;
