//! Steps of a contact world: location of events within a step, and forces evaluated within a step.

use super::driven::{Drive, Driven};
use super::radau::Radau;
use super::world::ContactWorld;

/// Limit of the iterations that locate an event.
const LOCATING: usize = 60;
/// Depth \[m\] up to which an event counts as located.
const LOCATED: f64 = 1e-15;

impl ContactWorld {
    /// Violation of the modes at a stage of the last step.
    fn violation_after(&mut self, stage: usize) -> f64 {
        for ((trial, y), change) in self
            .trial
            .iter_mut()
            .zip(&self.y)
            .zip(self.radau.stage(stage))
        {
            *trial = y + change;
        }
        self.scene.look(&self.trial);
        self.scene.violation()
    }

    /// Time of the first stage of a step of `h` at which a mode is violated.
    pub(super) fn find_violation(&mut self, h: f64) -> Option<f64> {
        if self.scene.points.is_empty() {
            return None;
        }
        let times = Radau::times();
        (0..3)
            .find(|&stage| self.violation_after(stage) > 0.0)
            .map(|stage| h * times[stage])
    }

    /// Locates the first event before `after` and repeats the step so that it ends there. Returns its length.
    pub(super) fn locate(
        &mut self,
        elapsed: f64,
        mut after: f64,
        iteration: f64,
        drive: &mut Drive,
    ) -> f64 {
        let (mut before, mut violation_before) = (0.0, None);
        let mut found_after = self.try_step(elapsed, after, iteration, drive);
        // Value for the secant: halved where one side stays (Illinois method).
        let mut violation_after = found_after;
        let mut last_side = 0;
        for _ in 0..LOCATING {
            if found_after > 0.0 && found_after <= LOCATED || after - before <= 1e-14 * after {
                break;
            }
            let guess = match violation_before {
                Some(at_before) if at_before < 0.0 => {
                    before - at_before * (after - before) / (violation_after - at_before)
                }
                _ => f64::NAN,
            };
            // A little beyond the root, so that the other side of the bracket also moves.
            let guess = guess + 1e-3 * (after - before).min(guess - before);
            let time = if guess > before && guess < after {
                guess
            } else {
                0.5 * (before + after)
            };
            let violation = self.try_step(elapsed, time, iteration, drive);
            if violation > 0.0 {
                (after, found_after, violation_after) = (time, violation, violation);
                if last_side == 1 {
                    violation_before = violation_before.map(|v| 0.5 * v);
                }
                last_side = 1;
            } else {
                (before, violation_before) = (time, Some(violation));
                if last_side == -1 {
                    violation_after *= 0.5;
                }
                last_side = -1;
            }
        }
        let _ = self.try_step(elapsed, after, iteration, drive);
        after
    }

    /// Tries a step of `h` without error control. Returns the violation of the modes at its end.
    fn try_step(&mut self, elapsed: f64, h: f64, iteration: f64, drive: &mut Drive) -> f64 {
        if self.try_radau(elapsed, h, iteration, drive).is_none() {
            self.set_jacobian(elapsed, drive);
            let _ = self.try_radau(elapsed, h, iteration, drive);
        }
        self.violation_after(2)
    }

    /// Computes the rates for steps that start `elapsed` \[s\] after the start of the call.
    pub(super) fn begin_radau(&mut self, elapsed: f64, drive: &mut Drive) {
        let scene = &mut self.scene;
        let mut equations = Driven {
            scene,
            drive,
            elapsed,
        };
        self.radau.begin(&self.y, &mut equations);
    }

    /// Tries a step of `h`, as [`Radau::step`].
    pub(super) fn try_radau(
        &mut self,
        elapsed: f64,
        h: f64,
        iteration: f64,
        drive: &mut Drive,
    ) -> Option<f64> {
        let scene = &mut self.scene;
        let mut equations = Driven {
            scene,
            drive,
            elapsed,
        };
        self.radau.step(&self.y, h, iteration, &mut equations)
    }

    pub(super) fn set_jacobian(&mut self, elapsed: f64, drive: &mut Drive) {
        let scene = &mut self.scene;
        let mut equations = Driven {
            scene,
            drive,
            elapsed,
        };
        self.radau.set_jacobian(&self.y, &mut equations);
        self.work.jacobians += 1;
    }
}
