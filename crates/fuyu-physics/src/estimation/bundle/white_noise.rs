//! Noise of image points that is independent from frame to frame, measured without a model of the motion.
//!
//! High-order differences of a track over time cancel smooth motion and leave the noise. If third and fifth differences
//! give the same noise, the motion has been cancelled.

use crate::estimation::Tracks;
use crate::vision::FeatureFrame;

/// Coefficients of the differences, and their sums of squares.
const THIRD: [f64; 4] = [1.0, -3.0, 3.0, -1.0];
const FIFTH: [f64; 6] = [1.0, -5.0, 10.0, -10.0, 5.0, -1.0];
const SQUARES: [f64; 2] = [20.0, 252.0];

/// The fifth differences must give at least this share of the noise that the third ones give.
const AGREEING: f64 = 0.85;

/// Least number of differences.
const ENOUGH: usize = 60;

/// Intervals of frames that differ by at most this share are equal.
const EQUAL: f64 = 0.02;

/// Median of a chi-squared variable of one degree of freedom.
const MEDIAN: f64 = 0.455;

/// A difference of more standard deviations contains an outlier.
const OUTLYING: f64 = 5.0;

/// Standard deviation of the noise \[px\]. `None` if the motion between frames is not small, or there are too few points
/// in consecutive frames.
pub fn white_noise(tracks: &Tracks) -> Option<f64> {
    let frames = tracks.frames();
    let (mut third, mut fifth) = (Vec::new(), Vec::new());
    for window in frames.windows(FIFTH.len()) {
        let first = window[1].time - window[0].time;
        let mut intervals = window.windows(2).map(|pair| pair[1].time - pair[0].time);
        if intervals.any(|interval| (interval - first).abs() > EQUAL * first) {
            continue;
        }
        for feature in &window[0].features {
            let Some(track) = course(window, feature.id) else {
                continue;
            };
            for axis in 0..2 {
                let difference = |coefficients: &[f64]| -> f64 {
                    let each = coefficients.iter().zip(&track);
                    each.map(|(c, pixel)| c * pixel[axis]).sum()
                };
                third.push(difference(&THIRD).powi(2) / SQUARES[0]);
                fifth.push(difference(&FIFTH).powi(2) / SQUARES[1]);
            }
        }
    }
    let [third, fifth] = [third, fifth].map(deviation);
    (fifth? > AGREEING * third?).then_some(fifth?)
}

/// Image points of one id in all frames of `window`; `None` if one lacks it.
fn course(window: &[FeatureFrame], id: u64) -> Option<[[f64; 2]; FIFTH.len()]> {
    let mut track = [[0.0; 2]; FIFTH.len()];
    for (pixel, frame) in track.iter_mut().zip(window) {
        let at = frame.features.binary_search_by_key(&id, |f| f.id).ok()?;
        *pixel = [frame.features[at].u, frame.features[at].v];
    }
    Some(track)
}

/// Standard deviation from squares, most of which are of normal variables: from the median of those without outliers.
fn deviation(mut squares: Vec<f64>) -> Option<f64> {
    if squares.len() < ENOUGH {
        return None;
    }
    squares.sort_by(f64::total_cmp);
    let mut normal = squares.len();
    let mut deviation = f64::INFINITY;
    // The number of outliers and the deviation determine each other.
    for _ in 0..8 {
        deviation = (squares[normal / 2] / MEDIAN).sqrt();
        let now = squares.partition_point(|square| *square <= (OUTLYING * deviation).powi(2));
        if now == normal || now < ENOUGH {
            break;
        }
        normal = now;
    }
    Some(deviation)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::Feature;
    use rand::{RngExt, SeedableRng, rngs::StdRng};
    use rand_distr::StandardNormal;

    /// Points on circles that turn by `step` \[rad\] from frame to frame, with noise of 2 px.
    fn circles(step: f64) -> Tracks {
        let mut rng = StdRng::seed_from_u64(3);
        let frames = (0..60).map(|k| {
            let angle = step * f64::from(k);
            let features = (0..10).map(|id| {
                let mut noise = || 2.0 * rng.sample::<f64, _>(StandardNormal);
                let phase = angle + 0.6 * f64::from(id);
                Feature {
                    id: u64::from(id as u32),
                    u: 500.0 + 150.0 * phase.cos() + noise(),
                    v: 500.0 + 150.0 * phase.sin() + noise(),
                }
            });
            FeatureFrame::new(0.1 * f64::from(k), features.collect())
        });
        Tracks::new(frames).unwrap()
    }

    // 8 % of the points are anywhere: a quarter of third, a third of fifth differences contain one.
    #[test]
    fn outliers_do_not_count_as_noise() {
        let mut rng = StdRng::seed_from_u64(5);
        let clean = circles(0.05);
        let frames = clean.frames().iter().map(|frame| {
            let features = frame.features.iter().map(|f| match rng.random_bool(0.08) {
                true => Feature {
                    u: rng.random_range(0.0..1000.0),
                    v: rng.random_range(0.0..1000.0),
                    ..*f
                },
                false => *f,
            });
            FeatureFrame::new(frame.time, features.collect())
        });
        let found = white_noise(&Tracks::new(frames).unwrap()).unwrap();
        assert!((found - 2.0).abs() < 0.25, "{found}");
    }

    #[test]
    fn noise_is_measured_if_the_motion_is_slow() {
        let found = white_noise(&circles(0.05)).unwrap();
        assert!((found - 2.0).abs() < 0.2, "{found}");
        assert_eq!(white_noise(&circles(0.6)), None);
    }
}
