//! Reduced inertia and kinetic energy.

use nalgebra::DMatrix;

use super::Workspace;
use crate::model::Model;

impl Workspace {
    /// Reduced inertia `Ĥ` (n × n): inertia that the joints feel when the base is free.
    /// Masutani 1995 eq. (4.48); `H_q` of eq. (4.46) by composite bodies.
    pub fn reduced_inertia(&mut self, model: &Model) -> &DMatrix<f64> {
        self.set_reduced_inertia(model);
        &self.reduced
    }

    pub(super) fn set_reduced_inertia(&mut self, model: &Model) {
        let n = model.dof();
        self.reduced.fill(0.0);
        for j in 0..n {
            let mut body = j + 1;
            let mut force = self.composite[body].momentum(&self.axes[j]);
            self.reduced[(j, j)] = self.axes[j].dot(&force);
            while let Some(parent) = model.bodies()[body].parent.filter(|&p| p != 0) {
                force = force.shifted_to_parent(&self.X_PB[body]);
                let h = self.axes[parent - 1].dot(&force);
                self.reduced[(j, parent - 1)] = h;
                self.reduced[(parent - 1, j)] = h;
                body = parent;
            }
        }
        for j in 0..n {
            let linear = self.J_C.column(j) * self.mass;
            let angular = self.H_B_inverse * self.H_M.column(j);
            for i in j..n {
                let base = self.J_C.column(i).dot(&linear) + self.H_M.column(i).dot(&angular);
                self.reduced[(i, j)] -= base;
                if i != j {
                    self.reduced[(j, i)] -= base;
                }
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
