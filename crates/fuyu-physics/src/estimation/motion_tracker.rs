//! What is held to be the motion from frame to frame: the last batch solution, and the filter that carries it on.

use nalgebra::UnitQuaternion;

use crate::{
    estimation::{
        Estimated, Method, MotionEstimate,
        filter::{Filter, Update},
    },
    vision::Sighting,
};

/// After so many frames in a row that show the body where it cannot be, it moves otherwise than it did.
const MISFITS: u32 = 10;

/// So many frames that fit confirm a solution.
const CONFIRMED: u32 = 20;

/// Fewer known points than these do not tell that the body is elsewhere.
pub const TELLING: usize = 8;

/// A filter whose future is this many times more certain than that of a new batch solution is kept.
const SURER: f64 = 3.0;

/// A batch solution, and what it was found from.
#[derive(Debug, Clone)]
pub struct Batch {
    /// The solution.
    pub estimated: Estimated,
    /// Frames of its window.
    pub frames: usize,
    /// Time of the first and of the last of them \[s\].
    pub span: (f64, f64),
}

/// Where an answer comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Source {
    /// The last batch solution: there is no filter, or no frame since.
    Batch,
    /// The filter, corrected by the newest frame.
    Filter,
    /// Whichever there is, carried on without a frame that could correct it.
    Coasting,
}

impl Source {
    /// Its name in diagnostics.
    pub fn name(self) -> &'static str {
        match self {
            Self::Batch => "batch",
            Self::Filter => "filter",
            Self::Coasting => "coasting",
        }
    }
}

/// The present motion.
#[derive(Debug, Clone)]
pub struct Belief {
    batch: Batch,
    filter: Option<Filter>,
    motion: MotionEstimate,
    /// Axes F of the body that stay from one solution to the next, in those that this solution took.
    R_BF: UnitQuaternion<f64>,
    /// Time of the newest frame that told something \[s\].
    corrected: f64,
    /// Frames since the batch's.
    since: usize,
    last: Option<Update>,
    /// Frames that fitted, those of the solutions before included.
    fits: u32,
    misfits: Misfits,
}

/// Why frames no longer fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Loss {
    /// They did for long; since this time \[s\] the body moves otherwise.
    Pushed(f64),
    /// They never did: the batch solution is wrong.
    Unconfirmed,
}

/// Frames in a row that do not fit.
#[derive(Debug, Clone, Copy, Default)]
struct Misfits {
    count: u32,
    /// Time of the first \[s\].
    since: f64,
}

impl Belief {
    /// Starts at a batch solution. With `disturbance` ([`Filter::new`]) a filter carries it on through the frames
    /// `later`, each with the camera's attitude; only bundle adjustment can start one.
    pub fn new<'a>(
        batch: Batch,
        disturbance: Option<f64>,
        later: impl Iterator<Item = (&'a Sighting, UnitQuaternion<f64>)>,
    ) -> Self {
        let solution = batch.estimated.solution.as_ref();
        let filter = disturbance
            .zip(solution)
            .and_then(|(disturbance, solution)| Filter::new(solution, disturbance));
        let mut belief = Self {
            motion: batch.estimated.motion.clone(),
            corrected: batch.span.1,
            batch,
            filter,
            R_BF: UnitQuaternion::identity(),
            since: 0,
            last: None,
            fits: 0,
            misfits: Misfits::default(),
        };
        for (frame, R_IC) in later {
            belief.see(frame, &R_IC);
        }
        belief
    }

    /// The better of the two at `time` \[s\], judged by their next `horizon` seconds: `next`, in the axes of the
    /// body that this one has, unless it knows much less. It does where few frames have come since a gap.
    pub fn or(self, mut next: Self, time: f64, horizon: f64) -> Self {
        let foresight = |belief: &Self| Some(belief.filter.as_ref()?.foresight(horizon));
        if let (Some(ours), Some(theirs)) = (foresight(&self), foresight(&next))
            && self.misfits.count == 0
            && ours * SURER < theirs
        {
            return self;
        }
        if self.misfits.count == 0 {
            next.fits = next.fits.saturating_add(self.fits);
        }
        next.R_BF = next.motion.attitude(time).inverse() * self.motion.attitude(time) * self.R_BF;
        next
    }

    /// Takes in a frame, later than all before; tells if the body has not been where it should be for some frames.
    pub fn see(&mut self, frame: &Sighting, R_IC: &UnitQuaternion<f64>) -> Option<Loss> {
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
        if let Some(motion) = filter.estimate() {
            self.motion = motion;
        }
        self.last = Some(update);
        if update.used > 0 {
            self.corrected = frame.time;
        }
        let known = update.used + update.rejected;
        if known < TELLING {
            return None;
        }
        if 2 * update.used >= known {
            self.misfits.count = 0;
            self.fits = self.fits.saturating_add(1);
            return None;
        }
        if self.misfits.count == 0 {
            self.misfits.since = frame.time;
        }
        self.misfits.count += 1;
        let loss = match self.fits >= CONFIRMED {
            true => Loss::Pushed(self.misfits.since),
            false => Loss::Unconfirmed,
        };
        (self.misfits.count >= MISFITS).then_some(loss)
    }

