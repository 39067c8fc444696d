//! The dynamic adjustment from a motion that is nearly right to the solution.

use nalgebra::{SMatrix, UnitQuaternion, Vector3};

use super::adjust::{AdjustOptions, PoseModel, adjust, information};
use super::ambiguity::best_hypothesis;
use super::frames::Frames;
use super::free_motion::FreeMotion;
use super::model_fit::{ModelFit, TumblingModel, dispersion, settle, sharpen, simplest};
use super::pixel_likelihood::PixelLikelihood;
use super::pose_model::free_positions::{COMMON, FreePositions};
use super::pose_model::linear_com_motion::{LINE, LinearComMotion, marginalise_line};
use super::scene::Scene;
use super::structure::{Segment, SolverSettings, scene_of};
use super::transferred_structure::{structure_from_attitudes, transfer_structure};
use super::uncertainty::{Residuals, report};
use super::{BodyPoint, BodyPose, Options, Solution};
use crate::estimation::EstimateError;
use crate::vision::Pinhole;

/// The result of the dynamic adjustment.
pub struct GlobalFit {
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
    /// The time from which on the frames fit one motion, if not all do \[s\].
    pub since: Option<f64>,
    loss: PixelLikelihood,
    dispersion: f64,
    linear_com: bool,
    /// What each frame leaves with a pose of its own \[px\].
    unmodelled: Option<f64>,
    /// Another rate that explains the images as well \[rad/s\].
    alternative: Option<f64>,
    settings: SolverSettings,
}

/// Adjusts motion, points and positions together, from a motion that is nearly right.
pub fn adjust_globally(
    mut frames: Frames,
    motion: FreeMotion,
    segments: &[Segment],
    turns: &[UnitQuaternion<f64>],
    settings: &SolverSettings,
) -> Option<GlobalFit> {
    let times: Vec<f64> = frames.list.iter().map(|f| f.time).collect();
    let attitudes: Vec<_> = (motion.attitudes(&times).into_iter().zip(&frames.list))
        .map(|(R_WB, f)| f.R_WC.inverse() * R_WB)
        .collect();
    // The segments judged points by poses of their own; here the motion judges.
    for observation in frames.list.iter_mut().flat_map(|f| &mut f.observations) {
        observation.inlier = true;
    }
    let mut log_focal = 0.0;
    let single = (segments.len() == 1).then(|| &segments[0]);
    let known = single.and_then(|s| {
        log_focal = s.log_focal;
        transfer_structure(&frames, s, &turns[0], &attitudes, settings)
    });
    let (point_of, position_of) = match known {
        Some(known) => known,
        None => structure_from_attitudes(&frames, &attitudes, settings)?,
    };
    let chosen: Vec<usize> = (0..frames.list.len())
        .filter(|&i| {
            let correspondences = frames.list[i]
                .observations
                .iter()
                .filter(|s| point_of[s.track].is_some());
            position_of[i].is_some() && correspondences.count() >= 2
        })
        .collect();
    let wanted = |track: usize| point_of[track].is_some();
    let (mut scene, tracks) = scene_of(&frames, &chosen, wanted, settings.noise, 2);
    let points: Vec<_> = tracks.iter().filter_map(|t| point_of[*t]).collect();
    let t_C: Vec<_> = chosen.iter().filter_map(|i| position_of[*i]).collect();
    let times: Vec<f64> = chosen.iter().map(|i| times[*i]).collect();
    let R_WC: Vec<_> = chosen.iter().map(|i| frames.list[*i].R_WC).collect();
    let focal = settings.focal_free.then_some(log_focal);
    let free_positions = FreePositions::new(motion, t_C, &times, &R_WC, settings.noise, focal);
    let fixed = R_WC.iter().all(|R| *R == UnitQuaternion::identity());
    let line = single
        .filter(|_| fixed)
        .and_then(|s| fit_linear_com(&mut scene, &free_positions, &points, s.rms, settings));
    let fitted = match line {
        Some(line) => ComMotion::Linear(line),
        None => {
            let free = settle(&mut scene, free_positions, points, settings)?;
            let free = simplest(&scene, free, settings);
            let line = fixed.then(|| try_linear_com(&scene, &free, settings));
            line.flatten()
                .map_or(ComMotion::Free(free), ComMotion::Linear)
        }
    };
    let linear_com = matches!(fitted, ComMotion::Linear(_));
    let alternative;
    let (free_positions, points, residuals, loss, dispersion) = match fitted {
        ComMotion::Linear(fit) => {
            let (mut fit, other) = best_hypothesis(&mut scene, fit, settings);
            alternative = other;
            let loss = sharpen(&scene, &mut fit, settings);
            let dispersion = dispersion(&scene, &fit, &loss);
            let free = fit.motion.into_free();
            (free, fit.points, fit.residuals, loss, dispersion)
        }
        ComMotion::Free(fit) => {
            let (mut fit, other) = best_hypothesis(&mut scene, fit, settings);
            alternative = other;
            let loss = sharpen(&scene, &mut fit, settings);
            let dispersion = dispersion(&scene, &fit, &loss);
            (fit.motion, fit.points, fit.residuals, loss, dispersion)
        }
    };
    let FreePositions {
        motion,
        t_C,
        log_focal,
        ..
    } = free_positions;
    Some(GlobalFit {
        frames,
        chosen,
        tracks,
        scene,
        motion,
        t_C,
        points,
        log_focal,
        residuals,
        since: None,
        loss,
        dispersion,
        linear_com,
        unmodelled: unmodelled(segments),
        alternative,
        settings: *settings,
    })
}

