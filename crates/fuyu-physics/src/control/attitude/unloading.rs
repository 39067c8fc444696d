//! Unloading: start, end and rate of the desaturation of the wheels by thrusters.

use nalgebra::Vector3;

use super::AttitudeConfigError;
use super::error::{require, require_positive};

/// Desaturation of the wheels by thrusters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UnloadingConfig {
    /// Unloading starts when a wheel reaches this fraction of its momentum limit, up to 1.
    pub start: f64,
    /// Unloading ends when all wheels are below this fraction, which is less than `start`.
    pub stop: f64,
    /// Time constant with which the momentum decays \[s\].
    pub time: f64,
}

impl Default for UnloadingConfig {
    fn default() -> Self {
        Self {
            start: 0.7,
            stop: 0.1,
            time: 20.0,
        }
    }
}

impl UnloadingConfig {
    /// Refuses values out of their range.
    ///
    /// # Errors
    /// [`AttitudeConfigError::Value`] names the value.
    pub fn check(&self) -> Result<(), AttitudeConfigError> {
        let Self { start, stop, time } = *self;
        let in_range = start > 0.0 && start <= 1.0;
        require("unloading.start", start, in_range, "above 0 and at most 1")?;
        let below = stop > 0.0 && stop < start;
        require(
            "unloading.stop",
            stop,
            below,
            "above 0 and below unloading.start",
        )?;
        require_positive("unloading.time [s]", time)
    }
}

/// Whether the wheels are being unloaded, with hysteresis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Unloading {
    config: UnloadingConfig,
    is_active: bool,
}

impl Unloading {
    /// Inactive unloading.
    ///
    /// # Errors
    /// As [`UnloadingConfig::check`].
    pub fn new(config: UnloadingConfig) -> Result<Self, AttitudeConfigError> {
        config.check()?;
        Ok(Self {
            config,
            is_active: false,
        })
    }

    /// Whether the wheels are being unloaded.
    pub fn is_active(&self) -> bool {
        self.is_active
    }

    /// Ends the unloading.
    pub fn reset(&mut self) {
        self.is_active = false;
    }

    /// Requested external torque, base axes \[N m\], if the wheels are to be unloaded. `load` is the largest momentum
    /// of a wheel as a fraction of its limit, `momentum` that of all wheels, base axes \[N m s\].
    pub fn torque(&mut self, load: f64, momentum: &Vector3<f64>) -> Option<Vector3<f64>> {
        if load >= self.config.start {
            self.is_active = true;
        } else if load < self.config.stop {
            self.is_active = false;
        }
        self.is_active.then(|| -momentum / self.config.time)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unloading_has_hysteresis() {
        let mut unloading = Unloading::new(UnloadingConfig::default()).unwrap();
        let h = Vector3::new(10.0, -4.0, 0.0);
        let loads = [0.2, 0.69, 0.7, 0.5, 0.11, 0.09, 0.5, 0.71];
        let active = [false, false, true, true, true, false, false, true];
        for (load, expected) in loads.into_iter().zip(active) {
            let torque = unloading.torque(load, &h);
            assert_eq!(torque.is_some(), expected, "{load}");
            assert!(torque.is_none_or(|torque| torque == -h / 20.0));
        }
        let wrong = UnloadingConfig {
            stop: 0.8,
            ..UnloadingConfig::default()
        };
        let text = Unloading::new(wrong).unwrap_err().to_string();
        assert_eq!(
            text,
            "unloading.stop is 0.8; it must be above 0 and below unloading.start"
        );
    }
}
