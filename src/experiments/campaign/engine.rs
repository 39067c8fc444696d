//! Many runs on the processors of one machine.

use std::{
    ffi::OsString,
    io::{BufRead, BufReader, Write},
    ops::{ControlFlow, RangeInclusive},
    path::Path,
    process::{Child, ChildStdin, Command, Stdio},
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicBool, Ordering},
        mpsc::{self, Receiver, RecvTimeoutError},
    },
    thread,
    time::{Duration, Instant},
};

use serde::{Deserialize, Serialize};

use super::{
    Campaign, CampaignError, Dataset,
    range::RangeWriter,
    row::{Row, Verdict},
    run::too_long,
};

/// How often a run is tried during which its process dies. The run need not be the cause: all processes may be being killed.
const TRIES: u32 = 3;

/// Most runs that a process computes at the same time, in the lanes of SIMD registers.
const LANES: usize = 8;

/// Where runs are computed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Workers {
    /// In threads of this process. A run that hangs inside of one step, or ends the process, ends the campaign.
    Threads,
    /// In processes of this command (an executable and its first arguments), which is called with the dataset's folder as its last
    /// argument, and calls [`serve_worker`]: `fuyu campaign worker DIR`, for example.
    Processes(Vec<OsString>),
}

/// How a range of runs is computed.
#[derive(Debug, Clone)]
pub struct RangeOptions {
    /// Runs at the same time.
    pub jobs: usize,
    /// Where.
    pub workers: Workers,
}

/// How far a range is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Progress {
    /// Runs that are done, those of earlier processes included.
    pub done: u64,
    /// Runs of the range.
    pub total: u64,
}

/// Computes the runs of a range that `dataset` lacks, and returns how far it came. `progress` is called at the start and after
/// each run; if it breaks, no further run starts. The rows do not depend on the order, nor on the options.
///
/// # Errors
/// [`CampaignError::Input`] if there are no such runs, [`CampaignError::Runtime`] if the dataset cannot be written; what is
/// done is kept.
pub fn run_range(
    campaign: &Campaign,
    dataset: &Dataset,
    range: RangeInclusive<u64>,
    options: &RangeOptions,
    mut progress: impl FnMut(Progress) -> ControlFlow<()>,
) -> Result<Progress, CampaignError> {
    let runs = campaign.runs();
    if range.is_empty() || *range.end() >= runs {
        return Err(CampaignError::Input(format!(
            "runs {} to {}: the campaign has runs 0 to {}",
            range.start(),
            range.end(),
            runs - 1
        )));
    }
    let total = range.end() - range.start() + 1;
    let mut writer = RangeWriter::new(dataset, range)?;
    let missing = writer.missing();
    let mut done = total - missing.len() as u64;
    if progress(Progress { done, total }).is_break() {
        return Ok(Progress { done, total });
    }
    let jobs = options.jobs.clamp(1, missing.len().max(1));
    let queue = Mutex::new(missing.into_iter());
    let stop = AtomicBool::new(false);
    thread::scope(|scope| {
        // Bounded, so that rows do not pile up before a slow disk.
        let (sender, rows) = mpsc::sync_channel(2 * jobs);
        for _ in 0..jobs {
            let (sender, queue, stop) = (sender.clone(), &queue, &stop);
            scope.spawn(move || {
                let mut worker = Worker::new(campaign, dataset.folder(), &options.workers);
                while !stop.load(Ordering::Relaxed) {
                    let mut queue = queue.lock().unwrap_or_else(PoisonError::into_inner);
                    // Fewer towards the end, so that all workers end at about the same time.
                    let count = (queue.len() / (2 * jobs)).clamp(1, worker.lanes());
                    let next: Vec<_> = queue.by_ref().take(count).collect();
                    drop(queue);
                    if next.is_empty() || !worker.run_all(&next, |row| sender.send(row).is_ok()) {
                        break;
                    }
                }
            });
        }
        drop(sender);
        let mut result = Ok(());
        for row in rows {
            match row.and_then(|row| writer.add(&row)) {
                Ok(()) => {
                    done += 1;
                    let goes_on = !stop.load(Ordering::Relaxed);
                    if goes_on && progress(Progress { done, total }).is_break() {
                        stop.store(true, Ordering::Relaxed);
                    }
                }
                Err(e) => {
                    stop.store(true, Ordering::Relaxed);
                    result = result.and(Err(e));
                }
            }
        }
        result.map(|()| Progress { done, total })
    })
}

