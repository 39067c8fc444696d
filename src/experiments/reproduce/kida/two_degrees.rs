//! Figs. 4.22 to 4.25: direct feedback of angle and rate, and feed-forward that matches a reference model.

use fuyu_lti::kida1993::air_table::structure;
use fuyu_lti::kida1993::double_loop::disturbance;
use fuyu_lti::kida1993::two_degrees::{
    CASES, Case, ModelMatching, feedback_only, model_matching, reference_model, root_locus, step,
};
use fuyu_lti::{Complex, LtiError, Matrix, StateSpace};

use super::completed;
use super::diagrams::{
    abscissa, bode, branches, marks, over_time, pole_map, sampled, series, time_figure, upper,
};
use crate::experiments::reproduce::Report;
use crate::experiments::{Figure, Mark, Panel, Series};

/// Weight of the matching error. With 1, the printed value, the feed-forward signals cost as much as the error and are
/// hardly used.
const WEIGHT: f64 = 1000.0;

const STEP: f64 = 0.01;
const SAMPLES: usize = 1501;

const MATCHING: &str = "The text takes W0 = W1 = 1, with which the forward signals are hardly used; here W0 = 1000. \
    The book shows measured responses; here seven modes are simulated.";

fn label(case: &Case) -> String {
    format!("{} {} [1 {:.1}]", case.name, case.p, case.d / case.p)
}

/// The slowest closed-loop pole.
fn slowest(poles: &[Complex]) -> Complex {
    let by_size = |a: &&Complex, b: &&Complex| a.norm().total_cmp(&b.norm());
    poles.iter().min_by(by_size).copied().unwrap_or_default()
}

pub(super) fn fig_4_22(report: Report) -> Report {
    completed(report, |report| {
        let factors: Vec<f64> = (0..=500)
            .map(|i| 1e-3 * 10f64.powf(f64::from(i) / 80.0))
            .collect();
        for (case, letter) in CASES.iter().zip(["a", "b", "c"]) {
            let locus = root_locus(case, &factors)?;
            let worst = locus
                .iter()
                .map(|(_, poles)| abscissa(poles))
                .fold(f64::MIN, f64::max);
            report.holds(
                &format!(
                    "case {}: largest real part along the locus [rad/s]: stable for every k",
                    case.name
                ),
                worst,
                worst < 0.0,
            );
            let poles = root_locus(case, &[1.0])?.remove(0).1;
            let lowest = slowest(&poles);
            let ratio = -lowest.re / lowest.norm();
            match letter {
                "a" => report.holds(
                    "case (a): damping ratio of the lowest poles, small: below .5",
                    ratio,
                    ratio < 0.5,
                ),
                "b" => report.not_reproduced(
                    "case (b): damping ratio of the lowest poles, .71 in the text",
                    ratio,
                    (0.45..0.52).contains(&ratio),
                ),
                _ => report.holds(
                    "case (c): damping ratio of the lowest poles, critically damped: above .95",
                    ratio,
                    ratio > 0.95,
                ),
            }
            // Zeros of the loop k (P + D s) G.
            let loop_gain = Matrix::from_row_slice(1, 2, &[case.p, case.d]);
            let zeros = structure(7)?
                .displacement_and_rate_system()?
                .scaled_outputs(&loop_gain)?
                .zeros()?;
            let open = structure(7)?.displacement_system()?.poles()?;
            let mut map = pole_map(
                &format!("Kida 1993 Fig. 4.22: root locus, case {}", label(case)),
                vec![
                    marks("k = 0", Mark::Cross, upper(&open)),
                    marks("zeros", Mark::Ring, upper(&zeros)),
                    marks("k = 1", Mark::Plus, upper(&poles)),
                ],
                Some([(-12.0, 1.0), (-1.0, 32.0)]),
            );
            map.series.push(series("0 < k < 1800", branches(&locus)));
            report.planes.push((format!("kida-fig-4.22-{letter}"), map));
        }
        report.note("Modes above 5 Hz are outside of the pictures. The text has case (c) as 8 [0.2 1], which is 1.6 [1 \
                     5].");
        report.note("The text calls the damping ratio of case (b) 'about 1/sqrt 2'. With the printed gains and Table \
             3.1 it is .49 for the rigid mode alone, D / (2 sqrt(P J)), and .48 with seven modes.");
        Ok(())
    })
}

/// The angle \[deg\] after a torque of 0.35 N m for a second, under direct feedback.
fn pushed(case: &Case) -> Result<Vec<f64>, LtiError> {
    let gain = StateSpace::gain(Matrix::from_row_slice(1, 2, &[case.p, case.d]));
    let run = disturbance(&structure(7)?, &gain, STEP * (SAMPLES - 1) as f64)?;
    Ok(run.output.iter().map(|y| y[0].to_degrees()).collect())
}

fn degrees(radians: Vec<f64>) -> Vec<f64> {
    radians.into_iter().map(f64::to_degrees).collect()
}

fn rms(a: &[f64], b: &[f64]) -> f64 {
    let squares: f64 = a.iter().zip(b).map(|(x, y)| (x - y).powi(2)).sum();
    (squares / a.len() as f64).sqrt()
}

fn matched() -> Result<Vec<ModelMatching>, LtiError> {
    CASES
        .iter()
        .map(|case| model_matching(case, WEIGHT, 1e-3))
        .collect()
}

fn responses(title: &str, steps: Vec<Series>, pushes: Vec<Series>) -> Figure {
    time_figure(
        title,
        vec![
            over_time("step: angle [deg]", steps),
            over_time("pulse: angle [deg]", pushes),
        ],
    )
}

