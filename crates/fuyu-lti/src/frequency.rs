//! Frequency responses as data for plots, on grids that resolve lightly damped modes.

use crate::matrix::Complex;
use crate::{LtiError, StateSpace};

/// A point of a Bode diagram.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BodePoint {
    /// Frequency in rad/s.
    pub frequency: f64,
    /// Gain in dB.
    pub gain_db: f64,
    /// Phase in degrees, continuous along the diagram.
    pub phase_deg: f64,
}

/// Singular values at one frequency.
#[derive(Debug, Clone, PartialEq)]
pub struct SigmaPoint {
    /// Frequency in rad/s.
    pub frequency: f64,
    /// Singular values in descending order.
    pub values: Vec<f64>,
}

/// Offsets from a resonance, in units of its half width.
const OFFSETS: [f64; 14] = [
    0.0, 0.15, 0.3, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 5.0, 8.0, 13.0, 25.0, 50.0,
];

impl StateSpace {
    /// Frequencies in rad/s from `low` to `high`, `per_decade` in each decade, with further points around every lightly damped pole and zero. Ascending; of a
    /// discrete system, none above pi over the sampling time.
    pub fn frequency_grid(
        &self,
        low: f64,
        high: f64,
        per_decade: usize,
    ) -> Result<Vec<f64>, LtiError> {
        if !(low > 0.0 && high > low && high.is_finite()) {
            return Err(LtiError::Range {
                what: "the lowest frequency".into(),
                value: low,
                expected: "positive and below the highest",
            });
        }
        let high = high.min(self.nyquist_frequency());
        if high <= low {
            return Err(LtiError::Range {
                what: "the lowest frequency".into(),
                value: low,
                expected: "below pi over the sampling time",
            });
        }
        Ok(self.grid_around(&self.features()?, low, high, per_decade))
    }

    /// The highest frequency that samples show \[rad/s\]; infinite for a continuous system.
    pub(crate) fn nyquist_frequency(&self) -> f64 {
        self.sampling_time
            .map_or(f64::INFINITY, |h| std::f64::consts::PI / h)
    }

    fn grid_around(
        &self,
        features: &[Complex],
        low: f64,
        high: f64,
        per_decade: usize,
    ) -> Vec<f64> {
        let decades = (high / low).log10();
        let count = ((decades * per_decade.max(1) as f64).ceil() as usize).clamp(2, 200_000);
        let mut grid: Vec<f64> = (0..=count)
            .map(|i| low * 10f64.powf(decades * i as f64 / count as f64))
            .collect();
        for p in features {
            let w = p.im.abs();
            if w <= low || w >= high {
                continue;
            }
            let width = p.re.abs().max(1e-7 * w);
            for t in OFFSETS {
                grid.extend(
                    [w - width * t, w + width * t]
                        .into_iter()
                        .filter(|&v| v > low && v < high),
                );
            }
        }
        grid.sort_by(f64::total_cmp);
        grid.dedup_by(|a, b| *a - *b <= 1e-13 * *b);
        grid
    }

    /// Poles and zeros, of a discrete system mapped to the s plane by `ln(z) / h`. Zeros of systems with several inputs or outputs are left out.
    fn features(&self) -> Result<Vec<Complex>, LtiError> {
        let mut out = self.poles()?;
        if self.inputs() == 1 && self.outputs() == 1 {
            out.extend(self.zeros()?);
        }
        if let Some(h) = self.sampling_time {
            out = out
                .into_iter()
                .filter(|z| z.norm() > 1e-12)
                .map(|z| z.ln() / h)
                .collect();
        }
        Ok(out)
    }

    /// A grid from a hundredth of the slowest to a hundred times the fastest pole or zero, and at least from 0.01 to 100 rad/s; of a
    /// discrete system, up to pi over the sampling time.
    pub(crate) fn natural_grid(&self, per_decade: usize) -> Result<Vec<f64>, LtiError> {
        let features = self.features()?;
        let sizes: Vec<f64> = features
            .iter()
            .map(|p| p.norm())
            .filter(|&w| w > 1e-6 && w < 1e12)
            .collect();
        let nyquist = self.nyquist_frequency();
        let low = (sizes.iter().copied().fold(1.0, f64::min) / 100.0).min(nyquist / 100.0);
        let high = (sizes.iter().copied().fold(1.0, f64::max) * 100.0).min(nyquist);
        Ok(self.grid_around(&features, low, high, per_decade))
    }

