//! Linearised closed loop at the goal.

use nalgebra::linalg::Schur;
use nalgebra::{Complex, DMatrix, DVector, Matrix6xX};

use super::sampled_damping::largest_below;
use super::{Gains, JacobianKind};
use crate::dynamics::Workspace;
use crate::model::{Frame, Model};

/// Growth of a deviation in a period that exceeds rounding.
const GROWS: f64 = 1.0 + 1e-6;

/// The closed loop of transpose-Jacobian control, linearised in deviations `δq` from joint positions at which the tip
/// is at its goal: `Ĥ δq̈ + K_V δq̇ + (k_p J_Lᵀ Ĵ_L + k_o J_Aᵀ Ĵ_A) δq = 0`, Masutani 1995 eq. (6.2), which omits the
/// attitude. `J` is the Jacobian that the law uses; the tip moves by the generalized Jacobian `Ĵ`.
#[derive(Debug, Clone, PartialEq)]
pub struct LinearisedLoop {
    /// `Ĥ` \[kg m² or kg\].
    pub inertia: DMatrix<f64>,
    /// Diagonal of `K_V`.
    pub damping: DVector<f64>,
    /// `k_p J_Lᵀ Ĵ_L + k_o J_Aᵀ Ĵ_A`; symmetric if the law uses the generalized Jacobian.
    pub stiffness: DMatrix<f64>,
}

impl LinearisedLoop {
    /// The loop at joint positions `q`, with the law's Jacobian. For any tree, planar or not.
    ///
    /// # Panics
    /// If `q` or `gains.k_v` do not have one element per joint.
    pub fn at(
        model: &Model,
        workspace: &mut Workspace,
        tip: &Frame,
        q: &DVector<f64>,
        gains: &Gains,
        jacobian: JacobianKind,
    ) -> Self {
        let n = model.dof();
        assert_eq!(gains.k_v.len(), n, "one gain per joint");
        workspace.set_positions(q);
        let mut law = Matrix6xX::zeros(n);
        jacobian.write(workspace, tip, &mut law);
        let mut generalized = Matrix6xX::zeros(n);
        workspace.generalized_jacobian(tip, &mut generalized);
        let stiffness = law.rows(0, 3).tr_mul(&generalized.rows(0, 3)) * gains.k_p
            + law.rows(3, 3).tr_mul(&generalized.rows(3, 3)) * gains.k_o;
        Self {
            inertia: workspace.reduced_inertia().clone(),
            damping: DVector::from_column_slice(&gains.k_v),
            stiffness,
        }
    }

    /// Roots of the characteristic equation \[1/s\], two per joint, in no particular order. `None` if the
    /// iteration does not converge.
    pub fn eigenvalues(&self) -> Option<Vec<Complex<f64>>> {
        let n = self.damping.len();
        let mut system = DMatrix::zeros(2 * n, 2 * n);
        system.view_mut((0, n), (n, n)).fill_with_identity();
        system.rows_mut(n, n).copy_from(&self.accelerations()?);
        eigenvalues(system)
    }

    /// Growth factor per sampling period \[s\] of the fastest growing deviation, if the law's efforts are held for a
    /// period: more than 1 if sampling makes the loop unstable, 1 if the joints can move without the tip. `None` as
    /// [`LinearisedLoop::eigenvalues`].
    ///
    /// Under held efforts `u` the motion is `δq + T δq̇ + ½ T² Ĥ⁻¹ u`, `δq̇ + T Ĥ⁻¹ u`.
    pub fn sampled_growth(&self, period: f64) -> Option<f64> {
        let n = self.damping.len();
        let identity = DMatrix::identity(n, n);
        let mut held = DMatrix::zeros(2 * n, n);
        held.rows_mut(0, n)
            .copy_from(&(&identity * (0.5 * period * period)));
        held.rows_mut(n, n).copy_from(&(&identity * period));
        let mut free = DMatrix::identity(2 * n, 2 * n);
        free.view_mut((0, n), (n, n))
            .copy_from(&(&identity * period));
        let roots = eigenvalues(free + held * self.accelerations()?)?;
        roots.iter().map(|root| root.norm()).max_by(f64::total_cmp)
    }

