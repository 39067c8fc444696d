//! The recursive filter between batch solutions.

use fuyu::estimation::bundle::{Options, estimate};
use fuyu::estimation::filter::Filter;
use fuyu::estimation::{Sighting, Tracks};
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
        let (batch, rest) = tracks.sightings().split_at(200);
        let batch = Tracks::new(batch.to_vec()).unwrap();
        let solution = estimate(&batch, &view.camera, &Options::default()).unwrap();
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
    let batch = Tracks::new(batch.sightings()[..200].to_vec()).unwrap();
    let solution = estimate(&batch, &view.camera, &Options::default()).unwrap();
    let mut filter = Filter::new(&solution, 1e-6).unwrap();
    let (mut frames, mut rejected, mut unknown) = (0, 0, 0);
    for frame in spoilt.tracks(&motion, &view.sphere()).sightings() {
        if frame.time <= filter.time() {
            continue;
        }
        let mut features = frame.features.clone();
        features[3].id = 99;
        let update = filter.update(
            &Sighting::new(frame.time, features),
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
        &Sighting::new(181.0, Vec::new()),
        &UnitQuaternion::identity(),
    );
    assert_eq!((empty.used, filter.time()), (0, 181.0));
}
