//! What a tracker is told once.

/// What belongs to the target in images without a mask of their own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Target {
    /// All that the image shows.
    Everything,
    /// Connected bright regions: a body in front of the black sky, but no star.
    Bright {
        /// Grey value from which a pixel is bright.
        threshold: u8,
        /// Pixels of the smallest region that is no star.
        smallest: usize,
    },
}

/// Settings of a tracker.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Most points that are tracked at a time.
    pub points: usize,
    /// Distance of a new point from all others \[px\].
    pub spacing: f64,
    /// Least strength of a new corner, as a fraction of that of the strongest one on the target.
    pub quality: f64,
    /// Least strength of a new corner: the smaller eigenvalue of the mean structure tensor \[(grey values/px)²\]. Below it, noise
    /// moves the corner.
    pub strength: f64,
    /// Side of the window that is compared \[px\], odd.
    pub window: usize,
    /// Levels of the pyramid; the coarsest image is smaller by `2^(levels - 1)`.
    pub levels: usize,
    /// Largest distance between a point and where tracking backward returns to \[px\].
    pub backward: f64,
    /// Least normalized cross-correlation of a point's surroundings with those at its first sight.
    pub similarity: f64,
    /// Distance of points from the edge of the target \[px\]: what is closer may be a silhouette.
    pub margin: usize,
    /// What belongs to the target in images without a mask.
    pub target: Target,
    /// Frames over which the points must move as one rigid body, 6 at least; a point is reported in frames in which it is found to, which
    /// takes six points. 0 does not test it.
    pub rigid_frames: usize,
    /// Largest deviation of a point from the motion of the body, root mean square over these frames \[px\].
    pub rigid_error: f64,
    /// Frames for which a point has to be tracked before it is reported.
    pub confirmation: usize,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            points: 100,
            spacing: 7.0,
            quality: 0.01,
            strength: 4.0,
            window: 15,
            levels: 4,
            backward: 0.5,
            similarity: 0.95,
            margin: 3,
            target: Target::Bright {
                threshold: 8,
                smallest: 100,
            },
            rigid_frames: 15,
            rigid_error: 0.7,
            confirmation: 6,
        }
    }
}

/// A setting that is out of range.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{name} is {value}; it must be {right}")]
pub struct SettingsError {
    /// The setting.
    pub name: &'static str,
    /// Its value.
    pub value: f64,
    /// What it must be.
    pub right: &'static str,
}

impl Settings {
    /// Checks all settings.
    ///
    /// # Errors
    /// [`SettingsError`] for the first one that is out of range.
    pub fn check(&self) -> Result<(), SettingsError> {
        let error = |name, value, right| Err(SettingsError { name, value, right });
        let count = |name, value: usize, from: usize, to: usize, right| match value {
            n if (from..=to).contains(&n) => Ok(()),
            n => error(name, n as f64, right),
        };
        count("points", self.points, 1, 10_000, "1 to 10000")?;
        count("levels", self.levels, 1, 8, "1 to 8")?;
        count("margin", self.margin, 0, 64, "0 to 64 px")?;
        count("rigid_frames", self.rigid_frames, 0, 200, "0 or 6 to 200")?;
        if (1..6).contains(&self.rigid_frames) {
            return error("rigid_frames", self.rigid_frames as f64, "0 or 6 to 200");
        }
        count("confirmation", self.confirmation, 1, 200, "1 to 200")?;
        if !(5..=63).contains(&self.window) || self.window.is_multiple_of(2) {
            return error("window", self.window as f64, "odd and 5 to 63 px");
        }
        for (name, value, low, high, right) in [
            ("spacing", self.spacing, 1.0, 1000.0, "1 to 1000 px"),
            ("quality", self.quality, 0.0, 1.0, "0 to 1"),
            ("strength", self.strength, 0.0, 1e5, "0 to 100000"),
            ("backward", self.backward, 1e-3, 100.0, "0.001 to 100 px"),
            ("similarity", self.similarity, 0.0, 1.0, "0 to 1"),
            (
                "rigid_error",
                self.rigid_error,
                1e-3,
                100.0,
                "0.001 to 100 px",
            ),
        ] {
            // Also false if it is not a number.
            if !(value >= low && value <= high) {
                return error(name, value, right);
            }
        }
        if matches!(self.target, Target::Bright { threshold: 0, .. }) {
            return error("target.threshold", 0.0, "1 to 255");
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn impossible_settings_are_refused_by_name() {
        assert_eq!(Settings::default().check(), Ok(()));
        type Change = fn(&mut Settings);
        let wrong: [(&str, Change); 7] = [
            ("points", |s| s.points = 0),
            ("window", |s| s.window = 14),
            ("levels", |s| s.levels = 9),
            ("similarity", |s| s.similarity = 1.1),
            ("spacing", |s| s.spacing = f64::NAN),
            ("rigid_error", |s| s.rigid_error = f64::INFINITY),
            ("confirmation", |s| s.confirmation = 0),
        ];
        for (name, change) in wrong {
            let mut settings = Settings::default();
            change(&mut settings);
            let error = settings.check().unwrap_err();
            assert_eq!(error.name, name);
            assert!(error.to_string().starts_with(name));
        }
    }
}
