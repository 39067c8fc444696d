//! A hostile peer: malformed RTPS datagrams and malformed samples.

use fuyu::{
    msg::{Interface, cdr, geometry_msgs::PoseStamped, sensor_msgs::JointState, std_msgs::Int64},
    ros::{Node, NodeError, Publisher, Qos},
};
use rand::{RngExt, SeedableRng, rngs::StdRng};
use serde_json::json;
use std::{
    net::{Ipv4Addr, UdpSocket},
    process::Command,
    thread,
    time::Duration,
};

use crate::{
    binaries::binary,
    child::{Running, executable},
    echo::joint_state,
    peer::Peer,
    waiting::{PATIENCE, eventually},
};

/// Number of datagrams, and of samples.
const COUNT: usize = 10_000;
/// How much memory a process may gain in the second round \[kB\]: the first round fills its caches.
const GROWTH: u64 = 8_000;

/// A byte string with some of it changed, left out, repeated or cut off.
fn spoilt(bytes: &[u8], from: usize, random: &mut StdRng) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    for _ in 0..random.random_range(1..6) {
        if bytes.len() <= from + 1 {
            break;
        }
        let at = random.random_range(from..bytes.len());
        match random.random_range(0..6) {
            0 => bytes[at] = random.random_range(0..=255),
            1 => bytes[at] ^= 1 << random.random_range(0..8),
            // Lengths and counts are four bytes, or two.
            2 => {
                let end = bytes.len().min(at + 4);
                bytes[at..end].fill(if random.random_bool(0.5) { 0xff } else { 0 });
            }
            3 => bytes.truncate(at),
            4 => {
                let end = bytes.len().min(at + random.random_range(1..32));
                let again = bytes[at..end].to_vec();
                bytes.splice(at..at, again);
            }
            _ => {
                let end = bytes.len().min(at + random.random_range(1..8));
                bytes.drain(at..end);
            }
        }
    }
    bytes
}

/// Announcements of a node's participant, received on the port of another participant of this computer.
fn announcements(domain: u16) -> Vec<Vec<u8>> {
    let catcher = (5..11).find_map(|participant| {
        let port = 7410 + 250 * domain + 2 * participant;
        UdpSocket::bind((Ipv4Addr::LOCALHOST, port)).ok()
    });
    let catcher = catcher.expect("a port of a participant that is not there");
    catcher.set_read_timeout(Some(PATIENCE)).expect("a timeout");
    let mut buffer = [0; 65_536];
    (0..2)
        .map(|_| {
            let length = catcher.recv(&mut buffer).expect("a node announces itself");
            buffer[..length].to_vec()
        })
        .collect()
}

/// A submessage of random kind and content, after a valid header.
fn invented(header: &[u8], random: &mut StdRng) -> Vec<u8> {
    const KINDS: [u8; 13] = [
        0x01, 0x06, 0x07, 0x08, 0x09, 0x0c, 0x0d, 0x0e, 0x0f, 0x12, 0x13, 0x15, 0x16,
    ];
    let mut bytes = header[..20].to_vec();
    for _ in 0..random.random_range(1..4) {
        let length = random.random_range(0..120usize);
        let said = if random.random_bool(0.8) {
            length
        } else {
            random.random_range(0..65_536)
        };
        bytes.push(KINDS[random.random_range(0..KINDS.len())]);
        bytes.push(random.random_range(0..16));
        bytes.extend((said as u16).to_le_bytes());
        bytes.extend((0..length).map(|_| random.random_range(0..=255u8)));
    }
    bytes
}

/// Sends to every port of the first participants of a domain.
fn shell(domain: u16, seeds: &[Vec<u8>], random: &mut StdRng) {
    let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("a socket");
    for i in 0..COUNT {
        let seed = &seeds[i % seeds.len()];
        let datagram = match i % 4 {
            // Random bytes, without a valid header.
            0 => (0..random.random_range(0..200))
                .map(|_| random.random_range(0..=255))
                .collect(),
            1 => invented(seed, random),
            2 => spoilt(seed, 0, random),
            // The header stays valid, so that the rest is parsed.
            _ => spoilt(seed, 20, random),
        };
        let participant = (i / 4 % 3) as u16;
        for offset in [10, 11] {
            let port = 7400 + 250 * domain + offset + 2 * participant;
            // A port without a listener refuses it.
            let _ = socket.send_to(&datagram, (Ipv4Addr::LOCALHOST, port));
        }
        // No faster than the node can read: datagrams that the kernel drops would test nothing.
        if i % 20 == 0 {
            thread::sleep(Duration::from_millis(5));
        }
    }
}

/// Publishes malformed samples of three types, then prints a line.
pub fn program(node: &Node) -> Result<(), NodeError> {
    let states =
        node.advertise::<JointState>("in/sensor_msgs/JointState", Qos::RELIABLE.depth(100))?;
    let commands = node.advertise::<JointState>("joint_commands", Qos::RELIABLE.depth(100))?;
    let goals = node.advertise::<PoseStamped>("goal_pose", Qos::RELIABLE.depth(100))?;
    let numbers = node.subscribe::<Int64>("shell", Qos::RELIABLE)?;
    let done = node.advertise::<Int64>("shelled", Qos::RELIABLE)?;
    tracing::info!("ready to shell");
    while node.wait() {
        let Some(seed) = numbers.take() else {
            continue;
        };
        let mut random = StdRng::seed_from_u64(seed.message.data as u64);
        let state = cdr::encode(&joint_state(0));
        let goal = cdr::encode(&PoseStamped::default());
        for i in 0..COUNT {
            match i % 3 {
                0 => spoil(&states, &state, &mut random),
                1 => spoil(&commands, &state, &mut random),
                _ => spoil(&goals, &goal, &mut random),
            }
            if i % 20 == 0 {
                thread::sleep(Duration::from_millis(5));
            }
        }
        done.publish(&seed.message);
    }
    Ok(())
}

