//! A real rclpy node for tests, driven over a pipe. See `peer.py`.

use serde_json::{Value, json};
use std::{
    collections::BTreeMap,
    io::{BufRead, BufReader, Write},
    os::{
        linux::net::SocketAddrExt,
        unix::net::{SocketAddr, UnixListener},
    },
    path::PathBuf,
    process::{Child, ChildStdin, Command, Stdio},
    sync::{Arc, Mutex, PoisonError, Weak, mpsc},
    thread,
    time::Duration,
};

/// The Python of the tests' environment, which is made on first use.
pub fn python() -> PathBuf {
    crate::python::environment("test-venv.sh", &[])
}

/// A DDS domain that no other test run on this computer uses while this lives.
#[derive(Clone)]
pub struct DomainClaim(
    #[expect(dead_code, reason = "bound as long as it lives")] Arc<UnixListener>,
);

impl DomainClaim {
    /// Waits until other test runs leave the domain; the same test may claim it again.
    pub fn new(domain: u16) -> Self {
        static CLAIMED: Mutex<BTreeMap<u16, Weak<UnixListener>>> = Mutex::new(BTreeMap::new());
        let name = SocketAddr::from_abstract_name(format!("fuyu-domain-{domain}"));
        let name = name.expect("a short name");
        for _ in 0..6000 {
            let mut claimed = CLAIMED.lock().unwrap_or_else(PoisonError::into_inner);
            if let Some(ours) = claimed.get(&domain).and_then(Weak::upgrade) {
                return Self(ours);
            }
            // A bound name is freed whenever its process ends, unlike a file.
            if let Ok(socket) = UnixListener::bind_addr(&name) {
                let socket = Arc::new(socket);
                claimed.insert(domain, Arc::downgrade(&socket));
                return Self(socket);
            }
            drop(claimed);
            thread::sleep(Duration::from_millis(100));
        }
        panic!("another test run has used ROS domain {domain} for ten minutes");
    }
}

/// A running rclpy node.
pub struct Peer {
    _domain: DomainClaim,
    child: Child,
    stdin: ChildStdin,
    answers: mpsc::Receiver<String>,
}

/// Longest time that any command may take; `peer.py` itself gives up much earlier.
const PATIENCE: Duration = Duration::from_secs(180);

impl Peer {
    /// Starts one on loopback in a DDS domain.
    pub fn start(name: &str, domain: u16) -> Self {
        Self::start_with(Command::new(python()), name, domain)
    }

    /// Starts one with a command that ends in a Python interpreter; on loopback, unless the command says otherwise.
    pub fn start_with(mut command: Command, name: &str, domain: u16) -> Self {
        let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/support/peer.py");
        let domain_claim = DomainClaim::new(domain);
        const RANGE: &str = "ROS_AUTOMATIC_DISCOVERY_RANGE";
        if !command.get_envs().any(|(name, _)| name == RANGE) {
            command.env(RANGE, "LOCALHOST");
        }
        let mut child = command
            .args([script, name])
            .env("ROS_DOMAIN_ID", domain.to_string())
            .env("RMW_IMPLEMENTATION", "rmw_fastrtps_cpp")
            .env_remove("ROS_LOCALHOST_ONLY")
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("python can be started");
        let stdin = child.stdin.take().expect("stdin is piped");
        let stdout = BufReader::new(child.stdout.take().expect("stdout is piped"));
        let (lines, answers) = mpsc::channel();
        // Ends with the pipe, thus with the peer.
        thread::spawn(move || {
            for line in stdout.lines().map_while(Result::ok) {
                if lines.send(line).is_err() {
                    return;
                }
            }
        });
        let peer = Self {
            _domain: domain_claim,
            child,
            stdin,
            answers,
        };
        assert_eq!(peer.read("the start"), json!({"ready": true}));
        peer
    }

    /// Executes a command of `peer.py`; panics if it raises.
    pub fn does(&mut self, command: Value) -> Value {
        writeln!(self.stdin, "{command}").expect("the peer runs");
        let answer = self.read(&command);
        assert!(answer.get("error").is_none(), "{command} gave {answer}");
        answer
    }

    /// The endpoints of a node in the graph, as soon as all that are expected are there: names by kind (publishers,
    /// subscribers, services). Panics if it never does.
    pub fn graph(&mut self, node: &str, namespace: &str, expected: &Value) -> Value {
        self.does(json!({
            "do": "graph", "node": node, "namespace": namespace, "expected": expected
        }))
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

    fn read(&self, asked: impl std::fmt::Display) -> Value {
        let line = self.answers.recv_timeout(PATIENCE);
        let line = line.unwrap_or_else(|e| panic!("the peer does not answer {asked}: {e}"));
        serde_json::from_str(&line).unwrap_or_else(|e| panic!("the peer said {line:?}: {e}"))
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