/// What frames with poses of their own leave \[px\].
fn unmodelled(segments: &[Segment]) -> Option<f64> {
    let resected: usize = segments.iter().map(Segment::resected).sum();
    let sum = |s: &Segment| s.resected() as f64 * s.rms.powi(2);
    (resected > 0).then(|| (segments.iter().map(sum).sum::<f64>() / resected as f64).sqrt())
}

/// How the centre of mass moves.
enum ComMotion<'a> {
    Linear(ModelFit<LinearComMotion<'a>>),
    Free(ModelFit<FreePositions<'a>>),
}

/// The motion with its centre of mass on a linear_com line, from a start that may be off. `None` if that leaves more
/// than the noise \[px\] that poses of their own leave.
fn fit_linear_com<'a>(
    scene: &mut Scene,
    start: &FreePositions<'a>,
    points: &[Vector3<f64>],
    noise: f64,
    settings: &SolverSettings,
) -> Option<ModelFit<LinearComMotion<'a>>> {
    let mut judged = scene.clone();
    let (line, centre) = LinearComMotion::new(start.clone())?;
    let points = points.iter().map(|p| p - centre).collect();
    let fit = settle(&mut judged, line, points, settings)?;
    let fit = simplest(&judged, fit, settings);
    // A variance from so many residuals is known so well.
    let spread = (2.0 / (2 * judged.observations().len()).max(1) as f64).sqrt();
    let accepted = fit.residuals.deviation.powi(2) < noise.powi(2) * (1.0 + 4.0 * spread)
        && fit.residuals.outliers < 0.3;
    if !accepted {
        return None;
    }
    *scene = judged;
    Some(fit)
}

/// The fit with its centre of mass on a linear_com line, if the images do not object.
fn try_linear_com<'a>(
    scene: &Scene,
    free: &ModelFit<FreePositions<'a>>,
    settings: &SolverSettings,
) -> Option<ModelFit<LinearComMotion<'a>>> {
    let adjust_options = AdjustOptions {
        loss: PixelLikelihood::Huber(4.0 * settings.noise),
        steps: 8,
        tolerance: 1e-5,
    };
    let (mut motion, centre) = LinearComMotion::new(free.motion.clone())?;
    let mut points: Vec<_> = free.points.iter().map(|p| p - centre).collect();
    let reached = adjust(scene, &mut motion, &mut points, &adjust_options)?;
    // What the positions' freedom takes from the cost if it is noise that they fit: half a variance each.
    let fewer = (3 * scene.len()) as f64 - LINE as f64;
    let expected = 0.5 * (fewer + 4.0 * (2.0 * fewer).sqrt()) * free.residuals.deviation.powi(2);
    (reached.cost < free.cost + expected).then_some(ModelFit {
        motion,
        points,
        residuals: free.residuals,
        cost: reached.cost,
    })
}

