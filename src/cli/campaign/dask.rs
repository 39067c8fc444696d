//! The engine `dask`: the Python package submits ranges of runs to a Dask scheduler, whose workers call
//! `fuyu campaign run-range`.

use std::{
    net::{TcpStream, ToSocketAddrs},
    process::{Command, Stdio},
    time::Duration,
};

use crate::{cli::Failure, experiments::campaign::Dataset};

/// The module of the Python package.
const MODULE: &str = "fuyu.campaign_dask";

/// Timeout of the scheduler's response.
const PATIENCE: Duration = Duration::from_secs(5);

/// Checks that the scheduler can be reached and the Python package is installed.
pub(super) fn check(address: &str) -> Result<(), Failure> {
    let input = |problem: String| Failure::Input(problem);
    let (scheme, host) = address.split_once("://").unwrap_or(("tcp", address));
    // Other schemes, such as ucx://, are known to Python only.
    if ["tcp", "tls"].contains(&scheme) {
        let unreachable = |e: &dyn std::fmt::Display| {
            input(format!(
                "--address {address}: no Dask scheduler answers: {e}; `dask scheduler` starts one"
            ))
        };
        let mut found = host.to_socket_addrs().map_err(|e| unreachable(&e))?;
        let first = found.next().ok_or_else(|| unreachable(&"no such host"))?;
        TcpStream::connect_timeout(&first, PATIENCE).map_err(|e| unreachable(&e))?;
    }
    let tried = Command::new("python3")
        .args(["-c", &format!("import distributed, {MODULE}")])
        .stdin(Stdio::null())
        .output();
    let output =
        tried.map_err(|e| input(format!("--engine dask: python3 cannot be started: {e}")))?;
    if !output.status.success() {
        let log = String::from_utf8_lossy(&output.stderr);
        let last = log.lines().rfind(|line| !line.trim().is_empty());
        return Err(input(format!(
            "--engine dask: python3 lacks the package fuyu or dask: {}; `pip install ./python distributed` installs both",
            last.unwrap_or("no message").trim()
        )));
    }
    Ok(())
}

/// Runs the Python package until all runs are done.
pub(super) fn run(address: &str, dataset: &Dataset) -> Result<(), Failure> {
    let runtime = |e: String| Failure::Runtime(format!("--engine dask: {e}"));
    let executable = std::env::current_exe().map_err(|e| runtime(e.to_string()))?;
    // Workers may have different working directories.
    let folder = dataset.folder().canonicalize();
    let folder = folder.unwrap_or_else(|_| dataset.folder().to_owned());
    let status = Command::new("python3")
        .args(["-m", MODULE, address])
        .arg(folder)
        .arg("--campaign")
        .arg(&dataset.manifest().campaign_path)
        .args(["--runs", &dataset.manifest().runs.to_string()])
        .args(["--chunk", &dataset.manifest().chunk.to_string()])
        .arg("--fuyu")
        .arg(executable)
        .stdin(Stdio::null())
        // stdout is for the summary.
        .stdout(std::io::stderr())
        .status()
        .map_err(|e| runtime(format!("python3 cannot be started: {e}")))?;
    match status.code() {
        Some(0) => Ok(()),
        Some(2) => Err(Failure::Input(format!(
            "--engine dask: {MODULE} refused its input"
        ))),
        _ => Err(runtime(format!("{MODULE} ended with {status}"))),
    }
}
