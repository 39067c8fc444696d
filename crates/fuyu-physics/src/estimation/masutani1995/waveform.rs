//! The waveform of `|w|²` by non-linear least squares: Masutani 1995 app. D.3.

use nalgebra::{SMatrix, SVector, Vector2, Vector3};

use super::{Options, Spectrum};
use crate::estimation::elliptic::{Modulus, modulus_with_2kK};

/// Samples of `|w|²` \[rad²/s²\] over the time since the first \[s\].
pub(super) type Samples = [(f64, f64)];

/// `|w|² = beta - k² λ² sn²(k, λ (t - t0) - delta)` with `λ = 2 K(k)/T`, eqs. (2.33), (2.34).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Waveform {
    /// Largest value \[rad²/s²\].
    pub beta: f64,
    /// Modulus.
    pub k: f64,
    /// Phase \[rad\], relative to the first sample's time.
    pub delta: f64,
    /// Period \[s\]: that of the spectrum, not fitted.
    pub period: f64,
    /// RMS residual \[rad²/s²\].
    pub rms: f64,
}

impl Waveform {
    /// Fits the waveform, starting from the spectrum's main component, (D.33) and (D.34). `None` if the fit fails.
    pub fn fit(samples: &Samples, spectrum: &Spectrum, options: &Options) -> Option<Self> {
        let period = spectrum.period;
        let amplitude = spectrum.amplitude;
        let start = modulus_with_2kK(period * (2.0 * amplitude).sqrt());
        // (D.17): A cos(2π t/T + phase) is largest at t = -phase T / 2π.
        let lag = (-spectrum.phase).rem_euclid(std::f64::consts::TAU);
        let delta = start.quarter_period() / std::f64::consts::PI * lag;
        let x = Vector3::new(spectrum.mean + amplitude, delta, start.k().min(0.999_999));
        let model = |x: &Vector3<f64>| {
            let [beta, delta, k]: [f64; 3] = (*x).into();
            let step = 1e-6 * (1.0 - k).min(k);
            let [wave, below, above] = [k, k - step, k + step].map(|k| Wave::new(beta, k, period));
            let (wave, below, above) = (wave?, below?, above?);
            Some(move |t: f64| {
                let (value, by_delta) = wave.at(t, delta);
                // (D.32): by differences, as there is no closed form.
                let by_k = (above.at(t, delta).0 - below.at(t, delta).0) / (2.0 * step);
                (value, Vector3::new(1.0, by_delta, by_k))
            })
        };
        let (x, sum) = gauss_newton(x, samples, options, model)?;
        Some(Self {
            beta: x[0],
            delta: x[1],
            k: x[2],
            period,
            rms: (sum / samples.len() as f64).sqrt(),
        })
    }

    /// `λ` \[rad/s\], (2.34): positive, the absolute value of that of (2.10).
    pub fn lambda(&self) -> f64 {
        2.0 * Modulus::new(self.k).quarter_period() / self.period
    }

    /// Least value \[rad²/s²\], (2.35).
    pub fn gamma(&self) -> f64 {
        self.beta - (self.k * self.lambda()).powi(2)
    }

    /// Time of the last maximum within `duration` \[s\] after the first sample, (2.41): \[s\] after the first sample.
    pub fn last_maximum(&self, duration: f64) -> f64 {
        let first = self.delta / self.lambda();
        first + ((duration - first) / self.period).floor() * self.period
    }

    /// The value at `t` \[s\] after the first sample \[rad²/s²\].
    pub fn value(&self, t: f64) -> f64 {
        let wave = Wave::new(self.beta, self.k, self.period);
        wave.map_or(f64::NAN, |wave| wave.at(t, self.delta).0)
    }
}

/// (D.29) without the phase.
struct Wave {
    beta: f64,
    modulus: Modulus,
    lambda: f64,
    scale: f64,
}

impl Wave {
    /// `None` if `k` is not a modulus in (0, 1).
    fn new(beta: f64, k: f64, period: f64) -> Option<Self> {
        if !(k > 0.0 && k < 1.0) {
            return None;
        }
        let modulus = Modulus::new(k);
        let lambda = 2.0 * modulus.quarter_period() / period;
        Some(Self {
            beta,
            modulus,
            lambda,
            scale: (k * lambda).powi(2),
        })
    }

