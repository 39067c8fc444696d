//! The simulation under the control of a real rclpy node, by the services and the action of `simulation_interfaces`.

use serde_json::{Value, json};

use crate::{
    joining::peer_with_interfaces,
    lateness::repeat_if_late,
    observer::{JOINT_STATE, ODOMETRY, fresh},
    peer::Peer,
    process::{Running, command, source},
    waiting::{PATIENCE, eventually},
};

const NAMESPACE: &str = "/chaser";
const TARGET: &str = "package://fuyu/urdf/target.urdf";

// Codes of the standard.
const UNSUPPORTED: u64 = 0;
pub const OK: u64 = 1;
const NOT_FOUND: u64 = 2;
pub const FAILED: u64 = 4;

const STOPPED: u64 = 0;
pub const PLAYING: u64 = 1;
pub const PAUSED: u64 = 2;
const QUITTING: u64 = 3;

/// The dynamics node of servicing.yaml in a namespace, paused, and the rclpy node that controls it.
pub struct Simulation {
    pub dynamics: Running,
    pub peer: Peer,
}

impl Simulation {
    pub fn start(domain: u16) -> Self {
        let mut dynamics = command("dynamics", domain);
        dynamics
            .args(["--ros-args", "-r", "__ns:=/chaser", "--params-file"])
            .arg(source("config/servicing.yaml"))
            .args(["-p", "start_paused:=true", "-p", "start_on_command:=false"]);
        Self {
            dynamics: Running::start(dynamics),
            peer: peer_with_interfaces("operator", domain),
        }
    }

    pub fn call(&mut self, service: &str, kind: &str, request: Value) -> Value {
        let answer = self.peer.does(json!({
            "do": "call", "service": format!("{NAMESPACE}/dynamics/{service}"),
            "type": format!("simulation_interfaces/srv/{kind}"), "request": request,
        }));
        answer["response"].clone()
    }

    /// Calls a service; gives its response, whose result must have this code.
    pub fn gets(&mut self, code: u64, service: &str, kind: &str, request: Value) -> Value {
        let response = self.call(service, kind, request.clone());
        let result = &response["result"];
        assert_eq!(result["result"], code, "{service} {request}: {response}");
        let said = result["error_message"].as_str().expect("a text");
        assert!(code == OK || !said.is_empty(), "{service} gives no reason");
        response
    }

    pub fn go(&mut self, code: u64, state: u64) -> Value {
        let request = json!({"state": {"state": state}});
        self.gets(code, "set_simulation_state", "SetSimulationState", request)
    }

    fn state(&mut self) -> u64 {
        let response = self.gets(OK, "get_simulation_state", "GetSimulationState", json!({}));
        response["state"]["state"].as_u64().expect("a state")
    }

    pub fn step(&mut self, code: u64, steps: u64) -> Value {
        let request = json!({"steps": steps});
        self.gets(code, "step_simulation", "StepSimulation", request)
    }

    fn reset(&mut self, code: u64, scope: u64) {
        let request = json!({"scope": scope});
        self.gets(code, "reset_simulation", "ResetSimulation", request);
    }

    pub fn of(&mut self, entity: &str) -> Value {
        let request = json!({"entity": entity});
        let response = self.gets(OK, "get_entity_state", "GetEntityState", request);
        response["state"].clone()
    }

    /// Simulated time \[ns\].
    pub fn time(&mut self) -> u64 {
        nanos(&self.of("target")["header"]["stamp"])
    }

    pub fn entities(&mut self, filters: Value) -> Vec<String> {
        let request = json!({"filters": filters});
        let response = self.gets(OK, "get_entities", "GetEntities", request);
        serde_json::from_value(response["entities"].clone()).expect("names")
    }

    /// The complete state of the world that the standard provides.
    fn snapshot(&mut self) -> Value {
        let request = json!({"filters": {}});
        self.gets(OK, "get_entities_states", "GetEntitiesStates", request)
    }

    fn spawn(&mut self, code: u64, request: Value) -> String {
        let response = self.gets(code, "spawn_entity", "SpawnEntity", request);
        response["entity_name"].as_str().expect("a name").to_owned()
    }
}

fn nanos(stamp: &Value) -> u64 {
    let part = |name: &str| stamp[name].as_u64().expect("a time");
    part("sec") * 1_000_000_000 + part("nanosec")
}