    /// The motion, in the axes that are inertial.
    pub fn motion(&self) -> &MotionEstimate {
        &self.motion
    }

    /// The body's lasting axes F, in those of [`Belief::motion`].
    pub fn R_BF(&self) -> UnitQuaternion<f64> {
        self.R_BF
    }

    /// How the batch solution was found.
    pub fn method(&self) -> Method {
        self.batch.estimated.method
    }

    /// The batch solution.
    pub fn batch(&self) -> &Batch {
        &self.batch
    }

    /// Where the motion at `time` \[s\] comes from.
    pub fn source(&self, time: f64) -> Source {
        match self.last {
            _ if time > self.corrected => Source::Coasting,
            Some(_) => Source::Filter,
            None => Source::Batch,
        }
    }

    /// Time of the newest frame that told something \[s\].
    pub fn corrected(&self) -> f64 {
        self.corrected
    }

    /// Frames that it rests on.
    pub fn frames(&self) -> usize {
        self.batch.frames + self.since
    }

    /// What the newest frame contributed to the filter, if there is one.
    pub fn last(&self) -> Option<&Update> {
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
    use nalgebra::{Matrix3, Translation3, Vector3};

    fn truth() -> FreeRotation {
        let inertia = Matrix3::from_diagonal(&Vector3::new(7.0, 4.0, 3.0));
        let rate = Vector3::new(0.1, 0.35, 0.2);
        FreeRotation::new(&inertia, UnitQuaternion::identity(), &rate, 0.0).unwrap()
    }

    /// Frames of a tumbling ball, 10 a second.
    fn frames(range: std::ops::Range<u32>) -> Vec<Sighting> {
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

    /// What follows from a batch of the first frames and a filter through the later ones.
    fn belief(first: Vec<Sighting>, later: &[Sighting]) -> Belief {
        let tracks = Tracks::new(first).unwrap();
        let camera = Pinhole::square(1024, 1.25);
        let options = bundle::Options::default();
        let batch = Batch {
            estimated: estimate(Method::Bundle, &tracks, &camera, &options).unwrap(),
            frames: tracks.sightings().len(),
            span: tracks.span().unwrap(),
        };
        let still = later.iter().map(|f| (f, UnitQuaternion::identity()));
        Belief::new(batch, Some(1e-6), still)
    }

    // Whoever follows a point of the target must not see it jump with every solution.
    #[test]
    fn the_axes_of_the_body_stay_from_one_solution_to_the_next() {
        let first = belief(frames(0..150), &frames(150..200));
        let next = belief(frames(60..200), &[]);
        let turned = |belief: &Belief, t: f64| belief.motion().attitude(t) * belief.R_BF();
        let before = turned(&first, 30.0);
        assert!(
            turned(&next, 30.0).angle_to(&before) > 0.01,
            "each takes axes of its own"
        );
        let kept = first.or(next, 19.9, 30.0);
        assert_eq!(kept.batch().frames, 140);
        let after = turned(&kept, 30.0);
        assert!(
            after.angle_to(&before) < 2e-3,
            "{}",
            after.angle_to(&before)
        );
    }

    #[test]
    fn a_batch_that_knows_much_less_does_not_replace_the_filter() {
        let seen = frames(500..515);
        let long = belief(frames(0..300), &seen);
        let short = belief(seen, &[]);
        assert_eq!(
            (long.source(51.4), long.source(52.0)),
            (Source::Filter, Source::Coasting)
        );
        assert_eq!(short.source(51.4), Source::Batch);
        assert_eq!(
            long.clone().or(short.clone(), 51.4, 30.0).batch().frames,
            300
        );
        assert_eq!(short.or(long, 51.4, 30.0).batch().frames, 300);
    }

    /// After which frame, and as what, a jump at 15 s is noticed.
    fn jump(belief: &mut Belief) -> Option<(u32, Loss)> {
        (0..).zip(frames(300..330)).find_map(|(k, mut frame)| {
            frame.time = 15.0 + 0.1 * f64::from(k);
            let loss = belief.see(&frame, &UnitQuaternion::identity());
            loss.map(|loss| (k, loss))
        })
    }

    #[test]
    fn a_body_that_jumps_is_noticed_after_some_frames() {
        let mut fresh = fresh_at_15();
        assert_eq!(jump(&mut fresh), Some((9, Loss::Unconfirmed)));
        let mut confirmed = belief(frames(0..120), &frames(120..150));
        assert_eq!(jump(&mut confirmed), Some((9, Loss::Pushed(15.0))));
        // Confirmed is what has been confirmed before.
        let mut renewed = belief(frames(0..120), &frames(120..150)).or(fresh_at_15(), 14.9, 30.0);
        assert_eq!(jump(&mut renewed), Some((9, Loss::Pushed(15.0))));
    }

    fn fresh_at_15() -> Belief {
        belief(frames(0..150), &[])
    }

    /// Frames whose first points, so many, have their ids passed round: each has that of its neighbour.
    fn mixed_up(frames: Vec<Sighting>, points: u64) -> Vec<Sighting> {
        let pass = |id: u64| if id < points { (id + 1) % points } else { id };
        renamed(frames, |_, id| pass(id))
    }

    /// Frames with other ids; the frame's place comes with each.
    fn renamed(frames: Vec<Sighting>, other: impl Fn(u64, u64) -> u64) -> Vec<Sighting> {
        let renamed = |(k, frame): (u64, Sighting)| {
            let features = frame.features.iter().map(|f| Feature {
                id: other(k, f.id),
                ..*f
            });
            Sighting::new(frame.time, features.collect())
        };
        (0..).zip(frames).map(renamed).collect()
    }

    /// How far the turn from one time to another \[s\] is off \[rad\].
    fn off(belief: &Belief, from: f64, to: f64) -> f64 {
        let motion = belief.motion();
        let told = motion.attitude(to) / motion.attitude(from);
        let truth = truth();
        told.angle_to(&(truth.attitude(to) / truth.attitude(from)))
    }

    fn see_all(belief: &mut Belief, frames: &[Sighting]) -> Option<(usize, Loss)> {
        let mut losses = frames.iter().enumerate().filter_map(|(k, frame)| {
            let loss = belief.see(frame, &UnitQuaternion::identity());
            loss.map(|loss| (k, loss))
        });
        losses.next()
    }

    // Fewer than half: the others still tell the motion, and those that are elsewhere do not draw it with them.
    #[test]
    fn a_few_ids_given_to_other_points_are_left_out() {
        let mut belief = belief(frames(0..120), &frames(120..150));
        let frames = mixed_up(frames(150..350), 6);
        assert_eq!(see_all(&mut belief, &frames), None);
        let last = *belief.last().unwrap();
        assert_eq!((last.used, last.rejected), (14, 6));
        assert_eq!(belief.source(34.9), Source::Filter);
        let off = off(&belief, 34.9, 64.9);
        assert!(off < 3e-3, "{off}");
    }

    // A tracker that gives every id to another point, once or in every frame. No frame may pull the motion away, and
    // after the tenth the tracks before are given up: those since are a window of their own.
    #[test]
    fn when_every_id_is_given_to_another_point_the_motion_is_kept_and_then_begun_anew() {
        let before = belief(frames(0..120), &frames(120..150));
        let once = mixed_up(frames(150..350), 20);
        let always = renamed(frames(150..350), |k, id| (id + 1 + k % 19) % 20);
        for wrong in [&once, &always] {
            let mut kept = before.clone();
            assert_eq!(see_all(&mut kept, &wrong[..9]), None);
            assert_eq!(kept.source(15.8), Source::Coasting);
            assert_eq!(kept.corrected(), 14.9);
            // Exactly as without those frames.
            let [without, with] = [&before, &kept].map(|b| off(b, 14.9, 44.9));
            assert!(
                with < 3e-3 && (with - without).abs() < 1e-9,
                "{with} {without}"
            );
            let lost = see_all(&mut kept, &wrong[9..]);
            assert_eq!(lost, Some((0, Loss::Pushed(15.0))));
        }
        let mut tracks = Tracks::new([frames(0..150), once].concat()).unwrap();
        tracks.forget_before(15.0);
        let anew = belief(tracks.sightings().to_vec(), &[]);
        assert_eq!(anew.frames(), 200);
        let off = off(&anew, 34.9, 64.9);
        assert!(off < 3e-3, "{off}");
    }

    // The same, but to a motion that no frame has confirmed yet: then it is the motion that is not believed.
    #[test]
    fn ids_given_to_other_points_at_once_refute_a_first_solution() {
        let mut fresh = fresh_at_15();
        let wrong = mixed_up(frames(150..160), 20);
        assert_eq!(see_all(&mut fresh, &wrong), Some((9, Loss::Unconfirmed)));
    }

    // A tracker that starts anew gives ids that were never seen. That says nothing against the motion, which is carried
    // on for as long as it takes the next batch to know the new points, and its axes stay.
    #[test]
    fn ids_never_seen_before_leave_the_motion_as_it_is_until_the_next_batch() {
        let mut old = belief(frames(0..120), &frames(120..150));
        let new = renamed(frames(150..250), |_, id| id + 100);
        assert_eq!(see_all(&mut old, &new), None);
        let last = *old.last().unwrap();
        assert_eq!((last.used, last.rejected, last.unknown), (0, 0, 20));
        assert_eq!(old.source(24.9), Source::Coasting);
        let before = off(&old, 24.9, 54.9);
        assert!(before < 3e-3, "{before}");
        let next = belief([frames(0..150), new[..60].to_vec()].concat(), &new[60..]);
        assert_eq!(next.source(24.9), Source::Filter);
        let seam = |b: &Belief| b.motion().attitude(24.9) * b.R_BF();
        let was = seam(&old);
        let renewed = old.or(next, 24.9, 30.0);
        assert!(seam(&renewed).angle_to(&was) < 1e-9);
        assert_eq!(renewed.last().unwrap().used, 20);
        let after = off(&renewed, 24.9, 54.9);
        assert!(after < 3e-3, "{after}");
    }
}
