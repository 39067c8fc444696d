//! Points and positions for a motion's attitudes: what the dynamic adjustment starts with.

use nalgebra::{UnitQuaternion, Vector3};

use super::adjust::Placement;
use super::frames::{Frames, Sight};
use super::known_rotation::{structure as linear_structure, triangulate};
use super::resection::{Mark, translation};
use super::structure::{Segment, Settings, scene_of};

/// Of each track the point, of each frame the body's position; as far as they are known.
pub type Known = (Vec<Option<Vector3<f64>>>, Vec<Option<Vector3<f64>>>);

/// Points and positions of a segment in the motion's body axes, `turn` taking segment axes to those; what it
/// lacks is found from the motion's attitudes.
pub fn carried_over(
    frames: &Frames,
    segment: &Segment,
    turn: &UnitQuaternion<f64>,
    attitudes: &[UnitQuaternion<f64>],
    settings: &Settings,
) -> Option<Known> {
    let focal = frames.focal * segment.log_focal.exp();
    let mut points: Vec<_> = segment.points.iter().map(|p| p.map(|p| turn * p)).collect();
    let position = |i: usize| {
        let known = |s: &Sight| Some((points[s.track]?, s.pixel));
        let marks: Vec<Mark> = frames.list[i].sights.iter().filter_map(known).collect();
        (marks.len() >= 2)
            .then(|| translation(&focal, &marks, &attitudes[i]))
            .flatten()
    };
    let positions: Vec<_> = (0..frames.list.len()).map(position).collect();
    let mut missing: Vec<Vec<_>> = vec![Vec::new(); frames.ids.len()];
    for ((frame, position), R_CB) in frames.list.iter().zip(&positions).zip(attitudes) {
        let Some(t_C) = *position else { continue };
        let placement = Placement { R_CB: *R_CB, t_C };
        for s in frame.sights.iter().filter(|s| points[s.track].is_none()) {
            missing[s.track].push((placement, s.pixel));
        }
    }
    for (track, sights) in missing.iter().enumerate().filter(|(_, s)| s.len() >= 2) {
        points[track] = triangulate(sights, &focal, settings.noise);
    }
    Some((points, positions))
}

/// Points and positions from the motion's attitudes alone.
pub fn from_rotations(
    frames: &Frames,
    attitudes: &[UnitQuaternion<f64>],
    settings: &Settings,
) -> Option<Known> {
    let all: Vec<usize> = (0..frames.list.len())
        .filter(|i| frames.list[*i].sights.len() >= 3)
        .collect();
    let (scene, tracks) = scene_of(frames, &all, |_| true, settings.noise, 2);
    let chosen: Vec<_> = all.iter().map(|i| attitudes[*i]).collect();
    let (solved, placements) = linear_structure(&scene, &chosen, settings.noise)?;
    let mut points = vec![None; frames.ids.len()];
    for (point, track) in solved.iter().zip(tracks) {
        points[track] = Some(*point);
    }
    let mut positions = vec![None; frames.list.len()];
    for (placement, i) in placements.iter().zip(all) {
        positions[i] = Some(placement.t_C);
    }
    Some((points, positions))
}
