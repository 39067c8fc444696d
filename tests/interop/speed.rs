//! Latency of a joint state, compared with other stacks in one run, and the cost of the default graph.

use fuyu::{
    msg::{cdr, sensor_msgs::JointState},
    ros::{Node, NodeError, Qos, Time},
};
use std::{
    fmt::Write as _,
    fs,
    process::{Command, Stdio},
    sync::{Arc, Mutex, PoisonError},
    thread,
    time::{Duration, Instant},
};

use crate::{
    binaries::binary,
    child::{Running, executable},
    echo::joint_state,
    namespace::Namespace,
    peer, python,
};

const PERIOD: Duration = Duration::from_millis(1);
/// Every test here has a separate network namespace.
pub const DOMAIN: u16 = 17;

fn quality(reliable: bool) -> Qos {
    match reliable {
        true => Qos::RELIABLE.depth(5000),
        false => Qos::SENSOR_DATA.depth(100),
    }
}

/// Parameters of sender and receiver: how many messages, and whether reliably.
fn parameters(node: &Node) -> Result<(i64, bool), NodeError> {
    let mut declare = node.declare();
    let count = declare.param("count", 5000, "Messages").value();
    let reliable = declare
        .param("reliable", false, "Whether none may be lost")
        .value();
    declare.finish()?;
    Ok((count, reliable))
}

/// Publishes 1000 joint states a second, each with its number and the time of sending.
pub fn send(node: &Node) -> Result<(), NodeError> {
    let (count, reliable) = parameters(node)?;
    let states = node.advertise::<JointState>("speed", quality(reliable))?;
    let ready = node.subscribe::<JointState>("ready", Qos::LATCHED)?;
    // Each receiver announces that it is ready.
    while ready.take().is_none() {
        if !node.wait() {
            return Ok(());
        }
    }
    let mut due = Instant::now();
    for number in 0..count {
        if !node.ok() {
            break;
        }
        let mut state = joint_state(0);
        state.position[0] = number as f64;
        state.header.stamp = Time::wall().into();
        states.publish(&state);
        due += PERIOD;
        thread::sleep(due.saturating_duration_since(Instant::now()));
    }
    tracing::info!("sent {count}, dropped {}", states.dropped());
    while node.wait() {}
    Ok(())
}

/// Receives what [`send`] sends, and logs latency and losses at the end.
pub fn take(node: &Node) -> Result<(), NodeError> {
    let (count, reliable) = parameters(node)?;
    #[derive(Default)]
    struct Heard {
        delays: Vec<i64>,
        last: Option<(f64, i64)>,
        lost: f64,
        backwards: u32,
    }
    let heard = Arc::new(Mutex::new(Heard::default()));
    let taken = Arc::clone(&heard);
    let _states = node.subscribe_raw(
        "speed",
        "sensor_msgs/msg/JointState",
        quality(reliable),
        move |sample| {
            let now = Time::wall().as_nanos();
            let Ok(state) = cdr::decode::<JointState>(&sample.cdr) else {
                return;
            };
            let mut heard = taken.lock().unwrap_or_else(PoisonError::into_inner);
            let (number, sent) = (state.position[0], Time::from(state.header.stamp).as_nanos());
            if let Some((last, before)) = heard.last {
                heard.lost += number - last - 1.0;
                heard.backwards += u32::from(sent < before);
            } else {
                heard.lost = number;
            }
            heard.last = Some((number, sent));
            // The list of delays in a run of an hour would look like a memory leak.
            if heard.delays.len() < 100_000 {
                heard.delays.push(now - sent);
            }
        },
    )?;
    let ready = node.advertise::<JointState>("ready", Qos::LATCHED)?;
    // Discovery is not simultaneous: the other side may discover this one a little later.
    let begin = Instant::now();
    let mut last = (None, Instant::now());
    while node.wait_for(Duration::from_millis(50)) {
        if begin.elapsed() > Duration::from_secs(3) && last.0.is_none() {
            ready.publish(&JointState::default());
        }
        let mut heard = heard.lock().unwrap_or_else(PoisonError::into_inner);
        let newest = heard.last.map(|(number, _)| number);
        if newest != last.0 {
            last = (newest, Instant::now());
        }
        let over = newest.is_some_and(|n| n >= (count - 1) as f64)
            || newest.is_some() && last.1.elapsed() > Duration::from_secs(20);
        if over {
            heard.delays.sort_unstable();
            let delays = &heard.delays;
            let at = |part: f64| delays[((delays.len() - 1) as f64 * part) as usize] as f64 * 1e-3;
            tracing::info!(
                "took {} lost {} backwards {} p50 {:.1} p99 {:.1} us",
                newest.map_or(0.0, |n| n + 1.0) - heard.lost,
                heard.lost,
                heard.backwards,
                at(0.5),
                at(0.99)
            );
            break;
        }
    }
    while node.wait() {}
    Ok(())
}

/// The number that follows a word in the log.
pub fn after(text: &str, word: &str) -> f64 {
    let mut words = text.split_whitespace();
    words.find(|w| *w == word);
    let number = words.next().and_then(|n| n.parse().ok());
    number.unwrap_or_else(|| panic!("no {word} in {text}"))
}

