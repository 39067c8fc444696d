//! Measuring wall time such that a starved machine is told apart from a broken program.

/// Measures a figure of wall time until it is below its limit, up to five times: a starved machine is slow
/// now and then, a broken program always. Gives the figure that was.
pub fn once_below(what: &str, limit: f64, mut measure: impl FnMut() -> f64) -> f64 {
    let mut measured = Vec::new();
    for _ in 0..5 {
        let figure = measure();
        measured.push(figure);
        if figure < limit {
            println!("{what}: {measured:.3?}, limit {limit}");
            return figure;
        }
    }
    panic!("{what}: {measured:.3?}, never below {limit}");
}
