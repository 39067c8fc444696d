//! Mean joint efforts between two states that are published in succession.

/// Mean joint effort per tick, computed from the time integral of the effort, whatever commands arrive within the tick:
/// mean effort times displacement is approximately the work.
#[derive(Debug, Clone)]
pub struct MeanEfforts {
    /// Joint efforts integrated since the last tick \[N m s or N s\].
    impulses: Vec<f64>,
    /// Means between the last two ticks \[N m or N\].
    means: Vec<f64>,
}

impl MeanEfforts {
    /// Zero efforts of a number of joints.
    pub fn new(joints: usize) -> Self {
        Self {
            impulses: vec![0.0; joints],
            means: vec![0.0; joints],
        }
    }

    /// Adds `efforts` \[N m or N\] that act for `seconds`.
    pub fn add(&mut self, efforts: &[f64], seconds: f64) {
        for (impulse, effort) in self.impulses.iter_mut().zip(efforts) {
            *impulse += effort * seconds;
        }
    }

    /// Adds the effort of one joint that acts for `seconds`.
    pub fn add_one(&mut self, joint: usize, effort: f64, seconds: f64) {
        self.impulses[joint] += effort * seconds;
    }

    /// Ends a tick that was `period` \[s\] long.
    pub fn finish_tick(&mut self, period: f64) {
        for (mean, impulse) in self.means.iter_mut().zip(&mut self.impulses) {
            *mean = *impulse / period;
            *impulse = 0.0;
        }
    }

    /// Means between the last two ticks \[N m or N\].
    pub fn means(&self) -> &[f64] {
        &self.means
    }

    /// Sets integrals and means to zero.
    pub fn reset(&mut self) {
        self.impulses.fill(0.0);
        self.means.fill(0.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_are_weighted_by_time_and_belong_to_one_tick() {
        let mut efforts = MeanEfforts::new(2);
        efforts.add(&[1.0, 0.0], 0.25);
        efforts.add(&[3.0, -2.0], 0.75);
        assert_eq!(efforts.means(), [0.0, 0.0]);
        efforts.finish_tick(1.0);
        assert_eq!(efforts.means(), [2.5, -1.5]);
        efforts.finish_tick(1.0);
        assert_eq!(efforts.means(), [0.0, 0.0]);
    }
}
