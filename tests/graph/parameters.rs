//! Parameters: at start, and from rclpy while the node runs.

use serde_json::{Value, json};
use std::fs;

use crate::{
    peer::Peer,
    probe::Probe,
    waiting::{PATIENCE, eventually},
};

fn call(peer: &mut Peer, service: &str, type_name: &str, request: Value) -> Value {
    let service = format!("/probe/{service}");
    let type_name = format!("rcl_interfaces/srv/{type_name}");
    let answer = peer.does(json!({
        "do": "call", "service": service, "type": type_name, "request": request
    }));
    answer["response"].clone()
}

#[test]
fn rclpy_lists_describes_gets_and_sets() {
    let domain = 45;
    let _probe = Probe::start(domain, &[]);
    let mut peer = Peer::start("peer", domain);
    peer.subscribe(
        "/parameter_events",
        "rcl_interfaces/msg/ParameterEvent",
        "reliable",
    );

    let list = json!({"prefixes": [], "depth": 0});
    let listed = call(&mut peer, "list_parameters", "ListParameters", list);
    assert_eq!(
        listed["result"],
        json!({
            "names": ["count", "frame", "gains.p", "label", "rate", "stubborn", "use_sim_time"],
            "prefixes": ["gains"],
        })
    );

    let names = json!({"names": ["rate", "label", "frame", "count", "nothing"]});
    let described = call(
        &mut peer,
        "describe_parameters",
        "DescribeParameters",
        names,
    );
    let described = described["descriptors"].as_array().unwrap();
    let rate = &described[0];
    assert_eq!((&rate["name"], &rate["type"]), (&json!("rate"), &json!(3)));
    assert_eq!(rate["description"], "Messages per second [Hz]");
    assert_eq!(
        rate["floating_point_range"],
        json!([{"from_value": 1.0, "to_value": 200.0, "step": 0.0}])
    );
    assert_eq!(described[1]["additional_constraints"], "not empty");
    assert_eq!(described[2]["read_only"], true);
    assert_eq!(described[3]["integer_range"][0]["to_value"], 10);
    assert_eq!(described[4]["type"], 0);

    let names = json!({"names": ["rate", "gains.p", "nothing"]});
    let types = call(
        &mut peer,
        "get_parameter_types",
        "GetParameterTypes",
        names.clone(),
    );
    assert_eq!(types["types"], json!([3, 8, 0]));
    let values = call(&mut peer, "get_parameters", "GetParameters", names);
    assert_eq!(values["values"][0]["double_value"], 20.0);
    assert_eq!(values["values"][1]["double_array_value"], json!([1.0, 2.0]));

    let mut set = |values: Value, atomically: bool| {
        let answer = peer.does(json!({
            "do": "set_parameters", "node": "/probe", "values": values, "atomically": atomically
        }));
        let response = answer["response"].clone();
        if atomically {
            response["result"].clone()
        } else {
            response["results"][0].clone()
        }
    };
    for (values, reason) in [
        (
            json!([["nothing", 1.0]]),
            "parameter nothing: not declared by /probe",
        ),
        (
            json!([["rate", 1]]),
            "parameter rate: 1 is an integer, expected a double; write 1.0",
        ),
        (
            json!([["rate", 500.0]]),
            "parameter rate: 500.0 is out of range, expected 1 to 200",
        ),
        (
            json!([["label", ""]]),
            "parameter label: an empty label would not be seen",
        ),
        (
            json!([["frame", "tool0"]]),
            "parameter frame: read-only, it can only be given when the node starts",
        ),
    ] {
        let refused = json!({"successful": false, "reason": reason});
        assert_eq!(set(values, false), refused);
    }
    let some = json!([["label", "never"], ["rate", -1.0]]);
    assert_eq!(set(some, true)["successful"], false);
    let both = json!([["label", "set"], ["rate", 100.0]]);
    assert_eq!(set(both, true)["successful"], true);

    peer.subscribe("chatter", "std_msgs/msg/String", "reliable");
    let first = &peer.receive("chatter", 1)[0]["message"]["data"];
    assert!(first.as_str().unwrap().starts_with("set "), "{first}");
    // It was 20 Hz, which must not be mistaken for 100 Hz on a late machine: some second shows the new rate.
    let mut seen = 0;
    eventually("the node follows the new rate", PATIENCE, || {
        seen += 50;
        let all = peer.receive("chatter", seen);
        let time = |i: usize| all[i]["time"].as_f64().unwrap();
        let rate = 40.0 / (time(seen - 1) - time(seen - 41));
        (33.0..300.0).contains(&rate).then_some(())
    });
    // Those of the start may have been heard, too.
    let event = eventually("the parameter event of the change", PATIENCE, || {
        let events = peer.receive("/parameter_events", 1);
        let event = events.last()?["message"].clone();
        (event["changed_parameters"] != json!([])).then_some(event)
    });
    assert_eq!(event["node"], "/probe");
    let changed = event["changed_parameters"].as_array().unwrap();
    assert_eq!(changed.len(), 2, "one event for one transaction: {event}");
    assert_eq!(changed[1]["value"]["double_value"], 100.0);
}

#[test]
fn files_and_arguments_are_checked_at_start() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("p.yaml");
    fs::write(
        &file,
        "probe:\n  ros__parameters:\n    rate: 5\n    lable: x\n",
    )
    .unwrap();
    let file = file.to_str().unwrap();
    let from_file = ["--ros-args", "--params-file", file];
    for (args, expected) in [
        (&from_file[..], vec![
            format!("error: {file}:3: parameter rate of /probe: 5 is an integer, expected a double; write 5.0"),
            format!("{file}:4: parameter lable: node /probe has no such parameter; did you mean label?"),
        ]),
        (&["--ros-args", "-p", "rate:=0.5"], vec![
            "error: argument -p: parameter rate of /probe: 0.5 is out of range, expected 1 to 200".into(),
        ]),
        (&["--ros-args", "-r", "a:b"], vec![
            "error: argument \"a:b\": expected FROM:=TO, as in joint_states:=js".into(),
        ]),
    ] {
        let (said, code) = Probe::start(46, args).finish();
        assert_eq!(code, Some(2), "{said}");
        let lines: Vec<_> = said.lines().collect();
        assert_eq!(lines, expected);
    }
}
