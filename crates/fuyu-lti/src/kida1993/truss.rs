//! The plane truss with three inputs and three outputs (section 3.6, Figs. 3.16 to 3.25).
//!
//! Figure 3.16 with the geometry is lost. The surrogate has what the text says: 99 bars, 45 nodes, 90 degrees of freedom, three rigid modes, 15 modes
//! in the plant and 4 in the design model, forces and displacement sensors at three collocated places. It is a strip of 14 x 2
//! square bays without one diagonal. Mass and stiffness are chosen so that the thesis's weights lie where they act: the crossover of the standard
//! design among the vibration modes. Verdicts and comparisons carry over, numbers do not.

use std::ops::Range;

use nalgebra::DVector;

use crate::matrix::{Complex, Matrix, identity, normal_modes};
use crate::{
    LtiError, ShapedWeights, SigmaPoint, StateSpace, Structure, TransferFunction, closed_loop,
    recovery_observer, shaped_lqr,
};

/// Bays along the strip; it is two bays wide.
const BAYS: usize = 14;
/// Mass per length of the bars in kg/m.
const LINEAR_DENSITY: f64 = 1e-4;
/// Axial stiffness of the bars in N.
const AXIAL_STIFFNESS: f64 = 950.0;
/// Damping ratio of the vibration modes.
const DAMPING: f64 = 0.005;
/// Modes of the plant.
pub const PLANT_MODES: usize = 15;
/// Modes of the design model.
pub const DESIGN_MODES: usize = 4;
/// Noise of the observer.
const MU: f64 = 1e-4;

/// Nodes of the strip as (x, y) in m, numbered along its width first.
pub fn nodes() -> Vec<(f64, f64)> {
    (0..=BAYS)
        .flat_map(|i| (0..=2).map(move |j| (i as f64, j as f64)))
        .collect()
}

/// Bars as pairs of nodes: 99 of them.
pub fn bars() -> Vec<(usize, usize)> {
    let node = |i: usize, j: usize| 3 * i + j;
    let mut out = Vec::new();
    for i in 0..=BAYS {
        for j in 0..=2 {
            if i < BAYS {
                out.push((node(i, j), node(i + 1, j)));
            }
            if j < 2 {
                out.push((node(i, j), node(i, j + 1)));
            }
            // The last diagonal is the one left out.
            if i < BAYS && j < 2 && (i, j) != (BAYS - 1, 1) {
                out.push((node(i, j), node(i + 1, j + 1)));
            }
        }
    }
    out
}

/// Degrees of freedom (2 node + {x: 0, y: 1}) of the three actuators and sensors: x of node 22 in the middle, y of nodes 1 and 43 at the ends.
pub const ACTUATED: [usize; 3] = [44, 3, 87];

/// The first 15 modes, mass normalised.
#[derive(Debug, Clone, PartialEq)]
pub struct Modes {
    /// Frequencies in rad/s, 0 for the three rigid modes.
    pub frequencies: Vec<f64>,
    /// Shapes, 90 x 15: one column per mode, one row per degree of freedom (2 node + {x: 0, y: 1}).
    pub shapes: Matrix,
}

/// Modes of the finite-element model (Fig. 3.17).
pub fn modes() -> Result<Modes, LtiError> {
    let nodes = nodes();
    let n = 2 * nodes.len();
    let (mut mass, mut stiffness) = (Matrix::zeros(n, n), Matrix::zeros(n, n));
    for (p, q) in bars() {
        let (dx, dy) = (nodes[q].0 - nodes[p].0, nodes[q].1 - nodes[p].1);
        let length = dx.hypot(dy);
        let direction = [-dx / length, -dy / length, dx / length, dy / length];
        let dofs = [2 * p, 2 * p + 1, 2 * q, 2 * q + 1];
        for (a, &i) in dofs.iter().enumerate() {
            for (b, &j) in dofs.iter().enumerate() {
                stiffness[(i, j)] += AXIAL_STIFFNESS / length * direction[a] * direction[b];
                // Consistent mass of a bar: rho A l / 6 [2 1; 1 2] in each direction.
                if a % 2 == b % 2 {
                    mass[(i, j)] += LINEAR_DENSITY * length / 6.0 * if a == b { 2.0 } else { 1.0 };
                }
            }
        }
    }
    let (squares, shapes) = normal_modes("the mass matrix of the truss", &mass, &stiffness)?;
    // Three rigid modes, whose eigenvalues are zero but for rounding.
    let frequencies = (0..PLANT_MODES)
        .map(|i| if i < 3 { 0.0 } else { squares[i].sqrt() })
        .collect();
    Ok(Modes {
        frequencies,
        shapes: shapes.columns(0, PLANT_MODES).into_owned(),
    })
}

impl Modes {
    /// From forces to displacements, with some of the modes.
    fn system(&self, which: Range<usize>) -> Result<StateSpace, LtiError> {
        Structure::modal(
            &self.frequencies[which.clone()],
            &vec![DAMPING; which.len()],
            &self
                .shapes
                .columns_range(which)
                .select_rows(&ACTUATED)
                .transpose(),
        )?
        .displacement_system()
    }
}

/// Number of nodes, bars and degrees of freedom, as in the thesis.
pub fn size() -> (usize, usize, usize) {
    (nodes().len(), bars().len(), 2 * nodes().len())
}

/// Plant with the first `count` modes, 4 to 15: forces in N to displacements in m.
pub fn plant(count: usize) -> Result<StateSpace, LtiError> {
    if !(DESIGN_MODES..=PLANT_MODES).contains(&count) {
        return Err(LtiError::Range {
            what: "the number of modes of the truss".into(),
            value: count as f64,
            expected: "between 4 and 15",
        });
    }
    modes()?.system(0..count)
}

