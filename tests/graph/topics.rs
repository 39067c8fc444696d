//! Topics, services and the graph, both ways.

use serde_json::json;
use std::{thread, time::Duration};

use crate::{peer::Peer, probe::Probe};

const TEXT: &str = "std_msgs/msg/String";

fn data(received: &serde_json::Value) -> &str {
    received["message"]["data"].as_str().unwrap()
}

#[test]
fn messages_go_both_ways_and_services_answer() {
    let domain = 40;
    let probe = Probe::start(domain, &[]);
    let mut peer = Peer::start("peer", domain);
    for (topic, qos) in [
        ("chatter", "reliable"),
        ("fast", "sensor_data"),
        ("heard", "reliable"),
        ("raw_heard", "reliable"),
        ("robot_description", "latched"),
    ] {
        peer.subscribe(topic, TEXT, qos);
    }
    let chatter = peer.receive("chatter", 20);
    assert!(data(&chatter[0]).starts_with("hello "));
    // Reliable: none is missing in between.
    let numbers = chatter.iter().map(|m| {
        let number = data(m).split(' ').nth(1).unwrap();
        number.parse::<i32>().unwrap()
    });
    let numbers: Vec<_> = numbers.collect();
    assert!(numbers.windows(2).all(|w| w[1] == w[0] + 1), "{numbers:?}");
    peer.receive("fast", 10);
    // It was published long before this subscription.
    assert_eq!(data(&peer.receive("robot_description", 1)[0]), "<robot/>");

    peer.does(json!({"do": "publish", "topic": "say", "type": TEXT, "message": {"data": "übung"}}));
    assert_eq!(data(&peer.receive("heard", 1)[0]), "übung");
    peer.does(json!({"do": "publish", "topic": "raw", "type": TEXT, "message": {"data": "ab"}}));
    // Header, length with the closing zero, text.
    let bytes = peer.receive("raw_heard", 1);
    assert!(
        data(&bytes[0]).starts_with("[00, 01, 00, 00, 03, 00, 00, 00, 61, 62, 00"),
        "{bytes:?}"
    );
    let pong = peer.does(json!({
        "do": "call", "service": "/probe/ping", "type": "std_srvs/srv/Trigger", "request": {}
    }));
    assert_eq!(
        pong["response"],
        json!({"success": true, "message": "pong"})
    );
    let (said, code) = probe.interrupt();
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("[probe]: the probe ends in order"), "{said}");
    assert!(!said.contains("ERROR"), "{said}");
    // What a program publishes last still arrives.
    thread::sleep(Duration::from_millis(500));
    let chatter = peer.receive("chatter", 20);
    let lasts = chatter.iter().filter(|m| data(m).starts_with("last "));
    assert_eq!(lasts.count(), 20);
    assert_eq!(data(chatter.last().unwrap()), "last 19 at the end");
}

#[test]
fn late_joiners_get_what_was_retained() {
    let domain = 41;
    let mut peer = Peer::start("peer", domain);
    peer.subscribe("heard", TEXT, "reliable");
    peer.does(json!({
        "do": "publish", "topic": "retained", "type": TEXT, "qos_name": "latched", "matched": 0,
        "message": {"data": "from before"}
    }));
    thread::sleep(Duration::from_secs(1));
    let _probe = Probe::start(domain, &[]);
    assert_eq!(data(&peer.receive("heard", 1)[0]), "from before");
}

