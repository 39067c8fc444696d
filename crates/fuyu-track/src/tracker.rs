//! Tracks from frame to frame.

use std::collections::VecDeque;

use image::GrayImage;
use nalgebra::{DMatrix, Matrix2, Vector2};
use optical_flow_lk::{TrackOptions, TrackParams, TrackStatus, TrackerContext};

use crate::{
    Image, Settings, SettingsError,
    corners::Finder,
    patch::{Patch, Pixels},
    region::Region,
    rigid,
};

/// Iterations of Lucas-Kanade tracking at a level.
const ITERATIONS: usize = 20;
/// From a prediction of the position, two levels of the pyramid are enough; what they do not find is searched for on all.
const NEAR: TrackOptions = TrackOptions::new().with_start_level(1).with_fb_levels(1);
/// Largest distance between tracking from the last frame and alignment with the first sight \[px\].
const LARGEST_DRIFT: f64 = 1.5;
/// Scales of a patch beyond which its present appearance becomes the reference.
const SCALES: [f64; 2] = [0.7, 1.4];
/// Most frames that represent the window of the test of rigid motion.
const RIGID_SAMPLES: usize = 8;
/// Fewest frames over which rigid motion is tested.
const SHORT_WINDOW: usize = 6;
/// Frames in which a point may deviate from rigid motion before it ends.
const STRIKES: u32 = 2;
/// Fraction of all points that may be missing before new ones are searched for in every frame.
const ROOM: f64 = 0.1;
/// Frames between searches if fewer are missing.
const SEARCH_INTERVAL: u64 = 5;

/// A point in an image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Feature {
    /// Identity, which no other point gets, also not after the loss of this one.
    pub id: u32,
    /// Column \[px\].
    pub u: f64,
    /// Row \[px\].
    pub v: f64,
    /// Frames since its first sight, with this one.
    pub frames: u32,
}

/// Points that have ended since the tracker was made, by reason.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Losses {
    /// Not found in the next frame, or not found again backward.
    pub unmatched: u64,
    /// Looked different from their first sight.
    pub appearance: u64,
    /// Came to the edge of the target, or out of the mask.
    pub edge: u64,
    /// Did not move with the others as one rigid body.
    pub motion: u64,
    /// Met another point.
    pub merged: u64,
    /// The size of the images changed.
    pub resized: u64,
}

/// Why a frame cannot be used. The tracker stays as it was.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TrackError {
    /// The frame is not later than the one before.
    #[error("the frame's time is {time} s; it must be finite and later than {last} s")]
    Time {
        /// Of this frame.
        time: f64,
        /// Of the last one; minus infinity if there is none.
        last: f64,
    },
    /// Image and mask are not of the same size.
    #[error("the mask is {0} x {1} px; it must be {2} x {3} px, as the image is")]
    MaskSize(usize, usize, usize, usize),
}

struct Track {
    id: u32,
    position: Vector2<f64>,
    /// \[px/s\]
    velocity: Vector2<f64>,
    patch: Patch,
    shape: Matrix2<f64>,
    /// The last positions, this frame's last.
    history: VecDeque<Vector2<f64>>,
    frames: u32,
    strikes: u32,
    /// Whether it has ever been found to move with the others.
    verified: bool,
    /// Whether it has in this frame. Points that are too few to be tested may have begun to slide.
    passed: bool,
}

/// Tracks points of a body from image to image.
pub struct Tracker {
    settings: Settings,
    flow: TrackerContext,
    finder: Finder,
    region: Region,
    image: GrayImage,
    tracks: Vec<Track>,
    next_id: Option<u32>,
    last: Option<f64>,
    frames: u64,
    losses: Losses,
    scratch: Vec<f32>,
    points: Vec<(f32, f32)>,
    predicted: Vec<(f32, f32)>,
}

