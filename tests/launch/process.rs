//! fuyu's executables as processes, and what their bags hold.

use fuyu::bag::Bag;
use fuyu::msg::Interface;
use serde_json::Value;
use std::{
    fs::{self, File},
    os::unix::process::CommandExt,
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
    thread,
    time::{Duration, Instant},
};
use tempfile::TempDir;

use crate::binaries::binary;
use crate::waiting::PATIENCE;

/// Gains for tests that need a stable loop on a machine that is late: stable up to a delay of 150 ms. With the gains of
/// the thesis it is 20 ms, since the fastest rate of joint damping over reduced inertia is 80 1/s, at joint 6. The tip
/// arrives, its attitude does not. They end the arguments of a launch.
pub const GENTLE: [&str; 5] = [
    "--ros-args",
    "-p",
    "controller:k_o:=2.0",
    "-p",
    "controller:k_v:=[400.0, 100.0, 200.0, 10.0, 2.0, 0.2]",
];

/// A file of the sources.
pub fn source(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

/// One of fuyu's executables, on loopback in a DDS domain.
pub fn command(executable: &str, domain: u16) -> Command {
    let mut command = Command::new(binary(executable));
    command
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .env("ROS_DOMAIN_ID", domain.to_string())
        .env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        .env_remove("ROS_LOCALHOST_ONLY")
        .env_remove("AMENT_PREFIX_PATH");
    command
}

/// Exit code and output of a process.
#[derive(Debug)]
pub struct Ended {
    pub code: Option<i32>,
    pub stdout: String,
    pub stderr: String,
}

impl Ended {
    /// Panics unless the exit code is 0.
    pub fn well(self) -> Self {
        assert_eq!(self.code, Some(0), "{}\n{}", self.stdout, self.stderr);
        self
    }

    pub fn json(&self) -> Value {
        serde_json::from_str(&self.stdout).unwrap_or_else(|e| panic!("{e}: {self:?}"))
    }
}

/// Runs a command of `fuyu` that needs no graph, to its end.
pub fn fuyu(args: &[&str]) -> Ended {
    let output = command("fuyu", 99).args(args).output().expect("it starts");
    Ended {
        code: output.status.code(),
        stdout: String::from_utf8(output.stdout).expect("stdout is text"),
        stderr: String::from_utf8(output.stderr).expect("stderr is text"),
    }
}

/// A running process; killed when dropped.
pub struct Running {
    child: Child,
    folder: TempDir,
}

impl Running {
    /// `fuyu launch CONFIG` with a bag of its own.
    pub fn launch(domain: u16, config: &Path, args: &[&str]) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let mut command = command("fuyu", domain);
        let bag = folder.path().join("bag");
        command
            .arg("launch")
            .arg(config)
            .arg("--bag")
            .arg(bag)
            .args(args);
        Self::start_in(command, folder)
    }

    /// `fuyu launch CONFIG` for as long as the test lasts, with [`GENTLE`] gains.
    pub fn gently(domain: u16, config: &Path) -> Self {
        Self::gently_with(domain, config, &[])
    }

    /// The same with options of `fuyu launch`.
    pub fn gently_with(domain: u16, config: &Path, options: &[&str]) -> Self {
        let args = [&["--duration", "600"], options, &GENTLE[..]].concat();
        Self::launch(domain, config, &args)
    }

    pub fn start(command: Command) -> Self {
        Self::start_in(command, tempfile::tempdir().expect("a folder"))
    }

    fn start_in(mut command: Command, folder: TempDir) -> Self {
        let file = |name: &str| File::create(folder.path().join(name)).expect("a file");
        command
            .stdin(Stdio::null())
            .stdout(file("stdout"))
            .stderr(file("stderr"))
            // A process group, as a shell with job control makes one, which Ctrl-Z can stop.
            .process_group(0);
        let child = command.spawn().expect("the executable is there");
        Self { child, folder }
    }

    pub fn bag(&self) -> PathBuf {
        self.folder.path().join("bag")
    }

    pub fn id(&self) -> u32 {
        self.child.id()
    }

    pub fn said(&self) -> (String, String) {
        let read = |name: &str| fs::read_to_string(self.folder.path().join(name)).expect("text");
        (read("stdout"), read("stderr"))
    }

    /// Sends a signal by its name without SIG.
    pub fn signal(&self, name: &str) {
        let id = self.child.id().to_string();
        let kill = Command::new("kill")
            .args([&format!("-{name}"), &id])
            .status();
        assert!(kill.expect("kill is there").success());
    }

    /// Waits for its end; panics after `patience`.
    pub fn wait(&mut self, patience: Duration) -> Ended {
        let deadline = Instant::now() + patience;
        loop {
            let status = self.child.try_wait().expect("it can be waited for");
            let (stdout, stderr) = self.said();
            if let Some(status) = status {
                return Ended {
                    code: status.code(),
                    stdout,
                    stderr,
                };
            }
            assert!(
                Instant::now() < deadline,
                "no end after {patience:?}\n{stderr}"
            );
            thread::sleep(Duration::from_millis(50));
        }
    }

    /// Ends a program that must still run, whose own end is not tested: rclpy sometimes waits forever when it is interrupted.
    pub fn kill_running(mut self) {
        if let Some(status) = self.child.try_wait().expect("it can be waited for") {
            let (stdout, stderr) = self.said();
            panic!("ended by itself with {status}\n{stdout}\n{stderr}");
        }
        self.signal("KILL");
        self.wait(PATIENCE);
    }

    /// Ends it with Ctrl-C.
    pub fn interrupt(&mut self) -> Ended {
        self.signal("INT");
        self.wait(PATIENCE)
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
        if thread::panicking() {
            eprintln!("{}", self.said().1);
        }
    }
}

