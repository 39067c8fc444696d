//! The equations of motion, steps (iii)-(v) of TR-942 section 2.3.4.

use nalgebra::{Cholesky, DMatrix, Vector3};

use super::{BaseSpeed, Equations, Kane};
use crate::dynamics::TreeAcceleration;
use crate::model::Model;
use crate::spatial::Twist;

impl Kane {
    /// Number of rows for the main body's velocity; those of its angular velocity and of the hinges follow.
    fn translation_rows(&self) -> usize {
        match self.speed {
            BaseSpeed::MainBody => 3,
            BaseSpeed::SystemCom => 0,
        }
    }

    /// Solves for the accelerations. On entry, `hinges` holds the hinges' efforts.
    pub(super) fn solve(&mut self, out: &mut TreeAcceleration) {
        self.set_equations();
        let hinge_row = self.translation_rows() + 3;
        let G = &mut self.of_hinges.G;
        G.fill(0.0);
        for cut in &self.cuts {
            cut.constrain(&self.bodies, hinge_row, G, &mut self.multipliers);
        }
        let equations = match &mut self.of_coordinates {
            Some(coordinates) => {
                coordinates.gather(&self.of_hinges, &self.model, hinge_row);
                coordinates
            }
            None => &mut self.of_hinges,
        };
        let Equations { M, speeds, G } = equations;
        // M = L Lᵀ; a matrix that is not positive definite gives values that are not finite.
        let factored = Cholesky::new_unchecked(std::mem::replace(M, DMatrix::zeros(0, 0)));
        let L = factored.l_dirty();
        L.solve_lower_triangular_unchecked_mut(speeds);
        if !self.cuts.is_empty() {
            L.solve_lower_triangular_unchecked_mut(G);
            // (2.3.46): (Gᵀ M⁻¹ G) f_c = -(Ġᵀ u + Gᵀ M⁻¹ (-g)).
            self.multipliers.gemv_tr(-1.0, G, speeds, -1.0);
            G.tr_mul_to(G, &mut self.GMG);
            let GMG = std::mem::replace(&mut self.GMG, DMatrix::zeros(0, 0));
            let GMG = Cholesky::new_unchecked(GMG);
            GMG.solve_mut(&mut self.multipliers);
            self.GMG = GMG.unpack_dirty();
            speeds.gemv(1.0, G, &self.multipliers, 1.0);
        }
        L.ad_solve_lower_triangular_unchecked_mut(speeds);
        *M = factored.unpack_dirty();
        self.write(out);
    }

    /// `M` (2.3.22), (2.3.32)-(2.3.36) and `-g` (2.3.26), (2.3.37), (2.3.38).
    ///
    /// Each entry is the partial velocity of one generalized speed times the momentum of its outer set for a unit value
    /// of another. If the velocity of the system's centre of mass is a generalized speed, that point is at rest in the
    /// partial velocities of the others, so that the terms of the common motion of all bodies vanish.
    fn set_equations(&mut self) {
        let first = self.translation_rows();
        let Equations { M, speeds, .. } = &mut self.of_hinges;
        let bodies = &self.bodies;
        let base = &bodies[0];
        let force = &base.force_hat;
        M.fill(0.0);
        let (about, per_mass) = match self.speed {
            BaseSpeed::MainBody => {
                let s = &base.moment_hat;
                M.fixed_view_mut::<3, 3>(0, 0).fill_diagonal(base.mass_hat);
                M.fixed_view_mut::<3, 3>(3, 0).copy_from(&s.cross_matrix());
                speeds.fixed_rows_mut::<3>(0).copy_from(&force.force);
                (Vector3::zeros(), 0.0)
            }
            BaseSpeed::SystemCom => (base.moment_hat / base.mass_hat, 1.0 / base.mass_hat),
        };
        M.fixed_view_mut::<3, 3>(first, first)
            .copy_from(&base.inertia_hat_about(&about));
        let torque = force.torque - about.cross(&force.force);
        speeds.fixed_rows_mut::<3>(first).copy_from(&torque);
        for (i, (body, effort)) in bodies[1..].iter().zip(&self.hinges).enumerate() {
            let row = first + 3 + i;
            let unit = &body.unit_momentum;
            let generalized = if body.is_prismatic() {
                body.z.dot(&body.force_hat.force)
            } else {
                body.z.dot(&body.force_hat.torque)
            };
            speeds[row] = generalized + effort - unit.force.dot(&force.force) * per_mass;
            if self.speed == BaseSpeed::MainBody {
                M.fixed_view_mut::<1, 3>(row, 0)
                    .copy_from(&unit.force.transpose());
            }
            let turning = unit.torque + (body.p - about).cross(&unit.force);
            M.fixed_view_mut::<1, 3>(row, first)
                .copy_from(&turning.transpose());
            if self.speed == BaseSpeed::SystemCom {
                for (j, other) in bodies[1..=i + 1].iter().enumerate() {
                    M[(row, first + 3 + j)] =
                        -unit.force.dot(&other.unit_momentum.force) * per_mass;
                }
            }
            let mut inner = i + 1;
            while inner != 0 {
                let other = &bodies[inner];
                M[(row, first + 2 + inner)] += if other.is_prismatic() {
                    other.z.dot(&unit.force)
                } else {
                    let torque = unit.torque + (body.p - other.p).cross(&unit.force);
                    other.z.dot(&torque)
                };
                inner = other.inner.expect("only the main body has no inner body");
            }
        }
    }

