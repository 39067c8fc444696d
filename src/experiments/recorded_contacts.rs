//! Targets that were touched in a recorded run.

use std::collections::BTreeSet;

use crate::{bag::Message, msg::ros_gz_interfaces::Contacts};

/// Namespaces of the targets that occur in `contacts`.
#[derive(Debug, Clone, Default)]
pub(super) struct TouchedTargets(BTreeSet<String>);

impl TouchedTargets {
    /// Adds a message; ignores other topics and types.
    pub fn accept(&mut self, message: &Message) {
        let Some(namespace) = message.topic.name.strip_suffix("/contacts") else {
            return;
        };
        if message.topic.type_name != "ros_gz_interfaces/msg/Contacts" {
            return;
        }
        // Undecodable messages are reported by the topic check.
        let Ok(message) = message.decode::<Contacts>() else {
            return;
        };
        for contact in &message.contacts {
            for entity in [&contact.collision1, &contact.collision2] {
                // A link is `TARGET/LINK`, or a link of a robot, whose name is no target's namespace.
                let body = entity.name.split('/').next().unwrap_or_default();
                let name = format!("{namespace}/ground_truth/{body}");
                if !self.0.contains(&name) {
                    self.0.insert(name);
                }
            }
        }
    }

    /// Whether anything has touched the target in `namespace`.
    pub fn contains(&self, namespace: &str) -> bool {
        self.0.contains(namespace)
    }
}
