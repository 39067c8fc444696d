//! A Zenoh router, processes that are connected to it, and the same over DDS.

use fuyu_ros::ros::{
    DiscoveryRange, Domain, Middleware, Node, NodeError, Process, RosArgs, ZenohConfig,
};
use std::{
    net::TcpListener,
    time::{Duration, Instant},
};
use zenoh::Wait;

/// How long something may take that usually takes milliseconds.
pub const PATIENCE: Duration = Duration::from_secs(30);

/// A router on loopback; stops when dropped.
pub struct Router {
    session: zenoh::Session,
    port: u16,
}

impl Router {
    /// At a port that nobody uses.
    pub fn start() -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a free port");
        let port = listener.local_addr().expect("it is bound").port();
        drop(listener);
        Self::start_at(port)
    }

    pub fn start_at(port: u16) -> Self {
        let config = format!(
            r#"{{ mode: "router", listen: {{ endpoints: ["tcp/127.0.0.1:{port}"] }}, connect: {{ endpoints: [] }},
                  scouting: {{ multicast: {{ enabled: false }} }} }}"#
        );
        let config = zenoh::Config::from_json5(&config).expect("the configuration is valid");
        let session = zenoh::open(config).wait().expect("the router starts");
        Self { session, port }
    }

    pub fn port(&self) -> u16 {
        self.port
    }

    /// Where clients connect to.
    pub fn endpoint(&self) -> String {
        format!("tcp/127.0.0.1:{}", self.port)
    }

    /// A session that knows nothing of ROS.
    pub fn client(&self) -> zenoh::Session {
        let config = format!(
            r#"{{ mode: "client", connect: {{ endpoints: ["{}"] }} }}"#,
            self.endpoint()
        );
        let config = zenoh::Config::from_json5(&config).expect("the configuration is valid");
        zenoh::open(config).wait().expect("it connects")
    }

    /// A process of its own, as far as Zenoh knows: with a session.
    pub fn process(&self, domain: u16) -> Process {
        process(self.port, domain)
    }
}

impl Drop for Router {
    fn drop(&mut self) {
        self.session.close().wait().expect("the router stops");
    }
}

/// What connects the processes of a test.
pub enum Network {
    /// DDS on loopback, from this domain on.
    Dds(u16),
    Zenoh(Router),
}

impl Network {
    /// Runs a test over both transports. `domain` and the next one are used by no other test.
    pub fn each(domain: u16, test: impl Fn(&Self)) {
        for network in [Self::Zenoh(Router::start()), Self::Dds(domain)] {
            println!("over {}", network.name());
            test(&network);
        }
    }

    fn name(&self) -> &'static str {
        match self {
            Self::Dds(_) => "DDS",
            Self::Zenoh(_) => "Zenoh",
        }
    }

    pub fn is_zenoh(&self) -> bool {
        matches!(self, Self::Zenoh(_))
    }

    /// A process with a participant, in the first domain or in another one.
    pub fn process(&self, domain: u16) -> Process {
        match self {
            Self::Zenoh(router) => router.process(domain),
            Self::Dds(first) => {
                let id = first + domain;
                let range = DiscoveryRange::Localhost;
                Process::new(RosArgs::default(), Domain { id, range })
            }
        }
    }
}

/// A process that connects to the router at this port, which may not be there yet.
pub fn process(port: u16, domain: u16) -> Process {
    let config = ZenohConfig::default()
        .with("connect/endpoints", &format!(r#"["tcp/127.0.0.1:{port}"]"#))
        .and_then(|config| config.with("listen/endpoints", r#"["tcp/127.0.0.1:0"]"#))
        .expect("the configuration is valid");
    let range = DiscoveryRange::Localhost;
    Process::new(RosArgs::default(), Domain { id: domain, range })
        .with_middleware(Middleware::zenoh(config))
}

/// The program of a node that the test uses from outside.
pub fn idle(node: &Node) -> Result<(), NodeError> {
    while node.wait() {}
    Ok(())
}

/// Waits until `condition` holds.
#[track_caller]
pub fn eventually(what: &str, mut condition: impl FnMut() -> bool) {
    let deadline = Instant::now() + PATIENCE;
    while !condition() {
        assert!(Instant::now() < deadline, "not within {PATIENCE:?}: {what}");
        std::thread::sleep(Duration::from_millis(5));
    }
}
