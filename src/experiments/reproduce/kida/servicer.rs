//! Kida's theorems and designs on a servicer with an arm, for which nothing is published: rows compare with an
//! independent program (Python, SciPy, SLICOT) on the same robot.

use fuyu_lti::kida1993::double_loop::{Problem, covering_gain, step, verdict};
use fuyu_lti::{
    LtiError, Matrix, StateSpace, Structure, TransferFunction, spectral_abscissa, spectral_radius,
    step_figures,
};
use std::f64::consts::TAU;

use super::diagrams::{marks, nyquist, over_time, pole_map, sampled, series, time_figure, upper};
use super::{Outcome, completed};
use crate::experiments::kida1993::servicer::{GAINS, POSTURES, Posture, Servicer, direct_feedback};
use crate::experiments::reproduce::Report;
use crate::experiments::{Figure, Mark, Panel};

const ROBOT: &str = "The servicer of Masutani 1995 (urdf/servicer.urdf) with two panels of 8 x 2 m and 48 kg (three \
    bending modes from .1955 Hz, torsion .625 Hz, damping .005), joints locked. Postures A: all zero; B: .3, .8, -1.4, \
    .6, .4, 0; C: 1.2, 1.9, -2.2, -.7, .5, .3 rad.";

/// Frequencies with free base \[Hz\] by an independent program, for array angles 0 and .6 rad and postures A, B, C.
const FREQUENCIES: [(f64, [[f64; 8]; 3]); 2] = [
    (
        0.0,
        [
            [
                0.198236518,
                0.325929574,
                0.625,
                0.626882021,
                1.230577292,
                1.288804937,
                3.435909201,
                3.467942654,
            ],
            [
                0.198223865,
                0.320068105,
                0.625,
                0.627298724,
                1.230552331,
                1.284834787,
                3.435884860,
                3.465570110,
            ],
            [
                0.198181243,
                0.311100829,
                0.625,
                0.629063844,
                1.230465688,
                1.279058665,
                3.435798633,
                3.462141526,
            ],
        ],
    ),
    (
        0.6,
        [
            [
                0.198204956,
                0.291677689,
                0.625,
                0.626881421,
                1.230514282,
                1.267327511,
                3.435848000,
                3.455196719,
            ],
            [
                0.198213719,
                0.303890563,
                0.625,
                0.627297782,
                1.230532034,
                1.274521348,
                3.435865150,
                3.459442338,
            ],
            [
                0.198178268,
                0.301312534,
                0.625,
                0.629055128,
                1.230459656,
                1.273009321,
                3.435792706,
                3.458557033,
            ],
        ],
    ),
];

/// Transmission zeros from three torques to three angles \[Hz\], the same in every posture, by an independent program.
const ZEROS: [f64; 8] = [
    0.195513, 0.198138, 0.625, 0.625, 1.225260, 1.230379, 3.430763, 3.435717,
];

/// Largest difference of two lists of the same length; infinite if lengths differ.
fn distance(a: &[f64], b: &[f64]) -> f64 {
    match a.len() == b.len() {
        true => a
            .iter()
            .zip(b)
            .map(|(x, y)| (x - y).abs())
            .fold(0.0, f64::max),
        false => f64::INFINITY,
    }
}

/// Frequencies \[Hz\] of the oscillating zeros of a structure, ascending. Zeros at the origin are rigid motion.
fn zeros_hz(structure: &Structure) -> Result<Vec<f64>, LtiError> {
    let zeros = structure.displacement_system()?.zeros()?;
    let mut found: Vec<f64> = zeros
        .iter()
        .filter(|z| z.im > 0.1)
        .map(|z| z.norm() / TAU)
        .collect();
    found.sort_by(f64::total_cmp);
    Ok(found)
}

