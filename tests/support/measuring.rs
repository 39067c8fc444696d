//! Limits on measured figures that vary from one measurement to the next. None of these measures again because a limit
//! was missed: a test that needs the processor in time is repeated as a whole (`lateness.rs`).

/// Measures `trials` times. All must be below the limit: for what is promised of every single case.
pub fn worst_below(what: &str, limit: f64, trials: usize, mut measure: impl FnMut() -> f64) {
    let measured: Vec<_> = (0..trials).map(|_| measure()).collect();
    println!("{what}: {measured:.3?}, limit {limit}");
    assert!(
        measured.iter().all(|figure| *figure < limit),
        "{what}: one of {measured:.3?} is not below {limit}"
    );
}
