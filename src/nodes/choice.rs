//! Enumerated parameters: the value is one of a list of names.

use crate::ros::{Declare, params::Declaration};

/// The value with the name `text`.
///
/// # Errors
/// Lists the names.
pub fn find<T: Copy>(names: &[(&'static str, T)], text: &str) -> Result<T, String> {
    let found = names.iter().find(|(name, _)| *name == text);
    found
        .map(|(_, value)| *value)
        .ok_or_else(|| format!("'{text}' is not one of {}", list(names)))
}

/// The name of `value`.
pub fn name_of<T: PartialEq>(names: &[(&'static str, T)], value: &T) -> &'static str {
    names
        .iter()
        .find(|(_, v)| v == value)
        .map_or("", |(name, _)| name)
}

/// Declares a parameter whose value is one of `names`, by default the first.
pub fn declare<'a, T: Copy + Send + Sync + 'static>(
    declare: &'a mut Declare,
    name: &str,
    names: &'static [(&'static str, T)],
    description: &str,
) -> Declaration<'a, String> {
    let all = list(names);
    declare
        .param(name, names[0].0, &format!("{description}: {all}"))
        .check(&format!("one of {all}"), move |text| {
            find(names, text).map(|_| ())
        })
}

/// All names, for a message.
pub fn list<T>(names: &[(&'static str, T)]) -> String {
    let names: Vec<_> = names.iter().map(|(name, _)| *name).collect();
    names.join(", ")
}
