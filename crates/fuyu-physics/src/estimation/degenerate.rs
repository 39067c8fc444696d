//! Degenerate tracks, from which no method can estimate a motion: collinear points, and a constant view.

use std::collections::HashMap;

use nalgebra::{Matrix2, Vector2};

use super::{EstimateError, Tracks};

/// Points are collinear if their scatter across a line is less than this share of that along it.
const COLLINEAR_RATIO: f64 = 4e-3;

/// Points are collinear if their scatter across a line is less than this many standard deviations of a pixel.
const COLLINEAR_NOISE: f64 = 3.0;

/// Least fraction of the frames that must be collinear, so that a few wrong points or frames do not decide.
const MIN_SHARE: f64 = 0.9;

/// Points that move by less than this many standard deviations of a pixel are at rest.
const AT_REST: f64 = 8.0;

/// Points that move by less than this many standard deviations of a pixel may be at rest with larger noise.
const MAYBE_NOISE: f64 = 30.0;

/// Ratio of the mean squared difference of successive values to their variance above which a path is noise: 2 for white
/// noise, much less for motion.
const NOISE_RATIO: f64 = 1.5;

/// Refuses degenerate tracks; `noise` is the standard deviation of an image coordinate \[px\].
///
/// # Errors
/// [`EstimateError::Collinear`] or [`EstimateError::Constant`].
pub fn check(tracks: &Tracks, noise: f64) -> Result<(), EstimateError> {
    let shown = tracks.frames().iter();
    let shown: Vec<_> = shown.filter(|s| !s.features.is_empty()).collect();
    if shown.len() < 2 {
        // Too few to decide; the methods check the number of frames.
        return Ok(());
    }
    let on_a_line = |points: Vec<Vector2<f64>>| lies_on_a_line(&points, noise);
    let lines = shown.iter().filter(|s| {
        let points = s.features.iter().map(|f| Vector2::new(f.u, f.v));
        on_a_line(points.collect())
    });
    if lines.count() as f64 >= MIN_SHARE * shown.len() as f64 {
        return Err(EstimateError::Collinear);
    }
    let mut paths = HashMap::<u64, Path>::new();
    for f in shown.iter().flat_map(|s| &s.features) {
        let point = Vector2::new(f.u, f.v);
        paths
            .entry(f.id)
            .or_insert_with(|| Path::from(point))
            .extend(point);
    }
    let largest = paths.values().map(|path| path.largest);
    let typical = upper_quartile(largest.collect()).unwrap_or(0.0);
    let noise_ratios = paths.values().filter_map(Path::noise_ratio);
    let is_noise = || upper_quartile(noise_ratios.collect()).is_some_and(|r| r > NOISE_RATIO);
    if typical < AT_REST * noise || (typical < MAYBE_NOISE * noise && is_noise()) {
        return Err(EstimateError::Constant { largest: typical });
    }
    Ok(())
}

/// The value that three quarters of `values` do not exceed.
fn upper_quartile(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() * 3 / 4).copied()
}

/// Whether the points are collinear; two points are.
fn lies_on_a_line(points: &[Vector2<f64>], noise: f64) -> bool {
    let count = points.len() as f64;
    let mean = points.iter().sum::<Vector2<f64>>() / count;
    let scatter = points.iter().map(|p| (p - mean) * (p - mean).transpose());
    let eigenvalues = (scatter.sum::<Matrix2<f64>>() / count).symmetric_eigenvalues();
    let across = eigenvalues.min().max(0.0).sqrt();
    across <= (COLLINEAR_RATIO * eigenvalues.max().max(0.0).sqrt()).max(COLLINEAR_NOISE * noise)
}

/// Statistics of the path of one image point.
struct Path {
    first: Vector2<f64>,
    last: Vector2<f64>,
    count: f64,
    /// Sum and sum of squares of the displacements from the first point.
    sum: Vector2<f64>,
    squares: f64,
    /// Sum of squares of the displacements between frames.
    steps: f64,
    largest: f64,
}

impl Path {
    fn from(first: Vector2<f64>) -> Self {
        Self {
            first,
            last: first,
            count: 0.0,
            sum: Vector2::zeros(),
            squares: 0.0,
            steps: 0.0,
            largest: 0.0,
        }
    }

    fn extend(&mut self, point: Vector2<f64>) {
        let displacement = point - self.first;
        self.count += 1.0;
        self.sum += displacement;
        self.squares += displacement.norm_squared();
        self.steps += (point - self.last).norm_squared();
        self.largest = self.largest.max(displacement.norm());
        self.last = point;
    }

    /// Mean squared step over the variance; `None` for a path that is too short or does not move.
    fn noise_ratio(&self) -> Option<f64> {
        let variance = self.squares / self.count - (self.sum / self.count).norm_squared();
        let random = self.steps / (self.count - 1.0) / variance;
        (self.count >= 8.0 && variance > 0.0).then_some(random)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::{Feature, FeatureFrame};

    /// 60 frames with twelve points, at the positions that `at` gives for frame and id.
    fn tracks(at: impl Fn(u32, u64) -> (f64, f64)) -> Tracks {
        let frame = |k: u32| {
            let feature = |id| {
                let (u, v) = at(k, id);
                Feature { id, u, v }
            };
            FeatureFrame::new(0.1 * f64::from(k), (0..12).map(feature).collect())
        };
        Tracks::new((0..60).map(frame)).unwrap()
    }

    /// Pseudo-random, uniform in [-0.5, 0.5], for each frame, id and axis.
    fn noise(k: u32, id: u64, axis: u32) -> f64 {
        let x = (f64::from(k) * 12.9898 + id as f64 * 78.233 + f64::from(axis) * 37.719).sin();
        (x * 43758.5453).rem_euclid(1.0) - 0.5
    }

    #[test]
    fn a_turning_rod_is_collinear_in_every_image() {
        let rod = |k: u32, id: u64, thick: f64| {
            let (along, turn) = (id as f64 - 5.5, 0.05 * f64::from(k));
            let across = thick * (id % 3) as f64;
            let u = 500.0 + 40.0 * along * turn.cos() - across * turn.sin();
            let v = 500.0 + 40.0 * along * turn.sin() + across * turn.cos();
            (u.round(), v.round())
        };
        let thin = tracks(|k, id| rod(k, id, 0.0));
        assert_eq!(check(&thin, 0.3), Err(EstimateError::Collinear));
        // A rod that is 6 pixels thick is not collinear.
        assert_eq!(check(&tracks(|k, id| rod(k, id, 3.0)), 0.3), Ok(()));
    }

    #[test]
    fn a_view_with_noise_only_is_constant_and_one_with_slow_motion_is_not() {
        let place = |id: u64| (100.0 + 37.0 * id as f64, 90.0 + (id * id) as f64);
        let noisy = tracks(|k, id| {
            let (u, v) = place(id);
            (u + 3.0 * noise(k, id, 0), v + 3.0 * noise(k, id, 1))
        });
        let refused = check(&noisy, 0.3);
        assert!(matches!(refused, Err(EstimateError::Constant { largest }) if largest > 2.4));
        let slow = tracks(|k, id| {
            let (u, v) = place(id);
            (
                u + 0.08 * f64::from(k) + noise(k, id, 0),
                v + noise(k, id, 1),
            )
        });
        assert_eq!(check(&slow, 0.3), Ok(()));
    }
}
