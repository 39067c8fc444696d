//! Motion tracker: holds the last batch solution and the filter that continues it, and gives the motion at every frame.

use nalgebra::{UnitQuaternion, Vector3};

use super::bundle::CentreMotion;
use super::change_detector::ChangeDetector;
use super::{
    Disturbance, Estimated, EstimationMethod, MotionEstimate, MotionState,
    filter::{Filter, Update},
};
use crate::vision::FeatureFrame;

/// Number of consecutive contradicting frames after which the track of the motion is lost.
const MISFITS_FOR_LOSS: u32 = 10;

/// Number of fitting frames after which a solution is confirmed.
const FITS_FOR_CONFIRMATION: u32 = 20;

/// Least number of known points with which a frame can contradict the motion.
pub const MIN_KNOWN_POINTS: usize = 8;

/// A batch solution predicts for this fraction of its length; longer predictions may fail although the motion has not changed.
const PREDICTABLE: f64 = 0.25;

/// A filter is kept if its prediction is this many times more certain than that of a new batch solution.
const CERTAINTY_RATIO: f64 = 3.0;

/// A batch solution, and its window of frames.
#[derive(Debug, Clone)]
pub struct BatchSolution {
    /// The estimate.
    pub estimated: Estimated,
    /// Number of frames in the window.
    pub frames: usize,
    /// Time of the first and of the last frame of the window \[s\].
    pub span: (f64, f64),
}

/// Source of the current motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MotionSource {
    /// The last batch solution: there is no filter, or no frame has arrived since.
    Batch,
    /// The filter, corrected by the newest frame.
    Filter,
    /// Filter or batch solution, extrapolated since the last frame that corrected it.
    Coasting,
}

impl MotionSource {
    /// The name in diagnostics.
    pub fn name(self) -> &'static str {
        match self {
            Self::Batch => "batch",
            Self::Filter => "filter",
            Self::Coasting => "coasting",
        }
    }
}

/// The current motion: a batch solution, and a filter that continues it.
#[derive(Debug, Clone)]
pub struct MotionTracker {
    batch: BatchSolution,
    filter: Option<Filter>,
    motion: MotionEstimate,
    /// Rotation from body axes F, which persist from one solution to the next, to the body axes B of this solution.
    R_BF: UnitQuaternion<f64>,
    /// Time of the newest frame that corrected the motion \[s\].
    corrected: f64,
    /// Number of frames since the batch solution.
    since: usize,
    last: Option<Update>,
    /// Number of fitting frames, including those of earlier solutions.
    fits: u32,
    misfits: Misfits,
    changes: ChangeDetector,
}

/// Why the track of the motion was lost.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum TrackLoss {
    /// The motion was confirmed by frames, and has changed since this time \[s\].
    MotionChanged(f64),
    /// Too few frames confirmed the motion, or the prediction was too long: the batch solution may be wrong or too short.
    Unconfirmed,
}

/// Consecutive frames that do not fit.
#[derive(Debug, Clone, Copy, Default)]
struct Misfits {
    count: u32,
    /// Time of the first such frame \[s\].
    since: f64,
}

impl MotionTracker {
    /// Starts at a batch solution and updates it with the frames `later`, each with the camera's attitude. If `disturbance` is given (see
    /// [`Filter::new`]) and the solution is of bundle adjustment, a filter continues it.
    pub fn new<'a>(
        batch: BatchSolution,
        disturbance: Option<f64>,
        later: impl Iterator<Item = (&'a FeatureFrame, UnitQuaternion<f64>)>,
    ) -> Self {
        let solution = batch.estimated.solution.as_ref();
        let filter = disturbance
            .zip(solution)
            .and_then(|(disturbance, solution)| Filter::new(solution, disturbance));
        let mut tracker = Self {
            motion: batch.estimated.motion.clone(),
            corrected: batch.span.1,
            batch,
            filter,
            R_BF: UnitQuaternion::identity(),
            since: 0,
            last: None,
            fits: 0,
            misfits: Misfits::default(),
            changes: ChangeDetector::new(0.0),
        };
        tracker.changes = ChangeDetector::new(tracker.batch.span.1);
        for (frame, R_IC) in later {
            tracker.update(frame, &R_IC);
        }
        tracker
    }

