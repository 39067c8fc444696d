//! A node that uses every feature of the ROS layer, run as a separate process.

use crate::peer::DomainClaim;
use fuyu::{
    msg::{
        std_msgs::String as Text,
        std_srvs::{Trigger, TriggerResponse},
    },
    ros::{DiscoveryRange, Node, NodeError, Process, Qos},
};
use nix::sys::signal::{SigSet, SigmaskHow, Signal};
use std::{
    fs,
    io::{BufRead, BufReader, Read},
    process::{Child, ChildStderr, Command, Stdio},
    time::Duration,
};

/// What the probe's process ignores from the start; all others are up to `Process`.
const INHERITED: [Signal; 4] = [
    Signal::SIGINT,
    Signal::SIGTERM,
    Signal::SIGHUP,
    Signal::SIGCONT,
];

/// Arguments of the node, one a line.
const ARGS: &str = "FUYU_PROBE_ARGS";

/// The process that the other tests start; by itself it is no test.
#[test]
#[ignore = "started by the other tests"]
fn node_process() {
    // Not started by a test, as with `--include-ignored`: it would run for ever.
    let Ok(args) = std::env::var(ARGS) else {
        return;
    };
    let args = args.lines().map(str::to_owned);
    let outcome = Process::from_env(args, DiscoveryRange::Subnet).and_then(|(mut process, _)| {
        process.start("probe", program)?;
        process.wait()
    });
    if let Err(e) = outcome {
        eprintln!("error: {e}");
        std::process::exit(e.exit_code().into());
    }
}

fn text(data: impl Into<String>) -> Text {
    Text { data: data.into() }
}

fn program(node: &Node) -> Result<(), NodeError> {
    let mut declare = node.declare();
    let rate = declare
        .param("rate", 20.0, "Messages per second [Hz]")
        .range(1.0, 200.0)
        .live();
    let label = declare
        .param("label", "hello", "Text of the messages")
        .check("not empty", |v: &String| match v.is_empty() {
            true => Err("an empty label would not be seen".to_owned()),
            false => Ok(()),
        })
        .live();
    let frame = declare
        .param("frame", "base_link", "Frame")
        .read_only()
        .value();
    let _ = declare.param("gains.p", [1.0, 2.0], "Gains [1/s]").live();
    let _ = declare.param("count", 3, "A number").range(0, 10).live();
    let stubborn = declare
        .param("stubborn", false, "Does not stop when asked to")
        .value();
    declare.finish()?;

    let chatter = node.advertise::<Text>("chatter", Qos::RELIABLE)?;
    let fast = node.advertise::<Text>("fast", Qos::SENSOR_DATA)?;
    let latched = node.advertise::<Text>("robot_description", Qos::LATCHED)?;
    let heard = node.advertise::<Text>("heard", Qos::RELIABLE)?;
    let said = node.subscribe::<Text>("say", Qos::RELIABLE)?;
    let retained = node.subscribe::<Text>("retained", Qos::LATCHED)?;
    let raw = node.advertise::<Text>("raw_heard", Qos::RELIABLE)?;
    let _raw = node.subscribe_raw("raw", "std_msgs/msg/String", Qos::RELIABLE, move |sample| {
        raw.publish(&text(format!("{:02x?}", &sample.cdr[..])));
    })?;
    let _ping = node.serve::<Trigger>("~/ping", |_| TriggerResponse {
        success: true,
        message: "pong".into(),
    })?;
    latched.publish(&text("<robot/>"));
    let status = node.diagnostics().status("probe");
    status.warn("only a test");
    status.set("frame", &frame);
    tracing::info!("the probe runs");

    let mut timer = node.timer(Duration::from_secs_f64(1.0 / rate.get()));
    let mut count = 0;
    while node.wait_until(timer.next()) {
        if rate.changed() {
            timer.set_period(Duration::from_secs_f64(1.0 / rate.get()));
        }
        while let Some(said) = said.take().or_else(|| retained.take()) {
            // What ends here sends SIGCHLD to this process.
            if said.message.data == "have a child" {
                let ended = Command::new("true").status();
                heard.publish(&text(format!("{ended:?}")));
            } else {
                heard.publish(&said.message);
            }
        }
        if timer.due() {
            count += 1;
            chatter.publish(&text(format!("{} {count} at {}", label.get(), node.now())));
            fast.publish(&text(count.to_string()));
        }
    }
    for i in 0..20 {
        chatter.publish(&text(format!("last {i} at the end")));
    }
    if stubborn {
        std::thread::sleep(Duration::from_secs(60));
    }
    tracing::info!("the probe ends in order");
    Ok(())
}

