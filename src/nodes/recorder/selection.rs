//! Selection of the topics to record.

use regex::Regex;

use crate::ros::{Node, NodeError};

/// Infrastructure topics that are recorded only if named.
const LEFT_OUT: [&str; 2] = ["/parameter_events", "/rosout"];

/// Selection of topics. Exclusion has priority; without any names, all topics are selected.
#[derive(Debug, Clone, Default)]
pub struct Selection {
    /// All topics, in addition to those named.
    pub all: bool,
    /// Topics by name.
    pub topics: Vec<String>,
    /// Topics whose full name this matches (in part).
    pub regex: Option<Regex>,
    /// Excluded topics by name.
    pub exclude_topics: Vec<String>,
    /// Excluded topics whose full name this matches (in part).
    pub exclude_regex: Option<Regex>,
}

impl Selection {
    /// The selection with full names, as `node` expands and remaps them.
    ///
    /// # Errors
    /// [`NodeError::Name`] for an invalid name.
    pub fn resolved(self, node: &Node) -> Result<Self, NodeError> {
        let resolve = |names: Vec<String>| -> Result<Vec<String>, NodeError> {
            names.iter().map(|name| node.resolve_topic(name)).collect()
        };
        Ok(Self {
            topics: resolve(self.topics)?,
            exclude_topics: resolve(self.exclude_topics)?,
            ..self
        })
    }

    /// Whether the topic with this full name is selected.
    pub fn takes(&self, topic: &str) -> bool {
        let is = |names: &[String]| names.iter().any(|name| name == topic);
        let matches = |regex: &Option<Regex>| regex.as_ref().is_some_and(|r| r.is_match(topic));
        if is(&self.exclude_topics) || matches(&self.exclude_regex) {
            return false;
        }
        let nothing_named = self.topics.is_empty() && self.regex.is_none();
        is(&self.topics)
            || matches(&self.regex)
            || ((self.all || nothing_named) && !LEFT_OUT.contains(&topic))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn regex(text: &str) -> Option<Regex> {
        Some(Regex::new(text).unwrap())
    }

    #[test]
    fn nothing_named_is_everything_but_plumbing() {
        let all = Selection::default();
        assert!(all.takes("/joint_states"));
        assert!(!all.takes("/rosout") && !all.takes("/parameter_events"));
        let named = Selection {
            all: true,
            topics: vec!["/rosout".into()],
            ..Selection::default()
        };
        assert!(named.takes("/rosout") && named.takes("/tf"));
        assert!(!named.takes("/parameter_events"));
    }

    #[test]
    fn names_and_expressions_add_up_and_exclusion_wins() {
        let selection = Selection {
            topics: vec!["/tf".into(), "/camera/image".into()],
            regex: regex("^/ground_truth/|states"),
            exclude_topics: vec!["/ground_truth/target/odom".into()],
            exclude_regex: regex("image"),
            ..Selection::default()
        };
        for taken in ["/tf", "/ground_truth/odom", "/a/joint_states"] {
            assert!(selection.takes(taken), "{taken}");
        }
        for left in [
            "/tf_static",
            "/ground_truth/target/odom",
            "/camera/image",
            "/a/ground_truth/odom",
        ] {
            assert!(!selection.takes(left), "{left}");
        }
        let only_excluding = Selection {
            exclude_regex: regex("^/camera/"),
            ..Selection::default()
        };
        assert!(only_excluding.takes("/tf") && !only_excluding.takes("/camera/tip_pose"));
    }
}
