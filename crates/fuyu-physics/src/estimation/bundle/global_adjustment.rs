//! Global bundle adjustment: motion, points and positions of all frames together, from an approximate motion.

use nalgebra::{UnitQuaternion, Vector3};

use super::adjust::{AdjustOptions, adjust};
use super::ambiguity::best_hypothesis;
use super::disturbed_fit::{DisturbedFit, describe, fit_with_disturbances};
use super::frames::Frames;
use super::free_motion::FreeMotion;
use super::inlier_gate::Residuals;
use super::intrinsics::Intrinsics;
use super::model_fit::{ModelFit, fit_robustly, prefer_sphere};
use super::pixel_likelihood::PixelLikelihood;
use super::pose_model::TumblingModel;
use super::pose_model::disturbed::{DisturbedMotion, INDEPENDENT, SMOOTH};
use super::pose_model::free_positions::FreePositions;
use super::pose_model::linear_com_motion::{LINE, LinearComMotion};
use super::scene::Scene;
use super::structure::{Segment, SolverSettings, scene_of};
use super::transferred_structure::{structure_from_attitudes, transfer_structure};
use super::uncertainty::report;
use super::{BodyPoint, BodyPose, CentreMotion, Options, Solution};
use crate::estimation::EstimateError;
use crate::vision::Pinhole;

/// Least variance factor of time-correlated errors that is mentioned in the diagnosis.
const NOTED: f64 = 4.0;

/// Result of the global adjustment.
pub struct GlobalFit {
    frames: Frames,
    chosen: Vec<usize>,
    tracks: Vec<usize>,
    observations: usize,
    fit: DisturbedFit,
    is_smooth: bool,
    /// Statistics of the residuals.
    pub residuals: Residuals,
    /// Time from which the frames fit one motion, if not all of them do \[s\].
    pub since: Option<f64>,
    /// RMS residual with one independent pose per frame \[px\].
    pub independent_rms: Option<f64>,
    /// Angular rate of a different motion that explains the images equally well \[rad/s\].
    alternative: Option<f64>,
    turn: f64,
}

/// Adjusts motion, points and positions together, from an approximate motion. `turns` are the rotations from the axes
/// of each segment to the body axes of `motion`.
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
    // The inlier gates of the segments used independent poses; gate all observations again.
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
    scene.expect_centre(settings.noise);
    let points: Vec<_> = tracks.iter().filter_map(|t| point_of[*t]).collect();
    let t_C: Vec<_> = chosen.iter().filter_map(|i| position_of[*i]).collect();
    let times: Vec<f64> = chosen.iter().map(|i| times[*i]).collect();
    let R_WC: Vec<_> = chosen.iter().map(|i| frames.list[*i].R_WC).collect();
    let free_positions = FreePositions::new(
        motion,
        t_C,
        &times,
        &R_WC,
        settings.noise,
        log_focal,
        settings.widths.focal,
    );
    let fixed = R_WC.iter().all(|R| *R == UnitQuaternion::identity());
    let line = single
        .filter(|_| fixed)
        .and_then(|s| fit_linear_com(&mut scene, &free_positions, &points, s.rms, settings));
    let fitted = match line {
        Some(line) => ComMotion::Linear(line),
        None => {
            let free = fit_robustly(&mut scene, free_positions, points, settings)?;
            let free = prefer_sphere(&scene, free, settings);
            let line = fixed.then(|| try_linear_com(&scene, &free, settings));
            line.flatten()
                .map_or(ComMotion::Free(free), ComMotion::Linear)
        }
    };
    let mut widths = settings.widths;
    widths.centre *= 0.5 * (scene.focal.x + scene.focal.y);
    let disturbed = |rotation: FreePositions, line: Option<(Vector3<f64>, Vector3<f64>)>| {
        let intrinsics = Intrinsics::of_focal(rotation.log_focal);
        let (noise, orbit) = (settings.noise, settings.orbit);
        let shape_spread = rotation.shape_spread;
        let (motion, t_C) = (rotation.motion, rotation.t_C);
        let mut model =
            DisturbedMotion::new(motion, t_C, line, &times, &R_WC, noise, widths, orbit);
        model.intrinsics = intrinsics;
        model.shape_spread = shape_spread;
        model
    };
    let is_smooth = matches!(fitted, ComMotion::Linear(_));
    let with_points = settings.with_points;
    let (fit, alternative, turn) = match fitted {
        ComMotion::Linear(fit) => {
            let (fit, other) = best_hypothesis(&mut scene, fit, settings);
            let turn = fit.motion.turn();
            let (rotation, start, displacement) = fit.motion.into_parts();
            let model = disturbed(rotation, Some((start, displacement)));
            let found = fit_with_disturbances::<0, SMOOTH>(
                &mut scene,
                model,
                fit.points,
                settings,
                with_points,
            )?;
            (found, other, turn)
        }
        ComMotion::Free(fit) => {
            let (fit, other) = best_hypothesis(&mut scene, fit, settings);
            let turn = fit.motion.turn();
            let model = disturbed(fit.motion, None);
            let found = fit_with_disturbances::<3, INDEPENDENT>(
                &mut scene,
                model,
                fit.points,
                settings,
                with_points,
            )?;
            (found, other, turn)
        }
    };
    Some(GlobalFit {
        observations: scene.observations().len(),
        frames,
        chosen,
        tracks,
        is_smooth,
        residuals: fit.residuals,
        fit,
        since: None,
        independent_rms: independent_rms(segments),
        alternative,
        turn,
    })
}

