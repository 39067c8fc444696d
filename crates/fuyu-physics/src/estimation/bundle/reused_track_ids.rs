//! Ids that a tracker gives to another point: where a track jumps for good, it is two.

use rand::Rng;

use super::frames::Frames;
use super::relative_pose::relative_pose;

/// No point goes so many times as far as most of them do.
const FARTHEST: f64 = 6.0;

/// Cuts the tracks that begin to show another point of the body; what was before gets a number of its own, higher than
/// that of what follows. How many were cut.
///
/// At a cut the track agrees neither with the next frame nor with the one after that, and these two agree with each
/// other. A single wrong image point does not look so.
pub fn split_reused_tracks(frames: &mut Frames, noise: f64, rng: &mut impl Rng) -> usize {
    let angle = noise * frames.pixel_angle();
    let mut agreeing = |i: usize, j: usize| -> Vec<usize> {
        let pose = relative_pose(&frames.pairs(i, j), angle, rng);
        let common = frames.common(i, j);
        let kept = pose.iter().flat_map(|p| &p.agreeing);
        // Where the body hardly turned, a jump along a ray's line is no less one.
        let ways: Vec<f64> = common.iter().map(|(_, a, b)| (b - a).norm()).collect();
        let mut sorted = ways.clone();
        sorted.sort_by(f64::total_cmp);
        let usual = sorted.get(sorted.len() / 2).copied().unwrap_or_default();
        let farthest = FARTHEST * usual + 12.0 * noise;
        (common.iter().zip(kept).zip(&ways))
            .filter(|((_, agrees), way)| **agrees && **way < farthest)
            .map(|(((track, ..), _), _)| *track)
            .collect()
    };
    let count = frames.list.len();
    let next: Vec<Vec<usize>> = (0..count - 1).map(|i| agreeing(i, i + 1)).collect();
    let mut cuts = Vec::new();
    for i in 0..count.saturating_sub(2) {
        let suspects: Vec<usize> = (frames.common(i, i + 1).iter())
            .map(|(track, ..)| *track)
            .filter(|t| !next[i].contains(t) && next[i + 1].contains(t))
            .collect();
        if suspects.is_empty() {
            continue;
        }
        let past = agreeing(i, i + 2);
        let reborn = suspects.into_iter().filter(|t| !past.contains(t));
        cuts.extend(reborn.map(|track| (i + 1, track)));
    }
    for (from, track) in &cuts {
        // What was before gets the new number, and of that the next cut finds nothing left.
        let fresh = frames.ids.len();
        frames.ids.push(frames.ids[*track]);
        for frame in &mut frames.list[..*from] {
            for observation in frame.observations.iter_mut().filter(|s| s.track == *track) {
                observation.track = fresh;
            }
            frame.observations.sort_by_key(|s| s.track);
        }
    }
    cuts.len()
}
