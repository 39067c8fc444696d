//! Worker process: computes runs for another process, with run numbers on stdin and rows on stdout.

use std::{
    ffi::{OsStr, OsString},
    io::{BufRead, BufReader, Write},
    path::Path,
    process::{Child, ChildStdin, Command, Stdio},
    sync::{
        atomic::{AtomicBool, Ordering},
        mpsc::{self, Receiver, RecvTimeoutError},
    },
    thread,
    time::{Duration, Instant},
};

use serde::{Deserialize, Serialize};

use super::{Campaign, CampaignError, Dataset, engine::POLL_PERIOD, row::Row};

/// Longest start of a process \[s\]: an interpreter on a slow file system needs a while.
const LONGEST_START: f64 = 300.0;

/// A line written by a worker process.
#[derive(Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Reply {
    /// The campaign is loaded.
    Ready,
    Row(Box<Row>),
    Error(String),
}

/// Result of waiting for a row.
pub(super) enum Answer {
    Row(Box<Row>),
    /// The process has reported an error.
    Error(String),
    Late,
    /// The process has ended, or has written an invalid line.
    Ended,
    /// A stop request has arrived first.
    Stopped,
}

/// Result of waiting for a line.
enum Line {
    Text(String),
    Late,
    Ended,
    Stopped,
}

/// A worker process. It is killed when this is dropped.
pub(super) struct WorkerProcess {
    child: Child,
    stdin: ChildStdin,
    lines: Receiver<String>,
}

impl WorkerProcess {
    /// Starts a process and waits until it is ready; `None` on a stop request.
    ///
    /// # Errors
    /// [`CampaignError::Input`] if the command is empty, [`CampaignError::Runtime`] if the process does not become ready.
    pub fn start(
        command: &[OsString],
        folder: &Path,
        stop: &AtomicBool,
    ) -> Result<Option<Self>, CampaignError> {
        let Some((executable, arguments)) = command.split_first() else {
            let empty = "the command of the workers is empty".to_owned();
            return Err(CampaignError::Input(empty));
        };
        let name = command.join(OsStr::new(" ")).display().to_string();
        let at = |e: String| CampaignError::Runtime(format!("{name}: {e}"));
        let mut child = Command::new(executable)
            .args(arguments)
            .arg(folder)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .map_err(|e| at(format!("cannot be started: {e}")))?;
        let pipes = (child.stdin.take(), child.stdout.take());
        let (Some(stdin), Some(stdout)) = pipes else {
            return Err(at("has no pipes".to_owned()));
        };
        let (sender, lines) = mpsc::channel();
        // The thread ends with the process.
        thread::spawn(move || {
            for line in BufReader::new(stdout).lines() {
                let Ok(line) = line else { break };
                if sender.send(line).is_err() {
                    break;
                }
            }
        });
        let process = Self {
            child,
            stdin,
            lines,
        };
        match process.line(LONGEST_START, stop) {
            Line::Text(line) => match serde_json::from_str(&line) {
                Ok(Reply::Ready) => Ok(Some(process)),
                Ok(Reply::Error(e)) => Err(at(e)),
                _ => Err(at(format!(
                    "its first line on stdout is {line:?}; a worker writes \"ready\""
                ))),
            },
            Line::Late => Err(at(format!("is not ready after {LONGEST_START} s"))),
            Line::Ended => Err(at(format!(
                "ended before it was ready: {}; its messages are on stderr",
                process.end()
            ))),
            Line::Stopped => Ok(None),
        }
    }

    /// Computes the row of a run, waiting at most `limit` \[s\].
    pub fn answer(&mut self, run: u64, limit: f64, stop: &AtomicBool) -> Answer {
        match self.ask(&[run]) {
            true => self.reply(limit, stop),
            false => Answer::Ended,
        }
    }

    /// Requests runs. Returns whether the process accepted the request.
    pub fn ask(&mut self, runs: &[u64]) -> bool {
        let runs: Vec<_> = runs.iter().map(u64::to_string).collect();
        let asked = writeln!(self.stdin, "{}", runs.join(" "));
        asked.and_then(|()| self.stdin.flush()).is_ok()
    }

