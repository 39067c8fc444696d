//! Search over angular velocities: initial values where no two frames share enough points for their relative pose.
//!
//! If the angular velocity is assumed to be constant over a short window, all attitudes in the window are known, and
//! structure follows by linear least squares from all its frames together (`known_rotation`). The best candidates of a
//! grid of angular velocities are adjusted, and the window is doubled until it contains all frames.

use nalgebra::{SVector, UnitQuaternion, Vector3};

use super::frames::Frames;
use super::free_motion::FreeMotion;
use super::known_rotation::structure;
use super::model_fit::{ModelFit, fit_robustly};
use super::pose_model::FramePose;
use super::pose_model::free_positions::FreePositions;
use super::pose_model::linear_com_motion::LinearComMotion;
use super::scene::{Scene, residual};
use super::structure::{SolverSettings, scene_of};
use crate::spatial::exp_so3;

/// Largest number of frames of the first window that are used.
const FIRST: usize = 14;

/// Largest number of frames of a longer window that are used.
const MOST: usize = 240;

/// Least number of points that the first and last frame of the first window share.
const SHARED: usize = 3;

/// Rotations over the first window that are tried \[rad\].
const TURNS: [f64; 6] = [0.15, 0.3, 0.6, 1.0, 1.6, 2.4];

/// Number of directions that are tried.
const DIRECTIONS: u32 = 40;

/// Number of candidates that are adjusted, and number that are followed into the next window.
const ADJUSTED: usize = 8;
const FOLLOWED: usize = 3;

/// An adjusted motion with the mean square of its residuals \[px²\].
type Candidate = (FreeMotion, f64);

/// The motion that explains the tracks, from a search over angular velocities that begins in window `rank` of
/// `first_windows`. A window with few points may fit a wrong motion, so callers try several.
pub fn search_rates(frames: &Frames, rank: usize, settings: &SolverSettings) -> Option<FreeMotion> {
    let (from, to) = *first_windows(frames).get(rank)?;
    let window = subset(frames, from, to, FIRST);
    let mut candidates: Vec<Candidate> = Vec::new();
    for (motion, _) in best_of_grid(&window, settings)? {
        candidates.extend(fit_window(&window, &motion, settings));
    }
    let (mut low, mut high) = (from, to);
    let last = frames.list.len() - 1;
    loop {
        candidates.sort_by(|a, b| a.1.total_cmp(&b.1));
        candidates.truncate(FOLLOWED);
        if low == 0 && high == last {
            break;
        }
        let grow = (high - low + 1).div_ceil(3);
        (low, high) = (low.saturating_sub(grow), (high + grow).min(last));
        let window = subset(frames, low, high, MOST);
        let followed = candidates
            .iter()
            .filter_map(|(motion, _)| fit_window(&window, motion, settings));
        candidates = followed.collect();
    }
    candidates.first().map(|(motion, _)| *motion)
}

/// Windows whose first and last frame share a few points, largest change first.
fn first_windows(frames: &Frames) -> Vec<(usize, usize)> {
    let count = frames.list.len();
    let starts = (0..8).rev().map(|k| k * count / 8);
    let windows = starts.filter_map(|from| {
        let shares = |to: &usize| frames.common(from, *to).len() >= SHARED;
        let to = (from + 2..count).take_while(shares).last()?;
        let change = frames.change(from, to, SHARED)?;
        Some((from, to, change))
    });
    let mut windows: Vec<_> = windows.collect();
    // Rotations of more than a radian or so have hidden points.
    windows.sort_by(|a, b| b.2.min(1.0).total_cmp(&a.2.min(1.0)));
    windows.iter().map(|w| (w.0, w.1)).collect()
}

/// Frames `from` to `to`, at most about `most` of them.
fn subset(frames: &Frames, from: usize, to: usize, most: usize) -> Frames {
    let stride = (to - from + 1).div_ceil(most);
    let kept = frames.list[from..=to].iter().step_by(stride.max(1));
    Frames {
        list: kept.cloned().collect(),
        ids: frames.ids.clone(),
        focal: frames.focal,
    }
}

