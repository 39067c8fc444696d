//! The matrix method against the tables of TR-942 (1987), against closed forms, and against the reduced form.

mod bad_input;
mod chain;
mod forces;
mod hinges;
mod loops;
mod pantograph;
mod trees;

/// The largest magnitude; not a number if one of them is not.
fn largest(values: impl IntoIterator<Item = f64>) -> f64 {
    let sizes = values.into_iter().map(f64::abs);
    sizes.max_by(f64::total_cmp).unwrap_or(0.0)
}
