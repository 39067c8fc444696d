//! The other programs: processes with the line protocol described in `peer.hpp`.

use std::cell::RefCell;
use std::fmt::Write as _;
use std::io::{BufRead, BufReader, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use fuyu::model::JointKind;

use super::robots::{Moving, Robot};

/// A program to compare with.
pub struct Peer(RefCell<Process>);

struct Process {
    /// Such as `pinocchio-clang`.
    name: String,
    child: Child,
    stdin: ChildStdin,
    stdout: BufReader<ChildStdout>,
}

impl Process {
    fn tell(&mut self, text: &str) {
        let written = self.stdin.write_all(text.as_bytes());
        let written = written.and_then(|()| self.stdin.flush());
        written.unwrap_or_else(|e| panic!("{} does not read: {e}", self.name));
    }

    fn answer(&mut self) -> Vec<f64> {
        let mut line = String::new();
        let read = self.stdout.read_line(&mut line);
        assert!(matches!(read, Ok(1..)), "{} ended", self.name);
        let numbers = line.split_whitespace().map(str::parse);
        let numbers = numbers.collect::<Result<_, _>>();
        numbers.unwrap_or_else(|e| panic!("{} prints no numbers: {e}", self.name))
    }
}

/// Where `scripts/bench-peers.sh` puts them.
fn folder() -> PathBuf {
    let target = std::env::var_os("CARGO_TARGET_DIR").map(PathBuf::from);
    let own = Path::new(env!("CARGO_MANIFEST_DIR")).join("target");
    target.unwrap_or(own).join("peers")
}

impl Peer {
    /// Those of these names that are installed.
    pub fn installed(names: &[&str]) -> Vec<Self> {
        let started = names.iter().filter_map(|name| {
            let child = Command::new(folder().join(name))
                .stdin(Stdio::piped())
                .stdout(Stdio::piped())
                .spawn();
            let mut child = child.ok()?;
            let (stdin, stdout) = (child.stdin.take()?, child.stdout.take()?);
            let process = Process {
                name: (*name).to_owned(),
                child,
                stdin,
                stdout: BufReader::new(stdout),
            };
            Some(Self(RefCell::new(process)))
        });
        started.collect()
    }

    /// Such as `pinocchio-clang`.
    pub fn name(&self) -> String {
        self.0.borrow().name.clone()
    }

    /// Sends a robot and its states.
    pub fn load(&self, robot: &Robot, states: &[Moving]) {
        let mut process = self.0.borrow_mut();
        process.tell(&describe(robot));
        process.answer();
        process.tell(&tell_states(states));
        process.answer();
    }

    /// The result; `None` if the program does not have the kernel.
    pub fn ask(&self, kernel: &str, state: usize) -> Vec<f64> {
        let mut process = self.0.borrow_mut();
        process.tell(&format!("ask {kernel} {state}\n"));
        process.answer()
    }

    /// Nanoseconds a call, measured by itself.
    pub fn time(&self, kernel: &str, calls: usize) -> f64 {
        let mut process = self.0.borrow_mut();
        process.tell(&format!("time {kernel} {calls}\n"));
        process.answer()[0]
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        // It may have ended already.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn put(text: &mut String, numbers: impl IntoIterator<Item = f64>) {
    for number in numbers {
        let _ = write!(text, " {number:?}");
    }
}

fn describe(robot: &Robot) -> String {
    let model = &robot.model;
    let mut text = format!("model {}\n", model.bodies().len());
    for (b, body) in model.bodies().iter().enumerate() {
        match b.checked_sub(1).map(|j| &model.joints()[j]) {
            None => text += "-1 free 1 0 0 0 1 0 0 0 1 0 0 0 0 0 0",
            Some(joint) => {
                let kind = match joint.kind {
                    JointKind::Revolute | JointKind::Continuous => "revolute",
                    JointKind::Prismatic => "prismatic",
                };
                let _ = write!(text, "{} {kind}", model.joint_parent(b - 1));
                let by_rows = joint.X_PJ.rotation.matrix().transpose();
                put(&mut text, by_rows.iter().copied());
                put(&mut text, joint.X_PJ.translation.vector.iter().copied());
                put(&mut text, joint.axis.iter().copied());
            }
        }
        let (inertia, about) = (&body.inertia, &body.inertia.about_com);
        put(&mut text, [inertia.mass]);
        put(&mut text, inertia.com.iter().copied());
        let upper = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];
        put(&mut text, upper.map(|at| about[at]));
        text.push('\n');
    }
    let tip = model.frame(&robot.tip).expect("the robot has its tip");
    let _ = write!(text, "{}", tip.body);
    put(&mut text, tip.X_BF.translation.vector.iter().copied());
    text + "\n"
}

fn tell_states(states: &[Moving]) -> String {
    let mut text = format!("states {}\n", states.len());
    for s in states {
        put(&mut text, s.state.R_WB.coords.iter().copied());
        put(&mut text, s.V_WB_B.angular.iter().copied());
        put(&mut text, s.V_WB_B.linear.iter().copied());
        for values in [&s.state.q, &s.state.qd, &s.input.efforts] {
            put(&mut text, values.iter().copied());
        }
        text.push('\n');
    }
    text
}
