//! The recursive filter between batch solutions.

use fuyu::estimation::bundle::{Options, estimate};
use fuyu::estimation::filter::Filter;
use fuyu::estimation::{FeatureFrame, Tracks};
use nalgebra::{UnitQuaternion, Vector3};

use crate::tumbling::{Motion, View, prediction_errors};

/// A batch over the first 120 s, then the filter alone. Its errors in angular velocity must be what its covariance
/// says: the normalised squared error (NEES) of three components is 3 on average. A filter that ignored the inertia's
/// error would be far above, one that forgot to reduce its covariance far below.
#[test]
fn the_filter_tracks_and_knows_how_well() {
    let (mut sum, mut count) = (0.0, 0);
    for seed in 1..=8 {
        let motion = Motion::new(0.6, 0.0, 0.3, 0.8, Vector3::z());
        let view = View {
            seed,
            duration: 180.0,
            ..View::chapter_3(1024)
        };
        let tracks = view.tracks(&motion, &view.sphere());
        let (batch, rest) = tracks.frames().split_at(200);
        let batch = Tracks::new(batch.to_vec()).unwrap();
        // With torques as in orbit the filter would know less after the batch than at its end.
        let solution = estimate(&batch, &view.camera, &Options::undisturbed()).unwrap();
        let mut filter = Filter::new(&solution, 0.0).unwrap();
        let (_, before) = filter.angular_velocity();
        for (i, frame) in rest.iter().enumerate() {
            let update = filter.update(frame, &UnitQuaternion::identity());
            assert_eq!((update.used, update.rejected, update.unknown), (20, 0, 0));
            assert!(update.rms < 0.5, "{}", update.rms);
            if i % 20 == 19 {
                let (w, spread) = filter.angular_velocity();
                let near = motion.attitudes(&[frame.time - 1e-3, frame.time + 1e-3]);
                let truth = (near[1] * near[0].inverse()).scaled_axis() / 2e-3;
                let off = w - truth;
                sum += off.dot(&(spread.try_inverse().unwrap() * off));
                count += 1;
            }
        }
        let (_, after) = filter.angular_velocity();
        assert!(after.trace() < 0.7 * before.trace());
        let estimate = filter.estimate().unwrap();
        let phi = prediction_errors(&motion, 180.0, |t| estimate.attitude(t)).1;
        assert!(phi < 0.03, "{phi}");
        let J = estimate.J().unwrap();
        let deviation = estimate.covariance().unwrap()[(2, 2)].sqrt();
        assert!(
            (J.z - motion.J.z).abs() < 5.0 * deviation,
            "{} {deviation}",
            J.z - motion.J.z
        );
    }
    let nees = sum / f64::from(count);
    assert!((1.0..6.0).contains(&nees), "{nees}");
}

#[test]
fn wrong_points_unknown_points_and_gaps_do_not_lose_it() {
    let motion = Motion::new(0.5, 0.0, -0.4, 0.8, Vector3::z());
    let view = View {
        duration: 180.0,
        ..View::chapter_3(1024)
    };
    let spoilt = View {
        outliers: 0.15,
        gap: Some((130.0, 150.0)),
        ..view.clone()
    };
    let batch = view.tracks(&motion, &view.sphere());
    let batch = Tracks::new(batch.frames()[..200].to_vec()).unwrap();
    let solution = estimate(&batch, &view.camera, &Options::default()).unwrap();
    let mut filter = Filter::new(&solution, 1e-6).unwrap();
    let (mut frames, mut rejected, mut unknown) = (0, 0, 0);
    for frame in spoilt.tracks(&motion, &view.sphere()).frames() {
        if frame.time <= filter.time() {
            continue;
        }
        let mut features = frame.features.clone();
        features[3].id = 99;
        let update = filter.update(
            &FeatureFrame::new(frame.time, features),
            &UnitQuaternion::identity(),
        );
        frames += 1;
        rejected += update.rejected;
        unknown += update.unknown;
    }
    // 19 known points a frame, 15 % of them wrong.
    assert!(frames > 60);
    assert!((130..260).contains(&rejected), "{rejected}");
    assert_eq!(unknown, frames);
    let estimate = filter.estimate().unwrap();
    let phi = prediction_errors(&motion, 180.0, |t| estimate.attitude(t)).1;
    assert!(phi < 0.05, "{phi}");
    // A frame without points carries the state and says so.
    let empty = filter.update(
        &FeatureFrame::new(181.0, Vec::new()),
        &UnitQuaternion::identity(),
    );
    assert_eq!((empty.used, filter.time()), (0, 181.0));
}

