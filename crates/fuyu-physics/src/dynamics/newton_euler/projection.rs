//! Projection of a state onto the constraints.

use std::cmp::Ordering;

use super::{BodyState, MatrixMethod, System};
use crate::spatial::exp_so3;

/// Limit of the iterations; convergence is quadratic.
const ITERATIONS: usize = 8;

impl MatrixMethod {
    /// Moves `state` to the nearest one (in the metric of masses and inertias) whose positions and rates satisfy the
    /// constraints, and normalizes quaternions. Returns the largest remaining gap \[m or rad\]. Called after every
    /// step, it removes the drift of the constraints. The system's centre of mass and momentum do not change. Not for
    /// systems with driven axes, which it would return to zero displacement.
    ///
    /// # Panics
    /// If `state` is of another system.
    pub fn project(&mut self, system: &System, state: &mut [f64]) -> f64 {
        let mut gap = f64::INFINITY;
        for _ in 0..ITERATIONS {
            self.set_motion(system, state);
            let before = std::mem::replace(
                &mut gap,
                self.set_right_hand_side(1.0, |motion, _, k| -motion.displacement[k]),
            );
            // Stop at rounding: the gap has not become smaller.
            if gap == 0.0 || gap.partial_cmp(&before) != Some(Ordering::Less) {
                break;
            }
            self.z.fill(0.0);
            self.constrain(system);
            for b in 0..system.bodies.len() {
                let change = self.bodies.motion(b, &self.z);
                let mut at = BodyState::read(state, b);
                let R_WB = at.R_WB();
                at.p_WC += R_WB * change.linear;
                at.Q_WB = (R_WB.into_inner()) * exp_so3(&change.angular).into_inner();
                at.write(state, b);
            }
        }
        self.set_motion(system, state);
        self.set_right_hand_side(0.0, |motion, _, k| -motion.rate[k]);
        self.z.fill(0.0);
        self.constrain(system);
        for b in 0..system.bodies.len() {
            let change = self.bodies.motion(b, &self.z);
            let mut at = BodyState::read(state, b);
            at.Q_WB = at.R_WB().into_inner();
            at.v_WC_B += change.linear;
            at.w_WB_B += change.angular;
            at.write(state, b);
        }
        gap
    }
}
