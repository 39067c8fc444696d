//! Authentication and access control with the keys of `fuyu_ros::keys`.

use base64::{Engine as _, prelude::BASE64_STANDARD};
use fuyu_ros::{
    keys::{self, KeyOptions, Role},
    msg::std_msgs,
    ros::{
        DiscoveryRange, Domain, Middleware, Node, Process, Publisher, Qos, RosArgs, Subscription,
        ZenohConfig, ZenohRouter,
    },
};
use std::{net::TcpListener, path::Path, sync::MutexGuard, time::Duration};
use tempfile::TempDir;

use crate::{
    eavesdropper::Eavesdropper,
    log,
    messages::{AddTwoInts, AddTwoIntsRequest, AddTwoIntsResponse},
    router::{PATIENCE, eventually, idle},
};

/// Keys, and a router that accepts them.
struct Guarded {
    folder: TempDir,
    _router: ZenohRouter,
    _log: MutexGuard<'static, ()>,
    port: u16,
}

impl Guarded {
    fn new(validity: Duration) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a free port");
        let port = listener.local_addr().expect("it is bound").port();
        drop(listener);
        let folder = tempfile::tempdir().expect("a folder");
        create(folder.path(), port, validity);
        let log = log::start();
        let config = ZenohConfig::from_file(&folder.path().join("router.json5"));
        let router = ZenohRouter::start(&config.expect("the configuration is valid"));
        Self {
            folder,
            _router: router.expect("the router starts"),
            _log: log,
            port,
        }
    }

    fn process(&self, role: Role) -> Process {
        process(self.folder.path(), role)
    }
}

fn create(folder: &Path, port: u16, validity: Duration) {
    let host = "localhost".to_owned();
    let options = KeyOptions {
        host,
        port,
        validity,
    };
    keys::create(folder, &options).expect("keys are created");
}

fn process(folder: &Path, role: Role) -> Process {
    with_config(config(folder, role))
}

fn config(folder: &Path, role: Role) -> ZenohConfig {
    let file = folder.join(format!("{}.json5", role.name()));
    ZenohConfig::from_file(&file).expect("the configuration is valid")
}

fn with_config(config: ZenohConfig) -> Process {
    let domain = Domain {
        id: 0,
        range: DiscoveryRange::Localhost,
    };
    Process::new(RosArgs::default(), domain).with_middleware(Middleware::zenoh(config))
}

const DAY: Duration = Duration::from_secs(86_400);

fn publisher(node: &Node, topic: &str) -> Publisher<std_msgs::String> {
    node.advertise(topic, Qos::RELIABLE).expect("it publishes")
}

fn subscription(node: &Node, topic: &str) -> Subscription<std_msgs::String> {
    node.subscribe(topic, Qos::RELIABLE.depth(100))
        .expect("it subscribes")
}

fn from(sender: &str) -> std_msgs::String {
    std_msgs::String {
        data: sender.to_owned(),
    }
}

// Fails if a role could do more than it may, or less.
#[test]
fn roles_do_what_they_may() {
    let guarded = Guarded::new(DAY);
    let mut processes = Role::ALL.map(|role| guarded.process(role));
    let [robot, controller, operator, viewer] = &mut processes;
    let robot = robot.start("robot", idle).expect("it starts");
    let controller = controller.start("controller", idle).expect("it starts");
    let operator = operator.start("operator", idle).expect("it starts");
    let viewer = viewer.start("viewer", idle).expect("it starts");
    let commands = subscription(&robot, "arm/joint_commands");
    let states = publisher(&robot, "arm/joint_states");
    let _sum = robot
        .serve::<AddTwoInts>("sum", |r| AddTwoIntsResponse { sum: r.a + r.b })
        .expect("it serves");

    // Everybody sees the robot.
    for node in [&controller, &operator, &viewer] {
        let seen = subscription(node, "arm/joint_states");
        eventually("states are seen", || {
            states.publish(&from("robot"));
            seen.take().is_some()
        });
        eventually("the graph is seen", || {
            let all = node.discovered_publishers();
            all.iter().any(|p| p.topic == "/arm/joint_states")
        });
    }
    // The controller commands it, the others do not.
    let senders = [&controller, &operator, &viewer];
    let senders = senders.map(|node| (node.name().name(), publisher(node, "arm/joint_commands")));
    let mut heard = 0;
    eventually("commands of the controller arrive", || {
        for (name, sender) in &senders {
            sender.publish(&from(name));
        }
        while let Some(command) = commands.take() {
            assert_eq!(command.message.data, "controller");
            heard += 1;
        }
        heard >= 20
    });
    // The operator calls services, the viewer does not.
    let [called, not_called] =
        [&operator, &viewer].map(|node| node.client::<AddTwoInts>("sum").expect("a client"));
    let request = AddTwoIntsRequest { a: 1, b: 2 };
    assert_eq!(called.call(&request, PATIENCE).expect("it replies").sum, 3);
    let refused = not_called.call(&request, Duration::from_secs(1));
    assert!(refused.is_err(), "{refused:?}");
    // Said by the router, or by the process that the router tells of no subscription.
    for (role, sender) in senders.iter().filter(|(role, _)| *role != "controller") {
        let refused = format!("refused: {role}");
        let by_router = [refused.as_str(), "publish 0/arm/joint_commands/"];
        let node = format!("node /{role}: nobody receives");
        let by_node = [node.as_str(), "/arm/joint_commands"];
        eventually("it is logged", || {
            sender.publish(&from(role));
            log::said(&by_router) || log::said(&by_node)
        });
    }
    assert!(
        !log::said(&["refused: robot"]) && !log::said(&["refused: controller", "joint_commands"])
    );
}

