//! Sec. 3.2 and 3.3: pliers in a spacecraft spin and flip periodically (intermediate axis theorem).

use nalgebra::{Matrix3, UnitQuaternion, Vector3};

use super::Report;
use super::study::SEED;
use crate::estimation::bundle;
use crate::estimation::free_body::FreeRotation;
use crate::estimation::masutani1995::{Analysis, Fit, Rate};
use crate::experiments::masutani_ch3::{self as chapter, CellErrors, Condition};
use crate::experiments::{Figure, Panel, PlaneFigure, Series};

/// Moments \[kg m²\], momentum \[N m s\] and energy \[J\]. The printed moments are ten times smaller; with these,
/// `L²/2E` would be outside their range.
const MOMENTS: [f64; 3] = [94.2, 94.2 * 4.0 / 7.0, 94.2 * 3.0 / 7.0];
const MOMENTUM: f64 = 46.3;
const ENERGY: f64 = 20.0;
/// Direction of the momentum in camera axes.
const DIRECTION: [f64; 3] = [0.250, -0.433, 0.866];
const RESOLUTION: u32 = 1024;
const POINTS: usize = 10;
/// Duration shown in Figs. 3.7, 3.11 and 3.12 \[s\].
const SHOWN: f64 = 100.0;

/// The motion, with minimal `|w|²` at time zero.
fn motion() -> Option<FreeRotation> {
    let J = Vector3::from(MOMENTS) / (2.0 * ENERGY);
    let alpha = (MOMENTUM / (2.0 * ENERGY)).powi(2);
    let spread = J.y - J.z;
    let square = Vector3::new(
        0.0,
        (alpha - J.z) / (J.y * spread),
        (J.y - alpha) / (J.z * spread),
    );
    let w = square.map(|s| s.max(0.0).sqrt());
    let nutation =
        UnitQuaternion::from_axis_angle(&Vector3::x_axis(), (J.y * w.y).atan2(J.z * w.z));
    let aim = UnitQuaternion::rotation_between(&Vector3::z(), &Vector3::from(DIRECTION))?;
    FreeRotation::new(&Matrix3::from_diagonal(&J), aim * nutation, &w, 0.0).ok()
}

pub(super) fn pliers(mut report: Report) -> Report {
    let seen = motion().map(|truth| {
        let points = chapter::points(POINTS, SEED);
        let condition = Condition::Images {
            resolution: RESOLUTION,
            points: &points,
        };
        let rates = chapter::rates(&truth, condition);
        let tracks = chapter::tracks(&truth, RESOLUTION, &points);
        (truth, rates, tracks)
    });
    let Some((truth, Ok(rates), tracks)) = seen else {
        report.holds("the images show a motion [-]", f64::NAN, false);
        return report;
    };
    shape(&mut report);
    turning_over(&mut report, &truth);
    let options = chapter::options();
    let solved = Analysis::new(&rates, &options).and_then(|a| {
        a.solve(&rates, &options)
            .map(|(estimate, fit)| (a, estimate, fit))
    });
    let mut lines = format!(
        "{:<16}{:>12}{:>14}{:>14}\n",
        "method", "r [-]", "Theta [deg]", "Phi [deg]"
    );
    let mut line = |name: &str, e: &CellErrors| {
        let (theta, phi) = (
            e.prediction.attitude.to_degrees(),
            e.prediction.axis.to_degrees(),
        );
        lines += &format!(
            "{name:<16}{:>12.2e}{theta:>14.3}{phi:>14.3}\n",
            e.parameters
        );
    };
    match solved {
        Err(_) => report.holds("the thesis's method answers [-]", f64::NAN, false),
        Ok((analysis, estimate, fit)) => {
            line("masutani1995", &chapter::judge(&estimate, &truth));
            let bin = analysis.spectrum.bin as f64;
            report.near("bin of the main spectral component [-]", 31.0, bin, 1.0);
            if let Some(parameters) = truth.parameters() {
                let (T, found) = (parameters.period(), analysis.spectrum.period);
                report.holds(
                    &format!("period of |w|² found, within 2 % of the true {T:.3} s [s]"),
                    found,
                    (found / T - 1.0).abs() < 0.02,
                );
            }
            draw(&mut report, &truth, &rates, &analysis, &fit);
        }
    }
    match bundle::estimate(
        &tracks,
        &chapter::camera(RESOLUTION),
        &bundle::Options::undisturbed(),
    ) {
        Err(_) => report.holds("bundle adjustment answers [-]", f64::NAN, false),
        Ok(solution) => {
            let errors = chapter::judge(&solution.motion, &truth);
            line("bundle", &errors);
            let phi = errors.prediction.axis.to_degrees();
            report.holds(
                "bundle adjustment, same images: Phi at most 0.05 deg [deg]",
                phi,
                phi <= 0.05,
            );
        }
    }
    report.listings.push(lines);
    report.note(
        "The print's moments (9.42, 5.38, 4.03) are ten times too small for its momentum and energy: L²/2E = 53.6 \
         would lie outside them. Taken: 94.2 and the exact ratios. I_z of (3.1) has cos², not sin².",
    );
    report
}