    /// The largest fraction of the stiffness, at most 1, for which no deviation grows in a sampling period \[s\]; 0 if
    /// the damping alone is too large.
    pub fn largest_stable_part(&self, period: f64) -> f64 {
        let is_stable = |part: f64| {
            let scaled = Self {
                stiffness: &self.stiffness * part,
                ..self.clone()
            };
            (scaled.sampled_growth(period)).is_some_and(|growth| growth <= GROWS)
        };
        if is_stable(1.0) {
            return 1.0;
        }
        largest_below(1.0, is_stable)
    }

    /// Matrix of the accelerations `δq̈` as a function of the state `(δq, δq̇)`.
    fn accelerations(&self) -> Option<DMatrix<f64>> {
        let n = self.damping.len();
        let inverse = self.inertia.clone().cholesky()?.inverse();
        let mut accelerations = DMatrix::zeros(n, 2 * n);
        let damping = DMatrix::from_diagonal(&self.damping);
        (accelerations.columns_mut(0, n)).copy_from(&-(&inverse * &self.stiffness));
        (accelerations.columns_mut(n, n)).copy_from(&-(&inverse * damping));
        Some(accelerations)
    }

    /// The largest real part of the roots \[1/s\]: negative where the goal is asymptotically stable, positive
    /// where it is unstable, zero up to rounding where the joints can move without the tip.
    /// `None` as [`LinearisedLoop::eigenvalues`].
    pub fn growth_rate(&self) -> Option<f64> {
        let roots = self.eigenvalues()?;
        roots.iter().map(|root| root.re).max_by(f64::total_cmp)
    }
}

fn eigenvalues(system: DMatrix<f64>) -> Option<Vec<Complex<f64>>> {
    let schur = Schur::try_new(system, f64::EPSILON, 10_000)?;
    Some(schur.complex_eigenvalues().iter().copied().collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::Saturation;

    /// One joint, `Ĥ = 1`: Jury's criterion for `z² - (2 - d - k/2) z + (1 - d + k/2)` with `d = D T`, `k = K T²` gives
    /// stability for `d > k/2` and `d < 2`. Fails without the half square of the held effort.
    #[test]
    fn one_sampled_joint_obeys_jury_s_criterion() {
        let period = 0.1;
        for (d, k, is_stable) in [
            (0.5, 0.9, true),
            (0.5, 1.1, false),
            (1.9, 0.1, true),
            (2.1, 0.1, false),
            (0.05, 0.09, true),
            (0.05, 0.11, false),
        ] {
            let one = |x: f64| DMatrix::from_element(1, 1, x);
            let sampled = LinearisedLoop {
                inertia: one(1.0),
                damping: DVector::from_element(1, d / period),
                stiffness: one(k / (period * period)),
            };
            let growth = sampled.sampled_growth(period).unwrap();
            assert_eq!(growth < 1.0, is_stable, "{d} {k}: {growth}");
        }
    }

    /// With the generalized Jacobian no root has a positive real part, in any posture.
    #[test]
    fn with_the_generalized_jacobian_every_posture_is_stable() {
        let xml = include_str!("../../../../urdf/servicer.urdf");
        let model = Model::from_urdf(xml, "urdf/servicer.urdf").unwrap();
        let tip = model.frame("tool0").unwrap();
        let mut workspace = Workspace::new(&model);
        let gains = Gains {
            k_p: 75.0,
            k_o: 100.0,
            k_v: vec![400.0, 100.0, 200.0, 10.0, 2.0, 2.0],
            saturation: Saturation::NONE,
        };
        for k in 0..200 {
            let q = DVector::from_fn(6, |j, _| (1.7 * (k * 6 + j) as f64).sin() * 3.0);
            let near = LinearisedLoop::at(
                &model,
                &mut workspace,
                tip,
                &q,
                &gains,
                JacobianKind::Generalized,
            );
            assert!((&near.stiffness - near.stiffness.transpose()).amax() < 1e-9);
            let roots = near.eigenvalues().unwrap();
            assert_eq!(roots.len(), 12);
            assert!(near.growth_rate().unwrap() < 1e-9, "{roots:?}");
        }
    }
}
