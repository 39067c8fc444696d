//! Declarations of lists of names, each of which has parameters of its own.

use crate::ros::Declare;

/// Declares the list `plural` of names, and with `declare_one` the parameters of each.
///
/// # Errors
/// A line that names the list and the name that is given twice.
pub(in crate::nodes) fn declare_each<T>(
    declare: &mut Declare,
    plural: &str,
    description: &str,
    declare_one: impl Fn(&mut Declare, String) -> T,
) -> Result<Vec<T>, String> {
    let names = declare
        .param(plural, Vec::<String>::new(), description)
        .read_only()
        .value();
    let mut once: Vec<String> = Vec::new();
    let mut twice = None;
    for name in names {
        match once.contains(&name) {
            true => twice = twice.or(Some(name)),
            false => once.push(name),
        }
    }
    // All are declared before the error, so that no parameter is reported as unknown.
    let all = once.into_iter().map(|name| declare_one(declare, name));
    let all = all.collect();
    match twice {
        Some(name) => Err(format!(
            "parameter {plural}: '{name}' is given twice; {plural} need different names"
        )),
        None => Ok(all),
    }
}