pub(super) fn zeros(report: Report) -> Report {
    completed(report, |report| {
        let mut all_zeros = Vec::new();
        for (angle, expected) in FREQUENCIES {
            let servicer = Servicer::new(angle)?;
            for ((name, q), expected) in POSTURES.iter().zip(expected) {
                let posture = servicer.posture(q)?;
                let off = distance(&posture.frequencies_hz, &expected);
                report.holds(
                    &format!("array angle {angle} rad, posture {name}: poles off an independent program's [Hz], below 1e-8"),
                    off,
                    off < 1e-8,
                );
                let six = zeros_hz(&posture.free)?;
                let clamped = [six[0], six[2], six[4], six[6]];
                let modes = [0.195_513_122_67, 0.625, 1.225_259_824_92, 3.430_762_988_50];
                let off = distance(&clamped, &modes);
                report.holds(
                    &format!("array angle {angle} rad, posture {name}: zeros, 6 inputs, off the clamped panel's modes [Hz], below 1e-9"),
                    off,
                    off < 1e-9,
                );
                all_zeros.push(zeros_hz(&posture.attitude)?);
            }
        }
        let moved = all_zeros
            .iter()
            .map(|z| distance(z, &all_zeros[0]))
            .fold(0.0, f64::max);
        report.holds(
            "zeros, 3 torques: differ between postures and array angles by [Hz], below 1e-10",
            moved,
            moved < 1e-10,
        );
        let off = distance(&all_zeros[0], &ZEROS);
        report.holds(
            "zeros, 3 torques: off an independent program's six digits [Hz], below 1e-6",
            off,
            off < 1e-6,
        );
        report.note(ROBOT);
        report.note(
            "With the attitude held only translation is left, and mass and translational coupling do not depend on \
             posture or array angle: so the three-by-three zeros stay while the poles move.",
        );
        report
            .figures
            .push(("kida-servicer-zeros".to_owned(), along_the_arm()?));
        Ok(())
    })
}

/// Poles and zeros as functions of the elbow angle.
fn along_the_arm() -> Result<Figure, Box<dyn std::error::Error>> {
    let servicer = Servicer::new(0.0)?;
    let (mut poles, mut zeros) = (vec![Vec::new(); 8], vec![Vec::new(); 8]);
    for i in -45..=45 {
        let angle = f64::from(4 * i);
        let mut q = POSTURES[1].1;
        q[2] = angle.to_radians();
        let posture = servicer.posture(&q)?;
        for (k, f) in posture.frequencies_hz.iter().enumerate() {
            poles[k].push((angle, *f));
        }
        for (k, f) in zeros_hz(&posture.attitude)?.into_iter().enumerate() {
            zeros[k].push((angle, f));
        }
    }
    let panel = |first: usize, limits| {
        let curve = |what: &str, k: usize, curves: &[Vec<(f64, f64)>]| {
            series(&format!("{what} {}", k + 1), curves[k].clone())
        };
        let pair = [first, first + 1];
        Panel {
            y_label: "frequency [Hz]".to_owned(),
            series: (pair.iter().map(|k| curve("pole", *k, &poles)))
                .chain(pair.iter().map(|k| curve("zero", *k, &zeros)))
                .collect(),
            limits: Some(limits),
            ..Panel::default()
        }
    };
    Ok(Figure {
        title:
            "Servicer: poles and attitude zeros while the elbow turns, other joints as in posture B"
                .to_owned(),
        x_label: "angle of joint 3 [deg]".to_owned(),
        panels: vec![
            panel(0, (0.18, 0.36)),
            panel(2, (0.62, 0.64)),
            panel(4, (1.21, 1.31)),
        ],
        ..Figure::default()
    })
}

fn gains() -> (Matrix, Matrix) {
    let (p, d) = GAINS;
    (Matrix::identity(3, 3) * p, Matrix::identity(3, 3) * d)
}

