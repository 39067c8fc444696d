//! The attitude node alone with an rclpy node that is its whole world: sensors that fail, wrong messages, jumps of time,
//! lifecycle and parameters. Commands are compared with `-P angle - D rate` by hand.

use serde_json::{Value, json};

use crate::{
    attitude::CONFIG,
    joining::peer_with_interfaces,
    lateness::repeat_if_late,
    observer::{DIAGNOSTICS, JOINT_STATE, diagnosed, now, numbers, reported},
    peer::Peer,
    process::{Running, command, source},
    waiting::{PATIENCE, eventually},
};

const STATE: &str = "fuyu_msgs/msg/AttitudeState";
const THRUSTERS: &str = "fuyu_msgs/msg/ThrusterCommands";
const CONTROL: &str = "attitude: control";
/// Control period, and the time between two states of this world \[ms\].
const PERIOD: u64 = 100;

/// Gains of the scenario.
const P: f64 = 60.0;
const D: f64 = 900.0;

/// Everything around the node.
struct World {
    peer: Peer,
    /// Time of the last state \[ms\].
    time: u64,
    /// What the gyro measures \[rad/s\].
    rate: [f64; 3],
    /// When the last state was sent.
    sent: f64,
}

fn stamp(ms: u64) -> Value {
    json!({"sec": ms / 1000, "nanosec": ms % 1000 * 1_000_000})
}

impl World {
    /// The node, with parameters besides those of the scenario, and a world at rest in which it knows its attitude.
    fn new(domain: u16, more: &[&str]) -> (Running, Self) {
        let mut node = command("attitude", domain);
        node.args(["--ros-args", "--params-file"])
            .arg(source(CONFIG))
            .args(["-p", "use_sim_time:=false"]);
        for parameter in more {
            node.args(["-p", parameter]);
        }
        let node = Running::start(node);
        let mut peer = peer_with_interfaces("world", domain);
        peer.subscribe("wheel_commands", JOINT_STATE, "reliable");
        peer.subscribe("thruster_commands", THRUSTERS, "reliable");
        peer.subscribe("attitude/state", STATE, "reliable");
        peer.subscribe("diagnostics", DIAGNOSTICS, "reliable");
        let urdf = std::fs::read_to_string(source("urdf/servicer.urdf")).expect("a robot");
        let mut world = Self {
            peer,
            time: 0,
            rate: [0.0; 3],
            sent: now(),
        };
        world.publish_as(
            "robot_description",
            "std_msgs/msg/String",
            json!({"data": urdf}),
            "latched",
        );
        eventually("the first command", PATIENCE, || {
            world.time += PERIOD;
            world.send_joints_and_wheels();
            world.send_imu();
            world.answer(1.0)
        });
        world.find_attitude();
        (node, world)
    }

    fn publish(&mut self, topic: &str, kind: &str, message: Value) {
        self.publish_as(topic, kind, message, "reliable");
    }

    fn publish_as(&mut self, topic: &str, kind: &str, message: Value, qos: &str) {
        self.peer.does(json!({
            "do": "publish", "topic": topic, "type": kind, "message": message, "qos_name": qos,
        }));
    }

    fn send_joints_and_wheels(&mut self) {
        self.sent = now();
        let header = json!({"stamp": stamp(self.time), "frame_id": "base_link"});
        let joints = (1..=6).map(|i| format!("joint{i}")).collect::<Vec<_>>();
        let zeros = vec![0.0; 6];
        self.publish(
            "joint_states",
            JOINT_STATE,
            json!({"header": header, "name": joints, "position": zeros, "velocity": zeros}),
        );
        self.publish("wheel_states", JOINT_STATE, wheels(self.time, &[0.0; 3]));
    }

    fn send_imu(&mut self) {
        let [x, y, z] = self.rate;
        let message = json!({
            "header": {"stamp": stamp(self.time), "frame_id": "base_link"},
            "angular_velocity": {"x": x, "y": y, "z": z},
        });
        self.publish("imu", "sensor_msgs/msg/Imu", message);
    }

