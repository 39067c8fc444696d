//! Figs. 3.12 to 3.15: loop-shaping examples 1 to 4.

use fuyu_lti::kida1993::loop_shaping::{RHO, Shapes, examples, shapes};
use fuyu_lti::{StateSpace, margins};

use super::diagrams::{FREQUENCY, bode, decibel, gain_curve, gain_panel};
use super::{completed, number};
use crate::experiments::Figure;
use crate::experiments::reproduce::Report;

/// Frequencies of the figure \[rad/s\].
const RANGE: (f64, f64) = (0.01, 1000.0);

fn gain(system: &StateSpace, w: f64) -> f64 {
    system.response(w).map_or(f64::NAN, |g| g[(0, 0)].norm())
}

/// Largest gain over all frequencies.
fn largest(system: &StateSpace) -> f64 {
    let at = (0..400).map(|i| 1e-3 * 10f64.powf(7.0 * f64::from(i) / 399.0));
    at.map(|w| gain(system, w)).fold(0.0, f64::max)
}

/// A design's name in the legend.
fn in_legend(name: &str) -> &str {
    match name {
        "J1" => "u weighted (J1)",
        "J2" => "y weighted (J2)",
        "J3" => "both weighted (J3)",
        other => other,
    }
}

/// One of the examples, chosen by the figure's number in the report's name.
pub(super) fn example(report: Report) -> Report {
    completed(report, |report| {
        let figure = number(report).to_owned();
        let index: usize = figure.trim_start_matches("3.").parse()?;
        let example = examples()?
            .into_iter()
            .nth(index - 12)
            .ok_or("an example of the book")?;
        let mut designs = Vec::new();
        for (name, cost) in &example.costs {
            designs.push((*name, shapes(cost)?));
        }
        let standard = &designs[designs.len() - 1].1;
        match &designs[..] {
            [(_, both), _] => mixed(report, both, standard),
            [(_, control), (_, output), _] => {
                single(report, example.number, control, output, standard)
            }
            _ => return Err("two or three designs".into()),
        }
        let crossover = margins(&standard.open_loop)?
            .phase
            .first()
            .map_or(f64::NAN, |p| p.frequency);
        if example.number == 1 {
            report.near(
                "gain crossover, 'about 2 rad/s' [rad/s]",
                2.0,
                crossover,
                1.0,
            );
        }
        if example.number == 4 {
            report.note(
                "The book prints q = (s+50)/(s+50), which is 1, and 1/r = 1/(s+.05), which is J1 of example 2 and does \
                 not do what the text says. Computed with q = (s+1)/(s+.05), the weight of example 3, and 1/r = \
                 50/(s+50), that of example 1.",
            );
        }
        report.note(&format!(
            "Rigid mode of the air table with the state measured, rho = {RHO}. The book shows curves without numbers: \
             gains of loop l, sensitivity s, response to disturbances m, complementary sensitivity t."
        ));
        let systems = |of: fn(&Shapes) -> &StateSpace| -> Vec<(&str, &StateSpace)> {
            designs
                .iter()
                .map(|(name, s)| (in_legend(name), of(s)))
                .collect()
        };
        let loops = bode(
            &format!(
                "Kida 1993 Fig. {figure}(a), example {}: loop l",
                example.number
            ),
            &systems(|s| &s.open_loop),
            RANGE,
            (-80.0, 120.0),
        )?;
        report
            .figures
            .push((format!("kida-fig-{figure}-loop"), loops));
        let panel = |label: &str, of: fn(&Shapes) -> &StateSpace, limits| {
            let curves: Result<Vec<_>, _> = (systems(of).iter())
                .map(|(name, s)| gain_curve(name, s, RANGE))
                .collect();
            curves.map(|curves| gain_panel(label, curves, limits))
        };
        let closed = Figure {
            title: format!(
                "Kida 1993 Fig. {figure}(b), example {}: s, m and t",
                example.number
            ),
            x_label: FREQUENCY.to_owned(),
            log_x: true,
            panels: vec![
                panel("s [dB]", |s| &s.sensitivity, (-120.0, 20.0))?,
                panel("m [dB]", |s| &s.disturbance, (-120.0, 0.0))?,
                panel("t [dB]", |s| &s.complementary, (-100.0, 20.0))?,
            ],
        };
        report
            .figures
            .push((format!("kida-fig-{figure}-closed"), closed));
        Ok(())
    })
}

