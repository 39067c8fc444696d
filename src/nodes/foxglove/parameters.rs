//! Parameters of all nodes for the operator's client, accessed by the parameter services of ROS nodes. As in
//! foxglove_bridge, a parameter is named by its node, a dot and its own name: `/teleop.method`.

use std::{
    collections::{BTreeMap, BTreeSet},
    sync::{Arc, Mutex, PoisonError},
    time::Duration,
};

use foxglove::websocket::{
    AnyClient, ClientId, GetParametersResponder, Parameter as Shown, ParameterHandler,
    ParameterValue as ShownValue, SetParametersResponder,
};

use super::control::Control;
use crate::{
    msg::rcl_interfaces::{
        self, ParameterEvent, ParameterType,
        services::{
            GetParameters, GetParametersRequest, ListParameters, ListParametersRequest,
            SetParameters, SetParametersRequest,
        },
    },
    ros::{Node, NodeError, ServiceClient},
};

/// Timeout of a service call.
const PATIENCE: Duration = Duration::from_secs(2);

/// The parameters of the graph's nodes.
pub struct Parameters(Arc<Shared>);

struct Shared {
    node: Node,
    control: Arc<Mutex<Control<ClientId>>>,
    /// Full names of the nodes.
    nodes: Mutex<BTreeSet<String>>,
    clients: Mutex<BTreeMap<String, Arc<Clients>>>,
}

/// The services of a node.
struct Clients {
    list: ServiceClient<ListParameters>,
    get: ServiceClient<GetParameters>,
    set: ServiceClient<SetParameters>,
}

impl Clients {
    fn new(own: &Node, node: &str) -> Result<Self, NodeError> {
        Ok(Self {
            list: own.client(&format!("{node}/list_parameters"))?,
            get: own.client(&format!("{node}/get_parameters"))?,
            set: own.client(&format!("{node}/set_parameters"))?,
        })
    }

    fn values(&self, names: Vec<String>) -> Result<Vec<rcl_interfaces::ParameterValue>, String> {
        let request = GetParametersRequest { names };
        let response = self.get.call(&request, PATIENCE);
        response.map(|r| r.values).map_err(|e| e.to_string())
    }
}

impl Parameters {
    /// Without nodes.
    pub fn new(node: &Node, control: Arc<Mutex<Control<ClientId>>>) -> Self {
        Self(Arc::new(Shared {
            node: node.clone(),
            control,
            nodes: Mutex::default(),
            clients: Mutex::default(),
        }))
    }

    /// Adds a node by its full name.
    pub fn add_node(&self, name: &str) {
        let mut nodes = self.0.nodes.lock().unwrap_or_else(PoisonError::into_inner);
        nodes.insert(name.to_owned());
    }

    /// The handler for the server.
    pub fn handler(&self) -> Arc<dyn ParameterHandler> {
        Arc::new(Self(Arc::clone(&self.0)))
    }
}

impl Shared {
    fn clients(&self, node: &str) -> Result<Arc<Clients>, String> {
        let mut clients = self.clients.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = clients.get(node) {
            return Ok(Arc::clone(known));
        }
        let known = (self.nodes.lock().unwrap_or_else(PoisonError::into_inner)).contains(node);
        if !known {
            return Err(format!("{node}: there is no such node"));
        }
        let new = Clients::new(&self.node, node).map_err(|e| format!("{node}: {e}"))?;
        let new = Arc::new(new);
        clients.insert(node.to_owned(), Arc::clone(&new));
        Ok(new)
    }

    /// The parameters in `names`, or all parameters if `names` is empty; and errors.
    fn get(&self, names: &[String]) -> (Vec<Shown>, Vec<String>) {
        let (mut shown, mut problems) = (Vec::new(), Vec::new());
        for (node, names) in self.by_node(names, &mut problems) {
            match self.of_node(&node, names) {
                Ok(values) => shown.extend(values),
                Err(problem) => problems.push(problem),
            }
        }
        (shown, problems)
    }

    /// The names grouped by node; without names, all nodes, each with `None`.
    fn by_node(
        &self,
        names: &[String],
        problems: &mut Vec<String>,
    ) -> BTreeMap<String, Option<Vec<String>>> {
        if names.is_empty() {
            let nodes = self.nodes.lock().unwrap_or_else(PoisonError::into_inner);
            return nodes.iter().map(|node| (node.clone(), None)).collect();
        }
        let mut by_node = BTreeMap::new();
        for name in names {
            match name.split_once('.') {
                Some((node, own)) => by_node
                    .entry(node.to_owned())
                    .or_insert_with(|| Some(Vec::new()))
                    .get_or_insert_default()
                    .push(own.to_owned()),
                None => problems.push(format!("{name}: expected /NODE.PARAMETER")),
            }
        }
        by_node
    }

