//! Masutani 1995, chapter 6: the fixed-base Jacobian as an approximation.

use nalgebra::Vector3;

use super::Report;
use crate::control::JacobianKind;
use crate::experiments::masutani_ch6::{Example, Planar, Region, STABLE, UNSTABLE, gains};
use crate::experiments::{Figure, MapFigure, MapPanel, MapScale, Panel, PlaneFigure, Series};

const RATIOS: [f64; 6] = [0.5, 1.0, 2.0, 5.0, 10.0, 20.0];

const RECOVERED: &str = "Start and goal are not printed; they are recovered ones. Gains and robot (Table 6.2) are as \
    printed.";

/// The stable region for six mass ratios.
pub(super) fn fig_6_1(mut report: Report) -> Report {
    /// Number of angles per side of the integration grid.
    const ANGLES: usize = 120;
    let gains = gains(f64::INFINITY);
    let robots = RATIOS.map(Planar::with_mass_ratio);
    let parts = robots
        .clone()
        .map(|mut robot| robot.unstable_fraction(&gains, ANGLES));
    for (ratio, part) in RATIOS.into_iter().zip(parts) {
        let (claim, holds) = match ratio {
            r if r < 1.0 => (": fairly large", part > 0.1),
            r if r >= 5.0 => (": slight", part < 0.05),
            _ => ("", true),
        };
        let quantity = format!("mass ratio {ratio}, unstable part of the tip's area{claim}");
        report.holds(&quantity, part, holds);
    }
    let shrinks = parts.windows(2).map(|pair| pair[1] / pair[0]);
    let least = shrinks.fold(0.0, f64::max);
    report.holds(
        "it shrinks from each base to the next heavier one: largest quotient below 1",
        least,
        least < 1.0,
    );
    let mut other = gains.clone();
    other.k_p *= 4.0;
    other.k_v = vec![500.0, 300.0];
    let mut robot = robots[3].clone();
    let moved = (robot.unstable_fraction(&other, ANGLES) - parts[3]).abs();
    report.holds(
        "mass ratio 5, other gains (k_p times 4, K_V of 500 and 300) change the part by less than 0.002",
        moved,
        moved < 0.002,
    );
    report.note(
        "The text gives no numbers: for a very small mass ratio the unstable region is 'fairly large', from 5 on \
         'slight', and gains 'hardly' move it. An independent computation has .238, .152, .080, .0247, .0071 and \
         .0016 of the tip's area.",
    );
    report.note(
        "Elbow on one side (q2 > 0), positions in the base frame. The base of mass ratio 20 has 2000 kg, 1500 kg m² \
         and joint 1 at 1.75 m; the others are similar to it. Grey is out of reach.",
    );
    let axis = |first: f64, count: u32| -> Vec<f64> {
        (0..count).map(|k| first + 0.15 * f64::from(k)).collect()
    };
    let (x, y) = (axis(-4.2, 75), axis(-5.25, 71));
    let panels = RATIOS.into_iter().zip(robots).map(|(ratio, mut robot)| {
        let cells = x.iter().flat_map(|x| y.iter().map(move |y| (*x, *y)));
        let values = cells.map(|(x, y)| match robot.region(x, y, &gains) {
            Region::Stable => 0.0,
            Region::Unstable => 1.0,
            Region::Outside => f64::NAN,
        });
        MapPanel {
            title: format!("mass ratio {ratio}"),
            values: values.collect(),
            crosses: Vec::new(),
            grid: None,
        }
    });
    let figure = MapFigure {
        title: "Masutani 1995 Fig. 6.1: stability with the fixed-base Jacobian".to_owned(),
        x_label: "x [m]".to_owned(),
        y_label: "y [m]".to_owned(),
        panels: panels.collect(),
        x: x.clone(),
        y: y.clone(),
        scale: MapScale::Classes(vec!["stable".to_owned(), "unstable".to_owned()]),
    };
    report.maps.push(("masutani-fig-6.1".to_owned(), figure));
    report
}

/// A simulated run with one of the Jacobians.
struct Run {
    /// Distance from the goal every 0.1 s \[m\].
    deviations: Vec<f64>,
    /// Position of the tip every 0.1 s.
    path: Vec<Vector3<f64>>,
    /// Base, joints and tip every 10 s, as one line that runs forth and back.
    arms: Vec<(f64, f64)>,
}

const SAMPLE: f64 = 0.1;

