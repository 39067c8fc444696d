//! Queue of joint states that have not been answered yet.

use std::collections::VecDeque;

use nalgebra::DVector;

use super::Stamp;

/// Largest number of queued joint states; the oldest is dropped when one more arrives.
const CAPACITY: usize = 64;

/// Positions and rates of the joints at one time.
#[derive(Debug, Clone)]
pub(super) struct JointSample {
    pub stamp: Stamp,
    /// Joint positions \[rad or m\].
    pub q: DVector<f64>,
    /// Joint rates \[rad/s or m/s\].
    pub qd: DVector<f64>,
}

/// A bounded queue, oldest first, that allocates only when it is made.
#[derive(Debug)]
pub(super) struct JointStates {
    waiting: VecDeque<JointSample>,
    free: Vec<JointSample>,
}

impl JointStates {
    pub fn new(joints: usize) -> Self {
        let empty = JointSample {
            stamp: Stamp::from_nanos(0),
            q: DVector::zeros(joints),
            qd: DVector::zeros(joints),
        };
        Self {
            waiting: VecDeque::with_capacity(CAPACITY),
            free: vec![empty; CAPACITY],
        }
    }

    pub fn push(&mut self, stamp: Stamp, q: &[f64], qd: &[f64]) {
        let slot = self.free.pop().or_else(|| self.waiting.pop_front());
        if let Some(mut sample) = slot {
            sample.stamp = stamp;
            sample.q.as_mut_slice().copy_from_slice(q);
            sample.qd.as_mut_slice().copy_from_slice(qd);
            self.waiting.push_back(sample);
        }
    }

    /// Takes the newest sample and drops the others.
    pub fn take_newest(&mut self) -> Option<JointSample> {
        let newest = self.waiting.pop_back();
        self.clear();
        newest
    }

    /// Takes the oldest sample with this stamp and drops those with earlier stamps; later ones stay.
    pub fn take_at(&mut self, stamp: Stamp) -> Option<JointSample> {
        while let Some(oldest) = self.waiting.front() {
            if oldest.stamp > stamp {
                return None;
            }
            let sample = self.waiting.pop_front()?;
            if sample.stamp == stamp {
                return Some(sample);
            }
            self.free.push(sample);
        }
        None
    }

    /// Returns a sample that was taken, so that its memory is reused.
    pub fn give_back(&mut self, sample: JointSample) {
        if self.free.len() + self.waiting.len() < CAPACITY {
            self.free.push(sample);
        }
    }

    pub fn clear(&mut self) {
        self.free.extend(self.waiting.drain(..));
    }
}
