//! Angular velocities: the error of predictions against their covariance.

use fuyu_physics::estimation::bundle::Widths;
use fuyu_physics::estimation::fit_rates;
use nalgebra::{UnitQuaternion, UnitVector3, Vector3};
use rand::{RngExt, SeedableRng, rngs::StdRng};
use rand_distr::StandardNormal;

use super::world::{State, World};

/// Length of the observation and of the prediction \[s\].
const SPAN: f64 = 60.0;
const HORIZON: f64 = 30.0;

fn normal(rng: &mut StdRng) -> Vector3<f64> {
    Vector3::from_fn(|_, _| rng.sample(StandardNormal))
}

/// Angle of the prediction's error \[rad\], and its Mahalanobis distance, for a random body whose angular velocity is
/// measured at 10 Hz with `noise` \[rad/s\].
fn prediction(seed: u64, noise: f64) -> (f64, f64) {
    let mut rng = StdRng::seed_from_u64(seed);
    let size = Vector3::from_fn(|_, _| rng.random_range(0.3..1.0f64).powi(2));
    let world = World {
        I: Vector3::new(size.y + size.z, size.z + size.x, size.x + size.y),
        ..World::default()
    };
    let axis = UnitVector3::new_normalize(normal(&mut rng)).into_inner();
    let start = State {
        R_WB: UnitQuaternion::from_scaled_axis(normal(&mut rng)),
        w_B: axis * rng.random_range(0.1..0.4),
        r_W: Vector3::z(),
        v_W: Vector3::zeros(),
        R_WC: UnitQuaternion::identity(),
    };
    let mut times: Vec<f64> = (0..=600).map(|k| 0.1 * f64::from(k)).collect();
    times.push(SPAN + HORIZON);
    let states = world.run(start, &times);
    let rates: Vec<_> = (times[..=600].iter().zip(&states))
        .map(|(t, s)| (*t, s.R_WB * s.w_B + normal(&mut rng) * noise))
        .collect();
    let found = fit_rates(&rates, &Widths::default()).unwrap();
    let turn = found.motion.attitude(SPAN + HORIZON) / found.motion.attitude(SPAN);
    let error = (turn / (states[601].R_WB / states[600].R_WB)).scaled_axis();
    let state = found.state.unwrap();
    let spread = state.covariance_between(SPAN, SPAN + HORIZON);
    let inverse = spread.try_inverse().unwrap();
    (error.norm(), error.dot(&(inverse * error)).max(0.0).sqrt())
}

/// Fails if another model than that of the motion is fitted.
#[test]
fn exact_angular_velocities_predict_half_a_minute() {
    for seed in 0..20 {
        let error = prediction(seed, 0.0).0.to_degrees();
        assert!(error < 0.01, "seed {seed}: {error} deg");
    }
}

/// Fails if the covariance is too small or too large by half: the median of an exact one is 1.54.
#[test]
fn errors_agree_with_the_covariance() {
    let mut offs: Vec<f64> = (0..60).map(|seed| prediction(seed, 1e-3).1).collect();
    offs.sort_by(f64::total_cmp);
    println!("median {:.2}, largest {:.2}", offs[30], offs[59]);
    assert!((1.2..1.9).contains(&offs[30]), "{offs:.2?}");
    // Three of sixty: one more than an exact covariance has.
    assert!(offs[56] < 3.0 && offs[59] < 5.0, "{offs:.2?}");
}
