//! Nodes as separate processes: this test executable, started again with a program's name.

use fuyu::ros::{DiscoveryRange, Node, NodeError, Process, return_free_memory};
use nix::sys::signal::{SigSet, SigmaskHow, Signal};
use std::{
    io::{BufRead, BufReader},
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
    sync::{Arc, Mutex, PoisonError},
    thread,
    time::{Duration, Instant},
};

use crate::{
    binaries::binary,
    namespace::Namespace,
    peer::DomainClaim,
    waiting::{PATIENCE, eventually},
};

/// Name of the program that a child runs.
const PROGRAM: &str = "FUYU_INTEROP_PROGRAM";

/// The process that tests start; does nothing without `PROGRAM` in its environment.
#[test]
#[ignore = "started by the other tests"]
fn process() {
    let Ok(program) = std::env::var(PROGRAM) else {
        return;
    };
    let program: fn(&Node) -> Result<(), NodeError> = match program.as_str() {
        "echo" => crate::echo::program,
        "hostile" => crate::hostile::program,
        "leap" => crate::time_jumps::program,
        "push" => crate::load::push,
        "send" => crate::speed::send,
        "take" => crate::speed::take,
        #[cfg(feature = "zenoh")]
        "listen" => crate::zenoh::listen,
        #[cfg(feature = "zenoh")]
        "receive_images" => crate::zenoh::receive_images,
        #[cfg(feature = "zenoh")]
        "send_images" => crate::zenoh::send_images,
        #[cfg(feature = "zenoh")]
        "steer" => crate::zenoh::steer,
        #[cfg(feature = "zenoh")]
        "steered" => crate::zenoh::steered,
        #[cfg(feature = "zenoh")]
        "watch" => crate::zenoh::watch::program,
        other => panic!("no program {other}"),
    };
    let arguments = std::env::var("FUYU_INTEROP_ARGS").unwrap_or_default();
    let arguments = arguments.lines().map(str::to_owned);
    // As the executables do.
    return_free_memory();
    let outcome =
        Process::from_env(arguments, DiscoveryRange::Subnet).and_then(|(mut process, _)| {
            process.start("node", program)?;
            process.wait()
        });
    if let Err(e) = outcome {
        eprintln!("error: {e}");
        std::process::exit(e.exit_code().into());
    }
}

/// This executable.
pub fn executable() -> PathBuf {
    std::env::current_exe().expect("a test knows its executable")
}

/// A process whose stderr is kept; killed when dropped.
pub struct Running {
    child: Child,
    said: Arc<Mutex<String>>,
    _domain: DomainClaim,
}

impl Running {
    /// A program of this executable, by a command that ends in [`executable`].
    pub fn program(mut command: Command, program: &str, domain: u16, args: &[&str]) -> Self {
        command
            .args(["child::process", "--exact", "--ignored", "--nocapture"])
            .env(PROGRAM, program)
            .env("FUYU_INTEROP_ARGS", args.join("\n"))
            .stdout(Stdio::null());
        Self::start(command, domain)
    }

    /// A node of fuyu by one of its scenarios.
    pub fn node(name: &str, config: &str, domain: u16, more: &[&str]) -> Self {
        let config = format!("{}/{config}", env!("CARGO_MANIFEST_DIR"));
        let mut command = Command::new(binary(name));
        command
            .args(["--ros-args", "--params-file", &config])
            .args(more);
        Self::start(command, domain)
    }

    /// A recorder of these topics into a new folder `bag`.
    pub fn recorder(
        namespace: &Namespace,
        domain: u16,
        topics: &str,
        bag: &Path,
        more: &[&str],
    ) -> Self {
        let mut command: Command = namespace.command(binary("recorder"));
        command
            .args(["--ros-args", "-p", &format!("topics:=[{topics}]")])
            .args(["-p", &format!("bag:={}", bag.display())])
            .args(more)
            .current_dir(bag.parent().expect("a folder"));
        Self::start(command, domain)
    }

    /// Any command, in a DDS domain, on loopback unless it says otherwise.
    pub fn start(mut command: Command, domain: u16) -> Self {
        let claim = DomainClaim::new(domain);
        let range = "ROS_AUTOMATIC_DISCOVERY_RANGE";
        if !command.get_envs().any(|(name, _)| name == range) {
            command.env(range, "LOCALHOST");
        }
        command
            .env("ROS_DOMAIN_ID", domain.to_string())
            .env_remove("ROS_LOCALHOST_ONLY")
            .env_remove("AMENT_PREFIX_PATH")
            .stdin(Stdio::null())
            .stderr(Stdio::piped());
        // The harness keeps the main thread of a child that is this executable; it must not take these.
        let mut taken = SigSet::empty();
        for signal in [
            Signal::SIGINT,
            Signal::SIGTERM,
            Signal::SIGHUP,
            Signal::SIGCONT,
        ] {
            taken.add(signal);
        }
        let before = taken.thread_swap_mask(SigmaskHow::SIG_BLOCK);
        let before = before.expect("masks can change");
        let mut child = command.spawn().expect("it can be started");
        before.thread_set_mask().expect("masks can change");
        let stderr = BufReader::new(child.stderr.take().expect("stderr is piped"));
        let said = Arc::new(Mutex::new(String::new()));
        // Ends with the pipe, thus with the child.
        thread::spawn({
            let said = Arc::clone(&said);
            move || {
                for line in stderr.lines().map_while(Result::ok) {
                    let mut said = said.lock().unwrap_or_else(PoisonError::into_inner);
                    said.push_str(&line);
                    said.push('\n');
                }
            }
        });
        Self {
            child,
            said,
            _domain: claim,
        }
    }

    pub fn id(&self) -> u32 {
        self.child.id()
    }

    /// Its stderr so far.
    pub fn said(&self) -> String {
        let said = self.said.lock().unwrap_or_else(PoisonError::into_inner);
        said.clone()
    }

    /// Waits until a word is on its stderr.
    pub fn says(&self, word: &str) {
        eventually(word, 3 * PATIENCE, || {
            self.said().contains(word).then_some(())
        });
    }

    pub fn runs(&mut self) -> bool {
        self.child
            .try_wait()
            .expect("it can be waited for")
            .is_none()
    }

    /// Sends a signal by its name without SIG.
    pub fn signal(&self, name: &str) {
        let id = self.id().to_string();
        let kill = Command::new("kill")
            .args([&format!("-{name}"), &id])
            .status();
        assert!(kill.expect("kill is there").success());
    }

    /// Waits for its end; its exit code, if no signal ended it.
    pub fn wait(&mut self, patience: Duration) -> Option<i32> {
        let deadline = Instant::now() + patience;
        loop {
            if let Some(status) = self.child.try_wait().expect("it can be waited for") {
                return status.code();
            }
            assert!(Instant::now() < deadline, "no end: {}", self.said());
            thread::sleep(Duration::from_millis(50));
        }
    }

    /// Ends it with Ctrl-C; panics unless the exit code is 0.
    pub fn interrupt(mut self) -> String {
        self.signal("INT");
        assert_eq!(self.wait(PATIENCE), Some(0), "{}", self.said());
        self.said()
    }

    /// Memory that it has in use \[kB\].
    pub fn resident(&self) -> u64 {
        let path = format!("/proc/{}/status", self.id());
        let status = std::fs::read_to_string(path).expect("it runs");
        let line = status.lines().find_map(|l| l.strip_prefix("VmRSS:"));
        let number = line.and_then(|l| l.split_whitespace().next());
        number.and_then(|n| n.parse().ok()).expect("a number")
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
        if thread::panicking() {
            eprintln!("{}", self.said());
        }
    }
}
