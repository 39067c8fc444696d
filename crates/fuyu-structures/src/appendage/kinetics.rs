//! Mass matrix, convective terms, momentum and energy of a deformable body at one state.

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

use super::{Appendage, Invariants, invariants::cross_moment, points::pairs, rigid_matrix};

/// Terms of the equations of motion of a deformable body at one state. Allocated once; [`Kinetics::update`] does not allocate.
///
/// The generalized velocity is `(v, w, μ')`: velocity of the attachment's origin relative to an inertial frame \[m/s\],
/// angular velocity of the attachment frame \[rad/s\], both in its axes, and the modal rates. With `a` the inertial acceleration of the
/// attachment's origin in attachment axes and `α = dw/dt`,
///
/// ```text
/// mass_matrix * (a, α, μ'') + bias + (0, 0, K μ + C μ') = (F, T, Q)
/// ```
///
/// `mass_matrix * (v, w, μ')` is the linear momentum, the angular momentum about the attachment's origin, and the modal
/// momenta, in its axes; half of its product with `(v, w, μ')` is the kinetic energy.
///
/// Here F and T are the force and the torque about the attachment's origin that act on the body, Q the modal forces, K
/// stiffness and C damping. It is the sum over mass points of `(∂ṙ/∂u)ᵀ r̈ dm` without approximation, so the equations are those of
/// a Lagrangian and conserve momentum and energy.
#[derive(Clone, Debug)]
pub struct Kinetics {
    /// (6 + n) x (6 + n), symmetric.
    pub mass_matrix: DMatrix<f64>,
    /// 6 + n convective forces.
    pub bias: DVector<f64>,
    coefficients: Vec<f64>,
    gradients: Vec<Vec<(usize, f64)>>,
    curvature: Vec<f64>,
    cross: Vec<Matrix3<f64>>,
}

impl Kinetics {
    /// Scratch memory for one appendage.
    pub fn new(appendage: &Appendage) -> Self {
        let n = appendage.modes();
        let functions = appendage.invariants.functions();
        Self {
            mass_matrix: DMatrix::zeros(6 + n, 6 + n),
            bias: DVector::zeros(6 + n),
            coefficients: vec![0.0; functions],
            gradients: (0..n).map(|_| Vec::with_capacity(1 + n)).collect(),
            curvature: vec![0.0; functions],
            cross: vec![Matrix3::zeros(); n],
        }
    }

    /// Mass matrix and bias at modal coordinates `mu`, modal rates `mu_dot` and angular velocity `w_A` \[rad/s\] of the attachment
    /// frame, in its axes.
    ///
    /// # Panics
    /// If `mu` or `mu_dot` has another length than the appendage has modes, or if the appendage is not the one of
    /// [`Kinetics::new`].
    pub fn update(
        &mut self,
        appendage: &Appendage,
        mu: &[f64],
        mu_dot: &[f64],
        w_A: &Vector3<f64>,
    ) {
        let n = appendage.modes();
        assert!(
            mu.len() == n && mu_dot.len() == n,
            "mu and mu_dot must have one entry for each of the {n} modes"
        );
        let invariants = &appendage.invariants;
        assert_eq!(
            self.coefficients.len(),
            invariants.functions(),
            "these are the kinetics of another appendage"
        );
        self.set_coefficients(n, mu, mu_dot, invariants.second_order());
        self.set_cross(invariants);
        self.set_body(invariants, mu_dot, w_A);
        self.set_modes(appendage, mu_dot, w_A);
    }

    /// `∫ r G_kᵀ dm`, where G_k = ∂r/∂μ_k.
    fn set_cross(&mut self, invariants: &Invariants) {
        for (cross, gradient) in self.cross.iter_mut().zip(&self.gradients) {
            *cross = Matrix3::zeros();
            for (b, slope) in gradient {
                for (a, coefficient) in self.coefficients.iter().enumerate() {
                    let factor = coefficient * slope;
                    if factor != 0.0 {
                        *cross += invariants.second(a, *b) * factor;
                    }
                }
            }
        }
    }