    /// Waits at most `limit` \[s\] for the row of the next requested run.
    pub fn reply(&self, limit: f64, stop: &AtomicBool) -> Answer {
        match self.line(limit, stop) {
            Line::Text(line) => match serde_json::from_str(&line) {
                Ok(Reply::Row(row)) => Answer::Row(row),
                Ok(Reply::Error(e)) => Answer::Error(e),
                Ok(Reply::Ready) | Err(_) => Answer::Ended,
            },
            Line::Late => Answer::Late,
            Line::Ended => Answer::Ended,
            Line::Stopped => Answer::Stopped,
        }
    }

    fn line(&self, limit: f64, stop: &AtomicBool) -> Line {
        let limit = Duration::try_from_secs_f64(limit).unwrap_or(Duration::MAX);
        let start = Instant::now();
        loop {
            let left = limit.saturating_sub(start.elapsed());
            match self.lines.recv_timeout(left.min(POLL_PERIOD)) {
                Ok(line) => return Line::Text(line),
                Err(RecvTimeoutError::Disconnected) => return Line::Ended,
                Err(RecvTimeoutError::Timeout) if stop.load(Ordering::Relaxed) => {
                    return Line::Stopped;
                }
                Err(RecvTimeoutError::Timeout) if left <= POLL_PERIOD => return Line::Late,
                Err(RecvTimeoutError::Timeout) => {}
            }
        }
    }

    /// Waits for the end of the process, and returns its exit status as text.
    pub fn end(mut self) -> String {
        // Stdout is closed shortly before the process ends.
        for _ in 0..100 {
            if let Ok(Some(status)) = self.child.try_wait() {
                return status.to_string();
            }
            thread::sleep(Duration::from_millis(10));
        }
        "it gave no valid answer".to_owned()
    }
}

impl Drop for WorkerProcess {
    fn drop(&mut self) {
        // Fails if the process has ended already.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Writes `ready` to stdout, then reads run numbers from stdin; computes the runs of each line together, and writes a
/// row for each. When stdin ends, even during a run, the process exits, since the requester is gone.
///
/// # Errors
/// [`CampaignError::Input`] if `folder` has no campaign, [`CampaignError::Runtime`] if stdout cannot be written.
pub fn serve_worker(folder: &Path) -> Result<(), CampaignError> {
    let campaign = match Dataset::open(folder).and_then(|dataset| dataset.campaign()) {
        Ok(campaign) => campaign,
        Err(e) => {
            write(&Reply::Error(e.to_string()))?;
            return Err(e);
        }
    };
    write(&Reply::Ready)?;
    // The row contains the message of a panic.
    std::panic::set_hook(Box::new(|_| {}));
    let (sender, runs) = mpsc::channel();
    thread::spawn(move || {
        for line in std::io::stdin().lines() {
            let runs = line.ok().and_then(|line| {
                let numbers = line.split_whitespace().map(|run| run.parse::<u64>().ok());
                numbers.collect::<Option<Vec<_>>>()
            });
            if runs.is_none_or(|runs| sender.send(runs).is_err()) {
                break;
            }
        }
        std::process::exit(0);
    });
    for runs in runs {
        if let Err(e) = serve(&campaign, &runs, folder) {
            write(&Reply::Error(e.to_string()))?;
        }
    }
    Ok(())
}

/// Computes runs and writes their rows.
fn serve(campaign: &Campaign, runs: &[u64], folder: &Path) -> Result<(), CampaignError> {
    if let Some(run) = runs.iter().find(|run| **run >= campaign.runs()) {
        return Err(CampaignError::Input(format!("there is no run {run}")));
    }
    campaign.run_together(runs, Some(folder), |row| write(&Reply::Row(Box::new(row))))
}

/// Writes a line to stdout.
fn write(reply: &Reply) -> Result<(), CampaignError> {
    let line = serde_json::to_string(reply);
    let line = line.map_err(|e| CampaignError::Runtime(e.to_string()))?;
    let mut stdout = std::io::stdout().lock();
    let written = writeln!(stdout, "{line}").and_then(|()| stdout.flush());
    written.map_err(|e| CampaignError::Runtime(format!("cannot write to stdout: {e}")))
}
