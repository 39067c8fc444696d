//! Inertia and angular momentum from a series of attitudes, by linear least squares.
//!
//! The angular momentum is constant: `R_i I R_iᵀ w_i = L`, linear in `I` and `L`. With `I = 1 + Σ d_k E_k` (scale is
//! not observable, so the trace is fixed) it is an ordinary least-squares problem with eight unknowns and needs no
//! initial values, unlike every later stage.

use nalgebra::{DMatrix, DVector, SMatrix, SVector, UnitQuaternion, Vector3};

use super::free_motion::{FreeMotion, PARAMETERS, shape_times};

/// A measured attitude.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AttitudeSample {
    /// Time \[s\].
    pub time: f64,
    /// Body axes in inertial axes.
    pub R_WB: UnitQuaternion<f64>,
}

/// A measured angular velocity, with the attitude at that time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BodyRate {
    /// Time and attitude.
    pub attitude: AttitudeSample,
    /// Angular velocity in body axes \[rad/s\].
    pub w_WB_B: Vector3<f64>,
}

/// Largest number of angular velocities taken from a series.
const MAX_RATES: usize = 240;

/// Largest rotation on either side that a polynomial is fitted to \[rad\].
const MAX_TURN: f64 = 1.7;

/// Largest number of neighbours on either side.
const NEIGHBOURS: usize = 8;

/// Angular velocities along a series: at each attitude, the slope of a polynomial fitted to the rotation vectors to its
/// neighbours.
pub fn rates(series: &[AttitudeSample]) -> Vec<BodyRate> {
    let stride = series.len().div_ceil(MAX_RATES).max(1);
    for (least, degree) in [(5, 4), (3, 2)] {
        let rate = |i: usize| body_rate_at(series, i, least, degree);
        let found: Vec<_> = (0..series.len()).step_by(stride).filter_map(rate).collect();
        if found.len() >= 8 || least == 3 {
            return found;
        }
    }
    Vec::new()
}

fn body_rate_at(
    series: &[AttitudeSample],
    i: usize,
    least: usize,
    degree: usize,
) -> Option<BodyRate> {
    let here = series[i];
    let vector = |a: &AttitudeSample| (here.R_WB.inverse() * a.R_WB).scaled_axis();
    let side = |others: &mut dyn Iterator<Item = &AttitudeSample>| -> Vec<(f64, Vector3<f64>)> {
        let mut all: Vec<(f64, Vector3<f64>)> = Vec::new();
        for a in others {
            let v = vector(a);
            // Stop where the rotation vector may be that of a rotation in the opposite direction.
            if v.norm() > MAX_TURN || all.last().is_some_and(|(_, last)| v.norm() < last.norm()) {
                break;
            }
            all.push((a.time - here.time, v));
        }
        let stride = all.len().div_ceil(NEIGHBOURS).max(1);
        all.into_iter().rev().step_by(stride).collect()
    };
    let before = side(&mut series[..i].iter().rev());
    let after = side(&mut series[i + 1..].iter());
    if before.is_empty() || after.is_empty() || before.len() + after.len() + 1 < least {
        return None;
    }
    let samples: Vec<_> = [(0.0, Vector3::zeros())]
        .into_iter()
        .chain(before)
        .chain(after)
        .collect();
    let span = samples.iter().map(|(t, _)| t.abs()).fold(0.0, f64::max);
    let A = DMatrix::from_fn(samples.len(), degree + 1, |r, c| {
        (samples[r].0 / span).powi(c as i32)
    });
    let b = DMatrix::from_fn(samples.len(), 3, |r, c| samples[r].1[c]);
    let fit = A.svd(true, true).solve(&b, 1e-9).ok()?;
    let w = Vector3::new(fit[(1, 0)], fit[(1, 1)], fit[(1, 2)]) / span;
    w.iter().all(|w| w.is_finite()).then_some(BodyRate {
        attitude: here,
        w_WB_B: w,
    })
}

/// Position along the rates (0 to 1) where the body turns over: the angular velocity in body axes changes fastest there.
pub fn fastest_tumbling(rates: &[BodyRate]) -> f64 {
    // Differences over several rates, so that a single wrong one does not decide.
    let apart = rates.len() / 40 + 2;
    let change = |i: usize| (rates[i + apart].w_WB_B - rates[i].w_WB_B).norm();
    let pairs = 0..rates.len().saturating_sub(apart);
    let fastest = pairs.max_by(|a, b| change(*a).total_cmp(&change(*b)));
    fastest.map_or(0.5, |i| (i + apart / 2) as f64 / rates.len() as f64)
}

