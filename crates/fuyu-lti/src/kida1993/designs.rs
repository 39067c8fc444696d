//! Designs 1 to 5 for the air table (section 3.4, Figs. 3.6 to 3.10).

use nalgebra::DVector;

use super::air_table::{self, SAMPLING_TIME};
use crate::matrix::{Complex, Matrix};
use crate::{
    LtiError, Margins, SampledLoop, SampledRun, ShapedWeights, StateSpace, TransferFunction,
    margins, recovery_observer, shaped_lqr,
};

/// Parameters of a design.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Config {
    /// What the thesis calls it.
    pub name: &'static str,
    /// Modes in the design model, the rigid one included.
    pub modes: usize,
    /// Weight of the control, rho.
    pub rho: f64,
    /// Noise of the observer, mu.
    pub mu: f64,
    /// Second-order low-pass 1/r: cut-off in rad/s and damping ratio; `None` for the standard regulator.
    pub shaping: Option<(f64, f64)>,
    /// Verdict of the thesis: whether the experiment was stable.
    pub stable_in_thesis: bool,
}

/// The five designs.
pub const DESIGNS: [Config; 5] = [
    Config {
        name: "design 1 (standard LQ)",
        modes: 1,
        rho: 1e-3,
        mu: 1e-3,
        shaping: None,
        stable_in_thesis: false,
    },
    Config {
        name: "design 2 (1 mode)",
        modes: 1,
        rho: 1e-3,
        mu: 1e-3,
        shaping: Some((1.0, 0.7)),
        stable_in_thesis: true,
    },
    Config {
        name: "design 3 (2 modes)",
        modes: 2,
        rho: 1e-5,
        mu: 1e-6,
        shaping: Some((10.0, 0.7)),
        stable_in_thesis: true,
    },
    Config {
        name: "design 4 (2 modes, LTR)",
        modes: 2,
        rho: 1e-5,
        mu: 1e-12,
        shaping: Some((10.0, 0.7)),
        stable_in_thesis: true,
    },
    Config {
        name: "design 5 (3 modes)",
        modes: 3,
        rho: 1e-6,
        mu: 1e-7,
        shaping: Some((10.0, 0.7)),
        stable_in_thesis: true,
    },
];

/// A design and its verdict on the plant with all seven modes.
#[derive(Debug, Clone)]
pub struct Design {
    /// Its parameters.
    pub config: Config,
    /// State feedback K, 1 x 2 modes.
    pub gain: Matrix,
    /// Feedback of the filter's states K_0, 1 x 2; 1 x 0 for the standard regulator.
    pub filter_gain: Matrix,
    /// Observer gain, 2 modes x 1.
    pub observer_gain: Matrix,
    /// Compensator F, G, H of eq. (3.16), closed by negative feedback.
    pub compensator: StateSpace,
    /// Loop of the state feedback l(s) on the design model.
    pub state_loop: StateSpace,
    /// Poles of the design model with the compensator: stable by Theorem 3.5.
    pub nominal_poles: Vec<Complex>,
    /// Poles of the seven-mode plant with the compensator.
    pub poles: Vec<Complex>,
    /// Largest real part of these in rad/s; the design is stable if it is negative.
    pub largest_real_part: f64,
    /// Margins of the loop with the seven-mode plant.
    pub margins: Margins,
    /// Largest relative residual of the Riccati equations.
    pub residual: f64,
}

impl Design {
    /// Loop of the seven-mode plant and the compensator, drawn solid in Figs. 3.6 (a) to 3.10 (a).
    pub fn open_loop(&self) -> Result<StateSpace, LtiError> {
        air_table::plant(7)?.series(&self.compensator)
    }

    /// Response of the seven-mode plant to a step of the reference by one degree, with the compensator sampled every 10 ms and the torque limited to
    /// `limit` N m: Figs. 3.6 (b) to 3.10 (b). Output in rad, command in N m.
    pub fn step(&self, seconds: f64, limit: f64) -> Result<SampledRun, LtiError> {
        let mut sampled =
            SampledLoop::new(&air_table::plant(7)?, &self.compensator, SAMPLING_TIME)?;
        sampled.limit = limit;
        let degree = 1f64.to_radians();
        sampled.run(
            (seconds / SAMPLING_TIME).round() as usize + 1,
            |_| DVector::from_element(1, degree),
            |_| DVector::zeros(1),
        )
    }
}

/// Synthesis on the low-order model, verdict on the seven-mode plant.
pub fn design(config: &Config) -> Result<Design, LtiError> {
    let model = air_table::plant(config.modes)?;
    let weights = ShapedWeights {
        controlled: model.c.clone(),
        output_weight: None,
        inverse_input_weight: match config.shaping {
            Some((w0, zeta)) => Some(
                TransferFunction::second_order_lowpass(w0, zeta)?
                    .to_state_space()
                    .map(filter_states)?,
            ),
            None => None,
        },
        rho: config.rho,
    };
    let regulator = shaped_lqr(&model, &weights)?;
    let observer = recovery_observer(&model, config.mu)?;
    let compensator = regulator.compensator(&observer.gain)?;
    let plant = air_table::plant(7)?;
    let closed = plant.feedback(&compensator)?;
    let poles = closed.poles()?;
    Ok(Design {
        config: *config,
        gain: regulator.gain.clone(),
        filter_gain: regulator.gain_r.clone(),
        state_loop: regulator.state_loop()?,
        nominal_poles: model.feedback(&compensator)?.poles()?,
        largest_real_part: poles.iter().fold(f64::NEG_INFINITY, |m, p| m.max(p.re)),
        poles,
        margins: margins(&plant.series(&compensator)?)?,
        residual: regulator.residual.max(observer.residual),
        observer_gain: observer.gain,
        compensator,
    })
}

/// The realisation of eq. (3.9): `B_o = [0; Omega^2]`, `C_o = [I 0]`, where the companion form has the gain in C.
fn filter_states(companion: StateSpace) -> StateSpace {
    let gain = companion.c[(0, 0)];
    StateSpace {
        b: &companion.b * gain,
        c: &companion.c / gain,
        ..companion
    }
}

/// The filter 1/r of the cost and that which the optimal feedback makes of it (section 3.3.2): cut-off in rad/s and damping ratio of both.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FilterChange {
    /// Of 1/r.
    pub designed: (f64, f64),
    /// Of the realised filter 1/r_o.
    pub realized: (f64, f64),
}

/// Theorem 3.3 in numbers, from the gains K_0 = [k1 k2]: `w'^2 = w^2 (1 + k1)`, `2 z' w' = 2 z w + w^2 k2`. `None` for the standard regulator.
///
/// (The thesis prints w'^2 k2 in the second; eq. (3.13) has w^2 k2.)
pub fn filter_change(design: &Design) -> Option<FilterChange> {
    let (w, z) = design.config.shaping?;
    let (k1, k2) = (design.filter_gain[(0, 0)], design.filter_gain[(0, 1)]);
    let realized = w * (1.0 + k1).sqrt();
    Some(FilterChange {
        designed: (w, z),
        realized: (realized, (2.0 * z * w + w * w * k2) / (2.0 * realized)),
    })
}
