//! Tracks that tell no motion whatever the method: points on a line, and a view that does not change.

use std::collections::HashMap;

use nalgebra::{Matrix2, Vector2};

use super::{EstimateError, Tracks};

/// Points that scatter across their line by less than this share of what they do along it are on it.
const THIN: f64 = 4e-3;

/// Scatter below this many standard deviations of a pixel is none.
const NOISE: f64 = 3.0;

/// A few points may jump to where they do not belong, or a few frames be wrong: this share must tell the same.
const MOST: f64 = 0.9;

/// Points that move by less than this many standard deviations of a pixel do not move.
const STILL: f64 = 8.0;

/// Points that move by less than this many may only tremble.
const TREMBLE: f64 = 30.0;

/// Mean squared difference of successive values over their variance: 2 for noise, little for motion.
const RANDOM: f64 = 1.5;

/// Refuses what no method can estimate from, with image points that are certain to `noise` \[px\].
///
/// # Errors
/// [`EstimateError::Collinear`] or [`EstimateError::Constant`].
pub fn check(tracks: &Tracks, noise: f64) -> Result<(), EstimateError> {
    let shown = tracks.sightings().iter();
    let shown: Vec<_> = shown.filter(|s| !s.features.is_empty()).collect();
    if shown.len() < 2 {
        // There is nothing to compare; the methods say how many frames they need.
        return Ok(());
    }
    let on_a_line = |points: Vec<Vector2<f64>>| lies_on_a_line(&points, noise);
    let lines = shown.iter().filter(|s| {
        let points = s.features.iter().map(|f| Vector2::new(f.u, f.v));
        on_a_line(points.collect())
    });
    if lines.count() as f64 >= MOST * shown.len() as f64 {
        return Err(EstimateError::Collinear);
    }
    let mut paths = HashMap::<u64, Path>::new();
    for f in shown.iter().flat_map(|s| &s.features) {
        let point = Vector2::new(f.u, f.v);
        paths
            .entry(f.id)
            .or_insert_with(|| Path::from(point))
            .go(point);
    }
    let largest = paths.values().map(|path| path.largest);
    let typical = high(largest.collect()).unwrap_or(0.0);
    let randomness = paths.values().filter_map(Path::randomness);
    let trembles = || high(randomness.collect()).is_some_and(|r| r > RANDOM);
    if typical < STILL * noise || (typical < TREMBLE * noise && trembles()) {
        return Err(EstimateError::Constant { largest: typical });
    }
    Ok(())
}

/// The value that three quarters do not exceed.
fn high(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() * 3 / 4).copied()
}

/// Two points are on a line, too.
fn lies_on_a_line(points: &[Vector2<f64>], noise: f64) -> bool {
    let count = points.len() as f64;
    let mean = points.iter().sum::<Vector2<f64>>() / count;
    let scatter = points.iter().map(|p| (p - mean) * (p - mean).transpose());
    let eigenvalues = (scatter.sum::<Matrix2<f64>>() / count).symmetric_eigenvalues();
    let across = eigenvalues.min().max(0.0).sqrt();
    across <= (THIN * eigenvalues.max().max(0.0).sqrt()).max(NOISE * noise)
}

/// How one point moves over the images.
struct Path {
    first: Vector2<f64>,
    last: Vector2<f64>,
    count: f64,
    /// Of the distances from the first.
    sum: Vector2<f64>,
    squares: f64,
    /// Of the steps.
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

    fn go(&mut self, point: Vector2<f64>) {
        let off = point - self.first;
        self.count += 1.0;
        self.sum += off;
        self.squares += off.norm_squared();
        self.steps += (point - self.last).norm_squared();
        self.largest = self.largest.max(off.norm());
        self.last = point;
    }

    /// Squared steps over the variance; `None` for a path that is too short or does not move.
    fn randomness(&self) -> Option<f64> {
        let variance = self.squares / self.count - (self.sum / self.count).norm_squared();
        let random = self.steps / (self.count - 1.0) / variance;
        (self.count >= 8.0 && variance > 0.0).then_some(random)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::{Feature, Sighting};

    /// 60 frames of points, where `at` says for frame and id.
    fn tracks(at: impl Fn(u32, u64) -> (f64, f64)) -> Tracks {
        let frame = |k: u32| {
            let feature = |id| {
                let (u, v) = at(k, id);
                Feature { id, u, v }
            };
            Sighting::new(0.1 * f64::from(k), (0..12).map(feature).collect())
        };
        Tracks::new((0..60).map(frame)).unwrap()
    }

    /// Even, without end, and different for each frame, id and axis.
    fn noise(k: u32, id: u64, axis: u32) -> f64 {
        let x = (f64::from(k) * 12.9898 + id as f64 * 78.233 + f64::from(axis) * 37.719).sin();
        (x * 43758.5453).rem_euclid(1.0) - 0.5
    }

    #[test]
    fn a_rod_that_turns_is_a_line_in_every_image() {
        let rod = |k: u32, id: u64, thick: f64| {
            let (along, turn) = (id as f64 - 5.5, 0.05 * f64::from(k));
            let across = thick * (id % 3) as f64;
            let u = 500.0 + 40.0 * along * turn.cos() - across * turn.sin();
            let v = 500.0 + 40.0 * along * turn.sin() + across * turn.cos();
            (u.round(), v.round())
        };
        let thin = tracks(|k, id| rod(k, id, 0.0));
        assert_eq!(check(&thin, 0.3), Err(EstimateError::Collinear));
        // A rod as thick as 6 pixels is none.
        assert_eq!(check(&tracks(|k, id| rod(k, id, 3.0)), 0.3), Ok(()));
    }

    #[test]
    fn a_view_that_trembles_is_constant_and_one_that_creeps_is_not() {
        let place = |id: u64| (100.0 + 37.0 * id as f64, 90.0 + (id * id) as f64);
        let trembling = tracks(|k, id| {
            let (u, v) = place(id);
            (u + 3.0 * noise(k, id, 0), v + 3.0 * noise(k, id, 1))
        });
        let refused = check(&trembling, 0.3);
        assert!(matches!(refused, Err(EstimateError::Constant { largest }) if largest > 2.4));
        let creeping = tracks(|k, id| {
            let (u, v) = place(id);
            (
                u + 0.08 * f64::from(k) + noise(k, id, 0),
                v + noise(k, id, 1),
            )
        });
        assert_eq!(check(&creeping, 0.3), Ok(()));
    }
}
