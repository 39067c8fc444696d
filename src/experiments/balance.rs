//! Residuals of momentum and energy in a run.

use nalgebra::Vector3;
use serde::Serialize;

use crate::{
    dynamics::{Floating, Momentum},
    nodes::dynamics::{FreeBody, World},
};

/// Largest relative change of momentum in a run.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct MomentumResidual {
    /// Linear.
    pub linear: f64,
    /// Angular, about the system's centre of mass.
    pub angular: f64,
}

impl MomentumResidual {
    /// Value for a run in which it was not computed.
    pub(super) const UNKNOWN: Self = Self {
        linear: f64::NAN,
        angular: f64::NAN,
    };
}

/// Momentum and energy of a free-floating body at one time.
pub(super) struct Carried {
    /// Momentum minus external impulse.
    momentum_W: Momentum,
    /// Scale of the rounding errors of linear and angular momentum.
    scale: (f64, f64),
    /// Kinetic and strain energy \[J\].
    energy: f64,
    /// Work on the body minus dissipation by deformation and wheels \[J\].
    supplied: f64,
    /// Mass \[kg\].
    mass: f64,
    /// Centre of mass \[m\].
    p_WC: Vector3<f64>,
}

impl Carried {
    /// Momentum and energy of a target.
    pub fn of_target(body: &Floating) -> Self {
        Self::of(body, body.model().total_mass())
    }

    /// Momentum and energy of the robot and the targets that it can grasp or touch.
    pub fn of_robot(world: &World) -> Self {
        let mut carried = Self::of(&world.robot, world.robot.total_mass());
        for target in world.coupled_targets() {
            carried.add(&Self::of_target(&target.body));
        }
        if let Some(change) = world.external_change() {
            carried.momentum_W.linear -= change.momentum_W.linear;
            carried.momentum_W.angular -= change.momentum_W.angular;
        }
        carried
    }

    fn of(body: &impl FreeBody, mass: f64) -> Self {
        let (momentum_W, scale) = body.carried_momentum_and_scale();
        Self {
            momentum_W,
            scale,
            energy: body.kinetic_energy() + body.strain_energy(),
            supplied: body.state().work - body.lost_energy(),
            mass,
            p_WC: body.state().p_WC,
        }
    }

    /// Adds another body; angular momentum is then about the common centre of mass.
    fn add(&mut self, other: &Self) {
        let (p, mass) = (self.p_WC, self.mass + other.mass);
        self.p_WC = (p * self.mass + other.p_WC * other.mass) / mass;
        let about = |p_WC: &Vector3<f64>, momentum: &Momentum| {
            momentum.angular + (p_WC - self.p_WC).cross(&momentum.linear)
        };
        self.momentum_W.angular =
            about(&p, &self.momentum_W) + about(&other.p_WC, &other.momentum_W);
        self.momentum_W.linear += other.momentum_W.linear;
        let arm = (other.p_WC - p).norm();
        self.scale.0 += other.scale.0;
        self.scale.1 += other.scale.1 + arm * other.scale.0;
        self.energy += other.energy;
        self.supplied += other.supplied;
        self.mass = mass;
    }
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
    /// Starts a balance with the state `start`.
    pub(super) fn new(start: &Carried) -> Self {
        Self {
            initial_momentum: start.momentum_W,
            initial_energy: start.energy,
            momentum_change: (0.0, 0.0),
            momentum_scale: (0.0, 0.0),
            energy_change: 0.0,
            energy_scale: 0.0,
        }
    }

    /// Adds the state `now`.
    pub(super) fn see(&mut self, now: &Carried) {
        let momentum = &now.momentum_W;
        let change = |a: Vector3<f64>, b: Vector3<f64>, worst| larger(worst, (a - b).norm());
        let first = &self.initial_momentum;
        self.momentum_change.0 = change(momentum.linear, first.linear, self.momentum_change.0);
        self.momentum_change.1 = change(momentum.angular, first.angular, self.momentum_change.1);
        self.momentum_scale.0 = larger(self.momentum_scale.0, now.scale.0);
        self.momentum_scale.1 = larger(self.momentum_scale.1, now.scale.1);
        let unexplained = now.energy - self.initial_energy - now.supplied;
        self.energy_change = larger(self.energy_change, unexplained.abs());
        // The energy of the common drift is constant and excluded from the scale.
        let drift = 0.5 * momentum.linear.norm_squared() / now.mass;
        self.energy_scale = larger(self.energy_scale, now.energy - drift);
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

    /// Largest change of kinetic and strain energy minus the net work (after dissipation by deformation and wheels),
    /// relative to the largest energy in the frame of the system's centre of mass.
    pub fn energy_residual(&self) -> f64 {
        relative(self.energy_change, self.energy_scale)
    }
}

/// The larger value; NaN if one is NaN.
pub(super) fn larger(a: f64, b: f64) -> f64 {
    if b > a || b.is_nan() { b } else { a }
}

fn relative(change: f64, scale: f64) -> f64 {
    if scale > 0.0 { change / scale } else { change }
}
