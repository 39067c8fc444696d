//! RIHS01 type hashes: SHA-256 of the canonical JSON of a type description (REP-2011, REP-2016).

use sha2::{Digest, Sha256};
use std::{collections::BTreeMap, fmt::Write as _};

use super::{
    Base, Definition, FieldDefinition, Interface, ServiceDefinition, Shape,
    builtin_interfaces::Time,
};

pub(super) fn rihs01(definition: &Definition) -> String {
    let mut referenced = definition.dependencies();
    referenced.sort_by_key(|d| d.type_name());
    let referenced: Vec<String> = referenced.iter().map(|d| description(d)).collect();
    hash(&description(definition), &referenced)
}

fn hash(described: &str, referenced: &[String]) -> String {
    let json = format!(
        "{{\"type_description\": {described}, \"referenced_type_descriptions\": [{}]}}",
        referenced.join(", ")
    );
    let mut hash = String::from("RIHS01_");
    for byte in Sha256::digest(json) {
        let _ = write!(hash, "{byte:02x}");
    }
    hash
}

/// RIHS01 hash of a service: that of a message with the fields request, response and event, whose event message
/// contains the other two.
pub(super) fn rihs01_of_service(service: &ServiceDefinition) -> String {
    let name = service.type_name();
    let event = format!("{name}_Event");
    let (request, response) = (service.request.type_name(), service.response.type_name());
    let message = |field, name: &str| typed_field(field, MESSAGE, 0, name);
    let fields = [
        message("request_message", &request),
        message("response_message", &response),
        message("event_message", &event),
    ];
    let event_fields = [
        message("info", EVENT_INFO),
        typed_field("request", MESSAGE + BOUNDED, 1, &request),
        typed_field("response", MESSAGE + BOUNDED, 1, &response),
    ];
    let info_fields = [
        typed_field("event_type", primitive_id(Base::Uint8), 0, ""),
        message("stamp", &Time::DEFINITION.type_name()),
        typed_field("client_gid", primitive_id(Base::Uint8) + ARRAY, 16, ""),
        typed_field("sequence_number", primitive_id(Base::Int64), 0, ""),
    ];
    let parts = [service.request, service.response, Time::DEFINITION];
    let contained = parts.iter().flat_map(|part| part.dependencies());
    let messages = contained.chain(parts.iter().copied());
    // Sorted by name, each once.
    let mut referenced: BTreeMap<_, _> =
        messages.map(|d| (d.type_name(), description(d))).collect();
    referenced.insert(event.clone(), described(&event, &event_fields));
    referenced.insert(EVENT_INFO.to_owned(), described(EVENT_INFO, &info_fields));
    let referenced: Vec<_> = referenced.into_values().collect();
    hash(&described(&name, &fields), &referenced)
}

/// Message type with the metadata of a service event.
const EVENT_INFO: &str = "service_msgs/msg/ServiceEventInfo";

/// Type ids of `type_description_interfaces/msg/FieldType`: a message, and the offsets for arrays and bounded
/// sequences.
const MESSAGE: usize = 1;
const ARRAY: usize = 48;
const BOUNDED: usize = 96;

// Written by hand since the hash fixes the order of keys and every space.
fn description(definition: &Definition) -> String {
    let fields: Vec<String> = definition.fields.iter().map(field).collect();
    described(&definition.type_name(), &fields)
}

fn described(name: &str, fields: &[String]) -> String {
    format!(
        "{{\"type_name\": \"{name}\", \"fields\": [{}]}}",
        fields.join(", ")
    )
}

fn field(f: &FieldDefinition) -> String {
    let (id, nested) = match f.ty.base {
        Base::Message(d) => (MESSAGE, d.type_name()),
        base => (primitive_id(base), String::new()),
    };
    let (offset, capacity) = match f.ty.shape {
        Shape::One => (0, 0),
        Shape::Array(n) => (ARRAY, n),
        Shape::Bounded(n) => (BOUNDED, n),
        Shape::Sequence => (144, 0),
    };
    typed_field(f.name, id + offset, capacity, &nested)
}

fn typed_field(name: &str, id: usize, capacity: usize, nested: &str) -> String {
    format!(
        "{{\"name\": \"{name}\", \"type\": {{\"type_id\": {id}, \"capacity\": {capacity}, \"string_capacity\": 0, \
         \"nested_type_name\": \"{nested}\"}}}}"
    )
}

