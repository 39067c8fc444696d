//! The solver: from tracks to the solution, stage by stage.

use rand::{SeedableRng, rngs::StdRng};

use super::ambiguity::UNAMBIGUOUS_TURN;
use super::attitude_fit::{AttitudeFit, SegmentAttitude, fit_attitudes};
use super::frames::Frames;
use super::global_adjustment::{GlobalFit, adjust_globally};
use super::linear_inertia::{AttitudeSample, fastest_tumbling, fit_inertia_and_momentum, rates};
use super::rate_search::search_rates;
use super::relative_pose::noise_between;
use super::relative_rotation::relative_rotation_fit;
use super::reused_track_ids::split_reused_tracks;
use super::structure::{Segment, SolverSettings, reconstruct};
use super::white_noise::white_noise;
use super::{LEAST_SHARED, MIN_FRAMES, MIN_POINTS, Options, Solution};
use crate::estimation::{EstimateError, Tracks, degenerate};
use crate::vision::Pinhole;

/// Largest number of doublings of the assumed noise, if the tracks do not fit together.
const DOUBLINGS: i32 = 4;

/// Number of pairs of neighbouring frames from which the noise is measured, and the ratio to the assumed noise above
/// which the measured noise is used.
const PAIRS: usize = 24;
const NOISIER: f64 = 1.4;

/// Above this ratio of measured to assumed noise, neighbouring frames show no rigid body.
const NOT_RIGID: f64 = 30.0;

/// Largest accepted share of outliers.
const MOST_OUTLIERS: f64 = 0.3;

/// Largest accepted ratio of residuals to assumed noise.
const MOST_NOISE: f64 = 6.0;

/// Largest accepted ratio of residuals to the noise measured between neighbouring frames.
const MOST_MEASURED: f64 = 2.0;

/// Largest accepted ratio of residuals to those of one independent pose per frame.
const AS_INDEPENDENT: f64 = 1.2;

/// Largest ratio of residuals to the white noise at which no further initialisation is tried.
const WHITE_NOISE_RATIO: f64 = 1.35;

/// Ratio of residuals to noise above which the solver starts again with other random samples, unless the residuals of
/// two starts agree to the second fraction.
const GOOD_NOISE_RATIO: f64 = 1.06;
const AGREE: f64 = 0.01;

/// Largest accepted ratio of residuals to the white noise, after all starts.
const LARGEST_NOISE_RATIO: f64 = 1.5;

/// An outlier counts as a residual of this many times the noise.
const OUTLIER: f64 = 6.0;

/// Largest accepted ratio of residuals to the noise measured between frames, after a short rotation.
const MOST_AFTER_SHORT_TURN: f64 = 1.5;

/// Largest number of segments.
const SEGMENTS: usize = 6;

/// Tracks that last fewer frames on average rarely allow a structure to be reconstructed.
const SHORT_TRACK: usize = 6;

/// If only the last part of the frames fits one motion: its reference time as a fraction of the whole time, and the
/// least fraction that this part must cover.
const LAST: f64 = 0.97;
const LEAST_SHARE: f64 = 0.1;

/// A fit with at most this RMS angle to the attitudes is a good start \[rad\].
const CLOSE: f64 = 0.03;