fn run(example: Example, jacobian: JacobianKind, seconds: u32) -> Run {
    let mut robot = example.start(jacobian);
    let frames = robot.model().frames().to_vec();
    let (mut deviations, mut path, mut arms) = (Vec::new(), Vec::new(), Vec::new());
    for k in 0..=10 * seconds {
        if k > 0 {
            robot.run_to(SAMPLE * f64::from(k), 0.02);
        }
        deviations.push(robot.error().position.norm());
        path.push(robot.X_WE().translation.vector);
        if k % 100 == 0 {
            let X_WB = robot.X_WB();
            arms.extend(frames.iter().map(|frame| {
                let p = (X_WB * robot.workspace().X_BF(frame)).translation;
                (p.x, p.y)
            }));
            arms.push((f64::NAN, f64::NAN));
        }
    }
    Run {
        deviations,
        path,
        arms,
    }
}

fn settled(deviations: &[f64]) -> f64 {
    let far = deviations.iter().rposition(|d| *d > 0.01);
    SAMPLE * far.map_or(0, |k| k + 1) as f64
}

fn both(example: Example, seconds: u32) -> [Run; 2] {
    [JacobianKind::Generalized, JacobianKind::FixedBase]
        .map(|jacobian| run(example, jacobian, seconds))
}

fn pictures(report: &mut Report, name: &str, runs: &[Run; 2]) {
    let titles = ["(a) generalized Jacobian", "(b) fixed-base Jacobian"];
    for ((run, title), letter) in runs.iter().zip(titles).zip(['a', 'b']) {
        let series = |name: &str, points| Series {
            name: name.to_owned(),
            points,
        };
        let path = run.path.iter().map(|p| (p.x, p.y)).collect();
        let plane = PlaneFigure {
            title: format!("Masutani 1995 {name}, every 10 s: {title}"),
            x_label: "x [m]".to_owned(),
            y_label: "y [m]".to_owned(),
            series: vec![
                series("base and arm", run.arms.clone()),
                series("path of the tip", path),
            ],
            ..PlaneFigure::default()
        };
        report
            .planes
            .push((format!("{}-{letter}", report.name), plane));
    }
    let deviation = |run: &Run, title: &str| Series {
        name: title.to_owned(),
        points: (0u32..)
            .zip(&run.deviations)
            .map(|(k, d)| (SAMPLE * f64::from(k), *d))
            .collect(),
    };
    let curves = runs.iter().zip(["generalized", "fixed-base"]);
    let figure = Figure {
        title: format!("Masutani 1995 {name}: deviation of the tip"),
        x_label: "time [s]".to_owned(),
        panels: vec![Panel {
            y_label: "|e_p| [m]".to_owned(),
            series: curves.map(|(run, title)| deviation(run, title)).collect(),
            ..Panel::default()
        }],
        ..Figure::default()
    };
    report
        .figures
        .push((format!("{}-deviation", report.name), figure));
}

/// A start in the stable region.
pub(super) fn fig_6_2(mut report: Report) -> Report {
    let runs = both(STABLE, 60);
    for (run, name) in runs.iter().zip(["generalized", "fixed-base"]) {
        let left = run.deviations[run.deviations.len() - 1];
        report.near(
            &format!("{name} Jacobian, |e_p| at 60 s [m]"),
            0.0,
            left,
            1e-4,
        );
    }
    let times = runs.each_ref().map(|run| settled(&run.deviations));
    let apart = (times[0] / times[1]).max(times[1] / times[0]);
    report.holds(
        "no special difference: times to 1 cm, the longer over the shorter, below 1.5",
        apart,
        apart < 1.5,
    );
    report.note(&format!(
        "The generalized Jacobian takes {:.1} s to 1 cm, the fixed-base one {:.1} s. {RECOVERED}",
        times[0], times[1]
    ));
    pictures(&mut report, "Fig. 6.2", &runs);
    report
}

/// A start in the unstable region.
pub(super) fn fig_6_3(mut report: Report) -> Report {
    let runs = both(UNSTABLE, 120);
    let [generalized, approximate] = &runs;
    let first = approximate.deviations[0];
    let most = |run: &Run| run.deviations.iter().copied().fold(0.0, f64::max);
    report.holds(
        "(a) generalized Jacobian: largest deviation over the first one, not above 1",
        most(generalized) / first,
        most(generalized) <= first,
    );
    report.holds(
        "(b) fixed-base Jacobian leads away first: largest deviation over the first one, above 1.2",
        most(approximate) / first,
        most(approximate) > 1.2 * first,
    );
    report.near(
        "(b) and arrives then: |e_p| at 120 s [m]",
        0.0,
        approximate.deviations[1200],
        1e-3,
    );
    let at = |x: f64| approximate.deviations.iter().position(|d| *d == x);
    let top = most(approximate);
    report.note(&format!(
        "The text: the tip moves away from its goal once, turns the base thereby, leaves the unstable region, and \
         converges. Here from {first:.3} m to {top:.3} m at {:.1} s, and within 1 cm after {:.1} s. {RECOVERED}",
        SAMPLE * at(top).unwrap_or(0) as f64,
        settled(&approximate.deviations),
    ));
    pictures(&mut report, "Fig. 6.3", &runs);
    report
}