impl Tracker {
    /// A tracker without points.
    ///
    /// # Errors
    /// [`SettingsError`] for a setting that is out of range.
    pub fn new(settings: Settings) -> Result<Self, SettingsError> {
        settings.check()?;
        Ok(Self {
            settings,
            flow: TrackerContext::new(),
            finder: Finder::default(),
            region: Region::default(),
            image: GrayImage::default(),
            tracks: Vec::new(),
            next_id: Some(0),
            last: None,
            frames: 0,
            losses: Losses::default(),
            scratch: Vec::new(),
            points: Vec::new(),
            predicted: Vec::new(),
        })
    }

    /// Settings that it was made with.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Points that have ended, by reason.
    pub fn losses(&self) -> Losses {
        self.losses
    }

    /// Forgets all points and the time of the last frame. Ids are not used again.
    pub fn restart(&mut self) {
        self.tracks.clear();
        self.last = None;
    }

    /// Tracks into the image of a later `time` \[s\] and gives the points in it, in order of their ids. What is not 0 in
    /// `mask` is the target; without a mask, [`Settings::target`] says what is. Points end when the size of the images changes.
    ///
    /// # Errors
    /// [`TrackError`] for a frame that cannot be used.
    pub fn track(
        &mut self,
        time: f64,
        image: Image<'_>,
        mask: Option<Image<'_>>,
    ) -> Result<Vec<Feature>, TrackError> {
        let last = self.last.unwrap_or(f64::NEG_INFINITY);
        if !(time.is_finite() && time > last) {
            return Err(TrackError::Time { time, last });
        }
        let (width, height) = (image.width(), image.height());
        if let Some(mask) = &mask
            && (mask.width(), mask.height()) != (width, height)
        {
            let (w, h) = (mask.width(), mask.height());
            return Err(TrackError::MaskSize(w, h, width, height));
        }
        let centre = self.region.bounds();
        match &mask {
            Some(mask) => self.region.set_mask(mask),
            None => self.region.set_target(&image, self.settings.target),
        }
        self.take_image(&image);
        if self.frames > 0 && self.last.is_some() {
            let shift = shift(centre, self.region.bounds());
            self.follow(time - last, shift);
        }
        self.end_at_edges();
        self.end_merged();
        self.end_loose();
        self.add_points();
        self.last = Some(time);
        self.frames += 1;
        let confirmed = (self.tracks.iter())
            .filter(|t| t.passed && t.frames as usize >= self.settings.confirmation);
        let features = confirmed.map(|track| Feature {
            id: track.id,
            u: track.position.x,
            v: track.position.y,
            frames: track.frames,
        });
        Ok(features.collect())
    }

    /// Copies the image and builds its pyramid.
    fn take_image(&mut self, image: &Image<'_>) {
        let (width, height) = (image.width() as u32, image.height() as u32);
        if self.image.dimensions() != (width, height) {
            self.losses.resized += self.tracks.len() as u64;
            self.tracks.clear();
            self.image = GrayImage::new(width, height);
        }
        let rows = self.image.chunks_exact_mut(image.width());
        for (v, row) in rows.enumerate() {
            row.copy_from_slice(image.row(v));
        }
        self.flow.advance(&self.image, self.settings.levels);
    }