/// The three designs of the section.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Weights {
    /// r = q = I (Figs. 3.20, 3.21).
    Standard,
    /// r grows from 50 rad/s (Figs. 3.22, 3.23).
    Control,
    /// r as above, and q = 20 / (s^2 + 1.4 s + 1) (Figs. 3.24, 3.25).
    Both,
}

impl Weights {
    /// All three, in the order of the figures.
    pub const ALL: [Self; 3] = [Self::Standard, Self::Control, Self::Both];
}

/// A design and what it does on the plant with 15 modes.
#[derive(Debug, Clone)]
pub struct Design {
    /// Its weights.
    pub weights: Weights,
    /// Compensator K, closed by negative feedback.
    pub compensator: StateSpace,
    /// Eqs. (3.32) to (3.35) with the design model: disturbance to output, sensitivity, complementary sensitivity, noise to control.
    pub functions: [StateSpace; 4],
    /// Additive model error, the modes that the design model lacks (eq. (3.29)).
    pub error: StateSpace,
    /// H-infinity norm of `Delta K (I + G K)^-1`; below 1 the design is robust (eq. (3.36)).
    pub robustness: f64,
    /// Poles of the plant with 15 modes in closed loop.
    pub poles: Vec<Complex>,
    /// Largest real part of these in rad/s.
    pub largest_real_part: f64,
    /// Displacement at the first actuator under a constant unit force there, for a stable design.
    pub static_deviation: f64,
    closed: StateSpace,
}

/// Designs the compensator on four modes.
pub fn design(weights: Weights) -> Result<Design, LtiError> {
    let modes = modes()?;
    let model = modes.system(0..DESIGN_MODES)?;
    let full = modes.system(0..PLANT_MODES)?;
    let error = modes.system(DESIGN_MODES..PLANT_MODES)?;
    // 1/r = ((s/400)^2 + 1.4 s/400 + 1) / ((s/50)^2 + 1.4 s/50 + 1)
    let inverse_r = TransferFunction::new(
        &[1.0 / 160_000.0, 1.4 / 400.0, 1.0],
        &[1.0 / 2500.0, 1.4 / 50.0, 1.0],
    )?;
    let q = TransferFunction::new(&[20.0], &[1.0, 1.4, 1.0])?;
    let regulator = shaped_lqr(
        &model,
        &ShapedWeights {
            controlled: model.c.clone(),
            output_weight: if weights == Weights::Both {
                Some(q.to_diagonal(3)?)
            } else {
                None
            },
            inverse_input_weight: if weights == Weights::Standard {
                None
            } else {
                Some(inverse_r.to_diagonal(3)?)
            },
            rho: 1.0,
        },
    )?;
    let compensator = regulator.compensator(&recovery_observer(&model, MU)?.gain)?;
    let one = StateSpace::gain(identity(3));
    let open_loop = compensator.series(&model)?;
    let noise_to_control = compensator.feedback(&model)?;
    let closed = closed_loop(&full, &compensator)?;
    let poles = closed.poles()?;
    let largest_real_part = poles.iter().fold(f64::NEG_INFINITY, |m, p| m.max(p.re));
    Ok(Design {
        weights,
        functions: [
            model.feedback(&compensator)?,
            one.feedback(&open_loop)?,
            open_loop.feedback(&one)?,
            noise_to_control.clone(),
        ],
        robustness: noise_to_control.series(&error)?.hinf_norm()?.norm,
        error,
        static_deviation: if largest_real_part < 0.0 {
            closed.dc_gain()?[(0, 0)]
        } else {
            f64::INFINITY
        },
        poles,
        largest_real_part,
        compensator,
        closed,
    })
}

/// Displacements (3) and forces (3) over time.
pub type Response = Vec<(f64, DVector<f64>)>;

impl Design {
    /// Singular values of the four functions at frequencies in rad/s (Figs. 3.20, 3.22, 3.24).
    pub fn sigma(&self, frequencies: &[f64]) -> Result<[Vec<SigmaPoint>; 4], LtiError> {
        let [a, b, c, d] = &self.functions;
        Ok([
            a.sigma(frequencies)?,
            b.sigma(frequencies)?,
            c.sigma(frequencies)?,
            d.sigma(frequencies)?,
        ])
    }

    /// Response of the 15-mode plant to a unit impulse at the first actuator (Figs. 3.21 (a), 3.23 (a), 3.25 (a)).
    pub fn impulse(&self, step: f64, samples: usize) -> Result<Response, LtiError> {
        let outputs = self
            .first_force_responses()?
            .impulse_response(0, step, samples)?;
        Ok(timed(step, outputs))
    }

    /// Response to a unit step of the force at the first actuator (Figs. 3.21 (b), 3.23 (b), 3.25 (b)).
    pub fn step(&self, step: f64, samples: usize) -> Result<Response, LtiError> {
        let outputs = self
            .first_force_responses()?
            .zero_order_hold(step)?
            .step_response(0, samples)?;
        Ok(timed(step, outputs))
    }

    fn first_force_responses(&self) -> Result<StateSpace, LtiError> {
        self.closed.select(&[0, 1, 2, 3, 4, 5], &[0])
    }
}

fn timed(step: f64, outputs: Vec<DVector<f64>>) -> Response {
    outputs
        .into_iter()
        .enumerate()
        .map(|(i, y)| (i as f64 * step, y))
        .collect()
}
