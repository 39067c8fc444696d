//! How well a body's momentum and energy are conserved in a run.

use nalgebra::Vector3;
use serde::Serialize;

use crate::dynamics::{Floating, Momentum};

/// Largest relative change of momentum.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct MomentumResidual {
    /// Linear.
    pub linear: f64,
    /// Angular, about the system's centre of mass.
    pub angular: f64,
}

/// Accumulates the changes of momentum and energy of a free-floating body, state by state.
pub struct Balance {
    initial_momentum: Momentum,
    initial_energy: f64,
    momentum_change: (f64, f64),
    momentum_scale: (f64, f64),
    energy_change: f64,
    energy_scale: f64,
}

impl Balance {
    /// Starts with the present state.
    pub fn new(body: &Floating) -> Self {
        Self {
            initial_momentum: carried(body).0,
            initial_energy: body.workspace().kinetic_energy(),
            momentum_change: (0.0, 0.0),
            momentum_scale: (0.0, 0.0),
            energy_change: 0.0,
            energy_scale: 0.0,
        }
    }

    /// Adds the present state.
    pub fn see(&mut self, body: &Floating) {
        let (momentum, scale) = carried(body);
        let change = |a: Vector3<f64>, b: Vector3<f64>, worst| larger(worst, (a - b).norm());
        let first = &self.initial_momentum;
        self.momentum_change.0 = change(momentum.linear, first.linear, self.momentum_change.0);
        self.momentum_change.1 = change(momentum.angular, first.angular, self.momentum_change.1);
        self.momentum_scale.0 = larger(self.momentum_scale.0, scale.0);
        self.momentum_scale.1 = larger(self.momentum_scale.1, scale.1);
        let energy = body.workspace().kinetic_energy();
        let unexplained = energy - self.initial_energy - body.state().work;
        self.energy_change = larger(self.energy_change, unexplained.abs());
        // The energy of the common drift is constant and excluded.
        let drift = 0.5 * momentum.linear.norm_squared() / body.model().total_mass();
        self.energy_scale = larger(self.energy_scale, energy - drift);
    }

    /// Largest change of the total momentum of the bodies, relative to the initial momentum or to
    /// [`Workspace::momentum_scale`](crate::dynamics::Workspace::momentum_scale), whichever is larger.
    pub fn momentum_residual(&self) -> MomentumResidual {
        let first = &self.initial_momentum;
        let (linear, angular) = self.momentum_scale;
        MomentumResidual {
            linear: relative(self.momentum_change.0, larger(linear, first.linear.norm())),
            angular: relative(
                self.momentum_change.1,
                larger(angular, first.angular.norm()),
            ),
        }
    }

    /// Largest change of kinetic energy minus work, relative to the largest kinetic energy in the frame of the system's
    /// centre of mass.
    pub fn energy_residual(&self) -> f64 {
        relative(self.energy_change, self.energy_scale)
    }
}

/// The larger of two; NaN if one is NaN.
pub(super) fn larger(a: f64, b: f64) -> f64 {
    if b > a || b.is_nan() { b } else { a }
}

fn relative(change: f64, scale: f64) -> f64 {
    if scale > 0.0 { change / scale } else { change }
}

/// Total momentum of the bodies in world axes, and the scale of its rounding error.
fn carried(body: &Floating) -> (Momentum, (f64, f64)) {
    let (momentum_B, scale) = body.workspace().carried_momentum_and_scale();
    let R_WB = body.state().R_WB;
    let momentum_W = Momentum {
        linear: R_WB * momentum_B.linear,
        angular: R_WB * momentum_B.angular,
    };
    (momentum_W, scale)
}
