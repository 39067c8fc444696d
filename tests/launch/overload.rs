//! Runs in real time under overload: a flood of refused commands, and processors that others use.

use fuyu::{
    msg::sensor_msgs::JointState,
    ros::{DiscoveryRange, Domain, Process, Publisher, Qos, RosArgs},
};
use std::{
    path::PathBuf,
    process::{Child, Command},
    sync::{
        Arc,
        atomic::{AtomicBool, AtomicU64, Ordering::Relaxed},
    },
    thread,
    time::{Duration, Instant},
};

use crate::{
    lateness::repeat_if_late,
    process::{Ended, Running, command, fuyu, source},
};

/// Simulated time of the runs \[s\].
const DURATION: &str = "12";
/// Processes that use a processor each.
const BUSY_LOOPS: usize = 8;
/// Largest difference of the tip's final position error from that of the simulation in one thread, with exit code 0: the
/// limit of `fuyu bag check` \[m\].
const LIMIT: f64 = 0.01;

fn config() -> PathBuf {
    source("config/positioning.yaml")
}

/// The final position error of the tip without a load \[m\].
fn reference() -> f64 {
    let path = config();
    let path = path.to_str().expect("a plain path");
    let summary = fuyu(&["simulate", path, "--duration", DURATION, "--json"]).well();
    summary.json()["tip_position_error"]
        .as_f64()
        .expect("a number")
}

/// The final position error of the tip \[m\] in the summary of a launch.
fn final_error(ended: &Ended) -> f64 {
    let mut lines = ended.stdout.lines();
    let line = lines.find_map(|line| line.strip_prefix("tip position error"));
    let number = line.and_then(|line| line.trim().strip_suffix(" m")?.parse().ok());
    number.unwrap_or_else(|| panic!("no tip position error in {ended:?}"))
}

/// Publishes commands that are refused at 5000 Hz until `end` is set; returns how many.
fn flood(domain: u16, end: Arc<AtomicBool>) -> u64 {
    let domain = Domain {
        id: domain,
        range: DiscoveryRange::Localhost,
    };
    let mut process = Process::new(RosArgs::default(), domain);
    let sent = Arc::new(AtomicU64::new(0));
    let (count, is_over) = (Arc::clone(&sent), Arc::clone(&end));
    let program = move |node: &fuyu::ros::Node| {
        let commands: Publisher<JointState> = node.advertise("joint_commands", Qos::RELIABLE)?;
        let command = JointState {
            name: vec!["joint1".into()],
            effort: vec![7.0],
            ..Default::default()
        };
        let begin = Instant::now();
        while !is_over.load(Relaxed) && node.ok() {
            // Five every millisecond, however late this thread is.
            let due = 5 * begin.elapsed().as_millis() as u64;
            for _ in count.load(Relaxed)..due.min(count.load(Relaxed) + 100) {
                commands.publish(&command);
                count.fetch_add(1, Relaxed);
            }
            thread::sleep(Duration::from_millis(1));
        }
        Ok(())
    };
    process.start("flood", program).expect("the node starts");
    while !end.load(Relaxed) {
        thread::sleep(Duration::from_millis(50));
    }
    process.finish().expect("it ends in order");
    sent.load(Relaxed)
}

// Fails if commands of all publishers share a queue, so that a flood crowds out those of the controller, or if the arbiter
// accepts them.
#[test]
fn five_thousand_refused_commands_per_second_do_not_disturb_the_controller() {
    let reference = reference();
    repeat_if_late(|| {
        let domain = 58;
        let mut run = Running::launch(domain, &config(), &["--duration", DURATION]);
        // The controller commands first.
        thread::sleep(Duration::from_millis(1500));
        let end = Arc::new(AtomicBool::new(false));
        let flooding = {
            let end = Arc::clone(&end);
            thread::spawn(move || flood(domain, end))
        };
        let ended = run.wait(Duration::from_secs(90)).well();
        end.store(true, Relaxed);
        let sent = flooding.join().expect("the flood ends");
        let off = (final_error(&ended) - reference).abs();
        println!(
            "{sent} refused commands, off by {off:.1e} m\n{}",
            ended.stdout
        );
        // Of some ten seconds.
        assert!(sent > 20_000, "{sent}");
        // The last state that the controller reported may be some periods before the end, in which the tip moves 0.5 mm each.
        assert!(off < 5e-3, "{off} m\n{}", ended.stdout);
        assert!(ended.stderr.contains("/flood"), "{}", ended.stderr);
    });
}

/// Processes that do nothing but compute, on one processor; killed when dropped.
struct BusyLoops(Vec<Child>);

impl BusyLoops {
    fn start() -> Self {
        let start = |_| {
            let mut command = Command::new("taskset");
            command.args(["-c", "0", "sh", "-c", "while :; do :; done"]);
            command.spawn().expect("taskset and a shell")
        };
        Self((0..BUSY_LOOPS).map(start).collect())
    }
}

impl Drop for BusyLoops {
    fn drop(&mut self) {
        for child in &mut self.0 {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

/// A launch on the processor that the busy loops use, with a niceness and arguments for its nodes.
fn overloaded(domain: u16, niceness: &str, args: &[&str]) -> Ended {
    let folder = tempfile::tempdir().expect("a folder");
    let fuyu = command("fuyu", domain);
    let mut command = Command::new("taskset");
    command
        .args(["-c", "0", "nice", "-n", niceness])
        .arg(fuyu.get_program());
    for (name, value) in fuyu.get_envs() {
        match value {
            Some(value) => command.env(name, value),
            None => command.env_remove(name),
        };
    }
    command.arg("launch").arg(config());
    command.args(["--duration", DURATION, "--bag"]);
    command.arg(folder.path().join("bag")).args(args);
    Running::start(command).wait(Duration::from_secs(300))
}

// Fails if a run ends off its goal with exit code 0, or on it with exit code 1. With `answer_timeout` zero simulated time
// does not wait for the controller, so that an overloaded computer moves the tip elsewhere.
#[test]
fn the_exit_code_of_an_overloaded_run_says_whether_the_result_is_the_requested_one() {
    let reference = reference();
    let busy = BusyLoops::start();
    let waiting = overloaded(59, "0", &[]);
    let args = ["--ros-args", "-p", "dynamics:answer_timeout:=0.0"];
    let not_waiting = overloaded(59, "5", &args);
    // Faster than any computer answers.
    let too_fast = ["-p", "dynamics:real_time_factor:=100.0"];
    let too_fast = overloaded(59, "0", &[&args[..], &too_fast].concat());
    drop(busy);
    let runs = [
        ("waiting", &waiting),
        ("not waiting", &not_waiting),
        ("too fast", &too_fast),
    ];
    for (what, ended) in runs {
        let off = (final_error(ended) - reference).abs();
        let code = ended.code;
        println!(
            "{what}: off by {off:.1e} m, exit code {code:?}\n{}",
            ended.stdout
        );
        match code {
            Some(0) => assert!(off < LIMIT, "{off} m with exit code 0"),
            Some(1) => {
                assert!(
                    ended.stderr.contains("the computer was too slow"),
                    "{ended:?}"
                );
                assert!(ended.stderr.contains("instead of"), "{ended:?}");
            }
            _ => panic!("{ended:?}"),
        }
    }
    assert_eq!(waiting.code, Some(0), "{}", waiting.stderr);
    assert_eq!(too_fast.code, Some(1), "{}", too_fast.stderr);
}
