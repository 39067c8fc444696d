//! Targets with joints that a real rclpy node adds to a running simulation, removes and resets.

use serde_json::{Value, json};

use crate::{
    lateness::repeat_if_late,
    observer::{JOINT_STATE, fresh, numbers},
    simulation_control::{OK, Simulation},
};

const DOMAIN: u16 = 132;
const SPAWNED: &str = "/chaser/ground_truth/sail/joint_states";

/// A hull of 20 kg m² and a panel of 5 kg m² that a spring of 8 N m/rad turns to 0.5 rad, about a hinge through both
/// centres of mass.
const SAIL: &str = r#"<robot name="sail">
    <link name="hull"><inertial><mass value="40"/>
        <inertia ixx="20" iyy="20" izz="20" ixy="0" ixz="0" iyz="0"/></inertial></link>
    <link name="panel"><inertial><mass value="10"/>
        <inertia ixx="5" iyy="5" izz="5" ixy="0" ixz="0" iyz="0"/></inertial></link>
    <joint name="hinge" type="continuous"><parent link="hull"/><child link="panel"/><axis xyz="0 0 1"/></joint>
    <gazebo reference="hinge"><springStiffness>8</springStiffness><springReference>0.5</springReference></gazebo>
</robot>"#;

/// Angle of the hinge `time` after the spring was released \[rad\].
fn angle(time: f64) -> f64 {
    let reduced: f64 = 20.0 * 5.0 / 25.0;
    0.5 * (1.0 - ((8.0 / reduced).sqrt() * time).cos())
}

/// The hinge's angle in the last joint states.
fn seen(sim: &mut Simulation) -> f64 {
    let states = fresh(&mut sim.peer, SPAWNED, 2);
    let last = states.last().expect("a state");
    assert_eq!(last["name"], json!(["hinge"]));
    assert_eq!(last["header"]["frame_id"], "sail");
    numbers(&last["position"])[0]
}

fn spawn(sim: &mut Simulation, code: u64, request: Value) {
    sim.gets(code, "spawn_entity", "SpawnEntity", request);
}

// Would break if spawned joints were held, or missing in joint_states, tf or the reset.
#[test]
fn a_spawned_target_moves_its_joints() {
    repeat_if_late(|| {
        let mut sim = Simulation::start(DOMAIN);
        let sail = json!({
            "name": "sail", "entity_resource": {"resource_string": SAIL},
            "initial_pose": {"pose": {"position": {"x": -3.0}}},
        });
        spawn(&mut sim, OK, sail.clone());
        sim.peer.subscribe(SPAWNED, JOINT_STATE, "reliable");
        (sim.peer).subscribe("/tf", "tf2_msgs/msg/TFMessage", "reliable");
        sim.step(OK, 100);
        let off = seen(&mut sim) - angle(1.0);
        assert!(off.abs() < 1e-9, "{off}");

        // Viewers see the panel in the hull's frame.
        let transforms = fresh(&mut sim.peer, "/tf", 1);
        let transforms = transforms[0]["transforms"]
            .as_array()
            .expect("a list")
            .clone();
        let of = |child: &str| {
            let found = transforms.iter().find(|t| t["child_frame_id"] == child);
            found
                .unwrap_or_else(|| panic!("no {child} in {transforms:?}"))
                .clone()
        };
        assert_eq!(of("sail")["header"]["frame_id"], "world");
        let panel = of("sail/panel");
        assert_eq!(panel["header"]["frame_id"], "sail");
        let turned = &panel["transform"]["rotation"];
        let [z, w] = ["z", "w"].map(|key| turned[key].as_f64().expect("a number"));
        assert!((2.0 * z.atan2(w) - angle(1.0)).abs() < 1e-9, "{panel}");

        // Its links are frames of requests, and their names are taken.
        let info = json!({"entity": "sail"});
        let info = sim.gets(OK, "get_entity_info", "GetEntityInfo", info)["info"].clone();
        let said = info["description"].as_str().expect("text");
        assert!(said.contains("2 bodies, 1 joints"), "{said}");
        spawn(
            &mut sim,
            101,
            json!({
                "name": "panel", "entity_namespace": "sail", "entity_resource": {"resource_string": SAIL},
            }),
        );
        let on_panel =
            json!({"header": {"frame_id": "sail/panel"}, "pose": {"position": {"z": 2.0}}});
        let request = json!({"entity": "target", "state": on_panel, "set_pose": true});
        sim.gets(OK, "set_entity_state", "SetEntityState", request);
        let is = sim.of("target")["pose"]["position"].clone();
        let expected = json!({"x": -3.0, "y": 0.0, "z": 2.0});
        for axis in ["x", "y", "z"] {
            let off = is[axis].as_f64().expect("a number") - expected[axis].as_f64().expect("one");
            assert!(off.abs() < 1e-12, "{is}");
        }

        // A move of the hull keeps the joints; a reset of the state does not.
        let moved = json!({"pose": {"position": {"x": 5.0}}});
        let request = json!({"entity": "sail", "state": moved, "set_pose": true});
        sim.gets(OK, "set_entity_state", "SetEntityState", request);
        assert!((seen(&mut sim) - angle(1.0)).abs() < 1e-9);
        sim.gets(
            OK,
            "reset_simulation",
            "ResetSimulation",
            json!({"scope": 2}),
        );
        assert_eq!(seen(&mut sim), 0.0);
        sim.step(OK, 50);
        assert!((seen(&mut sim) - angle(0.5)).abs() < 1e-9);

        // Another one of the same name, with another joint.
        let delete = |sim: &mut Simulation| {
            let request = json!({"entity": "sail"});
            sim.gets(OK, "delete_entity", "DeleteEntity", request);
        };
        delete(&mut sim);
        spawn(&mut sim, OK, sail);
        assert_eq!(seen(&mut sim), 0.0);
        sim.gets(
            OK,
            "reset_simulation",
            "ResetSimulation",
            json!({"scope": 4}),
        );
        assert_eq!(sim.entities(json!({"filter": "sail"})).len(), 0);

        // A robot is a body as any other.
        let servicer = json!({
            "name": "derelict",
            "entity_resource": {"uri": "package://fuyu/urdf/servicer.urdf"},
            "initial_pose": {"pose": {"position": {"y": 20.0}}},
        });
        spawn(&mut sim, OK, servicer);
        sim.step(OK, 5);
        let far = json!({
            "name": "lost", "entity_resource": {"resource_string": SAIL},
            "initial_pose": {"pose": {"position": {"x": 1e14}}},
        });
        spawn(&mut sim, 109, far);
        sim.dynamics.interrupt().well();
    });
}
