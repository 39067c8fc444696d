//! Structures in second-order form with actuators and sensors at the same places, and direct feedback (Kida 1993 section 4.2).

use crate::matrix::{
    Matrix, blocks, full_svd, identity, positive_definite, semidefinite, shaped, solve, square,
    symmetric, symmetric_part,
};
use crate::{LtiError, StateSpace};

/// `M w'' + C w' + K w = L u` with displacement sensors `L'w` and rate sensors `L'w'` where the actuators are (Kida 1993 eqs. (4.1), (4.2)).
///
/// M is positive definite, C and K positive semidefinite (zero for rigid-body modes), all n x n; L is n x m.
///
/// ```
/// use fuyu_lti::{Matrix, Structure};
/// // A rigid body of 10 kg m2 under direct rate and displacement feedback.
/// let body = Structure::modal(&[0.0], &[0.0], &Matrix::from_element(1, 1, 0.1f64.sqrt()))?;
/// let one = Matrix::identity(1, 1);
/// let closed = body.direct_feedback(&(&one * 4.0), &(&one * 4.0))?;
/// assert!((fuyu_lti::spectral_abscissa(&closed.a)? + 0.2).abs() < 1e-12);
/// # Ok::<(), fuyu_lti::LtiError>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Structure {
    mass: Matrix,
    damping: Matrix,
    stiffness: Matrix,
    input: Matrix,
}

impl Structure {
    /// Errors: sizes, matrices that are not symmetric, a mass matrix that is not positive definite, negative damping or stiffness.
    pub fn new(
        mass: Matrix,
        damping: Matrix,
        stiffness: Matrix,
        input: Matrix,
    ) -> Result<Self, LtiError> {
        let n = square("the mass matrix", &mass)?;
        let mass = symmetric("the mass matrix", &mass, n)?;
        let damping = symmetric("the damping matrix", &damping, n)?;
        let stiffness = symmetric("the stiffness matrix", &stiffness, n)?;
        shaped("the input matrix L", &input, n, input.ncols())?;
        positive_definite("the mass matrix", &mass)?;
        semidefinite("the damping matrix", &damping)?;
        semidefinite("the stiffness matrix", &stiffness)?;
        Ok(Self {
            mass,
            damping,
            stiffness,
            input,
        })
    }

    /// Modal form, mass normalised: frequencies in rad/s (0: rigid), damping ratios, and mode shapes at the actuators (one row per mode, one column per actuator).
    pub fn modal(
        frequencies: &[f64],
        damping_ratios: &[f64],
        shapes: &Matrix,
    ) -> Result<Self, LtiError> {
        let n = frequencies.len();
        if damping_ratios.len() != n {
            return Err(LtiError::Shape {
                what: "the list of damping ratios".into(),
                rows: damping_ratios.len(),
                cols: 1,
                expected: format!("{n} x 1"),
            });
        }
        let diagonal = |f: &dyn Fn(usize) -> f64| {
            Matrix::from_fn(n, n, |i, j| if i == j { f(i) } else { 0.0 })
        };
        Self::new(
            identity(n),
            diagonal(&|i| 2.0 * damping_ratios[i] * frequencies[i]),
            diagonal(&|i| frequencies[i] * frequencies[i]),
            shapes.clone(),
        )
    }

    /// A rigid base with appendages by their constrained modes (hybrid coordinates, Kida 1993 eq. (3.17)), forces and torques on the base.
    ///
    /// `base_mass` (k x k) is the mass matrix of the whole with undeformed appendages; `coupling` P has one row per mode and k columns;
    /// frequencies in rad/s and damping ratios are those of the modes with the base held. Coordinates: those of the base, then the modes.
    pub fn hybrid(
        base_mass: &Matrix,
        coupling: &Matrix,
        frequencies: &[f64],
        damping_ratios: &[f64],
    ) -> Result<Self, LtiError> {
        let (k, nm) = (
            square("the mass matrix of the base", base_mass)?,
            frequencies.len(),
        );
        shaped("the coupling P", coupling, nm, k)?;
        let modes = Self::modal(frequencies, damping_ratios, &Matrix::zeros(nm, 0))?;
        let z = Matrix::zeros;
        let widened = |m: &Matrix| blocks(&[&[&z(k, k), &z(k, nm)], &[&z(nm, k), m]]);
        Self::new(
            blocks(&[
                &[base_mass, &coupling.transpose()],
                &[coupling, &identity(nm)],
            ]),
            widened(&modes.damping),
            widened(&modes.stiffness),
            blocks(&[&[&identity(k)], &[&z(nm, k)]]),
        )
    }

