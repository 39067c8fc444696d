//! Grasps over DDS: the services `~/attach` and `~/detach` of the dynamics node.

use serde_json::{Value, json};

use crate::{
    peer::Peer,
    process::{Running, command, source},
};

const DOMAIN: u16 = 133;

/// A dynamics node with a target that its hand latches from up to `distance` \[m\].
fn dynamics(folder: &std::path::Path, distance: f64) -> Running {
    let text = format!(
        "dynamics:
  ros__parameters:
    urdf: {}
    state_rate: 20.0
    targets: [debris]
    debris:
      urdf: {}
      position: [5.0, 2.0, 0.5]
    grasps: [hand]
    hand:
      frame: tool0
      target: debris
      distance: {distance:.1}
      angle: 3.2
",
        source("urdf/servicer.urdf").display(),
        source("urdf/target.urdf").display(),
    );
    let path = folder.join("grasp.yaml");
    std::fs::write(&path, text).unwrap();
    let mut node = command("dynamics", DOMAIN);
    node.args(["--ros-args", "--params-file"]).arg(path);
    Running::start(node)
}

fn call(peer: &mut Peer, service: &str) -> (bool, String) {
    let answer = peer.does(json!({
        "do": "call", "service": format!("dynamics/{service}"), "type": "std_srvs/srv/Trigger", "request": {},
    }));
    let response: &Value = &answer["response"];
    let success = response["success"].as_bool();
    let message = response["message"].as_str();
    (
        success.unwrap_or_else(|| panic!("{answer}")),
        message.unwrap_or_else(|| panic!("{answer}")).to_owned(),
    )
}

// Fails if a latch closes from too far away, if a refusal has no reason, or if a closed latch does not open.
#[test]
fn an_operator_attaches_and_detaches() {
    let folder = tempfile::tempdir().unwrap();

    let mut node = dynamics(folder.path(), 0.1);
    let mut peer = Peer::start("operator", DOMAIN);
    let (attached, reason) = call(&mut peer, "attach");
    assert!(!attached && reason.contains("hand"), "{reason}");
    let (detached, reason) = call(&mut peer, "detach");
    assert!(!detached && reason == "no grasp is closed", "{reason}");
    drop(peer);
    node.interrupt().well();

    let mut node = dynamics(folder.path(), 50.0);
    // A new client, which has not known the node before.
    let mut peer = Peer::start("operator", DOMAIN);
    let (attached, said) = call(&mut peer, "attach");
    assert!(attached, "{said}");
    let (again, reason) = call(&mut peer, "attach");
    assert!(!again && reason.contains("closed already"), "{reason}");
    let (detached, said) = call(&mut peer, "detach");
    assert!(detached, "{said}");
    node.interrupt().well();
}