    /// Value and derivative by delta, (D.29) and (D.31).
    fn at(&self, t: f64, delta: f64) -> (f64, f64) {
        let j = self.modulus.jacobi(self.lambda * t - delta);
        (
            self.beta - self.scale * j.sn * j.sn,
            2.0 * self.scale * j.sn * j.cn * j.dn,
        )
    }
}

/// `|w|² = 1/alpha + λ² sech²(λ (t - t0) - delta)`, eq. (2.44).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pulse {
    /// `λ` \[rad/s\].
    pub lambda: f64,
    /// Phase \[rad\], relative to the first sample's time.
    pub delta: f64,
    /// RMS residual \[rad²/s²\].
    pub rms: f64,
}

impl Pulse {
    /// Fits the pulse, starting from the largest sample. `None` if the fit fails.
    pub fn fit(samples: &Samples, alpha: f64, options: &Options) -> Option<Self> {
        let floor = alpha.recip();
        let &(peak, height) = samples.iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
        let lambda = (height - floor).max(1e-6 * floor).sqrt();
        let model = |x: &Vector2<f64>| {
            let [lambda, delta]: [f64; 2] = (*x).into();
            Some(move |t: f64| {
                let u = lambda * t - delta;
                let sech = u.cosh().recip();
                let square = sech * sech;
                let slope = -2.0 * lambda * lambda * square * u.tanh();
                let by_lambda = 2.0 * lambda * square + slope * t;
                (
                    floor + lambda * lambda * square,
                    Vector2::new(by_lambda, -slope),
                )
            })
        };
        let start = Vector2::new(lambda, lambda * peak);
        let (x, sum) = gauss_newton(start, samples, options, model)?;
        (x[0] > 0.0).then(|| Self {
            lambda: x[0],
            delta: x[1],
            rms: (sum / samples.len() as f64).sqrt(),
        })
    }
}

/// Largest number of iterations.
const MAX_STEPS: usize = 200;

/// Damped Gauss-Newton, (D.20)-(D.26). `model` gives value and gradient as functions of time, `None` outside its
/// domain.
/// It ends when the sum hardly decreases; the print of (D.26) has this comparison reversed.
/// Returns parameters and sum of squares; `None` if the start is outside the domain.
fn gauss_newton<const M: usize, F: Fn(f64) -> (f64, SVector<f64, M>)>(
    start: SVector<f64, M>,
    samples: &Samples,
    options: &Options,
    model: impl Fn(&SVector<f64, M>) -> Option<F>,
) -> Option<(SVector<f64, M>, f64)> {
    let linearise = |x: &SVector<f64, M>| {
        let at = model(x)?;
        let mut normal = SMatrix::<f64, M, M>::zeros();
        let mut right = SVector::<f64, M>::zeros();
        let mut sum = 0.0;
        for (t, y) in samples {
            let (value, gradient) = at(*t);
            let residual = y - value;
            normal += gradient * gradient.transpose();
            right += gradient * residual;
            sum += residual * residual;
        }
        f64::is_finite(sum).then_some((normal, right, sum))
    };
    let mut x = start;
    let (mut normal, mut right, mut sum) = linearise(&x)?;
    for _ in 0..MAX_STEPS {
        let Some(step) = normal.try_inverse().map(|inverse| inverse * right) else {
            break;
        };
        let mut factor = 1.0;
        let better = loop {
            let next = x + step * factor;
            match linearise(&next) {
                Some(state) if state.2 <= sum => break Some((next, state)),
                _ if factor < 1e-9 => break None,
                _ => factor *= options.damping,
            }
        };
        let Some((next, state)) = better else { break };
        let fallen = sum - state.2;
        x = next;
        (normal, right) = (state.0, state.1);
        let before = std::mem::replace(&mut sum, state.2);
        if fallen <= options.convergence * before {
            break;
        }
    }
    Some((x, sum))
}