    /// Number of coordinates.
    pub fn coordinates(&self) -> usize {
        self.mass.nrows()
    }

    /// Number of actuators.
    pub fn actuators(&self) -> usize {
        self.input.ncols()
    }

    /// M, n x n.
    pub fn mass(&self) -> &Matrix {
        &self.mass
    }

    /// C, n x n.
    pub fn damping(&self) -> &Matrix {
        &self.damping
    }

    /// K, n x n.
    pub fn stiffness(&self) -> &Matrix {
        &self.stiffness
    }

    /// L, n x m.
    pub fn input(&self) -> &Matrix {
        &self.input
    }

    /// Only some of the actuators, by index from 0.
    pub fn with_actuators(&self, which: &[usize]) -> Result<Self, LtiError> {
        if let Some(&i) = which.iter().find(|&&i| i >= self.actuators()) {
            return Err(LtiError::Range {
                what: "the index of an actuator".into(),
                value: i as f64,
                expected: "below the number of them",
            });
        }
        Ok(Self {
            input: self.input.select_columns(which),
            ..self.clone()
        })
    }

    /// Without coordinates that nothing holds, damps or drives, such as the translation of a free spacecraft under torques: their momentum
    /// is zero, so the mass matrix is that with their accelerations eliminated (Schur complement). Error: a force, damping or stiffness on such a coordinate.
    pub fn without_free_coordinates(&self, free: &[usize]) -> Result<Self, LtiError> {
        let n = self.coordinates();
        let kept: Vec<usize> = (0..n).filter(|i| !free.contains(i)).collect();
        for &i in free {
            if i >= n {
                return Err(LtiError::Range {
                    what: "the index of a free coordinate".into(),
                    value: i as f64,
                    expected: "below the number of coordinates",
                });
            }
            let largest = self
                .damping
                .row(i)
                .amax()
                .max(self.stiffness.row(i).amax())
                .max(self.input.row(i).amax());
            if largest > 0.0 {
                return Err(LtiError::Range {
                    what: format!("damping, stiffness or input of the free coordinate {i}"),
                    value: largest,
                    expected: "zero",
                });
            }
        }
        let part = |m: &Matrix, rows: &[usize], columns: &[usize]| {
            m.select_rows(rows).select_columns(columns)
        };
        let eliminated = solve(
            "the mass of the free coordinates",
            &part(&self.mass, free, free),
            &part(&self.mass, free, &kept),
        )?;
        let mass = part(&self.mass, &kept, &kept) - part(&self.mass, &kept, free) * eliminated;
        Self::new(
            symmetric_part(&mass),
            part(&self.damping, &kept, &kept),
            part(&self.stiffness, &kept, &kept),
            self.input.select_rows(&kept),
        )
    }

    /// State space with the states `[w; w']` and the outputs `C1 w + C2 w'`.
    pub fn with_outputs(
        &self,
        displacement: &Matrix,
        rate: &Matrix,
    ) -> Result<StateSpace, LtiError> {
        let n = self.coordinates();
        let p = displacement.nrows();
        shaped("the displacement outputs", displacement, p, n)?;
        shaped("the rate outputs", rate, p, n)?;
        second_order(
            "the mass matrix",
            &self.mass,
            &self.damping,
            &self.stiffness,
            &self.input,
            &blocks(&[&[displacement, rate]]),
        )
    }

    /// From forces to displacements at the actuators, `L'w`.
    pub fn displacement_system(&self) -> Result<StateSpace, LtiError> {
        self.with_outputs(
            &self.input.transpose(),
            &Matrix::zeros(self.actuators(), self.coordinates()),
        )
    }

