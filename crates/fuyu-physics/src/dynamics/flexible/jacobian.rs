//! The generalized Jacobian of a robot with flexible parts.

use nalgebra::Matrix6xX;

use super::{FlexibleState, FlexibleSystem, FlexibleWorkspace};
use crate::dynamics::Momentum;
use crate::model::Frame;

/// Computes flexible generalized Jacobians; owns scratch memory.
///
/// At zero momentum the velocity of a frame's origin is `Ĵ_q q' + Ĵ_x x'`, where x contains modes, motor angles and
/// wheel angles, and `Ĵ = J - J_b M_b⁻¹ M_bx`: the base reacts to modal rates and wheels as it does to joints (Masutani
/// 1995 eqs. (4.36), (4.37), extended by the coupling of the modes, Kida 1993 eq. (B.4)).
#[derive(Clone, Debug)]
pub struct FlexibleJacobian {
    unit: FlexibleState,
    workspace: FlexibleWorkspace,
}

impl FlexibleJacobian {
    /// Scratch for `system`. Allocates; [`FlexibleJacobian::compute`] does not.
    pub fn new(system: &FlexibleSystem) -> Self {
        Self {
            unit: FlexibleState::at_rest(system),
            workspace: FlexibleWorkspace::new(system),
        }
    }

    /// Writes the generalized Jacobian of `frame`'s origin at the positions of `state` to `out` (6 x N, linear rows
    /// first, inertial velocity in base axes). Columns: joints, modal coordinates, motor angles, wheel angles.
    ///
    /// # Panics
    /// If the state is of another system, or `out` does not have one column per coordinate.
    pub fn compute(&mut self, state: &FlexibleState, frame: &Frame, out: &mut Matrix6xX<f64>) {
        let Self { unit, workspace } = self;
        let (n, extras) = (state.tree.q.len(), state.x.len());
        assert_eq!(
            out.ncols(),
            n + extras,
            "out must have one column per joint, mode, motor and wheel"
        );
        unit.copy_from(state);
        unit.tree.qd.fill(0.0);
        unit.xd.fill(0.0);
        for i in 0..n + extras {
            let rate = if i < n {
                &mut unit.tree.qd[i]
            } else {
                &mut unit.xd[i - n]
            };
            *rate = 1.0;
            workspace.set_positions(unit);
            workspace.nodes[0].V = workspace.base_twist(&Momentum::default());
            workspace.propagate_motion(unit);
            workspace.set_poses();
            let V = workspace.V_WF_B(frame);
            let column = &mut out.as_mut_slice()[6 * i..6 * (i + 1)];
            column[..3].copy_from_slice(V.linear.as_slice());
            column[3..].copy_from_slice(V.angular.as_slice());
            if i < n {
                unit.tree.qd[i] = 0.0;
            } else {
                unit.xd[i - n] = 0.0;
            }
        }
    }
}
