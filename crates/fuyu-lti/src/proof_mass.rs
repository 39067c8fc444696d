//! The proof-mass actuator (PMA): a mass on an elastic arm whose reaction force damps a structure (Kida 1993 section 4.3).

use crate::matrix::{Matrix, blocks, positive, shaped};
use crate::structure::second_order;
use crate::{LtiError, StateSpace, Structure};

/// A proof-mass actuator, `m a^2 theta'' + c theta' + k theta = a f`, with the force f between mass and structure (eq. (4.5)).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ProofMass {
    /// Mass m in kg.
    pub mass: f64,
    /// Length a of the arm in m.
    pub arm: f64,
    /// Stiffness k about the pivot in N m/rad, gravity included (eq. (4.7)).
    pub stiffness: f64,
    /// Damping c about the pivot in N m s/rad.
    pub damping: f64,
}

/// Dimensionless parameters of an actuator on one mode (section 4.3.2, with `c_e = 2 m sigma_1`, `gamma = c / (c_e a^2)`, `mu = d a^2 / c`).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ProofMassRatios {
    /// Mass ratio r = m phi^2.
    pub mass: f64,
    /// Frequency ratio nu: of the actuator to the mode.
    pub frequency: f64,
    /// Damping ratio gamma of the actuator, referred to the mode.
    pub damping: f64,
    /// mu: damping by feedback over damping of the pivot.
    pub feedback: f64,
}

impl ProofMassRatios {
    /// Theorem 4.3: `nu^2 mu < (1 + mu) / (r (1 + mu) + 1)`, necessary and sufficient for one mode without damping (printed as sufficient).
    pub fn is_stable(&self) -> bool {
        self.frequency.powi(2) * self.feedback
            < (1.0 + self.feedback) / (self.mass * (1.0 + self.feedback) + 1.0)
    }

    /// Coefficients of the characteristic polynomial in lambda = s / sigma_1, highest power first.
    pub fn characteristic(&self) -> [f64; 5] {
        let (r, nu2, g) = (self.mass, self.frequency.powi(2), self.damping);
        [
            1.0,
            2.0 * g * (1.0 + r * (1.0 + self.feedback)),
            1.0 + nu2 * (1.0 + r),
            2.0 * g,
            nu2,
        ]
    }
}

impl ProofMass {
    /// Errors: mass, arm or damping that are not positive, negative stiffness.
    pub fn new(mass: f64, arm: f64, stiffness: f64, damping: f64) -> Result<Self, LtiError> {
        positive("the mass of the proof mass", mass)?;
        positive("the length of the arm", arm)?;
        positive("the damping of the pivot", damping)?;
        if !(stiffness >= 0.0 && stiffness.is_finite()) {
            return Err(LtiError::Range {
                what: "the stiffness of the pivot".into(),
                value: stiffness,
                expected: "zero or more",
            });
        }
        Ok(Self {
            mass,
            arm,
            stiffness,
            damping,
        })
    }

    /// The actuator hanging in gravity g in m/s2, which stiffens the pivot: `k + m a g` (eq. (4.7)).
    pub fn under_gravity(&self, g: f64) -> Result<Self, LtiError> {
        Self::new(
            self.mass,
            self.arm,
            self.stiffness + self.mass * self.arm * g,
            self.damping,
        )
    }

    /// With the minor loop of eq. (4.11): electromagnetic force from angle and rate with the gains alpha and beta, eddy-current coefficient
    /// epsilon. Damping and stiffness become `c + m a g alpha (epsilon - beta)` and `k - m a g alpha` (eq. (4.12)); the small
    /// change of a^2 is neglected as there.
    pub fn with_minor_loop(
        &self,
        g: f64,
        alpha: f64,
        beta: f64,
        epsilon: f64,
    ) -> Result<Self, LtiError> {
        let unit = self.mass * self.arm * g * alpha;
        Self::new(
            self.mass,
            self.arm,
            self.stiffness - unit,
            self.damping + unit * (epsilon - beta),
        )
    }

    /// Own frequency `sqrt(k / m) / a` in rad/s.
    pub fn frequency(&self) -> f64 {
        (self.stiffness / self.mass).sqrt() / self.arm
    }

    /// From the commanded force u to the force f on a structure at rest (appendix 4C): `m a^2 s^2 / (m a^2 s^2 + c s + k)`. Its real part is negative below the own frequency, so it is not positive real.
    pub fn actuator(&self) -> Result<StateSpace, LtiError> {
        let j = self.mass * self.arm * self.arm;
        crate::TransferFunction::new(&[j, 0.0, 0.0], &[j, self.damping, self.stiffness])?
            .to_state_space()
    }