    /// What the star tracker measures at a time.
    fn send_attitude(&mut self, ms: u64, [x, y, z, w]: [Value; 4]) {
        let message = json!({
            "header": {"stamp": stamp(ms), "frame_id": "world"},
            "quaternion": {"x": x, "y": y, "z": z, "w": w},
        });
        self.publish(
            "star_tracker",
            "geometry_msgs/msg/QuaternionStamped",
            message,
        );
    }

    /// The last message on a topic with the stamp of the last state, if it comes within `patience` \[s\].
    fn last(&mut self, topic: &str, since: f64, patience: f64) -> Option<Value> {
        let wanted = stamp(self.time);
        let deadline = now() + patience;
        loop {
            let wait = json!({"do": "wait", "topic": topic, "since": since, "timeout": 0.2});
            let received = self.peer.does(wait);
            let received = received.as_array().expect("a list").iter();
            let mut messages = received.map(|m| &m["message"]);
            if let Some(found) = messages.rfind(|m| m["header"]["stamp"] == wanted) {
                return Some(found.clone());
            }
            if now() > deadline {
                return None;
            }
        }
    }

    /// The torques that answer the last state \[N m\].
    fn answer(&mut self, patience: f64) -> Option<Vec<f64>> {
        let command = self.last("wheel_commands", self.sent, patience)?;
        let efforts = numbers(&command["effort"]);
        assert_eq!(command["name"], json!(["wheel_x", "wheel_y", "wheel_z"]));
        assert!(
            efforts.len() == 3 && efforts.iter().all(|e| e.is_finite()),
            "{command}"
        );
        Some(efforts)
    }

    /// A state a control period later, and the torques that answer it.
    fn step(&mut self) -> Vec<f64> {
        self.time += PERIOD;
        self.send_joints_and_wheels();
        self.send_imu();
        let answer = self.answer(PATIENCE.as_secs_f64());
        answer.unwrap_or_else(|| panic!("no command for {} ms", self.time))
    }

    /// What the node reports about the last state.
    fn mode(&mut self) -> String {
        let state = self.last("attitude/state", self.sent, PATIENCE.as_secs_f64());
        let state = state.expect("a state of the controller");
        state["mode"].as_str().expect("text").to_owned()
    }

    /// Steps with measurements of the star tracker until they are used.
    fn find_attitude(&mut self) {
        eventually("the attitude is known", PATIENCE, || {
            let time = self.time;
            self.send_attitude(time, one());
            self.step();
            (self.mode() == "law").then_some(())
        });
    }

    /// Sends a message, between states, until the node reports it in these words.
    fn refused(&mut self, topic: &str, kind: &str, message: &Value, words: &str) {
        let since = now();
        let text = eventually(words, PATIENCE, || {
            self.publish(topic, kind, message.clone());
            self.step();
            reported(&mut self.peer, CONTROL, since, 3.0, |level, text| {
                level == 1 && text.contains(topic) && text.contains(words)
            })
        });
        println!("{text}");
    }

    /// The diagnostic message of a part, while states go on with `send`: a node whose inputs are silent reports that instead.
    fn diagnosed_while(
        &mut self,
        send: impl Fn(&mut Self),
        part: &str,
        enough: impl Fn(u64, &str) -> bool,
    ) -> String {
        let since = now();
        eventually(part, PATIENCE, || {
            self.time += PERIOD;
            send(self);
            reported(&mut self.peer, part, since, 0.2, &enough)
        })
    }

    fn set(&mut self, name: &str, value: Value) -> Value {
        let set = json!({"do": "set_parameters", "node": "/attitude", "values": [[name, value]]});
        self.peer.does(set)["response"]["results"][0].clone()
    }

    fn change(&mut self, transition: &str) {
        let answer = self.peer.does(json!({
            "do": "call", "service": "attitude/change_state", "type": "lifecycle_msgs/srv/ChangeState",
            "request": {"transition": {"label": transition}},
        }));
        assert_eq!(
            answer["response"]["success"], true,
            "{transition}: {answer}"
        );
    }
}