    /// Replaces this tracker by `next` at `time` \[s\], and keeps the persistent body axes. Keeps this tracker if the prediction of
    /// `next` over `horizon` \[s\] is much less certain (few frames since a gap, for example).
    #[must_use]
    pub fn replaced_by(self, mut next: Self, time: f64, horizon: f64) -> Self {
        let deviation =
            |tracker: &Self| Some(tracker.filter.as_ref()?.prediction_deviation(horizon));
        if let (Some(ours), Some(theirs)) = (deviation(&self), deviation(&next))
            && self.misfits.count == 0
            && ours * CERTAINTY_RATIO < theirs
        {
            return self;
        }
        if self.misfits.count == 0 {
            next.fits = next.fits.saturating_add(self.fits);
        } else if next.misfits.count > 0 {
            // The new solution does not fit the newest frames either: keep the count.
            next.misfits.since = next.misfits.since.min(self.misfits.since);
            next.misfits.count = next.misfits.count.max(self.misfits.count);
            next.fits = next.fits.max(self.fits);
        }
        next.changes.inherit(&self.changes);
        next.R_BF = next.motion.attitude(time).inverse() * self.motion.attitude(time) * self.R_BF;
        next
    }

    /// Updates the motion with a frame later than all before, and the camera's attitude. Returns the loss if several consecutive frames
    /// contradict the motion.
    pub fn update(
        &mut self,
        frame: &FeatureFrame,
        R_IC: &UnitQuaternion<f64>,
    ) -> Option<TrackLoss> {
        self.since += 1;
        let Some(filter) = &mut self.filter else {
            if !frame.features.is_empty() {
                self.corrected = frame.time;
            }
            return None;
        };
        if frame.time <= filter.time() {
            return None;
        }
        let update = filter.update(frame, R_IC);
        self.last = Some(update);
        // A frame that corrects nothing leaves the motion as it is.
        if update.used > 0 {
            self.corrected = frame.time;
            if let Some(motion) = filter.estimate() {
                self.motion = motion;
            }
        }
        let known = update.used + update.rejected;
        if known < MIN_KNOWN_POINTS {
            return None;
        }
        if 2 * update.used >= known {
            self.misfits.count = 0;
            self.fits = self.fits.saturating_add(1);
            // If most points are new, the known ones are about to vanish at the limb; errors of their positions are then large, and
            // common to all frames.
            if update.used < update.unknown {
                return None;
            }
            let changed = self.changes.add(frame.time, &update.innovation)?;
            // Soon after a short batch, a slowly growing error is an error of the batch solution, not a change of the motion.
            if self.is_beyond_prediction(frame.time) {
                self.changes = ChangeDetector::new(frame.time);
                return None;
            }
            return (self.fits >= FITS_FOR_CONFIRMATION)
                .then_some(TrackLoss::MotionChanged(changed));
        }
        if self.misfits.count == 0 {
            self.misfits.since = frame.time;
        }
        self.misfits.count += 1;
        let is_confirmed =
            self.fits >= FITS_FOR_CONFIRMATION && !self.is_beyond_prediction(self.misfits.since);
        let loss = match is_confirmed {
            true => TrackLoss::MotionChanged(self.misfits.since),
            false => TrackLoss::Unconfirmed,
        };
        (self.misfits.count >= MISFITS_FOR_LOSS).then_some(loss)
    }

    /// Whether `time` \[s\], since when the frames contradict the motion, is after the batch by more than [`PREDICTABLE`] of its length.
    /// So long a prediction, while a slow computer solves the next batch, fails without a change of the motion.
    fn is_beyond_prediction(&self, time: f64) -> bool {
        let (first, last) = self.batch.span;
        time - last > PREDICTABLE * (last - first)
    }

    /// The motion, in inertial axes.
    pub fn motion(&self) -> &MotionEstimate {
        &self.motion
    }

