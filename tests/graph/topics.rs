//! Topics, services and the graph, both ways.

use fuyu::ros::{DiscoveryRange, Domain, Process, Qos, RosArgs};
use serde_json::{Value, json};
use std::time::Duration;

use crate::{
    lateness::repeat_if_late,
    peer::Peer,
    probe::Probe,
    waiting::{PATIENCE, eventually},
};

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
    let chatter = eventually("the last message", PATIENCE, || {
        let chatter = peer.receive("chatter", 20);
        (data(chatter.last()?) == "last 19 at the end").then_some(chatter)
    });
    let lasts = chatter.iter().filter(|m| data(m).starts_with("last "));
    assert_eq!(lasts.count(), 20);
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
    let endpoints = [
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
        // The last of its publishers, and its last subscriber but that of the service.
        ("publishers", "/chaser/raw_heard", TEXT),
        ("subscribers", "/chaser/listen", TEXT),
        ("subscribers", "/chaser/raw", TEXT),
        ("services", "/chaser/eye/ping", "std_srvs/srv/Trigger"),
        (
            "services",
            "/chaser/eye/list_parameters",
            "rcl_interfaces/srv/ListParameters",
        ),
    ];
    let names = |kind| {
        let of_kind = endpoints.iter().filter(move |e| e.0 == kind);
        of_kind.map(|e| e.1).collect::<Vec<_>>()
    };
    let expected = json!({
        "publishers": names("publishers"), "subscribers": names("subscribers"),
        "services": names("services"),
    });
    let graph = peer.graph("eye", "/chaser", &expected);
    for (kind, name, type_name) in endpoints {
        assert_eq!(
            graph[kind][name],
            json!([type_name]),
            "{kind} {name} in {graph}"
        );
    }
    // No other endpoints: no `/clock` unless asked for, none under the name before remapping. Peers learn
    // of endpoints in the order in which they are made, so none of these is yet to come.
    assert!(graph["subscribers"].get("/clock").is_none(), "{graph}");
    assert!(
        graph["publishers"].get("/chaser/chatter").is_none(),
        "{graph}"
    );
    let info = peer.does(json!({
        "do": "topic_info", "topic": "/chaser/robot_description", "nodes": ["eye"]
    }));
    assert_eq!(
        info,
        json!([{"node": "eye", "namespace": "/chaser", "type": TEXT, "reliability": "RELIABLE", "durability": "TRANSIENT_LOCAL"}])
    );
    peer.subscribe("/loud", TEXT, "reliable");
    assert!(data(&peer.receive("/loud", 1)[0]).starts_with("remapped "));
    let (said, _) = probe.interrupt();
    assert_eq!(said, "", "nothing below a warning");
}

/// A status of a report of diagnostics.
fn named<'a>(report: &'a Value, name: &str) -> &'a Value {
    let status = report["message"]["status"].as_array().unwrap();
    status.iter().find(|s| s["name"] == name).unwrap()
}

fn median(mut numbers: Vec<f64>) -> f64 {
    numbers.sort_by(f64::total_cmp);
    numbers[numbers.len() / 2]
}

#[test]
fn diagnostics_and_log_reach_the_graph() {
    repeat_if_late(read_diagnostics_and_log);
}