fn primitive_id(base: Base) -> usize {
    match base {
        Base::Message(_) => MESSAGE,
        Base::Int8 => 2,
        Base::Uint8 => 3,
        Base::Int16 => 4,
        Base::Uint16 => 5,
        Base::Int32 => 6,
        Base::Uint32 => 7,
        Base::Int64 => 8,
        Base::Uint64 => 9,
        Base::Float32 => 10,
        Base::Float64 => 11,
        Base::Bool => 15,
        Base::Byte => 16,
        Base::String => 17,
    }
}

#[cfg(test)]
mod tests {
    use crate::msg::*;

    // From the packages of ROS 2 Jazzy. The tests of bags compare every type with installed ones.
    #[test]
    fn hashes_are_those_of_ros() {
        let cases = [
            (
                // All kinds of fields but bounded sequences: fixed arrays, sequences, and messages nested two deep.
                sensor_msgs::CameraInfo::DEFINITION,
                "RIHS01_b3dfd68ff46c9d56c80fd3bd4ed22c7a4ddce8c8348f2f59c299e73118e7e275",
            ),
            (
                // An array that Rust declares as nested arrays.
                nav_msgs::Odometry::DEFINITION,
                "RIHS01_3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0",
            ),
            (
                // Bounded sequences, default values, a field named by a Rust keyword.
                rcl_interfaces::ParameterDescriptor::DEFINITION,
                "RIHS01_52175dbfda6c51153101d33d2a9da05743f66f02d5ab2ca9ec4709b46b73d704",
            ),
            (
                // No fields.
                std_msgs::Empty::DEFINITION,
                "RIHS01_20b625256f32d5dbc0d04fee44f43c41e51c70d3502f84b4a08e7a9c26a96312",
            ),
            (
                // A message of this project, as rosidl hashes `msg/Momentum.msg`.
                fuyu_msgs::Momentum::DEFINITION,
                "RIHS01_0adc397bf3b06173447fd54f95563e1a9f38e4be8c03d347ba848ba67cbc3647",
            ),
            (
                fuyu_msgs::ControllerState::DEFINITION,
                "RIHS01_a22a1ca073e5b5b0a89623dcd865e2980cfbc9537acb8cceb87382ca5d136a23",
            ),
            (
                fuyu_msgs::FeatureTracks::DEFINITION,
                "RIHS01_b32dbc5b16464fc25accec8d5efefd0a558c3cdfdf18507cb76810f4d0ce69c9",
            ),
            (
                // Request of a service.
                std_srvs::SetBoolRequest::DEFINITION,
                "RIHS01_c62fbb99d94e1b25e8ef9e109f9581956bb1b3361a45a4e5810c36a90d29932e",
            ),
            (
                // Of simulation_interfaces 2.1, as rosidl hashes it: filters, bounds, tags.
                simulation_interfaces::services::GetEntitiesStatesRequest::DEFINITION,
                "RIHS01_0af5302d3526834e83bd9861fbcc5214af2b9a4b0c93a965840fb1a6c2891724",
            ),
            (
                simulation_interfaces::services::GetEntitiesStatesResponse::DEFINITION,
                "RIHS01_b651848f4d93a2b0ec5ec3f36659297ca30547c499f933eb279b60f8be434315",
            ),
            (
                simulation_interfaces::services::SpawnEntitiesRequest::DEFINITION,
                "RIHS01_03f070057ac2ab26d723fe9f07c7d57bd39ace34ad34bb043cdbca36825c98d9",
            ),
            (
                simulation_interfaces::services::GetSimulatorFeaturesResponse::DEFINITION,
                "RIHS01_ede4dc8227cbb2f86a24612c999dcaa67d17dab21dab566cefdc233e7a2a65d1",
            ),
            (
                // Parts of an action.
                simulation_interfaces::simulate_steps::SendGoalRequest::DEFINITION,
                "RIHS01_275e6fd2fafc5d33dcdc83bdea6de5cf29f30b9df74a3b9514a8c5d501fd0fe3",
            ),
            (
                simulation_interfaces::simulate_steps::FeedbackMessage::DEFINITION,
                "RIHS01_a30dee7ee7380769e616406ec5067b238aa2b27e1dbd7a5957fba1d908d7754d",
            ),
        ];
        for (definition, hash) in cases {
            assert_eq!(definition.type_hash(), hash, "{}", definition.type_name());
        }
    }
}
