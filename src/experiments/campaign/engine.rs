//! Engine that computes many runs on the processors of one machine.

use std::{
    ffi::OsString,
    ops::{ControlFlow, RangeInclusive},
    path::Path,
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicBool, Ordering},
        mpsc::{self, RecvTimeoutError},
    },
    thread,
    time::{Duration, Instant},
};

use super::{
    Campaign, CampaignError, Dataset,
    range::RangeWriter,
    row::{Row, Verdict},
    run::too_long,
    worker::{Answer, WorkerProcess},
};

/// Longest time between calls of `progress`, and longest reaction time of workers to a stop request.
pub(super) const POLL_PERIOD: Duration = Duration::from_millis(200);

/// Number of attempts for a run during which its process dies. The run need not be the cause: all processes may be
/// killed.
const TRIES: u32 = 3;

/// Maximum number of runs that a process computes at the same time, in the lanes of SIMD registers.
const LANES: usize = 8;

/// Where runs are computed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Workers {
    /// In threads of this process. A run that hangs within a step, or terminates the process, ends the campaign.
    Threads,
    /// In processes with this command (executable and first arguments). The dataset's folder is appended as last
    /// argument; the command must call [`serve_worker`](super::serve_worker), as `fuyu campaign worker DIR` does.
    Processes(Vec<OsString>),
}

/// Options for computing a range of runs.
#[derive(Debug, Clone)]
pub struct RangeOptions {
    /// Number of runs at the same time.
    pub jobs: usize,
    /// Where runs are computed.
    pub workers: Workers,
}

/// Progress of a range.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Progress {
    /// Number of runs done, including those of earlier processes.
    pub done: u64,
    /// Number of runs in the range.
    pub total: u64,
}

/// Computes the missing runs of a range in `dataset`. Returns the progress. `progress` is called at the start, after
/// each run, and at least every 200 ms; if it breaks, no further run starts, and processes are killed during their
/// runs. The rows do not depend on the order of computation or on the options.
///
/// # Errors
/// [`CampaignError::Input`] if the campaign has no such runs, [`CampaignError::Runtime`] if the dataset cannot be
/// written, or a process cannot start; completed rows are kept.
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
        // Bounded, so that rows do not accumulate if the disk is slow.
        let (sender, rows) = mpsc::sync_channel(2 * jobs);
        for _ in 0..jobs {
            let (sender, queue, stop) = (sender.clone(), &queue, &stop);
            scope.spawn(move || {
                let mut worker = Worker {
                    campaign,
                    folder: dataset.folder(),
                    workers: &options.workers,
                    stop,
                    process: None,
                };
                while !stop.load(Ordering::Relaxed) {
                    let mut queue = queue.lock().unwrap_or_else(PoisonError::into_inner);
                    // Smaller batches towards the end, so that all workers finish at about the same time.
                    let count = (queue.len() / (2 * jobs)).clamp(1, worker.lanes());
                    let next: Vec<_> = queue.by_ref().take(count).collect();
                    drop(queue);
                    if next.is_empty() {
                        break;
                    }
                    match worker.run_all(&next, |row| sender.send(Ok(row)).is_ok()) {
                        Ok(ControlFlow::Continue(())) => {}
                        Ok(ControlFlow::Break(())) => break,
                        Err(e) => {
                            // Not received if an earlier error has ended the campaign.
                            let _ = sender.send(Err(e));
                            break;
                        }
                    }
                }
            });
        }
        drop(sender);
        let mut result = Ok(());
        loop {
            match rows.recv_timeout(POLL_PERIOD) {
                Ok(row) => match row.and_then(|row| writer.add(&row)) {
                    Ok(()) => done += 1,
                    Err(e) => {
                        stop.store(true, Ordering::Relaxed);
                        result = result.and(Err(e));
                    }
                },
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break,
            }
            let goes_on = !stop.load(Ordering::Relaxed);
            if goes_on && progress(Progress { done, total }).is_break() {
                stop.store(true, Ordering::Relaxed);
            }
        }
        result.map(|()| Progress { done, total })
    })
}