    /// Rows of the attachment's translation and rotation, and with them its columns.
    fn set_body(&mut self, invariants: &Invariants, mu_dot: &[f64], w_A: &Vector3<f64>) {
        // ∫ r dm, ∫ r rᵀ dm, and ∫ γ dm, ∫ r γᵀ dm with γ = Σ ∂²r/∂μ_k∂μ_l μ_k' μ_l'.
        let (mut S, mut S_gamma) = (Vector3::zeros(), Vector3::zeros());
        let (mut r_r, mut r_gamma) = (Matrix3::zeros(), Matrix3::zeros());
        for (a, x) in self.coefficients.iter().enumerate() {
            S += invariants.first(a) * *x;
            S_gamma += invariants.first(a) * self.curvature[a];
            if *x == 0.0 {
                continue;
            }
            for (b, y) in self.coefficients.iter().enumerate() {
                if *y != 0.0 {
                    r_r += invariants.second(a, b) * (x * y);
                }
                if self.curvature[b] != 0.0 {
                    r_gamma += invariants.second(a, b) * (x * self.curvature[b]);
                }
            }
        }
        let J = Matrix3::identity() * r_r.trace() - r_r;
        let M = &mut self.mass_matrix;
        M.fixed_view_mut::<6, 6>(0, 0)
            .copy_from(&rigid_matrix(invariants.mass(), &S, &J));
        let (mut S_dot, mut r_rdot) = (Vector3::zeros(), Matrix3::zeros());
        for (k, (cross, rate)) in self.cross.iter().zip(mu_dot).enumerate() {
            let gradient = self.gradients[k].iter();
            let S_k: Vector3<f64> = gradient.map(|(a, g)| invariants.first(*a) * *g).sum();
            let H_k = cross_moment(cross);
            S_dot += S_k * *rate;
            r_rdot += cross * *rate;
            for i in 0..3 {
                M[(i, 6 + k)] = S_k[i];
                M[(6 + k, i)] = S_k[i];
                M[(3 + i, 6 + k)] = H_k[i];
                M[(6 + k, 3 + i)] = H_k[i];
            }
        }
        // ∫ w x (w x r) + 2 w x r' + γ dm
        let force = w_A.cross(&w_A.cross(&S)) + w_A.cross(&S_dot) * 2.0 + S_gamma;
        // The moments of the same: ∫ r x (w x (w x r)), 2 ∫ r x (w x r'), ∫ r x γ.
        let coriolis = (Matrix3::identity() * r_rdot.trace() - r_rdot.transpose()) * w_A * 2.0;
        let torque = w_A.cross(&(J * w_A)) + coriolis + cross_moment(&r_gamma);
        self.bias.fixed_rows_mut::<3>(0).copy_from(&force);
        self.bias.fixed_rows_mut::<3>(3).copy_from(&torque);
    }

    /// Rows and columns of the modes.
    fn set_modes(&mut self, appendage: &Appendage, mu_dot: &[f64], w_A: &Vector3<f64>) {
        let invariants = &appendage.invariants;
        let w_squared = w_A.norm_squared();
        for k in 0..mu_dot.len() {
            let cross = self.cross[k];
            // ∫ G_k · (w x (w x r)) dm
            let mut force = w_A.dot(&(cross * w_A)) - w_squared * cross.trace();
            for (l, rate) in mu_dot.iter().enumerate() {
                // 2 ∫ G_k · (w x r') dm
                let pair = self.gradient_moment(appendage, l, k);
                force += 2.0 * rate * w_A.dot(&cross_moment(&pair));
                if l >= k {
                    let first_order = invariants.second(1 + k, 1 + l).trace();
                    let value = appendage.modal_mass[(k, l)] + pair.trace() - first_order;
                    self.mass_matrix[(6 + k, 6 + l)] = value;
                    self.mass_matrix[(6 + l, 6 + k)] = value;
                }
            }
            // ∫ G_k · γ dm
            for (a, gradient) in &self.gradients[k] {
                for (b, curvature) in self.curvature.iter().enumerate() {
                    if *curvature != 0.0 {
                        force += gradient * curvature * invariants.second(*a, b).trace();
                    }
                }
            }
            self.bias[6 + k] = force;
        }
    }

    /// `∫ G_k G_lᵀ dm`.
    fn gradient_moment(&self, appendage: &Appendage, k: usize, l: usize) -> Matrix3<f64> {
        let mut sum = Matrix3::zeros();
        for (a, x) in &self.gradients[k] {
            for (b, y) in &self.gradients[l] {
                sum += appendage.invariants.second(*a, *b) * (x * y);
            }
        }
        sum
    }

    /// Values c_a, gradients ∂c_a/∂μ_k and curvatures Σ ∂²c_a/∂μ_k∂μ_l μ_k' μ_l' of the functions' coefficients.
    fn set_coefficients(&mut self, n: usize, mu: &[f64], mu_dot: &[f64], second_order: bool) {
        self.coefficients[0] = 1.0;
        self.coefficients[1..=n].copy_from_slice(mu);
        for (k, gradient) in self.gradients.iter_mut().enumerate() {
            gradient.clear();
            gradient.push((1 + k, 1.0));
        }
        if !second_order {
            return;
        }
        for (place, (k, l)) in pairs(n).enumerate() {
            let a = 1 + n + place;
            if k == l {
                self.coefficients[a] = mu[k] * mu[k] / 2.0;
                self.curvature[a] = mu_dot[k] * mu_dot[k];
                self.gradients[k].push((a, mu[k]));
            } else {
                self.coefficients[a] = mu[k] * mu[l];
                self.curvature[a] = 2.0 * mu_dot[k] * mu_dot[l];
                self.gradients[k].push((a, mu[l]));
                self.gradients[l].push((a, mu[k]));
            }
        }
    }
}
