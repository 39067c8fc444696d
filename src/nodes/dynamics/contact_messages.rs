//! Contacts as a message.

use super::{
    messages::{WORLD, header},
    world::{LinkContact, World},
};
use crate::{
    msg::{
        geometry_msgs::{Vector3, Wrench},
        ros_gz_interfaces::{Contact, Contacts, Entity, JointWrench},
        std_msgs,
    },
    nodes::geometry::vector_to_msg,
    ros::Time,
};

/// The contacts of the world: points and forces in world axes, normals from the second link to the first, wrenches
/// about the contact points.
pub fn contacts(stamp: Time, world: &World) -> Contacts {
    let mut message = Contacts {
        header: header(stamp, WORLD),
        contacts: Vec::new(),
    };
    for found in world.contact_points() {
        let [first, second] = found.links;
        let is_of_links = |c: &Contact| c.collision1.name == first && c.collision2.name == second;
        let known = message.contacts.iter().position(is_of_links);
        let index = known.unwrap_or_else(|| {
            message.contacts.push(Contact {
                collision1: link(first),
                collision2: link(second),
                ..Contact::default()
            });
            message.contacts.len() - 1
        });
        add(&mut message.contacts[index], stamp, &found);
    }
    message
}

fn link(name: &str) -> Entity {
    Entity {
        id: 0,
        name: name.to_owned(),
        r#type: Entity::LINK,
    }
}

fn add(contact: &mut Contact, stamp: Time, found: &LinkContact) {
    let point = &found.point;
    let force = |factor: f64| Wrench {
        force: vector_to_msg(&(point.force * factor)),
        torque: Vector3::default(),
    };
    let name = |name: &str| std_msgs::String {
        data: name.to_owned(),
    };
    contact.positions.push(vector_to_msg(&point.at));
    contact.normals.push(vector_to_msg(&point.normal));
    contact.depths.push(point.depth);
    contact.wrenches.push(JointWrench {
        header: header(stamp, WORLD),
        body_1_name: name(found.links[0]),
        body_2_name: name(found.links[1]),
        body_1_wrench: force(1.0),
        body_2_wrench: force(-1.0),
        ..JointWrench::default()
    });
}
