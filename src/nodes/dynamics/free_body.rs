//! Common interface of rigid robots, robots with flexible parts, and targets: base pose and twist, momentum, energy.

use nalgebra::Isometry3;

use super::divergence;
use crate::{
    dynamics::{Floating, Momentum, State, Workspace},
    model::Model,
    spatial::{Pose, Twist},
};

/// A body that floats freely.
pub trait FreeBody {
    /// Its tree of rigid bodies.
    fn model(&self) -> &Model;

    /// Its joints, attitude, centre of mass and momentum.
    fn state(&self) -> &State;

    /// Whether all numbers of its state are finite.
    fn is_finite(&self) -> bool;

    /// Pose of its base frame in the world.
    fn X_WB(&self) -> Pose;

    /// Twist of its base frame in the world, base axes.
    fn V_WB_B(&self) -> Twist;

    /// Acceleration of its base frame in the world under the current input, in base axes; the linear part is the
    /// acceleration of the frame's origin as a point.
    fn A_WB_B(&mut self) -> Twist;

    /// Momentum summed over all moving parts, in world axes.
    fn carried_momentum(&self) -> Momentum;

    /// As [`Self::carried_momentum`], with the scale of its rounding error (linear, angular).
    fn carried_momentum_and_scale(&self) -> (Momentum, (f64, f64));

    /// Kinetic energy \[J\].
    fn kinetic_energy(&self) -> f64;

    /// Strain energy of deformable bodies and elastic joints \[J\].
    fn strain_energy(&self) -> f64 {
        0.0
    }

    /// Energy dissipated by deformation, elastic joints and wheel bearings since the start \[J\]. Dissipation in the
    /// joints is part of the state.
    fn lost_energy(&self) -> f64 {
        0.0
    }

    /// Gives the base a new pose and twist (base axes). Everything keeps its position and rates relative to the base.
    ///
    /// # Errors
    /// The quantity that would be too large; the body is left unchanged.
    fn move_base(&mut self, X_WB: &Isometry3<f64>, V_WB_B: &Twist) -> Result<(), String>;
}

/// A body whose complete state can be saved and restored.
pub trait Restorable: FreeBody {
    /// Complete state of the body.
    type Saved: Clone;

    /// The current state.
    fn saved(&self) -> Self::Saved;

    /// Writes the current state to `saved` without allocating.
    fn save_to(&self, saved: &mut Self::Saved);

    /// Replaces the state.
    fn restore(&mut self, saved: &Self::Saved);

    /// Restores `saved` at `time` \[s\] with all internal motion stopped. The body keeps the saved momentum, or is
    /// stopped completely.
    fn restore_stopped(&mut self, saved: &Self::Saved, time: f64, keeps_momentum: bool);
}

/// Moves a body by `set`, as for [`FreeBody::move_base`]; undone with an error if the motion would diverge.
pub(super) fn try_to_move<B: Restorable>(
    body: &mut B,
    set: impl FnOnce(&mut B),
) -> Result<(), String> {
    let before = body.saved();
    set(body);
    match divergence::of(body) {
        Some(what) => {
            body.restore(&before);
            Err(what)
        }
        None => Ok(()),
    }
}

/// Converts a momentum in base axes to world axes.
pub(super) fn in_world(state: &State, momentum_B: &Momentum) -> Momentum {
    Momentum {
        linear: state.R_WB * momentum_B.linear,
        angular: state.R_WB * momentum_B.angular,
    }
}

impl FreeBody for Floating {
    fn model(&self) -> &Model {
        self.model()
    }

    fn state(&self) -> &State {
        self.state()
    }

    fn is_finite(&self) -> bool {
        self.state().is_finite()
    }

    fn X_WB(&self) -> Pose {
        self.state().X_WB(self.workspace())
    }

    fn V_WB_B(&self) -> Twist {
        *self.workspace().V_WB_B()
    }

    fn A_WB_B(&mut self) -> Twist {
        self.accelerations();
        self.workspace().A_WF_B(&self.model().frames()[0])
    }

    fn carried_momentum(&self) -> Momentum {
        in_world(self.state(), &self.workspace().carried_momentum())
    }

    fn carried_momentum_and_scale(&self) -> (Momentum, (f64, f64)) {
        let (momentum_B, scale) = self.workspace().carried_momentum_and_scale();
        (in_world(self.state(), &momentum_B), scale)
    }

    fn kinetic_energy(&self) -> f64 {
        self.workspace().kinetic_energy()
    }

    fn move_base(&mut self, X_WB: &Isometry3<f64>, V_WB_B: &Twist) -> Result<(), String> {
        try_to_move(self, |body| {
            let mut state = body.state().clone();
            state.set_base(&mut Workspace::new(body.model()), X_WB, V_WB_B);
            body.set_state(state);
        })
    }
}

impl Restorable for Floating {
    type Saved = State;

    fn saved(&self) -> State {
        self.state().clone()
    }

    fn save_to(&self, saved: &mut State) {
        saved.copy_from(self.state());
    }

    fn restore(&mut self, saved: &State) {
        self.set_state(saved.clone());
    }

    fn restore_stopped(&mut self, saved: &State, time: f64, keeps_momentum: bool) {
        let mut state = saved.clone();
        state.time = time;
        state.qd.fill(0.0);
        if !keeps_momentum {
            state.momentum_W = Momentum::default();
        }
        self.set_state(state);
    }
}
