//! Reduced inertia and kinetic energy.

use nalgebra::DMatrix;

use super::Workspace;
use crate::model::Model;

impl Workspace {
    /// Reduced inertia `Ĥ` (n × n): inertia that the joints feel when the base is free.
    /// Masutani 1995 eq. (4.48); `H_q` of eq. (4.46) by composite bodies.
    pub fn reduced_inertia(&mut self) -> &DMatrix<f64> {
        self.set_reduced_inertia();
        self.reduced.fill_upper_triangle_with_lower_triangle();
        &self.reduced
    }

    /// Fills the lower triangle of `Ĥ`.
    pub(super) fn set_reduced_inertia(&mut self) {
        let n = self.parents.len();
        for j in 0..n {
            // The momentum that joint j alone gives to the free-floating system, in terms of which the
            // base's share of every pair (i, j) is one dot product: m J_Cᵀ J_C + H_Mᵀ H_B⁻¹ H_M.
            let (linear, angular) = (self.J_C[j] * self.mass, self.H_A[j]);
            for i in 0..=j {
                self.reduced[(j, i)] = self.H_M[i].dot(&angular) - self.J_C[i].dot(&linear);
            }
            let mut body = j + 1;
            let mut force = self.composite[body].momentum(&self.axes[j]);
            loop {
                self.reduced[(j, body - 1)] += self.axes[body - 1].dot(&force);
                let parent = self.parents[body - 1];
                if parent == 0 {
                    break;
                }
                force = force.shifted_to_parent(&self.X_PB[body]);
                body = parent;
            }
        }
    }

    /// Kinetic energy \[J\] as the sum over bodies of Masutani 1995 eq. (4.44), from their twists
    /// (needs [`Workspace::set_motion`]).
    pub fn kinetic_energy(&self, model: &Model) -> f64 {
        let twice: f64 = (model.bodies().iter().zip(&self.twist))
            .map(|(body, twist)| {
                let v_com = twist.linear + twist.angular.cross(&body.inertia.com);
                body.inertia.mass * v_com.norm_squared()
                    + twist.angular.dot(&(body.inertia.about_com * twist.angular))
            })
            .sum();
        0.5 * twice
    }
}
