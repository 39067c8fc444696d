//! `fuyu launch --cockpit`: who may operate, and that the arm stops without its operator. The clients are independent ones in
//! Python; the page itself is tested in a browser (`cockpit/tests`).

use std::{
    io::{BufRead, BufReader, Read, Write},
    net::TcpStream,
    process::{Command, Stdio},
};

use serde_json::Value;

use crate::child_guard::ChildGuard;
use crate::lateness::repeat_if_late;
use crate::peer::DomainClaim;
use crate::python;
use crate::waiting::{PATIENCE, eventually};

#[test]
fn one_operator_steers_others_watch_and_a_lost_operator_stops_the_arm() {
    repeat_if_late(two_operators_and_watchers);
}

fn two_operators_and_watchers() {
    let domain = 112;
    let _claim = DomainClaim::new(domain);
    let dir = tempfile::tempdir().unwrap();
    let root = env!("CARGO_MANIFEST_DIR");
    // A page, whether or not the cockpit is built here.
    let page = dir.path().join("share/fuyu/cockpit/dist");
    std::fs::create_dir_all(&page).unwrap();
    std::fs::write(page.join("index.html"), "<title>a page</title>").unwrap();
    let launch = Command::new(env!("CARGO_BIN_EXE_fuyu"))
        .args(["launch", "config/teleoperation.yaml", "--cockpit"])
        .args(["--foxglove=127.0.0.1:0", "--bag"])
        .arg(dir.path().join("bag"))
        .current_dir(root)
        .env("AMENT_PREFIX_PATH", dir.path())
        .env("ROS_DOMAIN_ID", domain.to_string())
        .env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        .env_remove("ROS_LOCALHOST_ONLY")
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut launch = ChildGuard(launch);
    let log = BufReader::new(launch.stderr.take().unwrap()).lines();
    // The process must not block on a full pipe.
    let log = std::thread::spawn(move || log.map_while(Result::ok).collect::<Vec<_>>());
    let mut lines = BufReader::new(launch.stdout.take().unwrap()).lines();
    let line = lines
        .next()
        .expect("a line with the page's address")
        .unwrap();
    let address = line.strip_prefix("cockpit: http://").expect("the address");
    let (address, token) = address.split_once("/#token=").expect("the token");

    let mut browser = TcpStream::connect(address).unwrap();
    browser
        .write_all(b"GET / HTTP/1.1\r\nHost: x\r\n\r\n")
        .unwrap();
    let mut answer = String::new();
    browser.read_to_string(&mut answer).unwrap();
    assert!(answer.ends_with("<title>a page</title>"), "{answer}");

    let interpreter = python::environment(
        "test-venv.sh",
        &["foxglove", "websockets", "mcap-ros2-support", "protobuf"],
    );
    let client = Command::new(interpreter)
        .arg(format!("{root}/tests/bags/cockpit_client.py"))
        .args([&format!("ws://{address}"), token])
        .output()
        .unwrap();
    let told = String::from_utf8_lossy(&client.stderr);
    let report: Value =
        serde_json::from_slice(&client.stdout).unwrap_or_else(|e| panic!("{e}: {told}"));
    let sent = Command::new("kill")
        .args(["-INT", &launch.id().to_string()])
        .status();
    assert!(sent.unwrap().success());
    let status = eventually("the launch ends", PATIENCE, || launch.try_wait().unwrap());
    let log = log.join().unwrap().join("\n");
    assert!(status.success(), "{log}");
    assert!(
        !log.contains(token),
        "the log is a topic that everybody may read"
    );

    println!("{report:#}");
    let can = |who: &str, what: &str| {
        let all = report[who].as_array().unwrap();
        all.iter().any(|capability| capability == what)
    };
    for what in ["clientPublish", "parameters", "services"] {
        assert!(can("operator", what), "{what}");
        assert!(!can("watcher", what) && !can("wrong", what), "{what}");
    }
    let refused = report["refused_call"].as_str().unwrap();
    assert!(refused.contains("take control first"), "{refused}");
    assert_eq!(report["method"], "inverse_generalized");
    assert_eq!(
        (&report["second_takes"], &report["second_takes_then"]),
        (&0.into(), &1.into())
    );
    // The servo needs 0.07 s to half the speed. This is sooner than by teleop's own command_timeout of 0.5 s.
    let slowed = report["slowed_after_close"].as_f64().unwrap();
    assert!(slowed < 0.45, "{slowed} s");
    let slowed = report["slowed_after_silence"].as_f64().unwrap();
    assert!((0.4..0.8).contains(&slowed), "{slowed} s");
    assert_eq!(report["moves_without_asking"], false);
    assert_eq!(report["asks"], 1);
    assert_eq!(report["moves_by_late_commands"], false);
    // Playing.
    assert_eq!(report["call"], 1);
}

#[test]
fn a_page_that_is_not_built_is_one_line() {
    let dir = tempfile::tempdir().unwrap();
    let root = env!("CARGO_MANIFEST_DIR");
    if std::path::Path::new(root)
        .join("cockpit/dist/index.html")
        .exists()
    {
        println!("the page is built here: nothing to check");
        return;
    }
    let run = Command::new(env!("CARGO_BIN_EXE_fuyu"))
        .args(["launch", "config/teleoperation.yaml", "--cockpit", "--bag"])
        .arg(dir.path().join("bag"))
        .current_dir(root)
        .env("PATH", dir.path())
        .output()
        .unwrap();
    assert_eq!(run.status.code(), Some(2));
    let text = String::from_utf8_lossy(&run.stderr);
    assert!(
        text.contains("Node.js") && text.contains("just cockpit"),
        "{text}"
    );
    assert!(!dir.path().join("bag").exists());
}