pub(super) fn fig_4_23(report: Report) -> Report {
    completed(report, |report| {
        let model = degrees(step(&reference_model()?, STEP, SAMPLES)?);
        let (mut steps, mut pushes, mut apart) = (Vec::new(), Vec::new(), f64::INFINITY);
        for case in &CASES {
            let angle = degrees(step(&feedback_only(case)?, STEP, SAMPLES)?);
            let distance = rms(&angle, &model);
            apart = apart.min(distance);
            report.holds(
                &format!(
                    "case {}: rms distance of the step from the reference model [deg]",
                    case.name
                ),
                distance,
                distance > 0.02,
            );
            steps.push(sampled(&label(case), STEP, angle));
            pushes.push(sampled(&label(case), STEP, pushed(case)?));
        }
        let largest: Vec<f64> = (pushes.iter())
            .map(|s| s.points.iter().map(|p| p.1.abs()).fold(0.0, f64::max))
            .collect();
        report.holds(
            "pulse: largest angle in case (c) over that in (a): the gains decide, above 1",
            largest[2] / largest[0],
            largest[2] > largest[0],
        );
        report.note("Direct feedback alone. The book shows measured responses without numbers; here seven modes are \
                     simulated.");
        let title = "Kida 1993 Fig. 4.23: direct feedback, step of 1 deg and torque pulse";
        report
            .figures
            .push(("kida-fig-4.23".to_owned(), responses(title, steps, pushes)));
        Ok(())
    })
}

pub(super) fn fig_4_24(report: Report) -> Report {
    completed(report, |report| {
        let model = degrees(step(&reference_model()?, STEP, SAMPLES)?);
        let (mut steps, mut pushes) = (Vec::new(), Vec::new());
        for design in matched()? {
            let case = design.case;
            let before = rms(
                &degrees(step(&feedback_only(&case)?, STEP, SAMPLES)?),
                &model,
            );
            let angle = degrees(step(&design.achieved, STEP, SAMPLES)?);
            let after = rms(&angle, &model);
            report.holds(
                &format!("case {}: rms distance from the reference model over that of Fig. 4.23, below .2", case.name),
                after / before,
                after < 0.2 * before,
            );
            steps.push(sampled(&label(&case), STEP, angle));
            pushes.push(sampled(&label(&case), STEP, pushed(&case)?));
        }
        steps.push(sampled("reference model", STEP, model));
        report.note("Feed-forward does not change the response to disturbances: the lower panel is that of Fig. 4.23, \
                     as the text says.");
        report.note(MATCHING);
        let title = "Kida 1993 Fig. 4.24: two degrees of freedom, step of 1 deg and torque pulse";
        report
            .figures
            .push(("kida-fig-4.24".to_owned(), responses(title, steps, pushes)));
        Ok(())
    })
}

pub(super) fn fig_4_25(report: Report) -> Report {
    completed(report, |report| {
        let model = reference_model()?;
        let poles = model.poles()?;
        let damping = poles.iter().map(|p| -p.re / p.norm()).fold(1.0, f64::min);
        report.near(
            "reference model critically damped: damping ratio",
            1.0,
            damping,
            1e-6,
        );
        let mut panels = Vec::new();
        for design in matched()? {
            let name = design.case.name;
            let norm = design.hinf.norm.norm.max(design.hinf.norm.swept);
            report.holds(
                &format!("case {name}: norm of the matching problem over its bound, by two methods, not above 1"),
                norm / design.hinf.gamma,
                norm <= 1.000_001 * design.hinf.gamma,
            );
            let worst = |system: &StateSpace| {
                let at = (0..=100).map(|i| 0.01 * 10f64.powf(0.02 * f64::from(i)));
                at.map(|w| {
                    let [a, b] =
                        [system.response(w), model.response(w)].map(|g| g.map(|g| g[(0, 0)]));
                    Ok((a? - b?).norm())
                })
                .try_fold(0.0, |worst: f64, d: Result<f64, LtiError>| {
                    d.map(|d| worst.max(d))
                })
            };
            let (rigid, all) = (worst(&design.matched)?, worst(&design.achieved)?);
            report.holds(
                &format!("case {name}: largest |G_yr - G_M| to 1 rad/s, rigid model, below .05"),
                rigid,
                rigid < 0.05,
            );
            report.holds(
                &format!("case {name}: the same with seven modes, below .05"),
                all,
                all < 0.05,
            );
            let figure = bode(
                "",
                &[
                    ("G_yr, rigid", &design.matched),
                    ("G_yr, seven modes", &design.achieved),
                    ("G_M", &model),
                ],
                (0.01, 200.0),
                (-140.0, 20.0),
            )?;
            let gains = figure.panels.into_iter().next();
            panels.extend(gains.map(|panel| Panel {
                y_label: format!("case {name}: gain [dB]"),
                ..panel
            }));
        }
        report.note(MATCHING);
        report.note("The text writes the reference model's damping once as c, once as d; c = sqrt 2 and k = 1/2 \
                     satisfy c^2 = 4 k.");
        let figure = Figure {
            title: "Kida 1993 Fig. 4.25: reference to angle, matched and reached".to_owned(),
            x_label: super::diagrams::FREQUENCY.to_owned(),
            log_x: true,
            panels,
        };
        report.figures.push(("kida-fig-4.25".to_owned(), figure));
        Ok(())
    })
}
