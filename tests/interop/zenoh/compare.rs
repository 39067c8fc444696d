//! Both transports, measured in one run: the table of docs/zenoh.md.

use fuyu::{
    msg::{
        geometry_msgs::{Twist, TwistStamped, Vector3},
        sensor_msgs::Image,
        std_msgs::{Header, String as Text},
    },
    ros::{Node, NodeError, Publisher, Qos, Time},
};
use std::{
    process::Command,
    thread,
    time::{Duration, Instant},
};

use super::{
    interruptions::interrupt_once,
    network::{Network, Transport},
    robot::Robot,
    watch::Watch,
};
use crate::{
    binaries::binary,
    child::{Running, executable},
    namespace::Namespace,
    speed::{after, used},
    two_computers::START,
    wire::Wire,
};

const DOMAIN: u16 = 216;
/// Images of 640 by 480 pixels, 900 kB, at 30 Hz.
const IMAGES: usize = 300;
const IMAGE_PERIOD: Duration = Duration::from_millis(33);
/// Commands of an operator.
const COMMANDS: usize = 600;
const COMMAND_PERIOD: Duration = Duration::from_millis(50);
const POLL: Duration = Duration::from_millis(100);
/// `command_timeout` of the teleop node \[s\].
const COMMAND_TIMEOUT: f64 = 0.5;

/// Calls `publish` so often, in this rhythm, once somebody is [`ready`].
fn publish_in_rhythm(
    node: &Node,
    (count, period): (usize, Duration),
    publish: impl Fn(),
) -> Result<(), NodeError> {
    let ready = node.subscribe::<Text>("ready", Qos::LATCHED)?;
    while ready.take().is_none() {
        if !node.wait() {
            return Ok(());
        }
    }
    let mut due = Instant::now();
    for _ in 0..count {
        if !node.ok() {
            break;
        }
        publish();
        due += period;
        thread::sleep(due.saturating_duration_since(Instant::now()));
    }
    while node.wait() {}
    Ok(())
}

/// Says that this node has subscribed, once others have had time to discover it.
fn ready(node: &Node) -> Result<Publisher<Text>, NodeError> {
    node.wait_for(Duration::from_secs(3));
    let ready = node.advertise::<Text>("ready", Qos::LATCHED)?;
    ready.publish(&Text::default());
    Ok(ready)
}

/// Publishes images.
pub fn send_images(node: &Node) -> Result<(), NodeError> {
    let images = node.advertise::<Image>("images", Qos::SENSOR_DATA.depth(5))?;
    let rhythm = (IMAGES, IMAGE_PERIOD);
    publish_in_rhythm(node, rhythm, || {
        images.publish(&Image {
            header: now(),
            height: 480,
            width: 640,
            encoding: "rgb8".to_owned(),
            step: 1920,
            data: vec![7; 921_600],
            ..Image::default()
        });
    })
}

/// Receives images and logs their latency.
pub fn receive_images(node: &Node) -> Result<(), NodeError> {
    let images = node.subscribe::<Image>("images", Qos::SENSOR_DATA.depth(5))?;
    let _ready = ready(node)?;
    let mut delays = Delays::default();
    while node.wait_for(POLL) {
        while let Some(image) = images.take() {
            delays.add(image.message.header.stamp.into(), image.received_time);
        }
        delays.say_if_over();
    }
    Ok(())
}

/// Steers a tip along the base's y.
pub fn steer(node: &Node) -> Result<(), NodeError> {
    let commands = node.advertise::<TwistStamped>("cmd_vel", Qos::RELIABLE)?;
    let rhythm = (COMMANDS, COMMAND_PERIOD);
    publish_in_rhythm(node, rhythm, || {
        commands.publish(&TwistStamped {
            header: Header {
                frame_id: "base_link".to_owned(),
                ..now()
            },
            twist: Twist {
                linear: Vector3 {
                    y: 0.02,
                    ..Vector3::default()
                },
                ..Twist::default()
            },
        });
    })
}

/// Receives commands of an operator and logs their latency.
pub fn steered(node: &Node) -> Result<(), NodeError> {
    let commands = node.subscribe::<TwistStamped>("cmd_vel", Qos::RELIABLE.depth(100))?;
    let _ready = ready(node)?;
    let mut delays = Delays::default();
    while node.wait_for(POLL) {
        while let Some(command) = commands.take() {
            delays.add(command.message.header.stamp.into(), command.received_time);
        }
        delays.say_if_over();
    }
    Ok(())
}

fn now() -> Header {
    Header {
        stamp: Time::wall().into(),
        ..Header::default()
    }
}

/// Latencies of messages.
#[derive(Default)]
struct Delays {
    /// All of them \[s\].
    all: Vec<f64>,
    last: Option<Time>,
    /// How often nothing arrived for [`COMMAND_TIMEOUT`].
    silences: usize,
    is_said: bool,
}

impl Delays {
    fn add(&mut self, sent: Time, received: Time) {
        self.all.push(received - sent);
        let silence = self.last.map(|last| received - last);
        self.silences += usize::from(silence.is_some_and(|s| s > COMMAND_TIMEOUT));
        self.last = Some(received);
    }

