//! A rigid part with flexible parts: the constrained-mode and unconstrained-mode models of Kida 1993 section 2.3, their poles
//! and transmission zeros.

use nalgebra::{Cholesky, Complex, DMatrix, DVector, Dyn};

use crate::{
    StructureError,
    eigen::{check_symmetric, cholesky},
    error, lowest_modes,
    pencil::solve,
    quadratic_roots,
    uniform::dependent,
};

/// The constrained-mode (hybrid-coordinate) model, eq. (2.5), of n_0 rigid coordinates p and n modal ones μ:
///
/// ```text
/// [J  Pᵀ] [p'']   [0 0] [p']   [0 0] [p]
/// [P  M ] [μ''] + [0 C] [μ'] + [0 K] [μ] = L u,   y = H q
/// ```
///
/// M is the identity for mass-normalised modes.
#[derive(Clone, Debug)]
pub struct HybridModel {
    J: DMatrix<f64>,
    P: DMatrix<f64>,
    M: DMatrix<f64>,
    C: DMatrix<f64>,
    K: DMatrix<f64>,
}

impl HybridModel {
    /// Mass-normalised modes with constrained frequencies Ω \[rad/s\] and damping ratios Ξ; `J` is n_0 x n_0, `P` n x n_0.
    ///
    /// # Errors
    /// As [`HybridModel::with_matrices`].
    pub fn new(
        J: DMatrix<f64>,
        P: DMatrix<f64>,
        frequencies: &[f64],
        damping_ratios: &[f64],
    ) -> Result<Self, StructureError> {
        let n = frequencies.len();
        error::size("damping ratios", (damping_ratios.len(), 1), (n, 1))?;
        let K = DVector::from_fn(n, |k, _| frequencies[k].powi(2));
        let C = DVector::from_fn(n, |k, _| 2.0 * damping_ratios[k] * frequencies[k]);
        Self::with_matrices(
            J,
            P,
            DMatrix::identity(n, n),
            DMatrix::from_diagonal(&C),
            DMatrix::from_diagonal(&K),
        )
    }

    /// General modal matrices, n x n each: mass, damping, stiffness.
    ///
    /// # Errors
    /// Sizes that differ; a mass matrix of the whole that is not positive definite, which means that P is too large for J;
    /// a stiffness that is not positive definite.
    pub fn with_matrices(
        J: DMatrix<f64>,
        P: DMatrix<f64>,
        M: DMatrix<f64>,
        C: DMatrix<f64>,
        K: DMatrix<f64>,
    ) -> Result<Self, StructureError> {
        let (n, rigid) = (K.nrows(), J.nrows());
        error::size("coupling P", P.shape(), (n, rigid))?;
        for (name, matrix) in [
            ("rigid mass matrix J", &J),
            ("modal mass", &M),
            ("modal damping", &C),
            ("modal stiffness", &K),
        ] {
            check_symmetric(name, matrix)?;
        }
        error::size("modal mass", M.shape(), (n, n))?;
        error::size("modal damping", C.shape(), (n, n))?;
        let model = Self { J, P, M, C, K };
        // Without rigid coordinates, N is the modal mass.
        if !model.J.is_empty() {
            cholesky(
                model.N_c()?,
                "N = M - P J⁻¹ Pᵀ",
                "more mass moves with the modes than J has: J must include the undeformed flexible parts",
            )?;
        }
        cholesky(
            model.K.clone(),
            "modal stiffness",
            "frequencies must be positive",
        )?;
        Ok(model)
    }

    /// How many rigid coordinates there are, n_0.
    pub fn rigid(&self) -> usize {
        self.J.nrows()
    }

    /// How many modal coordinates there are, n.
    pub fn modes(&self) -> usize {
        self.K.nrows()
    }

    /// Mass, damping and stiffness of eq. (2.5), (n_0 + n) x (n_0 + n) each.
    pub fn matrices(&self) -> [DMatrix<f64>; 3] {
        let (r, n) = (self.rigid(), self.modes());
        let block = |m: &DMatrix<f64>| {
            let mut whole = DMatrix::zeros(r + n, r + n);
            whole.view_mut((r, r), (n, n)).copy_from(m);
            whole
        };
        let mut mass = block(&self.M);
        mass.view_mut((0, 0), (r, r)).copy_from(&self.J);
        mass.view_mut((r, 0), (n, r)).copy_from(&self.P);
        mass.view_mut((0, r), (r, n)).copy_from(&self.P.transpose());
        [mass, block(&self.C), block(&self.K)]
    }