/// Who computes runs, one after the other.
enum Worker<'a> {
    Thread(&'a Campaign, &'a Path),
    Process {
        campaign: &'a Campaign,
        folder: &'a Path,
        command: &'a [OsString],
        process: Option<WorkerProcess>,
    },
}

impl<'a> Worker<'a> {
    fn new(campaign: &'a Campaign, folder: &'a Path, workers: &'a Workers) -> Self {
        match workers {
            Workers::Threads => Self::Thread(campaign, folder),
            Workers::Processes(command) => Self::Process {
                campaign,
                folder,
                command,
                process: None,
            },
        }
    }

    /// How many runs it computes at the same time.
    fn lanes(&self) -> usize {
        match self {
            Self::Thread(..) => 1,
            Self::Process { campaign, .. } if campaign.runs_alone() => 1,
            Self::Process { .. } => LANES,
        }
    }

    /// Computes runs and sends their rows. Returns whether it may go on.
    fn run_all(
        &mut self,
        runs: &[u64],
        mut send: impl FnMut(Result<Row, CampaignError>) -> bool,
    ) -> bool {
        let mut missing = runs;
        if runs.len() > 1 {
            match self.run_together(runs) {
                Ok(rows) => {
                    missing = &runs[rows.len()..];
                    if !rows.into_iter().all(|row| send(Ok(row))) {
                        return false;
                    }
                }
                Err(e) => {
                    send(Err(e));
                    return false;
                }
            }
        }
        // If a process hangs or ends, each run alone shows which one it was.
        missing.iter().all(|run| {
            let row = self.run(*run);
            let is_row = row.is_ok();
            send(row) && is_row
        })
    }

    /// The rows of the first runs, up to that with which the process ended or took too long.
    fn run_together(&mut self, runs: &[u64]) -> Result<Vec<Row>, CampaignError> {
        let Self::Process {
            campaign,
            folder,
            command,
            process,
        } = self
        else {
            return Ok(Vec::new());
        };
        let mut worker = WorkerProcess::idle_or_new(process, command, folder)?;
        let mut rows = Vec::new();
        // It looks at the time itself, and begins again with each run alone.
        let limit = 2.2 * campaign.time_limit() + 10.0;
        if worker.ask(runs) {
            while rows.len() < runs.len() {
                match worker.reply(limit) {
                    Answer::Reply(Reply::Row(row)) => rows.push(row),
                    Answer::Reply(Reply::Error(e)) => return Err(CampaignError::Runtime(e)),
                    Answer::Late | Answer::Ended => return Ok(rows),
                }
            }
        }
        *process = Some(worker);
        Ok(rows)
    }

    fn run(&mut self, run: u64) -> Result<Row, CampaignError> {
        let (campaign, folder, command, process) = match self {
            Self::Thread(campaign, folder) => return campaign.run_one(run, Some(folder)),
            Self::Process {
                campaign,
                folder,
                command,
                process,
            } => (*campaign, *folder, *command, process),
        };
        let (mut ended, first) = (String::new(), Instant::now());
        for attempt in 0..TRIES {
            if attempt > 0 {
                thread::sleep(Duration::from_millis(200));
            }
            let mut worker = WorkerProcess::idle_or_new(process, command, folder)?;
            let start = Instant::now();
            // A process looks at the time itself after every state. This is for one that does not return.
            let limit = 1.1 * campaign.time_limit() + 5.0;
            match worker.answer(run, limit) {
                Answer::Reply(Reply::Row(row)) => {
                    *process = Some(worker);
                    return Ok(row);
                }
                Answer::Reply(Reply::Error(e)) => return Err(CampaignError::Runtime(e)),
                Answer::Late => {
                    let time = start.elapsed().as_secs_f64();
                    let reason = too_long(campaign.time_limit());
                    return Ok(campaign.lost(run, Verdict::Timeout, reason, time));
                }
                Answer::Ended => ended = worker.end(),
            }
        }
        let reason = format!("the process of the run ended: {ended}");
        let time = first.elapsed().as_secs_f64();
        Ok(campaign.lost(run, Verdict::Crash, reason, time))
    }
}

