//! Batch solver on a separate thread, so that frames are processed without delay.

use std::{
    sync::mpsc::{Receiver, Sender, TryRecvError, channel},
    thread,
    time::Instant,
};

use crate::{
    estimation::{Estimated, EstimationMethod, MethodError, Tracks, bundle, estimate},
    vision::Pinhole,
};

/// A batch to solve.
#[derive(Debug)]
pub struct Job {
    /// Estimation method.
    pub method: EstimationMethod,
    /// The frames.
    pub tracks: Tracks,
    /// The camera.
    pub camera: Pinhole,
    /// Options, including the camera's motion.
    pub options: bundle::Options,
}

/// A solved batch.
pub struct Solved {
    /// The job.
    pub job: Job,
    /// The estimate, or the reason for its failure.
    pub result: Result<Estimated, MethodError>,
    /// Duration \[s\], wall time.
    pub duration: f64,
}

/// The solver thread and its state.
pub struct Solver {
    jobs: Sender<Job>,
    results: Receiver<Solved>,
    busy: bool,
}

impl Solver {
    /// Starts the thread. It ends after the solver is dropped and the current job is done.
    pub fn start() -> Self {
        let (jobs, queue) = channel::<Job>();
        let (done, results) = channel();
        thread::spawn(move || {
            for job in queue {
                let start = Instant::now();
                let result = estimate(job.method, &job.tracks, &job.camera, &job.options);
                let duration = start.elapsed().as_secs_f64();
                let solved = Solved {
                    job,
                    result,
                    duration,
                };
                if done.send(solved).is_err() {
                    return;
                }
            }
        });
        Self {
            jobs,
            results,
            busy: false,
        }
    }

    /// Whether a job is being solved.
    pub fn is_busy(&self) -> bool {
        self.busy
    }

    /// Starts a job; the solver must not be busy.
    pub fn submit(&mut self, job: Job) {
        self.busy = self.jobs.send(job).is_ok();
    }

    /// Takes the solved job, if there is one.
    ///
    /// # Errors
    /// If the thread panicked; a new one has been started.
    pub fn take(&mut self) -> Result<Option<Solved>, String> {
        match self.results.try_recv() {
            Ok(solved) => {
                self.busy = false;
                Ok(Some(solved))
            }
            Err(TryRecvError::Empty) => Ok(None),
            Err(TryRecvError::Disconnected) => {
                *self = Self::start();
                Err("the solver thread panicked on these frames and was restarted".to_owned())
            }
        }
    }
}
