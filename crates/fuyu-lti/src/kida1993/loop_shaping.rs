//! Loop-shaping examples 1 to 4 (section 3.5.3, Figs. 3.12 to 3.15).

use crate::matrix::{Matrix, identity};
use crate::{LtiError, ShapedWeights, StateSpace, TransferFunction, shaped_lqr};

/// Weight of the control in all examples.
pub const RHO: f64 = 1e-3;

/// The rigid mode of the air table: states angle and rate of eta, output y = .31 eta.
pub fn plant() -> Result<StateSpace, LtiError> {
    StateSpace::new(
        Matrix::from_row_slice(2, 2, &[0.0, 1.0, 0.0, 0.0]),
        Matrix::from_row_slice(2, 1, &[0.0, 0.31]),
        Matrix::from_row_slice(1, 2, &[0.31, 0.0]),
        Matrix::zeros(1, 1),
    )
}

/// Which cost is minimised.
#[derive(Debug, Clone, PartialEq)]
pub enum Cost {
    /// `|y|^2 + rho |u|^2`
    Standard,
    /// J1, eq. (3.25): `|y|^2 + rho |r u|^2`, with 1/r given.
    Control(TransferFunction),
    /// J2, eq. (3.26): `|y / r|^2 + rho |u|^2`, with 1/r given.
    Output(TransferFunction),
    /// J3: `|q y|^2 + rho |r u|^2`, with q and 1/r given.
    Both(TransferFunction, TransferFunction),
}

/// An example: its number, and the designs that its figure compares.
#[derive(Debug, Clone, PartialEq)]
pub struct Example {
    /// 1 to 4.
    pub number: usize,
    /// Costs with their names in the figure.
    pub costs: Vec<(&'static str, Cost)>,
}

/// The four examples. In example 4 the thesis prints q = (s+50)/(s+50) and 1/r = 1/(s+.05); meant are q = (s+1)/(s+.05) and 1/r = 50/(s+50),
/// which do what text and figure say.
pub fn examples() -> Result<Vec<Example>, LtiError> {
    let lowpass = TransferFunction::first_order_lowpass(50.0)?;
    let slow = TransferFunction::new(&[1.0], &[1.0, 0.05])?;
    let lead_lag = TransferFunction::lead_lag(1.0, 1.0, 0.05)?;
    let pair = |number, f: &TransferFunction| Example {
        number,
        costs: vec![
            ("J1", Cost::Control(f.clone())),
            ("J2", Cost::Output(f.clone())),
            ("standard LQ", Cost::Standard),
        ],
    };
    Ok(vec![
        pair(1, &lowpass),
        pair(2, &slow),
        pair(3, &lead_lag),
        Example {
            number: 4,
            costs: vec![
                ("J3", Cost::Both(lead_lag.clone(), lowpass.clone())),
                ("standard LQ", Cost::Standard),
            ],
        },
    ])
}

/// Loop and closed-loop functions of a design, cut at the plant input.
#[derive(Debug, Clone)]
pub struct Shapes {
    /// l = k (s I - A)^-1 b
    pub open_loop: StateSpace,
    /// s = 1 / (1 + l)
    pub sensitivity: StateSpace,
    /// t = l / (1 + l)
    pub complementary: StateSpace,
    /// m: from a disturbance at the input to y.
    pub disturbance: StateSpace,
    /// Relative residual of the Riccati equation.
    pub residual: f64,
}

/// Designs the regulator of a cost with the states measured.
pub fn shapes(cost: &Cost) -> Result<Shapes, LtiError> {
    let g = plant()?;
    let system = |f: &TransferFunction| f.to_state_space().map(Some);
    let (output_weight, inverse_input_weight) = match cost {
        Cost::Standard => (None, None),
        Cost::Control(r) => (None, system(r)?),
        Cost::Output(q) => (system(q)?, None),
        Cost::Both(q, r) => (system(q)?, system(r)?),
    };
    let regulator = shaped_lqr(
        &g,
        &ShapedWeights {
            controlled: g.c.clone(),
            output_weight,
            inverse_input_weight,
            rho: RHO,
        },
    )?;
    let open_loop = regulator.state_loop()?;
    let one = StateSpace::gain(identity(1));
    let closed_states = g.to_states().feedback(&regulator.state_feedback)?;
    Ok(Shapes {
        sensitivity: one.feedback(&open_loop)?,
        complementary: open_loop.feedback(&one)?,
        disturbance: closed_states.scaled_outputs(&g.c)?,
        residual: regulator.residual,
        open_loop,
    })
}
