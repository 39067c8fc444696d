//! Calls that follow the discovery of a server at once: neither side may have discovered the other completely.

use fuyu::{
    msg::std_srvs::{Trigger, TriggerRequest},
    ros::{ActionServer, DiscoveryRange, Domain, Goal, Process, RosArgs, ServiceClient},
};
use serde_json::{Value, json};
use std::{
    process::Command,
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicU32, Ordering::Relaxed},
        mpsc,
    },
    thread,
    time::{Duration, Instant},
};

use crate::{
    lateness::repeat_if_late,
    namespace::Namespace,
    peer::{Peer, python},
    probe::Probe,
    waiting::{PATIENCE, eventually},
};

/// Every call must be answered within this time; Fast DDS repeats a lost request after 3000 ms \[ms\].
const SLOWEST: f64 = 300.0;
/// Clients in one test run; `five_hundred_first_calls` has more.
const CALLS: usize = 60;

const GET: &str = "rcl_interfaces/srv/GetParameters";

/// Asserts that every one of `times` \[ms\] is there and short, and prints them.
fn all_answered(what: &str, times: &[Option<f64>]) {
    let lost = times.iter().filter(|t| t.is_none()).count();
    let mut answered: Vec<_> = times.iter().copied().flatten().collect();
    answered.sort_by(f64::total_cmp);
    let median = answered.get(answered.len() / 2).copied();
    let slowest = answered.last().copied();
    let n = times.len();
    println!(
        "{what}: {lost} of {n} first calls lost, median {median:.1?} ms, slowest {slowest:.1?} ms"
    );
    assert_eq!(lost, 0, "{what}");
    assert!(slowest < Some(SLOWEST), "{what}: {slowest:?} ms");
}

fn times(answer: &Value) -> Vec<Option<f64>> {
    answer
        .as_array()
        .expect("a list")
        .iter()
        .map(Value::as_f64)
        .collect()
}

fn first_calls_of_rclpy(peer: &mut Peer, count: usize) -> Vec<Option<f64>> {
    let answer = peer.does(json!({
        "do": "first_calls", "service": "/probe/get_parameters", "type": GET,
        "request": {"names": ["rate"]}, "count": count
    }));
    times(&answer)
}

// Fails if a reply is sent before the client's reader is matched, or if a request that came too early is repeated only by
// the heartbeat of Fast DDS.
#[test]
fn the_first_call_of_an_rclpy_client_is_answered_at_once() {
    let domain = 100;
    let mut probe = Probe::start(domain, &[]);
    probe.runs();
    let peer = Mutex::new(Peer::start("peer", domain));
    repeat_if_late(|| {
        let mut peer = peer.lock().unwrap_or_else(PoisonError::into_inner);
        all_answered("rclpy", &first_calls_of_rclpy(&mut peer, CALLS));
    });
}

#[test]
#[ignore = "takes minutes"]
fn five_hundred_first_calls() {
    let domain = 101;
    let mut probe = Probe::start(domain, &[]);
    probe.runs();
    let mut peer = Peer::start("peer", domain);
    all_answered("rclpy", &first_calls_of_rclpy(&mut peer, 500));
    drop(peer);
    let new_processes = (0..100).map(|i| first_call_of_a_new_process(domain, i));
    all_answered("new processes", &new_processes.collect::<Vec<_>>());
}

/// How long the only call of a new rclpy process takes \[ms\].
fn first_call_of_a_new_process(domain: u16, number: usize) -> Option<f64> {
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/graph/first_call.py");
    let output = Command::new(python())
        .args([script, &format!("caller{number}")])
        .env("ROS_DOMAIN_ID", domain.to_string())
        .env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        .env("RMW_IMPLEMENTATION", "rmw_fastrtps_cpp")
        .env_remove("ROS_LOCALHOST_ONLY")
        .output()
        .expect("python can be started");
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{errors}");
    let time = String::from_utf8_lossy(&output.stdout);
    time.trim().parse().ok()
}

