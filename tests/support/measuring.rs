//! Limits on measured values that vary from one measurement to the next. No measurement is repeated because it missed a
//! limit: a test that depends on being scheduled in time is repeated as a whole (`lateness.rs`).

/// Measures `trials` times. All values must be below the limit: for limits that every single run must meet.
pub fn worst_below(what: &str, limit: f64, trials: usize, mut measure: impl FnMut() -> f64) {
    let measured: Vec<_> = (0..trials).map(|_| measure()).collect();
    println!("{what}: {measured:.3?}, limit {limit}");
    assert!(
        measured.iter().all(|figure| *figure < limit),
        "{what}: one of {measured:.3?} is not below {limit}"
    );
}
