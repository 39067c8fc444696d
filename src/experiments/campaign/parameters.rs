//! Parameters of a scenario by their dotted names, `NODE.PARAMETER` or `NODE.PARAMETER[ELEMENT]`.

use std::collections::BTreeMap;

use super::row::{Cell, ColumnKind};
use crate::{
    nodes::scenario::{Declared, Scenario},
    ros::{NodeName, ParameterValue},
};

/// A parameter of a node, or an element of a list parameter.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Place {
    /// Index of the node in the scenario.
    pub node: usize,
    /// Name of the parameter.
    pub parameter: String,
    /// Index of the element, if it is an element of a list.
    pub element: Option<usize>,
}

impl Place {
    /// The place of an element of this parameter.
    pub fn element(&self, element: usize) -> Self {
        Self {
            element: Some(element),
            ..self.clone()
        }
    }
}

/// The parameters of all nodes of a scenario.
#[derive(Clone)]
pub(super) struct Parameters {
    pub nodes: Vec<NodeName>,
    pub declared: Vec<Declared>,
}

impl Parameters {
    /// The parameters of `scenario`.
    ///
    /// # Errors
    /// One line per invalid parameter of the scenario.
    pub fn of(scenario: &Scenario) -> Result<Self, String> {
        let nodes = scenario.nodes().to_vec();
        let declared = nodes.iter().map(|node| scenario.declared(node));
        Ok(Self {
            declared: declared.collect::<Result<_, _>>()?,
            nodes,
        })
    }

    /// Name of a node in dotted names: without a namespace if it is unique without.
    fn node_name(&self, node: usize) -> String {
        let name = &self.nodes[node];
        match self
            .nodes
            .iter()
            .filter(|n| n.name() == name.name())
            .count()
        {
            1 => name.name().to_owned(),
            _ => name.full(),
        }
    }

    /// Finds the parameter or element with a dotted name.
    ///
    /// # Errors
    /// A line that lists the known names.
    pub fn find(&self, name: &str) -> Result<Place, String> {
        let (whole, element) = split_element(name)?;
        let Some((node_name, parameter)) = whole.split_once('.') else {
            return Err(format!(
                "parameter {name}: give it as NODE.PARAMETER, such as {}",
                self.names().first().map_or("dynamics.duration", |n| n)
            ));
        };
        let named = |node: &NodeName| match node_name.starts_with('/') {
            true => node.full() == node_name,
            false => node.name() == node_name,
        };
        let found: Vec<usize> = (0..self.nodes.len())
            .filter(|i| named(&self.nodes[*i]))
            .collect();
        let node = match found.as_slice() {
            [one] => *one,
            [] => {
                let names: Vec<_> = (0..self.nodes.len()).map(|i| self.node_name(i)).collect();
                let near = near(node_name, names.iter().map(String::as_str));
                let hint = near.map_or_else(
                    || format!("it has {}", names.join(", ")),
                    |near| format!("did you mean {near}.{parameter}?"),
                );
                return Err(format!(
                    "parameter {name}: the scenario has no node {node_name}; {hint}"
                ));
            }
            several => {
                let names: Vec<_> = several.iter().map(|i| self.nodes[*i].full()).collect();
                return Err(format!(
                    "parameter {name}: there are {}; give one of them",
                    names.join(" and ")
                ));
            }
        };
        let Some(value) = self.declared[node].get(parameter) else {
            let names = self.names();
            let hint = near(whole, names.iter().map(String::as_str)).map_or_else(
                || {
                    let own: Vec<_> = self.declared[node].keys().map(String::as_str).collect();
                    format!("it has {}", own.join(", "))
                },
                |near| format!("did you mean {near}?"),
            );
            return Err(format!(
                "parameter {name}: node {node_name} has no such parameter; {hint}"
            ));
        };
        let place = Place {
            node,
            parameter: parameter.to_owned(),
            element,
        };
        match (element, length(value)) {
            (Some(_), None) => Err(format!("parameter {name}: {whole} is no list")),
            (Some(element), Some(length)) if element >= length => Err(format!(
                "parameter {name}: {whole} has {length} elements, numbered from 0"
            )),
            _ => Ok(place),
        }
    }

    /// Dotted names of all parameters.
    fn names(&self) -> Vec<String> {
        let of_node = |i: usize| {
            let names = self.declared[i].keys();
            names.map(move |name| format!("{}.{name}", self.node_name(i)))
        };
        (0..self.nodes.len()).flat_map(of_node).collect()
    }

