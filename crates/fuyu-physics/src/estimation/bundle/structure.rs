//! Structure from motion: shape of the body and its pose in every frame, without dynamics.
//!
//! It starts from a window of key frames ([`super::key_frames`]). Further frames are resected from the known points,
//! points are added, and everything is adjusted again whenever the number of frames has doubled.

use nalgebra::{UnitQuaternion, Vector2, Vector3};
use rand::Rng;

use super::adjust::{AdjustOptions, adjust};
use super::frames::Frames;
use super::inlier_gate::{INLIER_GATE, gate_inliers, rms};
use super::key_frames::{key_frames, structure_of_key_frames};
use super::known_rotation::triangulate;
use super::pixel_likelihood::PixelLikelihood;
use super::pose_model::FramePose;
use super::pose_model::disturbed::{Orbit, Widths};
use super::pose_model::independent_poses::IndependentPoses;
use super::resection::{Correspondence, MIN_POINTS, resect, translation};
use super::scene::{Scene, SceneObservation, residual};
use crate::spatial::exp_so3;

/// Windows of key frames that are tried: their number, and where they start as a share of the frames. Where one window
/// shows little of the motion, another may show more.
const WINDOWS: [(usize, f64); 6] = [
    (6, 0.0),
    (6, 0.5),
    (12, 0.25),
    (12, 0.75),
    (24, 0.0),
    (48, 0.0),
];

/// Number of frames whose resection may fail before the search over all attitudes is given up.
const SEARCHES: usize = 8;

/// A part of the frames, with the structure reconstructed from it.
#[derive(Debug, Clone, PartialEq)]
pub struct Segment {
    /// The body's pose by frame, where known.
    pub poses: Vec<Option<FramePose>>,
    /// The point of each track in body axes, where known.
    pub points: Vec<Option<Vector3<f64>>>,
    /// Logarithm of the focal length over its nominal value.
    pub log_focal: f64,
    /// Root mean square of the inliers' residual components \[px\].
    pub rms: f64,
}

/// Assumptions of the solver about noise and camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SolverSettings {
    /// Image noise \[px\].
    pub noise: f64,
    /// Prior widths of the disturbances.
    pub widths: Widths,
    /// A relative orbit whose directions are known.
    pub orbit: Option<Orbit>,
    /// Whether the covariances of the points are wanted.
    pub with_points: bool,
}

impl Segment {
    /// Number of frames with a known pose.
    pub fn resected(&self) -> usize {
        self.poses.iter().flatten().count()
    }

    /// Whether the assumed noise explains the residuals.
    fn fits_noise(&self, settings: &SolverSettings) -> bool {
        self.rms < 1.7 * settings.noise
    }
}

/// The largest segment of the `open` frames that can be reconstructed. With `before`, the number of frames of the first
/// segment, half as many frames are enough. Updates the inliers of the frames that it resects.
pub fn reconstruct(
    frames: &mut Frames,
    open: &[usize],
    before: Option<usize>,
    settings: &SolverSettings,
    rng: &mut impl Rng,
) -> Option<Segment> {
    let mut best: Option<(Segment, Frames)> = None;
    let placeable = open
        .iter()
        .filter(|i| frames.list[**i].observations.len() >= MIN_POINTS)
        .count();
    // Without a first segment nearly all frames are wanted, and every window is tried for them.
    let enough = before.map_or(9 * placeable / 10, |b| b.min(placeable) / 2);
    let mut last_keys = Vec::new();
    for (window, part) in WINDOWS {
        let from = (part * open.len() as f64) as usize;
        let keys = key_frames(frames, &open[from..], window);
        // With too few frames a longer window has the same key frames as a shorter one.
        if keys.len() < 3 || keys == last_keys {
            continue;
        }
        let mut tried = frames.clone();
        let started = structure_of_key_frames(&mut tried, &keys, settings, rng);
        last_keys = keys;
        let Some(segment) = started.and_then(|s| grow(&mut tried, s, open, settings)) else {
            continue;
        };
        let done = segment.fits_noise(settings) && segment.resected() >= enough;
        let quality = |s: &Segment| (s.fits_noise(settings), s.resected());
        let better = best.as_ref().is_none_or(|(b, _)| {
            let (old, new) = (quality(b), quality(&segment));
            new > old || (new == old && segment.rms < b.rms)
        });
        if better {
            best = Some((segment, tried));
        }
        if done {
            break;
        }
    }
    let (segment, tried) = best?;
    *frames = tried;
    Some(segment)
}

