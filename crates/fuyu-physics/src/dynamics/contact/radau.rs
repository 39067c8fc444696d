//! Radau's implicit method of order 5 with error control, for stiff motion.
//!
//! The method has three stages and is L-stable: infinitely stiff modes decay in one step. Stages are found by
//! simplified Newton iterations; a transformation splits their linear system into a real and a complex one of the size
//! of the state (E. Hairer and G. Wanner, Solving Ordinary Differential Equations II, 1996, section IV.8; error
//! estimate, starting values and step control are also theirs). Each iteration conserves every conserved quantity that
//! is linear in the state, whether or not it has converged.

use nalgebra::{Complex, ComplexField};

/// Nodes of the stages; the last is the end of the step.
const C: [f64; 3] = [0.155_051_025_721_682_2, 0.644_948_974_278_317_8, 1.0];

/// Eigenvalues of the inverse of the Runge-Kutta matrix.
const MU_REAL: f64 = 3.637_834_252_744_496;
const MU_COMPLEX: Complex<f64> = Complex::new(2.681_082_873_627_752_3, -3.050_430_199_247_410_5);

/// Eigenvectors of the inverse of the Runge-Kutta matrix, and their inverse.
const T: [[f64; 3]; 3] = [
    [
        0.094_438_762_488_975_24,
        -0.141_255_295_020_954_2,
        0.030_029_194_105_147_42,
    ],
    [
        0.250_213_122_965_333_3,
        0.204_129_352_293_799_94,
        -0.382_942_112_757_261_9,
    ],
    [1.0, 1.0, 0.0],
];
const T_INVERSE: [[f64; 3]; 3] = [
    [
        4.178_718_591_551_904,
        0.327_682_820_761_062_37,
        0.523_376_445_499_449_5,
    ],
    [
        -4.178_718_591_551_904,
        -0.327_682_820_761_062_37,
        0.476_623_554_500_550_44,
    ],
    [
        0.502_872_634_945_786_8,
        -2.571_926_949_855_605,
        0.596_039_204_828_224_9,
    ],
];

/// `(-13 - 7 √6) / 3`, `(-13 + 7 √6) / 3`, `-1/3`: weights of the error estimate.
const E: [f64; 3] = [-10.048_809_399_827_416, 1.382_142_733_160_749, -1.0 / 3.0];

/// Limit of the Newton iterations.
const ITERATIONS: usize = 7;

/// Differential equations.
pub(super) trait Equations {
    /// Rates of the state `y`, `after` the start of the step \[s\].
    fn rates(&mut self, after: f64, y: &[f64], rates: &mut [f64]);
    /// For each entry of the state, the size that counts as one unit of error.
    fn scale(&self) -> &[f64];
}

/// An LU-factored matrix.
#[derive(Debug, Clone)]
struct Factors<T> {
    n: usize,
    /// By rows.
    entries: Vec<T>,
    pivots: Vec<usize>,
}

impl<T: ComplexField<RealField = f64> + Copy> Factors<T> {
    fn new(n: usize) -> Self {
        Self {
            n,
            entries: vec![T::zero(); n * n],
            pivots: vec![0; n],
        }
    }

    /// Factors `shift - matrix`. Returns whether it is regular.
    fn set(&mut self, shift: T, matrix: &[f64]) -> bool {
        let n = self.n;
        for (entry, value) in self.entries.iter_mut().zip(matrix) {
            *entry = T::from_real(-value);
        }
        for i in 0..n {
            self.entries[i * n + i] += shift;
        }
        for k in 0..n {
            let size = |i: usize| self.entries[i * n + k].norm1();
            let best = (k..n).fold(k, |best, i| if size(i) > size(best) { i } else { best });
            let largest = size(best);
            if largest.is_nan() || largest <= 0.0 {
                return false;
            }
            self.pivots[k] = best;
            if best != k {
                for j in 0..n {
                    self.entries.swap(k * n + j, best * n + j);
                }
            }
            let (above, below) = self.entries.split_at_mut((k + 1) * n);
            let pivot = &above[k * n..];
            let inverse = T::one() / pivot[k];
            for row in below.chunks_exact_mut(n) {
                if row[k] == T::zero() {
                    continue;
                }
                let factor = row[k] * inverse;
                row[k] = factor;
                for (entry, above) in row[k + 1..].iter_mut().zip(&pivot[k + 1..]) {
                    *entry -= factor * *above;
                }
            }
        }
        true
    }

