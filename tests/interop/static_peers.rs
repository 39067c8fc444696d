//! Discovery without multicast, by `ROS_STATIC_PEERS`.

use crate::{link_loss::Split, waiting::PATIENCE, wire::Wire};

// Fails if no announcement is sent to the peer, or if data are sent by multicast.
#[test]
fn a_static_peer_is_found_without_multicast() {
    let Some(wire) = Wire::without_multicast(["static", "peer"]) else {
        return;
    };
    let [near, far] = ["ROS_STATIC_PEERS=10.98.0.2", "ROS_STATIC_PEERS=10.98.0.1"];
    Split::new(wire, 114, [&[near], &[far]], &[]).all_receive(0.0, 3 * PATIENCE);
}

// As over a tunnel: nothing but loopback and the interface towards the peer is used.
#[test]
fn static_peers_are_added_to_the_local_computer() {
    let Some(wire) = Wire::without_multicast(["tunnel", "gate"]) else {
        return;
    };
    let local = "ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST";
    let [near, far] = ["ROS_STATIC_PEERS=10.98.0.2", "ROS_STATIC_PEERS=10.98.0.1"];
    Split::new(wire, 115, [&[local, near], &[local, far]], &[]).all_receive(0.0, 3 * PATIENCE);
}