    /// Structure and actuator without feedback, from the commanded force u to the rate at the actuator (appendix 4B): times d it is the loop of
    /// Fig. 4.12, which direct rate feedback closes. States as in [`ProofMass::closed_loop`].
    pub fn plant(&self, structure: &Structure) -> Result<StateSpace, LtiError> {
        self.coupled(structure, 0.0)?.select(&[0], &[1])
    }

    /// Structure and actuator under direct rate feedback `u = -d z` (eq. (4.10)), from a disturbing force at the actuator's place to the rate there.
    ///
    /// The structure has one actuator. States: `[theta; w; theta'; w']`.
    pub fn closed_loop(&self, structure: &Structure, d: f64) -> Result<StateSpace, LtiError> {
        self.coupled(structure, d)?.select(&[0], &[0])
    }

    /// Structure and actuator with `u = v - d z`, from the disturbing force and the command v to the rate.
    fn coupled(&self, structure: &Structure, d: f64) -> Result<StateSpace, LtiError> {
        let phi = structure.input();
        let n = structure.coordinates();
        shaped("the input matrix L", phi, n, 1)?;
        let (m, a) = (self.mass, self.arm);
        let z = Matrix::zeros;
        let number = |v: f64| Matrix::from_element(1, 1, v);
        second_order(
            "the mass matrix with the actuator",
            &blocks(&[
                &[&number(m * a * a), &(phi.transpose() * (m * a))],
                &[
                    &(phi * (m * a)),
                    &(structure.mass() + phi * phi.transpose() * m),
                ],
            ]),
            &blocks(&[
                &[&number(self.damping), &(phi.transpose() * (-d * a))],
                &[&z(n, 1), structure.damping()],
            ]),
            &blocks(&[
                &[&number(self.stiffness), &z(1, n)],
                &[&z(n, 1), structure.stiffness()],
            ]),
            // The command enters the equation of the arm as -a v, the disturbing force that of the structure.
            &blocks(&[&[&z(1, 1), &number(-a)], &[phi, &z(n, 1)]]),
            &blocks(&[&[&z(1, n + 2), &phi.transpose()]]),
        )
    }

    /// Sufficient condition of Theorem 4.2: `C - (d a)^2 phi phi' / (4 c)` positive definite. (Printed with phi'phi for a row vector phi.)
    pub fn satisfies_damping_condition(
        &self,
        structure: &Structure,
        d: f64,
    ) -> Result<bool, LtiError> {
        let phi = structure.input();
        shaped("the input matrix L", phi, structure.coordinates(), 1)?;
        let rest = structure.damping()
            - phi * phi.transpose() * ((d * self.arm).powi(2) / (4.0 * self.damping));
        Ok(crate::matrix::smallest_eigenvalue(&rest)? > 0.0)
    }

    /// Dimensionless parameters for the mode with frequency `sigma` in rad/s and mode shape `phi` in kg^-1/2 at the actuator, for the rate gain d in N s/m.
    pub fn ratios(&self, sigma: f64, phi: f64, d: f64) -> ProofMassRatios {
        ProofMassRatios {
            mass: self.mass * phi * phi,
            frequency: self.frequency() / sigma,
            damping: self.damping / (2.0 * self.mass * sigma * self.arm * self.arm),
            feedback: d * self.arm * self.arm / self.damping,
        }
    }

    /// The smallest rate gain d in N s/m, up to `largest`, at which the loop stops being stable, by bisection; `None` if it is stable up to there.
    ///
    /// Error: unstable at d = 0.
    pub fn stability_limit(
        &self,
        structure: &Structure,
        largest: f64,
    ) -> Result<Option<f64>, LtiError> {
        let margin = |d: f64| self.closed_loop(structure, d)?.stability_margin();
        self.closed_loop(structure, 0.0)?
            .require_stable("structure with the passive actuator")?;
        // The limit is approached from below in small steps, so that a stable interval above it does not hide it.
        let steps = 400;
        let mut low = 0.0;
        for i in 1..=steps {
            let mut high = largest * i as f64 / steps as f64;
            if margin(high)? > 0.0 {
                low = high;
                continue;
            }
            for _ in 0..100 {
                let middle = 0.5 * (low + high);
                if middle <= low || middle >= high {
                    break;
                }
                if margin(middle)? > 0.0 {
                    low = middle
                } else {
                    high = middle
                }
            }
            return Ok(Some(high));
        }
        Ok(None)
    }
}
