//! Theorems 3.1 to 3.6: regulators with a frequency-shaped weight of the control.

use fuyu_lti::kida1993::{air_table, designs};
use fuyu_lti::{
    LtiError, Matrix, ShapedWeights, StateSpace, Structure, TransferFunction, eigenvalues,
    is_controllable, is_observable, recovery_observer, shaped_lqr,
};
use nalgebra::Complex;
use std::f64::consts::FRAC_1_SQRT_2;

use super::random::Random;

/// Results of the theorems on random structures.
#[derive(Debug, Clone, Default)]
pub struct ShapingTheorems {
    /// Theorem 3.1: number of extended systems that lost controllability or observability.
    pub lost: usize,
    /// Theorem 3.2: number of unstable filters realised by the feedback.
    pub unstable_filters: usize,
    /// Theorem 3.3: number of filters whose cut-off is not higher, or whose damping ratio is not closer to `1/√2`.
    pub filters_not_better: usize,
    /// Cut-off \[rad/s\] and damping ratio of each filter, as weighted and as realised.
    pub filters: Vec<[(f64, f64); 2]>,
    /// Theorem 3.4(a): smallest slope of a loop at high frequency, as a power of the frequency.
    pub least_slope: f64,
    /// Theorem 3.4(b): least `|1 + l| |1 + k_o (jω - A_o)⁻¹ b_o|`, at least 1.
    pub least_return_difference: f64,
    /// Theorem 3.5: largest distance of a pole of plant and compensator from the poles of regulator and observer,
    /// relative to the fastest pole.
    pub separation: f64,
    /// Theorem 3.5: number of unstable loops.
    pub unstable_loops: usize,
}

/// A structure with one rigid and some lightly damped modes, collocated actuator and sensor, and the weights of a
/// regulator.
struct Case {
    plant: StateSpace,
    filter: (f64, f64),
    weights: ShapedWeights,
}

/// The second-order low-pass in the realisation of eq. (3.9), whose gains are k1 and k2 of the book.
fn lowpass(w0: f64, zeta: f64) -> Result<StateSpace, LtiError> {
    let companion = TransferFunction::second_order_lowpass(w0, zeta)?.to_state_space()?;
    let gain = companion.c[(0, 0)];
    Ok(StateSpace {
        b: &companion.b * gain,
        c: &companion.c / gain,
        ..companion
    })
}

fn case(random: &mut Random) -> Result<Case, LtiError> {
    let modes = random.count(1, 4);
    let mut frequencies: Vec<f64> = (0..modes).map(|_| random.on_log_scale(0.3, 30.0)).collect();
    frequencies[0] = 0.0;
    let shapes = random.matrix(modes, 1).map(|v| v + 0.3 * v.signum());
    let damping: Vec<f64> = (0..modes)
        .map(|_| random.on_log_scale(1e-3, 0.05))
        .collect();
    let plant = Structure::modal(&frequencies, &damping, &shapes)?.displacement_system()?;
    let filter = (
        random.on_log_scale(0.3, 20.0),
        random.on_log_scale(0.2, 2.0),
    );
    let weights = ShapedWeights {
        controlled: plant.c.clone(),
        output_weight: None,
        inverse_input_weight: Some(lowpass(filter.0, filter.1)?),
        rho: random.on_log_scale(1e-5, 10.0),
    };
    Ok(Case {
        plant,
        filter,
        weights,
    })
}

