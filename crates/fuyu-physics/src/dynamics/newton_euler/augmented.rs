//! The augmented inertia matrix, for inspection.

use nalgebra::{DMatrix, DVector};

use super::{Axis, BodyState, Load, MatrixMethod, System};
use crate::spatial::Wrench;

impl MatrixMethod {
    /// `A` and `B` of TR-942 eqs. (2.2.10)-(2.2.17), `A X = B`, for a system in `state` under `load`: of size
    /// 6 N + 6 M for N bodies and M hinges. `X` is eq. (2.2.11): rates of linear momentum of all bodies, then of
    /// angular momentum, body axes, then forces in all hinges, then torques, along their axes.
    ///
    /// For inspection and tests: the constraints determine all forces if `A` has full rank. The solution of
    /// [`MatrixMethod::solve`] satisfies `A X = B`. Forces act on the outer body, so the signs of `A_12` and of the
    /// rows of `A_21` are opposite to the printed ones; an angular row contains the translation terms `d_2` that
    /// reciprocity requires.
    pub fn augmented(
        &mut self,
        system: &System,
        state: &[f64],
        load: &Load,
    ) -> (DMatrix<f64>, DVector<f64>) {
        self.solve(system, state, load);
        let (n, m) = (system.bodies.len(), system.hinges.len());
        let mut A = DMatrix::identity(6 * (n + m), 6 * (n + m));
        let mut B = DVector::zeros(6 * (n + m));
        for (b, (body, wrench)) in system.bodies.iter().zip(&load.wrenches).enumerate() {
            let at = BodyState::read(state, b);
            let spin = body.inertia.about_com * at.w_WB_B;
            let force = wrench.force - at.w_WB_B.cross(&at.v_WC_B) * body.inertia.mass;
            let torque = wrench.torque - at.w_WB_B.cross(&spin);
            B.fixed_rows_mut::<3>(3 * b).copy_from(&force);
            B.fixed_rows_mut::<3>(3 * n + 3 * b).copy_from(&torque);
        }
        for i in 0..m {
            for axis in Axis::ALL {
                let k = axis.index();
                let at = 6 * n + 3 * i + if axis.is_rotation() { 3 * m + k - 3 } else { k };
                let free = !system.holds(i, axis);
                B[at] = if free {
                    self.hinge_efforts(i)[k]
                } else {
                    A[(at, at)] = 0.0;
                    load.driven[i][k] - self.motions[i].bias[k]
                };
                let bodies = self
                    .bodies
                    .acted_on(&system.joined[i], &self.motions[i], axis);
                for (body, Wrench { force, torque }) in bodies {
                    let state = BodyState::read(state, body);
                    let inertia = &system.bodies[body].inertia;
                    let inverse = inertia.about_com.cholesky().expect("inertias are checked");
                    let (p, q) = (3 * body, 3 * (n + body));
                    A.fixed_view_mut::<3, 1>(p, at).copy_from(&-force);
                    A.fixed_view_mut::<3, 1>(q, at).copy_from(&-torque);
                    if !free {
                        let linear = force.transpose() / inertia.mass;
                        let angular = inverse.solve(&torque).transpose();
                        A.fixed_view_mut::<1, 3>(at, p).copy_from(&linear);
                        A.fixed_view_mut::<1, 3>(at, q).copy_from(&angular);
                        // Momentum in body axes rotates with the body.
                        B[at] -= force.dot(&state.w_WB_B.cross(&state.v_WC_B));
                    }
                }
            }
        }
        (A, B)
    }
}