fn resource(uri: &str) -> Value {
    json!({"uri": uri})
}

#[test]
fn time_plays_pauses_steps_and_restarts() {
    repeat_if_late(|| {
        let mut sim = Simulation::start(1);
        let response = sim.call("get_simulator_features", "GetSimulatorFeatures", json!({}));
        let features = response["features"]["features"].as_array().expect("a list");
        for feature in [0, 1, 10, 11, 20, 24, 25, 26, 31, 32, 33] {
            assert!(features.contains(&json!(feature)), "{feature}: {response}");
        }
        assert!(!features.contains(&json!(40)), "{response}");

        assert_eq!((sim.state(), sim.time()), (PAUSED, 0));
        sim.step(OK, 5);
        assert_eq!((sim.state(), sim.time()), (PAUSED, 50_000_000));
        let first = sim.snapshot();

        sim.go(OK, PLAYING);
        sim.go(101, PLAYING);
        let said = sim.step(FAILED, 1)["result"]["error_message"].to_string();
        assert!(said.contains("playing; pause it first"), "{said}");
        eventually("time goes on", PATIENCE, || {
            (sim.time() > 100_000_000).then_some(())
        });
        sim.go(OK, PAUSED);
        let paused = sim.time();
        sim.peer
            .subscribe("/chaser/joint_states", JOINT_STATE, "reliable");
        let states = fresh(&mut sim.peer, "/chaser/joint_states", 3);
        assert!(
            states
                .iter()
                .all(|s| nanos(&s["header"]["stamp"]) == paused),
            "time goes on while paused: {states:?}"
        );
        sim.go(103, 7);
        sim.go(103, 4);

        // Bit-identical to the same steps before.
        sim.go(OK, STOPPED);
        assert_eq!((sim.state(), sim.time()), (STOPPED, 0));
        sim.step(FAILED, 1);
        sim.go(OK, PAUSED);
        sim.step(OK, 2);
        sim.step(OK, 3);
        assert_eq!(sim.snapshot(), first);

        // Scopes of a reset, one by one.
        let moved = sim.of("target");
        sim.reset(OK, 1);
        let again = sim.of("target");
        assert_eq!(nanos(&again["header"]["stamp"]), 0);
        assert_eq!(again["pose"], moved["pose"]);
        sim.step(OK, 4);
        sim.reset(OK, 2);
        let start = sim.of("target");
        assert_eq!(nanos(&start["header"]["stamp"]), 40_000_000);
        close(
            &start["pose"]["position"],
            &json!({"x": 1.0, "y": 12.0, "z": 1.0}),
        );
        sim.reset(UNSUPPORTED, 8);

        sim.go(OK, QUITTING);
        sim.dynamics.wait(PATIENCE).well();
    });
}

#[test]
fn steps_give_feedback_and_can_be_cancelled() {
    repeat_if_late(|| {
        let mut sim = Simulation::start(2);
        let act = |sim: &mut Simulation, steps: u64, cancel_after: Option<u64>| {
            sim.peer.does(json!({
                "do": "act", "action": format!("{NAMESPACE}/dynamics/simulate_steps"),
                "type": "simulation_interfaces/action/SimulateSteps",
                "goal": {"steps": steps}, "cancel_after": cancel_after,
            }))
        };
        let outcome = act(&mut sim, 20, None);
        assert_eq!(outcome["status"], 4, "{outcome}");
        assert_eq!(outcome["result"]["result"]["result"], OK, "{outcome}");
        assert_eq!((sim.state(), sim.time()), (PAUSED, 200_000_000));
        // A client that is late may miss some; those that come are in order.
        let count = |f: &Value, key: &str| f[key].as_u64().expect("a count");
        let feedback = outcome["feedback"].as_array().expect("a list");
        let done: Vec<_> = feedback
            .iter()
            .map(|f| count(f, "completed_steps"))
            .collect();
        assert!(!done.is_empty() && done.is_sorted(), "{outcome}");
        assert!(
            feedback
                .iter()
                .all(|f| count(f, "completed_steps") + count(f, "remaining_steps") == 20),
            "{outcome}"
        );

        let outcome = act(&mut sim, 1_000_000, Some(2));
        assert_eq!(outcome["cancelled"], 0, "{outcome}");
        assert_eq!(outcome["status"], 5, "{outcome}");
        let said = outcome["result"]["result"]["error_message"].to_string();
        assert!(said.contains("of 1000000 steps"), "{said}");
        let time = sim.time();
        assert!(time > 200_000_000);
        sim.step(OK, 1);
        assert_eq!((sim.state(), sim.time()), (PAUSED, time + 10_000_000));

        sim.go(OK, PLAYING);
        let outcome = act(&mut sim, 3, None);
        assert_eq!(outcome["status"], 6, "{outcome}");
        assert_eq!(outcome["result"]["result"]["result"], FAILED, "{outcome}");
        sim.dynamics.interrupt().well();
    });
}

