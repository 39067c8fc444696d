//! A real rclpy node for tests, driven over a pipe. See `peer.py`.

use serde_json::{Value, json};
use std::{
    io::{BufRead, BufReader, Write},
    path::PathBuf,
    process::{Child, ChildStdin, ChildStdout, Command, Stdio},
};

/// The Python of the tests' environment, which is made on first use.
pub fn python() -> PathBuf {
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/scripts/test-venv.sh");
    let output = Command::new(script)
        .stderr(Stdio::inherit())
        .output()
        .expect("scripts/test-venv.sh can be started");
    assert!(
        output.status.success(),
        "scripts/test-venv.sh failed, see above"
    );
    String::from_utf8_lossy(&output.stdout).trim().into()
}

/// A running rclpy node.
pub struct Peer {
    child: Child,
    stdin: ChildStdin,
    stdout: BufReader<ChildStdout>,
}

impl Peer {
    /// Starts one on loopback in a DDS domain.
    pub fn start(name: &str, domain: u16) -> Self {
        Self::start_with(Command::new(python()), name, domain)
    }

    /// Starts one with a command that ends in a Python interpreter.
    pub fn start_with(mut command: Command, name: &str, domain: u16) -> Self {
        let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/support/peer.py");
        let mut child = command
            .args([script, name])
            .env("ROS_DOMAIN_ID", domain.to_string())
            .env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
            .env("RMW_IMPLEMENTATION", "rmw_fastrtps_cpp")
            .env_remove("ROS_LOCALHOST_ONLY")
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("python can be started");
        let stdin = child.stdin.take().expect("stdin is piped");
        let stdout = BufReader::new(child.stdout.take().expect("stdout is piped"));
        let mut peer = Self {
            child,
            stdin,
            stdout,
        };
        assert_eq!(peer.read(), json!({"ready": true}));
        peer
    }

    /// Does a command of `peer.py`; panics if it raises.
    pub fn does(&mut self, command: Value) -> Value {
        writeln!(self.stdin, "{command}").expect("the peer runs");
        let answer = self.read();
        assert!(answer.get("error").is_none(), "{command} gave {answer}");
        answer
    }

    /// Subscribes to a topic.
    pub fn subscribe(&mut self, topic: &str, type_name: &str, qos: &str) {
        self.does(json!({"do": "subscribe", "topic": topic, "type": type_name, "qos_name": qos}));
    }

    /// At least `count` messages of a subscribed topic; panics if they do not come.
    pub fn receive(&mut self, topic: &str, count: usize) -> Vec<Value> {
        let all = self.does(json!({"do": "wait", "topic": topic, "count": count}));
        let all = all.as_array().expect("a list").clone();
        assert!(
            all.len() >= count,
            "{} of {count} messages on {topic}",
            all.len()
        );
        all
    }

    fn read(&mut self) -> Value {
        let mut line = String::new();
        self.stdout.read_line(&mut line).expect("the peer answers");
        serde_json::from_str(&line).unwrap_or_else(|e| panic!("the peer said {line:?}: {e}"))
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
