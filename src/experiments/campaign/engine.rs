//! Many runs on the processors of one machine.

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

/// Longest time without a call of `progress`, and until workers notice a stop request.
pub(super) const POLL_PERIOD: Duration = Duration::from_millis(200);

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
    /// argument, and calls [`serve_worker`](super::serve_worker): `fuyu campaign worker DIR`, for example.
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

/// Computes the runs of a range that `dataset` lacks, and returns how far it came. `progress` is called at the start, after
/// each run, and at least every 200 ms; if it breaks, no further run starts, and processes are ended during their runs. The rows
/// do not depend on the order, nor on the options.
///
/// # Errors
/// [`CampaignError::Input`] if there are no such runs, [`CampaignError::Runtime`] if the dataset cannot be written, or a
/// process cannot start; what is done is kept.
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
                let mut worker = Worker {
                    campaign,
                    folder: dataset.folder(),
                    workers: &options.workers,
                    stop,
                    process: None,
                };
                while !stop.load(Ordering::Relaxed) {
                    let mut queue = queue.lock().unwrap_or_else(PoisonError::into_inner);
                    // Fewer towards the end, so that all workers end at about the same time.
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
                            // If nobody receives it, an earlier one has ended the campaign.
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

/// Who computes runs, one after the other.
struct Worker<'a> {
    campaign: &'a Campaign,
    folder: &'a Path,
    workers: &'a Workers,
    /// Set by a stop request.
    stop: &'a AtomicBool,
    /// That waits for work.
    process: Option<WorkerProcess>,
}

impl Worker<'_> {
    /// How many runs it computes at the same time.
    fn lanes(&self) -> usize {
        match self.workers {
            Workers::Threads => 1,
            Workers::Processes(_) if self.campaign.runs_alone() => 1,
            Workers::Processes(_) => LANES,
        }
    }

    /// Computes runs and sends their rows, each as soon as it is there. Breaks on a stop request, or if nobody receives them.
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
            // One that ends or hangs is replaced, and each run alone shows which one it was.
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

    /// The row of a run; nothing on a stop request.
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

    /// The process that waits for work, or a new one; nothing on a stop request.
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

/// Longest wait for the row of a run after `attempts` to compute it together with others \[s\]. A process looks at the time itself
/// after every state; this is for one that does not return.
pub(super) fn longest_wait(campaign: &Campaign, attempts: u32) -> f64 {
    let attempts = attempts + campaign.attempts();
    1.1 * f64::from(attempts) * campaign.time_limit() + 5.0
}