    fn factor_J(&self) -> Result<Cholesky<f64, Dyn>, StructureError> {
        let remedy = "every rigid coordinate needs mass or inertia";
        cholesky(self.J.clone(), "rigid mass matrix J", remedy)
    }

    /// `N^c = M - P J⁻¹ Pᵀ` of theorem 2.3: the modal mass with the rigid part free.
    ///
    /// # Errors
    /// `J` not positive definite.
    pub fn N_c(&self) -> Result<DMatrix<f64>, StructureError> {
        if self.J.is_empty() {
            return Ok(self.M.clone());
        }
        let solved = self.factor_J()?.solve(&self.P.transpose());
        Ok((&self.M - &self.P * solved).symmetric_part())
    }

    /// Poles by theorem 2.3(a), 2 n of them; 2 n_0 more are zero.
    ///
    /// # Errors
    /// An eigenvalue iteration that does not converge.
    pub fn poles(&self) -> Result<Vec<Complex<f64>>, StructureError> {
        quadratic_roots(&self.N_c()?, &self.C, &self.K)
    }

    /// Undamped frequencies \[rad/s\] with the rigid part free, ascending.
    ///
    /// # Errors
    /// An eigenvalue iteration that does not converge.
    pub fn frequencies(&self) -> Result<Vec<f64>, StructureError> {
        let eigen = lowest_modes(&self.K, &self.N_c()?, self.modes())?;
        Ok(eigen.values.iter().map(|v| v.sqrt()).collect())
    }

    /// Transmission zeros from forces on all rigid coordinates to their displacements, by theorem 2.3(b): the constrained
    /// poles, in which neither J nor P appears.
    ///
    /// # Errors
    /// No rigid coordinate; an eigenvalue iteration that does not converge.
    pub fn zeros(&self) -> Result<Vec<Complex<f64>>, StructureError> {
        require_rigid(self.rigid())?;
        quadratic_roots(&self.M, &self.C, &self.K)
    }

    /// Transmission zeros from forces on the rigid part to measurements `y = H_r p + H_e μ` on the flexible one, by theorem
    /// 2.5(a): roots of `det[N s² + C s + K]` with `N = M - P H_r⁻¹ H_e`. `H_r` is n_0 x n_0, `H_e` n_0 x n. They may lie in the
    /// right half-plane.
    ///
    /// # Errors
    /// No rigid coordinate, sizes that differ, or singular `H_r`.
    pub fn zeros_measured_elsewhere(
        &self,
        H_r: &DMatrix<f64>,
        H_e: &DMatrix<f64>,
    ) -> Result<Vec<Complex<f64>>, StructureError> {
        let N = &self.M - &self.P * rigid_solve(H_r, H_e, self.rigid(), self.modes())?;
        quadratic_roots(&N, &self.C, &self.K)
    }

    /// Transmission zeros from forces `(L_r, L_e) u` on the flexible part to displacements of the rigid one, by theorem
    /// 2.6(a) with `N = M - L_e L_r⁻¹ Pᵀ` (the book prints the transpose, which has the same determinant for diagonal
    /// matrices). `L_r` is n_0 x n_0, `L_e` n x n_0.
    ///
    /// # Errors
    /// No rigid coordinate, sizes that differ, or singular `L_r`.
    pub fn zeros_driven_elsewhere(
        &self,
        L_r: &DMatrix<f64>,
        L_e: &DMatrix<f64>,
    ) -> Result<Vec<Complex<f64>>, StructureError> {
        let right = rigid_solve(
            &L_r.transpose(),
            &L_e.transpose(),
            self.rigid(),
            self.modes(),
        )?;
        let N = &self.M - right.transpose() * self.P.transpose();
        quadratic_roots(&N, &self.C, &self.K)
    }

    /// The model with some rigid coordinates held at zero. Its poles are the transmission zeros from forces on them to their
    /// displacements, with the other rigid coordinates free.
    ///
    /// # Errors
    /// A coordinate that does not exist.
    pub fn held(&self, coordinates: &[usize]) -> Result<Self, StructureError> {
        let free = error::others("rigid coordinate that is held", coordinates, self.rigid())?;
        Ok(Self {
            J: self.J.select_rows(&free).select_columns(&free),
            P: self.P.select_columns(&free),
            ..self.clone()
        })
    }