fn spoil<M: Interface>(publisher: &Publisher<M>, good: &[u8], random: &mut StdRng) {
    // The first four bytes are written by DDS.
    let mut bytes = spoilt(good, 4, random);
    bytes.resize(bytes.len().max(4), 0);
    publisher.publish_cdr(bytes);
}

fn start(domain: u16) -> Running {
    let echo = Command::new(executable());
    let echo = Running::program(echo, "echo", domain, &["--ros-args", "-r", "__node:=echo"]);
    echo.says("echoes");
    echo
}

/// Whether the node still echoes a message.
fn echoes(peer: &mut Peer, data: i64) {
    let kind = "std_msgs/msg/Int64";
    eventually("an echo", PATIENCE, || {
        peer.does(json!({
            "do": "publish", "topic": "in/std_msgs/Int64", "type": kind, "message": {"data": data}
        }));
        let wait = json!({"do": "wait", "topic": "out/std_msgs/Int64", "timeout": 2.0});
        let came = peer.does(wait);
        let mut came = came.as_array()?.iter();
        came.any(|m| m["message"]["data"] == data).then_some(())
    });
}

// Fails if a datagram ends a thread of the node, or its memory is never freed.
#[test]
fn malformed_datagrams_harm_nothing() {
    let domain = 18;
    let mut echo = start(domain);
    let seeds = announcements(domain);
    let mut peer = Peer::start("peer", domain);
    peer.subscribe("out/std_msgs/Int64", "std_msgs/msg/Int64", "reliable");
    echoes(&mut peer, 1);
    let mut random = StdRng::seed_from_u64(18);
    shell(domain, &seeds, &mut random);
    echoes(&mut peer, 2);
    let before = echo.resident();
    shell(domain, &seeds, &mut random);
    echoes(&mut peer, 3);
    let after = echo.resident();
    println!("{COUNT} datagrams, twice: {before} kB, then {after} kB");
    assert!(echo.runs());
    assert!(after < before + GROWTH, "from {before} to {after} kB");
    let said = echo.interrupt();
    assert!(!said.contains("panic"), "{said}");
}

// Fails if a sample that cannot be decoded, or has invalid values, ends a node or changes its state.
#[test]
fn malformed_samples_harm_nothing() {
    let domain = 19;
    let mut echo = start(domain);
    let folder = tempfile::tempdir().expect("a folder");
    let config = concat!(env!("CARGO_MANIFEST_DIR"), "/config/positioning.yaml");
    let node = |executable: &str| {
        let mut command = Command::new(executable);
        command
            .args(["--ros-args", "--params-file", config, "-p"])
            .arg(if executable.ends_with("dynamics") {
                "duration:=0.0"
            } else {
                "use_sim_time:=true"
            })
            .current_dir(folder.path());
        Running::start(command, domain)
    };
    let mut dynamics = node(binary("dynamics"));
    let mut camera = node(binary("camera"));
    let shell = Running::program(Command::new(executable()), "hostile", domain, &[]);
    shell.says("ready to shell");
    let mut peer = Peer::start("peer", domain);
    for (topic, kind) in [
        ("out/std_msgs/Int64", "std_msgs/msg/Int64"),
        ("shelled", "std_msgs/msg/Int64"),
        ("joint_states", "sensor_msgs/msg/JointState"),
    ] {
        peer.subscribe(topic, kind, "reliable");
    }
    let shelled = |peer: &mut Peer, seed: i64| {
        let kind = "std_msgs/msg/Int64";
        peer.does(
            json!({"do": "publish", "topic": "shell", "type": kind, "message": {"data": seed}}),
        );
        peer.receive("shelled", seed as usize);
        echoes(peer, seed);
    };
    shelled(&mut peer, 1);
    let before = [&echo, &dynamics, &camera].map(Running::resident);
    shelled(&mut peer, 2);
    let after = [&echo, &dynamics, &camera].map(Running::resident);
    println!("{COUNT} samples, twice: {before:?} kB, then {after:?} kB");
    for (process, (before, after)) in [&mut echo, &mut dynamics, &mut camera]
        .into_iter()
        .zip(before.into_iter().zip(after))
    {
        assert!(process.runs(), "{}", process.said());
        assert!(after < before + GROWTH, "from {before} to {after} kB");
    }
    // Time continues, and the published state is finite.
    let states = peer.receive("joint_states", 1);
    for state in &states {
        for field in ["position", "velocity", "effort"] {
            let values = state["message"][field].as_array().expect("a list");
            assert!(
                values
                    .iter()
                    .all(|x| x.as_f64().is_some_and(f64::is_finite)),
                "{state}"
            );
        }
    }
    for process in [echo, dynamics, camera, shell] {
        let said = process.interrupt();
        assert!(!said.contains("panic"), "{said}");
    }
}