pub(super) fn feedback(report: Report) -> Report {
    completed(report, |report| {
        let servicer = Servicer::new(0.0)?;
        let (p, d) = gains();
        let mut postures = Vec::new();
        for ((name, q), expected) in POSTURES.iter().zip([-0.006_417, -0.006_422, -0.006_400]) {
            let posture = servicer.posture(q)?.under_wheels;
            posture.certify(&p, &d)?;
            let poles = posture.direct_feedback(&p, &d)?.poles()?;
            let largest = super::diagrams::abscissa(&poles);
            report.holds(
                &format!("posture {name}: largest real part [rad/s], {expected} by an independent program"),
                largest,
                (largest - expected).abs() < 1e-6,
            );
            postures.push((*name, posture));
        }
        random_postures(report, &servicer)?;
        sampled_loops(report, &postures)?;
        let (p, d) = GAINS;
        report.note(&format!(
            "{ROBOT} Torques -{p} angle - {d} rate about each axis, by three wheels of .2 kg m² that turn freely under their motors."
        ));
        let mut map = pole_map(
            "Servicer with direct feedback: poles in three postures",
            Vec::new(),
            Some([(-0.35, 0.03), (-0.5, 9.0)]),
        );
        let mut all = Vec::new();
        for ((name, posture), mark) in postures.iter().zip([Mark::Cross, Mark::Plus, Mark::Ring]) {
            let poles = posture.direct_feedback(&gains().0, &gains().1)?.poles()?;
            all.push(marks(&format!("posture {name}"), mark, upper(&poles)));
        }
        map.marks = all;
        report
            .planes
            .push(("kida-servicer-feedback-poles".to_owned(), map));
        Ok(())
    })
}

/// Theorem 4.1 in random postures, and with a gain that violates its premise.
fn random_postures(report: &mut Report, servicer: &Servicer) -> Outcome {
    const COUNT: usize = 400;
    let (p, d) = gains();
    let (mut worst, mut unstable) = (f64::NEG_INFINITY, 0);
    let skew = Matrix::from_row_slice(3, 3, &[0.0, -1.0, 1.0, 1.0, 0.0, -1.0, -1.0, 1.0, 0.0]);
    let skewed = &p + skew * (600.0 / 3f64.sqrt());
    for q in Servicer::random_postures(COUNT) {
        let posture = servicer.posture(&q)?.under_wheels;
        worst = worst.max(spectral_abscissa(&posture.direct_feedback(&p, &d)?.a)?);
        unstable += usize::from(spectral_abscissa(&posture.direct_feedback(&skewed, &d)?.a)? > 0.0);
    }
    report.holds(
        &format!("Theorem 4.1: {COUNT} random postures, largest real part [rad/s]: stable"),
        worst,
        worst < 0.0,
    );
    report.holds(
        &format!("a skew part of 600 N m/rad in P, against its premise: unstable, of {COUNT}: all"),
        unstable as f64,
        unstable == COUNT,
    );
    Ok(())
}

/// Spectral radius of the loop sampled every `step` s, with a `delay` \[s\].
fn radius(posture: &Structure, step: f64, delay: f64) -> Result<f64, LtiError> {
    let plant = posture.displacement_and_rate_system()?;
    let sampled = plant.zero_order_hold_delayed(step, delay)?;
    spectral_radius(&sampled.feedback(&direct_feedback(GAINS))?.a)
}