pub(super) fn solve(
    tracks: &Tracks,
    camera: &Pinhole,
    options: &Options,
) -> Result<Solution, EstimateError> {
    let lookup = options.camera_motion.lookup();
    let mut frames = Frames::new(
        tracks,
        camera,
        options.points_per_frame.max(MIN_POINTS),
        lookup,
    );
    let shared = check(&frames)?;
    degenerate::check(tracks, options.pixel_noise)?;
    let mut best: Option<GlobalFit> = None;
    let mut resected = 0;
    let observations: usize = frames.list.iter().map(|f| f.observations.len()).sum();
    // A correct fit to exact tracks leaves smaller residuals than this minimum.
    let assumed = options.pixel_noise.max(1e-3);
    let measured = noise_of_neighbours(&frames, assumed);
    if measured > NOT_RIGID * assumed {
        return Err(EstimateError::NotRigid {
            consistent: 0,
            frames: frames.list.len(),
        });
    }
    // White noise is measured without a motion model; noise between neighbouring frames with few points is
    // underestimated.
    let white = white_noise(tracks);
    let measured = white.map_or(measured, |white| white.max(measured.min(white * 1.3)));
    let first = match measured < NOISIER * assumed {
        true => assumed,
        false => measured.min(assumed * f64::from(1 << DOUBLINGS)),
    };
    // Residuals that independent poses leave as well are noise, however large.
    let quiet = |b: &GlobalFit| {
        let independent = AS_INDEPENDENT * b.independent_rms.unwrap_or_default();
        let most = (MOST_NOISE * assumed).max(MOST_MEASURED * first);
        b.residuals.deviation < most.max(independent)
    };
    // After a short rotation a wrong motion may absorb most of the error.
    let trusted = |b: &GlobalFit| {
        b.turn() > UNAMBIGUOUS_TURN || b.residuals.deviation < MOST_AFTER_SHORT_TURN * first
    };
    let initialisations: &[Initialisation] = match shared < MIN_POINTS {
        true => &[
            Initialisation::RateSearch(0),
            Initialisation::RateSearch(1),
            Initialisation::RateSearch(2),
        ],
        false => &[
            Initialisation::Structure,
            Initialisation::OtherSamples(1),
            Initialisation::OtherSamples(2),
            Initialisation::RelativeRotation,
            Initialisation::RateSearch(0),
        ],
    };
    // Residuals above the white noise indicate another minimum, or an unmodelled effect.
    let as_white = |b: &GlobalFit, most: f64| {
        white.is_none_or(|white| b.residuals.deviation < most * white.max(assumed))
    };
    let fits_noise = |b: &GlobalFit| as_white(b, WHITE_NOISE_RATIO);
    // Otherwise no start has found the motion, or the model does not contain it.
    let explained = |b: &GlobalFit| as_white(b, LARGEST_NOISE_RATIO);
    // Slightly larger residuals may also come from another minimum.
    let fits_well = |b: &GlobalFit| {
        b.residuals.deviation < GOOD_NOISE_RATIO * white.unwrap_or(first).max(assumed)
    };
    let mut searched_reused_ids = false;
    let mut held = false;
    let most = assumed * f64::from(1 << DOUBLINGS);
    let levels = |initialisation| {
        let noises = (0..=DOUBLINGS).map(|doubling| first * f64::from(1 << doubling));
        noises
            .filter(move |n| *n <= most)
            .map(move |n| (initialisation, n))
    };
    for (initialisation, noise) in initialisations.iter().copied().flat_map(levels) {
        let is_again = matches!(initialisation, Initialisation::OtherSamples(_));
        let is_other_window = matches!(initialisation, Initialisation::RateSearch(1..));
        if ((held || is_other_window) && noise > first) || (is_again && !held) {
            continue;
        }
        if !is_again && best.as_ref().is_some_and(|b| held && fits_noise(b)) {
            break;
        }
        // Structure with a higher assumed noise adds nothing once most frames are resected, and little if tracks are
        // short.
        let lasting = observations >= SHORT_TRACK * frames.ids.len();
        let enough = 4 * resected >= 3 * frames.list.len() || !lasting;
        if initialisation == Initialisation::Structure && enough && noise > first && best.is_none()
        {
            continue;
        }
        let settings = SolverSettings {
            noise,
            widths: options.widths,
            orbit: options.orbit,
            with_points: options.with_points,
        };
        let other = match initialisation {
            Initialisation::OtherSamples(k) => k,
            _ => 0,
        };
        let mut rng = StdRng::seed_from_u64(options.seed.wrapping_add(other));
        // With too small a noise the inlier gate rejects many correct points.
        let holds = |f: &GlobalFit| f.residuals.outliers < MOST_OUTLIERS && trusted(f);
        let good = |f: &GlobalFit| holds(f) && quiet(f);
        let mut found = attempt(
            &frames,
            initialisation,
            &settings,
            good,
            &mut rng,
            &mut resected,
        );
        if !found.as_ref().is_some_and(holds) && !searched_reused_ids {
            searched_reused_ids = true;
            if split_reused_tracks(&mut frames, noise, &mut rng) > 0 {
                found = attempt(
                    &frames,
                    initialisation,
                    &settings,
                    good,
                    &mut rng,
                    &mut resected,
                );
            }
        }
        let Some(found) = found else { continue };
        held |= holds(&found);
        let agrees = best.as_ref().is_some_and(|b| {
            let (old, new) = (b.residuals.deviation, found.residuals.deviation);
            is_again && fits_noise(&found) && (new - old).abs() < AGREE * old
        });
        let done = holds(&found) && (fits_well(&found) || agrees);
        let square = |b: &GlobalFit| {
            let share = b.residuals.outliers;
            b.residuals.deviation.powi(2) * (1.0 - share) + (OUTLIER * first).powi(2) * share
        };
        let better = |b: &GlobalFit| square(&found) < square(b);
        if best.as_ref().is_none_or(better) {
            best = Some(found);
        }
        if done {
            break;
        }
    }
    match best {
        Some(best)
            if best.residuals.outliers < MOST_OUTLIERS
                && quiet(&best)
                && trusted(&best)
                && explained(&best) =>
        {
            best.finish(camera, options)
        }
        Some(best) if 3 * resected >= frames.list.len() || shared < MIN_POINTS => {
            Err(EstimateError::NotFree {
                rms: best.residuals.rms,
            })
        }
        _ => Err(EstimateError::NotRigid {
            consistent: resected,
            frames: frames.list.len(),
        }),
    }
}

