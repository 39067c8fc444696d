//! A robot over a WireGuard tunnel: its routers connect within the tunnel.

use super::{
    network::{Network, Transport},
    robot::Robot,
};
use crate::{two_computers::START, wire::Wire, wireguard};

// Fails if anything but the connection of the routers is needed between the computers.
#[test]
fn a_robot_works_over_wireguard_and_zenoh() {
    if !wireguard::is_installed() {
        return;
    }
    let Some(wire) = Wire::without_multicast(["zguard", "zguardfar"]) else {
        return;
    };
    let folder = tempfile::tempdir().expect("a folder");
    let _tunnel = wireguard::tunnel(&wire, folder.path());
    let network = Network::new(wire, Transport::Zenoh, 214, "10.44.0.1");
    Robot::start(network, &[], &[]).all_receive(START);
}
