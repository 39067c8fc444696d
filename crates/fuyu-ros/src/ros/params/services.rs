//! The six parameter services and `/parameter_events`.

use std::{collections::BTreeSet, sync::Arc};

use super::{Change, ParameterStore, ParameterValue, SetError, USE_SIM_TIME};
use crate::{
    msg::rcl_interfaces::{
        ListParametersResult, Parameter, ParameterDescriptor, ParameterEvent, SetParametersResult,
        services::{
            DescribeParameters, DescribeParametersResponse, GetParameterTypes,
            GetParameterTypesResponse, GetParameters, GetParametersResponse, ListParameters,
            ListParametersResponse, SetParameters, SetParametersAtomically,
            SetParametersAtomicallyResponse, SetParametersResponse,
        },
    },
    ros::{Node, NodeError, Qos, endpoint::EndpointSpec, service::ServiceServer},
};

/// Creates the parameter services of a node and starts publishing parameter events. The services exist as long as the
/// returned servers.
pub(in crate::ros) fn serve(node: &Node) -> Result<Vec<ServiceServer>, NodeError> {
    let store = node.parameters();
    announce_changes(node)?;

    let (get, types) = (Arc::clone(store), Arc::clone(store));
    let (list, describe) = (Arc::clone(store), Arc::clone(store));
    let (set, set_atomically) = (Arc::clone(store), Arc::clone(store));
    Ok(vec![
        node.serve::<GetParameters>("~/get_parameters", move |request| GetParametersResponse {
            values: values(&get, &request.names).map(Into::into).collect(),
        })?,
        node.serve::<GetParameterTypes>("~/get_parameter_types", move |request| {
            GetParameterTypesResponse {
                types: values(&types, &request.names)
                    .map(|v| v.kind() as u8)
                    .collect(),
            }
        })?,
        node.serve::<ListParameters>("~/list_parameters", move |request| ListParametersResponse {
            result: list_names(&list.names(), &request.prefixes, request.depth),
        })?,
        node.serve::<DescribeParameters>("~/describe_parameters", move |request| {
            let descriptors =
                request
                    .names
                    .into_iter()
                    .map(|name| match describe.describe(&name) {
                        Some(descriptor) => ParameterDescriptor::from(&descriptor),
                        None => ParameterDescriptor {
                            name,
                            ..Default::default()
                        },
                    });
            DescribeParametersResponse {
                descriptors: descriptors.collect(),
            }
        })?,
        node.serve::<SetParameters>("~/set_parameters", move |request| SetParametersResponse {
            results: request
                .parameters
                .into_iter()
                .map(|p| result(convert(vec![p]).and_then(|p| apply(&set, p))))
                .collect(),
        })?,
        node.serve::<SetParametersAtomically>("~/set_parameters_atomically", move |request| {
            SetParametersAtomicallyResponse {
                result: result(convert(request.parameters).and_then(|p| apply(&set_atomically, p))),
            }
        })?,
    ])
}

/// Publishes changes on `/parameter_events` and wakes the node. The store holds a weak reference to the node.
fn announce_changes(node: &Node) -> Result<(), NodeError> {
    let events =
        EndpointSpec::topic::<ParameterEvent>("/parameter_events", Qos::PARAMETER_EVENTS).shared();
    let writer = node.core.add_writer(events)?;
    let core = Arc::downgrade(&node.core);
    node.parameters().on_change(move |changes| {
        let Some(core) = core.upgrade() else {
            return;
        };
        let simulated = changes.iter().rfind(|c| c.name == USE_SIM_TIME);
        if let Some(ParameterValue::Bool(simulated)) = simulated.map(|c| &c.value)
            && let Err(e) = core.use_sim_time(*simulated)
        {
            tracing::error!("{e}");
        }
        let name = core.names.node().full();
        let event = event(core.clock.now().into(), &name, changes);
        core.publish(&writer, &event);
        core.events.notify();
    });
    Ok(())
}

fn values(store: &ParameterStore, names: &[String]) -> impl Iterator<Item = ParameterValue> {
    names.iter().map(|n| store.get(n).unwrap_or_default())
}

fn convert(parameters: Vec<Parameter>) -> Result<Vec<(String, ParameterValue)>, String> {
    parameters
        .into_iter()
        .map(|p| match ParameterValue::try_from(p.value) {
            Ok(value) => Ok((p.name, value)),
            Err(e) => Err(format!("parameter {}: {e}", p.name)),
        })
        .collect()
}

fn apply(store: &ParameterStore, values: Vec<(String, ParameterValue)>) -> Result<(), String> {
    store.set(values).map_err(|e: SetError| e.to_string())
}

fn result(outcome: Result<(), String>) -> SetParametersResult {
    SetParametersResult {
        successful: outcome.is_ok(),
        reason: outcome.err().unwrap_or_default(),
    }
}

fn event(
    stamp: crate::msg::builtin_interfaces::Time,
    node: &str,
    changes: &[Change],
) -> ParameterEvent {
    let of = |new: bool| {
        let chosen = changes.iter().filter(|c| c.new == new);
        chosen
            .map(|c| Parameter {
                name: c.name.clone(),
                value: c.value.clone().into(),
            })
            .collect()
    };
    ParameterEvent {
        stamp,
        node: node.to_owned(),
        new_parameters: of(true),
        changed_parameters: of(false),
        deleted_parameters: Vec::new(),
    }
}

/// Lists parameters as rclcpp does: names at or below one of the prefixes (without prefixes all names), at most `depth`
/// levels below it (zero: no limit), and the prefixes of the listed names.
fn list_names(names: &[String], prefixes: &[String], depth: u64) -> ListParametersResult {
    let levels = |rest: &str| 1 + rest.matches('.').count() as u64;
    let shallow = |rest: &str| depth == 0 || levels(rest) <= depth;
    let listed = |name: &&String| {
        if prefixes.is_empty() {
            return shallow(name);
        }
        prefixes
            .iter()
            .any(|prefix| match name.strip_prefix(prefix.as_str()) {
                Some("") => true,
                Some(rest) => rest.strip_prefix('.').is_some_and(shallow),
                None => false,
            })
    };
    let names: Vec<String> = names.iter().filter(listed).cloned().collect();
    let prefixes: BTreeSet<_> = names
        .iter()
        .filter_map(|n| n.rsplit_once('.'))
        .map(|(prefix, _)| prefix.to_owned())
        .collect();
    ListParametersResult {
        names,
        prefixes: prefixes.into_iter().collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_as_rclcpp_does() {
        let names = ["a", "joints.q1.kp", "joints.q2.kp", "joints.rate"].map(str::to_owned);
        let list = |prefixes: &[&str], depth| {
            let prefixes: Vec<_> = prefixes.iter().map(|&p| p.to_owned()).collect();
            list_names(&names, &prefixes, depth).names
        };
        assert_eq!(list(&[], 0), names);
        assert_eq!(list(&[], 1), ["a"]);
        assert_eq!(list(&["joints"], 1), ["joints.rate"]);
        assert_eq!(list(&["joints.q1"], 0), ["joints.q1.kp"]);
        assert_eq!(list(&["joint"], 0), [""; 0]);
        let all = list_names(&names, &[], 0);
        assert_eq!(all.prefixes, ["joints", "joints.q1", "joints.q2"]);
    }
}