/// RMS residual of all segments, with one independent pose per frame \[px\].
fn independent_rms(segments: &[Segment]) -> Option<f64> {
    let resected: usize = segments.iter().map(Segment::resected).sum();
    let sum = |s: &Segment| s.resected() as f64 * s.rms.powi(2);
    (resected > 0).then(|| (segments.iter().map(sum).sum::<f64>() / resected as f64).sqrt())
}

/// Fit with linear motion of the centre of mass, or with free positions.
enum ComMotion<'a> {
    Linear(ModelFit<LinearComMotion<'a>>),
    Free(ModelFit<FreePositions<'a>>),
}

/// Fit with linear motion of the centre of mass, from a rough start. `None` if its residuals are larger than `noise`
/// \[px\], the residuals with independent poses.
fn fit_linear_com<'a>(
    scene: &mut Scene,
    start: &FreePositions<'a>,
    points: &[Vector3<f64>],
    noise: f64,
    settings: &SolverSettings,
) -> Option<ModelFit<LinearComMotion<'a>>> {
    let mut judged = scene.clone();
    let (line, centre) = LinearComMotion::new(start.clone(), points)?;
    let points = points.iter().map(|p| p - centre).collect();
    let fit = fit_robustly(&mut judged, line, points, settings)?;
    let fit = prefer_sphere(&judged, fit, settings);
    // Relative standard deviation of a variance estimated from this many residuals.
    let spread = (2.0 / (2 * judged.observations().len()).max(1) as f64).sqrt();
    let accepted = fit.residuals.deviation.powi(2) < noise.powi(2) * (1.0 + 4.0 * spread)
        && fit.residuals.outliers < 0.3;
    if !accepted {
        return None;
    }
    *scene = judged;
    Some(fit)
}

