//! Names of robots and targets in a recording.

/// Whether `namespace` is that of a target: `ground_truth/NAME`, below the robot's namespace.
pub fn is_of_target(namespace: &str) -> bool {
    let parent = namespace.rsplit_once('/').map(|(parent, _)| parent);
    parent.is_some_and(|parent| parent.ends_with("/ground_truth"))
}

/// Name in reports of the robot or target with this namespace: `chaser`, `target` or `chaser/target`; empty without a
/// namespace.
pub fn title_of(namespace: &str) -> String {
    let title = match is_of_target(namespace) {
        true => namespace.replacen("/ground_truth/", "/", 1),
        false => namespace.to_owned(),
    };
    title.trim_matches('/').to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn targets_and_robots_are_distinguished() {
        assert!(is_of_target("/ground_truth/debris"));
        assert!(is_of_target("/chaser/ground_truth/debris"));
        for robot in ["", "/chaser", "/ground_truth", "/debris"] {
            assert!(!is_of_target(robot), "{robot}");
        }
        assert_eq!(title_of(""), "");
        assert_eq!(title_of("/chaser"), "chaser");
        assert_eq!(title_of("/ground_truth/debris"), "debris");
        assert_eq!(title_of("/chaser/ground_truth/debris"), "chaser/debris");
    }
}