    fn solve(&self, x: &mut [T]) {
        let n = self.n;
        for k in 0..n {
            x.swap(k, self.pivots[k]);
        }
        for i in 1..n {
            let (known, rest) = x.split_at_mut(i);
            for (l, x) in self.entries[i * n..].iter().zip(&*known) {
                rest[0] -= *l * *x;
            }
        }
        for i in (0..n).rev() {
            let (rest, known) = x.split_at_mut(i + 1);
            for (u, x) in self.entries[i * n + i + 1..].iter().zip(&*known) {
                rest[i] -= *u * *x;
            }
            rest[i] /= self.entries[i * n + i];
        }
    }
}

/// The method with its memory, for one number of state variables.
#[derive(Debug, Clone)]
pub(super) struct Radau {
    n: usize,
    jacobian: Vec<f64>,
    real: Factors<f64>,
    complex: Factors<Complex<f64>>,
    /// Step length for which the matrices are factored; zero if they are not.
    factored: f64,
    /// Whether the Jacobian is that of the state at the start of the step.
    pub is_current: bool,
    has_jacobian: bool,
    /// Stages minus the start of the step.
    z: [Vec<f64>; 3],
    w: [Vec<f64>; 3],
    rates: [Vec<f64>; 3],
    /// Rates at the start.
    start_rates: Vec<f64>,
    point: Vec<f64>,
    shifted: Vec<f64>,
    update: Vec<f64>,
    complex_update: Vec<Complex<f64>>,
    error: Vec<f64>,
    /// Stages of the last accepted step, and its length, from which the next step is extrapolated.
    last: Option<f64>,
    last_z: [Vec<f64>; 3],
    /// Iterations of the last step, and their convergence rate.
    pub iterations: usize,
    pub convergence: f64,
    /// Whether the stages of the last step are finite.
    pub is_finite: bool,
}

impl Radau {
    pub fn new(n: usize) -> Self {
        let vector = || vec![0.0; n];
        let three = || [vector(), vector(), vector()];
        Self {
            n,
            jacobian: vec![0.0; n * n],
            real: Factors::new(n),
            complex: Factors::new(n),
            factored: 0.0,
            is_current: false,
            has_jacobian: false,
            z: three(),
            w: three(),
            rates: three(),
            start_rates: vector(),
            point: vector(),
            shifted: vector(),
            update: vector(),
            complex_update: vec![Complex::new(0.0, 0.0); n],
            error: vector(),
            last: None,
            last_z: three(),
            iterations: 0,
            convergence: 0.0,
            is_finite: true,
        }
    }

    /// Times of the stages, as fractions of the step.
    pub fn times() -> [f64; 3] {
        C
    }

    /// Whether no Jacobian has been computed for the present equations.
    pub fn is_new(&self) -> bool {
        !self.has_jacobian
    }

    /// Discards the last step, after an event or a change of the equations.
    pub fn restart(&mut self) {
        self.last = None;
        self.is_current = false;
        self.has_jacobian = false;
        self.factored = 0.0;
    }

    /// Computes the rates at the start of the next steps.
    pub fn begin(&mut self, y: &[f64], equations: &mut impl Equations) {
        equations.rates(0.0, y, &mut self.start_rates);
    }

    /// Sets the Jacobian at `y` by differences.
    pub fn set_jacobian(&mut self, y: &[f64], equations: &mut impl Equations) {
        let n = self.n;
        self.point.copy_from_slice(y);
        for (j, &start) in y.iter().enumerate() {
            // The square root of the rounding error, relative to the size of the entry.
            let wanted = 1.5e-8 * equations.scale()[j].max(start.abs());
            self.point[j] = start + wanted;
            let step = self.point[j] - start;
            equations.rates(0.0, &self.point, &mut self.shifted);
            self.point[j] = start;
            for i in 0..n {
                self.jacobian[i * n + j] = (self.shifted[i] - self.start_rates[i]) / step;
            }
        }
        self.is_current = true;
        self.has_jacobian = true;
        self.iterations = 0;
        self.factored = 0.0;
    }