/// No turn, as a quaternion x, y, z, w.
fn one() -> [Value; 4] {
    [json!(0.0), json!(0.0), json!(0.0), json!(1.0)]
}

fn wheels(ms: u64, speeds: &[f64]) -> Value {
    json!({
        "header": {"stamp": stamp(ms)}, "name": ["wheel_x", "wheel_y", "wheel_z"], "velocity": speeds,
    })
}

/// The torque about z of a step in which the star tracker measures no turn \[N m\].
fn held(world: &mut World) -> f64 {
    let time = world.time;
    world.send_attitude(time, one());
    world.step()[2]
}

fn close(found: &[f64], expected: [f64; 3], tolerance: f64) {
    let is_close = found
        .iter()
        .zip(expected)
        .all(|(a, b)| (a - b).abs() < tolerance);
    assert!(is_close, "{found:?} instead of {expected:?}");
}

// Every wrong message is named in diagnostics, and torques are those without it.
#[test]
fn wrong_messages_are_refused_and_the_base_is_held() {
    repeat_if_late(|| {
        let (mut node, mut world) = World::new(210, &[]);
        // The base turns at a constant rate; the motors of the wheels push the other way.
        world.rate = [1e-3, 0.0, -2e-3];
        let begin = world.time;
        let expected = |world: &World| {
            let seconds = (world.time - begin) as f64 * 1e-3;
            world.rate.map(|rate| (D + P * seconds) * rate)
        };
        let torques = world.step();
        close(&torques, expected(&world), 0.05);
        let now = world.time;
        let at = |ms: u64| json!({"stamp": stamp(ms)});
        let turned =
            |x: Value, w: f64, ms: u64| json!({"header": at(ms), "quaternion": {"x": x, "w": w}});
        let quaternion = "geometry_msgs/msg/QuaternionStamped";
        for (topic, kind, message, words) in [
            (
                "star_tracker",
                quaternion,
                turned(Value::Null, 1.0, now),
                "norm NaN; it must be 1",
            ),
            (
                "star_tracker",
                quaternion,
                turned(json!(0.0), 0.5, now),
                "norm 0.5; it must be 1",
            ),
            (
                "star_tracker",
                quaternion,
                turned(json!(0.0), 1.0, now + 60_000),
                "far ahead",
            ),
            (
                "attitude_target",
                quaternion,
                turned(json!(0.0), 0.0, now),
                "norm 0; it must be 1",
            ),
            (
                "wheel_states",
                JOINT_STATE,
                wheels(now, &[1.0, 2.0]),
                "has no velocity for wheel 'wheel_z'",
            ),
            (
                "imu",
                "sensor_msgs/msg/Imu",
                json!({"header": at(now), "angular_velocity": {"x": null}}),
                "angular_velocity.x is NaN; it must be finite",
            ),
            (
                "joint_states",
                JOINT_STATE,
                json!({"header": at(now), "name": ["joint1"], "position": [0.0], "velocity": [0.0]}),
                "joint2",
            ),
        ] {
            world.refused(topic, kind, &message, words);
        }
        let mut nan = wheels(now, &[0.0; 3]);
        nan["velocity"][0] = Value::Null;
        world.refused(
            "wheel_states",
            JOINT_STATE,
            &nan,
            "speed of wheel wheel_x is NaN",
        );
        let torques = world.step();
        close(&torques, expected(&world), 0.05);
        assert_eq!(world.mode(), "law");
        // A wheel state from the future does not hide those that follow.
        world.publish(
            "wheel_states",
            JOINT_STATE,
            wheels(now + 1_000_000, &[0.0; 3]),
        );
        world.step();
        world.step();
        let seen = json!({"do": "wait", "topic": "diagnostics", "since": world.sent});
        world.peer.does(seen);
        world.step();
        diagnosed(&mut world.peer, "attitude: wheels", |level, text| {
            level == 0 && text.contains("of its momentum")
        });
        assert!(!node.interrupt().well().stderr.contains("panic"));
    });
}