/// Theorems 3.1 to 3.5 on `count` random structures.
///
/// # Errors
/// Numerical failure, which does not occur with these structures.
pub fn on_random_structures(count: usize) -> Result<ShapingTheorems, LtiError> {
    let mut random = Random::new(31);
    let mut all = ShapingTheorems {
        least_slope: f64::INFINITY,
        least_return_difference: f64::INFINITY,
        ..ShapingTheorems::default()
    };
    for _ in 0..count {
        let case = case(&mut random)?;
        let (plant, weights) = (&case.plant, &case.weights);
        let Some(r) = weights.inverse_input_weight.as_ref() else {
            continue;
        };
        let extended = r.series(plant)?;
        let kept = is_controllable(&plant.a, &plant.b)?
            == is_controllable(&extended.a, &extended.b)?
            && is_observable(&plant.a, &plant.c)? == is_observable(&extended.a, &extended.c)?;
        all.lost += usize::from(!kept);
        let regulator = shaped_lqr(plant, weights)?;
        all.unstable_filters += usize::from(!regulator.realized_filter()?.is_stable()?);
        let (w, z) = case.filter;
        let (k1, k2) = (regulator.gain_r[(0, 0)], regulator.gain_r[(0, 1)]);
        let new_w = w * (1.0 + k1).sqrt();
        let new_z = (2.0 * z * w + w * w * k2) / (2.0 * new_w);
        let nearer = match z >= FRAC_1_SQRT_2 {
            true => new_z <= z + 1e-9 && new_z >= FRAC_1_SQRT_2 - 1e-9,
            false => new_z >= z - 1e-9 && new_z <= FRAC_1_SQRT_2 + 1e-9,
        };
        all.filters_not_better += usize::from(!(new_w > w && nearer));
        all.filters.push([(w, z), (new_w, new_z)]);
        let l = regulator.state_loop()?;
        let fastest = largest(&l.poles()?);
        let gain = |w: f64| Ok::<_, LtiError>(l.response(w)?[(0, 0)].norm());
        let slope = (gain(1e3 * fastest)? / gain(1e4 * fastest)?).log10();
        all.least_slope = all.least_slope.min(slope);
        let own = StateSpace::new(
            r.a.clone(),
            r.b.clone(),
            regulator.gain_r.clone(),
            Matrix::zeros(1, 1),
        )?;
        for w in l.frequency_grid(fastest * 1e-4, fastest * 1e2, 15)? {
            // A frequency at a pole is skipped.
            let (Ok(l), Ok(f)) = (l.response(w), own.response(w)) else {
                continue;
            };
            let product = (l[(0, 0)] + 1.0).norm() * (f[(0, 0)] + 1.0).norm();
            all.least_return_difference = all.least_return_difference.min(product);
        }
        let observer = recovery_observer(plant, random.on_log_scale(1e-4, 1.0))?;
        let closed = plant.feedback(&regulator.compensator(&observer.gain)?)?;
        let states = StateSpace::new(
            plant.a.clone(),
            plant.b.clone(),
            Matrix::identity(plant.order(), plant.order()),
            Matrix::zeros(plant.order(), 1),
        )?;
        let mut separate = states.feedback(&regulator.state_feedback)?.poles()?;
        separate.extend(eigenvalues(&(&plant.a - &observer.gain * &plant.c))?);
        let poles = closed.poles()?;
        all.unstable_loops += usize::from(poles.iter().any(|p| p.re >= 0.0));
        let distance = matched(&poles, &separate) / largest(&poles);
        all.separation = all.separation.max(distance);
    }
    Ok(all)
}

fn largest(poles: &[Complex<f64>]) -> f64 {
    poles.iter().map(|p| p.norm()).fold(0.0, f64::max)
}

/// Largest distance after pairing each value of `b` with the nearest unpaired value of `a`; infinite if their numbers
/// differ.
fn matched(a: &[Complex<f64>], b: &[Complex<f64>]) -> f64 {
    if a.len() != b.len() {
        return f64::INFINITY;
    }
    let mut left = a.to_vec();
    b.iter().fold(0.0, |worst: f64, value| {
        let distances = left.iter().map(|v| (v - value).norm()).enumerate();
        let Some((place, distance)) = distances.min_by(|x, y| x.1.total_cmp(&y.1)) else {
            return f64::INFINITY;
        };
        left.swap_remove(place);
        worst.max(distance)
    })
}

/// Theorem 3.6 on the air table with two modes and the weights of design 4: for each observer noise μ, the largest
/// distance below 30 rad/s of the loop with observer from the state-feedback loop, relative to the latter. With
/// `collocated` false, the sensor is where the first vibration has the opposite sign, which gives a zero in the right
/// half-plane.
///
/// # Errors
/// Numerical failure, which does not occur with these data.
pub fn recovery(noises: &[f64], collocated: bool) -> Result<Vec<f64>, LtiError> {
    let mut plant = air_table::plant(2)?;
    if !collocated {
        plant.c[(0, 1)] = -plant.c[(0, 1)];
    }
    let weights = ShapedWeights {
        controlled: plant.c.clone(),
        output_weight: None,
        inverse_input_weight: Some(lowpass(10.0, 0.7)?),
        rho: designs::DESIGNS[3].rho,
    };
    let regulator = shaped_lqr(&plant, &weights)?;
    let wanted = regulator.state_loop()?;
    let distance = |noise: &f64| {
        let compensator = regulator.compensator(&recovery_observer(&plant, *noise)?.gain)?;
        let reached = plant.series(&compensator)?;
        let mut worst = 0.0_f64;
        for i in 0..60 {
            let w = 30.0 * 10f64.powf(-3.0 * f64::from(i) / 59.0);
            let (a, b) = (wanted.response(w)?[(0, 0)], reached.response(w)?[(0, 0)]);
            worst = worst.max((a - b).norm() / (1.0 + a.norm()));
        }
        Ok(worst)
    };
    noises.iter().map(distance).collect()
}