/// The scene of the `chosen` frames, with the tracks that `wanted` selects and that at least `least` of these frames
/// show; and the track of each point.
pub fn scene_of(
    frames: &Frames,
    chosen: &[usize],
    wanted: impl Fn(usize) -> bool,
    noise: f64,
    least: usize,
) -> (Scene, Vec<usize>) {
    let mut counts = vec![0; frames.ids.len()];
    for observation in chosen.iter().flat_map(|&i| &frames.list[i].observations) {
        counts[observation.track] += usize::from(observation.inlier);
    }
    let mut numbers = vec![usize::MAX; frames.ids.len()];
    let mut tracks = Vec::new();
    let mut lists = Vec::with_capacity(chosen.len());
    for &i in chosen {
        let mut list = Vec::with_capacity(frames.list[i].observations.len());
        for observation in &frames.list[i].observations {
            let track = observation.track;
            if counts[track] < least || !wanted(track) {
                continue;
            }
            if numbers[track] == usize::MAX {
                numbers[track] = tracks.len();
                tracks.push(track);
            }
            list.push(SceneObservation {
                point: numbers[track],
                pixel: observation.pixel,
                inlier: observation.inlier,
            });
        }
        lists.push(list);
    }
    let scene = Scene::new(frames.focal, lists, tracks.len(), noise);
    (scene, tracks)
}

/// Extends a segment over the `open` frames as far as it goes.
fn grow(
    frames: &mut Frames,
    mut segment: Segment,
    open: &[usize],
    settings: &SolverSettings,
) -> Option<Segment> {
    let mut searches = SEARCHES;
    let at = |i: usize| open.partition_point(|o| *o < i);
    let first = segment.poses.iter().position(Option::is_some)?;
    let last = segment.poses.iter().rposition(Option::is_some)?;
    let (mut low, mut high) = (at(first), at(last));
    for &i in &open[low..=high] {
        resect_frame(frames, &mut segment, i, settings, &mut searches);
    }
    adjust_segment(frames, &mut segment, settings, 8)?;
    while low > 0 || high + 1 < open.len() {
        let reach = (high - low + 1).max(6);
        let (up, down) = (
            (high + reach / 2).min(open.len() - 1),
            low.saturating_sub(reach / 2),
        );
        let forwards = open[high + 1..=up].iter();
        let backwards = open[down..low].iter().rev();
        for (k, &i) in forwards.chain(backwards).enumerate() {
            resect_frame(frames, &mut segment, i, settings, &mut searches);
            if k % 8 == 7 {
                add_points(frames, &mut segment, settings);
            }
        }
        (low, high) = (down, up);
        adjust_segment(frames, &mut segment, settings, 4)?;
    }
    // Frames that could not be resected before may fit the adjusted structure.
    for &i in open {
        if segment.poses[i].is_none() {
            resect_frame(frames, &mut segment, i, settings, &mut searches);
        }
    }
    adjust_segment(frames, &mut segment, settings, 4)?;
    Some(segment)
}

/// Resects frame `i` from the known points, if it has no pose yet.
fn resect_frame(
    frames: &mut Frames,
    segment: &mut Segment,
    i: usize,
    settings: &SolverSettings,
    searches: &mut usize,
) {
    if segment.poses[i].is_some() {
        return;
    }
    let focal = frames.focal * segment.log_focal.exp();
    let known = |s: &super::frames::Observation| Some((segment.points[s.track]?, s.pixel));
    let correspondences: Vec<Correspondence> = frames.list[i]
        .observations
        .iter()
        .filter_map(known)
        .collect();
    if correspondences.len() < MIN_POINTS {
        return;
    }
    let R_CB = extrapolated(frames, segment, i);
    let Some(t_C) = translation(&focal, &correspondences, &R_CB) else {
        return;
    };
    let guess = FramePose { R_CB, t_C };
    let found = resect(
        &focal,
        &correspondences,
        &guess,
        settings.noise,
        *searches > 0,
    );
    if let Some(resected) = found {
        segment.poses[i] = Some(resected.pose);
        let R = resected.pose.R_CB.to_rotation_matrix();
        let limit = 2.0 * INLIER_GATE * settings.noise;
        for observation in &mut frames.list[i].observations {
            observation.inlier = segment.points[observation.track].is_none_or(|p| {
                let off = residual(&focal, &(R * p + resected.pose.t_C), &observation.pixel);
                off.is_some_and(|r| r.norm() < limit)
            });
        }
    } else {
        *searches = searches.saturating_sub(1);
    }
}