// Would break if the node went on with a measurement that is too old, or did not go back to it when it returns.
#[test]
fn silent_sensors_have_their_fallbacks() {
    repeat_if_late(|| {
        // The gyro's bias wanders by 1e-3 rad/s in a second, which makes the attitude unknown after some seconds.
        let (mut node, mut world) = World::new(
            211,
            &["largest_uncertainty:=0.004", "gyro.rate_random_walk:=0.001"],
        );
        let degree = 1f64.to_radians();
        // One degree about z: the base is turned by -1 deg from it.
        let (sine, cosine) = (0.5 * degree).sin_cos();
        let target = json!({"quaternion": {"z": sine, "w": cosine}});
        world.publish(
            "attitude_target",
            "geometry_msgs/msg/QuaternionStamped",
            target,
        );
        let to_target = [0.0, 0.0, -P * 2.0 * sine];
        eventually("the new reference", PATIENCE, || {
            let time = world.time;
            world.send_attitude(time, one());
            let found = world.step();
            ((found[2] - to_target[2]).abs() < 0.02).then_some(())
        });

        // The star tracker falls silent: the gyro carries the attitude on, then only the rate is damped.
        let mut modes = Vec::new();
        for _ in 0..300 {
            world.step();
            modes.push(world.mode());
            if modes.last().is_some_and(|mode| mode == "rate_damping") {
                break;
            }
        }
        let lost = modes.len();
        println!("the attitude is lost after {lost} periods without a star tracker");
        assert!(lost > 10 && modes[lost - 1] == "rate_damping", "{modes:?}");
        assert!(
            modes[..lost - 1].iter().all(|mode| mode == "law"),
            "{modes:?}"
        );
        close(&world.step(), [0.0; 3], 0.05);
        let all_but_the_star_tracker = |world: &mut World| {
            world.send_joints_and_wheels();
            world.send_imu();
        };
        let text = world.diagnosed_while(all_but_the_star_tracker, CONTROL, |level, text| {
            level == 1 && text.contains("only the rate is damped")
        });
        println!("{text}");
        let star_tracker = "attitude: star tracker";
        let text = world.diagnosed_while(all_but_the_star_tracker, star_tracker, |level, text| {
            level == 1 && text.contains("the gyro alone carries it on")
        });
        println!("{text}");
        world.find_attitude();
        close(&world.step(), to_target, 0.1);

        // The gyro falls silent: zero torque and closed valves, while joints and wheels tell the time.
        for _ in 0..6 {
            world.time += PERIOD;
            world.send_joints_and_wheels();
        }
        let patience = PATIENCE.as_secs_f64();
        assert_eq!(world.answer(patience).expect("a command"), [0.0; 3]);
        assert_eq!(world.mode(), "zero_torque");
        let valves = world
            .last("thruster_commands", world.sent, patience)
            .expect("closed valves");
        assert_eq!(numbers(&valves["on_time"]), [0.0; 12]);
        let no_gyro = World::send_joints_and_wheels;
        let text = world.diagnosed_while(no_gyro, CONTROL, |level, text| {
            level == 2 && text.contains("zero torque")
        });
        println!("{text}");
        world.find_attitude();
        close(&world.step(), to_target, 0.1);

        // Time jumps ahead by 100 s, and back to the start: a gap, and another run with the reference of the parameters.
        for (time, expected) in [(world.time + 100_000, to_target), (50, [0.0; 3])] {
            world.time = time;
            let after = world.step();
            assert!(after.iter().all(|torque| torque.abs() < 20.0), "{after:?}");
            world.find_attitude();
            close(&world.step(), expected, 0.1);
        }
        assert!(!node.interrupt().well().stderr.contains("panic"));
    });
}