/// A probe as a process, killed when dropped.
pub struct Probe {
    child: Child,
    stderr: BufReader<ChildStderr>,
    /// Lines read from it.
    said: String,
    _domain: DomainClaim,
}

impl Probe {
    /// On loopback in a DDS domain, with ROS arguments.
    pub fn start(domain: u16, args: &[&str]) -> Self {
        Self::start_with(Command::new(Self::executable()), domain, args)
    }

    pub fn executable() -> std::path::PathBuf {
        std::env::current_exe().expect("a test knows its executable")
    }

    /// With a command that ends in this executable.
    pub fn start_with(mut command: Command, domain: u16, args: &[&str]) -> Self {
        let claim = DomainClaim::new(domain);
        command
            .args(["probe::node_process", "--exact", "--ignored", "--nocapture"])
            .env(ARGS, args.join("\n"))
            .env("ROS_DOMAIN_ID", domain.to_string())
            .env_remove("ROS_LOCALHOST_ONLY")
            .stdout(Stdio::null())
            .stderr(Stdio::piped());
        if std::env::var_os("ROS_AUTOMATIC_DISCOVERY_RANGE").is_none()
            && !command
                .get_envs()
                .any(|(name, _)| name == "ROS_AUTOMATIC_DISCOVERY_RANGE")
        {
            command.env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST");
        }
        // The test harness keeps the main thread of the probe, so what a node's main function does
        // first is done here: that thread must not take these signals either.
        let mut taken = SigSet::empty();
        for signal in INHERITED {
            taken.add(signal);
        }
        let before = taken
            .thread_swap_mask(SigmaskHow::SIG_BLOCK)
            .expect("masks can change");
        let mut child = command.spawn().expect("the probe starts");
        before.thread_set_mask().expect("masks can change");
        let stderr = child.stderr.take().expect("stderr is piped");
        Self {
            child,
            stderr: BufReader::new(stderr),
            said: String::new(),
            _domain: claim,
        }
    }

    pub fn id(&self) -> u32 {
        self.child.id()
    }

    /// Waits until its program has made its endpoints.
    pub fn runs(&mut self) {
        self.says("the probe runs");
    }

    /// Waits until it has written this to stderr.
    pub fn says(&mut self, text: &str) {
        while !self.said.contains(text) {
            let read = self.stderr.read_line(&mut self.said);
            assert!(read.expect("stderr is text") > 0, "it ended: {}", self.said);
        }
    }

    pub fn signal(&self, name: &str) {
        let pid = self.child.id().to_string();
        let kill = Command::new("kill")
            .args([&format!("-{name}"), &pid])
            .status();
        assert!(kill.expect("kill is there").success());
    }

    /// Signal masks of all threads but the harness's, by thread name.
    pub fn blocked_signals(&self) -> Vec<(String, u64)> {
        let main = self.child.id().to_string();
        let tasks = fs::read_dir(format!("/proc/{main}/task")).expect("it runs");
        tasks
            .map(|task| task.expect("a task").path())
            .filter(|task| !task.ends_with(&main))
            .map(|task| {
                let status = fs::read_to_string(task.join("status")).expect("a status");
                let field = |name: &str| {
                    let line = status.lines().find_map(|l| l.strip_prefix(name));
                    line.expect("the field").trim().to_owned()
                };
                let mask = u64::from_str_radix(&field("SigBlk:"), 16).expect("a mask");
                (field("Name:"), mask)
            })
            .collect()
    }

    /// Ends the probe with SIGINT; returns its stderr and its exit code.
    pub fn interrupt(mut self) -> (String, Option<i32>) {
        self.signal("INT");
        self.finish()
    }

    /// Waits until the probe ends; returns its stderr and its exit code.
    pub fn finish(&mut self) -> (String, Option<i32>) {
        let rest = self.stderr.read_to_string(&mut self.said);
        rest.expect("stderr is text");
        let code = self.child.wait().expect("it ends").code();
        (std::mem::take(&mut self.said), code)
    }
}

impl Drop for Probe {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
