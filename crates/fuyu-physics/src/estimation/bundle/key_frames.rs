//! Key frames, and the initial structure reconstructed from them: two-view rotations, linear structure, bundle
//! adjustment.

use std::collections::HashMap;

use nalgebra::UnitQuaternion;
use rand::Rng;

use super::adjust::{AdjustOptions, adjust};
use super::frames::Frames;
use super::inlier_gate::{INLIER_GATE, gate_inliers, rms};
use super::known_rotation::{drop_points_behind_camera, structure as linear_structure};
use super::pixel_likelihood::PixelLikelihood;
use super::pose_model::independent_poses::IndependentPoses;
use super::relative_pose::relative_pose;
use super::structure::{Segment, SolverSettings, scene_of};

/// Least change of the points' arrangement from one key frame to the next; see [`Frames::change`].
const KEY_CHANGE: f64 = 0.2;

/// Least number of points that consecutive key frames share.
const MIN_COMMON: usize = 8;

/// At most `most` frames of `open`, from its first on, each visibly changed from the one before.
pub fn key_frames(frames: &Frames, open: &[usize], most: usize) -> Vec<usize> {
    let mut keys: Vec<usize> = Vec::with_capacity(most);
    let mut last_good = None;
    for &i in open {
        let Some(&last) = keys.last() else {
            if frames.list[i].observations.len() >= MIN_COMMON {
                keys.push(i);
            }
            continue;
        };
        match frames.change(last, i, MIN_COMMON) {
            Some(change) if change >= KEY_CHANGE => {
                keys.push(i);
                last_good = None;
            }
            Some(_) => last_good = Some(i),
            // Fall back to the last frame that shares enough points, although it changed little.
            None => {
                if let Some(good) = last_good.take() {
                    keys.push(good);
                } else if keys.len() < 3 {
                    keys.clear();
                } else {
                    break;
                }
            }
        }
        if keys.len() == most {
            break;
        }
    }
    keys
}

/// Structure of the key frames.
pub fn structure_of_key_frames(
    frames: &mut Frames,
    keys: &[usize],
    settings: &SolverSettings,
    rng: &mut impl Rng,
) -> Option<Segment> {
    let angle = settings.noise * frames.pixel_angle();
    let mut attitudes = vec![UnitQuaternion::identity()];
    let mut agreements = HashMap::<(usize, usize), (u32, u32)>::new();
    for pair in keys.windows(2) {
        let both = frames.common(pair[0], pair[1]);
        let pose = relative_pose(&frames.pairs(pair[0], pair[1]), angle, rng)?;
        for ((track, ..), agrees) in both.iter().zip(&pose.agreeing) {
            for key in pair {
                let votes = agreements.entry((*key, *track)).or_default();
                votes.0 += u32::from(*agrees);
                votes.1 += 1;
            }
        }
        let turn = UnitQuaternion::from_rotation_matrix(&pose.R);
        let mut next = turn * attitudes.last()?;
        next.renormalize();
        attitudes.push(next);
    }
    for &key in keys {
        for observation in &mut frames.list[key].observations {
            let votes = agreements.get(&(key, observation.track));
            observation.inlier = votes.is_none_or(|(good, _)| *good > 0);
        }
    }
    let (mut scene, tracks) = scene_of(frames, keys, |_| true, settings.noise, 2);
    let (mut points, poses) = linear_structure(&scene, &attitudes, settings.noise)?;
    if 4 * drop_points_behind_camera(&mut scene, &points, &poses) < 3 * scene.observations().len() {
        return None;
    }
    let mut motion = IndependentPoses::new(poses, 0.0);
    for width in [10.0, 4.0] {
        let adjust_options = AdjustOptions {
            likelihood: PixelLikelihood::Huber(width * settings.noise),
            steps: 30,
            tolerance: 1e-4,
        };
        adjust(&scene, &mut motion, &mut points, &adjust_options)?;
        // Outliers that agree now are inliers again.
        gate_inliers(
            &mut scene,
            &motion,
            &points,
            2.0 * INLIER_GATE * settings.noise,
        );
    }
    let mut segment = Segment {
        poses: vec![None; frames.list.len()],
        points: vec![None; frames.ids.len()],
        log_focal: 0.0,
        rms: 0.0,
    };
    for (k, &i) in keys.iter().enumerate() {
        segment.poses[i] = Some(motion.poses[k]);
    }
    for (point, &track) in points.iter().zip(&tracks) {
        segment.points[track] = Some(*point);
    }
    segment.rms = rms(&scene, &motion, &points);
    (segment.rms < 8.0 * settings.noise).then_some(segment)
}