    /// Samples of the Bode diagram of one entry of the transfer matrix. Frequencies in rad/s, ascending; those at a pole on the imaginary axis are skipped.
    pub fn bode(
        &self,
        output: usize,
        input: usize,
        frequencies: &[f64],
    ) -> Result<Vec<BodePoint>, LtiError> {
        let mut out: Vec<BodePoint> = Vec::with_capacity(frequencies.len());
        for (frequency, g) in self.nyquist(output, input, frequencies)? {
            let mut phase_deg = g.arg().to_degrees();
            if let Some(before) = out.last() {
                phase_deg += 360.0 * ((before.phase_deg - phase_deg) / 360.0).round();
            }
            out.push(BodePoint {
                frequency,
                gain_db: 20.0 * g.norm().log10(),
                phase_deg,
            });
        }
        Ok(out)
    }

    /// Samples of the Nyquist diagram of one entry of the transfer matrix: frequency in rad/s and value.
    pub fn nyquist(
        &self,
        output: usize,
        input: usize,
        frequencies: &[f64],
    ) -> Result<Vec<(f64, Complex)>, LtiError> {
        let one = self.select(&[output], &[input])?;
        Ok(frequencies
            .iter()
            .filter_map(|&w| Some((w, one.response(w).ok()?[(0, 0)])))
            .collect())
    }

    /// Samples of the singular value diagram.
    pub fn sigma(&self, frequencies: &[f64]) -> Result<Vec<SigmaPoint>, LtiError> {
        let mut out = Vec::with_capacity(frequencies.len());
        for &frequency in frequencies {
            if let Ok(values) = self.singular_values(frequency) {
                out.push(SigmaPoint { frequency, values });
            }
        }
        Ok(out)
    }
}

/// Largest singular value over all frequencies and where it is, by a sweep with refinement of each peak: a lower bound of the H-infinity norm.
pub(crate) fn peak_gain(sys: &StateSpace) -> Result<(f64, f64), LtiError> {
    let gain = |w: f64| {
        sys.singular_values(w)
            .ok()
            .and_then(|v| v.first().copied())
            .unwrap_or(0.0)
    };
    let mut grid = vec![0.0];
    grid.extend(sys.natural_grid(20)?);
    let values: Vec<f64> = grid.iter().map(|&w| gain(w)).collect();
    let largest = values.iter().copied().fold(0.0, f64::max);
    let mut best = (0.0, 0.0);
    for i in 0..grid.len() {
        if values[i] > best.0 {
            best = (values[i], grid[i]);
        }
        // Only peaks that could become the largest are worth refining.
        let inside = i > 0 && i + 1 < grid.len();
        if inside
            && values[i] >= values[i - 1]
            && values[i] >= values[i + 1]
            && values[i] > 0.3 * largest
        {
            let (g, w) = golden_maximum(&gain, grid[i - 1], grid[i + 1]);
            if g > best.0 {
                best = (g, w);
            }
        }
    }
    Ok(best)
}

/// Maximum of a function that has one peak between the limits: value and place.
pub(crate) fn golden_maximum(f: &impl Fn(f64) -> f64, mut low: f64, mut high: f64) -> (f64, f64) {
    let ratio = 0.5 * (5f64.sqrt() - 1.0);
    let (mut x1, mut x2) = (high - ratio * (high - low), low + ratio * (high - low));
    let (mut f1, mut f2) = (f(x1), f(x2));
    for _ in 0..80 {
        if high - low <= 1e-10 * high.abs() {
            break;
        }
        if f1 >= f2 {
            (high, x2, f2) = (x2, x1, f1);
            x1 = high - ratio * (high - low);
            f1 = f(x1);
        } else {
            (low, x1, f1) = (x1, x2, f2);
            x2 = low + ratio * (high - low);
            f2 = f(x2);
        }
    }
    if f1 >= f2 { (f1, x1) } else { (f2, x2) }
}
