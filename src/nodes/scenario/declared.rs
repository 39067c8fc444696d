//! Declared parameters of the nodes of a scenario, and conversion of scenarios to text.

use std::{collections::BTreeMap, fmt::Write as _, path::Path};

use super::Scenario;
use crate::{
    nodes::{
        attitude::AttitudeParams, camera::CameraParams, controller::ControllerParams,
        dynamics::DynamicsParams, estimator::EstimatorParams, mission::MissionParams,
        recorder::RecorderParams, teleop::TeleopParams, tracker::TrackerParams, views::ViewsParams,
    },
    ros::{Declare, NodeName, ParameterValue},
};

/// Names and values of a node's parameters, including defaults.
pub type Declared = BTreeMap<String, ParameterValue>;

/// Declares the parameters of a node.
fn declare(node: &str, declare: &mut Declare) -> Result<(), String> {
    match node {
        "dynamics" => DynamicsParams::declare(declare).map(drop),
        "camera" => CameraParams::declare(declare).map(drop),
        "controller" => {
            ControllerParams::declare(declare);
            Ok(())
        }
        "attitude" => AttitudeParams::declare(declare).map(drop),
        "mission" => MissionParams::declare(declare).map(drop),
        "teleop" => TeleopParams::declare(declare).map(drop),
        "estimator" => EstimatorParams::declare(declare).map(drop),
        "tracker" => TrackerParams::declare(declare).map(drop),
        "views" => {
            ViewsParams::declare(declare);
            Ok(())
        }
        _ => {
            RecorderParams::declare(declare);
            Ok(())
        }
    }
}

impl Scenario {
    /// The parameters of one of the scenario's nodes.
    ///
    /// # Errors
    /// One line per invalid parameter.
    pub fn declared(&self, node: &NodeName) -> Result<Declared, String> {
        let (_, store) = self.store_of(node, |d| declare(node.name(), d))?;
        let names = store.names().into_iter();
        let values = names.filter_map(|name| Some((name.clone(), store.get(&name)?)));
        Ok(values.collect())
    }

    /// The scenario as a parameter file, with the values from file, command line and [`set`](Self::set). A parameter
    /// given to all nodes is printed for the nodes that have it, according to `declared`. File paths relative to the
    /// scenario's folder become absolute.
    ///
    /// # Errors
    /// If a parameter file named on the command line cannot be read.
    pub fn to_text(&self, declared: &[Declared]) -> Result<String, String> {
        let folder = self
            .path
            .parent()
            .and_then(|folder| folder.canonicalize().ok());
        let mut text = String::new();
        for (node, declared) in self.nodes.iter().zip(declared) {
            let overrides = self.args.overrides(node, node.name());
            let mut given = BTreeMap::new();
            for parameter in overrides.map_err(|e| e.to_string())? {
                if !parameter.shared || declared.contains_key(&parameter.name) {
                    given.insert(parameter.name, parameter.value);
                }
            }
            let name = match node.namespace() {
                "/" => node.name().to_owned(),
                _ => node.full(),
            };
            let _ = writeln!(text, "{name}:\n  ros__parameters:");
            for (name, value) in &given {
                let value = absolute(folder.as_deref(), value);
                let _ = writeln!(text, "    {}: {}", quoted(name), value_text(&value));
            }
        }
        Ok(text)
    }
}

/// The value, or, if it names a file in `folder`, the path of this file.
fn absolute(folder: Option<&Path>, value: &ParameterValue) -> ParameterValue {
    let resolve = |text: &String| {
        let path = folder
            .filter(|_| !text.contains("://"))
            .map(|f| f.join(text));
        match path {
            Some(path) if !text.is_empty() && path.exists() => path.display().to_string(),
            _ => text.clone(),
        }
    };
    match value {
        ParameterValue::String(text) if text.contains(['.', '/']) => {
            ParameterValue::String(resolve(text))
        }
        ParameterValue::StringArray(texts) => {
            let path = |text: &String| match text.contains('/') {
                true => resolve(text),
                false => text.clone(),
            };
            ParameterValue::StringArray(texts.iter().map(path).collect())
        }
        other => other.clone(),
    }
}

/// A YAML string in double quotes: a JSON string in which characters that YAML cannot print are escaped.
fn string(text: &str) -> String {
    let hidden =
        |c: char| ('\u{7f}'..='\u{9f}').contains(&c) || ('\u{fffe}'..='\u{ffff}').contains(&c);
    let json = serde_json::Value::from(text).to_string();
    let escaped = |c: char| match hidden(c) {
        true => format!("\\u{:04x}", u32::from(c)),
        false => c.to_string(),
    };
    json.chars().map(escaped).collect()
}

/// A key, in quotes if necessary.
fn quoted(text: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "._".contains(c);
    if text.chars().all(plain) && text.starts_with(|c: char| c.is_ascii_alphabetic()) {
        return text.to_owned();
    }
    string(text)
}

/// The value in YAML; reading it gives the same bits.
fn value_text(value: &ParameterValue) -> String {
    let number = |x: &f64| match x.is_finite() {
        true => format!("{x:?}"),
        false if x.is_nan() => ".nan".to_owned(),
        false if *x > 0.0 => ".inf".to_owned(),
        false => "-.inf".to_owned(),
    };
    let text = |text: &String| string(text);
    let list = |items: Vec<String>| format!("[{}]", items.join(", "));
    match value {
        ParameterValue::Double(x) => number(x),
        ParameterValue::DoubleArray(xs) => list(xs.iter().map(number).collect()),
        ParameterValue::String(x) => text(x),
        ParameterValue::StringArray(xs) => list(xs.iter().map(text).collect()),
        other => other.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scenario(text: &str) -> Scenario {
        Scenario::parse("config/test.yaml".into(), text).unwrap()
    }

    fn text_of(scenario: &Scenario) -> String {
        let declared = scenario.nodes().iter().map(|node| scenario.declared(node));
        let declared: Vec<_> = declared.collect::<Result<_, _>>().unwrap();
        scenario.to_text(&declared).unwrap()
    }

    #[test]
    fn a_scenario_as_text_has_the_same_parameters_to_the_bit() {
        let mut original = scenario(
            "/**:\n  ros__parameters: {use_sim_time: true, position_noise: 1.0e-7}\n\
             dynamics:\n  ros__parameters:\n    time_step: 0.01\n    base: {velocity: [0.1, 0.30000000000000004, -1e-300]}\n\
             camera:\n  ros__parameters: {goal: {position: [1.0, 2.0, 3.0]}}\n",
        );
        original.set("camera", "rate", ParameterValue::Double(1.0 / 3.0));
        original.set(
            "camera",
            "tip_link",
            ParameterValue::String("a \"b\": c\u{e9}\u{7f}".into()),
        );
        let again = scenario(&text_of(&original));
        for node in original.nodes() {
            assert_eq!(
                original.declared(node).unwrap(),
                again.declared(node).unwrap()
            );
        }
        assert_eq!(text_of(&original), text_of(&again));
    }

    #[test]
    fn defaults_are_declared_and_unknown_parameters_refused() {
        let ours = scenario("dynamics:\n  ros__parameters: {}\n");
        let declared = ours.declared(&ours.nodes()[0]).unwrap();
        assert_eq!(
            declared["urdf"],
            ParameterValue::String("package://fuyu/urdf/servicer.urdf".into())
        );
        let wrong = scenario("dynamics:\n  ros__parameters: {time_stop: 1.0}\n");
        let error = wrong.declared(&wrong.nodes()[0]).unwrap_err();
        assert!(error.contains("did you mean time_step?"), "{error}");
    }
}
