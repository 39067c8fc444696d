//! ROS definition of a service, and its type hash.

use super::{Definition, Interface, Kind, Service, type_hash};

/// Name, request and response of a service.
#[derive(Debug, Clone, Copy)]
pub struct ServiceDefinition {
    /// ROS package, `std_srvs`.
    pub package: &'static str,
    /// Kind of interface file: `.srv`, or `.action` for a service of an action.
    pub kind: Kind,
    /// Name within the package, `SetBool`.
    pub name: &'static str,
    /// Message from the client to the server.
    pub request: &'static Definition,
    /// Message from the server to the client.
    pub response: &'static Definition,
}

impl ServiceDefinition {
    /// The definition of the service `S`.
    pub fn of<S: Service>() -> Self {
        Self {
            package: S::PACKAGE,
            kind: S::Request::DEFINITION.kind,
            name: S::NAME,
            request: S::Request::DEFINITION,
            response: S::Response::DEFINITION,
        }
    }

    /// Full ROS name, `std_srvs/srv/SetBool`.
    pub fn type_name(&self) -> String {
        format!("{}/{}/{}", self.package, self.kind.name(), self.name)
    }

    /// RIHS01 hash of the service (REP-2011), which covers its request, response and event messages: `RIHS01_` and 64
    /// hexadecimal digits.
    pub fn type_hash(&self) -> String {
        type_hash::rihs01_of_service(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    mod example_interfaces {
        crate::services! {
            package example_interfaces;

            /// The service of the demos of ROS.
            service AddTwoInts {
                AddTwoIntsRequest {
                    /// First number.
                    a: i64,
                    /// Second number.
                    b: i64,
                }
                AddTwoIntsResponse {
                    /// Their sum.
                    sum: i64,
                }
            }
        }
    }

    // From the design document of rmw_zenoh. Fails if the event message of the service is not hashed as rosidl does.
    #[test]
    fn the_hash_of_a_service_is_that_of_ros() {
        let definition = ServiceDefinition::of::<example_interfaces::AddTwoInts>();
        assert_eq!(definition.type_name(), "example_interfaces/srv/AddTwoInts");
        assert_eq!(
            definition.type_hash(),
            "RIHS01_e118de6bf5eeb66a2491b5bda11202e7b68f198d6f67922cf30364858239c81a"
        );
    }
}