/// Examples 1 to 3: weight on the control (J1) or on the output (J2).
fn single(
    report: &mut Report,
    example: usize,
    control: &Shapes,
    output: &Shapes,
    standard: &Shapes,
) {
    let slope = |s: &Shapes| (gain(&s.complementary, 1e5) / gain(&s.complementary, 1e6)).log10();
    let expected = if example == 3 { 1.0 } else { 2.0 };
    report.holds(
        &format!("Property 3.3: power with which t1 falls, {expected:.0}"),
        slope(control),
        (slope(control) - expected).abs() < 0.02,
    );
    report.holds(
        "Property 3.3: power with which t2 falls, 1, as with the standard regulator",
        slope(output),
        (slope(output) - 1.0).abs() < 0.02 && (slope(standard) - 1.0).abs() < 0.02,
    );
    let s_2 = largest(&output.sensitivity);
    report.holds(
        "Property 3.4: largest |s2|, not above 1",
        s_2,
        s_2 <= 1.0 + 1e-9,
    );
    let s_1 = largest(&control.sensitivity);
    if example != 3 {
        report.holds(
            "Property 3.4: largest |s1|, above 1: no circle condition",
            s_1,
            s_1 > 1.0 + 1e-4,
        );
    }
    let quotient =
        |of: fn(&Shapes) -> &StateSpace, a: &Shapes, w| gain(of(a), w) / gain(of(standard), w);
    if example == 1 {
        let high = quotient(|s| &s.complementary, control, 1e4);
        report.holds(
            "t1 over that of the standard regulator at 1e4 rad/s: only t1 is lower",
            high,
            high < 0.05,
        );
        let low = quotient(|s| &s.disturbance, control, 0.01);
        report.holds(
            "m1 over that of the standard regulator at .01 rad/s: no marked difference",
            low,
            (low - 1.0).abs() < 0.1,
        );
        let high = quotient(|s| &s.complementary, output, 1e4);
        report.holds(
            "t2 over that of the standard regulator at 1e4 rad/s: not lower",
            high,
            high > 0.9,
        );
        return;
    }
    let low = quotient(|s| &s.sensitivity, output, 0.01);
    report.holds(
        "s2 over that of the standard regulator at .01 rad/s: improved, below .3",
        low,
        low < 0.3,
    );
    let low = quotient(|s| &s.disturbance, output, 0.01);
    report.holds(
        "m2 over that of the standard regulator at .01 rad/s: improved, below .3",
        low,
        low < 0.3,
    );
    let low = quotient(|s| &s.disturbance, control, 0.1);
    report.holds(
        "m1 over that of the standard regulator at .1 rad/s: not improved, above .5",
        low,
        low > 0.5,
    );
    if example == 2 {
        let high = quotient(|s| &s.complementary, output, 1e4);
        report.holds(
            "t2 over that of the standard regulator at 1e4 rad/s [dB]: the same, to 2 dB",
            decibel(high),
            decibel(high).abs() < 2.0,
        );
        report.holds(
            "m1 is worse than that of the standard regulator: quotient above 1",
            low,
            low > 1.0,
        );
    }
}

/// Example 4: weights on both.
fn mixed(report: &mut Report, both: &Shapes, standard: &Shapes) {
    for (text, of, w, limit) in [
        (
            "s3 over that of the standard regulator at .01 rad/s: improved, below .3",
            (|s| &s.sensitivity) as fn(&Shapes) -> &StateSpace,
            0.01,
            0.3,
        ),
        (
            "m3 over that of the standard regulator at .01 rad/s: improved, below .3",
            |s| &s.disturbance,
            0.01,
            0.3,
        ),
        (
            "t3 over that of the standard regulator at 1e4 rad/s: improved, below .1",
            |s| &s.complementary,
            1e4,
            0.1,
        ),
    ] {
        let quotient = gain(of(both), w) / gain(of(standard), w);
        report.holds(text, quotient, quotient < limit);
    }
}
