//! Fixtures and comparisons.

use fuyu_structures::{Appendage, Beam, Boom, PlateStrip};
use nalgebra::{Complex, DMatrix};
use serde_json::Value;

/// A fixture by its file name.
pub fn fixture(name: &str) -> Value {
    let path = format!("{}/tests/fixtures/{name}.json", env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{path}: {e}"));
    serde_json::from_str(&text).unwrap()
}

/// A list of numbers.
pub fn numbers(value: &Value) -> Vec<f64> {
    let list = value
        .as_array()
        .unwrap_or_else(|| panic!("not a list: {value}"));
    list.iter().map(|v| v.as_f64().unwrap()).collect()
}

/// A matrix as a list of rows.
pub fn matrix(value: &Value) -> DMatrix<f64> {
    let rows: Vec<Vec<f64>> = value.as_array().unwrap().iter().map(numbers).collect();
    DMatrix::from_fn(rows.len(), rows[0].len(), |i, j| rows[i][j])
}

/// Roots with positive imaginary part as a list of pairs.
pub fn roots(value: &Value) -> Vec<Complex<f64>> {
    let m = matrix(value);
    (0..m.nrows())
        .map(|i| Complex::new(m[(i, 0)], m[(i, 1)]))
        .collect()
}

/// Largest relative difference of two lists of the same length.
pub fn worst(found: &[f64], expected: &[f64]) -> f64 {
    assert_eq!(found.len(), expected.len(), "{found:?} {expected:?}");
    let differences = found
        .iter()
        .zip(expected)
        .map(|(a, b)| (a - b).abs() / b.abs());
    differences.fold(0.0, f64::max)
}

/// Largest relative distance from each expected root to the nearest found one that is not taken.
pub fn worst_root(found: &[Complex<f64>], expected: &[Complex<f64>]) -> f64 {
    assert_eq!(found.len(), expected.len(), "{found:?}\n{expected:?}");
    let mut left = found.to_vec();
    let mut largest = 0.0_f64;
    for root in expected {
        let distance = |s: &Complex<f64>| (s - root).norm() / root.norm();
        let (place, error) = left
            .iter()
            .map(distance)
            .enumerate()
            .min_by(|a, b| a.1.total_cmp(&b.1))
            .unwrap();
        left.swap_remove(place);
        largest = largest.max(error);
    }
    largest
}

/// Those with positive imaginary part.
pub fn upper(roots: &[Complex<f64>]) -> Vec<Complex<f64>> {
    roots.iter().copied().filter(|s| s.im > 0.0).collect()
}

/// The panel of the fixtures.
pub fn strip(second_order: bool) -> PlateStrip {
    PlateStrip {
        length: 8.0,
        width: 2.0,
        areal_mass: 3.0,
        EI: 3000.0,
        GJ: 800.0,
        bending_modes: 3,
        torsion_modes: 1,
        damping: 0.005,
        second_order,
    }
}

pub fn panel(second_order: bool) -> Appendage {
    strip(second_order).appendage("panel").unwrap()
}

/// A boom that bends in both planes as `beam` does, without damping.
pub fn boom(beam: &Beam, modes: [usize; 2], second_order: bool) -> Appendage {
    let boom = Boom {
        along_y: beam.clone(),
        along_z: beam.clone(),
        modes,
        damping: 0.0,
        second_order,
    };
    boom.appendage("boom").unwrap()
}