    /// From forces to rates at the actuators, `L'w'`.
    pub fn rate_system(&self) -> Result<StateSpace, LtiError> {
        self.with_outputs(
            &Matrix::zeros(self.actuators(), self.coordinates()),
            &self.input.transpose(),
        )
    }

    /// From forces to displacements and rates, `[L'w; L'w']`.
    pub fn displacement_and_rate_system(&self) -> Result<StateSpace, LtiError> {
        let (l, z) = (
            self.input.transpose(),
            Matrix::zeros(self.actuators(), self.coordinates()),
        );
        self.with_outputs(&blocks(&[&[&l], &[&z]]), &blocks(&[&[&z], &[&l]]))
    }

    /// Closed loop under direct velocity and displacement feedback `u = v - P z1 - D z2` (DVDFB; with P = 0, DVFB): from v to `[z1; z2]`.
    ///
    /// P and D are m x m and may be any matrices; [`Structure::certify`] says when stability is guaranteed.
    pub fn direct_feedback(&self, p: &Matrix, d: &Matrix) -> Result<StateSpace, LtiError> {
        let m = self.actuators();
        shaped("the displacement gain P", p, m, m)?;
        shaped("the rate gain D", d, m, m)?;
        self.displacement_and_rate_system()?
            .feedback(&StateSpace::gain(blocks(&[&[p, d]])))
    }

    /// Whether DVDFB with these gains is asymptotically stable for every structure of this form (Kida 1993 Theorem 4.1): P and D symmetric
    /// and positive definite, `[K L]` and `[C L]` of full row rank (every mode that does not decay is reached by an actuator).
    ///
    /// For P = 0 Lemma 4.2 applies: K and C positive definite (no rigid-body mode). The error names what is missing; the loop may be stable nevertheless.
    pub fn certify(&self, p: &Matrix, d: &Matrix) -> Result<(), LtiError> {
        let m = self.actuators();
        let d = symmetric("the rate gain D", d, m)?;
        positive_definite("the rate gain D", &d)?;
        if p.amax() == 0.0 {
            positive_definite("the stiffness matrix", &self.stiffness)?;
            positive_definite("the damping matrix", &self.damping)?;
            return Ok(());
        }
        let p = symmetric("the displacement gain P", p, m)?;
        positive_definite("the displacement gain P", &p)?;
        for (name, matrix) in [("[K L]", &self.stiffness), ("[C L]", &self.damping)] {
            let scaled = |m: &Matrix| {
                if m.amax() > 0.0 {
                    m / m.amax()
                } else {
                    m.clone()
                }
            };
            let (_, values, _) = full_svd(&blocks(&[&[&scaled(matrix), &scaled(&self.input)]]))?;
            if values.last().is_none_or(|&s| s <= 1e-12 * values[0])
                || values.len() < self.coordinates()
            {
                return Err(LtiError::Singular {
                    what: format!(
                        "{name}: a mode is neither held nor reached by an actuator; the matrix"
                    ),
                });
            }
        }
        Ok(())
    }
}

/// `M w'' + C w' + K w = F u` with the states `[w; w']` and the outputs `outputs * [w; w']`. Error: M, whose name is `what`, is singular.
pub(crate) fn second_order(
    what: &str,
    mass: &Matrix,
    damping: &Matrix,
    stiffness: &Matrix,
    input: &Matrix,
    outputs: &Matrix,
) -> Result<StateSpace, LtiError> {
    let (n, m) = input.shape();
    let z = Matrix::zeros;
    let inverse = solve(what, mass, &identity(n))?;
    let accelerations = inverse * blocks(&[&[&-stiffness, &-damping, input]]);
    let ab = blocks(&[&[&z(n, n), &identity(n), &z(n, m)], &[&accelerations]]);
    StateSpace::new(
        ab.columns(0, 2 * n).into_owned(),
        ab.columns(2 * n, m).into_owned(),
        outputs.clone(),
        z(outputs.nrows(), m),
    )
}
