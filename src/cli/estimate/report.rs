//! Output of `fuyu estimate`: JSON and text.

use std::fmt::Write as _;

use nalgebra::{Matrix3, Vector3};
use serde::Serialize;

use super::{Args, Found};
use crate::{
    cli::Failure,
    estimation::bundle::{CentreMotion, Scale},
    spatial::unwound,
};

type Rows = [[f64; 3]; 3];

/// Output of `--json`.
#[derive(Serialize)]
#[allow(non_snake_case)]
pub(super) struct Report {
    pub method: &'static str,
    pub model: &'static str,
    pub J: Option<[f64; 3]>,
    pub alpha: f64,
    angular_velocity: Vec<RateOutput>,
    pub prediction: Vec<AttitudeOutput>,
    pub rms: f64,
    /// Covariance of `J` and `alpha`.
    pub covariance: Option<[[f64; 4]; 4]>,
    /// Axes of `J` in the body axes of `q`, one axis per row.
    principal_axes: Option<Rows>,
    state: Option<StateOutput>,
    momentum: MomentumOutput,
    points: Vec<PointOutput>,
    centre: Option<CentreOutput>,
    pub focal_length: Option<f64>,
    focal_length_deviation: Option<f64>,
    principal_point: Option<[f64; 2]>,
    radial_distortion: Option<f64>,
    axes_time: f64,
    pub notes: Vec<String>,
}

#[derive(Serialize)]
struct RateOutput {
    t: f64,
    w: [f64; 3],
}

#[derive(Serialize)]
pub(super) struct AttitudeOutput {
    pub t: f64,
    /// Quaternion x, y, z, w.
    q: [f64; 4],
    /// Covariance of the rotation since the last frame \[rad²\].
    turn_covariance: Option<Rows>,
}

/// State at the last frame.
#[derive(Serialize)]
struct StateOutput {
    t: f64,
    q: [f64; 4],
    /// Covariance of the attitude \[rad²\].
    attitude_covariance: Rows,
    w: [f64; 3],
    /// Covariance of the angular velocity \[rad²/s²\].
    w_covariance: Rows,
    /// Angular acceleration due to torques \[rad/s²\].
    angular_acceleration: [f64; 3],
}

#[derive(Serialize)]
struct MomentumOutput {
    /// Direction of the angular momentum.
    direction: [f64; 3],
    /// Covariance of the direction \[rad²\].
    covariance: Option<Rows>,
    /// Momentum over twice the kinetic energy \[s\].
    over_twice_energy: f64,
}

#[derive(Serialize)]
struct PointOutput {
    id: u64,
    /// Position in the body axes of `q`; for the unit see `centre`.
    p: [f64; 3],
    covariance: Option<Rows>,
}

/// The centre of mass at the last frame.
#[derive(Serialize)]
struct CentreOutput {
    position: [f64; 3],
    velocity: [f64; 3],
    /// Covariance of position and velocity.
    covariance: [[f64; 6]; 6],
    /// `m`, or, if the scale is unknown, `depth`: the depth of the centre in the first frame.
    unit: &'static str,
}

fn rows(m: &Matrix3<f64>) -> Rows {
    m.transpose().into()
}

