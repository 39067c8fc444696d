//! Explicit Runge-Kutta methods for formulations whose state is a plain vector.

use super::Tableau;

/// Steps `x' = f(x)` for a vector `x` of fixed length; owns the stage memory. It makes no corrections: a quaternion in
/// `x` is not normalised, and a constraint is not restored. [`super::Integrator`] is the integrator for a robot's
/// state.
#[derive(Debug, Clone)]
pub struct RungeKutta {
    tableau: &'static Tableau,
    /// The rates of all stages, one after the other.
    rates: Vec<f64>,
    stage: Vec<f64>,
}

impl RungeKutta {
    /// A stepper for vectors of `length` entries.
    pub fn new(tableau: &'static Tableau, length: usize) -> Self {
        Self {
            tableau,
            rates: vec![0.0; length * tableau.c.len()],
            stage: vec![0.0; length],
        }
    }

    /// Advances `x` by `dt`; `f(x, rate)` writes the rate of change at `x`, for every stage.
    ///
    /// # Panics
    /// If `x` has not the length that the stepper was made for.
    pub fn step(&mut self, x: &mut [f64], dt: f64, mut f: impl FnMut(&[f64], &mut [f64])) {
        let length = self.stage.len();
        assert_eq!(x.len(), length, "length of the state");
        if length == 0 {
            return;
        }
        for (i, a) in self.tableau.a.iter().enumerate() {
            let (earlier, current) = self.rates.split_at_mut(i * length);
            self.stage.copy_from_slice(x);
            add_weighted(&mut self.stage, earlier, a, dt);
            f(&self.stage, &mut current[..length]);
        }
        add_weighted(x, &self.rates, self.tableau.b, dt);
    }
}

/// `x += dt Σ weights rates`.
fn add_weighted(x: &mut [f64], rates: &[f64], weights: &[f64], dt: f64) {
    for (rate, weight) in rates.chunks_exact(x.len()).zip(weights) {
        if *weight != 0.0 {
            let k = dt * weight;
            for (x, rate) in x.iter_mut().zip(rate) {
                *x += rate * k;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A nonlinear system with a known solution, `x = tan t`, `y = exp(tan t)`. Fails if a stage starts from the wrong
    /// state or uses the wrong rate, which reduces the order.
    #[test]
    fn halving_the_step_shows_the_order() {
        let error = |tableau, steps: u32| {
            let mut stepper = RungeKutta::new(tableau, 2);
            let mut x = [0.0, 1.0];
            for _ in 0..steps {
                stepper.step(&mut x, 1.0 / f64::from(steps), |x, rate| {
                    rate[0] = 1.0 + x[0] * x[0];
                    rate[1] = x[1] * (1.0 + x[0] * x[0]);
                });
            }
            (x[1] - 1f64.tan().exp()).abs()
        };
        for (tableau, steps, order) in [
            (&Tableau::RK4, 64, 4.0),
            (&Tableau::RK_GILL, 64, 4.0),
            (&Tableau::DOP8, 8, 8.0),
        ] {
            let seen = (error(tableau, steps) / error(tableau, 2 * steps)).log2();
            assert!((seen - order).abs() < 0.3, "order {seen}, not {order}");
        }
    }
}