/// The torque-free motion that fits `rates` best. Its reference is the rate at position `along` (0 to 1). `None`
/// without rates.
pub fn fit_inertia_and_momentum(rates: &[BodyRate], along: f64) -> Option<FreeMotion> {
    let middle = rates.get((along * rates.len() as f64) as usize)?.attitude;
    let size = rates.iter().map(|r| r.w_WB_B.norm()).sum::<f64>() / rates.len() as f64;
    let mut weights = vec![1.0; rates.len()];
    let mut solution = SVector::<f64, PARAMETERS>::zeros();
    for _ in 0..4 {
        let mut H = SMatrix::<f64, PARAMETERS, PARAMETERS>::zeros();
        let mut g = SVector::<f64, PARAMETERS>::zeros();
        let rows = |rate: &BodyRate| {
            let mut J = SMatrix::<f64, 3, PARAMETERS>::zeros();
            J.fixed_columns_mut::<5>(0)
                .copy_from(&shape_times(&rate.w_WB_B));
            let R = rate.attitude.R_WB.to_rotation_matrix();
            J.fixed_columns_mut::<3>(5)
                .copy_from(&-R.matrix().transpose());
            J
        };
        for (rate, weight) in rates.iter().zip(&weights) {
            let J = rows(rate);
            H += J.tr_mul(&J) * *weight;
            g -= J.tr_mul(&rate.w_WB_B) * *weight;
        }
        // Shapes that the motion does not determine (isotropic body, single axis) stay spherical.
        let ridge = 1e-6 * size * size * rates.len() as f64;
        for k in 0..5 {
            H[(k, k)] += ridge;
        }
        solution = H.cholesky()?.solve(&g);
        let errors: Vec<f64> = rates
            .iter()
            .map(|r| (r.w_WB_B + rows(r) * solution).norm())
            .collect();
        let errors = DVector::from_vec(errors);
        let mut sorted: Vec<f64> = errors.iter().copied().collect();
        sorted.sort_by(f64::total_cmp);
        let width = (2.0 * sorted[sorted.len() / 2])
            .max(1e-9 * size)
            .max(f64::MIN_POSITIVE);
        for (weight, error) in weights.iter_mut().zip(&errors) {
            *weight = 1.0 / (1.0 + (error / width).powi(2));
        }
    }
    let mut shape: SVector<f64, 5> = solution.fixed_rows::<5>(0).into_owned();
    let momentum = solution.fixed_rows::<3>(5).into_owned();
    // Noise may give an inertia that no body can have: move towards a sphere until the inertia is valid.
    for _ in 0..20 {
        if let Some(motion) = FreeMotion::new(&shape, momentum, middle.time, middle.R_WB) {
            return Some(motion);
        }
        shape *= 0.7;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tumbling_body_gives_its_inertia() {
        let shape = SVector::<f64, 5>::new(0.3, -0.2, 0.1, 0.05, -0.15);
        let truth = FreeMotion::new(
            &shape,
            Vector3::new(0.3, -0.5, 0.6),
            0.0,
            UnitQuaternion::from_scaled_axis(Vector3::new(0.4, -0.7, 1.1)),
        )
        .unwrap();
        let times: Vec<f64> = (0..300).map(|i| 0.3 * f64::from(i)).collect();
        let series: Vec<_> = (truth.attitudes(&times).into_iter().zip(&times))
            .map(|(R_WB, &time)| AttitudeSample { time, R_WB })
            .collect();
        let found = fit_inertia_and_momentum(&rates(&series), 0.5).unwrap();
        assert!(
            (found.inertia - truth.inertia).norm() < 5e-3,
            "{}",
            found.inertia
        );
        assert!((found.momentum - truth.momentum).norm() < 5e-3);
    }

    #[test]
    fn a_spin_about_one_axis_leaves_a_sphere() {
        let series: Vec<_> = (0..50)
            .map(|i| {
                let time = 0.2 * f64::from(i);
                let R_WB = UnitQuaternion::from_scaled_axis(Vector3::new(0.0, 0.3, 0.4) * time);
                AttitudeSample { time, R_WB }
            })
            .collect();
        let found = fit_inertia_and_momentum(&rates(&series), 0.5).unwrap();
        let w = found.w_WB_B(&found.R_WB);
        assert!((w - Vector3::new(0.0, 0.3, 0.4)).norm() < 1e-6, "{w}");
        assert_eq!(fit_inertia_and_momentum(&[], 0.5), None);
    }
}