    /// The state with its covariance, propagated to `time` \[s\]; `None` if the method has none.
    pub fn state(&self, time: f64) -> Option<MotionState> {
        let known = match &self.filter {
            Some(filter) => Some(filter.state()),
            None => self.batch.estimated.state.as_ref(),
        };
        let mut state = known?.clone();
        if time > state.motion.time {
            state.predict(time, &Disturbance::NONE);
        }
        Some(state)
    }

    /// Position of the body's origin at `time` \[s\] in camera axes, in the batch solution's unit of length: the extrapolated centre of
    /// mass if its path is known, otherwise the position in the last frame of the batch. `None` if the method gives no position.
    pub fn position(&self, time: f64) -> Option<Vector3<f64>> {
        let solution = self.batch.estimated.solution.as_ref()?;
        match self.centre(time) {
            Some(centre) => Some(centre.position),
            None => solution.poses.last().map(|pose| pose.t_C),
        }
    }

    /// The centre of mass at `time` \[s\], in the batch solution's unit of length. `None` if the images do not determine which point of
    /// the body it is.
    pub fn centre(&self, time: f64) -> Option<CentreMotion> {
        let centre = self.batch.estimated.solution.as_ref()?.centre.as_ref()?;
        Some(centre.after(time - self.batch.span.1))
    }

    /// Rotation from the persistent body axes F to the body axes of [`MotionTracker::motion`].
    pub fn R_BF(&self) -> UnitQuaternion<f64> {
        self.R_BF
    }

    /// Method of the batch solution.
    pub fn method(&self) -> EstimationMethod {
        self.batch.estimated.method
    }

    /// The batch solution.
    pub fn batch(&self) -> &BatchSolution {
        &self.batch
    }

    /// Source of the motion at `time` \[s\].
    pub fn source(&self, time: f64) -> MotionSource {
        match self.last {
            _ if time > self.corrected => MotionSource::Coasting,
            Some(_) => MotionSource::Filter,
            None => MotionSource::Batch,
        }
    }

    /// Time of the newest frame that corrected the motion \[s\].
    pub fn corrected(&self) -> f64 {
        self.corrected
    }

    /// Number of frames that the motion is estimated from.
    pub fn frames(&self) -> usize {
        self.batch.frames + self.since
    }

    /// Contribution of the newest frame to the filter, if there is one.
    pub fn last_update(&self) -> Option<&Update> {
        self.last.as_ref()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        estimation::{Tracks, bundle, estimate, free_body::FreeRotation},
        spatial::Pose,
        vision::{BodyPoint, Feature, FeatureCamera, FeatureCameraConfig, Pinhole},
    };
    use nalgebra::{Matrix3, Translation3};

    fn truth() -> FreeRotation {
        let inertia = Matrix3::from_diagonal(&Vector3::new(7.0, 4.0, 3.0));
        let rate = Vector3::new(0.1, 0.35, 0.2);
        FreeRotation::new(&inertia, UnitQuaternion::identity(), &rate, 0.0).unwrap()
    }

    /// Frames of a tumbling ball, 10 a second.
    fn frames(range: std::ops::Range<u32>) -> Vec<FeatureFrame> {
        let motion = truth();
        let config = FeatureCameraConfig {
            quantised: true,
            ..FeatureCameraConfig::ideal(1024, 1.25)
        };
        let mut camera = FeatureCamera::new(config, BodyPoint::on_sphere(20, 0.45, 5));
        let frame = |k: u32| {
            let time = 0.1 * f64::from(k);
            let R_CB = motion.attitude(time).to_rotation_matrix();
            let X_CB = Pose::from_parts(Translation3::new(0.0, 0.0, 0.9), R_CB);
            camera.show(time, &X_CB);
            camera.deliver(time).unwrap()
        };
        range.map(frame).collect()
    }

