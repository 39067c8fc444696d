//! Consistency of the covariance of bundle adjustment with its errors: random bodies, cameras and defects of tracks.

use fuyu::estimation::bundle::{Options, estimate};
use fuyu::estimation::filter::Filter;
use fuyu::estimation::{EstimateError, Feature, FeatureFrame, Tracks};
use fuyu::vision::Pinhole;
use nalgebra::{UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng, rngs::StdRng};

use crate::tumbling::{Motion, View, prediction_errors};

/// A random problem: what is seen, how the body moves, and the error of the given focal length.
fn problem(seed: u64) -> (View, Motion, f64) {
    let mut rng = StdRng::seed_from_u64(seed);
    let mut random = |low: f64, high: f64| rng.random_range(low..high);
    let (e, s) = (random(0.3, 1.0), random(-1.0, 1.0));
    let s_alpha = random(-1.0, 1.0);
    let duration = [20.0, 30.0, 60.0][random(0.0, 2.99) as usize];
    let interval = duration / [60.0, 150.0, 250.0][random(0.0, 2.99) as usize];
    // At most half a radian per frame, and more than one radian over the whole observation.
    let rate = random(1.0 / duration, (0.5 / interval).min(0.8));
    let direction = Vector3::new(random(-1.0, 1.0), random(-1.0, 1.0), random(-1.0, 1.0));
    let motion = Motion::new(e, s, s_alpha, rate * rate, direction.normalize());
    let occlusion = random(0.0, 1.0) < 0.4;
    let view = View {
        duration,
        interval,
        points: random(if occlusion { 30.0 } else { 12.0 }, 40.0) as usize,
        noise: [0.0, 0.3, 1.0][random(0.0, 2.99) as usize],
        outliers: [0.0, 0.02, 0.1][random(0.0, 2.99) as usize],
        dropped: [0.0, 0.3][random(0.0, 1.99) as usize],
        lifetime: (random(0.0, 1.0) < 0.3).then_some(40.0),
        distance: random(2.0, 6.0),
        occlusion,
        seed,
        ..View::chapter_3(1024)
    };
    let focal = [0.0, 0.01, -0.01, 0.0][random(0.0, 3.99) as usize];
    (view, motion, focal)
}

/// The normalised squared error (NEES) of the predicted turn after the observation, a quarter as long as it: of three
/// components, so 3 on average if the covariance is right.
fn nees(seed: u64, estimate_focal_length: bool) -> Result<f64, EstimateError> {
    let (view, motion, focal) = problem(seed);
    let tracks = view.tracks(&motion, &view.sphere());
    let camera = Pinhole {
        fx: view.camera.fx * (1.0 + focal),
        fy: view.camera.fy * (1.0 + focal),
        ..view.camera
    };
    let options = match estimate_focal_length {
        true => Options::default(),
        false => Options::undisturbed(),
    };
    let solution = estimate(&tracks, &camera, &options)?;
    let times = [view.duration, 1.25 * view.duration];
    let truth = motion.attitudes(&times);
    let turn = |R: [UnitQuaternion<f64>; 2]| R[1] * R[0].inverse();
    let ours = turn(times.map(|t| solution.motion.attitude(t)));
    let error = (ours * turn([truth[0], truth[1]]).inverse()).scaled_axis();
    let covariance = solution.turn_covariance(times[0], times[1]);
    let inverse = covariance.try_inverse().unwrap();
    Ok(error.dot(&(inverse * error)))
}

/// Normalised squared errors of the solved problems. Refused problems are left out, but three quarters must be solved.
fn values(seeds: std::ops::Range<u64>, estimate_focal_length: bool) -> Vec<f64> {
    let all = seeds.end - seeds.start;
    let each = seeds.filter_map(|seed| match nees(seed, estimate_focal_length) {
        Ok(nees) => Some(nees),
        Err(e) => {
            println!("{seed}: {e}");
            None
        }
    });
    let mut values: Vec<f64> = each.collect();
    assert!(
        4 * values.len() as u64 >= 3 * all,
        "{} of {all}",
        values.len()
    );
    values.sort_by(f64::total_cmp);
    println!("{values:.1?}");
    values
}

#[test]
fn it_is_as_sure_as_it_is_right() {
    let values = values(0..40, true);
    let median = values[values.len() / 2];
    // The median of a consistent covariance is 2.4. It was ten times as large when the noise was underestimated and
    // residuals were trimmed at six times that noise.
    assert!((0.5..6.0).contains(&median), "{median}");
    // Six standard deviations in one of the three components.
    assert!(values[values.len() - 1] < 36.0, "{values:.1?}");
}

/// A focal length that is wrong by 1 % and not estimated causes an error that more frames do not reduce.
#[test]
fn a_wrong_focal_length_makes_it_less_sure() {
    let values = values(0..40, false);
    // Nine standard deviations. It is said to be exact, so this is the estimator's answer to a wrong input; by default it is
    // estimated, and the same problems are within the limits of the test above.
    assert!(values[values.len() - 1] < 81.0, "{values:.1?}");
}

