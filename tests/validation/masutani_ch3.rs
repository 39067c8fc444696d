//! Chapter 3 of Masutani 1995: 294 motions under each condition, against the tables that it prints, and against
//! the errors that an independent implementation of the same method makes.

use fuyu::estimation::MotionModel;
use fuyu::experiments::masutani_ch3::{
    Cell, CellErrors, Condition, ModelTable, TABLE_3_2, TABLE_3_3, TABLE_3_5, cell, grid,
    in_parallel, points,
};
use fuyu::vision::BodyPoint;
use nalgebra::Vector3;

use crate::fixtures::rows;

fn sweep(condition: Condition) -> Vec<Cell> {
    let motions: Vec<_> = grid(0.8).iter().map(|m| m.rotation().unwrap()).collect();
    in_parallel(&motions, 2, |motion| cell(motion, condition))
}

/// Share of the cells whose model is as printed.
fn agreement(cells: &[Cell], table: &ModelTable) -> f64 {
    let models: Vec<_> = cells.iter().map(|c| c.model).collect();
    table.agreement(&models) as f64 / cells.len() as f64
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Medians of `r` and of `Phi` \[deg\] over the cells that the asymmetric model answered.
fn medians(cells: &[Cell]) -> [f64; 2] {
    let asymmetric = |c: &&Cell| c.model == Some(MotionModel::Asymmetric);
    let answered: Vec<&CellErrors> = cells
        .iter()
        .filter(asymmetric)
        .filter_map(|c| c.result.as_ref().ok())
        .collect();
    [
        median(answered.iter().map(|e| e.parameters).collect()),
        median(
            answered
                .iter()
                .map(|e| e.prediction.axis.to_degrees())
                .collect(),
        ),
    ]
}

/// Within 10 % of the reference's medians.
fn check([r, phi]: [f64; 2], [expected_r, expected_phi]: [f64; 2]) {
    println!("r {r:.2e} ({expected_r:e}), Phi {phi:.3} ({expected_phi}) deg");
    assert!(
        (r / expected_r - 1.0).abs() < 0.1,
        "r {r}, expected {expected_r}"
    );
    assert!(
        (phi / expected_phi - 1.0).abs() < 0.1,
        "Phi {phi}, expected {expected_phi}"
    );
}

/// The cells that differ have constant rates (s_alpha = 0, which starts on the middle axis, or e = 1), where rounding
/// decides between two models that are both right. The reference's r is known to one digit (5e-5), which the
/// fixtures' two cells (7.0e-5 and 2.5e-5) agree with.
#[test]
fn true_angular_velocities_choose_the_models_of_table_3_2() {
    let cells = sweep(Condition::TrueRates);
    let agreed = agreement(&cells, &TABLE_3_2);
    println!("{agreed}");
    assert!(agreed >= 0.97, "{agreed}");
    let [r, phi] = medians(&cells);
    check([r, phi], [5.5e-5, 0.45]);
    assert!(cells.iter().all(|c| c.result.is_ok()));
}

#[test]
fn true_rotations_choose_the_models_of_table_3_3() {
    let cells = sweep(Condition::TrueRotations);
    let agreed = agreement(&cells, &TABLE_3_3);
    println!("{agreed}");
    assert!(agreed >= 0.98, "{agreed}");
    check(medians(&cells), [0.0052, 2.5]);
}

/// Which points the thesis took is not known; over five sets of points the median agrees. (Tables 3.4 and 3.5 are the
/// same condition, and differ from each other in 7 % of their cells.)
#[test]
fn images_choose_the_models_of_table_3_5() {
    let runs = [1, 2, 3, 4, 5].map(|seed| {
        let points = points(20, seed);
        let cells = sweep(Condition::Images {
            resolution: 1024,
            points: &points,
        });
        let [r, phi] = medians(&cells);
        [agreement(&cells, &TABLE_3_5), r, phi]
    });
    let over_runs = |i: usize| median(runs.iter().map(|run| run[i]).collect());
    let agreed = over_runs(0);
    println!("{runs:?}");
    assert!(agreed >= 0.87, "{agreed}");
    check([over_runs(1), over_runs(2)], [0.0072, 3.7]);
}

/// The reference's own points, whose medians at 256 px are .0105 and 4.8 degrees.
#[test]
fn coarse_images_err_as_much_as_the_reference_does() {
    let text = include_str!("fixtures/e080_s+04_r256.json");
    let data: serde_json::Value = serde_json::from_str(text).unwrap();
    let vertices = rows(&data["points_body_mm"]);
    let vertices: Vec<_> = vertices
        .iter()
        .map(|p| Vector3::from_row_slice(p) * 1e-3)
        .collect();
    let cells = sweep(Condition::Images {
        resolution: 256,
        points: &BodyPoint::of_vertices(&vertices),
    });
    check(medians(&cells), [0.0105, 4.8]);
}

/// Sets of points of our own. Over them r is .0086 to .0158, median .0123: the reference's .0105 is what some choice of
/// points gives. Phi is 4.85 to 6.97 degrees, median 5.08.
#[test]
fn coarse_images_err_by_the_choice_of_points() {
    let runs = [1, 2, 3, 4, 5].map(|seed| {
        let points = points(20, seed);
        medians(&sweep(Condition::Images {
            resolution: 256,
            points: &points,
        }))
    });
    println!("{runs:?}");
    let least = runs.iter().map(|run| run[0]).fold(f64::INFINITY, f64::min);
    let largest = runs.iter().map(|run| run[0]).fold(0.0, f64::max);
    assert!(least < 0.0105 && 0.0105 < largest, "{least} to {largest}");
    let phi = median(runs.iter().map(|run| run[1]).collect());
    assert!((phi / 4.8 - 1.0).abs() < 0.1, "{phi}");
}
