//! Batch solutions on a thread of their own, so that frames are never kept waiting.

use std::{
    sync::mpsc::{Receiver, Sender, TryRecvError, channel},
    thread,
};

use crate::{
    estimation::{Estimated, Method, MethodError, Tracks, bundle, estimate},
    vision::Pinhole,
};

/// What is to be solved.
#[derive(Debug)]
pub struct Job {
    /// How.
    pub method: Method,
    /// The frames.
    pub tracks: Tracks,
    /// The camera.
    pub camera: Pinhole,
    /// What is known beside.
    pub options: bundle::Options,
}

/// What came of it.
pub struct Solved {
    /// The job.
    pub job: Job,
    /// The motion, or why there is none.
    pub result: Result<Estimated, MethodError>,
}

/// The thread, and what it is at.
pub struct Solver {
    jobs: Sender<Job>,
    answers: Receiver<Solved>,
    busy: bool,
}

impl Solver {
    /// Starts the thread. It ends when the solver is dropped and its work is done.
    pub fn start() -> Self {
        let (jobs, to_do) = channel::<Job>();
        let (done, answers) = channel();
        thread::spawn(move || {
            for job in to_do {
                let result = estimate(job.method, &job.tracks, &job.camera, &job.options);
                if done.send(Solved { job, result }).is_err() {
                    return;
                }
            }
        });
        Self {
            jobs,
            answers,
            busy: false,
        }
    }

    /// Whether a job is under way.
    pub fn is_busy(&self) -> bool {
        self.busy
    }

    /// Gives the thread a job; it must not be busy.
    pub fn give(&mut self, job: Job) {
        self.busy = self.jobs.send(job).is_ok();
    }

    /// The finished job, if there is one.
    ///
    /// # Errors
    /// When the thread has died on its job; a new one has been started.
    pub fn take(&mut self) -> Result<Option<Solved>, String> {
        match self.answers.try_recv() {
            Ok(solved) => {
                self.busy = false;
                Ok(Some(solved))
            }
            Err(TryRecvError::Empty) => Ok(None),
            Err(TryRecvError::Disconnected) => {
                *self = Self::start();
                Err("the solver broke down on these frames and was started anew".to_owned())
            }
        }
    }
}