    fn of_node(&self, node: &str, names: Option<Vec<String>>) -> Result<Vec<Shown>, String> {
        let clients = self.clients(node)?;
        let names = match names {
            Some(names) => names,
            // Not every node has the services.
            None if !clients.list.is_available() => return Ok(Vec::new()),
            None => {
                let all = ListParametersRequest::default();
                let listed = clients.list.call(&all, PATIENCE);
                listed.map_err(|e| e.to_string())?.result.names
            }
        };
        let values = clients.values(names.clone())?;
        let pairs = names.iter().zip(values);
        Ok(pairs
            .filter_map(|(name, value)| show(node, name, value))
            .collect())
    }

    /// Sets parameters. Returns their new values, and errors.
    fn set(&self, wishes: &[Shown]) -> (Vec<Shown>, Vec<String>) {
        let names: Vec<_> = wishes.iter().map(|p| p.name.clone()).collect();
        let mut problems = Vec::new();
        for (node, names) in self.by_node(&names, &mut problems) {
            let names = names.unwrap_or_default();
            if let Err(problem) = self.set_of_node(&node, &names, wishes, &mut problems) {
                problems.push(problem);
            }
        }
        let (now, _) = self.get(&names);
        (now, problems)
    }

    fn set_of_node(
        &self,
        node: &str,
        names: &[String],
        wishes: &[Shown],
        problems: &mut Vec<String>,
    ) -> Result<(), String> {
        let clients = self.clients(node)?;
        let current = clients.values(names.to_vec())?;
        let mut parameters = Vec::new();
        for (name, current) in names.iter().zip(current) {
            let full = format!("{node}.{name}");
            let wish = wishes.iter().find(|p| p.name == full);
            let Some(value) = wish.and_then(|p| p.value.as_ref()) else {
                problems.push(format!("{full}: no value is given"));
                continue;
            };
            match message(value, current.r#type) {
                Some(value) => parameters.push(rcl_interfaces::Parameter {
                    name: name.clone(),
                    value,
                }),
                None => problems.push(match current.r#type {
                    ParameterType::PARAMETER_NOT_SET => {
                        format!("{full}: there is no such parameter")
                    }
                    _ => format!("{full}: a value of another type than the parameter's"),
                }),
            }
        }
        if parameters.is_empty() {
            return Ok(());
        }
        let names: Vec<_> = parameters.iter().map(|p| p.name.clone()).collect();
        let request = SetParametersRequest { parameters };
        let response = clients.set.call(&request, PATIENCE);
        let response = response.map_err(|e| e.to_string())?;
        let results = names.iter().zip(response.results);
        let refused = results.filter(|(_, result)| !result.successful);
        problems.extend(refused.map(|(name, result)| format!("{node}.{name}: {}", result.reason)));
        Ok(())
    }
}

impl ParameterHandler for Parameters {
    fn get(
        &self,
        client: AnyClient,
        names: Vec<String>,
        _: Option<String>,
        responder: GetParametersResponder,
    ) {
        let shared = Arc::clone(&self.0);
        tokio::task::spawn_blocking(move || {
            let (shown, problems) = shared.get(&names);
            for problem in problems {
                client.send_warning(problem);
            }
            responder.respond(shown);
        });
    }

    fn set(
        &self,
        client: AnyClient,
        parameters: Vec<Shown>,
        _: Option<String>,
        responder: SetParametersResponder,
    ) {
        let shared = Arc::clone(&self.0);
        tokio::task::spawn_blocking(move || {
            let control = shared.control.lock();
            let holds = control
                .unwrap_or_else(PoisonError::into_inner)
                .holds(client.id());
            let (now, problems) = match holds {
                true => shared.set(&parameters),
                false => {
                    let names: Vec<_> = parameters.iter().map(|p| p.name.clone()).collect();
                    let problem = format!("{}: take control first", names.join(", "));
                    (shared.get(&names).0, vec![problem])
                }
            };
            for problem in problems {
                client.send_error(problem);
            }
            responder.respond(now);
        });
    }
}

/// The parameters that a node has changed.
pub fn changed(event: ParameterEvent) -> Vec<Shown> {
    let node = event.node;
    let changed = event.new_parameters.into_iter();
    let changed = changed.chain(event.changed_parameters);
    let shown = changed.map(|p| show(&node, &p.name, p.value));
    shown.flatten().collect()
}