/// Directions spread evenly over a sphere.
fn directions() -> impl Iterator<Item = Vector3<f64>> {
    let golden = std::f64::consts::PI * (3.0 - 5.0f64.sqrt());
    (0..DIRECTIONS).map(move |k| {
        let z = 1.0 - 2.0 * (f64::from(k) + 0.5) / f64::from(DIRECTIONS);
        let (s, c) = (golden * f64::from(k)).sin_cos();
        let r = (1.0 - z * z).sqrt();
        Vector3::new(r * c, r * s, z)
    })
}

/// The best motions of the grid, with spherical inertia.
fn best_of_grid(window: &Frames, settings: &SolverSettings) -> Option<Vec<Candidate>> {
    let (first, last) = (window.list.first()?.time, window.list.last()?.time);
    let middle = 0.5 * (first + last);
    let all: Vec<usize> = (0..window.list.len()).collect();
    let (scene, _) = scene_of(window, &all, |_| true, settings.noise, 2);
    let mut found: Vec<Candidate> = Vec::new();
    for turn in TURNS {
        for direction in directions() {
            let rate = direction * (turn / (last - first));
            let attitude = |i: usize| {
                let frame = &window.list[i];
                frame.R_WC.inverse() * exp_so3(&(rate * (frame.time - middle)))
            };
            let attitudes: Vec<UnitQuaternion<f64>> = all.iter().map(|i| attitude(*i)).collect();
            let Some((points, poses)) = structure(&scene, &attitudes, settings.noise) else {
                continue;
            };
            let motion =
                FreeMotion::new(&SVector::zeros(), rate, middle, UnitQuaternion::identity());
            let cost = mean_square(&scene, &points, &poses, 40.0 * settings.noise);
            found.extend(motion.map(|m| (m, cost)));
        }
    }
    found.sort_by(|a, b| a.1.total_cmp(&b.1));
    found.truncate(ADJUSTED);
    Some(found)
}

/// Mean square of the residuals, each at most `limit` \[px²\].
fn mean_square(scene: &Scene, points: &[Vector3<f64>], poses: &[FramePose], limit: f64) -> f64 {
    let most = limit * limit;
    let mut sum = 0.0;
    for (i, pose) in poses.iter().enumerate() {
        for s in scene.frame(i) {
            let x = pose.R_CB * points[s.point] + pose.t_C;
            let off = residual(&scene.focal, &x, &s.pixel);
            sum += off.map_or(most, |r| r.norm_squared().min(most));
        }
    }
    sum / scene.observations().len().max(1) as f64
}

/// Adjusts a motion to the frames of a window. Its reference time stays.
fn fit_window(
    window: &Frames,
    motion: &FreeMotion,
    settings: &SolverSettings,
) -> Option<Candidate> {
    let times: Vec<f64> = window.list.iter().map(|f| f.time).collect();
    let R_WC: Vec<_> = window.list.iter().map(|f| f.R_WC).collect();
    let attitudes: Vec<_> = (motion.attitudes(&times).into_iter().zip(&R_WC))
        .map(|(R_WB, R_WC)| R_WC.inverse() * R_WB)
        .collect();
    let all: Vec<usize> = (0..times.len()).collect();
    let (mut scene, _) = scene_of(window, &all, |_| true, settings.noise, 2);
    let (points, poses) = structure(&scene, &attitudes, settings.noise)?;
    let t_C = poses.iter().map(|p| p.t_C).collect();
    let free = FreePositions::new(*motion, t_C, &times, &R_WC, settings.noise, 0.0, 0.0);
    let rough = SolverSettings {
        noise: 2.0 * settings.noise,
        ..*settings
    };
    let quality = |residuals: &super::inlier_gate::Residuals| {
        residuals.rms.powi(2) * (1.0 - residuals.outliers)
            + (12.0 * settings.noise).powi(2) * residuals.outliers
    };
    let is_fixed = R_WC.iter().all(|R| *R == UnitQuaternion::identity());
    if is_fixed {
        let (line, centre) = LinearComMotion::new(free, &points)?;
        let points = points.iter().map(|p| p - centre).collect();
        let ModelFit {
            motion, residuals, ..
        } = fit_robustly(&mut scene, line, points, &rough)?;
        return Some((motion.into_parts().0.motion, quality(&residuals)));
    }
    let fit = fit_robustly(&mut scene, free, points, &rough)?;
    Some((fit.motion.motion, quality(&fit.residuals)))
}
