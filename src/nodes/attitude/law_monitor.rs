//! The present attitude law: its replacement while the node runs, and its stability in the postures that occur.

use std::time::{Duration, Instant};

use super::{AttitudeLoop, params::NamedLaw};
use crate::ros::Status;

/// Largest spectral radius of a stable loop: rate feedback alone leaves the attitude free, with poles at 1.
const STABLE: f64 = 1.0 + 1e-9;

/// Time between two computations of the stability.
const PAUSE: Duration = Duration::from_secs(1);

/// Applies changes of the parameter `law`, and reports about the law in force.
#[derive(Debug, Default)]
pub(super) struct LawMonitor {
    /// The law that was selected last.
    selected: Option<NamedLaw>,
    /// Why it was refused.
    refusal: Option<String>,
    checked: Option<Instant>,
}

impl LawMonitor {
    /// Makes `law` the law in force, unless it has been tried before. If it is refused, the one before stays.
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

    /// Reports whether the law is stable in the present posture, once a second.
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