/// (3.1), with its misprint corrected, at an angle of 30 degrees.
fn shape(report: &mut Report) {
    let (sin, cos) = (std::f64::consts::PI / 6.0).sin_cos();
    let I = [
        (1.0 + 3.0 * sin * sin) / 3.0,
        4.0 / 3.0 * sin * sin,
        cos * cos / 3.0,
    ];
    report.near(
        "I_x / I_y of a V with 60 degrees [-]",
        7.0 / 4.0,
        I[0] / I[1],
        1e-6,
    );
    report.near(
        "I_y / I_z of a V with 60 degrees [-]",
        4.0 / 3.0,
        I[1] / I[2],
        1e-6,
    );
}

/// Number of flips of the pliers' axis during the 40 s of Figs. 3.3 and 3.4.
fn turning_over(report: &mut Report, truth: &FreeRotation) {
    let momentum = truth.momentum_direction();
    let along = |t: f64| momentum.dot(&(truth.attitude(t) * Vector3::y()));
    let sides: Vec<bool> = (0..=4000)
        .map(|i| along(0.01 * f64::from(i)) > 0.0)
        .collect();
    let turns = sides.windows(2).filter(|p| p[0] != p[1]).count() as f64;
    report.holds(
        "turns over and back within 40 s: times [-]",
        turns,
        turns >= 2.0,
    );
    let rotations = (0..1000).map(|i| {
        let t = 0.01 * f64::from(i);
        truth.angular_velocity(t).norm() * 0.01 / std::f64::consts::TAU
    });
    let rotations: f64 = rotations.sum();
    report.holds(
        "after a few rotations: from one end to turning over [-]",
        rotations,
        (1.0..5.0).contains(&rotations),
    );
    let figure = Figure {
        title: "Pliers: their axis along the momentum".to_owned(),
        x_label: "time [s]".to_owned(),
        panels: vec![Panel {
            y_label: "cosine [-]".to_owned(),
            series: vec![series(
                "y axis",
                (0..=400).map(|i| {
                    let t = 0.1 * f64::from(i);
                    (t, along(t))
                }),
            )],
            ..Panel::default()
        }],
        ..Figure::default()
    };
    report
        .figures
        .push((format!("{}-turning-over", report.name), figure));
}

fn series(name: &str, points: impl Iterator<Item = (f64, f64)>) -> Series {
    Series {
        name: name.to_owned(),
        points: points.collect(),
    }
}

