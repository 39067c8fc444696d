//! Rate feedback by a proof-mass actuator on a hanging ladder structure (section 4.3).

use crate::matrix::{Complex, Matrix};
use crate::{LtiError, ProofMass, Structure};

/// Gravity in m/s2.
pub const GRAVITY: f64 = 9.81;

/// Moving mass in kg (Table 4.1).
pub const MASS: f64 = 1.0;

/// Stiffness of the pivot in N m/rad (Table 4.1).
pub const STIFFNESS: f64 = 3.74e-2;

/// Damping of the pivot in N m s/rad (Table 4.1).
pub const DAMPING: f64 = 1.14e-2;

/// Eddy-current coefficient of the actuator (section 4.3.3 (b)).
pub const EDDY: f64 = 0.05;

/// Measured frequencies of the structure in Hz (Table 4.2).
pub const FREQUENCIES_HZ: [f64; 3] = [2.45, 9.65, 17.9];

/// Damping ratio without control.
pub const STRUCTURAL_DAMPING: f64 = 0.003;

/// The gains at which the thesis finds the loop unstable: with the actuator as it is, with ten times its damping, without gravity (Figs. 4.4, 4.5, 4.6).
pub const PRINTED_LIMITS: [f64; 3] = [1.0, 21.0, 32.0];

/// What the thesis does not print: length of the arm and mode shape at the actuator. Any two printed limits determine them; the third then disagrees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Unprinted {
    /// Arm in m.
    pub arm: f64,
    /// Shape of the first mode at the actuator in kg^-1/2.
    pub shape: f64,
}

/// Recovered from the limits 1 (on the ground) and 32 (without gravity), with the first mode alone.
pub const FROM_FIRST_AND_THIRD: Unprinted = Unprinted {
    arm: 0.100_956_28,
    shape: 1.491_494_26,
};

/// Recovered from the limits 21 (ten times the damping) and 32 (without gravity).
pub const FROM_SECOND_AND_THIRD: Unprinted = Unprinted {
    arm: 0.043_981_24,
    shape: 1.451_831_17,
};

/// The structure with its first mode.
pub fn structure(unprinted: &Unprinted) -> Result<Structure, LtiError> {
    Structure::modal(
        &[std::f64::consts::TAU * FREQUENCIES_HZ[0]],
        &[STRUCTURAL_DAMPING],
        &Matrix::from_element(1, 1, unprinted.shape),
    )
}

/// The actuator in the three situations of Figs. 4.4 to 4.6: on the ground; on the ground with ten times the damping; without gravity.
pub fn actuators(unprinted: &Unprinted) -> Result<[ProofMass; 3], LtiError> {
    let free = ProofMass::new(MASS, unprinted.arm, STIFFNESS, DAMPING)?;
    let damped = ProofMass::new(MASS, unprinted.arm, STIFFNESS, 10.0 * DAMPING)?;
    Ok([
        free.under_gravity(GRAVITY)?,
        damped.under_gravity(GRAVITY)?,
        free,
    ])
}

/// Gains at which the loop becomes unstable in the three situations; infinite if not below 1000.
pub fn limits(unprinted: &Unprinted) -> Result<[f64; 3], LtiError> {
    let structure = structure(unprinted)?;
    let mut out = [f64::INFINITY; 3];
    for (limit, actuator) in out.iter_mut().zip(actuators(unprinted)?) {
        for largest in [10.0, 100.0, 1000.0] {
            if let Some(d) = actuator.stability_limit(&structure, largest)? {
                *limit = d;
                break;
            }
        }
    }
    Ok(out)
}

/// Root locus: the poles in rad/s for each rate gain (Figs. 4.4 to 4.6).
pub fn root_locus(
    structure: &Structure,
    actuator: &ProofMass,
    gains: &[f64],
) -> Result<Vec<(f64, Vec<Complex>)>, LtiError> {
    gains
        .iter()
        .map(|&d| Ok((d, actuator.closed_loop(structure, d)?.poles()?)))
        .collect()
}

/// The actuator of the experiments with the minor loop, alpha = .7 and beta = .05 (section 4.3.3 (c)).
///
/// With beta = epsilon = .05 as printed, eq. (4.12) leaves the damping unchanged; beta counts with the opposite sign if damping is to grow.
pub fn compensated(unprinted: &Unprinted) -> Result<ProofMass, LtiError> {
    actuators(unprinted)?[0].with_minor_loop(GRAVITY, 0.7, 0.05, EDDY)
}

/// Rate at the actuator in m/s every `step` s after a unit impulse of force there, under the rate gain d (Figs. 4.8 to 4.11 show its derivative).
pub fn impulse(
    structure: &Structure,
    actuator: &ProofMass,
    d: f64,
    step: f64,
    samples: usize,
) -> Result<Vec<f64>, LtiError> {
    let response = actuator
        .closed_loop(structure, d)?
        .impulse_response(0, step, samples)?;
    Ok(response.into_iter().map(|y| y[0]).collect())
}