    /// Dotted name of a place.
    pub fn name(&self, place: &Place) -> String {
        let whole = format!("{}.{}", self.node_name(place.node), place.parameter);
        match place.element {
            Some(element) => format!("{whole}[{element}]"),
            None => whole,
        }
    }

    /// The scenario's value of a whole parameter.
    pub fn nominal(&self, place: &Place) -> &ParameterValue {
        &self.declared[place.node][&place.parameter]
    }

    /// Seeds of noise: parameters called `seed`, alone or at the end of a dotted name.
    pub fn seeds(&self) -> Vec<Place> {
        let of_node = |node: usize| {
            let names = self.declared[node].iter().filter(|(name, value)| {
                let is_seed = name.as_str() == "seed" || name.ends_with(".seed");
                is_seed && matches!(value, ParameterValue::Integer(_))
            });
            names.map(move |(name, _)| Place {
                node,
                parameter: name.clone(),
                element: None,
            })
        };
        (0..self.nodes.len()).flat_map(of_node).collect()
    }
}

/// The name most similar to `name`, if any is similar enough.
pub(super) fn near<'a>(name: &str, names: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    let ranked = names.map(|n| (strsim::damerau_levenshtein(n, name), n));
    let (distance, near) = ranked.min()?;
    (distance <= 1 + name.len() / 4).then_some(near)
}

/// Splits `name[3]` into `name` and 3.
fn split_element(name: &str) -> Result<(&str, Option<usize>), String> {
    let Some(start) = name.strip_suffix(']') else {
        return Ok((name, None));
    };
    let parts = start.rsplit_once('[');
    let parts = parts.and_then(|(whole, element)| Some((whole, Some(element.parse().ok()?))));
    parts.ok_or_else(|| {
        format!("parameter {name}: give the number of an element in brackets, as in [0]")
    })
}

/// Number of elements of a list.
pub(super) fn length(value: &ParameterValue) -> Option<usize> {
    match value {
        ParameterValue::ByteArray(v) => Some(v.len()),
        ParameterValue::BoolArray(v) => Some(v.len()),
        ParameterValue::IntegerArray(v) => Some(v.len()),
        ParameterValue::DoubleArray(v) => Some(v.len()),
        ParameterValue::StringArray(v) => Some(v.len()),
        _ => None,
    }
}

/// Parameter values that differ from the scenario's, by node and name.
pub(super) type Changes = BTreeMap<(usize, String), ParameterValue>;

/// A value, or an element of it, as a cell.
pub(super) fn cell(value: &ParameterValue, element: Option<usize>) -> Cell {
    let element = element.unwrap_or(0);
    let found = match value {
        ParameterValue::NotSet => None,
        ParameterValue::Bool(b) => Some(Cell::Bool(*b)),
        ParameterValue::Integer(i) => Some(Cell::Integer(*i)),
        ParameterValue::Double(x) => Some(Cell::Number(*x)),
        ParameterValue::String(text) => Some(Cell::Text(text.clone())),
        ParameterValue::ByteArray(v) => v.get(element).map(|b| Cell::Integer(i64::from(*b))),
        ParameterValue::BoolArray(v) => v.get(element).map(|b| Cell::Bool(*b)),
        ParameterValue::IntegerArray(v) => v.get(element).map(|i| Cell::Integer(*i)),
        ParameterValue::DoubleArray(v) => v.get(element).map(|x| Cell::Number(*x)),
        ParameterValue::StringArray(v) => v.get(element).map(|t| Cell::Text(t.clone())),
    };
    found.unwrap_or(Cell::Null)
}

/// The type of the column for a value.
pub(super) fn column_kind(value: &ParameterValue) -> ColumnKind {
    match value {
        ParameterValue::Bool(_) | ParameterValue::BoolArray(_) => ColumnKind::Bool,
        ParameterValue::Integer(_)
        | ParameterValue::ByteArray(_)
        | ParameterValue::IntegerArray(_) => ColumnKind::Integer,
        ParameterValue::Double(_) | ParameterValue::DoubleArray(_) => ColumnKind::Number,
        ParameterValue::NotSet | ParameterValue::String(_) | ParameterValue::StringArray(_) => {
            ColumnKind::Text
        }
    }
}