// Fails if the cache of a latched topic does not reach a viewer through access control.
#[test]
fn a_viewer_gets_what_is_latched() {
    let guarded = Guarded::new(DAY);
    let (mut one, mut two) = (guarded.process(Role::Robot), guarded.process(Role::Viewer));
    let robot = one.start("robot", idle).expect("it starts");
    let description = robot.advertise::<std_msgs::String>("robot_description", Qos::LATCHED);
    let description = description.expect("it publishes");
    description.publish(&from("robot"));
    let viewer = two.start("viewer", idle).expect("it starts");
    let late = viewer.subscribe::<std_msgs::String>("robot_description", Qos::LATCHED);
    let late = late.expect("it subscribes").wait_next(PATIENCE);
    assert_eq!(late.expect("it arrives").message.data, "robot");
}

// Fails if the router accepted anybody who can reach it.
#[test]
fn a_stranger_is_refused() {
    let guarded = Guarded::new(DAY);
    // Keys of the same names, of another authority.
    let folder = tempfile::tempdir().expect("a folder");
    create(folder.path(), guarded.port, DAY);
    let refused = process(folder.path(), Role::Robot).start("robot", idle);
    let text = refused.err().expect("it is refused").to_string();
    assert!(text.contains("no Zenoh session"), "{text}");
    log::has(&["a connection is refused", "fatal alert"]);
    // The same keys, but it trusts the router.
    let authority = std::fs::read(guarded.folder.path().join("authority.pem"));
    let authority = BASE64_STANDARD.encode(authority.expect("it is there"));
    let key = "transport/link/tls/root_ca_certificate_base64";
    let trusting = config(folder.path(), Role::Robot).with(key, &format!("\"{authority}\""));
    let mut trusting = with_config(trusting.expect("the configuration is valid"));
    assert!(trusting.start("robot", idle).is_err());
    log::has(&["a connection is refused", "invalid peer certificate"]);
    // Without any.
    let config = ZenohConfig::default()
        .with("mode", "\"client\"")
        .and_then(|c| c.with("connect/timeout_ms", "1000"))
        .and_then(|c| {
            let endpoint = format!(r#"["tcp/127.0.0.1:{}"]"#, guarded.port);
            c.with("connect/endpoints", &endpoint)
        })
        .expect("the configuration is valid");
    let domain = Domain {
        id: 0,
        range: DiscoveryRange::Localhost,
    };
    let mut plain =
        Process::new(RosArgs::default(), domain).with_middleware(Middleware::zenoh(config));
    assert!(plain.start("robot", idle).is_err());
    log::has(&["a connection is refused", "corrupt message"]);
}

// Fails if certificates were accepted after their end.
#[test]
fn expired_certificates_are_refused() {
    let guarded = Guarded::new(Duration::ZERO);
    let refused = guarded.process(Role::Robot).start("robot", idle);
    assert!(refused.is_err());
    log::has(&["a connection is refused", "CertificateExpired"]);
}

// Fails if what somebody has recorded on the network could be sent again: over a connection of its own, or in the one
// that it belongs to.
#[test]
fn replayed_messages_do_nothing() {
    let guarded = Guarded::new(DAY);
    let mut eavesdropper = Eavesdropper::start(guarded.port);
    let mut one = guarded.process(Role::Robot);
    let robot = one.start("robot", idle).expect("it starts");
    let commands = subscription(&robot, "replayed/joint_commands");
    let endpoint = format!(r#"["tls/localhost:{}"]"#, eavesdropper.port());
    let listened_to = config(guarded.folder.path(), Role::Controller)
        .with("connect/endpoints", &endpoint)
        .expect("the configuration is valid");
    let mut two = with_config(listened_to);
    let controller = two.start("controller", idle).expect("it starts");
    let sender = publisher(&controller, "replayed/joint_commands");
    eventually("commands arrive", || {
        sender.publish(&from("first"));
        commands.take().is_some()
    });
    while commands.wait_next(Duration::from_millis(500)).is_some() {}
    let before = eavesdropper.heard();
    sender.publish(&from("thrust"));
    let command = commands.wait_next(PATIENCE).expect("it arrives");
    assert_eq!(command.message.data, "thrust");
    let all = eavesdropper.heard();
    let record = &all[before.len()..];
    assert!(!record.is_empty(), "the command went past the eavesdropper");

    // All of it, as another connection.
    eavesdropper.send_again(&all);
    log::has(&["a connection is refused", "cannot decrypt"]);
    // The command, in the connection of the controller.
    eavesdropper.insert(record);
    let again = commands.wait_next(Duration::from_secs(2));
    assert!(again.is_none(), "{again:?}");
    log::has(&["a connection has ended"]);
    // The controller connects again.
    eventually("commands arrive again", || {
        sender.publish(&from("later"));
        let command = commands.take();
        assert!(
            command.as_ref().is_none_or(|c| c.message.data == "later"),
            "{command:?}"
        );
        command.is_some()
    });
}
