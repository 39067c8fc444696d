//! From tracks to the solution, stage by stage.

use nalgebra::{UnitQuaternion, Vector2, Vector3};
use rand::{SeedableRng, rngs::StdRng};

use super::adjust::{Effort, Motion, adjust, information};
use super::attitude_fit::{Sample, fit};
use super::dynamic::{COMMON, Tumbling};
use super::frames::Frames;
use super::free_motion::FreeMotion;
use super::known_rotation::{structure as linear_structure, triangulate};
use super::momentum_start::{Attitude, momentum_start, rates};
use super::placing::{Mark, translation};
use super::relative_rotation::relative_rotation_fit;
use super::scene::{Scene, residual};
use super::structure::{BELIEVED, Segment, Settings, reconstruct, scene_of};
use super::uncertainty::{Residuals, report};
use super::{BodyPoint, BodyPose, MIN_FRAMES, MIN_POINTS, Options, Solution};
use crate::estimation::{EstimateError, Tracks};
use crate::vision::Pinhole;

/// The noise is doubled up to so many times if the tracks do not fit together.
const DOUBLINGS: i32 = 3;

/// Segments that are sought.
const SEGMENTS: usize = 6;

/// Tracks that last fewer frames on average rarely build a structure.
const SHORT_TRACK: usize = 6;

/// Below this angle between angular velocity and momentum \[rad\] it is asked whether there is any.
const SLIGHT_NUTATION: f64 = 0.05;

/// By how much a shape must lower the cost (in units of the noise) to be believed rather than a sphere: its five
/// parameters lower it by 2.5 if there is nothing to see.
const WORTH: f64 = 20.0;

pub(super) fn solve(
    tracks: &Tracks,
    camera: &Pinhole,
    options: &Options,
) -> Result<Solution, EstimateError> {
    let lookup = options.camera_motion.lookup();
    let frames = Frames::new(
        tracks,
        camera,
        options.points_per_frame.max(MIN_POINTS),
        lookup,
    );
    check(&frames, options)?;
    let mut best: Option<Adjusted> = None;
    let mut placed = 0;
    let sights: usize = frames.list.iter().map(|f| f.sights.len()).sum();
    let lasting = sights >= SHORT_TRACK * frames.ids.len();
    let methods = [Method::Structure, Method::RelativeRotation];
    let levels = |method| (0..=DOUBLINGS).map(move |doubling| (method, doubling));
    for (method, doubling) in methods.into_iter().flat_map(levels) {
        if method == Method::Structure && !lasting && doubling > 0 {
            continue;
        }
        let settings = Settings {
            noise: options.pixel_noise.max(1e-3) * f64::from(1 << doubling),
            focal_free: options.estimate_focal_length,
        };
        let mut rng = StdRng::seed_from_u64(options.seed);
        let frames = frames.clone();
        let found = match method {
            Method::Structure => from_structure(frames, &settings, &mut rng, &mut placed),
            Method::RelativeRotation => relative_rotation_fit(&frames, settings.noise, &mut rng)
                .and_then(|motion| dynamic(frames, motion, &[], &[], &settings)),
        };
        let Some(found) = found else { continue };
        // Tracks noisier than assumed lose many good points as if they were wrong.
        let done = found.residuals.outliers < 0.3;
        let better = |b: &Adjusted| found.residuals.outliers < b.residuals.outliers;
        if best.as_ref().is_none_or(better) {
            best = Some(found);
        }
        if done {
            break;
        }
    }
    match best {
        Some(best) if best.residuals.outliers < 0.5 => best.finish(camera, options),
        Some(best) if 3 * placed >= frames.list.len() => Err(EstimateError::NotFree {
            rms: best.residuals.rms,
        }),
        _ => Err(EstimateError::NotRigid {
            placed,
            frames: frames.list.len(),
        }),
    }
}

/// Where the motion comes from that the dynamic adjustment starts with.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Method {
    Structure,
    RelativeRotation,
}