    /// A tracker from a batch of the first frames and a filter through the later ones.
    fn tracker_from(first: Vec<FeatureFrame>, later: &[FeatureFrame]) -> MotionTracker {
        let tracks = Tracks::new(first).unwrap();
        let camera = Pinhole::square(1024, 1.25);
        let options = bundle::Options::default();
        let batch = BatchSolution {
            estimated: estimate(EstimationMethod::Bundle, &tracks, &camera, &options).unwrap(),
            frames: tracks.frames().len(),
            span: tracks.span().unwrap(),
        };
        let still = later.iter().map(|f| (f, UnitQuaternion::identity()));
        MotionTracker::new(batch, Some(1e-6), still)
    }

    // A follower of a point on the target must not see a jump when a solution replaces another.
    #[test]
    fn body_axes_persist_from_one_solution_to_the_next() {
        let first = tracker_from(frames(0..150), &frames(150..200));
        let next = tracker_from(frames(60..200), &[]);
        let attitude =
            |tracker: &MotionTracker, t: f64| tracker.motion().attitude(t) * tracker.R_BF();
        let before = attitude(&first, 30.0);
        assert!(
            attitude(&next, 30.0).angle_to(&before) > 0.01,
            "each solution has axes of its own"
        );
        let kept = first.replaced_by(next, 19.9, 30.0);
        assert_eq!(kept.batch().frames, 140);
        let after = attitude(&kept, 30.0);
        assert!(
            after.angle_to(&before) < 2e-3,
            "{}",
            after.angle_to(&before)
        );
    }

    #[test]
    fn a_much_less_certain_batch_does_not_replace_the_filter() {
        let later = frames(500..515);
        let long = tracker_from(frames(0..300), &later);
        let short = tracker_from(later, &[]);
        assert_eq!(
            (long.source(51.4), long.source(52.0)),
            (MotionSource::Filter, MotionSource::Coasting)
        );
        assert_eq!(short.source(51.4), MotionSource::Batch);
        assert_eq!(
            long.clone()
                .replaced_by(short.clone(), 51.4, 30.0)
                .batch()
                .frames,
            300
        );
        assert_eq!(short.replaced_by(long, 51.4, 30.0).batch().frames, 300);
    }

    /// Frame after which a jump at 15 s is detected, and the loss reported.
    fn detect_jump(tracker: &mut MotionTracker) -> Option<(u32, TrackLoss)> {
        (0..).zip(frames(300..330)).find_map(|(k, mut frame)| {
            frame.time = 15.0 + 0.1 * f64::from(k);
            let loss = tracker.update(&frame, &UnitQuaternion::identity());
            loss.map(|loss| (k, loss))
        })
    }

    #[test]
    fn a_jump_of_the_body_is_detected_after_ten_frames() {
        let mut fresh = fresh_at_15();
        assert_eq!(detect_jump(&mut fresh), Some((9, TrackLoss::Unconfirmed)));
        let mut confirmed = tracker_from(frames(0..130), &frames(130..150));
        assert_eq!(
            detect_jump(&mut confirmed),
            Some((9, TrackLoss::MotionChanged(15.0)))
        );
        // A confirmation persists to the next solution.
        let mut renewed =
            tracker_from(frames(0..130), &frames(130..150)).replaced_by(fresh_at_15(), 14.9, 30.0);
        assert_eq!(
            detect_jump(&mut renewed),
            Some((9, TrackLoss::MotionChanged(15.0)))
        );
    }

    /// The points of tracked images slide where shadows and edges move, as residuals show. Fails if the filter assumes the noise of the
    /// batch.
    #[test]
    fn points_that_slide_are_not_a_change_of_the_motion() {
        let mut tracker = tracker_from(frames(0..150), &[]);
        for (k, mut frame) in (0..30).zip(frames(150..180)) {
            frame.features.truncate(9);
            for feature in &mut frame.features {
                let direction = 2.4 * feature.id as f64;
                feature.u += 0.03 * f64::from(k) * direction.cos();
                feature.v += 0.03 * f64::from(k) * direction.sin();
            }
            let loss = tracker.update(&frame, &UnitQuaternion::identity());
            assert_eq!(loss, None, "frame {k}");
        }
        let misfits = tracker.misfits.count;
        assert_eq!(misfits, 0, "the points pass the gate");
    }

