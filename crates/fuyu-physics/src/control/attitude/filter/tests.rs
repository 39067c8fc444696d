use super::*;
use crate::control::attitude::SimulatedGyro;
use rand::{RngExt, SeedableRng, rngs::StdRng};
use rand_distr::StandardNormal;
use std::collections::VecDeque;

const GYRO: GyroErrors = GyroErrors {
    angle_random_walk: 1e-4,
    rate_random_walk: 2e-5,
    initial_bias: 1e-3,
};

/// A motion with an angular velocity that changes in size and direction: attitude by small steps of the exponential.
struct Motion {
    R_WB: UnitQuaternion<f64>,
    time: f64,
}

impl Motion {
    fn rate(t: f64) -> Vector3<f64> {
        Vector3::new(
            0.03 * (0.3 * t).sin(),
            0.02 * (0.5 * t).cos(),
            -0.01 + 0.02 * (0.2 * t).sin(),
        )
    }

    fn advance_to(&mut self, time: f64) {
        let step = (time - self.time) / 8.0;
        for i in 0..8 {
            let w = Self::rate(self.time + (f64::from(i) + 0.5) * step);
            self.R_WB *= exp_so3(&(w * step));
        }
        self.time = time;
    }
}

/// 3.7 Hz, a tenth of the attitudes lost. Shown at 200 Hz, exposures fall between gyro samples of 50 Hz.
struct Tracker {
    waiting: VecDeque<(f64, UnitQuaternion<f64>)>,
    random: StdRng,
    next: f64,
}

impl Tracker {
    fn show(&mut self, time: f64, R_WB: &UnitQuaternion<f64>) {
        if time + 1e-9 < self.next {
            return;
        }
        self.next += 1.0 / 3.7;
        let mut normal = || self.random.sample::<f64, _>(StandardNormal) * 1e-4;
        let error = Vector3::new(normal(), normal(), normal());
        if self.random.random::<f64>() > 0.1 {
            self.waiting.push_back((time, R_WB * exp_so3(&error)));
        }
    }

    /// The oldest attitude that was exposed at `until` or before.
    fn deliver(&mut self, until: f64) -> Option<(f64, UnitQuaternion<f64>)> {
        let is_due = self
            .waiting
            .front()
            .is_some_and(|(exposed, _)| *exposed <= until + 1e-9);
        is_due.then(|| self.waiting.pop_front()).flatten()
    }
}

struct Run {
    filter: AttitudeFilter,
    /// Normalized squared errors of attitude and bias, one per second.
    normalized: Vec<f64>,
    attitude_error: Vec<f64>,
}

/// A run of `seconds` with gyro samples every 20 ms. `said` are the errors that the filter assumes.
fn run(seed: u64, seconds: usize, latency: f64, said: GyroErrors) -> Run {
    let config = AttitudeFilterConfig::new(said, 1e-4);
    let mut filter = AttitudeFilter::new(config).unwrap();
    let mut gyro = SimulatedGyro::new(GYRO, seed);
    let mut tracker = Tracker {
        waiting: VecDeque::new(),
        random: StdRng::seed_from_u64(seed + 1_000_000),
        next: 0.0,
    };
    let mut motion = Motion {
        R_WB: UnitQuaternion::from_euler_angles(2.0, -1.0, 0.5),
        time: 0.0,
    };
    let (mut normalized, mut attitude_error) = (Vec::new(), Vec::new());
    for k in 0..=seconds * 200 {
        let time = k as f64 * 0.005;
        motion.advance_to(time);
        tracker.show(time, &motion.R_WB);
        if k % 4 == 0 {
            let w = gyro.sample(&Motion::rate(time), 0.02);
            filter.add_gyro(Stamp::from_secs_f64(time), w).unwrap();
        }
        while let Some((exposed, R_WB)) = tracker.deliver(time - latency) {
            let stamp = Stamp::from_secs_f64(exposed);
            let used = filter.add_star_tracker(stamp, &R_WB).unwrap();
            let is_right = !matches!(used, StarTrackerUse::TooOld | StarTrackerUse::Outlier);
            assert!(is_right || said != GYRO, "{used:?}");
        }
        if k % 200 == 0 && k > 0 {
            let estimate = filter.estimate(Stamp::from_secs_f64(time)).unwrap();
            // The first measurements may be lost or on their way.
            assert!(estimate.attitude_known || time < 2.5);
            if !estimate.attitude_known {
                continue;
            }
            let turn = (estimate.R_WB.inverse() * motion.R_WB).scaled_axis();
            let bias = gyro.bias() - estimate.bias;
            let error = nalgebra::Vector6::new(turn.x, turn.y, turn.z, bias.x, bias.y, bias.z);
            let inverse = estimate.covariance.try_inverse().unwrap();
            normalized.push(error.dot(&(inverse * error)));
            attitude_error.push(turn.norm_squared());
        }
    }
    Run {
        filter,
        normalized,
        attitude_error,
    }
}