/// Refuses what cannot succeed, and says why.
fn check(frames: &Frames, options: &Options) -> Result<(), EstimateError> {
    let have = frames.list.iter().filter(|f| !f.sights.is_empty()).count();
    if have < MIN_FRAMES {
        return Err(EstimateError::TooFewFrames {
            have,
            need: MIN_FRAMES,
        });
    }
    let neighbours = (0..frames.list.len() - 1).map(|i| frames.common(i, i + 1).len());
    let next_but_one = (0..frames.list.len() - 2).map(|i| frames.common(i, i + 2).len());
    let most = neighbours.chain(next_but_one).max().unwrap_or(0);
    if most < MIN_POINTS {
        return Err(EstimateError::TooFewPoints {
            most,
            need: MIN_POINTS,
        });
    }
    if frames
        .list
        .iter()
        .all(|f| on_a_line(f.sights.iter().map(|s| s.pixel)))
    {
        return Err(EstimateError::Collinear);
    }
    let mut first: Vec<Option<Vector2<f64>>> = vec![None; frames.ids.len()];
    let mut largest = vec![0.0f64; frames.ids.len()];
    for sight in frames.list.iter().flat_map(|f| &f.sights) {
        let start = *first[sight.track].get_or_insert(sight.pixel);
        largest[sight.track] = largest[sight.track].max((sight.pixel - start).norm());
    }
    // A few points may jump to where they do not belong.
    largest.sort_by(f64::total_cmp);
    let typical = largest[largest.len() * 3 / 4];
    if typical < 8.0 * options.pixel_noise {
        return Err(EstimateError::Constant { largest: typical });
    }
    Ok(())
}

/// Whether points scatter across their line by less than a pixel in a few hundred along it.
fn on_a_line(points: impl Iterator<Item = Vector2<f64>> + Clone) -> bool {
    let count = points.clone().count();
    if count < 3 {
        return true;
    }
    let mean = points.clone().sum::<Vector2<f64>>() / count as f64;
    let scatter: nalgebra::Matrix2<f64> = points.map(|p| (p - mean) * (p - mean).transpose()).sum();
    let eigenvalues = scatter.symmetric_eigenvalues();
    eigenvalues.min() <= (4e-3f64).powi(2) * eigenvalues.max()
}

/// The solution that starts from structure; `placed` is told how many frames that placed.
fn from_structure(
    mut frames: Frames,
    settings: &Settings,
    rng: &mut StdRng,
    placed: &mut usize,
) -> Option<Adjusted> {
    let segments = segments(&mut frames, settings, rng);
    let count: usize = segments.iter().map(Segment::placed).sum();
    *placed = count.max(*placed);
    if 3 * count < frames.list.len() {
        return None;
    }
    let (motion, turns) = motion_of_segments(&frames, &segments)?;
    dynamic(frames, motion, &segments, &turns, settings)
}

/// Parts of the frames that could be reconstructed, the largest first.
fn segments(frames: &mut Frames, settings: &Settings, rng: &mut StdRng) -> Vec<Segment> {
    let mut open: Vec<usize> = (0..frames.list.len()).collect();
    let mut found: Vec<Segment> = Vec::new();
    while found.len() < SEGMENTS && open.len() >= MIN_FRAMES {
        let Some(segment) = reconstruct(frames, &open, settings, rng) else {
            break;
        };
        if segment.placed() < MIN_FRAMES {
            break;
        }
        open.retain(|i| segment.placements[*i].is_none());
        found.push(segment);
    }
    found.sort_by_key(|s| std::cmp::Reverse(s.placed()));
    found
}

/// The motion that fits the attitudes of all segments, and each segment's axes in the body's.
fn motion_of_segments(
    frames: &Frames,
    segments: &[Segment],
) -> Option<(FreeMotion, Vec<UnitQuaternion<f64>>)> {
    let attitude = |segment: &Segment, i: usize| {
        let placement = segment.placements[i]?;
        Some(Attitude {
            time: frames.list[i].time,
            R_WB: frames.list[i].R_WC * placement.R_CB,
        })
    };
    let all = 0..frames.list.len();
    let series: Vec<Attitude> = all
        .clone()
        .filter_map(|i| attitude(segments.first()?, i))
        .collect();
    let start = momentum_start(&rates(&series))?;
    let samples: Vec<Sample> = all
        .filter_map(|i| {
            let mut each = segments.iter().enumerate();
            each.find_map(|(segment, s)| {
                let attitude = attitude(s, i)?;
                Some(Sample { attitude, segment })
            })
        })
        .collect();
    let fit = fit(&start, &samples, segments.len())?;
    Some((fit.motion, fit.segments))
}

/// The result of the dynamic adjustment.
struct Adjusted {
    frames: Frames,
    chosen: Vec<usize>,
    tracks: Vec<usize>,
    scene: Scene,
    motion: FreeMotion,
    t_C: Vec<Vector3<f64>>,
    points: Vec<Vector3<f64>>,
    log_focal: f64,
    residuals: Residuals,
    settings: Settings,
}