    /// The last known points of a side that turns away have a common error. Fails if they count as evidence of a change although most
    /// points are new.
    #[test]
    fn a_minority_of_known_points_is_no_evidence_of_a_change() {
        let losses = [9, 16].map(|known| {
            let mut tracker = tracker_from(frames(0..150), &[]);
            (0..30).zip(frames(150..180)).find_map(|(k, mut frame)| {
                for feature in frame.features.iter_mut().skip(known) {
                    feature.id += 1000;
                }
                // The body turns about the optical axis, in addition.
                let angle = 2e-4 * f64::from(k);
                for feature in &mut frame.features {
                    let [u, v] = [feature.u - 511.5, feature.v - 511.5];
                    feature.u -= angle * v;
                    feature.v += angle * u;
                }
                tracker.update(&frame, &UnitQuaternion::identity())
            })
        });
        assert_eq!(losses[0], None);
        assert!(losses[1].is_some(), "most points know of a change");
    }

    /// A prediction beyond a quarter of the batch may fail by itself, as in a replay faster than its batches. Fails with half of the
    /// length.
    #[test]
    fn a_batch_is_evidence_of_a_change_for_a_quarter_of_its_length() {
        let later = frames(100..150);
        let after = |batch: u32| {
            let first = frames(batch - 100..batch);
            let mut tracker = tracker_from(first, &later[(batch as usize - 100)..]);
            tracker.fits = FITS_FOR_CONFIRMATION;
            detect_jump(&mut tracker).map(|(_, loss)| loss)
        };
        // Batches of 10 s that end 1.1 s and 3.1 s before the jump.
        assert_eq!(after(140), Some(TrackLoss::MotionChanged(15.0)));
        assert_eq!(after(120), Some(TrackLoss::Unconfirmed));
    }

    // A batch of 2 s predicts for 2 s. Fails if a later misfit ended the window of frames.
    #[test]
    fn a_short_batch_is_no_evidence_of_a_change_long_after_it() {
        let later = frames(20..150);
        let mut short = tracker_from(frames(0..20), &later[..70]);
        short.fits = FITS_FOR_CONFIRMATION;
        short.misfits = Misfits::default();
        assert_eq!(
            detect_jump(&mut short).map(|(_, loss)| loss),
            Some(TrackLoss::Unconfirmed)
        );
    }

    fn fresh_at_15() -> MotionTracker {
        tracker_from(frames(0..150), &[])
    }

    /// Frames in which the first `points` points have each other's ids, shifted by one.
    fn with_shifted_ids(frames: Vec<FeatureFrame>, points: u64) -> Vec<FeatureFrame> {
        let shifted = |id: u64| if id < points { (id + 1) % points } else { id };
        with_ids(frames, |_, id| shifted(id))
    }

    /// Frames with the ids that `other` gives for the frame's index and the id.
    fn with_ids(frames: Vec<FeatureFrame>, other: impl Fn(u64, u64) -> u64) -> Vec<FeatureFrame> {
        let renamed = |(k, frame): (u64, FeatureFrame)| {
            let features = frame.features.iter().map(|f| Feature {
                id: other(k, f.id),
                ..*f
            });
            FeatureFrame::new(frame.time, features.collect())
        };
        (0..).zip(frames).map(renamed).collect()
    }

    /// Error of the rotation from one time to another \[s\], \[rad\].
    fn rotation_error(tracker: &MotionTracker, from: f64, to: f64) -> f64 {
        let motion = tracker.motion();
        let estimated = motion.attitude(to) / motion.attitude(from);
        let truth = truth();
        estimated.angle_to(&(truth.attitude(to) / truth.attitude(from)))
    }

    fn update_all(
        tracker: &mut MotionTracker,
        frames: &[FeatureFrame],
    ) -> Option<(usize, TrackLoss)> {
        let mut losses = frames.iter().enumerate().filter_map(|(k, frame)| {
            let loss = tracker.update(frame, &UnitQuaternion::identity());
            loss.map(|loss| (k, loss))
        });
        losses.next()
    }

