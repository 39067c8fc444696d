//! Motion of a body or camera while the shutter is open.

use nalgebra::Isometry3;

/// Poses in the world when the shutter opens and when it closes; in between, position and attitude change at constant
/// rates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    /// When the shutter opens.
    pub open: Isometry3<f64>,
    /// When it closes.
    pub close: Isometry3<f64>,
}

impl Motion {
    /// No motion during the exposure.
    pub fn at_rest(pose: Isometry3<f64>) -> Self {
        Self {
            open: pose,
            close: pose,
        }
    }

    /// The pose at a fraction of the exposure, in [0, 1].
    pub fn at(&self, fraction: f64) -> Isometry3<f64> {
        if self.open == self.close {
            return self.open;
        }
        let (a, b) = (&self.open, &self.close);
        // Half a turn in an exposure has no unique axis.
        a.try_lerp_slerp(b, fraction, 1e-12).unwrap_or(*a)
    }

    /// The same motion of a frame that is fixed in this one, at `offset`.
    #[must_use]
    pub fn of_part(&self, offset: &Isometry3<f64>) -> Self {
        Self {
            open: self.open * offset,
            close: self.close * offset,
        }
    }

    /// Whether all numbers are finite.
    pub(crate) fn is_finite(&self) -> bool {
        [&self.open, &self.close].iter().all(|X| {
            X.translation.vector.iter().all(|x| x.is_finite())
                && X.rotation.coords.iter().all(|x| x.is_finite())
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Translation3, UnitQuaternion, Vector3};

    #[test]
    fn poses_in_between_turn_at_a_constant_rate() {
        let turned = |angle: f64| {
            let rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle);
            Isometry3::from_parts(Translation3::new(angle, 0.0, 1.0), rotation)
        };
        let motion = Motion {
            open: turned(0.2),
            close: turned(0.6),
        };
        let quarter = motion.at(0.25);
        assert!((quarter.rotation.angle() - 0.3).abs() < 1e-12);
        assert!((quarter.translation.x - 0.3).abs() < 1e-12);
        assert_eq!(Motion::at_rest(turned(1.0)).at(0.7), turned(1.0));
    }
}