impl Report {
    pub(super) fn new(found: &Found, args: &Args) -> Result<Self, Failure> {
        let (estimated, R_CI) = (&found.estimated, found.R_IC.inverse());
        let motion = &estimated.motion;
        let R = *R_CI.to_rotation_matrix().matrix();
        let turned = |m: &Matrix3<f64>| rows(&(R * m * R.transpose()));
        let steps = (args.predict * args.predict_rate + 1e-9).floor() as u32;
        let time = |k: u32| found.end + f64::from(k) / args.predict_rate;
        let times: Vec<f64> = (0..=steps).map(time).collect();
        let spreads = estimated.state.as_ref().map(|s| s.turn_covariances(&times));
        let attitudes = times.iter().map(|t| estimated.seen_from(&found.R_IC, *t).0);
        let prediction = (0..).zip(unwound(attitudes)).map(|(k, q)| AttitudeOutput {
            t: times[k],
            q: [q.i, q.j, q.k, q.w],
            turn_covariance: spreads.as_ref().map(|s| turned(&s[k])),
        });
        let state = estimated.state.as_ref().map(|state| {
            let (R_CB, w) = estimated.seen_from(&found.R_IC, found.end);
            StateOutput {
                t: found.end,
                q: [R_CB.i, R_CB.j, R_CB.k, R_CB.w],
                attitude_covariance: turned(&state.attitude_covariance()),
                w: w.into(),
                w_covariance: turned(&state.angular_velocity().1),
                angular_acceleration: (R * state.acceleration).into(),
            }
        });
        let direction = R_CI * motion.momentum_direction();
        let mut notes = estimated.diagnosis.clone();
        let solution = estimated.solution.as_ref();
        let scale = match (args.distance.or(args.range), solution) {
            (Some(known), Some(solution)) => {
                let option = if args.distance.is_some() {
                    "--distance"
                } else {
                    "--range"
                };
                let scale = solution.scale(&known);
                Some(scale.map_err(|e| Failure::Input(format!("{option}: {e}")))?)
            }
            (Some(_), None) => {
                return Err(Failure::Input(
                    "--distance and --range need feature tracks and --method bundle".to_owned(),
                ));
            }
            (None, Some(solution)) => solution.scale_of_ranges(&found.ranges),
            (None, None) => None,
        };
        notes.extend(found.ignored_clouds.clone());
        if let Some(solution) = solution {
            if scale.is_none() {
                notes.push(
                    "the scale is not determined: lengths are in units of the body's depth; give one distance between two \
                     points (--distance), the range of one (--range), or clouds of points on camera/points in a bag"
                        .to_owned(),
                );
            }
            if solution.centre.is_none() {
                notes.push(
                    "the centre of mass is not determined: its path is not smooth, or the camera rotates".to_owned(),
                );
            }
        }
        let unit = if scale.is_some() { "m" } else { "depth" };
        let scale = scale.unwrap_or(Scale {
            metres: 1.0,
            deviation: 0.0,
        });
        let length = scale.metres;
        let estimates_focal = solution.filter(|s| s.focal_deviation.is_some());
        let points = solution.map(|s| s.points.as_slice()).unwrap_or_default();
        let rates = estimated.w_IB_I.iter();
        Ok(Self {
            method: estimated.method.name(),
            model: motion.model().name(),
            J: motion.J().map(Into::into),
            alpha: motion.alpha(),
            angular_velocity: rates
                .map(|(t, w)| RateOutput {
                    t: *t,
                    w: (R_CI * w).into(),
                })
                .collect(),
            prediction: prediction.collect(),
            rms: motion.rms(),
            covariance: motion.covariance().map(|c| c.transpose().into()),
            principal_axes: motion.principal_axes().as_ref().map(rows),
            state,
            momentum: MomentumOutput {
                direction: direction.into_inner().into(),
                covariance: (estimated.state.as_ref())
                    .map(|s| turned(&s.momentum_direction_covariance())),
                over_twice_energy: motion.alpha().sqrt(),
            },
            points: points
                .iter()
                .map(|p| PointOutput {
                    id: p.id,
                    p: (p.p_B * length).into(),
                    covariance: p.covariance.as_ref().map(|c| {
                        let along = p.p_B * scale.deviation;
                        rows(&(c * length.powi(2) + along * along.transpose()))
                    }),
                })
                .collect(),
            centre: (solution.and_then(|s| s.centre.as_ref()))
                .map(|c| CentreOutput::new(&c.in_metres(&scale), unit)),
            focal_length: estimates_focal.map(|s| s.camera.fx),
            focal_length_deviation: estimates_focal
                .and_then(|s| Some(s.focal_deviation? * s.camera.fx)),
            principal_point: estimates_focal.map(|s| [s.camera.cx, s.camera.cy]),
            radial_distortion: estimates_focal.map(|s| s.radial),
            axes_time: found.end,
            notes,
        })
    }
}

impl CentreOutput {
    fn new(centre: &CentreMotion, unit: &'static str) -> Self {
        Self {
            position: centre.position.into(),
            velocity: centre.velocity.into(),
            covariance: centre.covariance.into(),
            unit,
        }
    }
}

/// The table that is printed without `--json`.
pub(super) fn to_text(found: &Found, report: &Report) -> String {
    let mut out = String::new();
    // Writing to a string cannot fail.
    let mut row = |label: &str, value: String| {
        let _ = writeln!(out, "{label:<28}{value}");
    };
    row("input", found.input.clone());
    row("method", report.method.to_owned());
    row("model", report.model.replace('_', " "));
    let triple = |v: &[f64; 3]| format!("{:.6}  {:.6}  {:.6}", v[0], v[1], v[2]);
    let deviations = report
        .covariance
        .map(|c| [0, 1, 2, 3].map(|i| c[i][i].sqrt()));
    let spread = |d: &[f64]| {
        let d: Vec<_> = d.iter().map(|d| format!("{d:.1e}")).collect();
        format!("  +- {}", d.join("  "))
    };
    let J = (report.J.as_ref()).map_or("not determined by this motion".to_owned(), triple);
    let uncertainty = deviations.map_or_else(String::new, |d| spread(&d[..3]));
    row("J [s2]", J + &uncertainty);
    let uncertainty = deviations.map_or_else(String::new, |d| spread(&d[3..]));
    row("alpha [s2]", format!("{:.6}{uncertainty}", report.alpha));
    let w: Vector3<f64> = found.estimated.seen_from(&found.R_IC, found.end).1;
    let diagonal = |m: &Rows| [0, 1, 2].map(|k| m[k][k].max(0.0).sqrt());
    let uncertainty =
        (report.state.as_ref()).map_or_else(String::new, |s| spread(&diagonal(&s.w_covariance)));
    row(
        "angular velocity [rad/s]",
        format!("{}{uncertainty} at {:.3} s", triple(&w.into()), found.end),
    );
    row("momentum direction", triple(&report.momentum.direction));
    row("residual", format!("{:.4} {} rms", report.rms, found.unit));
    if let (Some(focal), Some(deviation)) = (report.focal_length, report.focal_length_deviation) {
        row(
            "focal length [px]",
            format!("{focal:.2}  +- {deviation:.2}"),
        );
    }
    if let (Some(first), Some(last)) = (report.prediction.first(), report.prediction.last()) {
        let deviation = (last.turn_covariance.as_ref()).map_or_else(String::new, |c| {
            let square: f64 = (0..3).map(|k| c[k][k]).sum();
            format!(
                " (standard deviation at the end {:.3} deg)",
                square.max(0.0).sqrt().to_degrees()
            )
        });
        row(
            "predicted",
            format!(
                "{:.1} s to {:.1} s{deviation}; --json has the attitudes",
                first.t, last.t
            ),
        );
    }
    for note in &report.notes {
        row("note", note.clone());
    }
    out
}
