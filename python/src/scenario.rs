//! `Scenario`.

use std::ffi::CString;
use std::time::Instant;

use fuyu::experiments::{Fleet, check_robots, notes, simulation, warnings};
use fuyu::ros::ParameterValue;
use pyo3::exceptions::PyUserWarning;
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyFloat, PyInt, PyString};

use crate::error::{input, positive, run};

/// A scenario: a ROS 2 parameter file that names the nodes of a run.
///
/// `source` is the path of a file, or the name of a scenario that comes with fuyu, such as `positioning`.
#[pyclass(frozen, module = "fuyu")]
pub struct Scenario {
    source: String,
    scenario: fuyu::nodes::scenario::Scenario,
}

/// What a run gives.
struct Outcome {
    json: String,
    warnings: Vec<String>,
}

#[pymethods]
impl Scenario {
    #[new]
    fn new(source: &Bound<'_, PyAny>) -> PyResult<Self> {
        let source: String = source.str()?.extract()?;
        let is_name = source
            .chars()
            .all(|c| c.is_alphanumeric() || c == '_' || c == '-');
        let file = match is_name && !std::path::Path::new(&source).exists() {
            true => format!("package://fuyu/config/{source}.yaml"),
            false => source.clone(),
        };
        let scenario = fuyu::nodes::scenario::Scenario::read(&file).map_err(input)?;
        Ok(Self { source, scenario })
    }

    /// Name of the scenario.
    #[getter]
    fn name(&self) -> String {
        self.scenario.name()
    }

    /// The file; `package://fuyu/PATH` if it comes with the package.
    #[getter]
    fn path(&self) -> String {
        self.scenario.path().display().to_string()
    }

    /// Names of its nodes.
    #[getter]
    fn nodes(&self) -> Vec<String> {
        let nodes = self.scenario.nodes().iter();
        nodes.map(|node| node.name().to_owned()).collect()
    }

    /// Simulates the scenario without DDS: the result is the object that `fuyu simulate --json` prints, to the bit, as a dict.
    ///
    /// `duration` [s] replaces the scenario's. `parameters` replaces parameters by node and dotted name, such as
    /// `{"controller.k_p": 80.0}`; keywords do the same by node, such as `controller={"k_p": 80.0}`. `output` is a new folder for a
    /// bag of the run. Doubtful results are warnings. The interpreter's lock is released, so that runs in
    /// threads use all processors.
    #[pyo3(signature = (duration = None, *, output = None, parameters = None, **nodes))]
    fn simulate<'py>(
        &self,
        py: Python<'py>,
        duration: Option<f64>,
        output: Option<std::path::PathBuf>,
        parameters: Option<&Bound<'py, PyDict>>,
        nodes: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let mut scenario = self.scenario.clone();
        let mut changes = Vec::new();
        if let Some(parameters) = parameters {
            flatten("", parameters, &mut changes)?;
        }
        if let Some(nodes) = nodes {
            flatten("", nodes, &mut changes)?;
        }
        for (name, value) in changes {
            let (node, parameter) = name.split_once('.').ok_or_else(|| {
                input(format!("{name} is not a parameter; give NODE.PARAMETER, or a dict of the node's parameters"))
            })?;
            if !scenario.has(node) {
                let known = self.nodes().join(", ");
                return Err(input(format!(
                    "{}: does not name the node '{node}' of {name}; it has {known}",
                    self.path()
                )));
            }
            scenario.set(node, parameter, value);
        }
        let duration = duration.map(|d| positive("duration", d)).transpose()?;
        let outcome = py.detach(|| simulate(&scenario, duration, output.as_deref()))?;
        for warning in outcome.warnings {
            let category = py.get_type::<PyUserWarning>();
            PyErr::warn(py, &category, &CString::new(warning)?, 1)?;
        }
        let json = py.import("json")?;
        json.call_method1("loads", (outcome.json,))
    }

    fn __repr__(&self) -> String {
        format!("fuyu.Scenario('{}')", self.source)
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let restore = py.get_type::<Self>();
        let args = (self.source.as_str(),);
        (restore, args).into_pyobject(py).map(Bound::into_any)
    }
}

