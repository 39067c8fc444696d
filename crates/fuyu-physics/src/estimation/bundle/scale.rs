//! The scale of lengths, which the images of one camera do not determine, from one known length or from measured ranges.

use std::str::FromStr;

use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};

use super::{BodyPoint, BodyPose, CentreMotion, Solution};

/// A length that is known \[m\].
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum KnownLength {
    /// Distance between two feature points.
    Distance([u64; 2], f64),
    /// Distance from the camera to a feature point in the last frame, from a range finder.
    Range(u64, f64),
}

/// Distance from the camera to a feature point, measured in one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeasuredRange {
    /// The feature point.
    pub id: u64,
    /// Time of the frame \[s\].
    pub time: f64,
    /// The distance \[m\].
    pub metres: f64,
}

/// Least number of measured ranges that give the scale: the median of three is right if one of them is wrong.
const LEAST_RANGES: usize = 3;

/// Ranges that deviate from the median by more standard deviations are wrong: those of the background, for example.
const WRONG_RANGE: f64 = 3.0;

/// Why a length does not give the scale.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum ScaleError {
    /// There is no such point.
    #[error("point {0} is not among the points that were reconstructed")]
    NoPoint(u64),
    /// The points coincide.
    #[error("points {0} and {1} coincide")]
    Coincident(u64, u64),
    /// There is no pose in the last frame.
    #[error("the position of the body in the last frame is not known")]
    NoPose,
}

/// Metres per unit of length of a solution.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scale {
    /// The value \[m\].
    pub metres: f64,
    /// Its standard deviation \[m\].
    pub deviation: f64,
}

impl KnownLength {
    /// A distance from `ID,ID,M`.
    ///
    /// # Errors
    /// A one-line message that states the expected format.
    pub fn distance(text: &str) -> Result<Self, String> {
        let wrong = || {
            format!("'{text}' is not ID,ID,M: two different point ids and a positive distance [m]")
        };
        let parts: Vec<&str> = text.split(',').map(str::trim).collect();
        match parts.as_slice() {
            [a, b, length] => match (a.parse(), b.parse(), positive(length)) {
                (Ok(a), Ok(b), Some(length)) if a != b => Ok(Self::Distance([a, b], length)),
                _ => Err(wrong()),
            },
            _ => Err(wrong()),
        }
    }

    /// A range from `ID,M`.
    ///
    /// # Errors
    /// A one-line message that states the expected format.
    pub fn range(text: &str) -> Result<Self, String> {
        let wrong = || format!("'{text}' is not ID,M: a point id and a positive range [m]");
        let (id, length) = text.split_once(',').ok_or_else(wrong)?;
        match (id.trim().parse(), positive(length.trim())) {
            (Ok(id), Some(length)) => Ok(Self::Range(id, length)),
            _ => Err(wrong()),
        }
    }
}

fn positive(text: &str) -> Option<f64> {
    let value = f64::from_str(text).ok()?;
    (value.is_finite() && value > 0.0).then_some(value)
}

impl Solution {
    /// Metres per unit of length of the solution, from the length `known`. The deviation follows from the covariances
    /// of the points, which need [`super::Options::with_points`].
    ///
    /// # Errors
    /// [`ScaleError`] if a point is not known.
    pub fn scale(&self, known: &KnownLength) -> Result<Scale, ScaleError> {
        let find = |id: u64| -> Result<&BodyPoint, ScaleError> {
            let point = self.points.iter().find(|p| p.id == id);
            point.ok_or(ScaleError::NoPoint(id))
        };
        // The length in units of the solution as a vector, with its covariance.
        let (apart, spread, metres) = match *known {
            KnownLength::Distance([a, b], metres) => {
                let points = [find(a)?, find(b)?];
                let apart = points[0].p_B - points[1].p_B;
                if apart.norm() < 1e-9 {
                    return Err(ScaleError::Coincident(a, b));
                }
                let spread: Matrix3<f64> = points.iter().filter_map(|p| p.covariance).sum();
                (apart, spread, metres)
            }
            KnownLength::Range(id, metres) => {
                let point = find(id)?;
                let pose = self.poses.last().ok_or(ScaleError::NoPose)?;
                let (position, spread) = self.in_camera(point, pose);
                (position, spread, metres)
            }
        };
        let length = apart.norm();
        let scale = metres / length;
        Ok(Scale {
            metres: scale,
            deviation: scale * deviation_along(&apart, &spread) / length,
        })
    }