    /// The accelerations in base axes.
    fn write(&mut self, out: &mut TreeAcceleration) {
        let first = self.translation_rows();
        let base = &self.bodies[0];
        let speeds = &self
            .of_coordinates
            .as_ref()
            .unwrap_or(&self.of_hinges)
            .speeds;
        let angular: Vector3<f64> = speeds.fixed_rows::<3>(first).into_owned();
        let qdd = &speeds.as_slice()[first + 3..];
        out.qdd.as_mut_slice().copy_from_slice(qdd);
        if self.model.has_mimics() {
            self.model.expand_rates(qdd, &mut self.hinges);
        } else {
            self.hinges.copy_from_slice(qdd);
        }
        let linear = match self.speed {
            BaseSpeed::MainBody => speeds.fixed_rows::<3>(0).into_owned(),
            BaseSpeed::SystemCom => {
                // The first row of the equations of motion, which is not part of the system solved.
                let mut force = base.force_hat.force - angular.cross(&base.moment_hat);
                for (body, qdd) in self.bodies[1..].iter().zip(&self.hinges) {
                    force -= body.unit_momentum.force * *qdd;
                }
                force / base.mass_hat
            }
        };
        let R_BW = base.R_WB.inverse();
        out.A_WB_B = Twist::new(R_BW * angular, R_BW * linear);
    }
}

impl Equations {
    /// Sets the equations for the coordinates of a robot with mimic joints from those for all its hinges: with `u_t = T u`,
    /// these are `M = Tᵀ M_t T`, `-g = -Tᵀ g_t` and `G = Tᵀ G_t`. Rows before `hinge_row` are the main body's.
    fn gather(&mut self, tree: &Self, model: &Model, hinge_row: usize) {
        let place = |row: usize| match row.checked_sub(hinge_row) {
            None => (row, 1.0),
            Some(hinge) => {
                let coupling = model.coupling(hinge);
                (hinge_row + coupling.coordinate, coupling.ratio)
            }
        };
        self.M.fill(0.0);
        self.speeds.fill(0.0);
        self.G.fill(0.0);
        for r in 0..tree.M.nrows() {
            let (row, of_row) = place(r);
            self.speeds[row] += of_row * tree.speeds[r];
            for constraint in 0..tree.G.ncols() {
                self.G[(row, constraint)] += of_row * tree.G[(r, constraint)];
            }
            for c in 0..=r {
                let (column, of_column) = place(c);
                // Off the diagonal, an entry of the lower triangle stands for two.
                let twice = if row == column && r != c { 2.0 } else { 1.0 };
                self.M[(row.max(column), row.min(column))] +=
                    twice * of_row * of_column * tree.M[(r, c)];
            }
        }
    }
}
