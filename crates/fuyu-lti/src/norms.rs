//! H2 and H-infinity norms.

use crate::eigen::balanced;
use crate::frequency::peak_gain;
use crate::gramians::controllability_gramian;
use crate::matrix::{complex, identity, singular_values, solve};
use crate::riccati::scaled_hamiltonian;
use crate::{LtiError, StateSpace, eigenvalues};

/// H-infinity norm of a stable system.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HinfNorm {
    /// The norm, to a relative accuracy of about 1e-9.
    pub norm: f64,
    /// Frequency of the peak in rad/s; infinite if the gain rises to it for ever.
    pub frequency: f64,
    /// Largest gain found by a frequency sweep, which shares no formula with the norm: a lower bound, equal to about 1e-8 unless the sweep misses a peak.
    pub swept: f64,
}

impl StateSpace {
    /// H2 norm: root mean square of the output for white noise of unit intensity at the inputs. Errors: unstable, or continuous with D other than zero (the norm is infinite).
    pub fn h2_norm(&self) -> Result<f64, LtiError> {
        if self.sampling_time.is_none() {
            self.require_no_feedthrough("a continuous system with an H2 norm")?;
        }
        let p = controllability_gramian(self)?;
        let square = (&self.c * p * self.c.transpose() + &self.d * self.d.transpose()).trace();
        Ok(square.max(0.0).sqrt())
    }

    /// H-infinity norm: the largest singular value of the frequency response over all frequencies.
    ///
    /// The level is raised until the Hamiltonian matrix of the level has no eigenvalue on the imaginary axis (Boyd, Balakrishnan &
    /// Kabamba 1989), with the new level from the midpoints between its imaginary eigenvalues (Bruinsma & Steinbuch 1990). A discrete system is
    /// mapped to a continuous one by the bilinear transformation, which keeps the norm. Error: unstable.
    pub fn hinf_norm(&self) -> Result<HinfNorm, LtiError> {
        self.require_stable("a system with an H-infinity norm")?;
        let sys = self.bilinear()?;
        let to_frequency = |w: f64| {
            self.sampling_time
                .map_or(w, |h| 2.0 / h * (w * h / 2.0).atan())
        };
        let gain = |w: f64| -> Result<f64, LtiError> {
            Ok(sys.singular_values(w)?.first().copied().unwrap_or(0.0))
        };
        let at_infinity = singular_values(&complex(&sys.d))?
            .first()
            .copied()
            .unwrap_or(0.0);
        let (swept, peak) = peak_gain(&sys)?;
        let mut best = if at_infinity > swept {
            (at_infinity, f64::INFINITY)
        } else {
            (swept, peak)
        };
        let result = |best: (f64, f64)| HinfNorm {
            norm: best.0,
            frequency: to_frequency(best.1),
            swept: swept.max(at_infinity),
        };
        if best.0 == 0.0 {
            return Ok(result(best));
        }
        const STEP: f64 = 1e-9;
        for _ in 0..60 {
            let level = best.0 * (1.0 + 2.0 * STEP);
            let crossings = level_crossings(&sys, level)?;
            if crossings.is_empty() {
                return Ok(result((best.0 * (1.0 + STEP), best.1)));
            }
            let mut candidates: Vec<f64> =
                crossings.windows(2).map(|w| (w[0] * w[1]).sqrt()).collect();
            candidates.extend(crossings.windows(2).map(|w| 0.5 * (w[0] + w[1])));
            candidates.extend(&crossings);
            let before = best.0;
            for w in candidates {
                let g = gain(w)?;
                if g > best.0 {
                    best = (g, w);
                }
            }
            // Crossings that are only rounding of a pair that has just left the axis: the level is the norm.
            if best.0 <= before * (1.0 + 0.1 * STEP) {
                return Ok(result(best));
            }
        }
        Err(LtiError::NotConverged {
            what: "the H-infinity norm",
            iterations: 60,
        })
    }

    /// The continuous system with s = (2/h) (z - 1)/(z + 1); itself if it is continuous already.
    pub(crate) fn bilinear(&self) -> Result<Self, LtiError> {
        let Some(h) = self.sampling_time else {
            return Ok(self.clone());
        };
        let one = identity(self.order());
        let inverse = solve(
            "A + I of the bilinear transformation",
            &(&self.a + &one),
            &one,
        )?;
        let b = &inverse * &self.b;
        Ok(Self {
            a: (&self.a - &one) * &inverse * (2.0 / h),
            d: &self.d - &self.c * &b,
            b: b * (2.0 / h.sqrt()),
            c: &self.c * &inverse * (2.0 / h.sqrt()),
            sampling_time: None,
        })
    }
}

/// Frequencies in rad/s, ascending, at which a singular value of the continuous system's response equals `level`: imaginary eigenvalues of a Hamiltonian matrix.
fn level_crossings(sys: &StateSpace, level: f64) -> Result<Vec<f64>, LtiError> {
    let (m, p) = (sys.inputs(), sys.outputs());
    let r = identity(m) * (level * level) - sys.d.transpose() * &sys.d;
    let s = identity(p) * (level * level) - &sys.d * sys.d.transpose();
    let r_inv = solve("level^2 I - D'D", &r, &identity(m))?;
    let s_inv = solve("level^2 I - D D'", &s, &identity(p))?;
    let a = &sys.a + &sys.b * &r_inv * sys.d.transpose() * &sys.c;
    let upper = &sys.b * &r_inv * sys.b.transpose() * level;
    let lower = sys.c.transpose() * &s_inv * &sys.c * level;
    let (hamiltonian, _) = scaled_hamiltonian(&a, &-upper, &lower);
    let size = balanced(&hamiltonian).norm();
    let mut out: Vec<f64> = eigenvalues(&hamiltonian)?
        .into_iter()
        .filter(|l| l.im >= 0.0 && l.re.abs() <= 1e-8 * l.norm() + 1e-13 * size)
        .map(|l| l.im)
        .collect();
    out.sort_by(f64::total_cmp);
    Ok(out)
}