/// A worker thread, which computes runs by itself or by a process.
struct Worker<'a> {
    campaign: &'a Campaign,
    folder: &'a Path,
    workers: &'a Workers,
    /// Set by a stop request.
    stop: &'a AtomicBool,
    /// Its process while it is idle.
    process: Option<WorkerProcess>,
}

impl Worker<'_> {
    /// Number of runs that it computes at the same time.
    fn lanes(&self) -> usize {
        match self.workers {
            Workers::Threads => 1,
            Workers::Processes(_) if self.campaign.runs_alone() => 1,
            Workers::Processes(_) => LANES,
        }
    }

    /// Computes runs and sends each row as soon as it is done. Breaks on a stop request, or if the receiver is gone.
    fn run_all(
        &mut self,
        runs: &[u64],
        mut send: impl FnMut(Row) -> bool,
    ) -> Result<ControlFlow<()>, CampaignError> {
        let mut missing = runs;
        if let (Workers::Processes(command), 2..) = (self.workers, runs.len()) {
            let Some(mut process) = self.idle_or_new(command)? else {
                return Ok(ControlFlow::Break(()));
            };
            // If the process dies or hangs, it is replaced, and each missing run is computed alone to find the culprit.
            let mut is_there = process.ask(runs);
            while is_there && !missing.is_empty() {
                match process.reply(longest_wait(self.campaign, 1), self.stop) {
                    Answer::Row(row) => {
                        missing = &missing[1..];
                        if !send(*row) {
                            return Ok(ControlFlow::Break(()));
                        }
                    }
                    Answer::Error(e) => return Err(CampaignError::Runtime(e)),
                    Answer::Stopped => return Ok(ControlFlow::Break(())),
                    Answer::Late | Answer::Ended => is_there = false,
                }
            }
            self.process = is_there.then_some(process);
        }
        for run in missing {
            let Some(row) = self.run(*run)? else {
                return Ok(ControlFlow::Break(()));
            };
            if !send(row) {
                return Ok(ControlFlow::Break(()));
            }
        }
        Ok(ControlFlow::Continue(()))
    }

    /// Computes the row of a run; `None` on a stop request.
    fn run(&mut self, run: u64) -> Result<Option<Row>, CampaignError> {
        let campaign = self.campaign;
        if self.stop.load(Ordering::Relaxed) {
            return Ok(None);
        }
        let Workers::Processes(command) = self.workers else {
            return campaign.run_one(run, Some(self.folder)).map(Some);
        };
        let (mut ended, first) = (String::new(), Instant::now());
        for attempt in 0..TRIES {
            if attempt > 0 {
                thread::sleep(Duration::from_millis(200));
            }
            let Some(mut process) = self.idle_or_new(command)? else {
                return Ok(None);
            };
            let start = Instant::now();
            match process.answer(run, longest_wait(campaign, 0), self.stop) {
                Answer::Row(row) => {
                    self.process = Some(process);
                    return Ok(Some(*row));
                }
                Answer::Error(e) => return Err(CampaignError::Runtime(e)),
                Answer::Stopped => return Ok(None),
                Answer::Late => {
                    let time = start.elapsed().as_secs_f64();
                    let reason = too_long(campaign.time_limit());
                    return Ok(Some(campaign.lost(run, Verdict::Timeout, reason, time)));
                }
                Answer::Ended => ended = process.end(),
            }
        }
        let reason = format!("the process of the run ended: {ended}");
        let time = first.elapsed().as_secs_f64();
        Ok(Some(campaign.lost(run, Verdict::Crash, reason, time)))
    }

    /// The idle process, or a new one; `None` on a stop request.
    fn idle_or_new(
        &mut self,
        command: &[OsString],
    ) -> Result<Option<WorkerProcess>, CampaignError> {
        match self.process.take() {
            Some(process) => Ok(Some(process)),
            None => WorkerProcess::start(command, self.folder, self.stop),
        }
    }
}

/// Longest wait for the row of a run after `attempts` to compute it together with others \[s\]. A process checks the
/// time limit itself after every state; this limit is for a process that hangs.
pub(super) fn longest_wait(campaign: &Campaign, attempts: u32) -> f64 {
    let attempts = attempts + campaign.attempts();
    1.1 * f64::from(attempts) * campaign.time_limit() + 5.0
}