impl GlobalFit {
    /// By how much the body turned \[rad\].
    pub fn turn(&self) -> f64 {
        let time = |i: Option<&usize>| i.map_or(0.0, |i| self.frames.list[*i].time);
        let whole = time(self.chosen.last()) - time(self.chosen.first());
        self.motion.w_WB_B(&self.motion.R_WB).norm() * whole
    }

    /// By how much the covariance is to be larger than that of independent residuals. What the motion leaves and
    /// poses of the frames' own do not is no noise: it is the same in all frames, which then tell no more than
    /// one does.
    fn widening(&self) -> f64 {
        let Some(noise) = self.unmodelled else {
            return 1.0;
        };
        let count = self.scene.observations().len().max(1) as f64;
        let excess = (self.residuals.deviation / noise).powi(2) - 1.0;
        // A variance from so many residuals is known so well.
        if excess < 4.0 * count.recip().sqrt() {
            return 1.0;
        }
        1.0 + excess * count / self.points.len().max(1) as f64
    }

    /// The solution, with covariance and diagnosis.
    pub fn finish(self, camera: &Pinhole, options: &Options) -> Result<Solution, EstimateError> {
        let widening = self.widening();
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
        let free_positions =
            FreePositions::new(motion, self.t_C, &times, &R_WC, self.settings.noise, focal);
        if let Some(other) = self.alternative {
            let rate = free_positions.rate().norm();
            return Err(EstimateError::Ambiguous {
                turn: free_positions.turn(),
                rates: [rate.min(other), rate.max(other)],
            });
        }
        let not_free = EstimateError::NotFree {
            rms: self.residuals.rms,
        };
        let known = if self.linear_com {
            LinearComMotion::new(free_positions.clone())
                .and_then(|(line, _)| information(&self.scene, &line, &self.points, &self.loss))
                .and_then(|all| marginalise_line(&all))
        } else {
            information(&self.scene, &free_positions, &self.points, &self.loss)
        };
        // The residuals tell how exact the images are, not what was known before.
        let prior =
            free_positions.prior().0 * (self.dispersion / self.settings.noise.powi(2) - 1.0);
        let covariance = known
            .and_then(|i| (i + SMatrix::from_diagonal(&prior)).try_inverse())
            .map(|c| c * (self.dispersion * widening))
            .ok_or_else(|| not_free.clone())?;
        let mut report = report(
            &motion,
            &covariance,
            &self.residuals,
            options,
            self.log_focal,
        )
        .ok_or(not_free)?;
        if widening > 1.0 {
            report.diagnosis.push(format!(
                "the motion leaves {:.2} px where frames by themselves leave {:.2} px: what is wrong is the same in many \
                 frames (focal length? lens?), so the deviations told are {:.1} times as large",
                self.residuals.deviation,
                self.unmodelled.unwrap_or_default(),
                widening.sqrt()
            ));
        }
        if let Some(since) = self.since {
            report.diagnosis.push(format!(
                "frames before {since:.1} s fit no free motion together with later ones, and were left out: next to \
                 turning over the least disturbance decides"
            ));
        }
        let scale = self.log_focal.exp();
        let poses = (0..self.chosen.len()).map(|k| {
            let pose = free_positions.pose(k);
            BodyPose {
                time: times[k],
                R_CB: pose.R_CB,
                t_C: pose.t_C,
            }
        });
        // Of a track that was cut, the last part has the id now, and the lowest number.
        let ids = &self.frames.ids;
        let points = (self.points.iter().zip(&self.tracks))
            .filter(|(_, track)| ids.iter().position(|id| *id == ids[**track]) == Some(**track));
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