/// Attitude in frame `i`, interpolated or extrapolated at a constant rate from the nearest frames with a pose.
fn extrapolated(frames: &Frames, segment: &Segment, i: usize) -> UnitQuaternion<f64> {
    let resected = |k: &usize| segment.poses[*k].is_some();
    let attitude = |k: usize| segment.poses[k].map_or(UnitQuaternion::identity(), |p| p.R_CB);
    let time = |k: usize| frames.list[k].time;
    let mut before = (0..i).rev().filter(resected).take(2);
    let mut after = (i + 1..frames.list.len()).filter(resected).take(2);
    let (b, a) = ((before.next(), before.next()), (after.next(), after.next()));
    let extrapolate = |near: usize, far: usize| {
        let turn = (attitude(far).inverse() * attitude(near)).scaled_axis();
        let ratio = (time(i) - time(near)) / (time(near) - time(far));
        attitude(near) * exp_so3(&(turn * ratio))
    };
    let distance = |k: Option<usize>| k.map_or(f64::INFINITY, |k| (time(k) - time(i)).abs());
    match (b, a) {
        ((Some(p), _), (Some(n), _)) if n - p <= 3 => {
            let ratio = (time(i) - time(p)) / (time(n) - time(p));
            let turn = (attitude(p).inverse() * attitude(n)).scaled_axis();
            attitude(p) * exp_so3(&(turn * ratio))
        }
        ((near, Some(far)), (other, _)) if distance(near) <= distance(other) => {
            extrapolate(near.unwrap_or(far), far)
        }
        (_, (Some(near), Some(far))) => extrapolate(near, far),
        ((Some(near), Some(far)), _) => extrapolate(near, far),
        ((Some(only), None), _) | (_, (Some(only), None)) => attitude(only),
        _ => UnitQuaternion::identity(),
    }
}

/// Triangulates the points that at least three frames with a pose show from different directions.
fn add_points(frames: &Frames, segment: &mut Segment, settings: &SolverSettings) {
    let mut observations: Vec<Vec<(FramePose, Vector2<f64>)>> = vec![Vec::new(); frames.ids.len()];
    let mut any = false;
    for (frame, pose) in frames.list.iter().zip(&segment.poses) {
        let Some(pose) = pose else { continue };
        for s in frame.observations.iter().filter(|s| s.inlier) {
            if segment.points[s.track].is_none() {
                observations[s.track].push((*pose, s.pixel));
                any = true;
            }
        }
    }
    if !any {
        return;
    }
    let focal = frames.focal * segment.log_focal.exp();
    for (track, observations) in observations
        .iter()
        .enumerate()
        .filter(|(_, s)| s.len() >= 3)
    {
        let side = |p: &FramePose| p.R_CB.inverse_transform_vector(&p.t_C).normalize();
        let first = side(&observations[0].0);
        let widest = observations.iter().map(|(p, _)| side(p).angle(&first));
        if widest.fold(0.0, f64::max) > 0.05 {
            segment.points[track] = triangulate(observations, &focal, settings.noise);
        }
    }
}

/// Adjusts all known poses and points together, and updates the inliers.
fn adjust_segment(
    frames: &mut Frames,
    segment: &mut Segment,
    settings: &SolverSettings,
    steps: usize,
) -> Option<()> {
    add_points(frames, segment, settings);
    let chosen: Vec<usize> = (0..frames.list.len())
        .filter(|i| segment.poses[*i].is_some())
        .collect();
    let known = |track: usize| segment.points[track].is_some();
    let (mut scene, tracks) = scene_of(frames, &chosen, known, settings.noise, 2);
    let mut points: Vec<_> = tracks.iter().filter_map(|t| segment.points[*t]).collect();
    let poses = chosen.iter().filter_map(|i| segment.poses[*i]).collect();
    // A few frames do not determine the focal length.
    let focal_deviation = match chosen.len() {
        ..=12 => 0.0,
        _ => settings.widths.focal,
    };
    let mut motion = IndependentPoses::new(poses, focal_deviation);
    motion.log_focal = segment.log_focal;
    let limit = INLIER_GATE * settings.noise;
    gate_inliers(&mut scene, &motion, &points, 2.0 * limit);
    let adjust_options = AdjustOptions {
        likelihood: PixelLikelihood::Huber(4.0 * settings.noise),
        steps,
        // The global adjustment refines the result.
        tolerance: 1e-3,
    };
    adjust(&scene, &mut motion, &mut points, &adjust_options)?;
    gate_inliers(&mut scene, &motion, &points, limit);
    segment.log_focal = motion.log_focal;
    segment.rms = rms(&scene, &motion, &points);
    for (point, &track) in points.iter().zip(&tracks) {
        segment.points[track] = Some(*point);
    }
    let mut number = vec![usize::MAX; frames.ids.len()];
    for (k, &track) in tracks.iter().enumerate() {
        number[track] = k;
    }
    for (k, &i) in chosen.iter().enumerate() {
        let observed = scene.frame(k);
        let inliers = observed.iter().filter(|s| s.inlier).count();
        for observation in &mut frames.list[i].observations {
            if let Some(s) = observed
                .iter()
                .find(|s| s.point == number[observation.track])
            {
                observation.inlier = s.inlier;
            }
        }
        // A frame with too few inliers has to be resected again.
        let enough = inliers >= MIN_POINTS && 2 * inliers >= observed.len();
        segment.poses[i] = enough.then_some(motion.poses[k]);
    }
    Some(())
}
