//! Gain and phase margins of a loop with one input and one output.

use crate::frequency::golden_maximum;
use crate::matrix::{Complex, shaped};
use crate::{LtiError, StateSpace};

/// A frequency at which the loop gain is 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PhaseMargin {
    /// Frequency in rad/s.
    pub frequency: f64,
    /// Angle in degrees, within (-180, 180], by which the loop's phase is ahead of -180 degrees.
    pub degrees: f64,
}

/// A frequency at which the loop's phase is -180 degrees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GainMargin {
    /// Frequency in rad/s.
    pub frequency: f64,
    /// Gain in dB by which the loop gain may grow before it is 1 here; negative: by which it may fall.
    pub decibel: f64,
}

/// Margins of a loop under negative feedback.
#[derive(Debug, Clone, PartialEq)]
pub struct Margins {
    /// All gain crossovers, by frequency.
    pub phase: Vec<PhaseMargin>,
    /// All phase crossovers, by frequency.
    pub gain: Vec<GainMargin>,
    /// Smallest return difference |1 + L|: distance of the Nyquist curve from -1. For a strictly proper loop it is at most 1.
    pub min_return_difference: f64,
    /// Frequency of that in rad/s.
    pub min_return_difference_at: f64,
}

impl Margins {
    /// The phase margin of least size.
    pub fn smallest_phase(&self) -> Option<PhaseMargin> {
        self.phase
            .iter()
            .copied()
            .min_by(|a, b| a.degrees.abs().total_cmp(&b.degrees.abs()))
    }

    /// The gain margin of least size.
    pub fn smallest_gain(&self) -> Option<GainMargin> {
        self.gain
            .iter()
            .copied()
            .min_by(|a, b| a.decibel.abs().total_cmp(&b.decibel.abs()))
    }
}

/// Margins of the open loop L, with one input and one output, that is closed by negative feedback.
///
/// Crossovers are bracketed on a grid that resolves every pole and zero, and refined by bisection to rounding. They are margins of
/// stability only if the closed loop is stable.
///
/// ```
/// use fuyu_lti::{TransferFunction, margins};
/// // 1 / (s (s + 1)): crossover at sqrt((sqrt(5) - 1) / 2), phase margin 51.83 degrees.
/// let l = TransferFunction::new(&[1.0], &[1.0, 1.0, 0.0])?.to_state_space()?;
/// let m = margins(&l)?;
/// assert!((m.phase[0].degrees - 51.827292).abs() < 1e-6);
/// assert!(m.gain.is_empty());
/// # Ok::<(), fuyu_lti::LtiError>(())
/// ```
pub fn margins(open_loop: &StateSpace) -> Result<Margins, LtiError> {
    shaped("D of the loop", &open_loop.d, 1, 1)?;
    let value = |w: f64| open_loop.response(w).ok().map(|g| g[(0, 0)]);
    let samples: Vec<(f64, Complex)> = open_loop
        .natural_grid(120)?
        .into_iter()
        .filter_map(|w| Some((w, value(w)?)))
        .collect();
    let mut out = Margins {
        phase: Vec::new(),
        gain: Vec::new(),
        min_return_difference: f64::INFINITY,
        min_return_difference_at: 0.0,
    };
    for pair in samples.windows(2) {
        let [(w1, g1), (w2, g2)] = [pair[0], pair[1]];
        if (g1.norm() > 1.0) != (g2.norm() > 1.0) {
            let w = bisect(w1, w2, |w| value(w).map(|g| g.norm() - 1.0));
            if let Some(g) = value(w).filter(|g| (g.norm() - 1.0).abs() < 1e-3) {
                let degrees = (-g).arg().to_degrees();
                out.phase.push(PhaseMargin {
                    frequency: w,
                    degrees,
                });
            }
        }
        if (g1.im > 0.0) != (g2.im > 0.0) {
            let w = bisect(w1, w2, |w| value(w).map(|g| g.im));
            if let Some(g) = value(w).filter(|g| g.re < 0.0 && g.im.abs() < 1e-6 * g.norm()) {
                out.gain.push(GainMargin {
                    frequency: w,
                    decibel: -20.0 * g.norm().log10(),
                });
            }
        }
    }
    let distance = |w: f64| value(w).map_or(f64::INFINITY, |g| (g + 1.0).norm());
    for i in 0..samples.len() {
        let here = (samples[i].1 + 1.0).norm();
        if here < out.min_return_difference {
            (out.min_return_difference, out.min_return_difference_at) = (here, samples[i].0);
        }
        let neighbours = i > 0 && i + 1 < samples.len();
        if neighbours
            && here <= (samples[i - 1].1 + 1.0).norm()
            && here <= (samples[i + 1].1 + 1.0).norm()
        {
            let (negative, w) =
                golden_maximum(&|w| -distance(w), samples[i - 1].0, samples[i + 1].0);
            if -negative < out.min_return_difference {
                (out.min_return_difference, out.min_return_difference_at) = (-negative, w);
            }
        }
    }
    Ok(out)
}

/// The place between two frequencies where the sign of f changes; f is `None` at a pole.
fn bisect(mut low: f64, mut high: f64, f: impl Fn(f64) -> Option<f64>) -> f64 {
    let start = f(low).unwrap_or(0.0) > 0.0;
    for _ in 0..100 {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            break;
        }
        match f(middle) {
            Some(v) if (v > 0.0) == start => low = middle,
            Some(_) => high = middle,
            None => break,
        }
    }
    0.5 * (low + high)
}

/// Loop of one channel of a square plant with all other channels closed: cut at input `channel`, from the plant input to the negative of the feedback that returns there.
///
/// `controller` maps plant outputs to plant inputs and is closed by negative feedback.
pub fn loop_at_input(
    plant: &StateSpace,
    controller: &StateSpace,
    channel: usize,
) -> Result<StateSpace, LtiError> {
    let m = plant.inputs();
    let full = plant.series(controller)?;
    if channel >= m {
        return Err(LtiError::Range {
            what: "the channel".into(),
            value: channel as f64,
            expected: "below the number of inputs",
        });
    }
    // Inputs and outputs with the open channel first; the others are closed.
    let order: Vec<usize> = std::iter::once(channel)
        .chain((0..m).filter(|&i| i != channel))
        .collect();
    let sorted = full.select(&order, &order)?;
    let others = StateSpace::gain(-crate::matrix::identity(m - 1));
    sorted.lower_lft(&others, m - 1, m - 1)
}
