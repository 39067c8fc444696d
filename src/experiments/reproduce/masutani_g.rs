//! Masutani 1995, appendix G: operation counts of the generalized Jacobian.

use nalgebra::{DVector, Matrix6xX};

use super::Report;
use crate::dynamics::Workspace;
use crate::experiments::masutani_g::SerialArm;
use crate::experiments::operation_counts::recursion;

/// Operations of the printed procedure and of fuyu's recursion.
pub(super) fn table_g_1(mut report: Report) -> Report {
    let mut largest: f64 = 0.0;
    for n in [2, 6, 12] {
        let arm = SerialArm::example(n);
        let q: Vec<f64> = (0..n).map(|j| (1.0 + j as f64).sin() * 2.0).collect();
        let (columns, counts) = arm.generalized_jacobian(&q);
        let formula = |a: usize, b: usize, c: usize| (a * n * n + b * n + c) as f64;
        for (what, published, computed) in [
            (
                "multiplications, 12 n² + 148 n + 19",
                formula(12, 148, 19),
                counts.multiplications,
            ),
            (
                "additions, 12 n² + 126 n + 16",
                formula(12, 126, 16),
                counts.additions,
            ),
            ("divisions", 3.0, counts.divisions),
        ] {
            report.near(
                &format!("n = {n}, printed procedure: {what}"),
                published,
                computed as f64,
                0.0,
            );
        }
        largest = largest.max(apart(&arm, &q, &columns));
    }
    report.near(
        "largest difference between its Jacobian and fuyu's",
        0.0,
        largest,
        1e-12,
    );
    let own = |n: usize| recursion(&SerialArm::example(n).model());
    let six = own(6);
    let part = (six.multiplications + six.divisions) as f64 / 1339.0;
    report.holds(
        "n = 6, multiplications and divisions of fuyu's recursion over the 1339 printed: below 0.6",
        part,
        part < 0.6,
    );
    let part = six.additions as f64 / 1204.0;
    report.holds(
        "n = 6, its additions over the 1204 printed: below 0.6",
        part,
        part < 0.6,
    );
    let step = |n: usize| own(n + 1).multiplications - own(n).multiplications;
    report.holds(
        "it is linear in n: multiplications of the 21st joint less those of the 3rd, none",
        step(20) as f64 - step(2) as f64,
        step(20) == step(2),
    );
    report.note(&format!(
        "For six joints fuyu takes {} multiplications, {} additions and {} divisions, for thirty {} and {}. The \
         fixed-base Jacobian's 169 and 88 of the table are quoted there without a procedure.",
        six.multiplications,
        six.additions,
        six.divisions,
        own(30).multiplications,
        own(30).additions,
    ));
    report
}

fn apart(arm: &SerialArm, q: &[f64], columns: &[[f64; 6]]) -> f64 {
    let model = arm.model();
    let mut workspace = Workspace::new(&model);
    workspace.set_positions(&DVector::from_row_slice(q));
    let mut ours = Matrix6xX::zeros(q.len());
    let tip = model.frame("tip").expect("the arm has a tip");
    workspace.generalized_jacobian(tip, &mut ours);
    let pairs = columns.iter().flatten().zip(ours.iter());
    pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}