/// Effects of sampling and delay, which Theorem 4.1 does not cover.
fn sampled_loops(report: &mut Report, postures: &[(&str, Structure)]) -> Outcome {
    for ((name, posture), expected) in postures.iter().zip([1.0065, 1.0021, 0.9968]) {
        let found = radius(posture, 0.5, 0.5)?;
        let word = if expected < 1.0 { "stable" } else { "unstable" };
        report.holds(
            &format!("posture {name}, .5 s and one sample of delay: spectral radius, {expected} by an independent program: {word}"),
            found,
            (found - expected).abs() < 1e-4 && (found < 1.0) == (expected < 1.0),
        );
    }
    for (step, delay, text) in [
        (
            1.0,
            0.0,
            "1 s without delay: largest spectral radius, stable",
        ),
        (
            0.25,
            0.25,
            ".25 s and one sample of delay: largest spectral radius, stable",
        ),
    ] {
        let mut largest = 0.0_f64;
        for (_, posture) in postures {
            largest = largest.max(radius(posture, step, delay)?);
        }
        report.holds(text, largest, largest < 1.0);
    }
    let steps = || (1..=48).map(|i| 0.0125 * f64::from(i));
    let mut panels = Vec::new();
    for (delayed, label) in [(true, "one sample of delay"), (false, "no delay")] {
        let mut curves = Vec::new();
        for (name, posture) in postures {
            let mut points = Vec::new();
            for step in steps() {
                points.push((
                    step,
                    radius(posture, step, if delayed { step } else { 0.0 })?,
                ));
            }
            curves.push(series(&format!("posture {name}"), points));
        }
        panels.push(Panel {
            y_label: label.to_owned(),
            series: curves,
            marks: vec![(1.0, "stability limit".to_owned())],
            limits: Some((0.99, 1.02)),
            ..Panel::default()
        });
    }
    let figure = Figure {
        title: "Servicer with sampled direct feedback: spectral radius".to_owned(),
        x_label: "sampling time [s]".to_owned(),
        panels,
        ..Figure::default()
    };
    report
        .figures
        .push(("kida-servicer-feedback".to_owned(), figure));
    Ok(())
}

fn weight(k: f64) -> Result<TransferFunction, LtiError> {
    TransferFunction::new(&[k, 0.0, 0.0], &[1.0, 2.8 * 0.2, 4.0 * 0.2 * 0.2])
}