    /// Finds the points again, `interval` \[s\] after the last frame. `shift` \[px\] is how far the target as a whole seems to have moved.
    fn follow(&mut self, interval: f64, shift: Vector2<f64>) {
        let single = |p: Vector2<f64>| (p.x as f32, p.y as f32);
        self.points.clear();
        self.predicted.clear();
        for track in &self.tracks {
            self.points.push(single(track.position));
            let ahead = track.position + track.velocity * interval;
            self.predicted.push(single(ahead));
        }
        let mut found = self.flow_to_image(NEAR);
        // Points that have only just begun, or that turned elsewhere than their past told: as their neighbours do.
        let missing: Vec<usize> = (0..found.len()).filter(|i| found[*i].is_none()).collect();
        if !missing.is_empty() {
            let moved: Vec<_> = (self.tracks.iter().zip(&found))
                .filter_map(|(track, found)| found.map(|p| (track.position, p - track.position)))
                .collect();
            self.points.clear();
            self.predicted.clear();
            for i in &missing {
                let position = self.tracks[*i].position;
                let distance = |p: &Vector2<f64>| (p - position).norm_squared();
                let nearest =
                    (moved.iter()).min_by(|a, b| distance(&a.0).total_cmp(&distance(&b.0)));
                let step = nearest.map_or(shift, |(_, step)| *step);
                self.points.push(single(position));
                self.predicted.push(single(position + step));
            }
            let again = self.flow_to_image(TrackOptions::new());
            for (i, position) in missing.into_iter().zip(again) {
                found[i] = position;
            }
        }
        let mut found = found.into_iter();
        let pixels = Pixels {
            data: self.image.as_raw(),
            width: self.image.width() as usize,
            height: self.image.height() as usize,
        };
        let (settings, losses) = (&self.settings, &mut self.losses);
        let scratch = &mut self.scratch;
        self.tracks.retain_mut(|track| {
            let Some(position) = found.next().flatten() else {
                losses.unmatched += 1;
                return false;
            };
            let aligned = track.patch.align(pixels, position, track.shape, scratch);
            let Some(aligned) = aligned.filter(|a| {
                a.similarity >= settings.similarity
                    && (a.position - position).norm() <= LARGEST_DRIFT
            }) else {
                losses.appearance += 1;
                return false;
            };
            track.velocity = (aligned.position - track.position) / interval;
            track.position = aligned.position;
            track.shape = aligned.shape;
            track.frames = track.frames.saturating_add(1);
            track.history.push_back(track.position);
            if track.history.len() > settings.rigid_frames.max(1) {
                track.history.pop_front();
            }
            let scales = track.shape.singular_values();
            if !(scales.min() >= SCALES[0] && scales.max() <= SCALES[1]) {
                let Some(patch) = Patch::new(pixels, track.position, settings.window / 2) else {
                    losses.appearance += 1;
                    return false;
                };
                (track.patch, track.shape) = (patch, Matrix2::identity());
            }
            true
        });
    }

    /// Where the points are in the new image, from where they are predicted to be; `None` for those not found forward and backward.
    fn flow_to_image(&mut self, options: TrackOptions) -> Vec<Option<Vector2<f64>>> {
        let params = TrackParams {
            window_size: self.settings.window,
            max_iterations: ITERATIONS,
            min_eigen_threshold: 1e-2,
        };
        let backward = self.settings.backward as f32;
        let results = (self.flow).track_fb_with(
            &self.points,
            Some(&self.predicted),
            params,
            backward,
            options,
        );
        let positions = results.iter().map(|result| {
            let p = Vector2::new(f64::from(result.pos.0), f64::from(result.pos.1));
            (result.status == TrackStatus::Tracked && p.iter().all(|x| x.is_finite())).then_some(p)
        });
        positions.collect()
    }

    fn end_at_edges(&mut self) {
        let (region, margin) = (&self.region, self.settings.margin);
        let before = self.tracks.len();
        (self.tracks).retain(|track| region.contains(track.position.x, track.position.y, margin));
        self.losses.edge += (before - self.tracks.len()) as u64;
    }

    /// Ends the younger one of two points that have come together.
    fn end_merged(&mut self) {
        let closest = (0.4 * self.settings.spacing).powi(2);
        let mut kept: Vec<Vector2<f64>> = Vec::with_capacity(self.tracks.len());
        let before = self.tracks.len();
        // They are in order of their ids.
        self.tracks.retain(|track| {
            let near = |q: &Vector2<f64>| (track.position - q).norm_squared() < closest;
            let merged = kept.iter().any(near);
            if !merged {
                kept.push(track.position);
            }
            !merged
        });
        self.losses.merged += (before - self.tracks.len()) as u64;
    }

