//! Lemmas 4.2 and 4.4 and Theorems 4.1 to 4.3.

use super::completed;
use crate::experiments::kida1993::feedback_theorems::{direct_feedback, proof_masses};
use crate::experiments::reproduce::Report;
use crate::experiments::{Dots, Figure, Panel};

pub(super) fn theorems(report: Report) -> Report {
    completed(report, |report| {
        let all = direct_feedback(300)?;
        let masses = proof_masses(300)?;
        let mut none = |quantity: &str, (of, found): (usize, usize)| {
            let quantity = format!("{quantity}, of {of}: none");
            report.holds(&quantity, found as f64, of > 50 && found == 0);
        };
        none(
            "Lemma 4.2: no rigid mode, rate feedback: unstable loops",
            all.rate,
        );
        none(
            "rigid modes, rate feedback alone: asymptotically stable loops",
            all.rigid_under_rate,
        );
        none(
            "Theorem 4.1: rate and displacement feedback: unstable loops",
            all.rate_and_displacement,
        );
        none(
            "Lemma 4.4: positive-real actuator in the rate loop: unstable loops",
            all.real_actuators,
        );
        none(
            "Theorem 4.2: proof mass that satisfies the condition: unstable loops",
            masses.sufficient,
        );
        none(
            "Theorem 4.3: proof mass called stable: unstable loops",
            masses.stable,
        );
        none(
            "Theorem 4.3 is necessary, too: called unstable: stable loops",
            masses.unstable,
        );
        none(
            "proof mass without feedback: unstable loops",
            masses.passive,
        );
        let mut some = |quantity: &str, (of, found): (usize, usize)| {
            let quantity = format!("{quantity}, of {of}: some");
            report.holds(&quantity, found as f64, found > 10);
        };
        some(
            "a skew part in P, against the premise of Theorem 4.1: unstable loops",
            all.skew,
        );
        some(
            "actuator of second order, not positive real: unstable loops",
            all.other_actuators,
        );
        report.note(
            "Random structures with 2 to 7 coordinates, 0 to 2 rigid modes, 1 to 3 actuators; random proof masses on \
             one mode without damping. Theorem 4.3 is printed as sufficient. Corrections: c_e = 2 m sigma_1, gamma = c \
             / (c_e a^2), mu = d a^2 / c; (4.11) begins with m a^2 theta''.",
        );
        let side = |stable: bool| {
            let points = masses
                .margins
                .iter()
                .copied()
                .filter(|m| (m.1 < 0.0) == stable);
            points.collect::<Vec<_>>()
        };
        let dots = |name: &str, points: Vec<(f64, f64)>| Dots {
            name: name.to_owned(),
            points,
            deviations: Vec::new(),
        };
        let figure = Figure {
            title: "Kida 1993 Theorem 4.3 on random proof masses".to_owned(),
            x_label: "(1 + mu) / (r (1 + mu) + 1) over nu^2 mu: above 1 the theorem calls the loop stable".to_owned(),
            log_x: true,
            panels: vec![Panel {
                y_label: "largest real part / sigma".to_owned(),
                dots: vec![dots("stable poles", side(true)), dots("unstable poles", side(false))],
                marks: vec![(0.0, "stability limit".to_owned())],
                ..Panel::default()
            }],
        };
        report.figures.push(("kida-theorem-4.3".to_owned(), figure));
        Ok(())
    })
}
