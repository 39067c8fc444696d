//! The equations of motion, steps (iii)-(v) of TR-942 section 2.3.4.

use nalgebra::{Cholesky, DMatrix, Vector3};

use super::{BaseSpeed, Kane};
use crate::dynamics::TreeAcceleration;
use crate::spatial::Twist;

impl Kane {
    /// Number of rows for the main body's velocity; those of its angular velocity and of the hinges follow.
    fn translation_rows(&self) -> usize {
        match self.speed {
            BaseSpeed::MainBody => 3,
            BaseSpeed::SystemCom => 0,
        }
    }

    /// Solves for the accelerations. On entry, `out.qdd` holds the hinges' efforts.
    pub(super) fn solve(&mut self, out: &mut TreeAcceleration) {
        self.set_equations(out);
        let hinge_row = self.translation_rows() + 3;
        self.G.fill(0.0);
        for cut in &self.cuts {
            cut.constrain(&self.bodies, hinge_row, &mut self.G, &mut self.multipliers);
        }
        // M = L Lᵀ; a matrix that is not positive definite gives values that are not finite.
        let M = Cholesky::new_unchecked(std::mem::replace(&mut self.M, DMatrix::zeros(0, 0)));
        let L = M.l_dirty();
        L.solve_lower_triangular_unchecked_mut(&mut self.speeds);
        if !self.cuts.is_empty() {
            L.solve_lower_triangular_unchecked_mut(&mut self.G);
            // (2.3.46): (Gᵀ M⁻¹ G) f_c = -(Ġᵀ u + Gᵀ M⁻¹ (-g)).
            self.multipliers.gemv_tr(-1.0, &self.G, &self.speeds, -1.0);
            self.G.tr_mul_to(&self.G, &mut self.GMG);
            let GMG = std::mem::replace(&mut self.GMG, DMatrix::zeros(0, 0));
            let GMG = Cholesky::new_unchecked(GMG);
            GMG.solve_mut(&mut self.multipliers);
            self.GMG = GMG.unpack_dirty();
            self.speeds.gemv(1.0, &self.G, &self.multipliers, 1.0);
        }
        L.ad_solve_lower_triangular_unchecked_mut(&mut self.speeds);
        self.M = M.unpack_dirty();
        self.write(out);
    }

    /// `M` (2.3.22), (2.3.32)-(2.3.36) and `-g` (2.3.26), (2.3.37), (2.3.38).
    ///
    /// Each entry is the partial velocity of one generalized speed times the momentum that another, at unit value, gives
    /// to its outer set. If the velocity of the system's centre of mass is a generalized speed, that point is at rest in
    /// the partial velocities of the others, so that the terms of the common motion of all bodies drop out.
    fn set_equations(&mut self, out: &TreeAcceleration) {
        let first = self.translation_rows();
        let (M, bodies) = (&mut self.M, &self.bodies);
        let base = &bodies[0];
        let force = &base.force_hat;
        M.fill(0.0);
        let (about, per_mass) = match self.speed {
            BaseSpeed::MainBody => {
                let s = &base.moment_hat;
                M.fixed_view_mut::<3, 3>(0, 0).fill_diagonal(base.mass_hat);
                M.fixed_view_mut::<3, 3>(3, 0).copy_from(&s.cross_matrix());
                self.speeds.fixed_rows_mut::<3>(0).copy_from(&force.force);
                (Vector3::zeros(), 0.0)
            }
            BaseSpeed::SystemCom => (base.moment_hat / base.mass_hat, 1.0 / base.mass_hat),
        };
        M.fixed_view_mut::<3, 3>(first, first)
            .copy_from(&base.inertia_hat_about(&about));
        let torque = force.torque - about.cross(&force.force);
        self.speeds.fixed_rows_mut::<3>(first).copy_from(&torque);
        for (i, (body, effort)) in bodies[1..].iter().zip(out.qdd.iter()).enumerate() {
            let row = first + 3 + i;
            let unit = &body.unit_momentum;
            let generalized = if body.is_prismatic() {
                body.z.dot(&body.force_hat.force)
            } else {
                body.z.dot(&body.force_hat.torque)
            };
            self.speeds[row] = generalized + effort - unit.force.dot(&force.force) * per_mass;
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
    fn write(&self, out: &mut TreeAcceleration) {
        let first = self.translation_rows();
        let base = &self.bodies[0];
        let angular: Vector3<f64> = self.speeds.fixed_rows::<3>(first).into_owned();
        out.qdd
            .as_mut_slice()
            .copy_from_slice(&self.speeds.as_slice()[first + 3..]);
        let linear = match self.speed {
            BaseSpeed::MainBody => self.speeds.fixed_rows::<3>(0).into_owned(),
            BaseSpeed::SystemCom => {
                // The first row of the equations, which the others do not contain.
                let mut force = base.force_hat.force - angular.cross(&base.moment_hat);
                for (body, qdd) in self.bodies[1..].iter().zip(out.qdd.iter()) {
                    force -= body.unit_momentum.force * *qdd;
                }
                force / base.mass_hat
            }
        };
        let R_BW = base.R_WB.inverse();
        out.A_WB_B = Twist::new(R_BW * angular, R_BW * linear);
    }
}
