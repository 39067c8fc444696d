//! What nodes of Fast DDS know of processes that join the graph at the same time, and join it again.

use std::{
    io::{BufRead, BufReader, Write},
    process::{Command, Stdio},
    thread,
    time::Duration,
};

use crate::{peer::python, probe::Probe};

const DOMAIN: u16 = 128;
/// Processes of fuyu, and participants of Fast DDS, that all discover each other at once: a load for two cores.
const PROBES: usize = 6;
const OBSERVERS: usize = 6;
const ROUNDS: usize = 6;

/// On a line of its input, waits until all observers know the same endpoints of this many new participants, but not longer
/// than 10 s; prints how many endpoints of each new participant each observer knows.
const SCRIPT: &str = "
import json, sys, time, rclpy
from rclpy.node import Node

PROBES, OBSERVERS = map(int, sys.argv[1:])
RUSTDDS = bytes([1, 0x12])
nodes = []
for i in range(OBSERVERS):
    context = rclpy.Context()
    rclpy.init(context=context)
    nodes.append(Node(f'observer{i}', context=context))
old = set()

def new(node):
    known = {}
    for topic, _ in node.get_topic_names_and_types(no_demangle=True):
        for uses in (node.get_publishers_info_by_topic, node.get_subscriptions_info_by_topic):
            for use in uses(topic, no_mangle=True):
                participant = bytes(use.endpoint_gid[:12])
                if participant.startswith(RUSTDDS) and participant not in old:
                    known[participant] = known.get(participant, 0) + 1
    return known

print('ready', flush=True)
for line in sys.stdin:
    end = time.monotonic() + 10
    while time.monotonic() < end:
        time.sleep(0.5)
        known = [new(node) for node in nodes]
        counts = sorted({n for each in known for n in each.values()})
        complete = all(len(each) == PROBES for each in known)
        if complete and counts == [json.loads(line)]:
            break
    print(json.dumps([sorted(each.values()) for each in known]), flush=True)
    old |= {participant for each in known for participant in each}
";

/// The topics of the probe, and the services of its node, in both directions.
const ENDPOINTS: usize = 27;

// Fails if endpoints are created while Fast DDS still asks for earlier ones of the same participant, of which it then knows
// nothing for ever (docs/upstream.md): at the first start on a busy computer, or when a process joins the graph again.
#[test]
fn every_endpoint_is_known_however_many_processes_join_at_once() {
    let mut observers = Command::new(python())
        .args(["-c", SCRIPT, &PROBES.to_string(), &OBSERVERS.to_string()])
        .env("ROS_DOMAIN_ID", DOMAIN.to_string())
        .env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        .env("RMW_IMPLEMENTATION", "rmw_fastrtps_cpp")
        .env_remove("ROS_LOCALHOST_ONLY")
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("python can be started");
    let mut commands = observers.stdin.take().expect("stdin is piped");
    let mut answers = BufReader::new(observers.stdout.take().expect("stdout is piped")).lines();
    let mut answer = || answers.next().expect("it runs").expect("it prints text");
    assert_eq!(answer(), "ready");
    let mut know = |when: &str| {
        writeln!(commands, "{ENDPOINTS}").expect("it reads");
        let known: Vec<Vec<usize>> = serde_json::from_str(&answer()).expect("numbers");
        let all = vec![vec![ENDPOINTS; PROBES]; OBSERVERS];
        assert_eq!(known, all, "endpoints known to each observer, {when}");
    };
    let probes: Vec<_> = (0..PROBES)
        .map(|i| {
            let name = format!("__node:=probe{i}");
            Probe::start(DOMAIN, &["--ros-args", "-r", &name])
        })
        .collect();
    know("after the start");
    for round in 0..ROUNDS {
        for signal in ["STOP", "CONT"] {
            probes.iter().for_each(|probe| probe.signal(signal));
            thread::sleep(Duration::from_millis(300));
        }
        know(&format!("after they have joined again, round {round}"));
    }
    drop(commands);
    observers.wait().expect("it ends");
}