/// Mean over runs and seconds of the normalized squared error, which has six degrees of freedom, after `skip` seconds.
fn mean_normalized(latency: f64, said: GyroErrors, seconds: usize, skip: usize) -> f64 {
    let (mut sum, mut count) = (0.0, 0);
    for seed in 0..150 {
        let run = run(seed, seconds, latency, said);
        sum += run.normalized[skip..].iter().sum::<f64>();
        count += run.normalized.len() - skip;
    }
    sum / count as f64
}

// 150 runs: the mean over independent runs at one time has the standard deviation sqrt(12 / 150) = .28, and the mean
// over correlated seconds less. A filter that ignores latency, or has a wrong sign in the coupling of bias and
// attitude, is off by an order of magnitude.
#[test]
fn the_covariance_is_honest_from_the_start_to_the_steady_state() {
    for (latency, name) in [(0.0, "no latency"), (0.33, "latency .33 s")] {
        let first = mean_normalized(latency, GYRO, 3, 0);
        let later = mean_normalized(latency, GYRO, 60, 20);
        println!(
            "{name}: normalized squared error {first:.3} at first, {later:.3} later; 6 is right"
        );
        assert!((first - 6.0).abs() < 0.7, "{name}: {first}");
        assert!((later - 6.0).abs() < 0.4, "{name}: {later}");
    }
    // The test can tell: said to be three times as good, the gyro makes the filter overconfident.
    let better = GyroErrors {
        angle_random_walk: GYRO.angle_random_walk / 3.0,
        rate_random_walk: GYRO.rate_random_walk / 3.0,
        ..GYRO
    };
    let overconfident = mean_normalized(0.33, better, 60, 20);
    assert!(overconfident > 12.0, "{overconfident}");
}

// A late measurement corrects the past: after the same measurements the estimate is that without latency, to rounding.
#[test]
fn latency_changes_nothing_once_measurements_have_arrived() {
    let config = AttitudeFilterConfig::new(GYRO, 1e-4);
    let mut filters = [(); 2].map(|()| AttitudeFilter::new(config).unwrap());
    let mut motion = Motion {
        R_WB: UnitQuaternion::identity(),
        time: 0.0,
    };
    let mut frames = Vec::new();
    for k in 0..=500 {
        let time = f64::from(k) * 0.02;
        motion.advance_to(time);
        let stamp = Stamp::from_secs_f64(time);
        for filter in &mut filters {
            filter
                .add_gyro(stamp, Motion::rate(time) + Vector3::x() * 1e-3)
                .unwrap();
        }
        if k % 10 == 0 {
            frames.push((stamp, motion.R_WB));
            filters[0].add_star_tracker(stamp, &motion.R_WB).unwrap();
        }
        // Two at a time, up to 1 s late.
        if k % 20 == 19 {
            for (stamp, R_WB) in frames.drain(..) {
                filters[1].add_star_tracker(stamp, &R_WB).unwrap();
            }
        }
    }
    for (stamp, R_WB) in frames {
        filters[1].add_star_tracker(stamp, &R_WB).unwrap();
    }
    let now = Stamp::from_secs_f64(10.0);
    let [a, b] = filters.map(|filter| filter.estimate(now).unwrap());
    assert!(a.R_WB.angle_to(&b.R_WB) < 1e-13);
    assert!((a.bias - b.bias).norm() < 1e-14);
    assert!((a.covariance - b.covariance).amax() < 1e-15);
    // The bias has been found, and the attitude is right. The filter's trust in its noise model limits how well.
    assert!((b.bias - Vector3::x() * 1e-3).norm() < 1e-5, "{}", b.bias);
    assert!(b.R_WB.angle_to(&motion.R_WB) < 1e-5);
}

// Without a star tracker the attitude drifts with the gyro, and its covariance grows as the error model says:
// sigma_b² t² + sigma_v² t + sigma_u² t³/3 for an axis.
#[test]
fn without_star_tracker_the_covariance_grows() {
    let config = AttitudeFilterConfig::new(GYRO, 1e-4);
    let mut filter = AttitudeFilter::new(config).unwrap();
    let stamp = |t: f64| Stamp::from_secs_f64(t);
    filter.add_gyro(stamp(0.0), Vector3::zeros()).unwrap();
    let started = filter.add_star_tracker(stamp(0.0), &UnitQuaternion::identity());
    assert_eq!(started, Ok(StarTrackerUse::Started));
    for k in 1..=1000 {
        filter
            .add_gyro(stamp(f64::from(k) * 0.01), Vector3::zeros())
            .unwrap();
    }
    let estimate = filter.estimate(stamp(10.0)).unwrap();
    let expected = 1e-8 + 1e-6 * 100.0 + 1e-8 * 10.0 + 4e-10 * 1000.0 / 3.0;
    let found = estimate.attitude_deviation().powi(2);
    assert!((found / expected - 1.0).abs() < 1e-9, "{found} {expected}");
    assert!(estimate.attitude_known);
}

