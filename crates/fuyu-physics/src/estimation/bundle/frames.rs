//! Tracks in the form that the solver uses: numbered tracks, pixels relative to the principal point, camera attitudes.

use std::collections::HashMap;

use nalgebra::{UnitQuaternion, Vector2, Vector3};

use super::relative_pose::Pair;
use crate::estimation::Tracks;
use crate::vision::Pinhole;

/// Observation of a track in a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Observation {
    /// Number of the track, by first appearance.
    pub track: usize,
    /// Image point relative to the principal point \[px\].
    pub pixel: Vector2<f64>,
    /// Whether the observation agrees with the structure so far.
    pub inlier: bool,
}

/// One frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// Time \[s\].
    pub time: f64,
    /// The camera's axes in inertial axes.
    pub R_WC: UnitQuaternion<f64>,
    /// Its observations, by ascending track.
    pub observations: Vec<Observation>,
}

/// All frames, with track ids and focal lengths.
#[derive(Debug, Clone, PartialEq)]
pub struct Frames {
    /// In the order of time.
    pub list: Vec<Frame>,
    /// The id of each track.
    pub ids: Vec<u64>,
    /// Focal lengths \[px\].
    pub focal: Vector2<f64>,
}

impl Frames {
    /// The frames of `tracks` with the camera's attitude `R_WC(t)`. Each frame keeps at most `most` points, those of
    /// the longest tracks.
    pub fn new(
        tracks: &Tracks,
        camera: &Pinhole,
        most: usize,
        mut R_WC: impl FnMut(f64) -> UnitQuaternion<f64>,
    ) -> Self {
        let mut lengths = HashMap::<u64, usize>::new();
        for feature in tracks.frames().iter().flat_map(|s| &s.features) {
            *lengths.entry(feature.id).or_default() += 1;
        }
        let (mut numbers, mut ids) = (HashMap::<u64, usize>::new(), Vec::new());
        let mut list = Vec::with_capacity(tracks.frames().len());
        for sighting in tracks.frames() {
            let mut features: Vec<_> = sighting.features.iter().collect();
            if features.len() > most {
                features.sort_by_key(|f| (std::cmp::Reverse(lengths[&f.id]), f.id));
                features.truncate(most);
            }
            let mut observations = Vec::with_capacity(features.len());
            for feature in features {
                let track = *numbers.entry(feature.id).or_insert_with(|| {
                    ids.push(feature.id);
                    ids.len() - 1
                });
                let pixel = Vector2::new(feature.u - camera.cx, feature.v - camera.cy);
                let inlier = true;
                observations.push(Observation {
                    track,
                    pixel,
                    inlier,
                });
            }
            observations.sort_by_key(|s| s.track);
            list.push(Frame {
                time: sighting.time,
                R_WC: R_WC(sighting.time),
                observations,
            });
        }
        Self {
            list,
            ids,
            focal: Vector2::new(camera.fx, camera.fy),
        }
    }

    /// The inliers that frames `i` and `j` share: track, pixel in each.
    pub fn common(&self, i: usize, j: usize) -> Vec<(usize, Vector2<f64>, Vector2<f64>)> {
        let (a, b) = (&self.list[i].observations, &self.list[j].observations);
        let mut rest = b.iter().peekable();
        let mut both = Vec::with_capacity(a.len().min(b.len()));
        for s in a.iter().filter(|s| s.inlier) {
            while rest.next_if(|o| o.track < s.track).is_some() {}
            if let Some(o) = rest.peek().filter(|o| o.track == s.track && o.inlier) {
                both.push((s.track, s.pixel, o.pixel));
            }
        }
        both
    }

    /// The ray of an image point, scaled to z = 1.
    pub fn ray(&self, pixel: &Vector2<f64>) -> Vector3<f64> {
        Vector3::new(pixel.x / self.focal.x, pixel.y / self.focal.y, 1.0)
    }

    /// Rays of the points that frames `i` and `j` share.
    pub fn pairs(&self, i: usize, j: usize) -> Vec<Pair> {
        let both = self.common(i, j);
        let rays = both.iter().map(|(_, a, b)| (self.ray(a), self.ray(b)));
        rays.collect()
    }

    /// Change of the arrangement of the common points from `i` to `j`, relative to its size: about the angle turned
    /// \[rad\]. Common translation is removed. `None` with fewer than `least` points.
    pub fn change(&self, i: usize, j: usize, least: usize) -> Option<f64> {
        let both = self.common(i, j);
        if both.len() < least.max(1) {
            return None;
        }
        let count = both.len() as f64;
        let mean_a = both.iter().map(|b| b.1).sum::<Vector2<f64>>() / count;
        let mean_b = both.iter().map(|b| b.2).sum::<Vector2<f64>>() / count;
        let size = both.iter().map(|b| (b.1 - mean_a).norm()).sum::<f64>() / count;
        let mut moved: Vec<f64> = both
            .iter()
            .map(|b| ((b.2 - mean_b) - (b.1 - mean_a)).norm())
            .collect();
        let middle = moved.len() / 2;
        let median = *moved.select_nth_unstable_by(middle, f64::total_cmp).1;
        Some(median / size.max(f64::MIN_POSITIVE))
    }

    /// Angle of one pixel near the optical axis \[rad\].
    pub fn pixel_angle(&self) -> f64 {
        2.0 / (self.focal.x + self.focal.y)
    }
}