fn read_diagnostics_and_log() {
    let domain = 43;
    let _probe = Probe::start(domain, &[]);
    let mut peer = Peer::start("peer", domain);
    peer.subscribe("/rosout", "rcl_interfaces/msg/Log", "latched");
    peer.subscribe(
        "diagnostics",
        "diagnostic_msgs/msg/DiagnosticArray",
        "reliable",
    );
    // Though it came before the subscription.
    let log = eventually("the probe's log", PATIENCE, || {
        let all = peer.receive("/rosout", 1);
        let mut all = all.iter().map(|m| &m["message"]);
        all.find(|m| m["name"] == "probe").cloned()
    });
    assert_eq!(
        (&log["msg"], &log["level"]),
        (&json!("the probe runs"), &json!(20))
    );

    // Medians: a machine under load delays single reports.
    let communication = |report: &Value| named(report, "probe: communication")["values"].clone();
    let reports = peer.receive("diagnostics", 6);
    let stamp = |report: &Value| {
        let stamp = &report["message"]["header"]["stamp"];
        stamp["sec"].as_f64().unwrap() + 1e-9 * stamp["nanosec"].as_f64().unwrap()
    };
    let periods = reports.windows(2).map(|w| stamp(&w[1]) - stamp(&w[0]));
    let rates = reports.iter().filter_map(|report| {
        let values = communication(report);
        let mut values = values.as_array().unwrap().iter();
        let rate = values.find(|v| v["key"] == "publishes /chatter: rate [Hz]")?;
        rate["value"].as_str().unwrap().parse::<f64>().ok()
    });
    let (period, rate) = (median(periods.collect()), median(rates.collect()));
    assert!((0.8..1.2).contains(&period), "a report every {period} s");
    assert!((15.0..25.0).contains(&rate), "chatter at {rate} Hz");
    let own = named(&reports[2], "probe: probe");
    assert_eq!(
        (&own["message"], &own["level"]),
        (&json!("only a test"), &json!([1]))
    );
    assert_eq!(
        own["values"],
        json!([{"key": "frame", "value": "base_link"}])
    );
}

#[test]
fn simulated_time_comes_from_the_clock() {
    let domain = 44;
    let _probe = Probe::start(domain, &["--ros-args", "-p", "use_sim_time:=true"]);
    let mut peer = Peer::start("peer", domain);
    peer.subscribe("chatter", TEXT, "reliable");
    peer.graph(
        "probe",
        "/",
        &json!({"publishers": ["/chatter"], "subscribers": ["/clock"]}),
    );
    let tick = |peer: &mut Peer, sec: i32, nanosec: u32| {
        peer.does(json!({
            "do": "publish", "topic": "/clock", "type": "rosgraph_msgs/msg/Clock",
            "message": {"clock": {"sec": sec, "nanosec": nanosec}}
        }));
    };
    // At 20 Hz a message comes due every 50 ms of simulated time, however long that takes. The first tick may come
    // before its publisher is known. The probe discovers the peer's endpoints in their order: once it answers, it knows
    // this publisher and the subscriber of its chatter.
    tick(&mut peer, 0, 20_000_000);
    peer.does(json!({
        "do": "call", "service": "/probe/ping", "type": "std_srvs/srv/Trigger", "request": {}
    }));
    tick(&mut peer, 0, 20_000_000);
    tick(&mut peer, 0, 70_000_000);
    peer.receive("chatter", 1);
    tick(&mut peer, 0, 90_000_000);
    tick(&mut peer, 100, 0);
    let all = peer.receive("chatter", 2);
    let stamps: Vec<_> = all
        .iter()
        .map(|m| data(m).rsplit(' ').next().unwrap())
        .collect();
    assert_eq!(stamps, ["0.070000000", "100.000000000"]);
}

// Fails if samples that cannot be decoded are only counted: whom to ask would not be known.
#[test]
fn an_invalid_sample_is_logged_with_its_topic_and_publisher() {
    let domain = 106;
    let mut probe = Probe::start(domain, &[]);
    probe.runs();
    let domain = Domain {
        id: domain,
        range: DiscoveryRange::Localhost,
    };
    let mut process = Process::new(RosArgs::default(), domain);
    let started = process.start("vandal", |node| {
        let say = node.advertise_raw("say", TEXT, Qos::RELIABLE)?;
        while node.wait_for(Duration::from_millis(50)) {
            // A text that is longer than its message.
            say.publish(vec![0, 1, 0, 0, 0xff, 0xff, 0, 0]);
        }
        Ok(())
    });
    started.expect("the node starts");
    probe.says("node /probe: topic /say: a sample from ");
    probe.says("is ignored: its 8 bytes are not a std_msgs/msg/String");
    // Its name is known at last.
    probe.says("a sample from node /vandal (publisher 0112");
    process.finish().expect("it ends in order");
}