/// Adjusts motion, points and positions together, from a motion that is nearly right.
fn dynamic(
    mut frames: Frames,
    motion: FreeMotion,
    segments: &[Segment],
    turns: &[UnitQuaternion<f64>],
    settings: &Settings,
) -> Option<Adjusted> {
    let times: Vec<f64> = frames.list.iter().map(|f| f.time).collect();
    let attitudes: Vec<_> = (motion.attitudes(&times).into_iter().zip(&frames.list))
        .map(|(R_WB, f)| f.R_WC.inverse() * R_WB)
        .collect();
    // The segments judged points by placements of their own; here the motion judges.
    for sight in frames.list.iter_mut().flat_map(|f| &mut f.sights) {
        sight.kept = true;
    }
    let mut log_focal = 0.0;
    let single = (segments.len() == 1).then(|| &segments[0]);
    let known = single.and_then(|s| {
        log_focal = s.log_focal;
        carried_over(&frames, s, &turns[0], &attitudes, settings)
    });
    let known = match known {
        Some(known) => known,
        None => from_rotations(&frames, &attitudes, settings)?,
    };
    let (point_of, position_of) = known;
    let chosen: Vec<usize> = (0..frames.list.len())
        .filter(|&i| {
            let marks = frames.list[i]
                .sights
                .iter()
                .filter(|s| point_of[s.track].is_some());
            position_of[i].is_some() && marks.count() >= 2
        })
        .collect();
    let wanted = |track: usize| point_of[track].is_some();
    let (mut scene, tracks) = scene_of(&frames, &chosen, wanted, settings.noise, 2);
    let mut points: Vec<_> = tracks.iter().filter_map(|t| point_of[*t]).collect();
    let t_C: Vec<_> = chosen.iter().filter_map(|i| position_of[*i]).collect();
    let times: Vec<f64> = chosen.iter().map(|i| times[*i]).collect();
    let R_WC: Vec<_> = chosen.iter().map(|i| frames.list[*i].R_WC).collect();
    let focal = settings.focal_free.then_some(log_focal);
    let mut tumbling = Tumbling::new(motion, t_C, &times, &R_WC, settings.noise, focal);
    // The start may be off by much; each round believes what is less far off than in the one before.
    let mut outliers = f64::INFINITY;
    let mut residuals = None;
    for (round, width) in [8.0, 2.0, 1.0, 1.0].into_iter().enumerate() {
        let limit = width * BELIEVED * settings.noise;
        let now = judge(&mut scene, &tumbling, &points, limit);
        let settled = round == 3 && (now.outliers - outliers).abs() < 1e-9;
        outliers = now.outliers;
        residuals = Some(now);
        if settled {
            break;
        }
        let effort = Effort {
            huber: width * 4.0 * settings.noise,
            steps: if round == 0 { 25 } else { 8 },
            tolerance: if round < 2 { 1e-4 } else { 1e-7 },
        };
        adjust(&scene, &mut tumbling, &mut points, &effort)?;
    }
    let residuals = residuals?;
    if tumbling.nutation() < SLIGHT_NUTATION
        && let Some(mut sphere) = tumbling.spherical()
    {
        let effort = Effort {
            huber: 4.0 * settings.noise,
            steps: 10,
            tolerance: 1e-7,
        };
        let mut placed = points.clone();
        let with_shape = adjust(
            &scene,
            &mut tumbling,
            &mut points,
            &Effort { steps: 1, ..effort },
        )?;
        let without = adjust(&scene, &mut sphere, &mut placed, &effort);
        let worth = WORTH * residuals.deviation.powi(2);
        if without.is_some_and(|o| o.cost < with_shape.cost + worth) {
            (tumbling, points) = (sphere, placed);
        }
    }
    let Tumbling {
        motion,
        t_C,
        log_focal,
        ..
    } = tumbling;
    Some(Adjusted {
        frames,
        chosen,
        tracks,
        scene,
        motion,
        t_C,
        points,
        log_focal,
        residuals,
        settings: *settings,
    })
}

type Known = (Vec<Option<Vector3<f64>>>, Vec<Option<Vector3<f64>>>);