    /// The model without some rigid coordinates on which no force acts: the momentum that belongs to them is zero, which determines them.
    ///
    /// # Errors
    /// A coordinate that does not exist.
    pub fn without(&self, coordinates: &[usize]) -> Result<Self, StructureError> {
        let field = "rigid coordinate that is eliminated";
        let kept = error::others(field, coordinates, self.rigid())?;
        if coordinates.is_empty() {
            return Ok(self.clone());
        }
        let inner = Self {
            J: self.J.select_rows(coordinates).select_columns(coordinates),
            ..self.clone()
        };
        let J_ck = self.J.select_rows(coordinates).select_columns(&kept);
        let P_c = self.P.select_columns(coordinates);
        let factor = inner.factor_J()?;
        let solved_J = factor.solve(&J_ck);
        let solved_P = factor.solve(&P_c.transpose());
        let J_kk = self.J.select_rows(&kept).select_columns(&kept);
        Ok(Self {
            J: (J_kk - J_ck.transpose() * &solved_J).symmetric_part(),
            P: self.P.select_columns(&kept) - &P_c * &solved_J,
            M: (&self.M - &P_c * solved_P).symmetric_part(),
            C: self.C.clone(),
            K: self.K.clone(),
        })
    }

    /// Poles with the forces `-stiffness p - damping p'` on the rigid coordinates (n_0 x n_0 each), 2 (n_0 + n) of them: collocated
    /// feedback of position and rate (DVDFB).
    ///
    /// # Errors
    /// Sizes that differ; a stiffness that leaves a rigid coordinate without force.
    pub fn feedback_poles(
        &self,
        stiffness: &DMatrix<f64>,
        damping: &DMatrix<f64>,
    ) -> Result<Vec<Complex<f64>>, StructureError> {
        let r = self.rigid();
        error::size("stiffness of the feedback", stiffness.shape(), (r, r))?;
        error::size("damping of the feedback", damping.shape(), (r, r))?;
        let [mass, mut C, mut K] = self.matrices();
        C.view_mut((0, 0), (r, r)).copy_from(damping);
        K.view_mut((0, 0), (r, r)).copy_from(stiffness);
        quadratic_roots(&mass, &C, &K)
    }

    /// The model in unconstrained modes, eqs. (2.6) to (2.8).
    ///
    /// # Errors
    /// An eigenvalue iteration that does not converge.
    pub fn unconstrained(&self) -> Result<UnconstrainedModel, StructureError> {
        let (r, n) = (self.rigid(), self.modes());
        let elastic = lowest_modes(&self.K, &self.N_c()?, n)?;
        let factor = self.factor_J()?;
        let Phi_1 = factor
            .l()
            .transpose()
            .try_inverse()
            .ok_or_else(|| dependent("rigid mass matrix J"))?;
        let Phi_2 = -factor.solve(&(self.P.transpose() * &elastic.vectors));
        let damping = (elastic.vectors.transpose() * &self.C * &elastic.vectors).symmetric_part();
        debug_assert_eq!((Phi_1.nrows(), Phi_2.shape()), (r, (r, n)));
        Ok(UnconstrainedModel {
            frequencies: elastic.values.map(f64::sqrt),
            damping,
            Phi_1,
            Phi_2,
            Phi_3: elastic.vectors,
        })
    }
}

/// Zeros belong to forces on rigid coordinates: without any, there are none.
fn require_rigid(count: usize) -> Result<(), StructureError> {
    let field = "number of rigid coordinates, on which the forces act,";
    error::positive(field, count as f64).map(drop)
}

/// `H_r⁻¹ H_e` with checks.
fn rigid_solve(
    H_r: &DMatrix<f64>,
    H_e: &DMatrix<f64>,
    r: usize,
    n: usize,
) -> Result<DMatrix<f64>, StructureError> {
    require_rigid(r)?;
    error::size(
        "rigid part of the output or input matrix",
        H_r.shape(),
        (r, r),
    )?;
    error::size(
        "flexible part of the output or input matrix",
        H_e.shape(),
        (r, n),
    )?;
    solve(H_r, H_e).ok_or_else(|| dependent("rigid part of the output or input matrix"))
}