/// Figs. 3.7 to 3.13.
fn draw(report: &mut Report, truth: &FreeRotation, rates: &[Rate], analysis: &Analysis, fit: &Fit) {
    let shown = |rate: &&Rate| rate.0 <= SHOWN;
    let exact = |t: f64| truth.angular_velocity(t);
    let fine = || (0..=1000).map(|i| f64::from(i) * SHOWN / 1000.0);
    let component = |i: usize| Panel {
        y_label: format!("w_{} [rad/s]", ["x", "y", "z"][i]),
        series: vec![
            series(
                "extracted",
                rates.iter().filter(shown).map(|(t, w)| (*t, w[i])),
            ),
            series("true", fine().map(|t| (t, exact(t)[i]))),
        ],
        ..Panel::default()
    };
    let over_time = |title: &str, panels| Figure {
        title: title.to_owned(),
        x_label: "time [s]".to_owned(),
        panels,
        ..Figure::default()
    };
    let squares = rates
        .iter()
        .filter(shown)
        .map(|(t, w)| (*t, w.norm_squared()));
    let mut waves = vec![
        series("extracted", squares),
        series("true", fine().map(|t| (t, exact(t).norm_squared()))),
    ];
    if let Fit::Asymmetric { waveform, .. } = fit {
        let start = rates[0].0;
        waves.push(series(
            "fit",
            fine().map(|t| (t, waveform.value(t - start))),
        ));
    }
    let normal = analysis.plane.normal;
    let x = normal.cross(&Vector3::x()).normalize();
    let y = normal.cross(&x);
    let in_plane = |w: &Vector3<f64>| (x.dot(w), y.dot(w));
    let angles = |points: &mut dyn Iterator<Item = (f64, (f64, f64))>| {
        let mut last: f64 = 0.0;
        let turn = std::f64::consts::TAU;
        let unwound = points.map(|(t, (a, b))| {
            let angle = b.atan2(a);
            last = angle + turn * ((last - angle) / turn).round();
            (t, last)
        });
        unwound.collect::<Vec<_>>()
    };
    let found = angles(&mut rates.iter().filter(shown).map(|(t, w)| (*t, in_plane(w))));
    let true_ = angles(&mut fine().map(|t| (t, in_plane(&exact(t)))));
    let stem = |what: &str| format!("{}-{what}", report.name);
    let figures = vec![
        (
            stem("fig-3.7"),
            over_time(
                "Masutani 1995 Fig. 3.7: angular velocity in camera axes",
                (0..3).map(component).collect(),
            ),
        ),
        (
            stem("fig-3.8"),
            over_time(
                "Masutani 1995 Figs. 3.8, 3.10: |w|² and its fit",
                vec![Panel {
                    y_label: "|w|² [rad²/s²]".to_owned(),
                    series: waves,
                    ..Panel::default()
                }],
            ),
        ),
        (
            stem("fig-3.9"),
            Figure {
                title: "Masutani 1995 Fig. 3.9: spectrum of |w|²".to_owned(),
                x_label: "bin [-]".to_owned(),
                panels: vec![Panel {
                    y_label: "|G| [rad²/s²]".to_owned(),
                    series: vec![series(
                        "extracted",
                        analysis
                            .spectrum
                            .magnitudes
                            .iter()
                            .enumerate()
                            .map(|(k, g)| (k as f64, *g)),
                    )],
                    ..Panel::default()
                }],
                ..Figure::default()
            },
        ),
        (
            stem("fig-3.13"),
            over_time(
                "Masutani 1995 Fig. 3.13: angle of the herpolhode",
                vec![Panel {
                    y_label: "chi [rad]".to_owned(),
                    series: vec![
                        series("extracted", found.into_iter()),
                        series("true", true_.into_iter()),
                    ],
                    ..Panel::default()
                }],
            ),
        ),
    ];
    let herpolhode = PlaneFigure {
        title: "Masutani 1995 Figs. 3.11, 3.12: herpolhode".to_owned(),
        x_label: "w in the plane [rad/s]".to_owned(),
        y_label: "w in the plane [rad/s]".to_owned(),
        series: vec![
            series(
                "extracted",
                rates.iter().filter(shown).map(|(_, w)| in_plane(w)),
            ),
            series("true", fine().map(|t| in_plane(&exact(t)))),
        ],
        ..PlaneFigure::default()
    };
    let plane = (stem("fig-3.12"), herpolhode);
    report.figures.extend(figures);
    report.planes.push(plane);
}