    /// Says them once nothing has arrived for five seconds.
    fn say_if_over(&mut self) {
        let is_over = self.last.is_some_and(|last| Time::wall() - last > 5.0);
        if !is_over || self.is_said {
            return;
        }
        self.is_said = true;
        self.all.sort_by(f64::total_cmp);
        let at = |part: f64| 1e3 * self.all[((self.all.len() - 1) as f64 * part) as usize];
        tracing::info!(
            "took {} silences {} p50 {:.2} p99 {:.2} worst {:.2} ms",
            self.all.len(),
            self.silences,
            at(0.5),
            at(0.99),
            at(1.0)
        );
    }
}

/// Two programs of this executable; what the second one says at the end.
fn pair(commands: [Command; 2], programs: [&str; 2], arguments: &[&str]) -> String {
    let [first, second] = commands;
    let start = |command, program: &str| {
        let name = format!("__node:={program}");
        let args = [&["--ros-args", "-r", &name], arguments].concat();
        Running::program(command, program, DOMAIN, &args)
    };
    let second = start(second, programs[1]);
    let first = start(first, programs[0]);
    second.says(" p99 ");
    first.interrupt();
    let said = second.interrupt();
    let line = said.lines().find(|line| line.contains(" p99 "));
    line.expect("it was said").to_owned()
}

fn network(transport: Transport, loss: f64, delay: f64) -> Option<Network> {
    let wire = Wire::new(["zcomp", "zcompfar"], loss, delay)?;
    Some(Network::new(wire, transport, DOMAIN, "10.98.0.1"))
}

#[test]
#[ignore = "takes ten minutes on an idle machine"]
fn transports_compared() {
    for transport in Transport::BOTH {
        println!("{transport:?}");
        let Some(namespace) = Namespace::new("zone") else {
            return;
        };
        namespace.add_wire("10.97.0.1/24").expect("an interface");
        let router = transport.router(&namespace, DOMAIN, &[]);
        let on_one = || [0, 1].map(|_| transport.command(&namespace, executable()));
        let line = pair(on_one(), ["send", "take"], &["-p", "count:=20000"]);
        println!(
            "- joint states at 1 kHz: p50 {} us, p99 {} us, {} of 20000",
            after(&line, "p50"),
            after(&line, "p99"),
            after(&line, "took")
        );
        let line = pair(on_one(), ["send_images", "receive_images"], &[]);
        println!(
            "- images of 900 kB at 30 Hz: p50 {} ms, p99 {} ms, {} of {IMAGES}",
            after(&line, "p50"),
            after(&line, "p99"),
            after(&line, "took")
        );
        drop(router);
        let start = Instant::now();
        let Some(network) = network(transport, 0.0, 0.0) else {
            return;
        };
        let mut robot = Robot::start(network, &[], &[]);
        robot.all_receive(START);
        println!(
            "- two routers and six processes on two computers start within {:.1} s",
            start.elapsed().as_secs_f64()
        );
        let ids: Vec<_> = robot.nodes.iter().map(Running::id).collect();
        let routers: Vec<_> = robot.network.routers.iter().map(Running::id).collect();
        let total = |ids: &[u32]| ids.iter().map(|id| used(*id)).sum::<f64>();
        let (begin, before) = (Instant::now(), [total(&ids), total(&routers)]);
        thread::sleep(Duration::from_secs(30));
        let part = |now: f64, before: f64| (now - before) / begin.elapsed().as_secs_f64();
        println!(
            "- processor time of dynamics, camera, controller and recorder: {:.3}, routers: {:.3}",
            part(total(&ids), before[0]),
            part(total(&routers), before[1])
        );
        let back = interrupt_once(&mut robot, Duration::from_secs(60));
        println!("- after 60 s without a network: everything within {back:.1} s");
        drop(robot);
        teleoperate(transport);
    }
}

/// An operator at the far end of a slow network that loses messages.
fn teleoperate(transport: Transport) {
    let Some(network) = network(transport, 0.01, 0.1) else {
        return;
    };
    let config = concat!(env!("CARGO_MANIFEST_DIR"), "/config/teleoperation.yaml");
    let node = |name: &str| {
        let mut command = network.command(0, binary(name));
        command.args(["--ros-args", "--params-file", config]);
        Running::start(command, network.domain)
    };
    let watch = Watch::start(&network, 0);
    let _nodes = [node("teleop"), node("dynamics")];
    let commands = [1, 0].map(|end| network.command(end, executable()));
    let line = pair(commands, ["steer", "steered"], &[]);
    println!(
        "- teleoperation, 100 ms in each direction, 1 % loss: commands p50 {} ms, p99 {} ms, worst {} ms, {} of \
         {COMMANDS}, {} silences; the arm has moved by {:.3} rad",
        after(&line, "p50"),
        after(&line, "p99"),
        after(&line, "worst"),
        after(&line, "took"),
        after(&line, "silences"),
        watch.heard().moved
    );
}
