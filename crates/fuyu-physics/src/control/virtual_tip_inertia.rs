//! Virtual inertia at the tip, with which a sampled law can damp the tip strongly.

use nalgebra::{DMatrix, DVector, Matrix6, Matrix6xX, Vector6};

use super::Manipulator;
use super::task_priority::factorize;
use crate::dynamics::{Input, State};

/// Virtual inertia at the tip.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct VirtualTipInertia {
    /// Mass \[kg\].
    pub mass: f64,
    /// Moment of inertia about every axis \[kg m²\].
    pub inertia: f64,
}

/// Computes the wrench that makes the tip move as if it carried a load with the virtual inertia.
///
/// Damping `D` of the tip slows it down at the rate `Λ⁻¹ D`, where `Λ = (Ĵ Ĥ⁻¹ Ĵᵀ)⁻¹` is the tip's own inertia. A light
/// wrist makes it small in some directions, and a law that is sampled with the period `T` is unstable if that rate is
/// more than `2/T`. With the wrench `-M dV_s/dt` on the tip, which is that of a load `M = (m, i)`, the rate is that of
/// `(Λ + M)⁻¹ D`, never more than `d/m`, in any posture; slow motion, `D V_s = (k_p ē_p, k_o ē_o)`, does not change.
///
/// A load takes its power from its own kinetic energy, so for a law with a Lyapunov function `W` the loaded law has the
/// Lyapunov function `W + ½ m |V_s|² + ½ i |Ω_s|²`, which decreases as fast. `V_s = Ĵ s` is the tip's velocity relative
/// to the goal's, with `s = q̇ - q̇_D` of [`FeedForward`](super::FeedForward), or `q̇` without feed-forward. The
/// acceleration, on which the wrench depends and which itself depends on the wrench, follows from the model: `dV_s/dt =
/// A + Λ⁻¹ f` with `A` of the motion without the load. (With feed-forward, `A` is that of the rates `s`; this omits
/// terms of the size `M |q̇_D| |s|`, which are smaller than the damping `D |s|` by the ratio of `|q̇_D|` to `d/m`, some
/// hundred times.)
#[derive(Debug, Clone)]
pub(super) struct InertiaWrench {
    state: State,
    input: Input,
    acceleration: DVector<f64>,
    /// `L` with `Ĥ = L Lᵀ`.
    factor: DMatrix<f64>,
    /// `Ĵ L⁻ᵀ`.
    scaled_jacobian: Matrix6xX<f64>,
    row: DVector<f64>,
}

impl InertiaWrench {
    /// Scratch for a robot; the only function that allocates memory.
    pub fn new(manipulator: &Manipulator) -> Self {
        let joints = manipulator.model.dof();
        Self {
            state: State::at_rest(&manipulator.model),
            input: Input::zero(&manipulator.model),
            acceleration: DVector::zeros(joints),
            factor: DMatrix::zeros(joints, joints),
            scaled_jacobian: Matrix6xX::zeros(joints),
            row: DVector::zeros(joints),
        }
    }

    /// The wrench of the virtual inertia on the tip \[N, N m\], linear rows first, base axes.
    ///
    /// `jacobian` is `Ĵ`, `rates` are `s`, `efforts` are all other joint efforts. `manipulator.workspace` holds the
    /// joint positions `q`; its motion afterwards is that of `s` without momentum.
    pub fn compute(
        &mut self,
        inertia: VirtualTipInertia,
        manipulator: &mut Manipulator,
        q: &DVector<f64>,
        jacobian: &Matrix6xX<f64>,
        rates: &DVector<f64>,
        efforts: impl Fn(usize) -> f64,
    ) -> Vector6<f64> {
        let Manipulator { tip, workspace, .. } = manipulator;
        self.state.q.copy_from(q);
        self.state.qd.copy_from(rates);
        for (j, effort) in self.input.efforts.iter_mut().enumerate() {
            *effort = efforts(j);
        }
        workspace.set_motion(&self.state);
        workspace.accelerations(&self.state, &self.input, &mut self.acceleration);
        workspace.set_accelerations(&self.acceleration);
        let A = workspace.A_WF_B(tip);
        factorize(workspace.reduced_inertia(), &mut self.factor);
        for (i, row) in jacobian.row_iter().enumerate() {
            self.row.tr_copy_from(&row);
            self.factor.solve_lower_triangular_mut(&mut self.row);
            self.scaled_jacobian.row_mut(i).tr_copy_from(&self.row);
        }
        // f = -M (A + Λ⁻¹ f) is f = -S u with S² = M, (1 + S Λ⁻¹ S) u = S A.
        let (m, i) = (inertia.mass.sqrt(), inertia.inertia.sqrt());
        let S = Vector6::new(m, m, m, i, i, i);
        let mut square = Matrix6::identity();
        for column in self.scaled_jacobian.column_iter() {
            let scaled = S.component_mul(&column);
            square.ger(1.0, &scaled, &scaled, 1.0);
        }
        let (a, alpha) = (A.linear, A.angular);
        let A = Vector6::new(a.x, a.y, a.z, alpha.x, alpha.y, alpha.z);
        // The eigenvalues are at least one, so only a matrix that is not finite has no factor; the joint efforts of the
        // other terms then show that.
        square.cholesky().map_or_else(Vector6::zeros, |factor| {
            -S.component_mul(&factor.solve(&S.component_mul(&A)))
        })
    }
}
