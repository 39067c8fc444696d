//! Shaping of a joint path: bumps are added so that the base turns least and clearances are kept.

use nalgebra::{DMatrix, DVector, UnitQuaternion};

use super::clearance::Distances;
use super::plan::{Plan, PlanError, Reserve, point};
use super::rendezvous::{Rendezvous, RendezvousPlanner};
use super::shooting::{PIECES, Shot};

/// Weight of a violated clearance \[1/m\] relative to the base's angular velocity \[rad/s\].
const CLEARANCE_WEIGHT: f64 = 1.0;
const SHAPING_ITERATIONS: usize = 4;
/// Largest bump \[rad or m\].
const LARGEST_BUMP: f64 = 0.8;
/// Weight of a bump \[1/(rad s)\], so that a joint moves for the base's sake only where that helps.
const BUMP_WEIGHT: f64 = 1e-4;

impl RendezvousPlanner {
    /// Chooses the bumps, and checks the result.
    pub(super) fn shaped(&mut self, task: &Rendezvous, shot: Shot) -> Result<Plan, PlanError> {
        let n = self.model.dof();
        let mut bumps = DVector::zeros(n);
        let mut shot = shot;
        let mut residual = self.residual(task, &shot, &bumps);
        for _ in 0..SHAPING_ITERATIONS {
            const STEP: f64 = 1e-3;
            let mut slope = DMatrix::zeros(residual.len(), n);
            for j in 0..n {
                let mut moved = bumps.clone();
                moved[j] += STEP;
                let other = self.shoot(task, shot.end.clone(), &moved)?;
                let column = (self.residual(task, &other, &moved) - &residual) / STEP;
                slope.set_column(j, &column);
            }
            let normal = slope.tr_mul(&slope) + DMatrix::identity(n, n) * 1e-12;
            let Some(factor) = normal.cholesky() else {
                break;
            };
            let step = -factor.solve(&slope.tr_mul(&residual));
            let mut gained = false;
            for share in [1.0, 0.5, 0.2] {
                let moved =
                    (&bumps + &step * share).map(|b: f64| b.clamp(-LARGEST_BUMP, LARGEST_BUMP));
                let Ok(other) = self.shoot(task, shot.end.clone(), &moved) else {
                    continue;
                };
                let after = self.residual(task, &other, &moved);
                if after.norm_squared() < 0.999 * residual.norm_squared() {
                    (bumps, shot, residual, gained) = (moved, other, after, true);
                    break;
                }
            }
            if !gained {
                break;
            }
        }
        self.checked(task, shot, bumps, Reserve::FIRST)
    }

    /// Residuals that the bumps minimise: angular velocity of the base, violated clearances, and size of the bumps.
    fn residual(&mut self, task: &Rendezvous, shot: &Shot, bumps: &DVector<f64>) -> DVector<f64> {
        let mut rows = Vec::with_capacity(5 * PIECES + bumps.len());
        let scale = 1.0 / (PIECES as f64).sqrt();
        let mut R_IB = task.start.state.R_WB;
        for piece in 0..PIECES {
            let (after, rate) = self.turned(task, (&shot.polynomials, bumps), &R_IB, piece);
            rows.extend((rate * scale).iter());
            R_IB = after;
            let distances = self.distances(task, shot, bumps, &R_IB, piece + 1);
            let margin = self.clearance.config().margin;
            // With a reserve, so that the minimum itself keeps the margin.
            let own = (margin + 0.05 - distances.own).max(0.0);
            let of_target = (0.05 - distances.keep_out).max(0.0);
            rows.push(CLEARANCE_WEIGHT * scale * own);
            rows.push(CLEARANCE_WEIGHT * scale * of_target);
        }
        rows.extend(bumps.iter().map(|b| BUMP_WEIGHT * b));
        DVector::from_vec(rows)
    }

    /// Distances at the end of a piece of the path.
    pub(super) fn distances(
        &mut self,
        task: &Rendezvous,
        shot: &Shot,
        bumps: &DVector<f64>,
        R_IB: &UnitQuaternion<f64>,
        piece: usize,
    ) -> Distances {
        let s = piece as f64 / PIECES as f64;
        let T = task.duration();
        let at = |j: usize| point(&shot.polynomials[j], bumps[j], s, T).position;
        let q = DVector::from_fn(bumps.len(), |j, _| at(j));
        self.workspace.set_positions(&q);
        let center = task.center.map(|(from, to)| from.lerp(&to, s));
        let X_IB = self.X_IB(R_IB);
        (self.clearance).distances(&self.workspace, &X_IB, center.as_ref())
    }
}