    /// Metres per unit of length of the solution, from measured ranges: the mean of those that agree. `None` if fewer
    /// than three ranges belong to known points in known poses. The deviation combines the scatter of the ranges and
    /// the covariances of the points, which need [`super::Options::with_points`].
    pub fn scale_of_ranges(&self, ranges: &[MeasuredRange]) -> Option<Scale> {
        // Metres per unit of length, and the relative deviation due to the point.
        let ratio = |range: &MeasuredRange| {
            let after = self.poses.partition_point(|p| p.time < range.time);
            let pose = self.poses.get(after).filter(|p| p.time == range.time)?;
            let point = self.points.iter().find(|p| p.id == range.id)?;
            let (position, spread) = self.in_camera(point, pose);
            let length = position.norm();
            let of_point = deviation_along(&position, &spread) / length;
            (length > 1e-9).then(|| (range.metres / length, of_point))
        };
        let mut ratios: Vec<(f64, f64)> = ranges.iter().filter_map(ratio).collect();
        if ratios.len() < LEAST_RANGES {
            return None;
        }
        ratios.sort_by(|a, b| a.0.total_cmp(&b.0));
        let middle = ratios[ratios.len() / 2].0;
        let mut off: Vec<f64> = ratios.iter().map(|(r, _)| (r - middle).abs()).collect();
        off.sort_by(f64::total_cmp);
        // The median distance from the middle is 0.6745 deviations of a normal variable.
        let limit = WRONG_RANGE * off[off.len() / 2] / 0.6745;
        ratios.retain(|(ratio, _)| (ratio - middle).abs() <= limit);
        let count = ratios.len() as f64;
        let metres = ratios.iter().map(|(r, _)| r).sum::<f64>() / count;
        let squares: f64 = ratios.iter().map(|(r, _)| (r - metres).powi(2)).sum();
        let scatter = (squares / (count - 1.0).max(1.0) / count).sqrt();
        let of_points = ratios[ratios.len() / 2].1;
        Some(Scale {
            metres,
            deviation: scatter.hypot(metres * of_points),
        })
    }

    /// Position of a point in the camera's axes of a frame, and its covariance.
    fn in_camera(&self, point: &BodyPoint, pose: &BodyPose) -> (Vector3<f64>, Matrix3<f64>) {
        let R = pose.R_CB.to_rotation_matrix();
        let of_point = R * point.covariance.unwrap_or_default() * R.inverse();
        let of_centre = self
            .centre
            .as_ref()
            .map(|c| c.covariance.fixed_view::<3, 3>(0, 0).into_owned());
        (
            pose.R_CB * point.p_B + pose.t_C,
            of_point + of_centre.unwrap_or_default(),
        )
    }
}

/// Standard deviation of the length of a vector.
fn deviation_along(vector: &Vector3<f64>, covariance: &Matrix3<f64>) -> f64 {
    vector.dot(&(covariance * vector)).max(0.0).sqrt() / vector.norm()
}

impl CentreMotion {
    /// The motion in metres instead of units of the solution.
    pub fn in_metres(&self, scale: &Scale) -> Self {
        let mut both = Vector6::zeros();
        both.fixed_rows_mut::<3>(0).copy_from(&self.position);
        both.fixed_rows_mut::<3>(3).copy_from(&self.velocity);
        let along = both * scale.deviation;
        Self {
            position: self.position * scale.metres,
            velocity: self.velocity * scale.metres,
            covariance: self.covariance * scale.metres.powi(2) + along * along.transpose(),
        }
    }

    /// The motion after a further `later` \[s\] on a straight line.
    pub fn after(&self, later: f64) -> Self {
        let mut transition = Matrix6::identity();
        for k in 0..3 {
            transition[(k, 3 + k)] = later;
        }
        Self {
            position: self.position + self.velocity * later,
            velocity: self.velocity,
            covariance: transition * self.covariance * transition.transpose(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_are_read_and_refused() {
        assert_eq!(
            KnownLength::distance("3, 5,0.5"),
            Ok(KnownLength::Distance([3, 5], 0.5))
        );
        assert_eq!(KnownLength::range("7,2.5"), Ok(KnownLength::Range(7, 2.5)));
        for wrong in ["3,3,1", "3,5", "3,5,-1", "a,b,1", "3,5,inf"] {
            assert!(
                KnownLength::distance(wrong)
                    .unwrap_err()
                    .contains("ID,ID,M")
            );
        }
        assert!(KnownLength::range("7,0").is_err());
    }
}