/// The unconstrained-mode model, eq. (2.7): n_0 rigid modes and n elastic ones.
#[derive(Clone, Debug)]
pub struct UnconstrainedModel {
    /// Σ: angular frequencies of the elastic modes \[rad/s\], ascending.
    pub frequencies: DVector<f64>,
    /// Modal damping, n x n. The book writes `2 Z Σ` and takes it as diagonal; it is so only if the constrained modes' damping
    /// is proportional. The zeros are exact with the full matrix only.
    pub damping: DMatrix<f64>,
    /// n_0 x n_0, `Φ₁ Φ₁ᵀ = J⁻¹`.
    pub Phi_1: DMatrix<f64>,
    /// n_0 x n: motion of the rigid part in the elastic modes.
    pub Phi_2: DMatrix<f64>,
    /// n x n: modal coordinates μ in the elastic modes.
    pub Phi_3: DMatrix<f64>,
}

impl UnconstrainedModel {
    fn stiffness(&self) -> DMatrix<f64> {
        DMatrix::from_diagonal(&self.frequencies.map(|w| w * w))
    }

    /// `J = (Φ₁ Φ₁ᵀ)⁻¹`.
    fn J(&self) -> Result<DMatrix<f64>, StructureError> {
        let inverse = &self.Phi_1 * self.Phi_1.transpose();
        inverse.try_inverse().ok_or_else(|| dependent("Φ₁"))
    }

    fn zeros_with(&self, N: DMatrix<f64>) -> Result<Vec<Complex<f64>>, StructureError> {
        quadratic_roots(&N, &self.damping, &self.stiffness())
    }

    /// Poles by theorem 2.4(a) (where the book prints J for the identity), 2 n of them.
    ///
    /// # Errors
    /// An eigenvalue iteration that does not converge.
    pub fn poles(&self) -> Result<Vec<Complex<f64>>, StructureError> {
        let n = self.frequencies.len();
        self.zeros_with(DMatrix::identity(n, n))
    }

    /// Transmission zeros of the rigid part by theorem 2.4(b): `N = I + Φ₂ᵀ (Φ₁ Φ₁ᵀ)⁻¹ Φ₂`.
    ///
    /// # Errors
    /// No rigid coordinate; an eigenvalue iteration that does not converge.
    pub fn zeros(&self) -> Result<Vec<Complex<f64>>, StructureError> {
        let (r, n) = self.Phi_2.shape();
        require_rigid(r)?;
        let N = self.Phi_2.transpose() * self.J()? * &self.Phi_2;
        self.zeros_with(DMatrix::identity(n, n) + N.symmetric_part())
    }

    /// As [`HybridModel::zeros_measured_elsewhere`], by theorem 2.5(b): `N = I + Φ₂ᵀ (Φ₁ Φ₁ᵀ)⁻¹ H_r⁻¹ (H_r Φ₂ + H_e Φ₃)`.
    ///
    /// # Errors
    /// No rigid coordinate, sizes that differ, or singular `H_r`.
    pub fn zeros_measured_elsewhere(
        &self,
        H_r: &DMatrix<f64>,
        H_e: &DMatrix<f64>,
    ) -> Result<Vec<Complex<f64>>, StructureError> {
        let (r, n) = self.Phi_2.shape();
        let measured = &self.Phi_2 + rigid_solve(H_r, H_e, r, self.Phi_3.nrows())? * &self.Phi_3;
        let N = self.Phi_2.transpose() * self.J()? * measured;
        self.zeros_with(DMatrix::identity(n, n) + N)
    }

    /// As [`HybridModel::zeros_driven_elsewhere`], by theorem 2.6(b): `N = I + (Φ₂ᵀ L_r + Φ₃ᵀ L_e) L_r⁻¹ J Φ₂`.
    ///
    /// # Errors
    /// No rigid coordinate, sizes that differ, or singular `L_r`.
    pub fn zeros_driven_elsewhere(
        &self,
        L_r: &DMatrix<f64>,
        L_e: &DMatrix<f64>,
    ) -> Result<Vec<Complex<f64>>, StructureError> {
        let (r, n) = self.Phi_2.shape();
        let right =
            rigid_solve(&L_r.transpose(), &L_e.transpose(), r, self.Phi_3.nrows())?.transpose();
        let driven = self.Phi_2.transpose() + self.Phi_3.transpose() * right;
        let N = driven * self.J()? * &self.Phi_2;
        self.zeros_with(DMatrix::identity(n, n) + N)
    }
}