/// Points and positions of a segment in the motion's body axes, `turn` taking segment axes to those; what it
/// lacks is found from the motion's attitudes.
fn carried_over(
    frames: &Frames,
    segment: &Segment,
    turn: &UnitQuaternion<f64>,
    attitudes: &[UnitQuaternion<f64>],
    settings: &Settings,
) -> Option<Known> {
    let focal = frames.focal * segment.log_focal.exp();
    let mut points: Vec<_> = segment.points.iter().map(|p| p.map(|p| turn * p)).collect();
    let position = |i: usize| {
        let known = |s: &super::frames::Sight| Some((points[s.track]?, s.pixel));
        let marks: Vec<Mark> = frames.list[i].sights.iter().filter_map(known).collect();
        (marks.len() >= 2)
            .then(|| translation(&focal, &marks, &attitudes[i]))
            .flatten()
    };
    let positions: Vec<_> = (0..frames.list.len()).map(position).collect();
    let mut missing: Vec<Vec<_>> = vec![Vec::new(); frames.ids.len()];
    for ((frame, position), R_CB) in frames.list.iter().zip(&positions).zip(attitudes) {
        let Some(t_C) = *position else { continue };
        let placement = super::adjust::Placement { R_CB: *R_CB, t_C };
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
fn from_rotations(
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

/// Believes what is less than `limit` \[px\] off; how far off it is.
fn judge(scene: &mut Scene, motion: &Tumbling, points: &[Vector3<f64>], limit: f64) -> Residuals {
    let focal = scene.focal * motion.log_focal.exp();
    let (mut sum, mut kept, mut all) = (0.0, 0usize, 0usize);
    for i in 0..scene.len() {
        let placement = motion.placement(i);
        let R = placement.R_CB.to_rotation_matrix();
        for seen in scene.frame_mut(i) {
            let x = R * points[seen.point] + placement.t_C;
            let off = residual(&focal, &x, &seen.pixel).map(|r| r.norm_squared());
            seen.kept = off.is_some_and(|o| o < limit * limit);
            all += 1;
            if let Some(off) = off.filter(|_| seen.kept) {
                kept += 1;
                sum += off;
            }
        }
    }
    let unknowns = 3 * scene.len() + 3 * scene.points + COMMON;
    let freedom = (2 * kept).saturating_sub(unknowns).max(1) as f64;
    Residuals {
        rms: (sum / (2 * kept.max(1)) as f64).sqrt(),
        deviation: (sum / freedom).sqrt(),
        outliers: 1.0 - kept as f64 / all.max(1) as f64,
    }
}

impl Adjusted {
    fn finish(self, camera: &Pinhole, options: &Options) -> Result<Solution, EstimateError> {
        let times: Vec<f64> = self
            .chosen
            .iter()
            .map(|i| self.frames.list[*i].time)
            .collect();
        let R_WC: Vec<_> = self
            .chosen
            .iter()
            .map(|i| self.frames.list[*i].R_WC)
            .collect();
        let focal = self.settings.focal_free.then_some(self.log_focal);
        let motion = self.motion;
        let tumbling = Tumbling::new(motion, self.t_C, &times, &R_WC, self.settings.noise, focal);
        let huber = 4.0 * self.settings.noise;
        let not_free = EstimateError::NotFree {
            rms: self.residuals.rms,
        };
        let variance = self.residuals.deviation.powi(2);
        let covariance = information(&self.scene, &tumbling, &self.points, huber)
            .and_then(|i| i.try_inverse())
            .map(|c| c * variance)
            .ok_or_else(|| not_free.clone())?;
        let report = report(
            &motion,
            &covariance,
            &self.residuals,
            options,
            self.log_focal,
        )
        .ok_or(not_free)?;
        let scale = self.log_focal.exp();
        let poses = (0..self.chosen.len()).map(|k| {
            let placement = tumbling.placement(k);
            BodyPose {
                time: times[k],
                R_CB: placement.R_CB,
                t_C: placement.t_C,
            }
        });
        let points = self.points.iter().zip(&self.tracks);
        Ok(Solution {
            motion: report.motion,
            points: points
                .map(|(p, t)| BodyPoint {
                    id: self.frames.ids[*t],
                    p_B: *p,
                })
                .collect(),
            poses: poses.collect(),
            camera: Pinhole {
                fx: camera.fx * scale,
                fy: camera.fy * scale,
                ..*camera
            },
            focal_deviation: focal.map(|_| covariance[(COMMON - 1, COMMON - 1)].max(0.0).sqrt()),
            outliers: self.residuals.outliers,
            diagnosis: report.diagnosis,
            free: motion,
            covariance: covariance.fixed_view::<8, 8>(0, 0).into_owned(),
        })
    }
}
