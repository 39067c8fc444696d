//! The interop matrix: what works with which peer. `docs/interop.md` has the table; a run with another result fails
//! and writes it to `target/interop-matrix.md`. `FUYU_UPDATE_INTEROP=1` updates the document.

use fuyu::msg;
use serde_json::{Value, json};
use std::{
    collections::BTreeMap,
    fs,
    io::{BufRead, BufReader, Write},
    path::{Path, PathBuf},
    process::{Command, Stdio},
    sync::{Mutex, PoisonError, mpsc},
    thread,
    time::Duration,
};

use crate::{
    child::{Running, executable},
    echo,
    namespace::Namespace,
    python,
    waiting::{PATIENCE, eventually},
};

/// Columns of the table.
const PEERS: [&str; 3] = ["rclpy Jazzy", "rclpy Kilted", "CycloneDDS"];
const CYCLONE: &str = "cyclone_peer.py";
/// Longest time that one row may take; the peer itself gives up much earlier.
const ROW_PATIENCE: Duration = Duration::from_secs(300);

/// Rows and verdicts of one peer, in a namespace with nothing but `lo` where one can be made.
fn column(script: &str, python: PathBuf, domain: u16) -> Vec<(String, bool, String)> {
    let namespace = Namespace::new(&format!("matrix{domain}"));
    let command = |program: PathBuf| match &namespace {
        Some(namespace) => namespace.command(program),
        None => Command::new(program),
    };
    // Every endpoint is there before the peer comes.
    let echo = Running::program(
        command(executable()),
        "echo",
        domain,
        &["--ros-args", "-r", "__node:=echo"],
    );
    echo.says("echoes");

    let here = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/interop");
    let mut peer = command(python)
        .arg(here.join(script))
        .env("ROS_DOMAIN_ID", domain.to_string())
        .env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        .env("RMW_IMPLEMENTATION", "rmw_fastrtps_cpp")
        .env_remove("ROS_LOCALHOST_ONLY")
        .env_remove("AMENT_PREFIX_PATH")
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("python can be started");
    let mut stdin = peer.stdin.take().expect("stdin is piped");
    let texts: BTreeMap<_, _> = msg::definitions()
        .chain(msg::service_definitions())
        .map(|d| (d.type_name(), d.msg_text()))
        .collect();
    writeln!(stdin, "{}", json!({"types": echo::types(), "texts": texts})).expect("it reads");
    let stdout = BufReader::new(peer.stdout.take().expect("stdout is piped"));
    let (lines, answer) = mpsc::channel();
    // Ends with the pipe, thus with the peer.
    thread::spawn(move || {
        for line in stdout.lines().map_while(Result::ok) {
            if lines.send(line).is_err() {
                return;
            }
        }
    });
    let mut rows = Vec::new();
    loop {
        let line = answer.recv_timeout(ROW_PATIENCE);
        let line = line.unwrap_or_else(|e| panic!("{script} ends after {:?}: {e}", rows.last()));
        let answer: Value = serde_json::from_str(&line).expect("a row");
        let Some(row) = answer["row"].as_str() else {
            break;
        };
        let (verdict, detail) = (answer["verdict"] == true, answer["detail"].to_string());
        println!("{script}: {row}: {verdict} {detail}");
        rows.push((row.to_owned(), verdict, detail));
    }
    for (row, words) in noticed(script) {
        let warned = (0..600).any(|_| {
            let warned = echo.said().contains(words);
            thread::sleep(Duration::from_millis(if warned { 0 } else { 100 }));
            warned
        });
        rows.push((row.to_owned(), warned, String::new()));
    }
    writeln!(stdin, "{{}}").expect("it waits");
    eventually("the peer ends", PATIENCE, || {
        peer.try_wait().expect("it can be waited for")
    });
    let said = echo.interrupt();
    let others = said.matches("another definition of");
    let expected = usize::from(script == CYCLONE);
    assert_eq!(others.count(), expected, "definitions are the same: {said}");
    rows
}