/// Calls a service from as many new clients as needed, without a pause after `wait_for_service`.
fn first_calls(domain: u16, service: &'static str, count: usize) -> Vec<Option<f64>> {
    let domain = Domain {
        id: domain,
        range: DiscoveryRange::Localhost,
    };
    let mut process = Process::new(RosArgs::default(), domain);
    let (send, receive) = mpsc::channel();
    let program = move |node: &fuyu::ros::Node| {
        for _ in 0..count {
            let client: ServiceClient<Trigger> = node.client(service)?;
            assert!(client.wait_for_service(PATIENCE), "no service {service}");
            let start = Instant::now();
            let answer = client.call(&TriggerRequest::default(), Duration::from_secs(10));
            let time = start.elapsed().as_secs_f64() * 1e3;
            let _ = send.send(answer.ok().map(|_| time));
        }
        Ok(())
    };
    process.start("caller", program).expect("the node starts");
    let all = receive.iter().take(count).collect();
    process.finish().expect("it ends in order");
    all
}

#[test]
fn the_first_call_of_our_client_is_answered_at_once() {
    let domain = 102;
    let mut probe = Probe::start(domain, &[]);
    probe.runs();
    let mut peer = Peer::start("peer", domain);
    peer.does(json!({
        "do": "serve", "service": "/pong", "type": "std_srvs/srv/Trigger",
        "response": {"success": true, "message": "pong"}
    }));
    repeat_if_late(|| {
        all_answered("fuyu to fuyu", &first_calls(domain, "/probe/ping", CALLS));
        all_answered("fuyu to rclpy", &first_calls(domain, "/pong", CALLS));
    });
}

mod fibonacci {
    fuyu_ros::action! {
        package test_msgs;

        /// A long computation.
        action Fibonacci {
            goal {
                /// How many numbers.
                order: i32,
            }
            outcome {
                /// The numbers.
                sequence: Vec<i32>,
            }
            feedback {
                /// The numbers so far.
                sequence: Vec<i32>,
            }
        }
    }
}

// Fails if goals, cancellations or requests for results are treated differently from other calls.
#[test]
fn the_first_calls_of_an_action_are_answered_at_once() {
    let domain = 107;
    let mut process = Process::new(
        RosArgs::default(),
        Domain {
            id: domain,
            range: DiscoveryRange::Localhost,
        },
    );
    let started = process.start("actor", |node| {
        let actions = ActionServer::<fibonacci::Fibonacci>::new(node, "fibonacci")?;
        let mut goals = Vec::new();
        while node.wait() {
            goals.extend(std::iter::from_fn(|| actions.take()));
            let canceled = goals.extract_if(.., |goal: &mut Goal<_>| goal.is_canceling());
            canceled.for_each(|goal| goal.canceled(fibonacci::Outcome::default()));
        }
        Ok(())
    });
    started.expect("the node starts");
    let peer = Mutex::new(Peer::start("peer", domain));
    repeat_if_late(|| {
        let mut peer = peer.lock().unwrap_or_else(PoisonError::into_inner);
        let answer = peer.does(json!({
            "do": "first_goals", "action": "/fibonacci", "type": "test_msgs/action/Fibonacci",
            "goal": {"order": 5}, "count": CALLS / 3
        }));
        let all = times(&answer);
        assert_eq!(all.len(), CALLS / 3 * 3);
        all_answered("goals, cancellations, results", &all);
    });
    process.finish().expect("it ends in order");
}

