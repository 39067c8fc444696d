//! ROS package [`ros_gz_interfaces`](https://docs.ros.org/en/jazzy/p/ros_gz_interfaces/): contacts.

use super::geometry_msgs::{Vector3, Wrench};
use super::std_msgs::{Header, String as Text, UInt32};

crate::messages! {
    package ros_gz_interfaces;

    /// Something in a simulation.
    message Entity {
        /// Its number, or 0.
        id: u64,
        /// Its name.
        name: String,
        /// One of the constants.
        r#type: u8,
    }
    constants {
        /// Nothing.
        NONE: u8 = 0,
        /// A light.
        LIGHT: u8 = 1,
        /// A body with all of its links.
        MODEL: u8 = 2,
        /// A link.
        LINK: u8 = 3,
        /// What is seen of a link.
        VISUAL: u8 = 4,
        /// What of a link can touch.
        COLLISION: u8 = 5,
        /// A sensor.
        SENSOR: u8 = 6,
        /// A joint.
        JOINT: u8 = 7,
    }

    /// Wrenches between two bodies.
    message JointWrench {
        /// Time, and frame of the axes.
        header: Header,
        /// Name of the first body.
        body_1_name: Text,
        /// Its number.
        body_1_id: UInt32,
        /// Name of the second body.
        body_2_name: Text,
        /// Its number.
        body_2_id: UInt32,
        /// Wrench on the first body.
        body_1_wrench: Wrench,
        /// Wrench on the second body.
        body_2_wrench: Wrench,
    }

    /// Contact of two bodies. Lists have one element per point.
    message Contact {
        /// The first.
        collision1: Entity,
        /// The second.
        collision2: Entity,
        /// Where they touch \[m\].
        positions: Vec<Vector3>,
        /// Unit normals.
        normals: Vec<Vector3>,
        /// How deep they are in each other \[m\].
        depths: Vec<f64>,
        /// Forces, about the points.
        wrenches: Vec<JointWrench>,
    }

    /// All contacts at a time.
    message Contacts {
        /// Time, and frame of positions and axes.
        header: Header,
        /// The contacts.
        contacts: Vec<Contact>,
    }
}
