//! Modes of the damping: directions of joint motion that viscous damping slows down independently.

use nalgebra::DMatrix;

use super::small_matrix::{diagonalize, factorize, solve_lower, solve_lower_transposed};

/// With the reduced inertia `Ĥ = L Lᵀ` and the damping `D` of one configuration, `L⁻¹ D L⁻ᵀ = V Λ Vᵀ`. The coordinates
/// `x = Vᵀ Lᵀ q̇` of the joint rates then decay as `x' = -Λ x`, and the damping dissipates the power `q̇ᵀ D q̇ = xᵀ Λ
/// x`, in this and in any other configuration. Held joints take no part in a mode.
#[derive(Debug, Clone)]
pub(super) struct Modes {
    joints: usize,
    /// Joints that are not held.
    free: Vec<usize>,
    /// `L`.
    factor: Vec<f64>,
    /// `L⁻¹ D L⁻ᵀ`, then its diagonal form.
    scaled: Vec<f64>,
    /// `V`.
    vectors: Vec<f64>,
    /// Diagonal of `Λ` \[1/s\].
    pub decay: Vec<f64>,
    scratch: Vec<f64>,
}

impl Modes {
    pub fn new(joints: usize) -> Self {
        Self {
            joints,
            free: (0..joints).collect(),
            factor: vec![0.0; joints * joints],
            scaled: vec![0.0; joints * joints],
            vectors: vec![0.0; joints * joints],
            decay: vec![0.0; joints],
            scratch: vec![0.0; joints],
        }
    }

    /// Number of modes.
    pub fn count(&self) -> usize {
        self.free.len()
    }

    /// Computes the modes of the joints that are not `held`, from `Ĥ` and `D` of all joints.
    pub fn set(&mut self, inertia: &DMatrix<f64>, damping: &DMatrix<f64>, held: &[bool]) {
        self.free.clear();
        self.free.extend((0..self.joints).filter(|&j| !held[j]));
        let m = self.free.len();
        for (k, &j) in self.free.iter().enumerate() {
            for (i, &row) in self.free.iter().enumerate() {
                self.factor[k * m + i] = inertia[(row, j)];
                self.scaled[k * m + i] = damping[(row, j)];
            }
        }
        factorize(&mut self.factor, m);
        let is_damped = self.scaled[..m * m].iter().any(|d| *d != 0.0);
        if !is_damped {
            self.vectors[..m * m].fill(0.0);
            (0..m).for_each(|i| self.vectors[i * m + i] = 1.0);
            self.decay[..m].fill(0.0);
            return;
        }
        for column in self.scaled[..m * m].chunks_exact_mut(m.max(1)) {
            solve_lower(&self.factor, m, column);
        }
        // Apply the same transform from the other side.
        for i in 0..m {
            for k in 0..m {
                self.scratch[k] = self.scaled[k * m + i];
            }
            solve_lower(&self.factor, m, &mut self.scratch[..m]);
            for k in 0..m {
                self.scaled[k * m + i] = self.scratch[k];
            }
        }
        diagonalize(&mut self.scaled, m, &mut self.vectors);
        for k in 0..m {
            // Damping is never negative; rounding may be.
            self.decay[k] = self.scaled[k * m + k].max(0.0);
        }
    }

    /// `x = Vᵀ Lᵀ q̇` for the rates (or accelerations) of all joints.
    pub fn read(&mut self, rates: &[f64], x: &mut [f64]) {
        let m = self.free.len();
        for k in 0..m {
            let column = &self.factor[k * m..][..m];
            self.scratch[k] = (k..m).map(|i| column[i] * rates[self.free[i]]).sum();
        }
        for (k, x) in x.iter_mut().enumerate().take(m) {
            let vector = &self.vectors[k * m..][..m];
            *x = vector.iter().zip(&self.scratch).map(|(v, y)| v * y).sum();
        }
    }

    /// Writes `q̇ = L⁻ᵀ V x` of the joints that are not held.
    pub fn write(&mut self, x: &[f64], rates: &mut [f64]) {
        let m = self.free.len();
        self.scratch[..m].fill(0.0);
        for (k, x) in x.iter().enumerate().take(m) {
            let vector = &self.vectors[k * m..][..m];
            for (y, v) in self.scratch.iter_mut().zip(vector) {
                *y += v * x;
            }
        }
        solve_lower_transposed(&self.factor, m, &mut self.scratch[..m]);
        for (value, &j) in self.scratch.iter().zip(&self.free) {
            rates[j] = *value;
        }
    }
}