/// Errors between two batch solutions, the first of 12 s, with the filter and by that solution alone: root mean squares of the
/// angular velocity's \[rad/s\] and of the attitude's over the 10 s after the next \[deg\].
fn between_solutions(gap: Option<(f64, f64)>) -> ([f64; 2], [f64; 2]) {
    let (mut rates, mut turns, mut count) = ([0.0; 2], [0.0; 2], 0.0);
    for seed in 1..=6 {
        let motion = Motion::new(0.6, 0.0, 0.3, 0.8, Vector3::z());
        let view = View {
            seed,
            gap,
            interval: 0.1,
            duration: 30.0,
            ..View::chapter_3(512)
        };
        let tracks = view.tracks(&motion, &view.sphere());
        let until = tracks.frames().partition_point(|s| s.time <= 12.0);
        let (batch, rest) = tracks.frames().split_at(until);
        let batch = Tracks::new(batch.to_vec()).unwrap();
        let solution = estimate(&batch, &view.camera, &Options::default()).unwrap();
        let mut filter = Filter::new(&solution, 1e-6).unwrap();
        for frame in rest {
            let update = filter.update(frame, &UnitQuaternion::identity());
            assert_eq!(update.used, 20, "{update:?} at {} s", frame.time);
            let near = motion.attitudes(&[frame.time - 1e-3, frame.time + 1e-3]);
            let truth = (near[1] * near[0].inverse()).scaled_axis() / 2e-3;
            rates[0] += (filter.angular_velocity().0 - truth).norm_squared();
            rates[1] += (solution.motion.angular_velocity(frame.time) - truth).norm_squared();
            count += 1.0;
        }
        let filtered = filter.estimate().unwrap();
        let (theta, _) = prediction_errors(&motion, 30.0, |t| filtered.attitude(t));
        turns[0] += theta * theta / 6.0;
        let (theta, _) = prediction_errors(&motion, 30.0, |t| solution.motion.attitude(t));
        turns[1] += theta * theta / 6.0;
    }
    (
        rates.map(|square| f64::sqrt(square / count)),
        turns.map(f64::sqrt),
    )
}

// Fails when the filter weighs frames wrongly, ignores them, or is led astray by the first ones after a gap.
#[test]
fn between_solutions_the_filter_knows_more_than_the_last_solution() {
    for gap in [None, Some((22.0, 27.0))] {
        let (rates, turns) = between_solutions(gap);
        println!("gap {gap:?}: w {rates:?} rad/s, attitude {turns:?} deg");
        assert!(rates[0] < 0.8 * rates[1], "{gap:?}: {rates:?}");
        assert!(turns[0] < 0.6 * turns[1], "{gap:?}: {turns:?}");
    }
}

// Foresight is on the safe side, for it takes the points' common error as one of the attitude; but it is no more than
// ten times what the next 30 s turn out to be wrong by.
#[test]
fn foresight_covers_what_predictions_err_by() {
    let (mut squares, mut expected) = (0.0, 0.0);
    for seed in 1..=8 {
        let motion = Motion::new(0.6, 0.0, 0.3, 0.8, Vector3::z());
        let view = View {
            seed,
            duration: 60.0,
            ..View::chapter_3(1024)
        };
        let tracks = view.tracks(&motion, &view.sphere());
        let solution = estimate(&tracks, &view.camera, &Options::default()).unwrap();
        let filter = Filter::new(&solution, 0.0).unwrap();
        let turn = |R: &dyn Fn(f64) -> UnitQuaternion<f64>| R(90.0) * R(60.0).inverse();
        let truth = turn(&|t| motion.attitudes(&[t])[0]);
        squares += turn(&|t| solution.motion.attitude(t))
            .angle_to(&truth)
            .powi(2);
        expected += filter.prediction_deviation(30.0).powi(2);
    }
    let ratio = f64::sqrt(squares / expected);
    assert!((0.1..1.5).contains(&ratio), "{ratio}");
}

// A body that is pushed is no longer where the filter expects it, and its frames are refused.
#[test]
fn a_push_shows_in_what_is_rejected() {
    let motion = Motion::new(0.5, 0.0, -0.4, 0.8, Vector3::z());
    let pushed = Motion {
        w_B: motion.w_B * 1.3,
        ..motion
    };
    let view = View {
        duration: 150.0,
        ..View::chapter_3(1024)
    };
    let before = view.tracks(&motion, &view.sphere());
    let after = view.tracks(&pushed, &view.sphere());
    let batch = Tracks::new(before.frames()[..200].to_vec()).unwrap();
    let solution = estimate(&batch, &view.camera, &Options::default()).unwrap();
    let mut filter = Filter::new(&solution, 1e-6).unwrap();
    let updates = after.frames()[200..].iter();
    let updates: Vec<_> = updates
        .map(|frame| filter.update(frame, &UnitQuaternion::identity()))
        .collect();
    let refused = updates.iter().filter(|u| 2 * u.used < 20).count();
    assert!(refused * 10 > updates.len() * 9, "{refused}");
}