// An inactive node commands nothing after zero torque, and what is configured again works as at the start.
#[test]
fn a_deactivated_node_ends_its_torques() {
    repeat_if_late(|| {
        let (mut node, mut world) = World::new(212, &[]);
        world.rate = [1e-3, 0.0, 0.0];
        let acting = world.step();
        assert!(acting[0] > 0.5, "{acting:?}");
        let since = now();
        world.change("deactivate");
        let last = world.last("wheel_commands", since, PATIENCE.as_secs_f64());
        assert_eq!(numbers(&last.expect("a command")["effort"]), [0.0; 3]);
        let valves = world.last("thruster_commands", since, PATIENCE.as_secs_f64());
        assert_eq!(
            numbers(&valves.expect("closed valves")["on_time"]),
            [0.0; 12]
        );
        diagnosed(&mut world.peer, CONTROL, |level, text| {
            level == 1 && text.contains("not active")
        });
        for _ in 0..5 {
            world.time += PERIOD;
            world.send_joints_and_wheels();
            world.send_imu();
        }
        assert_eq!(world.answer(1.0), None);
        world.change("activate");
        let again = world.step();
        assert!(again[0] > 0.5, "{again:?}");

        world.change("deactivate");
        world.change("cleanup");
        world.change("configure");
        world.change("activate");
        eventually("the first command", PATIENCE, || {
            world.time += PERIOD;
            world.send_joints_and_wheels();
            world.send_imu();
            world.answer(1.0)
        });
        assert_eq!(world.mode(), "rate_damping");
        world.find_attitude();
        assert!(!node.interrupt().well().stderr.contains("panic"));
    });
}

// The torque goes over from one law to the next with the time constant that is stated; a law that cannot be designed is
// refused, and the one before stays.
#[test]
fn a_law_takes_over_without_a_jump() {
    repeat_if_late(|| {
        let more = [
            "bumpless_transfer_time:=2.0",
            "hinf.rate_gain:=1e-3",
            "hinf.postures:=16",
        ];
        let (mut node, mut world) = World::new(213, &more);
        let refused = world.set("period", json!(0.2));
        assert_eq!(refused["successful"], false, "{refused}");
        assert!(
            refused["reason"]
                .as_str()
                .is_some_and(|why| why.contains("read-only")),
            "{refused}"
        );
        let target = json!({"quaternion": {"z": 0.01, "w": (1.0f64 - 1e-4).sqrt()}});
        world.publish(
            "attitude_target",
            "geometry_msgs/msg/QuaternionStamped",
            target,
        );
        let before = eventually("the new reference", PATIENCE, || {
            let torque = held(&mut world);
            ((torque + P * 0.02).abs() < 1e-3).then_some(torque)
        });
        assert_eq!(world.set("law", json!("lqr"))["successful"], true);
        let torques: Vec<f64> = (0..200).map(|_| held(&mut world)).collect();
        let last = torques[199];
        println!(
            "{before} N m by dvdfb, {} N m after a period, {last} N m by lqr",
            torques[0]
        );
        // The weights of the scenario's default: 1 N m for .01 rad.
        assert!((last - before).abs() > 0.1, "{last} {before}");
        let mut expected = before;
        for (k, torque) in torques.iter().enumerate() {
            if k > 0 {
                expected = last + (before - last) * (-0.1 * k as f64 / 2.0).exp();
            }
            assert!((torque - expected).abs() < 0.01, "{k}: {torque} {expected}");
        }

        assert_eq!(world.set("law", json!("hinf"))["successful"], true);
        let text = eventually("the refusal of hinf", PATIENCE, || {
            held(&mut world);
            let since = world.sent;
            reported(
                &mut world.peer,
                "attitude: law",
                since,
                2.0,
                |level, text| level == 1 && text.contains("lqr stays in force"),
            )
        });
        println!("{text}");
        assert!(text.contains("hinf about the x axis"), "{text}");
        assert!((held(&mut world) - last).abs() < 0.01);
        assert_eq!(world.set("law", json!("dvdfb"))["successful"], true);
        eventually("the report about dvdfb", PATIENCE, || {
            held(&mut world);
            let since = world.sent;
            reported(
                &mut world.peer,
                "attitude: law",
                since,
                2.0,
                |level, text| level == 0 && text.starts_with("dvdfb, stable"),
            )
        });
        assert!(!node.interrupt().well().stderr.contains("panic"));
    });
}
