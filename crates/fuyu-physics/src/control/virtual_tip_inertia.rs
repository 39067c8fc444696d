//! A load that the tip is made to feel, so that it may be damped strongly by a law that is sampled.

use nalgebra::{DMatrix, DVector, Matrix6, Matrix6xX, Vector6};

use super::task_priority::factorize;
use super::{Manipulator, Measurement};
use crate::dynamics::{Input, State};

/// Mass \[kg\] and moment of inertia about every axis \[kg m²\] of a load at the tip.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct VirtualTipInertia {
    /// Mass \[kg\].
    pub mass: f64,
    /// Moment of inertia about every axis \[kg m²\].
    pub inertia: f64,
}

/// Makes the tip as heavy as if it carried a load.
///
/// What damps the tip with `D` slows it down at the rate `Λ⁻¹ D`, where `Λ = (Ĵ Ĥ⁻¹ Ĵᵀ)⁻¹` is the tip's own inertia. A light
/// wrist has little of it in some directions, and a law that answers at every period `T` and not all the time is unstable
/// where that rate is more than `2/T`. With the wrench `-M dV_s/dt` on the tip, that of a load `M = (m, i)` by its
/// inertia, the rate is that of `(Λ + M)⁻¹ D`, never more than `d/m`, whatever the posture is; and nothing changes about slow
/// motion, `D V_s = (k_p ē_p, k_o ē_o)`.
///
/// A load takes its power from its own kinetic energy, so a law with a Lyapunov function `W` has one with the load,
/// `W + ½ m |V_s|² + ½ i |Ω_s|²`, that falls as fast. `V_s = Ĵ s` is the tip's velocity beside the goal's, with `s = q̇ - q̇_D` of
/// [`FeedForward`](super::FeedForward), or `q̇` where nothing is fed forward. The acceleration that the wrench depends on, and
/// which depends on the wrench, follows from the model: `dV_s/dt = A + Λ⁻¹ f` with `A` of the motion without the load. (Where
/// something is fed forward, `A` is that of the rates `s`; this leaves out terms of the size `M |q̇_D| |s|` beside the damping
/// `D |s|`, which is larger by how much `d/m` is larger than `|q̇_D|`, some hundred times.)
#[derive(Debug, Clone)]
pub(super) struct InertiaWrench {
    state: State,
    free: Input,
    acceleration: DVector<f64>,
    /// `L` with `Ĥ = L Lᵀ`, and `Ĵ L⁻ᵀ`.
    factor: DMatrix<f64>,
    moves: Matrix6xX<f64>,
    row: DVector<f64>,
}

impl InertiaWrench {
    /// For the arm; the only place where memory is taken.
    pub fn new(arm: &Manipulator) -> Self {
        let joints = arm.model.dof();
        Self {
            state: State::at_rest(&arm.model),
            free: Input::zero(&arm.model),
            acceleration: DVector::zeros(joints),
            factor: DMatrix::zeros(joints, joints),
            moves: Matrix6xX::zeros(joints),
            row: DVector::zeros(joints),
        }
    }

    /// The wrench of the load's inertia on the tip \[N, N m\], linear rows first, base axes.
    ///
    /// `tip_moves` is `Ĵ`, `rates` are `s`, `efforts` all efforts that act beside. `arm.workspace` has the positions of `seen`; its
    /// motion afterwards is that of `s` without momentum.
    pub fn wrench(
        &mut self,
        load: VirtualTipInertia,
        arm: &mut Manipulator,
        seen: &Measurement<'_>,
        tip_moves: &Matrix6xX<f64>,
        rates: &DVector<f64>,
        efforts: impl Fn(usize) -> f64,
    ) -> Vector6<f64> {
        let Manipulator {
            model,
            tip,
            workspace,
            ..
        } = arm;
        self.state.q.copy_from(seen.q);
        self.state.qd.copy_from(rates);
        for (j, effort) in self.free.efforts.iter_mut().enumerate() {
            *effort = efforts(j);
        }
        workspace.set_motion(&self.state);
        workspace.accelerations(model, &self.state, &self.free, &mut self.acceleration);
        workspace.set_accelerations(&self.acceleration);
        let A = workspace.A_WF_B(tip);
        factorize(workspace.reduced_inertia(), &mut self.factor);
        for (i, row) in tip_moves.row_iter().enumerate() {
            self.row.tr_copy_from(&row);
            self.factor.solve_lower_triangular_mut(&mut self.row);
            self.moves.row_mut(i).tr_copy_from(&self.row);
        }
        // f = -M (A + Λ⁻¹ f) is f = -S u with S² = M, (1 + S Λ⁻¹ S) u = S A.
        let (m, i) = (load.mass.sqrt(), load.inertia.sqrt());
        let S = Vector6::new(m, m, m, i, i, i);
        let mut square = Matrix6::identity();
        for column in self.moves.column_iter() {
            let scaled = S.component_mul(&column);
            square.ger(1.0, &scaled, &scaled, 1.0);
        }
        let (a, alpha) = (A.linear, A.angular);
        let A = Vector6::new(a.x, a.y, a.z, alpha.x, alpha.y, alpha.z);
        // At least one; positions that are not finite show in every result.
        square.cholesky().map_or_else(Vector6::zeros, |factor| {
            -S.component_mul(&factor.solve(&S.component_mul(&A)))
        })
    }
}
