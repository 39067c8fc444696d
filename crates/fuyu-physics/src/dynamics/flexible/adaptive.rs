//! Integration with error control.

use super::integrator::{ExtraRate, next_switch};
use super::{
    FlexibleError, FlexibleForcing, FlexibleIntegrator, FlexibleState, FlexibleSystem,
    FlexibleWorkspace,
};
use crate::dynamics::Tableau;
use crate::dynamics::rate::Rate;

/// Allowed error of a step: `absolute + relative * |value|` for each number of the state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerance {
    /// Relative error.
    pub relative: f64,
    /// Absolute error, in the unit of each number.
    pub absolute: f64,
}

impl Default for Tolerance {
    fn default() -> Self {
        Self {
            relative: 1e-10,
            absolute: 1e-12,
        }
    }
}

/// Weights of the error estimate of order 5 in DOP853 (Hairer, Norsett and Wanner, Solving Ordinary Differential
/// Equations I, 2nd ed., program DOP853, coefficients er1 to er12).
const ORDER_5: [f64; 12] = [
    0.013_120_044_994_194_88,
    0.0,
    0.0,
    0.0,
    0.0,
    -1.225_156_446_376_204_4,
    -0.495_758_949_657_250_2,
    1.664_377_182_454_986_4,
    -0.350_328_848_749_973_7,
    0.334_179_118_713_017_5,
    0.081_923_206_485_115_71,
    -0.022_355_307_863_886_294,
];

/// Weights of the embedded method of order 3 at stages 1, 9 and 12 (bhh1 to bhh3 there).
const ORDER_3: [(usize, f64); 3] = [
    (0, 0.244_094_488_188_976_4),
    (8, 0.733_846_688_281_611_8),
    (11, 0.022_058_823_529_411_766),
];

/// Largest number of steps tried in one call.
const MOST_STEPS: usize = 10_000_000;
/// Largest number of times that a step is shortened to end where a wheel reaches its speed limit.
const MOST_TRIES: usize = 20;

/// Integrates a [`FlexibleState`] by Dormand and Prince's method of order 8, whose step is controlled by error
/// estimates of order 5 and 3.
#[derive(Clone, Debug)]
pub struct AdaptiveIntegrator {
    fixed: FlexibleIntegrator,
    tolerance: Tolerance,
    /// The step to try next \[s\]; zero before the first.
    step: f64,
}

impl AdaptiveIntegrator {
    /// An integrator for `system`.
    pub fn new(system: &FlexibleSystem, tolerance: Tolerance) -> Self {
        Self {
            fixed: FlexibleIntegrator::with_tableau(system, &Tableau::DOP8),
            tolerance,
            step: 0.0,
        }
    }

    /// Advances `state` by `duration` \[s\], if that is positive; returns the number of accepted steps. Where `forcing`
    /// is discontinuous, end one call and begin the next.
    ///
    /// # Errors
    /// [`FlexibleError::StepTooSmall`] if the tolerance cannot be met, for instance because a value is not finite.
    ///
    /// # Panics
    /// As [`FlexibleIntegrator::step`].
    pub fn advance(
        &mut self,
        state: &mut FlexibleState,
        workspace: &mut FlexibleWorkspace,
        duration: f64,
        forcing: &mut impl FlexibleForcing,
    ) -> Result<usize, FlexibleError> {
        self.fixed.check(state, workspace);
        let end = state.tree.time + duration.max(0.0);
        let mut accepted = 0;
        for _ in 0..MOST_STEPS {
            let left = end - state.tree.time;
            if left <= 0.0 {
                workspace.set_state(state);
                return Ok(accepted);
            }
            let wanted = if self.step > 0.0 { self.step } else { 1e-3 };
            // A remainder of less than a tenth is joined to the step.
            let mut part = next_switch(state, if wanted > 0.9 * left { left } else { wanted });
            (self.fixed).compute_step(state, workspace, part, 0.0, forcing);
            // A wheel that reaches its speed limit has its full torque until then, and the step ends there.
            for _ in 0..MOST_TRIES {
                let Some(until) = self.fixed.until_wheel_limit(state, part) else {
                    break;
                };
                part = until;
                (self.fixed).compute_step(state, workspace, part, 0.0, forcing);
            }
            let error = self.error(state) * part;
            // Hairer's controller: safety .9, growth by at most 6, reduction by at most 3.
            let factor = if error.is_finite() {
                (0.9 * error.powf(-0.125)).clamp(1.0 / 3.0, 6.0)
            } else {
                1.0 / 3.0
            };
            if error <= 1.0 {
                let limited = part < wanted;
                self.fixed.accept(state, part);
                if left - part <= 0.0 {
                    state.tree.time = end;
                }
                accepted += 1;
                self.step = if limited {
                    wanted.max(part * factor)
                } else {
                    part * factor
                };
            } else {
                self.step = part * factor.min(1.0);
                let least = 1e-13 * end.abs().max(1e-3);
                if self.step < least {
                    break;
                }
            }
        }
        Err(FlexibleError::StepTooSmall {
            time: state.tree.time,
            step: self.step,
            tolerance: self.tolerance.relative,
        })
    }

    /// Error estimate of the last step from `state`, relative to the tolerance.
    fn error(&self, state: &FlexibleState) -> f64 {
        let Self {
            fixed, tolerance, ..
        } = self;
        let mut order_3 = [0.0; 12];
        order_3.copy_from_slice(Tableau::DOP8.b);
        for (i, weight) in ORDER_3 {
            order_3[i] -= weight;
        }
        let (mut fifth, mut third, mut count) = (0.0, 0.0, 0.0);
        let mut add = |value: f64, rate: &dyn Fn(usize) -> f64| {
            let scale = tolerance.absolute + tolerance.relative * value.abs();
            let (mut e5, mut e3) = (0.0, 0.0);
            for (i, (w5, w3)) in ORDER_5.iter().zip(&order_3).enumerate() {
                if *w5 != 0.0 || *w3 != 0.0 {
                    let rate = rate(i);
                    e5 += w5 * rate;
                    e3 += w3 * rate;
                }
            }
            fifth += (e5 / scale) * (e5 / scale);
            third += (e3 / scale) * (e3 / scale);
            count += 1.0;
        };
        let rates: &[Rate] = &fixed.rates;
        for (place, value) in Rate::values(&state.tree).enumerate() {
            add(value, &|i| rates[i].number(place));
        }
        let extras: &[ExtraRate] = &fixed.extra_rates;
        for (k, (x, xd)) in state.x.iter().zip(&state.xd).enumerate() {
            add(*x, &|i| extras[i].xd[k]);
            add(*xd, &|i| extras[i].xdd[k]);
        }
        let denominator = fifth + 0.01 * third;
        if denominator <= 0.0 {
            return 0.0;
        }
        fifth / (denominator * count).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // The weights of order 5 are the difference of two methods of order 5 and 8: they annihilate powers of c below 5,
    // and not c^5. The method of order 3 integrates powers below 3.
    #[test]
    fn the_error_estimates_have_their_orders() {
        let c = Tableau::DOP8.c;
        for power in 0..6 {
            let sum: f64 = (ORDER_5.iter().zip(c))
                .map(|(w, c)| w * c.powi(power))
                .sum();
            assert!((sum.abs() < 1e-15) == (power < 5), "power {power}: {sum:e}");
            let sum: f64 = ORDER_3.iter().map(|(i, w)| w * c[*i].powi(power)).sum();
            let exact = 1.0 / (f64::from(power) + 1.0);
            assert!(
                ((sum - exact).abs() < 1e-15) == (power < 3),
                "power {power}: {sum}"
            );
        }
    }
}