/// The report of `fuyu bag check`, and whether all checks passed.
pub struct Check {
    pub passed: bool,
    report: Value,
}

impl Check {
    pub fn of(bag: &Path) -> Self {
        let ended = fuyu(&[
            "bag",
            "check",
            "--json",
            bag.to_str().expect("a plain path"),
        ]);
        let report = ended.json();
        assert_eq!(
            ended.code,
            Some(i32::from(report["passed"] == false)),
            "{report}"
        );
        Self {
            passed: ended.code == Some(0),
            report,
        }
    }

    /// The value of a check, which must not have been skipped.
    pub fn value(&self, name: &str) -> f64 {
        let checks = self.report["checks"].as_array().expect("checks");
        let check = checks.iter().find(|c| c["name"] == name);
        check
            .and_then(|c| c["value"].as_f64())
            .unwrap_or_else(|| panic!("no {name} in {}", self.report))
    }

    /// Panics unless momentum is conserved to rounding.
    pub fn momentum_holds(&self) {
        for name in ["linear momentum", "angular momentum"] {
            let change = self.value(name);
            println!("{name} changes by {change:.1e}");
            assert!(change <= 1e-14, "{name} {change:e}");
        }
    }

    /// Names of the checks that failed.
    pub fn failed(&self) -> Vec<String> {
        let checks = self.report["checks"].as_array().expect("checks");
        let failed = checks.iter().filter(|c| c["verdict"] == "failed");
        failed.map(|c| c.to_string()).collect()
    }
}

/// All messages of a topic.
pub fn read<M: Interface>(bag: &Path, topic: &str) -> Vec<M> {
    let bag = Bag::open(bag).expect("a bag");
    let messages = bag.read::<M>(topic).expect("messages that decode");
    messages.into_iter().map(|m| m.message).collect()
}

/// A copy of a scenario with some text replaced; the file lives as long as the folder.
pub fn scenario(of: &str, changes: &[(&str, &str)]) -> (TempDir, PathBuf) {
    let mut text = fs::read_to_string(source(of)).expect("a scenario");
    for (from, to) in changes {
        assert!(text.contains(from), "{of} has no {from:?}");
        text = text.replace(from, to);
    }
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("scenario.yaml");
    fs::write(&path, text).expect("a file");
    (folder, path)
}