fn simulate(
    scenario: &fuyu::nodes::scenario::Scenario,
    duration: Option<f64>,
    output: Option<&std::path::Path>,
) -> PyResult<Outcome> {
    scenario.check().map_err(input)?;
    check_robots(scenario).map_err(input)?;
    let mut fleet = Fleet::new(scenario).map_err(input)?;
    let mut all_warnings = notes(scenario, &fleet);
    all_warnings.extend(scenario.warnings(true));
    let duration = simulation::duration_of(&fleet, duration);
    let bag = output.map(|folder| simulation::create_bag(scenario, &fleet, folder));
    let mut bag = bag.transpose().map_err(input)?;
    let start = Instant::now();
    let observed = simulation::simulate(&mut fleet, duration, bag.as_mut(), |_, _| Ok(()));
    let observed = observed.map_err(|stop| run(stop.describe(scenario)))?;
    let wall_time = start.elapsed().as_secs_f64();
    if let Some(bag) = bag {
        bag.finish().map_err(run)?;
    }
    all_warnings.extend(warnings(scenario, &fleet, &observed));
    let summaries = simulation::summaries(&fleet, &observed, wall_time);
    let json = simulation::results_text(&fleet, &observed, &summaries);
    Ok(Outcome {
        json: json.map_err(run)?,
        warnings: all_warnings,
    })
}

/// Parameters by dotted name, from dicts in dicts.
fn flatten(
    prefix: &str,
    values: &Bound<'_, PyDict>,
    into: &mut Vec<(String, ParameterValue)>,
) -> PyResult<()> {
    for (key, value) in values {
        let name = format!("{prefix}{}", key.extract::<String>()?);
        match value.cast::<PyDict>() {
            Ok(inner) => flatten(&format!("{name}."), inner, into)?,
            Err(_) => into.push((name.clone(), parameter(&name, &value)?)),
        }
    }
    Ok(())
}

/// A Python value as a ROS parameter. Arrays of numpy are lists.
fn parameter(name: &str, value: &Bound<'_, PyAny>) -> PyResult<ParameterValue> {
    let value = match value.hasattr("tolist")? {
        true => value.call_method0("tolist")?,
        false => value.clone(),
    };
    let wrong = || {
        let kind = value.get_type();
        input(format!(
            "parameter {name}: {kind} is no ROS parameter; give a bool, int, float, str, or a list of one of them"
        ))
    };
    if value.is_instance_of::<PyBool>() {
        return Ok(ParameterValue::Bool(value.extract()?));
    }
    if value.is_instance_of::<PyInt>() {
        return Ok(ParameterValue::Integer(value.extract()?));
    }
    if value.is_instance_of::<PyFloat>() {
        return Ok(ParameterValue::Double(value.extract()?));
    }
    if value.is_instance_of::<PyString>() {
        return Ok(ParameterValue::String(value.extract()?));
    }
    let items: Vec<Bound<'_, PyAny>> = value.extract().map_err(|_| wrong())?;
    let all = |is: fn(&Bound<'_, PyAny>) -> bool| items.iter().all(is);
    let is_bool = |item: &Bound<'_, PyAny>| item.is_instance_of::<PyBool>();
    if items.is_empty() {
        return Ok(ParameterValue::IntegerArray(Vec::new()));
    }
    if all(is_bool) {
        return Ok(ParameterValue::BoolArray(value.extract()?));
    }
    if items.iter().any(is_bool) {
        return Err(wrong());
    }
    if all(|item| item.is_instance_of::<PyInt>()) {
        return Ok(ParameterValue::IntegerArray(value.extract()?));
    }
    if all(|item| item.is_instance_of::<PyInt>() || item.is_instance_of::<PyFloat>()) {
        return Ok(ParameterValue::DoubleArray(value.extract()?));
    }
    if all(|item| item.is_instance_of::<PyString>()) {
        return Ok(ParameterValue::StringArray(value.extract()?));
    }
    Err(wrong())
}
