//! The dynamic adjustment from a motion that is nearly right to the solution.

use nalgebra::{UnitQuaternion, Vector3};

use super::adjust::{Effort, Motion, Placement, adjust, information};
use super::dynamic::{COMMON, Tumbling};
use super::frames::{Frames, Sight};
use super::free_motion::FreeMotion;
use super::known_rotation::{structure as linear_structure, triangulate};
use super::placing::{Mark, translation};
use super::scene::{Scene, residual};
use super::straight::{LINE, Straight, without_line};
use super::structure::{BELIEVED, Segment, Settings, scene_of};
use super::uncertainty::{Residuals, report};
use super::{BodyPoint, BodyPose, Options, Solution};
use crate::estimation::EstimateError;
use crate::vision::Pinhole;

/// Below this angle between angular velocity and momentum \[rad\] it is asked whether there is any.
const SLIGHT_NUTATION: f64 = 0.05;

/// By how much a shape must lower the cost (in units of the noise) to be believed rather than a sphere: its five
/// parameters lower it by 2.5 if there is nothing to see.
const WORTH: f64 = 20.0;

/// The result of the dynamic adjustment.
pub struct Adjusted {
    frames: Frames,
    chosen: Vec<usize>,
    tracks: Vec<usize>,
    scene: Scene,
    motion: FreeMotion,
    t_C: Vec<Vector3<f64>>,
    points: Vec<Vector3<f64>>,
    log_focal: f64,
    /// How well the images are explained.
    pub residuals: Residuals,
    straight: bool,
    settings: Settings,
}

/// Adjusts motion, points and positions together, from a motion that is nearly right.
pub fn dynamic(
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
    let fixed = R_WC.iter().all(|R| *R == UnitQuaternion::identity());
    let straight = fixed && straighten(&scene, &mut tumbling, &mut points, &residuals, settings);
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
        straight,
        settings: *settings,
    })
}

/// Lets the centre of mass move in a straight line if the images do not object; `points` then start there. Whether
/// it does.
fn straighten(
    scene: &Scene,
    tumbling: &mut Tumbling,
    points: &mut Vec<Vector3<f64>>,
    residuals: &Residuals,
    settings: &Settings,
) -> bool {
    let effort = Effort {
        huber: 4.0 * settings.noise,
        steps: 8,
        tolerance: 1e-7,
    };
    let mut free = points.clone();
    let reference = adjust(scene, tumbling, &mut free, &Effort { steps: 1, ..effort });
    let Some((mut straight, centre)) = Straight::new(tumbling.clone()) else {
        return false;
    };
    let mut placed: Vec<_> = points.iter().map(|p| p - centre).collect();
    let (Some(reference), Some(reached)) = (
        reference,
        adjust(scene, &mut straight, &mut placed, &effort),
    ) else {
        return false;
    };
    *points = free;
    // What the positions' freedom takes from the cost if it is noise that they fit: half a variance each.
    let fewer = (3 * scene.len()) as f64 - LINE as f64;
    let expected = 0.5 * (fewer + 4.0 * (2.0 * fewer).sqrt()) * residuals.deviation.powi(2);
    let accepted = reached.cost < reference.cost + expected;
    if accepted {
        (*tumbling, *points) = (straight.into_free(), placed);
    }
    accepted
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
    /// The solution, with covariance and diagnosis.
    pub fn finish(self, camera: &Pinhole, options: &Options) -> Result<Solution, EstimateError> {
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
        let known = if self.straight {
            Straight::new(tumbling.clone())
                .and_then(|(line, _)| information(&self.scene, &line, &self.points, huber))
                .and_then(|all| without_line(&all))
        } else {
            information(&self.scene, &tumbling, &self.points, huber)
        };
        let covariance = known
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