pub(super) fn double_loop(report: Report) -> Report {
    completed(report, |report| {
        let servicer = Servicer::new(0.0)?;
        let postures: Vec<Posture> = POSTURES
            .iter()
            .map(|(_, q)| servicer.posture(q))
            .collect::<Result<_, _>>()?;
        let structures: Vec<Structure> = postures.into_iter().map(|p| p.under_wheels).collect();
        // The rigid inertia about y in posture B with the other attitudes free.
        let rigid = structures[1].mass().view((0, 0), (3, 3)).into_owned();
        let inverse = rigid.try_inverse().ok_or("the inertia is regular")?;
        let inertia = 1.0 / inverse[(1, 1)];
        report.holds(
            "inertia about y [kg m2], 4604.677988 by an independent program",
            inertia,
            (inertia - 4_604.677_987_652).abs() < 1e-5,
        );
        let problem = |rate_gain: f64, k: f64| {
            Ok::<_, LtiError>(Problem {
                inertia,
                rate_gain,
                robustness: weight(k)?,
                frequency: 0.2,
                noise: 0.01,
            })
        };
        // Without rate feedback the error is largest at the lower end, so that this end is part of the definition.
        let plant = structures[0].with_actuators(&[1])?.displacement_system()?;
        let mut grid = plant.frequency_grid(1.0001e-3, 100.0, 300)?;
        grid.insert(0, 1e-3);
        let cover = |rate_gain: f64| {
            let k = covering_gain(
                &structures,
                1,
                &problem(rate_gain, 1.0)?,
                &weight(1.0)?,
                &grid,
            )?;
            Ok::<_, LtiError>(1.1 * k)
        };
        let (with, without) = (cover(900.0)?, cover(0.0)?);
        report.holds(
            "k that covers the error in all postures with a tenth more, D = 900: 32.71001 by an independent program",
            with,
            (with - 32.710_01).abs() < 1e-4,
        );
        report.holds(
            "the same without rate feedback: 6169",
            without,
            (without - 6169.0).abs() < 1.0,
        );
        let design = problem(900.0, with)?.solve(0.9)?;
        report.holds(
            "largest gamma, .26292 by an independent program",
            design.gamma_max,
            (design.gamma_max - 0.26292).abs() < 1e-5,
        );
        for (method, norm) in [
            ("Hamiltonian", design.hinf.norm.norm),
            ("sweep", design.hinf.norm.swept),
        ] {
            report.holds(
                &format!("norm of the cost on the closed loop, by {method}: below 1"),
                norm,
                norm < 1.0,
            );
        }
        let alone = problem(0.0, with)?.solve(0.9)?;
        report.holds(
            "largest gamma without rate feedback and the same weight, .0351 by an independent program",
            alone.gamma_max,
            (alone.gamma_max - 0.0351).abs() < 1e-4,
        );
        let none = problem(0.0, without)?.solve(0.9).is_err();
        report.holds(
            "without rate feedback and with the weight that covers: controllers",
            0.0,
            none,
        );
        let axis: Vec<Structure> = (structures.iter())
            .map(|s| s.with_actuators(&[1])?.without_free_coordinates(&[0, 2]))
            .collect::<Result<_, _>>()?;
        for ((name, _), structure) in POSTURES.iter().zip(&axis) {
            let v = verdict(structure, 0, &design.controller)?;
            report.holds(
                &format!("posture {name}: largest real part [rad/s]: stable"),
                v.largest_real_part,
                v.largest_real_part < 0.0,
            );
        }
        let phase = verdict(&axis[1], 0, &design.controller)?.margins.phase;
        let first = phase.first().map_or(f64::NAN, |p| p.degrees);
        report.holds(
            "posture B: phase margin [deg], 81 by an independent program",
            first,
            (first - 81.0).abs() < 0.5,
        );
        steps(report, &axis[1], [&design.controller, &alone.controller])?;
        report.note(ROBOT);
        report.note(
            "Rotation about y; W2 = k s^2 / (s^2 + 2.8 w0 s + 4 w0^2) with w0 = .2 rad/s; gamma nine tenths of the \
             largest. With 6169 instead of 32.7 there is no controller.",
        );
        let open =
            |controller: &StateSpace| axis[1].displacement_and_rate_system()?.series(controller);
        let figure = nyquist(
            "Servicer, posture B: Nyquist diagrams",
            &[
                ("double loop", &open(&design.controller)?),
                ("no rate feedback", &open(&alone.controller)?),
            ],
            (0.01, 100.0),
            3.0,
        )?;
        report
            .planes
            .push(("kida-servicer-double-loop-nyquist".to_owned(), figure));
        Ok(())
    })
}

/// Step responses with and without the inner loop.
fn steps(report: &mut Report, structure: &Structure, controllers: [&StateSpace; 2]) -> Outcome {
    const STEP: f64 = 0.5;
    let (mut angles, mut torques) = (Vec::new(), Vec::new());
    for ((controller, name), settling) in controllers
        .into_iter()
        .zip(["double loop", "no rate feedback"])
        .zip([56.5, 115.0])
    {
        let run = step(structure, 0, controller, STEP, 601)?;
        let angle: Vec<f64> = run.iter().map(|v| v.0.to_degrees()).collect();
        let figures = step_figures(&angle, STEP, 1.0, 0.05);
        report.holds(
            &format!(
                "posture B, {name}: settles to 5 % in [s], {settling} by an independent program"
            ),
            figures.settling,
            (figures.settling - settling).abs() < 1.0,
        );
        angles.push(sampled(name, STEP, angle));
        torques.push(sampled(name, STEP, run.iter().map(|v| v.1)));
    }
    let figure = time_figure(
        "Servicer, posture B: step of 1 deg about y",
        vec![
            over_time("angle [deg]", angles),
            over_time("torque [N m]", torques),
        ],
    );
    report
        .figures
        .push(("kida-servicer-double-loop".to_owned(), figure));
    Ok(())
}