/// Output of a worker's process: a line per run.
#[derive(Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Reply {
    Row(Row),
    Error(String),
}

enum Answer {
    Reply(Reply),
    Late,
    Ended,
}

/// A process that computes runs.
struct WorkerProcess {
    child: Child,
    stdin: ChildStdin,
    replies: Receiver<String>,
}

impl WorkerProcess {
    /// The process that waits for work, or a new one.
    fn idle_or_new(
        idle: &mut Option<Self>,
        command: &[OsString],
        folder: &Path,
    ) -> Result<Self, CampaignError> {
        match idle.take() {
            Some(worker) => Ok(worker),
            None => Self::start(command, folder),
        }
    }

    fn start(command: &[OsString], folder: &Path) -> Result<Self, CampaignError> {
        let Some((executable, arguments)) = command.split_first() else {
            let empty = "the command of the workers is empty".to_owned();
            return Err(CampaignError::Input(empty));
        };
        let name = Path::new(executable).display();
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
        let (sender, replies) = mpsc::channel();
        // It ends with the process.
        thread::spawn(move || {
            for line in BufReader::new(stdout).lines() {
                let Ok(line) = line else { break };
                if sender.send(line).is_err() {
                    break;
                }
            }
        });
        Ok(Self {
            child,
            stdin,
            replies,
        })
    }

    fn answer(&mut self, run: u64, limit: f64) -> Answer {
        match self.ask(&[run]) {
            true => self.reply(limit),
            false => Answer::Ended,
        }
    }

    /// Asks for runs; whether the process is there.
    fn ask(&mut self, runs: &[u64]) -> bool {
        let runs: Vec<_> = runs.iter().map(u64::to_string).collect();
        let asked = writeln!(self.stdin, "{}", runs.join(" "));
        asked.and_then(|()| self.stdin.flush()).is_ok()
    }

    /// The next reply, within `limit` \[s\].
    fn reply(&mut self, limit: f64) -> Answer {
        let limit = Duration::try_from_secs_f64(limit).unwrap_or(Duration::MAX);
        match self.replies.recv_timeout(limit) {
            Ok(line) => match serde_json::from_str(&line) {
                Ok(reply) => Answer::Reply(reply),
                Err(_) => Answer::Ended,
            },
            Err(RecvTimeoutError::Timeout) => Answer::Late,
            Err(RecvTimeoutError::Disconnected) => Answer::Ended,
        }
    }

    /// Ends it; says how it had ended.
    fn end(mut self) -> String {
        for _ in 0..20 {
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
        // It may have ended already.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Computes the runs whose numbers come on stdin, those of a line together, and writes a row for each to stdout.
/// Returns when stdin ends, also during a run: then whoever asked is gone.
///
/// # Errors
/// [`CampaignError::Input`] if `folder` holds no campaign.
pub fn serve_worker(folder: &Path) -> Result<(), CampaignError> {
    let campaign = Dataset::open(folder)?.campaign()?;
    // The message of a panic is in the row.
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
        let replies = match runs.iter().find(|run| **run >= campaign.runs()) {
            Some(run) => vec![Reply::Error(format!("there is no run {run}"))],
            None => match campaign.run_together(&runs, Some(folder)) {
                Ok(rows) => rows.into_iter().map(Reply::Row).collect(),
                Err(e) => vec![Reply::Error(e.to_string())],
            },
        };
        let mut stdout = std::io::stdout().lock();
        for reply in replies {
            let line = serde_json::to_string(&reply);
            let line = line.map_err(|e| CampaignError::Runtime(e.to_string()))?;
            let written = writeln!(stdout, "{line}").and_then(|()| stdout.flush());
            written.map_err(|e| CampaignError::Runtime(format!("cannot write to stdout: {e}")))?;
        }
    }
    Ok(())
}