/// A value with its type; `None` if the parameter is not set.
fn show(node: &str, name: &str, value: rcl_interfaces::ParameterValue) -> Option<Shown> {
    let name = format!("{node}.{name}");
    let list = |values: Vec<ShownValue>| Shown {
        name: name.clone(),
        r#type: None,
        value: Some(ShownValue::Array(values)),
    };
    Some(match value.r#type {
        ParameterType::PARAMETER_BOOL => Shown::bool(name, value.bool_value),
        ParameterType::PARAMETER_INTEGER => Shown::integer(name, value.integer_value),
        ParameterType::PARAMETER_DOUBLE => Shown::float64(name, value.double_value),
        ParameterType::PARAMETER_STRING => Shown::string(name, value.string_value),
        ParameterType::PARAMETER_BYTE_ARRAY => {
            let bytes: Vec<_> = value.byte_array_value.iter().map(|b| b.0).collect();
            Shown::byte_array(name, &bytes)
        }
        ParameterType::PARAMETER_BOOL_ARRAY => {
            let values = value.bool_array_value.into_iter();
            list(values.map(ShownValue::Bool).collect())
        }
        ParameterType::PARAMETER_INTEGER_ARRAY => {
            Shown::integer_array(name, value.integer_array_value)
        }
        ParameterType::PARAMETER_DOUBLE_ARRAY => {
            Shown::float64_array(name, value.double_array_value)
        }
        ParameterType::PARAMETER_STRING_ARRAY => {
            let values = value.string_array_value.into_iter();
            list(values.map(ShownValue::String).collect())
        }
        _ => return None,
    })
}

/// A client's value converted to the type `kind` of the parameter; `None` if it does not fit. Whole numbers fit both
/// integers and floats, which JSON does not distinguish.
fn message(value: &ShownValue, kind: u8) -> Option<rcl_interfaces::ParameterValue> {
    let mut message = rcl_interfaces::ParameterValue {
        r#type: kind,
        ..Default::default()
    };
    let all = |value: &ShownValue| match value {
        ShownValue::Array(values) => Some(values.clone()),
        _ => None,
    };
    match kind {
        ParameterType::PARAMETER_BOOL => message.bool_value = truth(value)?,
        ParameterType::PARAMETER_INTEGER => message.integer_value = integer(value)?,
        ParameterType::PARAMETER_DOUBLE => message.double_value = double(value)?,
        ParameterType::PARAMETER_STRING => message.string_value = text(value)?,
        ParameterType::PARAMETER_BOOL_ARRAY => {
            message.bool_array_value = all(value)?.iter().map(truth).collect::<Option<_>>()?;
        }
        ParameterType::PARAMETER_INTEGER_ARRAY => {
            message.integer_array_value = all(value)?.iter().map(integer).collect::<Option<_>>()?;
        }
        ParameterType::PARAMETER_DOUBLE_ARRAY => {
            message.double_array_value = all(value)?.iter().map(double).collect::<Option<_>>()?;
        }
        ParameterType::PARAMETER_STRING_ARRAY => {
            message.string_array_value = all(value)?.iter().map(text).collect::<Option<_>>()?;
        }
        _ => return None,
    }
    Some(message)
}

fn truth(value: &ShownValue) -> Option<bool> {
    match value {
        ShownValue::Bool(b) => Some(*b),
        _ => None,
    }
}

fn integer(value: &ShownValue) -> Option<i64> {
    match value {
        ShownValue::Integer(i) => Some(*i),
        // Exact up to 2^53.
        ShownValue::Float64(x) if x.fract() == 0.0 && x.abs() < 9e15 => Some(*x as i64),
        _ => None,
    }
}

fn double(value: &ShownValue) -> Option<f64> {
    match value {
        ShownValue::Integer(i) => Some(*i as f64),
        ShownValue::Float64(x) => Some(*x),
        _ => None,
    }
}

fn text(value: &ShownValue) -> Option<String> {
    match value {
        ShownValue::String(s) => Some(s.clone()),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_keep_the_type_of_their_parameter() {
        let one = |kind| message(&ShownValue::Integer(1), kind);
        let double = one(ParameterType::PARAMETER_DOUBLE).unwrap();
        assert_eq!((double.r#type, double.double_value), (3, 1.0));
        let integer = message(&ShownValue::Float64(2.0), ParameterType::PARAMETER_INTEGER);
        assert_eq!(integer.unwrap().integer_value, 2);
        let fraction = message(&ShownValue::Float64(2.5), ParameterType::PARAMETER_INTEGER);
        assert!(fraction.is_none());
        assert!(one(ParameterType::PARAMETER_STRING).is_none());
        assert!(one(ParameterType::PARAMETER_NOT_SET).is_none());
        let list = ShownValue::Array(vec![ShownValue::Integer(1), ShownValue::Float64(0.5)]);
        let list = message(&list, ParameterType::PARAMETER_DOUBLE_ARRAY).unwrap();
        assert_eq!(list.double_array_value, [1.0, 0.5]);
        // Every value that is shown can be set unchanged.
        for kind in [2, 3, 7, 8] {
            let value = rcl_interfaces::ParameterValue {
                r#type: kind,
                integer_value: 3,
                double_value: 3.0,
                integer_array_value: vec![3],
                double_array_value: vec![3.0],
                ..Default::default()
            };
            let shown = show("/n", "p", value).unwrap();
            assert_eq!(shown.name, "/n.p");
            assert!(message(&shown.value.unwrap(), kind).is_some(), "{kind}");
        }
    }
}
