//! Lemmas 4.2 and 4.4 and Theorems 4.1 to 4.3: direct feedback at collocated actuators, ideal or proof-mass.

use fuyu_lti::{
    LtiError, Matrix, ProofMass, Structure, TransferFunction, positive_real, spectral_abscissa,
};

use super::random::Random;

/// Results of direct feedback of rate (DVFB) and of rate and displacement (DVDFB) on random structures.
#[derive(Debug, Clone, Default)]
pub struct DirectFeedback {
    /// Lemma 4.2: structures without rigid modes under DVFB, and how many were unstable.
    pub rate: (usize, usize),
    /// Theorem 4.1: structures under DVDFB, and how many were unstable.
    pub rate_and_displacement: (usize, usize),
    /// Structures with rigid modes under DVFB, and how many were asymptotically stable, which the lemma excludes.
    pub rigid_under_rate: (usize, usize),
    /// Structures with a skew part added to P, against the theorem's premise, and how many were unstable.
    pub skew: (usize, usize),
    /// Lemma 4.4: structures with a positive-real actuator in the rate loop, and how many were unstable.
    pub real_actuators: (usize, usize),
    /// Structures with a low-pass of second order, which is not positive real, and how many were unstable.
    pub other_actuators: (usize, usize),
}

fn count(result: &mut (usize, usize), is_bad: bool) {
    result.0 += 1;
    result.1 += usize::from(is_bad);
}

/// A structure with `n` coordinates and `rigid` rigid-body modes.
fn structure(
    random: &mut Random,
    n: usize,
    rigid: usize,
    actuators: usize,
) -> Result<Structure, LtiError> {
    let t = random.matrix(n, n) + Matrix::identity(n, n) * 2.0;
    let mass = random.definite(n, 0.5);
    let mut stiffness = Matrix::zeros(n, n);
    for i in rigid..n {
        stiffness[(i, i)] = random.on_log_scale(0.5, 500.0);
    }
    let stiffness = (t.transpose() * stiffness * &t).symmetric_part();
    Structure::new(
        mass,
        &stiffness * 0.002,
        stiffness,
        random.matrix(n, actuators),
    )
}

/// Lemmas 4.2 and 4.4 and Theorem 4.1 on `number` random structures.
///
/// # Errors
/// Numerical failure, which does not occur with these structures.
pub fn direct_feedback(number: usize) -> Result<DirectFeedback, LtiError> {
    let mut random = Random::new(41);
    let mut all = DirectFeedback::default();
    for i in 0..number {
        let n = 2 + i % 6;
        let rigid = (i % 3).min(n - 1);
        let m = rigid.max(1) + i % 2;
        let s = structure(&mut random, n, rigid, m)?;
        let mut gain = || random.definite(m, 0.1) * random.on_log_scale(0.1, 100.0);
        let (p, d) = (gain(), gain());
        let none = Matrix::zeros(m, m);
        s.certify(&p, &d)?;
        let is_stable = s.direct_feedback(&p, &d)?.is_stable()?;
        count(&mut all.rate_and_displacement, !is_stable);
        let under_rate = s.direct_feedback(&none, &d)?;
        match rigid {
            0 => count(&mut all.rate, !under_rate.is_stable()?),
            _ => count(
                &mut all.rigid_under_rate,
                under_rate.stability_margin()? > 1e-6,
            ),
        }
        if m >= 2 {
            let skew = random.matrix(m, m) * (50.0 * p.amax());
            let skewed = &p + &skew - skew.transpose();
            let is_stable = s.direct_feedback(&skewed, &d)?.is_stable()?;
            count(&mut all.skew, !is_stable);
        }
        // One actuator with dynamics, on a structure without rigid modes.
        let s = structure(&mut random, n, 0, 1)?;
        let d = random.on_log_scale(0.1, 30.0);
        let (corner, zero) = (
            random.on_log_scale(0.1, 30.0),
            random.on_log_scale(0.1, 30.0),
        );
        let lag = TransferFunction::new(&[d * corner], &[1.0, corner])?;
        let lead = TransferFunction::new(&[d, d * zero], &[1.0, corner])?;
        let second_order = TransferFunction::new(&[0.49 * d], &[1.0, 0.7, 0.49])?;
        for actuator in [lag, lead, second_order] {
            let actuator = actuator.to_state_space()?;
            let is_stable = s.rate_system()?.feedback(&actuator)?.is_stable()?;
            match positive_real(&actuator)?.holds {
                true => count(&mut all.real_actuators, !is_stable),
                false => count(&mut all.other_actuators, !is_stable),
            }
        }
    }
    Ok(all)
}