/// The fit with linear motion of the centre of mass, if the residuals do not contradict it.
fn try_linear_com<'a>(
    scene: &Scene,
    free: &ModelFit<FreePositions<'a>>,
    settings: &SolverSettings,
) -> Option<ModelFit<LinearComMotion<'a>>> {
    let adjust_options = AdjustOptions {
        likelihood: PixelLikelihood::Huber(4.0 * settings.noise),
        steps: 8,
        tolerance: 1e-5,
    };
    let (mut motion, centre) = LinearComMotion::new(free.motion.clone(), &free.points)?;
    let mut points: Vec<_> = free.points.iter().map(|p| p - centre).collect();
    let reached = adjust(scene, &mut motion, &mut points, &adjust_options)?;
    // Expected increase of the cost if the freedom of the positions fitted noise only: half a variance each, plus four
    // standard deviations.
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
    /// Angle that the body turned \[rad\].
    pub fn turn(&self) -> f64 {
        self.turn
    }

    /// Factor on the covariance of independent residuals. If the motion leaves larger residuals than independent poses,
    /// the difference is a systematic error common to all frames, and all frames together count as one observation.
    fn covariance_inflation(&self) -> f64 {
        let Some(noise) = self.independent_rms else {
            return 1.0;
        };
        let count = self.observations.max(1) as f64;
        let excess = (self.residuals.deviation / noise).powi(2) - 1.0;
        // Both variances are of the same noise; they differ by the degrees of freedom of independent poses, six per
        // frame.
        let differing = 6.0 * self.chosen.len() as f64;
        if excess < 4.0 * (2.0 * differing).sqrt() / (2.0 * count) {
            return 1.0;
        }
        1.0 + excess * count / self.fit.points.len().max(1) as f64
    }

    /// The solution, with covariance and diagnosis.
    pub fn finish(self, camera: &Pinhole, options: &Options) -> Result<Solution, EstimateError> {
        let inflation = self.covariance_inflation();
        let DisturbedFit {
            model,
            points,
            point_covariances,
            residuals,
            lasting,
            poses,
            mut state,
            centre: com,
            intrinsic_deviations,
        } = self.fit;
        state.inflate(inflation);
        if let Some(other) = self.alternative {
            let rate = state.angular_velocity().0.norm();
            return Err(EstimateError::Ambiguous {
                turn: self.turn,
                rates: [rate.min(other), rate.max(other)],
            });
        }
        let not_free = EstimateError::NotFree { rms: residuals.rms };
        let Intrinsics {
            log_focal,
            centre,
            radial,
        } = model.intrinsics;
        let mut report = report(
            &state,
            &residuals,
            options,
            (log_focal, intrinsic_deviations[0]),
        )
        .ok_or(not_free)?;
        report.diagnosis.extend(describe(
            &model.scales,
            self.is_smooth,
            options.widths.acceleration,
        ));
        if lasting > NOTED {
            report.diagnosis.push(format!(
                "the errors of the image points last from frame to frame, as those of a tracker do: standard deviations are {:.1} times as \
                 large for it",
                lasting.sqrt()
            ));
        }
        if inflation > 1.0 {
            report.diagnosis.push(format!(
                "the motion leaves residuals of {:.2} px, independent poses {:.2} px: an error common to many frames (lens \
                 distortion? torques?); standard deviations are {:.1} times as large for it",
                residuals.deviation,
                self.independent_rms.unwrap_or_default(),
                inflation.sqrt()
            ));
        }
        if let Some(since) = self.since {
            report.diagnosis.push(format!(
                "frames before {since:.1} s do not fit one free motion with the later ones and were left out: near the \
                 separatrix the smallest disturbance decides when the body turns over"
            ));
        }
        let scale = log_focal.exp();
        let times = self.chosen.iter().map(|i| self.frames.list[*i].time);
        // After a split, the last part of a track has the current id, and the lowest number.
        let ids = &self.frames.ids;
        let is_current = |track: usize| ids.iter().position(|id| *id == ids[track]) == Some(track);
        let numbered = self.tracks.iter().enumerate();
        let points = numbered
            .filter(|(_, track)| is_current(**track))
            .map(|(k, track)| BodyPoint {
                id: ids[*track],
                p_B: points[k],
                covariance: point_covariances.get(k).map(|c| c * inflation),
            });
        Ok(Solution {
            motion: report.motion,
            points: points.collect(),
            poses: (times.zip(&poses))
                .map(|(time, pose)| BodyPose {
                    time,
                    R_CB: pose.R_CB,
                    t_C: pose.t_C,
                })
                .collect(),
            camera: Pinhole {
                fx: camera.fx * scale,
                fy: camera.fy * scale,
                cx: camera.cx + centre.x,
                cy: camera.cy + centre.y,
            },
            radial,
            focal_deviation: (options.widths.focal > 0.0).then_some(intrinsic_deviations[0]),
            outliers: residuals.outliers,
            diagnosis: report.diagnosis,
            state,
            centre: com.map(|c| CentreMotion {
                covariance: c.covariance * inflation,
                ..c
            }),
        })
    }
}
