//! Detection of a change of the motion from the innovations of the filter.
//!
//! Two tests use the innovations, normalised to unit covariance. Page's cumulative sum of their squares detects large changes
//! within some frames. An exponentially weighted mean detects small changes: after a push the attitude drifts away from the
//! prediction in a constant direction, while noise changes its sign from frame to frame. Errors of the body's structure are
//! also the same from frame to frame; so both tests are relative to the earlier level of the innovations.

use nalgebra::Vector3;

/// Allowance of the cumulative sum per frame, in units of the level.
const ALLOWANCE: f64 = 1.0;

/// Value of the cumulative sum above which the motion has changed.
const SUM_LIMIT: f64 = 30.0;

/// Weight of a frame in the mean; and the squared mean over its variance above which the motion has changed. A
/// chi-squared variable of three degrees of freedom exceeds this limit with a probability of 1e-8.
const WEIGHT: f64 = 0.08;
const MEAN_LIMIT: f64 = 40.0;

/// Weight of a frame in the running levels.
const LEVEL_WEIGHT: f64 = 0.002;

/// A squared innovation is clipped to this many times the level before it updates the level.
const CLIP: f64 = 4.0;

/// Number of frames before the first alarm.
const WARM_UP: u32 = 20;

/// Detects a change of the motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ChangeDetector {
    /// Running mean square of an innovation's component.
    level: f64,
    /// Running mean square of a component of the weighted mean, over its variance for independent innovations.
    mean_level: f64,
    sum: f64,
    mean: Vector3<f64>,
    frames: u32,
    /// Last time at which both the cumulative sum and the weighted mean were small \[s\].
    quiet: f64,
}

impl ChangeDetector {
    /// A detector that starts at `time` \[s\].
    pub fn new(time: f64) -> Self {
        Self {
            level: 1.0,
            mean_level: 1.0,
            sum: 0.0,
            mean: Vector3::zeros(),
            frames: 0,
            quiet: time,
        }
    }

    /// Adds the innovation of a frame, in inertial axes, normalised to unit covariance. If the motion has changed,
    /// returns the time since when \[s\].
    pub fn add(&mut self, time: f64, innovation: &Vector3<f64>) -> Option<f64> {
        self.frames = self.frames.saturating_add(1);
        let square = innovation.norm_squared() / 3.0;
        self.sum = (self.sum + square / self.level - 1.0 - ALLOWANCE).max(0.0);
        self.mean = self.mean * (1.0 - WEIGHT) + innovation * WEIGHT;
        let variance = WEIGHT / (2.0 - WEIGHT) * self.level;
        let drift = self.mean.norm_squared() / variance;
        let alarm = self.sum > SUM_LIMIT || drift > MEAN_LIMIT * self.mean_level;
        if drift < 4.0 * self.mean_level && self.sum < 1.0 {
            self.quiet = time;
        }
        if alarm && self.frames > WARM_UP {
            return Some(self.quiet);
        }
        let follow = |level: f64, value: f64| {
            let clipped = value.min(CLIP * level);
            // Never below the expected value for pure noise.
            (level + LEVEL_WEIGHT * (clipped - level)).max(1.0)
        };
        self.level = follow(self.level, square);
        self.mean_level = follow(self.mean_level, drift / 3.0);
        None
    }

    /// Takes over the counts of a detector that has seen the same frames with an earlier solution, so that a change
    /// about to be detected is not forgotten.
    pub fn inherit(&mut self, before: &Self) {
        self.frames = self.frames.max(before.frames);
        self.level = self.level.max(before.level);
        self.mean_level = self.mean_level.max(before.mean_level);
        if before.sum > self.sum {
            self.sum = before.sum;
            self.quiet = self.quiet.min(before.quiet);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng, rngs::StdRng};
    use rand_distr::StandardNormal;

    fn noise(rng: &mut StdRng) -> Vector3<f64> {
        Vector3::from_fn(|_, _| rng.sample(StandardNormal))
    }

    #[test]
    fn noise_gives_no_alarm_and_a_drift_gives_one() {
        let mut rng = StdRng::seed_from_u64(5);
        let mut detector = ChangeDetector::new(0.0);
        for k in 0..200_000 {
            assert_eq!(
                detector.add(0.1 * f64::from(k), &noise(&mut rng)),
                None,
                "{k}"
            );
        }
        let drift = Vector3::new(0.0, 1.5, 0.0);
        let found = (0..60).find_map(|k| {
            let time = 20_000.0 + 0.1 * f64::from(k);
            detector
                .add(time, &(noise(&mut rng) + drift))
                .map(|since| (k, since))
        });
        let (frames, since) = found.unwrap();
        assert!(
            frames < 50 && (since - 20_000.0).abs() < 2.0,
            "{frames} {since}"
        );
    }

    #[test]
    fn a_jump_is_found_within_some_frames() {
        let mut detector = ChangeDetector::new(0.0);
        let mut rng = StdRng::seed_from_u64(6);
        for k in 0..100 {
            detector.add(0.1 * f64::from(k), &noise(&mut rng));
        }
        let jump = Vector3::new(6.0, 0.0, 0.0);
        let frames = (0..20).find(|k| detector.add(10.0 + 0.1 * f64::from(*k), &jump).is_some());
        assert!(frames.unwrap() < 5, "{frames:?}");
    }

    /// If the count restarted with every batch solution, a change would not be detected.
    #[test]
    fn a_new_solution_inherits_what_has_been_counted() {
        let mut before = ChangeDetector::new(0.0);
        let jump = Vector3::new(5.0, 0.0, 0.0);
        for k in 0..60 {
            before.add(0.1 * f64::from(k), &Vector3::new(0.3, 0.0, 0.0));
        }
        before.add(6.0, &jump);
        let mut next = ChangeDetector::new(6.0);
        next.inherit(&before);
        let frames = (1..20).find(|k| next.add(6.0 + 0.1 * f64::from(*k), &jump).is_some());
        let own = {
            let mut fresh = before;
            (1..20).find(|k| fresh.add(6.0 + 0.1 * f64::from(*k), &jump).is_some())
        };
        assert!(
            frames.is_some() && frames <= own.map(|k| k + 2),
            "{frames:?} {own:?}"
        );
    }
}
