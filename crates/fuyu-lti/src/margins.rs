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
/// Crossovers are bracketed on a grid that resolves every pole and zero, and refined by bisection to rounding. The grid is extended, by up
/// to 12 decades on either side, to where the gain crosses 1. They are margins of stability only if the closed loop is stable.
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
    let mut samples: Vec<(f64, Complex)> = open_loop
        .natural_grid(PER_DECADE)?
        .into_iter()
        .filter_map(|w| Some((w, value(w)?)))
        .collect();
    extend_to_crossovers(&mut samples, open_loop.nyquist_frequency(), value);
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
    // The response is real at the ends of the frequencies, where its imaginary part has no change of sign.
    let ends = [0.0, open_loop.nyquist_frequency()];
    for w in ends.into_iter().filter(|w| w.is_finite()) {
        let crosses =
            |g: &Complex| g.re < 0.0 && g.im.abs() <= 1e-9 * g.norm() && g.norm() < INTEGRATES;
        let is_known = out
            .gain
            .iter()
            .any(|m| (m.frequency - w).abs() <= 1e-6 * (1.0 + w));
        if let Some(g) = value(w).filter(crosses).filter(|_| !is_known) {
            out.gain.push(GainMargin {
                frequency: w,
                decibel: -20.0 * g.norm().log10(),
            });
        }
    }
    out.gain.sort_by(|a, b| a.frequency.total_cmp(&b.frequency));
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

/// Gain at frequency zero beyond which the loop is one with an integrator, of which rounding has left a number.
const INTEGRATES: f64 = 1e12;

/// Points of the grid in each decade.
const PER_DECADE: usize = 120;

/// Most decades by which the grid is extended on either side.
const MOST_DECADES: usize = 12;

/// Extends ascending samples of a loop at both ends, decade by decade up to `highest` \[rad/s\], while the gain there goes towards 1 and
/// has not crossed it.
fn extend_to_crossovers(
    samples: &mut Vec<(f64, Complex)>,
    highest: f64,
    value: impl Fn(f64) -> Option<Complex>,
) {
    for factor in [0.1, 10.0] {
        let mut added = Vec::new();
        let end = if factor > 1.0 {
            samples.last()
        } else {
            samples.first()
        };
        let Some(&(mut w, mut g)) = end else {
            return;
        };
        for _ in 0..MOST_DECADES {
            let next = (w * factor).min(highest);
            let Some(beyond) = value(next).filter(|_| next != w) else {
                break;
            };
            // A loop that is constant here never crosses.
            let slope = (beyond.norm() / g.norm()).ln() / (next / w).ln().abs();
            if !(g.norm() > 1.0 && slope < -0.1 || g.norm() < 1.0 && slope > 0.1) {
                break;
            }
            let points =
                (1..=PER_DECADE).map(|i| w * (next / w).powf(i as f64 / PER_DECADE as f64));
            added.extend(points.filter_map(|w| Some((w, value(w)?))));
            (w, g) = (next, beyond);
        }
        samples.extend(added);
        samples.sort_by(|a, b| a.0.total_cmp(&b.0));
    }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TransferFunction;

    // 2 / (s - 1) is stable from half the gain on, k / (z - 0.5) up to k = 1.5, where its pole is at -1.
    #[test]
    fn crossovers_at_the_ends_of_the_frequencies_are_found() {
        let unstable = TransferFunction::new(&[2.0], &[1.0, -1.0]).unwrap();
        let found = margins(&unstable.to_state_space().unwrap()).unwrap();
        assert_eq!(found.gain.len(), 1);
        assert_eq!(found.gain[0].frequency, 0.0);
        assert!((found.gain[0].decibel + 20.0 * 2f64.log10()).abs() < 1e-9);
        let sampled = TransferFunction::new(&[0.5], &[1.0, -0.5]).unwrap();
        let mut sampled = sampled.to_state_space().unwrap();
        sampled.sampling_time = Some(0.1);
        let found = margins(&sampled).unwrap();
        let last = found.gain.last().expect("at the Nyquist frequency");
        assert!(
            (last.decibel - 20.0 * 3f64.log10()).abs() < 1e-6,
            "{found:?}"
        );
        // An integrator has none at zero.
        let integrator = TransferFunction::new(&[1.0], &[1.0, 1.0, 0.0]).unwrap();
        let found = margins(&integrator.to_state_space().unwrap()).unwrap();
        assert!(found.gain.is_empty(), "{found:?}");
    }

    // Crossovers far from every pole, by hand. They are missed by a grid that follows the poles alone.
    #[test]
    fn crossovers_far_from_the_poles_are_found() {
        let crossovers = |numerator: &[f64], denominator: &[f64]| {
            let l = TransferFunction::new(numerator, denominator).unwrap();
            margins(&l.to_state_space().unwrap()).unwrap().phase
        };
        // w² (w² + 1) = 1e10.
        let w = ((1.0 + 4e10_f64).sqrt() / 2.0 - 0.5).sqrt();
        let degrees = (1.0 / w).atan().to_degrees();
        let found = crossovers(&[1e5], &[1.0, 1.0, 0.0]);
        assert_eq!(found.len(), 1);
        assert!((found[0].frequency / w - 1.0).abs() < 1e-9, "{found:?}");
        assert!((found[0].degrees - degrees).abs() < 1e-6, "{found:?}");
        for gain in [1e-3, 1e3, 1e-9, 1e9] {
            let found = crossovers(&[gain], &[1.0, 0.0]);
            assert_eq!(found.len(), 1, "{gain}");
            assert!((found[0].frequency / gain - 1.0).abs() < 1e-9, "{found:?}");
            assert!((found[0].degrees - 90.0).abs() < 1e-6, "{found:?}");
        }
        // A differentiator with lag: 1e6 w = sqrt(w² + 1).
        let found = crossovers(&[1e6, 0.0], &[1.0, 1.0]);
        assert_eq!(found.len(), 1);
        assert!((found[0].frequency - 1e-6).abs() < 1e-12, "{found:?}");
        // Constant at both ends.
        assert!(crossovers(&[2.0, 6.0], &[1.0, 2.0]).is_empty());
    }

    // Samples of an integrator every 1000 s, whose highest frequency is below that of the usual grid.
    #[test]
    fn a_slowly_sampled_loop_has_its_crossover() {
        let one = |x: f64| crate::matrix::Matrix::from_element(1, 1, x);
        let l = StateSpace::discrete(one(1.0), one(1.0), one(0.5), one(0.0), 1000.0).unwrap();
        // |0.5 / (e^(jwh) - 1)| = 0.25 / sin(w h / 2).
        let found = margins(&l).unwrap().phase;
        let w = 2.0 * 0.25_f64.asin() / 1000.0;
        assert_eq!(found.len(), 1);
        assert!((found[0].frequency / w - 1.0).abs() < 1e-9, "{found:?}");
        assert!(l.frequency_grid(0.01, 1.0, 10).is_err());
    }
}