// Fails if the only message of a publisher that ends at once is lost because the reader did not know the publisher yet: without a
// request for it, one to eight of 20. Fast DDS does not answer one request of about 25 on a busy computer, and a topic sends one
// (`first_samples.rs`), so one may be lost.
#[test]
fn what_is_published_once_arrives() {
    let domain = 108;
    let mut probe = Probe::start(domain, &[]);
    probe.runs();
    let peer = Mutex::new(Peer::start("peer", domain));
    let (kind, tries) = ("std_msgs/msg/String", 20);
    let count = AtomicU32::new(0);
    let mut listening = peer.lock().unwrap_or_else(PoisonError::into_inner);
    listening.subscribe("heard", kind, "reliable");
    // An echo that the peer could not hear yet would count as lost.
    eventually("the peer hears the echo", PATIENCE, || {
        let message = json!({"data": "ready?"});
        listening.does(json!({"do": "publish", "topic": "say", "type": kind, "message": message}));
        let heard =
            listening.does(json!({"do": "wait", "topic": "heard", "count": 1, "timeout": 1}));
        (!heard.as_array().expect("a list").is_empty()).then_some(())
    });
    drop(listening);
    repeat_if_late(|| {
        let mut peer = peer.lock().unwrap_or_else(PoisonError::into_inner);
        let mut sent = Vec::new();
        for _ in 0..tries {
            let text = format!("once {}", count.fetch_add(1, Relaxed));
            let message = json!({"data": text});
            peer.does(json!({"do": "once", "topic": "say", "type": kind, "message": message}));
            sent.push(text);
        }
        thread::sleep(Duration::from_millis(500));
        let heard = peer.does(json!({"do": "wait", "topic": "heard", "count": 1, "timeout": 5}));
        let heard = heard.as_array().expect("a list");
        let arrived = sent
            .iter()
            .filter(|text| heard.iter().any(|h| h["message"]["data"] == text.as_str()))
            .count();
        println!("{arrived} of {tries} messages that were published once arrived");
        assert!(arrived + 1 >= tries, "{heard:?} of {sent:?}");
    });
}

/// Names of parameters, so many that the reply does not fit into a datagram on a wire.
fn many_names(count: usize) -> Value {
    json!({"names": vec!["label"; count]})
}

// Fails if long replies leave it to rustdds to fragment them. The peer has the default settings of ROS: it listens on a wire
// as well, so rustdds limits its datagrams to the wire's, which are smaller in tunnels than on Ethernet.
#[test]
fn long_replies_reach_rclpy_with_its_default_settings() {
    let Some(namespace) = Namespace::new("long") else {
        return;
    };
    if let Err(e) = namespace.add_wire("10.99.1.1/24") {
        println!("skipped: no second interface can be made here: {e}");
        return;
    }
    for (range, mtu) in [("LOCALHOST", 1500), ("SUBNET", 1400), ("SUBNET", 1280)] {
        let mtu_text = mtu.to_string();
        let set = namespace.ip(&["link", "set", "wire0", "mtu", &mtu_text]);
        set.expect("the wire takes it");
        let domain = 103;
        let mut probe = namespace.command(Probe::executable());
        probe.env("ROS_AUTOMATIC_DISCOVERY_RANGE", range);
        let mut probe = Probe::start_with(probe, domain, &[]);
        probe.runs();
        let mut python = namespace.command(python());
        python.env("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET");
        let mut peer = Peer::start_with(python, "peer", domain);
        let mut call = |service: &str, type_name: &str, names: Value| {
            peer.does(json!({
                "do": "call", "service": format!("/probe/{service}"),
                "type": format!("rcl_interfaces/srv/{type_name}"), "request": names, "timeout": 20
            }))["response"]
                .clone()
        };
        // A short one in between: a long one must not hold up those after it.
        for count in [1, 50, 2, 400, 3, 2000, 1].into_iter().chain(15..40) {
            let values = call("get_parameters", "GetParameters", many_names(count));
            let values = values["values"].as_array().expect("values");
            assert_eq!(values.len(), count, "{range} {mtu}");
            assert!(values.iter().all(|v| v["string_value"] == "hello"));
            let described = call(
                "describe_parameters",
                "DescribeParameters",
                many_names(count),
            );
            let described = described["descriptors"].as_array().expect("descriptors");
            assert_eq!(described.len(), count, "{range} {mtu}");
            assert!(
                described
                    .iter()
                    .all(|d| d["additional_constraints"] == "not empty")
            );
        }
    }
}
