//! What a tracker is told once.

/// Ranges of the settings, in their units.
pub mod ranges {
    use std::ops::RangeInclusive;

    /// Of [`points`](super::Settings::points).
    pub const POINTS: RangeInclusive<usize> = 1..=10_000;
    /// Of [`spacing`](super::Settings::spacing).
    pub const SPACING: RangeInclusive<f64> = 1.0..=1000.0;
    /// Of [`quality`](super::Settings::quality).
    pub const QUALITY: RangeInclusive<f64> = 0.0..=1.0;
    /// Of [`strength`](super::Settings::strength).
    pub const STRENGTH: RangeInclusive<f64> = 0.0..=1e5;
    /// Of [`window`](super::Settings::window), which is odd.
    pub const WINDOW: RangeInclusive<usize> = 5..=63;
    /// Of [`levels`](super::Settings::levels).
    pub const LEVELS: RangeInclusive<usize> = 1..=8;
    /// Of [`backward`](super::Settings::backward).
    pub const BACKWARD: RangeInclusive<f64> = 1e-3..=100.0;
    /// Of [`similarity`](super::Settings::similarity).
    pub const SIMILARITY: RangeInclusive<f64> = 0.0..=1.0;
    /// Of [`margin`](super::Settings::margin).
    pub const MARGIN: RangeInclusive<usize> = 0..=64;
    /// Of [`rigid_frames`](super::Settings::rigid_frames), unless it is 0.
    pub const RIGID_FRAMES: RangeInclusive<usize> = 6..=200;
    /// Of [`rigid_error`](super::Settings::rigid_error).
    pub const RIGID_ERROR: RangeInclusive<f64> = 1e-3..=100.0;
    /// Of [`confirmation`](super::Settings::confirmation).
    pub const CONFIRMATION: RangeInclusive<usize> = 1..=200;
}

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
    pub right: String,
}

impl Settings {
    /// Checks all settings.
    ///
    /// # Errors
    /// [`SettingsError`] for the first one that is out of range.
    pub fn check(&self) -> Result<(), SettingsError> {
        for (name, value, range, beginning) in [
            ("points", self.points, ranges::POINTS, ""),
            ("window", self.window, ranges::WINDOW, "odd and "),
            ("levels", self.levels, ranges::LEVELS, ""),
            ("margin", self.margin, ranges::MARGIN, ""),
            (
                "rigid_frames",
                self.rigid_frames,
                ranges::RIGID_FRAMES,
                "0 or ",
            ),
            ("confirmation", self.confirmation, ranges::CONFIRMATION, ""),
        ] {
            let is_right = match name {
                "window" => range.contains(&value) && !value.is_multiple_of(2),
                "rigid_frames" => value == 0 || range.contains(&value),
                _ => range.contains(&value),
            };
            if !is_right {
                let right = format!("{beginning}{} to {}", range.start(), range.end());
                return Err(SettingsError {
                    name,
                    value: value as f64,
                    right,
                });
            }
        }
        for (name, value, range) in [
            ("spacing", self.spacing, ranges::SPACING),
            ("quality", self.quality, ranges::QUALITY),
            ("strength", self.strength, ranges::STRENGTH),
            ("backward", self.backward, ranges::BACKWARD),
            ("similarity", self.similarity, ranges::SIMILARITY),
            ("rigid_error", self.rigid_error, ranges::RIGID_ERROR),
        ] {
            // A range contains no NaN.
            if !range.contains(&value) {
                let right = format!("{} to {}", range.start(), range.end());
                return Err(SettingsError { name, value, right });
            }
        }
        if matches!(self.target, Target::Bright { threshold: 0, .. }) {
            return Err(SettingsError {
                name: "target.threshold",
                value: 0.0,
                right: "1 to 255".to_owned(),
            });
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