/// Median of the noise measured between neighbouring frames \[px\]; zero if no pair has enough points.
fn noise_of_neighbours(frames: &Frames, assumed: f64) -> f64 {
    let last = frames.list.len() - 1;
    let angle = frames.pixel_angle();
    let noise = |k: usize| {
        let i = k * last / PAIRS;
        noise_between(&frames.pairs(i, i + 1), assumed * angle)
    };
    let mut noises: Vec<f64> = (0..PAIRS).filter_map(noise).collect();
    noises.sort_by(f64::total_cmp);
    noises.get(noises.len() / 2).map_or(0.0, |n| n / angle)
}

/// Solves with one initialisation and one noise. If quickly reconstructed structure gives no good result, it is
/// reconstructed again thoroughly.
fn attempt(
    frames: &Frames,
    initialisation: Initialisation,
    settings: &SolverSettings,
    good: impl Fn(&GlobalFit) -> bool,
    rng: &mut StdRng,
    resected: &mut usize,
) -> Option<GlobalFit> {
    match initialisation {
        Initialisation::Structure | Initialisation::OtherSamples(_) => {
            let mut attempt_with = |thoroughness| {
                from_structure(frames.clone(), settings, thoroughness, rng, resected)
            };
            let (found, several) = attempt_with(Thoroughness::Quick);
            if !several || found.as_ref().is_some_and(good) {
                return found;
            }
            attempt_with(Thoroughness::Thorough).0.or(found)
        }
        Initialisation::RelativeRotation => {
            let motion = relative_rotation_fit(frames, settings.noise, rng)?;
            adjust_globally(frames.clone(), motion, &[], &[], settings)
        }
        Initialisation::RateSearch(window) => {
            let motion = search_rates(frames, window, settings)?;
            adjust_globally(frames.clone(), motion, &[], &[], settings)
        }
    }
}

/// Source of the motion that the global adjustment starts from.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Initialisation {
    Structure,
    /// [`Self::Structure`] with this number added to the seed of the random samples.
    OtherSamples(u64),
    RelativeRotation,
    /// [`search_rates`] with this rank of the first window.
    RateSearch(usize),
}

/// Size at which a segment after the first is accepted without trying further windows of key frames.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Thoroughness {
    /// Half of the first segment.
    Quick,
    /// Nearly all remaining frames; otherwise the largest segment of all windows is accepted.
    Thorough,
}

/// Refuses tracks with too few frames or too few common points. Returns the largest number of common points.
fn check(frames: &Frames) -> Result<usize, EstimateError> {
    let have = frames
        .list
        .iter()
        .filter(|f| !f.observations.is_empty())
        .count();
    if have < MIN_FRAMES {
        return Err(EstimateError::TooFewFrames {
            have,
            need: MIN_FRAMES,
        });
    }
    let neighbours = (0..frames.list.len() - 1).map(|i| frames.common(i, i + 1).len());
    let next_but_one = (0..frames.list.len() - 2).map(|i| frames.common(i, i + 2).len());
    let most = neighbours.chain(next_but_one).max().unwrap_or(0);
    if most < LEAST_SHARED {
        return Err(EstimateError::TooFewPoints {
            most,
            need: LEAST_SHARED,
        });
    }
    Ok(most)
}

