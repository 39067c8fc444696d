//! Structure in the body axes of a given motion: points and positions from which the global adjustment starts.

use nalgebra::{UnitQuaternion, Vector3};

use super::frames::{Frames, Observation};
use super::known_rotation::{structure as linear_structure, triangulate};
use super::pose_model::FramePose;
use super::resection::{Correspondence, translation};
use super::structure::{Segment, SolverSettings, scene_of};

/// The point of each track (body axes) and the body's position in each frame (camera axes), where known.
pub type PointsAndPositions = (Vec<Option<Vector3<f64>>>, Vec<Option<Vector3<f64>>>);

/// Transfers the points of a segment to the motion's body axes; `turn` is the rotation from segment axes to body axes.
/// Positions and missing points are computed from the motion's attitudes.
pub fn transfer_structure(
    frames: &Frames,
    segment: &Segment,
    turn: &UnitQuaternion<f64>,
    attitudes: &[UnitQuaternion<f64>],
    settings: &SolverSettings,
) -> Option<PointsAndPositions> {
    let focal = frames.focal * segment.log_focal.exp();
    let mut points: Vec<_> = segment.points.iter().map(|p| p.map(|p| turn * p)).collect();
    let position = |i: usize| {
        let known = |s: &Observation| Some((points[s.track]?, s.pixel));
        let correspondences: Vec<Correspondence> = frames.list[i]
            .observations
            .iter()
            .filter_map(known)
            .collect();
        (correspondences.len() >= 2)
            .then(|| translation(&focal, &correspondences, &attitudes[i]))
            .flatten()
    };
    let positions: Vec<_> = (0..frames.list.len()).map(position).collect();
    let mut missing: Vec<Vec<_>> = vec![Vec::new(); frames.ids.len()];
    for ((frame, position), R_CB) in frames.list.iter().zip(&positions).zip(attitudes) {
        let Some(t_C) = *position else { continue };
        let pose = FramePose { R_CB: *R_CB, t_C };
        for s in frame
            .observations
            .iter()
            .filter(|s| points[s.track].is_none())
        {
            missing[s.track].push((pose, s.pixel));
        }
    }
    for (track, observations) in missing.iter().enumerate().filter(|(_, s)| s.len() >= 2) {
        points[track] = triangulate(observations, &focal, settings.noise);
    }
    Some((points, positions))
}

/// Points and positions from the motion's attitudes alone, by linear least squares.
pub fn structure_from_attitudes(
    frames: &Frames,
    attitudes: &[UnitQuaternion<f64>],
    settings: &SolverSettings,
) -> Option<PointsAndPositions> {
    let all: Vec<usize> = (0..frames.list.len())
        .filter(|i| frames.list[*i].observations.len() >= 3)
        .collect();
    let (scene, tracks) = scene_of(frames, &all, |_| true, settings.noise, 2);
    let chosen: Vec<_> = all.iter().map(|i| attitudes[*i]).collect();
    let (solved, poses) = linear_structure(&scene, &chosen, settings.noise)?;
    let mut points = vec![None; frames.ids.len()];
    for (point, track) in solved.iter().zip(tracks) {
        points[track] = Some(*point);
    }
    let mut positions = vec![None; frames.list.len()];
    for (pose, i) in poses.iter().zip(all) {
        positions[i] = Some(pose.t_C);
    }
    Some((points, positions))
}
