//! The main component of `|w|²`: Masutani 1995 app. D.1 and D.2.

use std::f64::consts::{PI, TAU};

use rustfft::{FftPlanner, num_complex::Complex};

use super::Options;

/// An amplitude below this share of the mean is rounding error: `|w|²` is constant.
const ROUNDING: f64 = 1e-9;

/// The spectrum of `|w|²` and its main component `A cos(2π (t - t0)/T + phase)`.
#[derive(Debug, Clone, PartialEq)]
pub struct Spectrum {
    /// Magnitudes `|G(κ)|` of (D.6), `κ = 0 ... N/2`, \[rad²/s²\].
    pub magnitudes: Vec<f64>,
    /// Bin of the largest magnitude.
    pub bin: usize,
    /// Largest magnitude outside the neighbourhood of the main component, as a fraction of the main magnitude.
    pub rival: f64,
    /// Period `T` of the main component \[s\], from the parabola through three bins, (D.7)-(D.12).
    pub period: f64,
    /// Amplitude `A` of the main component \[rad²/s²\], (D.14).
    pub amplitude: f64,
    /// Phase of the main component at the first sample \[rad\].
    pub phase: f64,
    /// Mean of `|w|²` \[rad²/s²\].
    pub mean: f64,
    /// Whether there is a main component, and no other of similar size.
    pub distinct: bool,
}

impl Spectrum {
    /// The spectrum of `|w|²` \[rad²/s²\] over time \[s\]; at least four samples in the order of time. Unevenly
    /// spaced samples (lost frames) are interpolated linearly to even spacing.
    pub fn of(samples: &[(f64, f64)], options: &Options) -> Self {
        let values = evenly(samples);
        let duration = samples[samples.len() - 1].0 - samples[0].0;
        let n = values.len();
        let size = n.next_power_of_two();
        let mean = values.iter().sum::<f64>() / n as f64;
        let window = |i: usize| 0.5 * (1.0 - (TAU * i as f64 / n as f64).cos());
        let windowed = values
            .iter()
            .enumerate()
            .map(|(i, x)| window(i) * (x - mean));
        let mut data: Vec<_> = windowed.map(|x| Complex::new(x, 0.0)).collect();
        data.resize(size, Complex::new(0.0, 0.0));
        FftPlanner::new().plan_fft_forward(size).process(&mut data);
        let scale = (size as f64).recip();
        data.truncate(size / 2 + 1);
        let magnitudes: Vec<_> = data.iter().map(|g| g.norm() * scale).collect();

        let inner = 1..magnitudes.len() - 1;
        let bin = inner.max_by(|&a, &b| magnitudes[a].total_cmp(&magnitudes[b]));
        let bin = bin.unwrap_or(1);
        let far = |k: &usize| k.abs_diff(bin) as f64 > options.neighbourhood;
        let rival = (0..magnitudes.len()).filter(far).map(|k| magnitudes[k]);
        let rival = rival.fold(0.0, f64::max) / magnitudes[bin];

        let (low, peak, high) = (magnitudes[bin - 1], magnitudes[bin], magnitudes[bin + 1]);
        let c2 = 0.5 * (low + high) - peak;
        let c1 = 0.5 * (high - low);
        // Relative to the bin. The lowest bin need not be a maximum, because the mean was subtracted from its neighbour.
        let shift = if c2 < 0.0 {
            (-0.5 * c1 / c2).clamp(-0.5, 0.5)
        } else {
            0.0
        };
        let bins_per_hertz = size as f64 * duration / (n as f64 - 1.0);
        let period = bins_per_hertz / (bin as f64 + shift);
        // (D.13): integral of the squared parabola between its roots.
        let power = if c2 < 0.0 {
            let distance = (c1 * c1 - 4.0 * c2 * peak).sqrt() / c2.abs();
            c2 * c2 * distance.powi(5) / 30.0
        } else {
            peak * peak
        };
        let weight = size as f64 * (0..n).map(|i| window(i).powi(2)).sum::<f64>();
        let amplitude = 2.0 * size as f64 * (power / weight).sqrt();
        // Between bins the phase falls by π n/N, the window being symmetric about its middle.
        let phase = data[bin].arg() - shift * PI * n as f64 * scale;
        Self {
            distinct: rival <= options.rival && amplitude > ROUNDING * mean,
            magnitudes,
            bin,
            rival,
            period,
            amplitude,
            phase,
            mean,
        }
    }
}

/// The values at evenly spaced times from the first to the last, at the median interval.
fn evenly(samples: &[(f64, f64)]) -> Vec<f64> {
    let mut intervals: Vec<_> = samples.windows(2).map(|p| p[1].0 - p[0].0).collect();
    intervals.sort_by(f64::total_cmp);
    let median = intervals[intervals.len() / 2];
    let even = |d: &f64| (d - median).abs() < 0.01 * median;
    if intervals.iter().all(even) {
        return samples.iter().map(|(_, x)| *x).collect();
    }
    let (start, end) = (samples[0].0, samples[samples.len() - 1].0);
    // Bounded, in case the median interval is very small compared with others.
    let count = ((end - start) / median)
        .round()
        .min(20.0 * samples.len() as f64) as usize;
    let mut after = 1;
    (0..=count)
        .map(|i| {
            let time = start + (end - start) * i as f64 / count as f64;
            while after + 1 < samples.len() && samples[after].0 < time {
                after += 1;
            }
            let ((t0, x0), (t1, x1)) = (samples[after - 1], samples[after]);
            x0 + (x1 - x0) * (time - t0) / (t1 - t0)
        })
        .collect()
}
