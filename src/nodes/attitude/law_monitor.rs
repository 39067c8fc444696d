//! Law monitor: changes of the attitude law while the node runs, and the stability of the active law in each posture.

use std::time::{Duration, Instant};

use super::{AttitudeLoop, params::NamedLaw};
use crate::ros::Status;

/// Largest spectral radius that counts as stable: rate feedback alone leaves the attitude free, with poles at 1.
const STABLE: f64 = 1.0 + 1e-9;

/// Time between two computations of the spectral radius.
const PAUSE: Duration = Duration::from_secs(1);

/// Applies changes of the parameter `law`, and reports on the active law.
#[derive(Debug, Default)]
pub(super) struct LawMonitor {
    /// The law selected last.
    selected: Option<NamedLaw>,
    /// Why it was refused, if it was.
    refusal: Option<String>,
    checked: Option<Instant>,
}

impl LawMonitor {
    /// Activates `law` if the selection has changed. If it is refused, the previous law stays active.
    pub(super) fn follow(&mut self, law: NamedLaw, attitude: &mut AttitudeLoop, status: &Status) {
        if self.selected.replace(law) == Some(law) {
            return;
        }
        self.checked = None;
        self.refusal = None;
        if attitude.params().law == law {
            return;
        }
        let before = attitude.params().law.name;
        match attitude.select_law(law) {
            Ok(()) => tracing::info!("law {} in place of {before}", law.name),
            Err(e) => {
                let line = format!("parameter law: {e}; {before} stays in force");
                tracing::warn!("{line}");
                status.warn(&line);
                self.refusal = Some(line);
            }
        }
    }

    /// Reports once a second whether the law is stable in the current posture.
    pub(super) fn check(&mut self, attitude: &AttitudeLoop, status: &Status) {
        if self.checked.is_some_and(|at| at.elapsed() < PAUSE) {
            return;
        }
        self.checked = Some(Instant::now());
        if let Some(line) = &self.refusal {
            status.warn(line);
            return;
        }
        let law = attitude.params().law.name;
        match attitude.radius() {
            Ok(None) => {}
            Ok(Some(radius)) if radius <= STABLE => status.ok(format!(
                "{law}, stable in this posture (spectral radius {radius:.4})"
            )),
            Ok(Some(radius)) => status.warn(format!(
                "{law} makes the robot vibrate in this posture (spectral radius {radius:.4}); select another law or lower gains"
            )),
            Err(e) => status.warn(format!("{law}: {e}")),
        }
    }
}
