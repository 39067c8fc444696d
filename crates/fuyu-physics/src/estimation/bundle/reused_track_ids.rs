//! Reused track ids: a tracker may give the id of a lost point to another point. Such a track is split in two.

use rand::Rng;

use super::frames::Frames;
use super::relative_pose::relative_pose;

/// Largest displacement of a point, as a multiple of the median.
const MAX_DISPLACEMENT: f64 = 6.0;

/// Splits the tracks that change to another point of the body. The part before the change gets a new, higher track number.
/// Returns the number of splits.
///
/// Before a change the track agrees with the frame before; at the change it agrees neither with the next frame nor with
/// the one after it, while these two agree with each other. A single wrong image point agrees with no other frame.
pub fn split_reused_tracks(frames: &mut Frames, noise: f64, rng: &mut impl Rng) -> usize {
    let angle = noise * frames.pixel_angle();
    let mut agreeing = |i: usize, j: usize| -> Vec<usize> {
        let pose = relative_pose(&frames.pairs(i, j), angle, rng);
        let common = frames.common(i, j);
        let kept = pose.iter().flat_map(|p| &p.agreeing);
        // If the body hardly turned, a jump along the epipolar line satisfies the two-view geometry.
        let displacements: Vec<f64> = common.iter().map(|(_, a, b)| (b - a).norm()).collect();
        let mut sorted = displacements.clone();
        sorted.sort_by(f64::total_cmp);
        let median = sorted.get(sorted.len() / 2).copied().unwrap_or_default();
        let farthest = MAX_DISPLACEMENT * median + 12.0 * noise;
        (common.iter().zip(kept).zip(&displacements))
            .filter(|((_, agrees), displacement)| **agrees && **displacement < farthest)
            .map(|(((track, ..), _), _)| *track)
            .collect()
    };
    let count = frames.list.len();
    let next: Vec<Vec<usize>> = (0..count - 1).map(|i| agreeing(i, i + 1)).collect();
    let mut splits = Vec::new();
    for i in 1..count.saturating_sub(2) {
        let suspects: Vec<usize> = (frames.common(i, i + 1).iter())
            .map(|(track, ..)| *track)
            .filter(|t| next[i - 1].contains(t) && !next[i].contains(t) && next[i + 1].contains(t))
            .collect();
        if suspects.is_empty() {
            continue;
        }
        let after_next = agreeing(i, i + 2);
        let reused = suspects.into_iter().filter(|t| !after_next.contains(t));
        splits.extend(reused.map(|track| (i + 1, track)));
    }
    for (from, track) in &splits {
        // Earlier frames get the new number, so a later split of the same track starts after this one.
        let fresh = frames.ids.len();
        frames.ids.push(frames.ids[*track]);
        for frame in &mut frames.list[..*from] {
            for observation in frame.observations.iter_mut().filter(|s| s.track == *track) {
                observation.track = fresh;
            }
            frame.observations.sort_by_key(|s| s.track);
        }
    }
    splits.len()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimation::Tracks;
    use crate::vision::{Feature, FeatureFrame, Pinhole};
    use nalgebra::{UnitQuaternion, Vector3};
    use rand::{RngExt, SeedableRng, rngs::StdRng};

    /// Points on a body that turns by 0.1 rad from frame to frame. From frame 12 on, id 3 is another point; 5 % of the
    /// image points are anywhere. Fails if points are not also compared with the previous frame: wrong image points
    /// then count as reused ids.
    #[test]
    fn wrong_image_points_are_no_reused_ids() {
        let mut rng = StdRng::seed_from_u64(7);
        let camera = Pinhole::square(1024, 1.0);
        let place = |k: f64| Vector3::new((2.1 * k).sin(), (1.3 * k).cos(), (3.7 * k).sin()) * 0.8;
        let frames = (0..24).map(|i| {
            let R = UnitQuaternion::from_scaled_axis(
                Vector3::new(0.3, 0.9, 0.2).normalize() * (0.1 * f64::from(i)),
            );
            let features = (0..24).map(|id: u32| {
                let number = if id == 3 && i >= 12 { 40 } else { id };
                let x = R * place(f64::from(number)) + Vector3::new(0.0, 0.0, 4.0);
                let wrong = id != 3 && rng.random_bool(0.05);
                let mut anywhere = || rng.random_range(0.0..1023.0);
                let (u, v) = match wrong {
                    true => (anywhere(), anywhere()),
                    false => (
                        camera.cx + camera.fx * x.x / x.z,
                        camera.cy + camera.fy * x.y / x.z,
                    ),
                };
                Feature {
                    id: u64::from(id),
                    u,
                    v,
                }
            });
            FeatureFrame::new(0.1 * f64::from(i), features.collect())
        });
        let tracks = Tracks::new(frames).unwrap();
        let mut frames = Frames::new(&tracks, &camera, 60, |_| UnitQuaternion::identity());
        assert_eq!(split_reused_tracks(&mut frames, 0.3, &mut rng), 1);
    }
}
