//! Selection of topics to record.

use regex::Regex;

use crate::{
    nodes::topics,
    ros::{Node, NodeError},
};

/// Infrastructure topics that are recorded only if named explicitly.
const LEFT_OUT: [&str; 2] = ["/parameter_events", "/rosout"];

/// Selection of topics. Exclusion has priority. If nothing is named, all topics are selected; for a recorder in a
/// namespace, those of its robot.
#[derive(Debug, Clone, Default)]
pub struct Selection {
    /// Whether all topics are selected, in addition to those named.
    pub all: bool,
    /// Topics by name.
    pub topics: Vec<String>,
    /// Pattern of selected topics, matched anywhere in the full name.
    pub regex: Option<Regex>,
    /// Excluded topics by name.
    pub exclude_topics: Vec<String>,
    /// Pattern of excluded topics, matched anywhere in the full name.
    pub exclude_regex: Option<Regex>,
    /// The topics of its robot, which a recorder in a namespace records if nothing is named; `None` for all topics.
    pub own_robot: Option<OwnRobot>,
}

/// The topics of the recorder's robot.
#[derive(Debug, Clone, Default)]
pub struct OwnRobot {
    /// The robot's namespace, with a slash at the end.
    prefix: String,
    /// Full names of fuyu's topics after remapping; some are outside the namespace, such as `/clock`.
    known: Vec<String>,
}

impl OwnRobot {
    /// The robot of `node`; `None` for a node in the root namespace, whose robot's topics cannot be distinguished from
    /// others.
    fn of(node: &Node) -> Result<Option<Self>, NodeError> {
        let namespace = node.name().namespace();
        if namespace == "/" {
            return Ok(None);
        }
        let known = topics::all().into_iter();
        let known = known.map(|topic| node.resolve_topic(topic.name));
        Ok(Some(Self {
            prefix: format!("{namespace}/"),
            known: known.collect::<Result<_, _>>()?,
        }))
    }

    fn has(&self, topic: &str) -> bool {
        topic.starts_with(&self.prefix) || self.known.iter().any(|name| name == topic)
    }
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
            own_robot: OwnRobot::of(node)?,
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
        let is_own = self.own_robot.as_ref().is_none_or(|own| own.has(topic));
        is(&self.topics)
            || matches(&self.regex)
            || ((self.all || nothing_named && is_own) && !LEFT_OUT.contains(&topic))
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

    // Fails if the bag of one robot contains another one, or not the topics that robots share.
    #[test]
    fn a_robot_in_a_namespace_is_recorded_alone() {
        let own = OwnRobot {
            prefix: "/a/".into(),
            known: vec!["/a/joint_states".into(), "/clock".into(), "/tf".into()],
        };
        let selection = Selection {
            own_robot: Some(own.clone()),
            ..Selection::default()
        };
        for taken in ["/a/joint_states", "/a/my_topic", "/clock", "/tf"] {
            assert!(selection.takes(taken), "{taken}");
        }
        for left in ["/b/joint_states", "/ab/joint_states", "/joint_states"] {
            assert!(!selection.takes(left), "{left}");
        }
        let all = Selection {
            all: true,
            own_robot: Some(own),
            ..Selection::default()
        };
        assert!(all.takes("/b/joint_states"));
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