/// Rows on fuyu's warnings about a peer.
fn noticed(script: &str) -> Vec<(&'static str, &'static str)> {
    let mut rows = vec![
        (
            "reliable asked of best effort: fuyu warns",
            "topic /best_effort is not exchanged with a peer",
        ),
        (
            "best effort offered to reliable: fuyu warns",
            "topic /reliable_please is not exchanged with a peer",
        ),
    ];
    rows.push(match script {
        // It announces the hash that it was given.
        CYCLONE => (
            "another definition of a type: fuyu warns",
            "topic /start_stream: a peer has another definition of std_msgs/msg/Int32 (RIHS01_0000",
        ),
        // From rosidl's generators, in the wheels.
        _ => (
            "type hash of the peer: fuyu reads it",
            "/upstream comes with sensor_msgs/msg/JointState RIHS01_a13ee3a3",
        ),
    });
    rows
}

fn document() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/interop.md")
}

const BEGIN: &str = "<!-- The table between these lines is made by tests/interop/matrix.rs. -->\n";
const END: &str = "<!-- End of the table. -->\n";

/// Rows of the table in the document: their names, and a cell for each peer.
fn table() -> Vec<(String, Vec<String>)> {
    let text = fs::read_to_string(document()).expect("docs/interop.md");
    let (_, rest) = text.split_once(BEGIN).expect("where the table begins");
    let (table, _) = rest.split_once(END).expect("where the table ends");
    let rows = table.lines().filter(|line| line.starts_with('|')).skip(2);
    let cells = rows.map(|line| {
        line.trim_matches('|')
            .split('|')
            .map(|c| c.trim().to_owned())
    });
    cells
        .map(|mut cells| (cells.next().unwrap_or_default(), cells.collect()))
        .collect()
}

/// Columns that are known by now write the document together.
static UPDATE: Mutex<()> = Mutex::new(());

fn written(rows: &[(String, Vec<String>)]) -> String {
    let mut text = format!(
        "| | {} |\n| --- |{}\n",
        PEERS.join(" | "),
        " --- |".repeat(PEERS.len())
    );
    for (row, cells) in rows {
        text += &format!("| {row} | {} |\n", cells.join(" | "));
    }
    text
}

/// Compares a column with the table, whose rows are those of all peers.
fn hold(peer: usize, found: &[(String, bool, String)]) {
    let _one = UPDATE.lock().unwrap_or_else(PoisonError::into_inner);
    let mut rows = table();
    let before = rows.clone();
    for (row, cells) in &mut rows {
        if !found.iter().any(|(name, ..)| name == row) {
            cells[peer] = "–".to_owned();
        }
    }
    for (name, verdict, _) in found {
        let cell = if *verdict { "yes" } else { "no" };
        match rows.iter_mut().find(|(row, _)| row == name) {
            Some((_, cells)) => cells[peer] = cell.to_owned(),
            None => {
                let mut cells = vec!["–".to_owned(); PEERS.len()];
                cells[peer] = cell.to_owned();
                rows.push((name.clone(), cells));
            }
        }
    }
    if rows == before {
        return;
    }
    if std::env::var_os("FUYU_UPDATE_INTEROP").is_some() {
        let text = fs::read_to_string(document()).expect("docs/interop.md");
        let (head, rest) = text.split_once(BEGIN).expect("where the table begins");
        let (_, tail) = rest.split_once(END).expect("where the table ends");
        let text = format!("{head}{BEGIN}\n{}\n{END}{tail}", written(&rows));
        fs::write(document(), text).expect("docs/interop.md can be written");
        return;
    }
    let target = executable()
        .ancestors()
        .nth(3)
        .expect("target")
        .join("interop-matrix.md");
    fs::write(&target, written(&rows)).expect("target can be written");
    let differing: Vec<_> = found
        .iter()
        .filter(|(name, verdict, _)| {
            let cell = if *verdict { "yes" } else { "no" };
            !before
                .iter()
                .any(|(row, cells)| row == name && cells[peer] == cell)
        })
        .collect();
    panic!(
        "docs/interop.md says otherwise of {}: {differing:#?}; the table of this run is {}",
        PEERS[peer],
        target.display()
    );
}

#[test]
fn rclpy_jazzy() {
    let python = python::environment("test-interfaces.sh", &[]);
    hold(0, &column("rclpy_peer.py", python, 11));
}

#[test]
fn rclpy_kilted() {
    let python = python::environment("test-interfaces.sh", &["kilted"]);
    hold(1, &column("rclpy_peer.py", python, 12));
}

#[test]
fn cyclone() {
    let python = python::environment("test-venv.sh", &["cyclone", "cyclonedds==11.0.1"]);
    hold(2, &column(CYCLONE, python, 13));
}
