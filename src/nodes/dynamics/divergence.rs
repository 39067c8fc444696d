//! Divergence of a motion: detection of speeds that are too large or not finite, and the state to restore then.

use super::free_body::{FreeBody, Restorable};
use crate::dynamics::Floating;

/// Largest speed of a joint or of a base \[rad/s or m/s\]. No mechanism reaches it, and its square, on which
/// accelerations and energies depend, is far from overflow. A diverging motion exceeds it within a few steps.
const MAX_SPEED: f64 = 1e6;

/// Largest distance of a body from the world's origin \[m\]: about the width of the solar system.
const MAX_DISTANCE: f64 = 1e13;

/// Describes the first quantity of a body's motion that is not finite or too large; `None` if there is none.
pub fn of(body: &(impl FreeBody + ?Sized)) -> Option<String> {
    let state = body.state();
    let joints = body.model().joints().iter();
    for (joint, rate) in joints.zip(&state.qd) {
        if is_beyond(*rate, MAX_SPEED) {
            let unit = match joint.kind.is_rotational() {
                true => "rad/s",
                false => "m/s",
            };
            return Some(format!("joint '{}' moves at {rate:.1e} {unit}", joint.name));
        }
    }
    let twist = body.V_WB_B();
    let (w, v) = (twist.angular.norm(), twist.linear.norm());
    if is_beyond(w, MAX_SPEED) {
        return Some(format!("its base turns at {w:.1e} rad/s"));
    }
    if is_beyond(v, MAX_SPEED) {
        return Some(format!("its base moves at {v:.1e} m/s"));
    }
    let distance = state.p_WC.norm();
    if is_beyond(distance, MAX_DISTANCE) {
        return Some(format!("it is {distance:.1e} m from the origin"));
    }
    (!body.is_finite()).then(|| "its state is not finite".to_owned())
}

/// Whether a value is NaN, or its magnitude larger than `limit`.
pub(super) fn is_beyond(value: f64, limit: f64) -> bool {
    let is_within = value.abs() <= limit;
    !is_within
}

/// Backup of a body's state before its last step, restored after a divergence.
pub struct StateBackup<B: Restorable = Floating> {
    saved: B::Saved,
    /// Whether the body was restored since the last command.
    is_restored: bool,
}

impl<B: Restorable> StateBackup<B> {
    /// A backup of the body's current state.
    pub fn new(body: &B) -> Self {
        Self {
            saved: body.saved(),
            is_restored: false,
        }
    }

    /// Saves the current state.
    pub fn save(&mut self, body: &B) {
        body.save_to(&mut self.saved);
    }

    /// The body was commanded: the next restore keeps its momentum.
    pub fn note_command(&mut self) {
        self.is_restored = false;
    }

    /// Restores the saved state with the joints at rest and the momentum unchanged. If there was no command since the
    /// last restore, the momentum itself is the problem: the body is stopped completely.
    pub fn restore(&mut self, body: &mut B, time: f64) {
        let keeps_momentum = !std::mem::replace(&mut self.is_restored, true);
        body.restore_stopped(&self.saved, time, keeps_momentum);
    }

    /// Restores the saved state with the body completely at rest. Its time becomes `time` \[s\].
    pub fn restore_at_rest(&self, body: &mut B, time: f64) {
        body.restore_stopped(&self.saved, time, false);
    }
}
