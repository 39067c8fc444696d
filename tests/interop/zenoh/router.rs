//! The command `fuyu router`.

use std::{net::TcpListener, process::Command};

use crate::binaries::binary;

/// Exit code and stderr.
fn run(args: &[&str]) -> (Option<i32>, String) {
    let mut command = Command::new(binary("fuyu"));
    let output = command.arg("router").args(args).output();
    let output = output.expect("it can be started");
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    (output.status.code(), text)
}

// Fails if a router that cannot work goes on, or does not say why in one line.
#[test]
fn a_router_says_what_is_wrong() {
    let taken = TcpListener::bind("127.0.0.1:0").expect("a free port");
    let taken = taken.local_addr().map(|address| (address, taken));
    let (address, _taken) = taken.expect("it is bound");
    let listen = format!("tcp/{address}");
    for (args, code, words) in [
        (&["--listen", &listen][..], 1, "in use"),
        (&["--listen", "nowhere"], 2, "--listen"),
        (&["--connect", "tcp"], 2, "--connect"),
        (
            &["--config", "/no/such/file.json5"],
            2,
            "/no/such/file.json5",
        ),
    ] {
        let (found, text) = run(args);
        assert_eq!(found, Some(code), "{args:?}: {text}");
        let lines: Vec<_> = text
            .lines()
            .filter(|l| l.contains("fuyu: error:"))
            .collect();
        assert!(
            lines.len() == 1 && lines[0].contains(words),
            "{args:?}: {text}"
        );
    }
}
