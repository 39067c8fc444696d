//! Values of the JSON result of a run, by dotted names, and criteria on them.

use std::collections::BTreeMap;

use serde_json::Value;

use super::{
    parameters::near,
    row::{Cell, Column, ColumnKind},
};

/// Parts of the result that are kept only if they are named.
const OMITTED: [&str; 3] = ["final", "events", "wall_time"];

/// Dotted names of the values in a result, with their types: `base_displacement[0]`, `final.q.joint1`; for lists also
/// `events.count`. Null values count as numbers.
pub(super) fn leaves(result: &Value) -> BTreeMap<String, ColumnKind> {
    let mut found = BTreeMap::new();
    collect("", result, &mut found);
    found.retain(|name, _| !is_wall_time(name));
    found
}

/// Whether a value is a wall time, which is not a result, since it is never the same.
fn is_wall_time(name: &str) -> bool {
    name.split('.').any(|part| part == "wall_time")
}

fn collect(name: &str, value: &Value, found: &mut BTreeMap<String, ColumnKind>) {
    let kind = match value {
        Value::Object(entries) => {
            for (key, value) in entries {
                let name = match name.is_empty() {
                    true => key.clone(),
                    false => format!("{name}.{key}"),
                };
                collect(&name, value, found);
            }
            return;
        }
        Value::Array(items) => {
            found.insert(format!("{name}.count"), ColumnKind::Integer);
            for (i, item) in items.iter().enumerate() {
                collect(&format!("{name}[{i}]"), item, found);
            }
            return;
        }
        Value::Null | Value::Number(_) => ColumnKind::Number,
        Value::Bool(_) => ColumnKind::Bool,
        Value::String(_) => ColumnKind::Text,
    };
    found.insert(name.to_owned(), kind);
}

/// The columns for the named values; without names, for all numbers except [`OMITTED`] parts.
///
/// # Errors
/// A line with a name that is not in the result.
pub(super) fn columns(names: Option<&[String]>, result: &Value) -> Result<Vec<Column>, String> {
    let leaves = leaves(result);
    let Some(names) = names else {
        let all = leaves.into_iter().filter(|(name, kind)| {
            let is_number = *kind == ColumnKind::Number;
            is_number && !name.split(['.', '[']).any(|part| OMITTED.contains(&part))
        });
        return Ok(all.map(|(name, kind)| Column { name, kind }).collect());
    };
    let mut columns: Vec<Column> = Vec::new();
    for name in names {
        if columns.iter().any(|column| column.name == *name) {
            return Err(format!("keep.results: {name} is named twice"));
        }
        let kind = leaves.get(name).ok_or_else(|| {
            let problem = unknown(name, leaves.keys().map(String::as_str));
            format!("keep.results: {problem}")
        })?;
        columns.push(Column {
            name: name.clone(),
            kind: *kind,
        });
    }
    Ok(columns)
}

/// The error that `name` is not among `names`.
pub(super) fn unknown<'a>(name: &str, names: impl Iterator<Item = &'a str> + Clone) -> String {
    let hint = near(name, names.clone()).map_or_else(
        || {
            let names: Vec<_> = names.filter(|n| !n.starts_with("final.")).collect();
            format!("there are {}", names.join(", "))
        },
        |near| format!("did you mean {near}?"),
    );
    format!("a run has no result {name}; {hint}")
}

/// The value with a dotted name.
pub(super) fn value(result: &Value, name: &str, kind: ColumnKind) -> Cell {
    let Some(found) = find(result, name) else {
        return Cell::Null;
    };
    match (found, kind) {
        (Found::Count(n), _) => Cell::Integer(n as i64),
        (Found::Value(Value::Number(x)), ColumnKind::Number) => {
            x.as_f64().map_or(Cell::Null, Cell::Number)
        }
        (Found::Value(Value::Bool(b)), ColumnKind::Bool) => Cell::Bool(*b),
        (Found::Value(Value::String(text)), ColumnKind::Text) => Cell::Text(text.clone()),
        _ => Cell::Null,
    }
}

enum Found<'a> {
    Value(&'a Value),
    Count(usize),
}

/// Finds the value with a dotted name. Keys may themselves contain dots.
fn find<'a>(value: &'a Value, name: &str) -> Option<Found<'a>> {
    if name.is_empty() {
        return Some(Found::Value(value));
    }
    match value {
        Value::Object(entries) => entries.iter().find_map(|(key, value)| {
            let rest = name.strip_prefix(key.as_str())?;
            match rest.strip_prefix('.') {
                Some(rest) => find(value, rest),
                None if rest.is_empty() || rest.starts_with('[') => find(value, rest),
                None => None,
            }
        }),
        Value::Array(items) => match name.strip_prefix('[') {
            Some(rest) => {
                let (index, rest) = rest.split_once(']')?;
                let item = items.get(index.parse::<usize>().ok()?)?;
                find(item, rest.strip_prefix('.').unwrap_or(rest))
            }
            None => (name == "count").then_some(Found::Count(items.len())),
        },
        _ => None,
    }
}

/// A comparison operator.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Comparison {
    Less,
    LessOrEqual,
    Greater,
    GreaterOrEqual,
    Equal,
    NotEqual,
}

/// Comparison operators; longer ones first, so that `<=` is not read as `<`.
const COMPARISONS: [(&str, Comparison); 6] = [
    ("<=", Comparison::LessOrEqual),
    (">=", Comparison::GreaterOrEqual),
    ("==", Comparison::Equal),
    ("!=", Comparison::NotEqual),
    ("<", Comparison::Less),
    (">", Comparison::Greater),
];