#[test]
fn the_graph_shows_remapped_names_and_qos() {
    let domain = 42;
    let args = "--ros-args -r __ns:=/chaser -r __node:=eye -r chatter:=/loud -r probe:say:=listen \
                -p label:=remapped -p other:rate:=1.0 --log-level warn";
    let args: Vec<_> = args.split_whitespace().collect();
    let probe = Probe::start(domain, &args);
    let mut peer = Peer::start("peer", domain);
    let graph = peer.does(json!({"do": "graph", "node": "eye", "namespace": "/chaser"}));
    for (kind, name, type_name) in [
        ("publishers", "/loud", TEXT),
        ("publishers", "/chaser/robot_description", TEXT),
        (
            "publishers",
            "/chaser/diagnostics",
            "diagnostic_msgs/msg/DiagnosticArray",
        ),
        ("publishers", "/rosout", "rcl_interfaces/msg/Log"),
        (
            "publishers",
            "/parameter_events",
            "rcl_interfaces/msg/ParameterEvent",
        ),
        ("subscribers", "/chaser/listen", TEXT),
        ("subscribers", "/chaser/raw", TEXT),
        ("services", "/chaser/eye/ping", "std_srvs/srv/Trigger"),
        (
            "services",
            "/chaser/eye/list_parameters",
            "rcl_interfaces/srv/ListParameters",
        ),
    ] {
        assert_eq!(
            graph[kind][name],
            json!([type_name]),
            "{kind} {name} in {graph}"
        );
    }
    // Nothing else of that name: no `/clock` unless asked for, no endpoint under its old name.
    assert!(graph["subscribers"].get("/clock").is_none(), "{graph}");
    assert!(
        graph["publishers"].get("/chaser/chatter").is_none(),
        "{graph}"
    );
    let info = peer.does(json!({"do": "topic_info", "topic": "/chaser/robot_description"}));
    assert_eq!(
        info,
        json!([{"node": "eye", "namespace": "/chaser", "type": TEXT, "reliability": "RELIABLE", "durability": "TRANSIENT_LOCAL"}])
    );
    peer.subscribe("/loud", TEXT, "reliable");
    assert!(data(&peer.receive("/loud", 1)[0]).starts_with("remapped "));
    let (said, _) = probe.interrupt();
    assert_eq!(said, "", "nothing below a warning");
}

#[test]
fn diagnostics_and_log_reach_the_graph() {
    let domain = 43;
    let _probe = Probe::start(domain, &[]);
    let mut peer = Peer::start("peer", domain);
    peer.subscribe("/rosout", "rcl_interfaces/msg/Log", "latched");
    peer.subscribe(
        "diagnostics",
        "diagnostic_msgs/msg/DiagnosticArray",
        "reliable",
    );
    let all = peer.receive("/rosout", 1);
    let log = all
        .iter()
        .map(|m| &m["message"])
        .find(|m| m["name"] == "probe");
    let log = log.expect("the probe's log, though it came before the subscription");
    assert_eq!(
        (&log["msg"], &log["level"]),
        (&json!("the probe runs"), &json!(20))
    );

    let reports = peer.receive("diagnostics", 3);
    let stamp = |i: usize| {
        let stamp = &reports[i]["message"]["header"]["stamp"];
        stamp["sec"].as_f64().unwrap() + 1e-9 * stamp["nanosec"].as_f64().unwrap()
    };
    let period = stamp(2) - stamp(1);
    assert!((0.3..3.0).contains(&period), "{period}");
    let status = reports[2]["message"]["status"].as_array().unwrap();
    let named = |name: &str| status.iter().find(|s| s["name"] == name).unwrap();
    let own = named("probe: probe");
    assert_eq!(
        (&own["message"], &own["level"]),
        (&json!("only a test"), &json!([1]))
    );
    assert_eq!(
        own["values"],
        json!([{"key": "frame", "value": "base_link"}])
    );
    let values = named("probe: communication")["values"].as_array().unwrap();
    let rate = values
        .iter()
        .find(|v| v["key"] == "publishes /chatter: rate [Hz]")
        .unwrap();
    let rate: f64 = rate["value"].as_str().unwrap().parse().unwrap();
    assert!((20.0 / 3.0..3.0 * 20.0).contains(&rate), "{rate}");
}

#[test]
fn simulated_time_comes_from_the_clock() {
    let domain = 44;
    let _probe = Probe::start(domain, &["--ros-args", "-p", "use_sim_time:=true"]);
    let mut peer = Peer::start("peer", domain);
    peer.subscribe("chatter", TEXT, "reliable");
    peer.does(json!({"do": "graph", "node": "probe"}));
    thread::sleep(Duration::from_millis(500));
    let mut tick = |sec: i32, nanosec: u32| {
        peer.does(json!({
            "do": "publish", "topic": "/clock", "type": "rosgraph_msgs/msg/Clock",
            "message": {"clock": {"sec": sec, "nanosec": nanosec}}
        }));
        thread::sleep(Duration::from_millis(100));
    };
    // At 20 Hz a message comes due every 50 ms of simulated time, however long that takes.
    tick(0, 20_000_000);
    tick(0, 70_000_000);
    tick(0, 90_000_000);
    tick(100, 0);
    let all = peer.receive("chatter", 2);
    let stamps: Vec<_> = all
        .iter()
        .map(|m| data(m).rsplit(' ').next().unwrap())
        .collect();
    assert_eq!(stamps, ["0.070000000", "100.000000000"]);
}
