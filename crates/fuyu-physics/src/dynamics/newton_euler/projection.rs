//! Bringing a state back to the constraints.

use std::cmp::Ordering;

use super::{BodyState, MatrixMethod, System};
use crate::spatial::exp_so3;

/// Passes after which positions are as near as they get; each squares the error.
const PASSES: usize = 8;

impl MatrixMethod {
    /// Moves `state` to the nearest one, as masses and inertias measure distance, in which positions and rates
    /// satisfy the constraints, and brings quaternions to unit length; returns the largest gap that is left
    /// \[m or rad\]. Integration lets constraints drift; called after every step, this stops it. The system's
    /// centre of mass stays, and the corrections of the rates carry no momentum. Driven axes are brought to zero
    /// displacement too, so a system that is driven is not for this.
    ///
    /// # Panics
    /// If `state` is of another system.
    pub fn project(&mut self, system: &System, state: &mut [f64]) -> f64 {
        let mut gap = f64::INFINITY;
        for _ in 0..PASSES {
            self.set_motion(system, state);
            let before = std::mem::replace(
                &mut gap,
                self.set_right(|motion, _, k| -motion.displacement[k]),
            );
            // Rounding is reached: no nearer than the pass before.
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
        self.set_right(|motion, _, k| -motion.rate[k]);
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