    fn norm(x: &[f64], scale: &[f64]) -> f64 {
        let squares: f64 = x.iter().zip(scale).map(|(x, s)| (x / s) * (x / s)).sum();
        (squares / x.len() as f64).sqrt()
    }

    /// Tries a step of `h` from `y`; [`Self::begin`] must have computed the rates at `y`. Returns the error estimate,
    /// in units of the scale; `None` if the iteration does not converge to `tolerance` of it. The end of the step is
    /// its last [`Self::stage`].
    pub fn step(
        &mut self,
        y: &[f64],
        h: f64,
        tolerance: f64,
        equations: &mut impl Equations,
    ) -> Option<f64> {
        let n = self.n;
        if self.factored != h {
            let is_regular = self.real.set(MU_REAL / h, &self.jacobian)
                && self.complex.set(MU_COMPLEX / h, &self.jacobian);
            self.factored = if is_regular { h } else { 0.0 };
            self.is_finite = is_regular;
            if !is_regular {
                return None;
            }
        }
        self.is_finite = true;
        self.guess(h);
        let m_complex = MU_COMPLEX / h;
        let (mut last, mut theta): (f64, f64) = (f64::INFINITY, 0.0);
        let mut converged = false;
        for iteration in 0..ITERATIONS {
            self.iterations = iteration + 1;
            for (i, c) in C.iter().enumerate() {
                for ((point, y), z) in self.point.iter_mut().zip(y).zip(&self.z[i]) {
                    *point = y + z;
                }
                equations.rates(c * h, &self.point, &mut self.rates[i]);
            }
            for k in 0..n {
                let f = [self.rates[0][k], self.rates[1][k], self.rates[2][k]];
                let of = |row: &[f64; 3]| row[0] * f[0] + row[1] * f[1] + row[2] * f[2];
                self.update[k] = of(&T_INVERSE[0]) - MU_REAL / h * self.w[0][k];
                let w = Complex::new(self.w[1][k], self.w[2][k]);
                self.complex_update[k] =
                    Complex::new(of(&T_INVERSE[1]), of(&T_INVERSE[2])) - m_complex * w;
            }
            self.real.solve(&mut self.update);
            self.complex.solve(&mut self.complex_update);
            let mut squares = 0.0;
            for k in 0..n {
                let (real, complex) = (self.update[k], self.complex_update[k]);
                self.w[0][k] += real;
                self.w[1][k] += complex.re;
                self.w[2][k] += complex.im;
                let s = equations.scale()[k];
                squares +=
                    (real * real + complex.re * complex.re + complex.im * complex.im) / (s * s);
                for (z, row) in self.z.iter_mut().zip(&T) {
                    z[k] = row[0] * self.w[0][k] + row[1] * self.w[1][k] + row[2] * self.w[2][k];
                }
            }
            let change = (squares / (3 * n) as f64).sqrt();
            if !change.is_finite() {
                self.is_finite = false;
                return None;
            }
            if iteration > 0 {
                theta = change / last;
            }
            let left = ITERATIONS - 1 - iteration;
            if change == 0.0
                || iteration > 0 && theta < 1.0 && theta / (1.0 - theta) * change <= tolerance
            {
                converged = true;
                break;
            }
            // Once only rounding errors are left, the iteration does not converge further.
            if iteration > 1 && theta > 0.3 && change <= 20.0 * tolerance {
                converged = true;
                break;
            }
            if iteration > 0
                && (theta >= 1.0
                    || theta.powi(left as i32) / (1.0 - theta) * change > tolerance * 1e3)
            {
                break;
            }
            last = change;
        }
        self.convergence = theta;
        if !converged {
            return None;
        }
        Some(self.estimate(y, h, equations))
    }