/// Like the first batches of the servicing scenario: a slow body nine radii away, seen for some seconds at 10 Hz. In
/// most of these, an adjustment from a single initial guess gave rates wrong by 0.1 rad/s, although its residuals were
/// no larger than the rounding of pixels.
#[test]
fn a_short_turn_seen_from_afar_is_known_or_refused() {
    let mut solved = 0;
    for duration in [0.9, 2.0, 3.0, 4.0] {
        for seed in 1..=6 {
            let motion = Motion {
                J: Vector3::new(1.0, 0.8, 0.6),
                alpha: 0.0,
                w_B: Vector3::new(0.04, 0.05, 0.12),
                R_WB: UnitQuaternion::from_scaled_axis(Vector3::new(
                    0.3 * seed as f64,
                    1.0 - 0.4 * seed as f64,
                    0.5,
                )),
            };
            let view = View {
                camera: Pinhole::square(1024, 1.0),
                duration,
                interval: 0.1,
                distance: 9.0,
                seed,
                ..View::chapter_3(1024)
            };
            let tracks = view.tracks(&motion, &view.sphere());
            let solution = match estimate(&tracks, &view.camera, &Options::default()) {
                Ok(solution) => solution,
                Err(EstimateError::Ambiguous { .. } | EstimateError::NotFree { .. }) => continue,
                Err(e) => panic!("{duration} s, seed {seed}: {e}"),
            };
            let (w, spread) = Filter::new(&solution, 0.0).unwrap().angular_velocity();
            let R = motion.attitudes(&[duration - 1e-3, duration]);
            let truth = (R[1] * R[0].inverse()).scaled_axis() / 1e-3;
            let (off, deviation) = ((w - truth).norm(), spread.trace().sqrt());
            assert!(
                off < 5.0 * deviation,
                "{duration} s, seed {seed}: {off} {deviation}"
            );
            solved += 1;
        }
    }
    assert!(solved >= 16, "{solved} of 24");
}

/// Two radians are not a short rotation. But from a distance of eight radii, with the far side hidden, an adjustment
/// from a single initial guess may give a motion whose prediction over another half of the observation is wrong by 80
/// degrees, with a standard deviation of 3 degrees.
#[test]
fn two_radians_seen_from_afar_are_known_or_refused() {
    let (mut solved, mut off) = (0, Vec::new());
    for seed in 0..12 {
        let motion = Motion::new(0.58, -0.51, -0.88, 0.074, Vector3::new(0.3, -0.5, 0.8));
        let view = View {
            camera: Pinhole::square(256, 0.38),
            points: 36,
            duration: 8.0,
            interval: 1.0 / 15.0,
            distance: 7.8,
            dropped: 0.3,
            occlusion: true,
            seed,
            ..View::chapter_3(256)
        };
        // An elongated body.
        let points = (view.sphere().iter())
            .map(|p| Vector3::new(0.15 * p.x, 0.15 * p.y, p.z))
            .collect::<Vec<_>>();
        let tracks = view.tracks(&motion, &points);
        let Ok(solution) = estimate(&tracks, &view.camera, &Options::default()) else {
            continue;
        };
        solved += 1;
        let times = [view.duration, 1.5 * view.duration];
        let truth = motion.attitudes(&times);
        let ours = times.map(|t| solution.motion.attitude(t));
        let error = (ours[1] * ours[0].inverse()).angle_to(&(truth[1] * truth[0].inverse()));
        let reported = solution.turn_covariance(times[0], times[1]).trace().sqrt();
        println!(
            "{seed}: {:.2} deg, {:.2} reported",
            error.to_degrees(),
            reported.to_degrees()
        );
        off.push(error / reported);
    }
    assert!(solved >= 6, "{solved} of 12");
    assert!(off.iter().all(|off| *off < 6.0), "{off:.1?}");
}

/// A tracker that reuses the ids of lost points: at every fortieth image point on average, or for all points at once.
#[test]
fn ids_given_to_other_points_are_told_apart() {
    let view = View {
        duration: 30.0,
        interval: 0.1,
        points: 60,
        ..View::chapter_3(1024)
    };
    let motion = Motion::new(0.6, 0.0, 0.3, 0.1, Vector3::z());
    let full = view.tracks(&motion, &view.sphere());
    let half = full.frames().len() / 2;
    for gradually in [true, false] {
        let mut rng = StdRng::seed_from_u64(3);
        let mut shown: Vec<u64> = (0..20).collect();
        let sightings = full.frames().iter().enumerate().map(|(i, sighting)| {
            for k in 0..20 {
                let lost = gradually && rng.random_range(0.0..1.0) < 1.0 / 40.0;
                let other = rng.random_range(0..60);
                if lost && !shown.contains(&other) {
                    shown[k] = other;
                }
            }
            if !gradually && i == half {
                shown = (20..40).collect();
            }
            let features = shown.iter().zip(0..).filter_map(|(point, id)| {
                let seen = sighting.feature(*point)?;
                Some(Feature { id, ..*seen })
            });
            FeatureFrame::new(sighting.time, features.collect())
        });
        let tracks = Tracks::new(sightings).unwrap();
        let solution = estimate(&tracks, &view.camera, &Options::default()).unwrap();
        let (_, phi) = prediction_errors(&motion, 30.0, |t| solution.motion.attitude(t));
        assert!(phi < 0.3, "{gradually}: {phi}");
        // Each id stands for one point, the one that has it now.
        let mut ids: Vec<u64> = solution.points.iter().map(|p| p.id).collect();
        ids.sort_unstable();
        ids.dedup();
        assert_eq!(ids.len(), solution.points.len());
    }
}