    /// Ends the points that do not move with the others: over the whole window, in which slow ones are found, and over a short one,
    /// in which fast ones are found before they are reported.
    fn end_loose(&mut self) {
        let whole = self.settings.rigid_frames;
        if whole == 0 {
            return;
        }
        let limit = self.settings.rigid_error;
        let mut worst: Vec<Option<f64>> = vec![None; self.tracks.len()];
        let short = self.settings.confirmation.max(SHORT_WINDOW);
        let windows = [whole, short];
        // The short one is only of use if it is shorter.
        for window in &windows[..1 + usize::from(short < whole)] {
            let window = *window;
            let old: Vec<usize> = (0..self.tracks.len())
                .filter(|i| self.tracks[*i].history.len() >= window)
                .collect();
            let samples = window.min(RIGID_SAMPLES);
            let frame = |k: usize| k * (window - 1) / (samples - 1).max(1);
            let columns = DMatrix::from_fn(2 * samples, old.len(), |row, i| {
                let history = &self.tracks[old[i]].history;
                history[history.len() - window + frame(row / 2)][row % 2]
            });
            let trusted: Vec<bool> = old.iter().map(|i| self.tracks[*i].verified).collect();
            let seed = self.frames;
            if let Some(deviations) = rigid::deviations(&columns, &trusted, limit, seed) {
                for (i, deviation) in old.into_iter().zip(deviations) {
                    worst[i] = Some(worst[i].unwrap_or(0.0).max(deviation));
                }
            }
        }
        for (track, deviation) in self.tracks.iter_mut().zip(worst) {
            track.strikes = match deviation {
                Some(d) if d > 2.0 * limit => STRIKES,
                Some(d) if d > limit => track.strikes + 1,
                _ => 0,
            };
            track.passed = deviation.is_some_and(|d| d <= limit);
            track.verified |= track.passed;
        }
        let before = self.tracks.len();
        self.tracks.retain(|track| track.strikes < STRIKES);
        self.losses.motion += (before - self.tracks.len()) as u64;
    }

    /// Begins new points where there is room.
    fn add_points(&mut self) {
        let most = self.settings.points;
        let room = most.saturating_sub(self.tracks.len());
        let urgent = room as f64 > ROOM * most as f64;
        let due = self.frames.is_multiple_of(SEARCH_INTERVAL);
        if room == 0 || !(due || urgent && self.frames.is_multiple_of(2)) {
            return;
        }
        let existing: Vec<_> = self.tracks.iter().map(|track| track.position).collect();
        let found = (self.finder).find(&self.image, &self.region, &existing, room, &self.settings);
        let pixels = Pixels {
            data: self.image.as_raw(),
            width: self.image.width() as usize,
            height: self.image.height() as usize,
        };
        let old = self.tracks.len();
        for position in found {
            let Some(patch) = Patch::new(pixels, position, self.settings.window / 2) else {
                continue;
            };
            let Some(id) = self.next_id else {
                // All four thousand million ids are used.
                return;
            };
            self.next_id = id.checked_add(1);
            let distance = |track: &&Track| (track.position - position).norm_squared();
            let nearest =
                (self.tracks[..old].iter()).min_by(|a, b| distance(a).total_cmp(&distance(b)));
            self.tracks.push(Track {
                id,
                position,
                velocity: nearest.map_or_else(Vector2::zeros, |track| track.velocity),
                patch,
                shape: Matrix2::identity(),
                history: VecDeque::from([position]),
                frames: 1,
                strikes: 0,
                verified: false,
                passed: self.settings.rigid_frames == 0,
            });
        }
    }
}

/// Between the middles of two boxes \[px\].
fn shift(before: Option<[usize; 4]>, now: Option<[usize; 4]>) -> Vector2<f64> {
    let middle = |b: [usize; 4]| Vector2::new((b[0] + b[1]) as f64, (b[2] + b[3]) as f64) / 2.0;
    match (before, now) {
        (Some(before), Some(now)) => middle(now) - middle(before),
        _ => Vector2::zeros(),
    }
}