#[test]
fn outliers_are_left_out_until_there_are_many() {
    let mut run = run(7, 20, 0.0, GYRO);
    let newest = run.filter.newest_gyro().unwrap().as_secs_f64();
    let before = run.filter.estimate(Stamp::from_secs_f64(newest)).unwrap();
    assert!(run.attitude_error.iter().all(|e| *e < 1e-6));
    let wrong = before.R_WB * exp_so3(&Vector3::new(0.1, 0.0, 0.0));
    for k in 1..=5 {
        let time = newest + 0.1 * f64::from(k);
        let stamp = Stamp::from_secs_f64(time);
        run.filter.add_gyro(stamp, before.bias).unwrap();
        let used = run.filter.add_star_tracker(stamp, &wrong).unwrap();
        let expected = match k {
            5 => StarTrackerUse::Started,
            _ => StarTrackerUse::Outlier,
        };
        assert_eq!(used, expected, "{k}");
    }
    assert_eq!(run.filter.outliers(), 5);
    let now = run.filter.newest_gyro().unwrap();
    assert!(run.filter.estimate(now).unwrap().R_WB.angle_to(&wrong) < 1e-12);
}

#[test]
fn gaps_restarts_order_and_wrong_values() {
    let config = AttitudeFilterConfig::new(GYRO, 1e-4);
    let mut filter = AttitudeFilter::new(config).unwrap();
    let stamp = |t: f64| Stamp::from_secs_f64(t);
    let one = UnitQuaternion::identity();
    assert!(filter.estimate(stamp(0.0)).is_none());
    // A measurement ahead of the gyro waits for it.
    assert_eq!(
        filter.add_star_tracker(stamp(0.05), &one),
        Ok(StarTrackerUse::Waiting)
    );
    assert_eq!(filter.add_gyro(stamp(0.0), Vector3::zeros()), Ok(None));
    assert!(!filter.estimate(stamp(0.0)).unwrap().attitude_known);
    let used = filter.add_gyro(stamp(0.1), Vector3::zeros());
    assert_eq!(used, Ok(Some(StarTrackerUse::Started)));
    // One that is not newer than the last, and one that is older than the history.
    assert_eq!(
        filter.add_star_tracker(stamp(0.05), &one),
        Ok(StarTrackerUse::TooOld)
    );
    assert_eq!(
        filter.add_star_tracker(stamp(0.02), &one),
        Ok(StarTrackerUse::TooOld)
    );
    // A gap loses the attitude, not the bias.
    filter.add_gyro(stamp(0.7), Vector3::zeros()).unwrap();
    let estimate = filter.estimate(stamp(0.7)).unwrap();
    assert!(!estimate.attitude_known && estimate.attitude_deviation() > 3.0);
    assert!(estimate.covariance[(3, 3)] < 1.1e-6);
    assert_eq!(
        filter.add_star_tracker(stamp(0.3), &one),
        Ok(StarTrackerUse::TooOld)
    );
    assert_eq!(
        filter.add_star_tracker(stamp(0.7), &one),
        Ok(StarTrackerUse::Started)
    );
    // Time that jumps back is another run.
    filter.add_gyro(stamp(0.2), Vector3::zeros()).unwrap();
    assert!(!filter.estimate(stamp(0.2)).unwrap().attitude_known);
    let error = filter.add_gyro(stamp(0.3), Vector3::new(0.0, f64::NAN, 0.0));
    let text = error.unwrap_err().to_string();
    assert_eq!(text, "angular_velocity.y is NaN; it must be finite");
    let wrong =
        UnitQuaternion::new_unchecked(nalgebra::Quaternion::new(f64::INFINITY, 0.0, 0.0, 0.0));
    let text = filter
        .add_star_tracker(stamp(0.2), &wrong)
        .unwrap_err()
        .to_string();
    assert_eq!(text, "quaternion.w is inf; it must be finite");
    let mut config = config;
    config.star_tracker_noise = 0.0;
    let text = AttitudeFilter::new(config).unwrap_err().to_string();
    assert_eq!(
        text,
        "star_tracker_noise [rad] is 0; it must be positive and finite"
    );
}

// Would break if a wrong stamp kept all later measurements out.
#[test]
fn measurements_from_the_future_are_refused() {
    let mut filter = AttitudeFilter::new(AttitudeFilterConfig::new(GYRO, 1e-4)).unwrap();
    let at = Stamp::from_secs_f64;
    let one = UnitQuaternion::identity();
    // Before the first gyro sample nothing is known about time.
    let used = filter.add_star_tracker(at(1e6), &one);
    assert_eq!(used, Ok(StarTrackerUse::Waiting));
    filter.add_gyro(at(0.0), Vector3::zeros()).unwrap();
    let used = filter.add_star_tracker(at(0.05), &one);
    assert_eq!(used, Ok(StarTrackerUse::Waiting));
    let used = filter.add_gyro(at(0.1), Vector3::zeros());
    assert_eq!(used, Ok(Some(StarTrackerUse::Started)));
    let used = filter.add_star_tracker(at(0.7), &one);
    assert_eq!(used, Ok(StarTrackerUse::TooNew));
    let used = filter.add_star_tracker(at(0.5), &one);
    assert_eq!(used, Ok(StarTrackerUse::Waiting));
}
