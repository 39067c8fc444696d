//! Declaration of lists of names, where each name has its own parameters.

use crate::ros::Declare;

/// Declares the list of names `plural`, and calls `declare_one` for the parameters of each name.
///
/// # Errors
/// A line that names the list and the repeated name.
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
    // All are declared before the error is returned, so that no parameter is reported as unknown.
    let all = once.into_iter().map(|name| declare_one(declare, name));
    let all = all.collect();
    match twice {
        Some(name) => Err(format!(
            "parameter {plural}: '{name}' is given twice; {plural} need different names"
        )),
        None => Ok(all),
    }
}
