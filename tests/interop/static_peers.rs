//! Discovery without multicast, by `ROS_STATIC_PEERS`.

use crate::{
    two_computers::{START, Settings, TwoComputers},
    wire::Wire,
};

const NEAR: &str = "ROS_STATIC_PEERS=10.98.0.2";
const FAR: &str = "ROS_STATIC_PEERS=10.98.0.1";

// Fails if no announcement is sent to the peer, or if data are sent by multicast.
#[test]
fn a_static_peer_is_found_without_multicast() {
    let Some(wire) = Wire::without_multicast(["static", "peer"]) else {
        return;
    };
    let settings = Settings {
        environment: [&[NEAR], &[FAR]],
        dynamics_first: true,
        ..Settings::default()
    };
    TwoComputers::start(wire, 114, settings).all_receive(0.0, START);
}

// As over a tunnel: nothing but loopback and the interface towards the peer is used.
#[test]
fn static_peers_are_added_to_the_local_computer() {
    let Some(wire) = Wire::without_multicast(["tunnel", "gate"]) else {
        return;
    };
    let local = "ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST";
    let settings = Settings {
        environment: [&[local, NEAR], &[local, FAR]],
        ..Settings::default()
    };
    TwoComputers::start(wire, 115, settings).all_receive(0.0, START);
}
