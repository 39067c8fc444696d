//! Parameter `robots`: the robots that share one world.

use crate::ros::{Declare, NodeName};

/// Declares `robots` and reads it.
pub(super) fn declare_robots(declare: &mut Declare) -> Vec<String> {
    let text = "Namespaces of all robots of this world, the same list for each; the dynamics node of the first one \
                publishes /clock, the others follow it. Empty: there is no other robot";
    (declare.param("robots", Vec::<String>::new(), text))
        .check(
            "different namespaces with a leading slash, at least two, such as [/chaser1, /chaser2]",
            |robots| check(robots),
        )
        .read_only()
        .value()
}

fn check(robots: &[String]) -> Result<(), String> {
    if let [only] = robots {
        return Err(format!("'{only}' is the only one"));
    }
    for (i, robot) in robots.iter().enumerate() {
        if robots[..i].contains(robot) {
            return Err(format!("'{robot}' is given twice"));
        }
        match NodeName::new(robot, "dynamics") {
            Ok(node) if node.namespace() == robot => {}
            Ok(_) => return Err(format!("'{robot}' has no leading slash, or one at its end")),
            Err(e) => return Err(e.to_string()),
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn namespaces_are_absolute_and_different() {
        let of = |robots: &[&str]| {
            let robots: Vec<_> = robots.iter().map(|&r| r.to_owned()).collect();
            check(&robots)
        };
        assert_eq!(of(&[]), Ok(()));
        assert_eq!(of(&["/chaser1", "/fleet/chaser2"]), Ok(()));
        for (robots, says) in [
            (&["/chaser1"][..], "only one"),
            (&["/chaser1", "/chaser1"], "twice"),
            (&["/chaser1", "chaser2"], "leading slash"),
            (&["/chaser1", "/chaser2/"], "slash"),
            (&["/chaser1", "/cha ser"], "not allowed"),
        ] {
            let refused = of(robots).unwrap_err();
            assert!(refused.contains(says), "{robots:?}: {refused}");
        }
    }
}