/// Results of random proof-mass actuators.
#[derive(Debug, Clone, Default)]
pub struct ProofMasses {
    /// Theorem 4.3, one undamped mode: number of loops that it calls stable, and how many of them are unstable.
    pub stable: (usize, usize),
    /// Theorem 4.3: number of loops that it calls unstable, and how many of them are stable.
    pub unstable: (usize, usize),
    /// Theorem 4.2, three modes: number of loops that satisfy it, and how many of them are unstable.
    pub sufficient: (usize, usize),
    /// Without feedback: number of loops, and how many are unstable.
    pub passive: (usize, usize),
    /// For each loop: margin to the limit of Theorem 4.3, `(1 + μ) / ((r (1 + μ) + 1) ν² μ)`, above 1 for a stable
    /// loop; and the largest real part of its poles over the mode's frequency.
    pub margins: Vec<(f64, f64)>,
}

/// Theorems 4.2 and 4.3 on `number` random actuators and structures.
///
/// # Errors
/// Numerical failure, which does not occur with these structures.
pub fn proof_masses(number: usize) -> Result<ProofMasses, LtiError> {
    let mut random = Random::new(43);
    let mut all = ProofMasses::default();
    for _ in 0..number {
        let actuator = ProofMass::new(
            random.on_log_scale(0.1, 5.0),
            random.on_log_scale(0.02, 0.3),
            random.on_log_scale(0.01, 5.0),
            random.on_log_scale(1e-3, 0.5),
        )?;
        let sigma = random.on_log_scale(1.0, 50.0);
        let (phi, d) = (
            random.on_log_scale(0.05, 2.0),
            random.on_log_scale(0.1, 100.0),
        );
        let shape = Matrix::from_element(1, 1, phi);
        let undamped = Structure::modal(&[sigma], &[0.0], &shape)?;
        let ratios = actuator.ratios(sigma, phi, d);
        let abscissa = spectral_abscissa(&actuator.closed_loop(&undamped, d)?.a)?;
        // Loops on the limit have no verdict.
        if abscissa.abs() > 1e-9 * sigma {
            match ratios.is_stable() {
                true => count(&mut all.stable, abscissa > 0.0),
                false => count(&mut all.unstable, abscissa < 0.0),
            }
        }
        let fed = 1.0 + ratios.feedback;
        let limit = fed / (ratios.mass * fed + 1.0);
        let used = ratios.frequency.powi(2) * ratios.feedback;
        all.margins.push((limit / used, abscissa / sigma));
        let passive = spectral_abscissa(&actuator.closed_loop(&undamped, 0.0)?.a)?;
        count(&mut all.passive, passive > 1e-9 * sigma);
        let modes = Structure::modal(
            &[sigma, 3.1 * sigma, 7.3 * sigma],
            &[0.05; 3],
            &Matrix::from_column_slice(3, 1, &[phi, -0.7 * phi, 0.4 * phi]),
        )?;
        for d in [0.01 * d, 0.1 * d, d] {
            if actuator.satisfies_damping_condition(&modes, d)? {
                let is_stable = actuator.closed_loop(&modes, d)?.is_stable()?;
                count(&mut all.sufficient, !is_stable);
            }
        }
    }
    Ok(all)
}