#[test]
fn entities_are_found_moved_added_and_removed() {
    repeat_if_late(|| {
        let mut sim = Simulation::start(3);
        let robot = sim.entities(json!({"categories": [{"category": 1}]}));
        let [robot] = robot.as_slice() else {
            panic!("{robot:?}")
        };
        let robot = robot.clone();
        assert_eq!(sim.entities(json!({})), [robot.as_str(), "target"]);
        let info = |sim: &mut Simulation, entity: &str| {
            let request = json!({"entity": entity});
            sim.gets(OK, "get_entity_info", "GetEntityInfo", request)["info"].clone()
        };
        assert_eq!(info(&mut sim, "target")["category"]["category"], 4);
        assert_eq!(info(&mut sim, &robot)["tags"], json!(["robot"]));

        // Moved, with another motion.
        let set = |sim: &mut Simulation, code: u64, request: Value| {
            sim.gets(code, "set_entity_state", "SetEntityState", request)
        };
        let pose = json!({
            "position": {"x": 1.0, "y": 2.0, "z": 3.0},
            "orientation": {"x": 0.0, "y": 0.6, "z": 0.0, "w": 0.8},
        });
        let twist = json!({
            "linear": {"x": 0.1, "y": 0.2, "z": 0.3}, "angular": {"x": 0.0, "y": 0.0, "z": 0.5},
        });
        for entity in ["target", &robot] {
            let state = json!({"pose": pose, "twist": twist});
            let request =
                json!({"entity": entity, "state": state, "set_pose": true, "set_twist": true});
            set(&mut sim, OK, request);
            let is = sim.of(entity);
            close(&is["pose"], &pose);
            close(&is["twist"], &twist);
        }
        let away = json!({"pose": {"position": {"x": 9.0}}, "twist": {"linear": {"x": 7.0}}});
        let request = json!({"entity": "target", "state": away, "set_pose": true});
        set(&mut sim, OK, request);
        let is = sim.of("target");
        close(
            &is["pose"]["position"],
            &json!({"x": 9.0, "y": 0.0, "z": 0.0}),
        );
        close(&is["twist"], &twist);
        // Relative to another entity, which stands at (1, 2, 3), turned about y.
        let relative = json!({"header": {"frame_id": robot}, "pose": {"position": {"y": 5.0}}});
        let request = json!({"entity": "target", "state": relative, "set_pose": true});
        set(&mut sim, OK, request);
        let is = sim.of("target");
        close(
            &is["pose"]["position"],
            &json!({"x": 1.0, "y": 7.0, "z": 3.0}),
        );
        let bad = json!({"pose": {"orientation": {"w": 0.0}}});
        let request = json!({"entity": "target", "state": bad, "set_pose": true});
        set(&mut sim, 101, request);
        set(
            &mut sim,
            NOT_FOUND,
            json!({"entity": "moon", "set_pose": true}),
        );

        // Added: every refusal of the standard, then two.
        for (code, request) in [
            (104, json!({"name": "debris"})),
            (
                101,
                json!({"name": "target", "entity_resource": resource(TARGET)}),
            ),
            (
                102,
                json!({"name": "1st", "entity_resource": resource(TARGET)}),
            ),
            (
                103,
                json!({"name": "a", "entity_resource": {"resource_string": "<sdf/>"}}),
            ),
            (
                105,
                json!({"name": "a", "entity_resource": resource(TARGET), "entity_namespace": "b c"}),
            ),
            (
                106,
                json!({"name": "a", "entity_resource": resource("/no/such.urdf")}),
            ),
            (
                106,
                json!({"name": "a", "entity_resource": {"resource_string": "<robot"}}),
            ),
            (
                109,
                json!({"name": "a", "entity_resource": resource(TARGET),
                "initial_pose": {"pose": {"orientation": {"w": 3.0}}}}),
            ),
        ] {
            sim.spawn(code, request);
        }
        let debris = json!({
            "name": "debris", "allow_renaming": true, "entity_resource": resource(TARGET),
            "initial_pose": {"pose": {"position": {"x": -3.0}}},
        });
        assert_eq!(sim.spawn(OK, debris.clone()), "debris");
        assert_eq!(sim.spawn(OK, debris), "debris_1");
        let there = json!({"name": "debris", "entity_resource": resource(TARGET), "entity_namespace": "far"});
        assert_eq!(sim.spawn(OK, there.clone()), "far/debris");
        let many = json!({"spawn_requests": [
            {"name": "rock", "entity_resource": resource(TARGET)}, there,
        ]});
        let response = sim.gets(150, "spawn_entities", "SpawnEntities", many);
        let codes = response["results"].as_array().expect("a list").iter();
        let codes: Vec<_> = codes.map(|r| r["result"]["result"].as_u64()).collect();
        assert_eq!(codes, [Some(OK), Some(101)]);
        let debris = ["debris", "debris_1", "far/debris"];
        assert_eq!(sim.entities(json!({"filter": "debris"})), debris);
        let spawned = sim.entities(json!({"tags": {"tags": ["spawned"]}}));
        assert_eq!(spawned, [&debris[..], &["rock"]].concat());
        let near = json!({"bounds": {"type": 3, "points": [{"x": -3.0}, {"x": 0.5}]}});
        assert_eq!(sim.entities(near), debris[..2]);
        let hull = json!({"filters": {"bounds": {"type": 2}}});
        sim.gets(UNSUPPORTED, "get_entities", "GetEntities", hull);
        for topic in [
            "/chaser/ground_truth/debris/odom",
            "/chaser/far/ground_truth/debris/odom",
        ] {
            sim.peer.subscribe(topic, ODOMETRY, "reliable");
            sim.peer.receive(topic, 1);
        }
        // A viewer needs its description, under the name of its frame.
        let description = "/chaser/far/ground_truth/debris/robot_description";
        (sim.peer).subscribe(description, "std_msgs/msg/String", "latched");
        let urdf = &sim.peer.receive(description, 1)[0]["message"]["data"];
        let urdf = urdf.as_str().expect("text");
        assert!(urdf.contains(r#"<link name="far/debris">"#), "{urdf}");
        let spawnables = json!({"sources": ["/no/such"]});
        let response = sim.gets(OK, "get_spawnables", "GetSpawnables", spawnables);
        assert!(
            response["spawnables"].to_string().contains(TARGET),
            "{response}"
        );
        assert!(
            response["result"].to_string().contains("/no/such"),
            "{response}"
        );

        // Removed.
        let delete = |sim: &mut Simulation, code: u64, entity: &str| {
            let request = json!({"entity": entity});
            sim.gets(code, "delete_entity", "DeleteEntity", request);
        };
        delete(&mut sim, OK, "debris_1");
        delete(&mut sim, NOT_FOUND, "debris_1");
        delete(&mut sim, FAILED, &robot);
        delete(&mut sim, OK, "target");
        sim.step(OK, 1);
        sim.reset(OK, 4);
        assert_eq!(sim.entities(json!({})), [robot.as_str()]);
        // The state is that after a launch.
        sim.reset(OK, 0);
        assert_eq!(sim.entities(json!({})), [robot.as_str(), "target"]);
        assert_eq!(sim.time(), 0);
        sim.dynamics.interrupt().well();
    });
}

/// Numbers of two messages differ by rounding only.
fn close(is: &Value, expected: &Value) {
    match (is, expected) {
        (Value::Object(is), Value::Object(expected)) => {
            expected
                .iter()
                .for_each(|(key, value)| close(&is[key], value));
        }
        _ => {
            let off = is.as_f64().expect("a number") - expected.as_f64().expect("a number");
            assert!(off.abs() < 1e-12, "{is} is not {expected}");
        }
    }
}