/// A pair of fuyu's processes: what the receiver logs at the end.
fn fuyu(namespace: &Namespace, count: usize) -> String {
    let count = format!("count:={count}");
    let start = |name: &str| {
        let args = ["--ros-args", "-r", &format!("__node:={name}"), "-p", &count];
        Running::program(namespace.command(executable()), name, DOMAIN, &args)
    };
    let (send, take) = (start("send"), start("take"));
    take.says(" p99 ");
    send.interrupt();
    let said = take.interrupt();
    let line = said.lines().find(|line| line.contains(" p99 "));
    line.expect("it was said").to_owned()
}

/// A pair of processes of another stack.
fn other(namespace: &Namespace, python: &std::path::Path, stack: &str, count: usize) -> String {
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/interop/speed_peer.py");
    let start = |role: &str| {
        let mut command = namespace.command(python);
        command
            .args([script, stack, role, &count.to_string()])
            .env("ROS_DOMAIN_ID", DOMAIN.to_string())
            .env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
            .env("RMW_IMPLEMENTATION", "rmw_fastrtps_cpp")
            .env_remove("ROS_LOCALHOST_ONLY")
            .stdout(Stdio::piped());
        command.spawn().expect("python can be started")
    };
    let (mut send, take) = (start("send"), start("take"));
    let output = take.wait_with_output().expect("it ends");
    let _ = send.kill();
    let _ = send.wait();
    String::from_utf8_lossy(&output.stdout).trim().to_owned()
}

/// Checks the median of three measurements: for values that are compared with another program's or are averages over time,
/// and that other load may disturb once. The third measurement is omitted if the first two agree.
fn median_below(what: &str, limit: f64, mut measure: impl FnMut() -> f64) {
    let mut measured = vec![measure(), measure()];
    if (measured[0] < limit) != (measured[1] < limit) {
        measured.push(measure());
    }
    println!("{what}: {measured:.3?}, limit {limit}");
    let below = measured.iter().filter(|figure| **figure < limit).count();
    assert!(below >= 2, "{what}: {measured:.3?}, limit {limit}");
}

// The figure in docs/interop.md is from this test, with FUYU_SPEED_COUNT=20000.
#[test]
#[ignore = "compares run times: needs a computer that does nothing else"]
fn latency_of_joint_states_is_below_that_of_rclpy() {
    let Some(namespace) = Namespace::new("speed") else {
        return;
    };
    let count = std::env::var("FUYU_SPEED_COUNT")
        .ok()
        .and_then(|n| n.parse().ok())
        .unwrap_or(3000);
    let rclpy = peer::python();
    let cyclone = python::environment("test-venv.sh", &["cyclone", "cyclonedds==11.0.1"]);
    median_below("p50 over that of rclpy", 1.0, || {
        let lines = [
            ("fuyu to fuyu", fuyu(&namespace, count)),
            (
                "rclpy to rclpy (Fast DDS)",
                other(&namespace, &rclpy, "rclpy", count),
            ),
            (
                "CycloneDDS to CycloneDDS, Python",
                other(&namespace, &cyclone, "cyclone", count),
            ),
        ];
        let mut table =
            "| one way at 1 kHz | p50 [us] | p99 [us] | taken |\n| --- | --- | --- | --- |\n"
                .to_owned();
        for (who, line) in &lines {
            let figure = |word| after(line, word);
            writeln!(
                table,
                "| {who} | {:.0} | {:.0} | {:.1} % |",
                figure("p50"),
                figure("p99"),
                100.0 * figure("took") / count as f64
            )
            .expect("text");
        }
        println!("{table}");
        after(&lines[0].1, "p50") / after(&lines[1].1, "p50")
    });
}

/// Processor time that a process has used \[s\].
pub fn used(id: u32) -> f64 {
    let stat = fs::read_to_string(format!("/proc/{id}/stat")).expect("it runs");
    let (_, fields) = stat.rsplit_once(") ").expect("fields");
    let ticks = fields
        .split(' ')
        .skip(11)
        .take(2)
        .map(|t| t.parse::<f64>().expect("ticks"));
    ticks.sum::<f64>() / 100.0
}

// Less than half of this is usual, also on a busy computer. Fails when the graph would leave little of a small one.
#[test]
fn a_graph_in_real_time_costs_little_processor_time() {
    let Some(namespace) = Namespace::new("cost") else {
        return;
    };
    let folder = tempfile::tempdir().expect("a folder");
    let mut command: Command = namespace.command(binary("fuyu"));
    let bag = folder.path().join("bag");
    command
        .args([
            "launch",
            "config/servicing.yaml",
            "--duration",
            "600",
            "--bag",
        ])
        .arg(bag)
        .stdout(Stdio::null());
    command.current_dir(env!("CARGO_MANIFEST_DIR"));
    let launch = Running::start(command, DOMAIN);
    launch.says("recording to");
    thread::sleep(Duration::from_secs(5));
    let what = "processor time of the graph over real time";
    median_below(what, 0.25, || {
        let (begin, before) = (Instant::now(), used(launch.id()));
        thread::sleep(Duration::from_secs(10));
        (used(launch.id()) - before) / begin.elapsed().as_secs_f64()
    });
    launch.interrupt();
}
