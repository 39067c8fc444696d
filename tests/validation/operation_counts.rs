//! How many multiplications and additions the kernels take, counted as they run.

use fuyu::dynamics::Workspace;
use fuyu::experiments::masutani_g::SerialArm;
use fuyu::experiments::operation_counts::recursion;
use nalgebra::{DVector, Matrix6xX};

/// Multiplications (a division is one) and additions of the generalized Jacobian of the last body, with the momentum
/// map, for an arm whose axes lie at any angle and distance, as App. G assumes, with dense inertias.
fn counts(links: usize) -> [usize; 2] {
    let counts = recursion(&SerialArm::example(links).model());
    [counts.multiplications + counts.divisions, counts.additions]
}

/// Masutani 1995 App. G: 12 n² + 148 n + 19 multiplications, 1339 for six joints, and 1204 additions. The
/// recursion takes 40 % less, and every joint more costs the same.
#[test]
fn the_generalized_jacobian_takes_less_than_the_thesis_and_grows_linearly() {
    let [multiplications, additions] = counts(6);
    assert!(multiplications as f64 <= 0.6 * 1339.0, "{multiplications}");
    assert!(additions as f64 <= 0.6 * 1204.0, "{additions}");
    let all: Vec<[usize; 2]> = (2..=30).map(counts).collect();
    let more = |k: usize, i: usize| all[k + 1][i] - all[k][i];
    for k in 0..all.len() - 1 {
        assert_eq!([more(k, 0), more(k, 1)], [more(0, 0), more(0, 1)]);
    }
}

/// The printed procedure takes what its table says, and gives the Jacobian that fuyu gives. A step left out or done
/// twice shows in the one or the other.
#[test]
fn the_printed_procedure_takes_what_table_g_1_says() {
    for n in 1..=8 {
        let arm = SerialArm::example(n);
        let q: Vec<f64> = (0..n).map(|j| 0.7 * j as f64 - 1.0).collect();
        let (columns, counts) = arm.generalized_jacobian(&q);
        assert_eq!(counts.multiplications, 12 * n * n + 148 * n + 19);
        assert_eq!(counts.additions, 12 * n * n + 126 * n + 16);
        assert_eq!(counts.divisions, 3);
        let model = arm.model();
        let mut workspace = Workspace::new(&model);
        workspace.set_positions(&DVector::from_vec(q));
        let mut ours = Matrix6xX::zeros(n);
        workspace.generalized_jacobian(model.frame("tip").unwrap(), &mut ours);
        for (a, b) in columns.iter().flatten().zip(ours.iter()) {
            assert!((a - b).abs() < 1e-13, "{a} {b}");
        }
    }
}