    fn estimate(&mut self, y: &[f64], h: f64, equations: &mut impl Equations) -> f64 {
        let combined =
            |k: usize, z: &[Vec<f64>; 3]| (z[0][k] * E[0] + z[1][k] * E[1] + z[2][k] * E[2]) / h;
        for k in 0..self.n {
            self.error[k] = self.start_rates[k] + combined(k, &self.z);
        }
        self.real.solve(&mut self.error);
        let error = Self::norm(&self.error, equations.scale());
        if error < 1.0 {
            return error;
        }
        // For stiff components the first estimate is too large.
        for ((point, y), error) in self.point.iter_mut().zip(y).zip(&self.error) {
            *point = y + error;
        }
        equations.rates(0.0, &self.point, &mut self.shifted);
        for k in 0..self.n {
            self.error[k] = self.shifted[k] + combined(k, &self.z);
        }
        self.real.solve(&mut self.error);
        Self::norm(&self.error, equations.scale())
    }

    /// Starting values of the stages: extrapolation of the last step's polynomial, or the start of the step.
    fn guess(&mut self, h: f64) {
        let Some(last) = self.last else {
            for (z, w) in self.z.iter_mut().zip(&mut self.w) {
                z.fill(0.0);
                w.fill(0.0);
            }
            return;
        };
        let ratio = h / last;
        for k in 0..self.n {
            // Values of that polynomial at the start of the last step (0) and at its stages.
            let values = [0.0, self.last_z[0][k], self.last_z[1][k], self.last_z[2][k]];
            let at = |x: f64| {
                let nodes = [0.0, C[0], C[1], C[2]];
                let mut sum = 0.0;
                for (i, value) in values.iter().enumerate() {
                    let mut product = *value;
                    for j in (0..4).filter(|j| *j != i) {
                        product *= (x - nodes[j]) / (nodes[i] - nodes[j]);
                    }
                    sum += product;
                }
                sum
            };
            for (z, node) in self.z.iter_mut().zip(C) {
                z[k] = at(1.0 + ratio * node) - values[3];
            }
        }
        for k in 0..self.n {
            for (w, row) in self.w.iter_mut().zip(&T_INVERSE) {
                w[k] = row[0] * self.z[0][k] + row[1] * self.z[1][k] + row[2] * self.z[2][k];
            }
        }
    }

    /// Change of the state from the start of the last step to stage `i`.
    pub fn stage(&self, i: usize) -> &[f64] {
        &self.z[i]
    }

    /// Stores the last step, for the extrapolation of the next one.
    pub fn accept(&mut self, h: f64) {
        std::mem::swap(&mut self.z, &mut self.last_z);
        self.last = Some(h);
        self.is_current = false;
    }

    /// Change of the state in the accepted step.
    pub fn accepted(&self) -> &[f64] {
        &self.last_z[2]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A stiff oscillator and a nonlinear decay, with a known solution.
    struct Stiff {
        rate: f64,
        scale: Vec<f64>,
    }

    impl Equations for Stiff {
        fn rates(&mut self, _: f64, y: &[f64], rates: &mut [f64]) {
            // x = cos t, with a strongly attracted second component that follows x².
            rates[0] = -y[1];
            rates[1] = y[0];
            rates[2] = -self.rate * (y[2] - y[0] * y[0]) - 2.0 * y[0] * y[1];
        }

        fn scale(&self) -> &[f64] {
            &self.scale
        }
    }

    fn error(rate: f64, steps: usize) -> f64 {
        let mut equations = Stiff {
            rate,
            scale: vec![1.0; 3],
        };
        let mut y = vec![1.0, 0.0, 1.0];
        let mut radau = Radau::new(3);
        let h = 1.0 / steps as f64;
        for _ in 0..steps {
            radau.begin(&y, &mut equations);
            radau.set_jacobian(&y, &mut equations);
            radau.step(&y, h, 1e-14, &mut equations).unwrap();
            radau.accept(h);
            for (y, z) in y.iter_mut().zip(radau.accepted()) {
                *y += z;
            }
        }
        let x = 1f64.cos();
        [y[0] - x, y[1] - 1f64.sin(), y[2] - x * x]
            .iter()
            .map(|e| e.abs())
            .fold(0.0, f64::max)
    }

    #[test]
    fn order_is_five_and_stiffness_costs_nothing() {
        let order = (error(1.0, 4) / error(1.0, 8)).log2();
        assert!((order - 5.0).abs() < 0.3, "{order}");
        let stiff = error(1e9, 8);
        assert!(stiff < 1e-7, "{stiff:e}");
    }
}
