//! Bags as tables. `fuyu/bags.py` makes Arrow tables of them.

use std::collections::BTreeMap;
use std::ffi::CString;
use std::path::PathBuf;

use fuyu::bag::{Bag, TableFormat, convert};
use pyo3::exceptions::PyUserWarning;
use pyo3::prelude::*;

use crate::error::{input, run};

/// Types of a bag's topics, by name: (ROS type, number of messages).
#[pyfunction]
pub fn bag_topics(bag: PathBuf) -> PyResult<BTreeMap<String, (String, u64)>> {
    let info = Bag::open(bag).and_then(|bag| bag.info()).map_err(input)?;
    let topics = info.topics.into_iter();
    Ok(topics.map(|t| (t.name, (t.type_name, t.count))).collect())
}

/// Writes the topics of a bag (all if none are named) as Parquet files into `folder`; returns the files by topic. The interpreter's lock
/// is released. Damage of the bag is a warning.
#[pyfunction]
pub fn convert_bag(
    py: Python<'_>,
    bag: PathBuf,
    folder: PathBuf,
    topics: Option<Vec<String>>,
) -> PyResult<BTreeMap<String, PathBuf>> {
    let source = Bag::open(&bag).map_err(input)?;
    let takes = |topic: &str| {
        let topics = topics.as_ref();
        topics.is_none_or(|topics| topics.iter().any(|t| t == topic))
    };
    let made = py.detach(|| convert(&source, &folder, TableFormat::Parquet, takes));
    let made = made.map_err(run)?;
    let damage = made.damage.iter().map(ToString::to_string);
    let left_out = made.left_out.iter();
    let left_out = left_out.map(|(topic, why)| format!("{topic} is omitted: {why}"));
    let cut = made.tables.iter().filter(|t| t.cut + t.undecoded > 0);
    let cut = cut.map(|t| {
        format!(
            "{}: {} messages have too many values for a table, whose excess is omitted, and {} are not valid {}",
            t.topic, t.cut, t.undecoded, t.type_name
        )
    });
    for warning in damage.chain(left_out).chain(cut) {
        let category = py.get_type::<PyUserWarning>();
        PyErr::warn(py, &category, &CString::new(warning)?, 1)?;
    }
    let tables = made.tables.into_iter();
    Ok(tables.map(|t| (t.topic, t.path)).collect())
}
