//! Services for the operator's client: control of the simulation and of the recorder, and taking control.

use std::{
    sync::{Arc, Mutex, PoisonError},
    time::{Duration, Instant},
};

use foxglove::{
    Schema,
    websocket::{
        ClientId,
        service::{Request, Service as Served, ServiceSchema},
    },
};

use super::{client_topics::ClientTopics, control::Control};
use crate::{
    msg::{
        Interface, Service, cdr,
        rosbag2_interfaces::{IsPaused, Pause, Resume, SplitBagfile},
        simulation_interfaces::services::{
            DeleteEntity, GetEntities, GetEntitiesStates, GetEntityInfo, GetEntityState,
            GetSimulationState, GetSimulatorFeatures, GetSpawnables, ResetSimulation,
            SetEntityState, SetSimulationState, SpawnEntity, StepSimulation,
        },
        std_srvs::{SetBool, SetBoolResponse},
    },
    ros::{Node, NodeError},
};

/// Timeout of a call; steps of a simulation may take long.
const PATIENCE: Duration = Duration::from_secs(30);

type Shared = Arc<Mutex<Control<ClientId>>>;

/// The services offered for the node with the full name `node`, chosen by the last part of the name; none for most
/// nodes.
///
/// # Errors
/// When DDS reports an error.
pub fn of_node(own: &Node, node: &str, control: &Shared) -> Result<Vec<Served>, NodeError> {
    let offer = Offer { own, node, control };
    match node.rsplit('/').next() {
        Some("dynamics") => Ok(vec![
            offer.reading::<GetSimulatorFeatures>("get_simulator_features")?,
            offer.reading::<GetSimulationState>("get_simulation_state")?,
            offer.changing::<SetSimulationState>("set_simulation_state")?,
            offer.changing::<StepSimulation>("step_simulation")?,
            offer.changing::<ResetSimulation>("reset_simulation")?,
            offer.reading::<GetEntities>("get_entities")?,
            offer.reading::<GetEntitiesStates>("get_entities_states")?,
            offer.reading::<GetEntityInfo>("get_entity_info")?,
            offer.reading::<GetEntityState>("get_entity_state")?,
            offer.changing::<SetEntityState>("set_entity_state")?,
            offer.changing::<SpawnEntity>("spawn_entity")?,
            offer.changing::<DeleteEntity>("delete_entity")?,
            offer.reading::<GetSpawnables>("get_spawnables")?,
        ]),
        Some("recorder") => Ok(vec![
            offer.reading::<IsPaused>("is_paused")?,
            offer.changing::<Pause>("pause")?,
            offer.changing::<Resume>("resume")?,
            offer.changing::<SplitBagfile>("split_bagfile")?,
        ]),
        _ => Ok(Vec::new()),
    }
}

struct Offer<'a> {
    own: &'a Node,
    node: &'a str,
    control: &'a Shared,
}

impl Offer<'_> {
    /// A service that changes nothing: every client may call it.
    fn reading<S: Service>(&self, name: &str) -> Result<Served, NodeError> {
        self.service::<S>(name, None)
    }

    /// A service that only the client in control may call.
    fn changing<S: Service>(&self, name: &str) -> Result<Served, NodeError> {
        self.service::<S>(name, Some(Arc::clone(self.control)))
    }

    fn service<S: Service>(
        &self,
        name: &str,
        control: Option<Shared>,
    ) -> Result<Served, NodeError> {
        let name = format!("{}/{name}", self.node);
        let client = self.own.client::<S>(&name)?;
        let answer = move |request: Request| -> Result<Vec<u8>, String> {
            if let Some(control) = &control {
                let control = control.lock().unwrap_or_else(PoisonError::into_inner);
                if !control.holds(request.client_id()) {
                    return Err(format!("{}: take control first", request.service_name()));
                }
            }
            let decoded = cdr::decode::<S::Request>(request.payload());
            let decoded = decoded.map_err(|e| format!("{}: {e}", request.service_name()))?;
            let response = client.call(&decoded, PATIENCE).map_err(|e| e.to_string())?;
            Ok(cdr::encode(&response))
        };
        Ok(Served::builder(name, schema::<S>()).blocking_handler_fn(answer))
    }
}

/// The service by which a client takes and keeps control (`true`), or releases it (`false`). The response says whether
/// the client has control now.
pub fn control(name: &str, control: &Shared, topics: &Arc<ClientTopics>) -> Served {
    let (control, topics) = (Arc::clone(control), Arc::clone(topics));
    let answer = move |request: Request| -> Result<Vec<u8>, String> {
        let wish: crate::msg::std_srvs::SetBoolRequest =
            cdr::decode(request.payload()).map_err(|e| e.to_string())?;
        let client = request.client_id();
        if !wish.data {
            topics.release(client);
        }
        let mut control = control.lock().unwrap_or_else(PoisonError::into_inner);
        let success = wish.data && control.take(client, Instant::now());
        let message = match (success, control.is_held()) {
            (true, _) => "this client has control",
            (false, true) => "another client has control",
            (false, false) => "nobody has control",
        };
        Ok(cdr::encode(&SetBoolResponse {
            success,
            message: message.to_owned(),
        }))
    };
    Served::builder(name, schema::<SetBool>()).handler_fn(answer)
}

fn schema<S: Service>() -> ServiceSchema {
    let part = |definition: &crate::msg::Definition| {
        let text = definition.schema_text().into_bytes();
        Schema::new(definition.type_name(), "ros2msg", text)
    };
    ServiceSchema::new(format!("{}/srv/{}", S::PACKAGE, S::NAME))
        .with_request("cdr", part(S::Request::DEFINITION))
        .with_response("cdr", part(S::Response::DEFINITION))
}