/// A criterion of success: `NAME < NUMBER`, also with `<=`, `>`, `>=`, `==`, `!=`, and `abs(NAME)`.
#[derive(Debug, Clone, PartialEq)]
pub struct Criterion {
    text: String,
    name: String,
    is_absolute: bool,
    comparison: Comparison,
    limit: f64,
}

impl Criterion {
    /// Parses a criterion.
    ///
    /// # Errors
    /// A line with the correct form.
    pub fn parse(text: &str) -> Result<Self, String> {
        let wrong = || {
            format!("success: '{text}' is no criterion; write it as in 'tip_position_error < 0.01'")
        };
        let found = COMPARISONS.iter().find_map(|(sign, comparison)| {
            let (left, right) = text.split_once(sign)?;
            Some((left.trim(), right.trim(), *comparison))
        });
        let (left, right, comparison) = found.ok_or_else(wrong)?;
        let inside = left.strip_prefix("abs(").and_then(|l| l.strip_suffix(')'));
        let name = inside.unwrap_or(left).trim();
        let limit: f64 = right.parse().map_err(|_| wrong())?;
        if name.is_empty() || name.contains(char::is_whitespace) || !limit.is_finite() {
            return Err(wrong());
        }
        Ok(Self {
            text: text.trim().to_owned(),
            name: name.to_owned(),
            is_absolute: inside.is_some(),
            comparison,
            limit,
        })
    }

    /// The criterion as written.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// Name of the result or parameter that it judges.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The quantity that is compared: the value or its magnitude.
    pub fn quantity(&self, value: f64) -> f64 {
        match self.is_absolute {
            true => value.abs(),
            false => value,
        }
    }

    /// Whether a value meets the criterion; a missing value does not.
    pub fn is_met(&self, value: Option<f64>) -> bool {
        let Some(x) = value.map(|x| self.quantity(x)) else {
            return false;
        };
        match self.comparison {
            Comparison::Less => x < self.limit,
            Comparison::LessOrEqual => x <= self.limit,
            Comparison::Greater => x > self.limit,
            Comparison::GreaterOrEqual => x >= self.limit,
            Comparison::Equal => x == self.limit,
            Comparison::NotEqual => x != self.limit,
        }
    }

    /// Distance by which a value violates the criterion; larger is worse. Infinite for a missing value.
    pub fn excess(&self, value: Option<f64>) -> f64 {
        let Some(x) = value.map(|x| self.quantity(x)) else {
            return f64::INFINITY;
        };
        match self.comparison {
            Comparison::Less | Comparison::LessOrEqual => x - self.limit,
            Comparison::Greater | Comparison::GreaterOrEqual => self.limit - x,
            Comparison::Equal => (x - self.limit).abs(),
            Comparison::NotEqual => -(x - self.limit).abs(),
        }
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn result() -> Value {
        json!({
            "tip_position_error": 0.005, "time_to_1cm": null, "base_displacement": [1.0, 2.0, 3.0],
            "events": [{"time": 1.0, "what": "stop"}], "wall_time": 3.0,
            "final": {"q": {"joint.1": 0.25}}, "momentum_residual": {"linear": 1e-15},
        })
    }

    #[test]
    fn values_are_found_by_dotted_names() {
        let number = |name| value(&result(), name, ColumnKind::Number).number();
        assert_eq!(number("tip_position_error"), Some(0.005));
        assert_eq!(number("base_displacement[2]"), Some(3.0));
        assert_eq!(number("base_displacement[3]"), None);
        assert_eq!(number("final.q.joint.1"), Some(0.25));
        assert_eq!(number("events.count"), Some(1.0));
        assert_eq!(number("events[0].time"), Some(1.0));
        assert_eq!(number("time_to_1cm"), None);
        let what = value(&result(), "events[0].what", ColumnKind::Text);
        assert_eq!(what, Cell::Text("stop".to_owned()));
    }

    #[test]
    fn numbers_outside_of_the_final_state_are_kept_by_default() {
        let columns = columns(None, &result()).unwrap();
        let names: Vec<_> = columns.iter().map(|c| c.name.as_str()).collect();
        let expected = [
            "base_displacement[0]",
            "base_displacement[1]",
            "base_displacement[2]",
            "momentum_residual.linear",
            "time_to_1cm",
            "tip_position_error",
        ];
        assert_eq!(names, expected);
    }

    #[test]
    fn unknown_results_are_refused_with_a_hint() {
        let error = columns(Some(&["tip_positon_error".to_owned()]), &result()).unwrap_err();
        assert!(
            error.contains("did you mean tip_position_error?"),
            "{error}"
        );
        // Wall times are in a separate table.
        assert!(columns(Some(&["wall_time".to_owned()]), &result()).is_err());
    }

    #[test]
    fn criteria() {
        for (text, value, met) in [
            ("x < 1", Some(0.5), true),
            ("x < 1", Some(1.0), false),
            ("x<=1e0", Some(1.0), true),
            ("abs(x) < 1", Some(-2.0), false),
            ("x >= -1", Some(-0.5), true),
            ("x == 2", Some(2.0), true),
            ("x != 2", Some(2.0), false),
            ("x < 1", None, false),
            ("x != 2", None, false),
            ("x < 1", Some(f64::NAN), false),
        ] {
            let criterion = Criterion::parse(text).unwrap();
            assert_eq!(criterion.is_met(value), met, "{text} {value:?}");
        }
        for text in [
            "x", "x <", "< 1", "x < y", "x = 1", "x < inf", "a b < 1", "",
        ] {
            assert!(
                Criterion::parse(text)
                    .unwrap_err()
                    .contains("tip_position_error"),
                "{text}"
            );
        }
    }
}