    // Fewer than half of the points: the others still determine the motion, and the wrong ones do not disturb it.
    #[test]
    fn a_few_ids_given_to_other_points_are_rejected() {
        let mut tracker = tracker_from(frames(0..130), &frames(130..150));
        let frames = with_shifted_ids(frames(150..350), 6);
        assert_eq!(update_all(&mut tracker, &frames), None);
        let last = *tracker.last_update().unwrap();
        assert_eq!((last.used, last.rejected), (14, 6));
        assert_eq!(tracker.source(34.9), MotionSource::Filter);
        let error = rotation_error(&tracker, 34.9, 64.9);
        assert!(error < 3e-3, "{error}");
    }

    // A feature tracker that gives every id to another point, once or in every frame. No frame may change the motion,
    // and after the tenth the earlier tracks are given up; the later ones are a window of their own.
    #[test]
    fn when_every_id_is_given_to_another_point_the_motion_is_kept_and_then_lost() {
        let before = tracker_from(frames(0..130), &frames(130..150));
        let once = with_shifted_ids(frames(150..350), 20);
        let always = with_ids(frames(150..350), |k, id| (id + 1 + k % 19) % 20);
        for wrong in [&once, &always] {
            let mut kept = before.clone();
            assert_eq!(update_all(&mut kept, &wrong[..9]), None);
            assert_eq!(kept.source(15.8), MotionSource::Coasting);
            assert_eq!(kept.corrected(), 14.9);
            // The same as without those frames.
            let [without, with] = [&before, &kept].map(|b| rotation_error(b, 14.9, 44.9));
            assert!(
                with < 3e-3 && (with - without).abs() < 1e-9,
                "{with} {without}"
            );
            let loss = update_all(&mut kept, &wrong[9..]);
            assert_eq!(loss, Some((0, TrackLoss::MotionChanged(15.0))));
        }
        let mut tracks = Tracks::new([frames(0..150), once].concat()).unwrap();
        tracks.forget_before(15.0);
        let restarted = tracker_from(tracks.frames().to_vec(), &[]);
        assert_eq!(restarted.frames(), 200);
        let error = rotation_error(&restarted, 34.9, 64.9);
        assert!(error < 3e-3, "{error}");
    }

    // The same with a motion that no frame has confirmed yet: the solution is taken to be wrong.
    #[test]
    fn ids_given_to_other_points_refute_an_unconfirmed_solution() {
        let mut fresh = fresh_at_15();
        let wrong = with_shifted_ids(frames(150..160), 20);
        assert_eq!(
            update_all(&mut fresh, &wrong),
            Some((9, TrackLoss::Unconfirmed))
        );
    }

    // A feature tracker that restarts gives new ids. These do not contradict the motion, which is extrapolated until
    // the next batch has the new points; body axes persist.
    #[test]
    fn new_ids_leave_the_motion_unchanged_until_the_next_batch() {
        let mut old = tracker_from(frames(0..130), &frames(130..150));
        let new = with_ids(frames(150..250), |_, id| id + 100);
        assert_eq!(update_all(&mut old, &new), None);
        let last = *old.last_update().unwrap();
        assert_eq!((last.used, last.rejected, last.unknown), (0, 0, 20));
        assert_eq!(old.source(24.9), MotionSource::Coasting);
        let before = rotation_error(&old, 24.9, 54.9);
        assert!(before < 3e-3, "{before}");
        let next = tracker_from([frames(0..150), new[..60].to_vec()].concat(), &new[60..]);
        assert_eq!(next.source(24.9), MotionSource::Filter);
        let seam = |b: &MotionTracker| b.motion().attitude(24.9) * b.R_BF();
        let was = seam(&old);
        let renewed = old.replaced_by(next, 24.9, 30.0);
        assert!(seam(&renewed).angle_to(&was) < 1e-9);
        assert_eq!(renewed.last_update().unwrap().used, 20);
        let after = rotation_error(&renewed, 24.9, 54.9);
        assert!(after < 3e-3, "{after}");
    }
}
