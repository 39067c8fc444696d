//! The scale of lengths from measured ranges: how often it is off by more than its deviation says.

use fuyu_physics::estimation::Tracks;
use fuyu_physics::estimation::bundle::{self, MeasuredRange, Options};
use fuyu_physics::vision::Pinhole;
use nalgebra::{UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng, rngs::StdRng};
use rand_distr::StandardNormal;

use super::world::{Eye, State, World};

/// Twenty bodies 4 to 9 m away, with a range of each point in four frames: 5 cm of noise, and a fifth of the ranges are those of the
/// background. Fails if wrong ranges spoil the scale, or if its deviation does not contain the scatter or the points.
#[test]
fn the_scale_of_noisy_ranges_is_within_its_deviation() {
    let mut beyond = [0; 2];
    for seed in 0..20 {
        let mut rng = StdRng::seed_from_u64(seed);
        let mut normal = || rng.sample::<f64, _>(StandardNormal);
        let points: Vec<_> = (0..15)
            .map(|_| Vector3::from_fn(|_, _| normal()).normalize())
            .collect();
        let w_B = Vector3::from_fn(|_, _| 0.1 * normal());
        let world = World {
            I: Vector3::new(1.0, 0.8, 0.55),
            ..World::default()
        };
        let start = State {
            R_WB: UnitQuaternion::identity(),
            w_B,
            r_W: Vector3::new(0.2, -0.1, rng.random_range(4.0..9.0)),
            v_W: Vector3::zeros(),
            R_WC: UnitQuaternion::identity(),
        };
        let times: Vec<f64> = (0..100).map(|k| 0.3 * f64::from(k)).collect();
        let states = world.run(start, &times);
        let eye = Eye::new(1.0, 0.3, false);
        let (mut tracks, mut ranges) = (Tracks::default(), Vec::new());
        for (k, (time, state)) in times.iter().zip(&states).enumerate() {
            tracks
                .push(eye.frame(*time, state, &points, &mut rng))
                .unwrap();
            if k % 30 != 5 {
                continue;
            }
            for (id, point) in (0..).zip(&points) {
                let true_range = (state.R_WB * point + state.r_W).norm();
                let metres = match rng.random_range(0.0..1.0) < 0.2 {
                    true => true_range + rng.random_range(1.0..50.0),
                    false => true_range + 0.05 * rng.sample::<f64, _>(StandardNormal),
                };
                ranges.push(MeasuredRange {
                    id,
                    time: *time,
                    metres,
                });
            }
        }
        let camera = Pinhole {
            fx: eye.focal,
            fy: eye.focal,
            cx: eye.centre.x,
            cy: eye.centre.y,
        };
        let options = Options {
            with_points: true,
            ..Options::default()
        };
        let solution = bundle::estimate(&tracks, &camera, &options).unwrap();
        let scale = solution.scale_of_ranges(&ranges).unwrap();
        let centre = solution.centre.as_ref().unwrap().in_metres(&scale);
        let error = centre.position.z - states.last().unwrap().r_W.z;
        let deviation = centre.covariance[(2, 2)].sqrt();
        assert!(
            error.abs() < 0.1 && deviation < 0.3,
            "seed {seed}: {error} m, reported {deviation} m"
        );
        beyond[0] += usize::from(error.abs() > 2.0 * deviation);
        beyond[1] += usize::from(error.abs() > 4.0 * deviation);
        assert_eq!(solution.scale_of_ranges(&ranges[..2]), None);
    }
    // Of normal errors, one of twenty is beyond 2 deviations.
    assert!(beyond[0] <= 3 && beyond[1] == 0, "{beyond:?}");
}
