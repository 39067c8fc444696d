//! YAML of ROS parameter files, parsed to a tree with the location of each value.

use serde::de::{self, Deserialize, Deserializer, MapAccess, SeqAccess, Visitor};
use serde_saphyr::{Location, Spanned};
use std::fmt;

use super::ParameterValue;

/// A node of the YAML tree.
#[derive(Debug, Clone)]
pub(in crate::ros) enum Tree {
    Null,
    Bool(bool),
    Integer(i64),
    Double(f64),
    Text(String),
    List(Vec<Spanned<Tree>>),
    Map(Vec<(Spanned<String>, Spanned<Tree>)>),
}

impl Tree {
    pub(in crate::ros) fn kind(&self) -> &'static str {
        match self {
            Self::Null => "nothing",
            Self::Bool(_) => "a bool",
            Self::Integer(_) => "an integer",
            Self::Double(_) => "a double",
            Self::Text(_) => "a string",
            Self::List(_) => "a list",
            Self::Map(_) => "a mapping",
        }
    }

    /// Converts a scalar or list to a parameter value.
    ///
    /// # Errors
    /// Location and reason, with the allowed values.
    pub(in crate::ros) fn value(&self, at: Location) -> Result<ParameterValue, (Location, String)> {
        match self {
            Self::Bool(v) => Ok(ParameterValue::Bool(*v)),
            Self::Integer(v) => Ok(ParameterValue::Integer(*v)),
            Self::Double(v) => Ok(ParameterValue::Double(*v)),
            Self::Text(v) => Ok(ParameterValue::String(v.clone())),
            Self::List(items) => list(items),
            Self::Null => Err((
                at,
                "no value; write one, or \"\" for an empty string".to_owned(),
            )),
            Self::Map(_) => Err((
                at,
                "a mapping is no value; expected a scalar or a list of scalars".to_owned(),
            )),
        }
    }
}

/// The first element of a list determines its type; the others must have the same type.
fn list(items: &[Spanned<Tree>]) -> Result<ParameterValue, (Location, String)> {
    let Some(first) = items.first() else {
        // An empty list has no type yet: `ParameterValue::fit` converts it to any list type.
        return Ok(ParameterValue::IntegerArray(Vec::new()));
    };
    fn collect<T>(
        items: &[Spanned<Tree>],
        of: &str,
        take: impl Fn(&Tree) -> Option<T>,
    ) -> Result<Vec<T>, (Location, String)> {
        let mixed = |item: &Spanned<Tree>| {
            let hint = match (&item.value, of) {
                (Tree::Integer(i), "a double") => format!("; write {i}.0"),
                (Tree::Double(_), "an integer") => {
                    "; write every number with a decimal point, as in 1.0".to_owned()
                }
                _ => String::new(),
            };
            let kind = item.value.kind();
            let text = format!("{kind} in a list that starts with {of}{hint}");
            (item.referenced, text)
        };
        items
            .iter()
            .map(|i| take(&i.value).ok_or_else(|| mixed(i)))
            .collect()
    }
    let of = first.value.kind();
    match &first.value {
        Tree::Bool(_) => collect(items, of, |t| match t {
            Tree::Bool(v) => Some(*v),
            _ => None,
        })
        .map(ParameterValue::BoolArray),
        Tree::Integer(_) => collect(items, of, |t| match t {
            Tree::Integer(v) => Some(*v),
            _ => None,
        })
        .map(ParameterValue::IntegerArray),
        Tree::Double(_) => collect(items, of, |t| match t {
            Tree::Double(v) => Some(*v),
            _ => None,
        })
        .map(ParameterValue::DoubleArray),
        Tree::Text(_) => collect(items, of, |t| match t {
            Tree::Text(v) => Some(v.clone()),
            _ => None,
        })
        .map(ParameterValue::StringArray),
        other => Err((
            first.referenced,
            format!(
                "{} in a list; ROS parameters have lists of scalars only, flatten it with dotted names",
                other.kind()
            ),
        )),
    }
}

/// Parses a YAML document.
///
/// # Errors
/// Location and reason, if it is not valid YAML.
pub(in crate::ros) fn parse(text: &str) -> Result<Spanned<Tree>, (Option<Location>, String)> {
    let options = serde_saphyr::options! {
        non_finite_float_policy: serde_saphyr::options::NonFiniteFloatPolicy::PassThrough,
        // Limits the expansion of nested aliases, which turns a few lines into megabytes.
        alias_limits: serde_saphyr::alias_limits! {
            max_total_replayed_events: 100_000,
        },
    };
    serde_saphyr::from_str_with_options(text, options).map_err(|e| {
        let plain = e.without_snippet();
        (plain.location(), brief(&plain.to_string()))
    })
}

/// Parses one value, as in `-p name:=value`.
pub(super) fn parse_value(text: &str) -> Result<ParameterValue, String> {
    let tree = parse(text).map_err(|(_, e)| e)?;
    tree.value.value(tree.referenced).map_err(|(_, e)| e)
}

/// Shortens the parser's message: without its location, which the caller adds, and without hints for programmers.
fn brief(text: &str) -> String {
    let line = text.lines().next().unwrap_or_default();
    let ends = [" at line ", ", set DuplicateKeyPolicy"];
    let end = ends.iter().filter_map(|e| line.find(e)).min();
    line[..end.unwrap_or(line.len())].to_owned()
}

impl<'de> Deserialize<'de> for Tree {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(TreeVisitor)
    }
}

struct TreeVisitor;

impl<'de> Visitor<'de> for TreeVisitor {
    type Value = Tree;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a scalar, a list or a mapping")
    }

    fn visit_unit<E>(self) -> Result<Tree, E> {
        Ok(Tree::Null)
    }

    fn visit_bool<E>(self, v: bool) -> Result<Tree, E> {
        Ok(Tree::Bool(v))
    }

    fn visit_i64<E>(self, v: i64) -> Result<Tree, E> {
        Ok(Tree::Integer(v))
    }

    fn visit_u64<E: de::Error>(self, v: u64) -> Result<Tree, E> {
        i64::try_from(v)
            .map(Tree::Integer)
            .map_err(|_| E::custom(format!("{v} does not fit 64 bits with a sign")))
    }

    fn visit_f64<E>(self, v: f64) -> Result<Tree, E> {
        Ok(Tree::Double(v))
    }

    fn visit_str<E>(self, v: &str) -> Result<Tree, E> {
        Ok(Tree::Text(v.to_owned()))
    }

    fn visit_string<E>(self, v: String) -> Result<Tree, E> {
        Ok(Tree::Text(v))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<Tree, A::Error> {
        let mut items = Vec::new();
        while let Some(item) = seq.next_element()? {
            items.push(item);
        }
        Ok(Tree::List(items))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Tree, A::Error> {
        let mut entries = Vec::new();
        while let Some(entry) = map.next_entry()? {
            entries.push(entry);
        }
        Ok(Tree::Map(entries))
    }
}