/// The fit that starts from reconstructed segments, and whether there are several. Raises `resected` to the number of
/// frames with a pose.
fn from_structure(
    mut frames: Frames,
    settings: &SolverSettings,
    thoroughness: Thoroughness,
    rng: &mut StdRng,
    resected: &mut usize,
) -> (Option<GlobalFit>, bool) {
    let segments = segments(&mut frames, settings, thoroughness, rng);
    let count: usize = segments.iter().map(Segment::resected).sum();
    *resected = count.max(*resected);
    let enough = 3 * count >= frames.list.len();
    let found = enough.then(|| from_segments(frames, &segments, settings));
    (found.flatten(), segments.len() > 1)
}

fn from_segments(
    mut frames: Frames,
    segments: &[Segment],
    settings: &SolverSettings,
) -> Option<GlobalFit> {
    let fit = motion_of_segments(&frames, segments)?;
    let (first, last) = (frames.list.first()?.time, frames.list.last()?.time);
    let from = fit.motion.time - fit.span;
    let tail = last - from > LEAST_SHARE * (last - first) && last < fit.motion.time + fit.span;
    let since = (!fit.fits_all && tail).then_some(from);
    for frame in frames.list.iter_mut().filter(|f| Some(f.time) < since) {
        frame.observations.clear();
    }
    let mut found = adjust_globally(frames, fit.motion, segments, &fit.segments, settings)?;
    found.since = since;
    Some(found)
}

/// Segments that could be reconstructed, the largest first.
fn segments(
    frames: &mut Frames,
    settings: &SolverSettings,
    thoroughness: Thoroughness,
    rng: &mut StdRng,
) -> Vec<Segment> {
    let mut open: Vec<usize> = (0..frames.list.len()).collect();
    let mut found: Vec<Segment> = Vec::new();
    while found.len() < SEGMENTS && open.len() >= MIN_FRAMES {
        let first = found
            .first()
            .filter(|_| thoroughness == Thoroughness::Quick);
        let before = first.map(Segment::resected);
        let Some(segment) = reconstruct(frames, &open, before, settings, rng) else {
            break;
        };
        if segment.resected() < MIN_FRAMES {
            break;
        }
        open.retain(|i| segment.poses[*i].is_none());
        found.push(segment);
    }
    found.sort_by_key(|s| std::cmp::Reverse(s.resected()));
    found
}

/// The motion that fits the attitudes of all segments, with the axes of each segment in body axes.
fn motion_of_segments(frames: &Frames, segments: &[Segment]) -> Option<AttitudeFit> {
    let attitude = |segment: &Segment, i: usize| {
        let pose = segment.poses[i]?;
        Some(AttitudeSample {
            time: frames.list[i].time,
            R_WB: frames.list[i].R_WC * pose.R_CB,
        })
    };
    let all = 0..frames.list.len();
    let series: Vec<AttitudeSample> = all
        .clone()
        .filter_map(|i| attitude(segments.first()?, i))
        .collect();
    let rates = rates(&series);
    let whole = series.last()?.time - series.first()?.time;
    let samples: Vec<SegmentAttitude> = all
        .filter_map(|i| {
            let mut each = segments.iter().enumerate();
            each.find_map(|(segment, s)| {
                let attitude = attitude(s, i)?;
                Some(SegmentAttitude { attitude, segment })
            })
        })
        .collect();
    // Near the separatrix the reference time matters: best while the body turns over. If no reference time gives a fit,
    // the frames do not show one motion, and only their last part is used.
    let mut best: Option<AttitudeFit> = None;
    for along in [0.5, fastest_tumbling(&rates), LAST] {
        let found = fit_inertia_and_momentum(&rates, along)
            .and_then(|start| fit_attitudes(&start, &samples, segments.len()));
        let Some(found) = found else { continue };
        let fits_all = found.fits_all && found.rms < CLOSE;
        let last = along == LAST && found.rms < CLOSE && found.span > LEAST_SHARE * whole;
        if fits_all || last || best.as_ref().is_none_or(|b| found.rms < b.rms) {
            best = Some(found);
        }
        if fits_all {
            break;
        }
    }
    best
}
