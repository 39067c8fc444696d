//! Names of nodes, topics and services: the rules of ROS, expansion and remapping.

use std::fmt;

/// Longest topic name in DDS, without the prefix and suffix that ROS adds.
const MAX_TOPIC: usize = 247;
/// Longest node name or namespace.
const MAX_NODE: usize = 255;

/// A name that breaks the rules of ROS.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{kind} {name:?}: {rule}")]
pub struct NameError {
    kind: &'static str,
    name: String,
    rule: String,
}

/// Namespace and name of a node.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct NodeName {
    namespace: String,
    name: String,
}

impl NodeName {
    /// A name in a namespace (`/`, `/chaser`, also without the leading slash).
    ///
    /// # Errors
    /// [`NameError`] says which rule is broken.
    pub fn new(namespace: &str, name: &str) -> Result<Self, NameError> {
        let namespace = format!("/{}", namespace.strip_prefix('/').unwrap_or(namespace));
        check_tokens("node name", name, name, MAX_NODE)?;
        if name.contains('/') {
            return Err(broken(
                "node name",
                name,
                "must hold no slash; a namespace is given apart (-r __ns:=/name)",
            ));
        }
        if namespace != "/" {
            check_tokens("namespace", &namespace, &namespace[1..], MAX_NODE)?;
        }
        Ok(Self {
            namespace,
            name: name.to_owned(),
        })
    }

    /// `/` or `/chaser`.
    pub fn namespace(&self) -> &str {
        &self.namespace
    }

    /// `dynamics`.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// `/chaser/dynamics`.
    pub fn full(&self) -> String {
        join(&self.namespace, &self.name)
    }

    /// Full name of a topic or service: relative names are put into the namespace, `~/name` below the node; `{node}`,
    /// `{ns}` and `{namespace}` are substituted.
    ///
    /// # Errors
    /// [`NameError`] says which rule is broken.
    pub fn expand(&self, name: &str) -> Result<String, NameError> {
        let replaced = self.substitute(name)?;
        let full = match replaced.strip_prefix('~') {
            Some("") => self.full(),
            Some(rest) if rest.starts_with('/') => self.full() + rest,
            Some(_) => return Err(broken("name", name, "a `~` must be followed by a slash")),
            None if replaced.starts_with('/') => replaced,
            None => join(&self.namespace, &replaced),
        };
        check_tokens("name", name, &full[1..], MAX_TOPIC)?;
        Ok(full)
    }

    fn substitute(&self, name: &str) -> Result<String, NameError> {
        if !name.contains(['{', '}']) {
            return Ok(name.to_owned());
        }
        let replaced = name
            .replace("{node}", &self.name)
            .replace("{namespace}", self.namespace.trim_start_matches('/'))
            .replace("{ns}", self.namespace.trim_start_matches('/'));
        if replaced.contains(['{', '}']) {
            let rule = "only {node}, {ns} and {namespace} can stand in braces";
            return Err(broken("name", name, rule));
        }
        Ok(replaced)
    }
}

impl fmt::Display for NodeName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.full())
    }
}

fn join(namespace: &str, name: &str) -> String {
    format!("{}/{name}", namespace.trim_end_matches('/'))
}

fn broken(kind: &'static str, name: &str, rule: impl Into<String>) -> NameError {
    NameError {
        kind,
        name: name.to_owned(),
        rule: rule.into(),
    }
}

/// Checks the parts of `path` (no leading slash). `shown` is the user's text, for errors.
fn check_tokens(
    kind: &'static str,
    shown: &str,
    path: &str,
    longest: usize,
) -> Result<(), NameError> {
    if shown.is_empty() {
        return Err(broken(kind, shown, "must not be empty"));
    }
    if path.len() > longest {
        let rule = format!("is {} characters long, at most {longest} fit", path.len());
        return Err(broken(kind, shown, rule));
    }
    for token in path.split('/') {
        let Some(first) = token.chars().next() else {
            let rule = "must not end with a slash nor hold two in a row";
            return Err(broken(kind, shown, rule));
        };
        if first.is_ascii_digit() {
            let rule = format!("`{token}` must not start with a digit");
            return Err(broken(kind, shown, rule));
        }
        let odd = token
            .chars()
            .find(|c| !c.is_ascii_alphanumeric() && *c != '_');
        if let Some(odd) = odd {
            let rule = format!("{odd:?} is not allowed, only letters, digits and underscores are");
            return Err(broken(kind, shown, rule));
        }
    }
    Ok(())
}

/// Kind of name that a remap rule changes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Target {
    /// `__node:=name`
    NodeName,
    /// `__ns:=/namespace`
    Namespace,
    /// `from:=to` for topics, services or both.
    Name {
        /// The name to replace, as written.
        from: String,
        /// Whether the rule applies to topics.
        topics: bool,
        /// Whether the rule applies to services.
        services: bool,
    },
}

/// One `-r` argument.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Remap {
    /// The node, by the name in its program, that the rule is limited to.
    pub node: Option<String>,
    /// The name to be replaced.
    pub target: Target,
    /// The replacement.
    pub to: String,
}

/// The name of a node and its remap rules.
#[derive(Debug, Clone)]
pub struct Names {
    node: NodeName,
    rules: Vec<Remap>,
}

impl Names {
    /// Creates the names of a node; `__node` and `__ns` rules are applied to the name that the program chose.
    ///
    /// # Errors
    /// [`NameError`] if the name breaks the rules before or after remapping.
    pub fn new(namespace: &str, name: &str, rules: &[Remap]) -> Result<Self, NameError> {
        let rules: Vec<_> = rules
            .iter()
            .filter(|r| r.node.as_deref().is_none_or(|n| n == name))
            .cloned()
            .collect();
        let rule = |target: Target| rules.iter().find(|r| r.target == target);
        let node = NodeName::new(
            rule(Target::Namespace).map_or(namespace, |r| &r.to),
            rule(Target::NodeName).map_or(name, |r| &r.to),
        )?;
        Ok(Self { node, rules })
    }

    /// The node.
    pub fn node(&self) -> &NodeName {
        &self.node
    }

    /// Full name of a topic, expanded and remapped.
    ///
    /// # Errors
    /// [`NameError`] says which rule is broken.
    pub fn topic(&self, name: &str) -> Result<String, NameError> {
        self.resolve(name, |target| {
            matches!(target, Target::Name { topics: true, .. })
        })
    }

    /// Full name of a service, expanded and remapped.
    ///
    /// # Errors
    /// [`NameError`] says which rule is broken.
    pub fn service(&self, name: &str) -> Result<String, NameError> {
        self.resolve(name, |target| {
            matches!(target, Target::Name { services: true, .. })
        })
    }

    fn resolve(&self, name: &str, applies: impl Fn(&Target) -> bool) -> Result<String, NameError> {
        let full = self.node.expand(name)?;
        for rule in self.rules.iter().filter(|r| applies(&r.target)) {
            if let Target::Name { from, .. } = &rule.target
                && self.node.expand(from)? == full
            {
                return self.node.expand(&rule.to);
            }
        }
        Ok(full)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn node() -> NodeName {
        NodeName::new("/chaser", "dynamics").unwrap()
    }

    #[test]
    fn names_expand_as_in_rcl() {
        for (name, full) in [
            ("joint_states", "/chaser/joint_states"),
            ("camera/tip_pose", "/chaser/camera/tip_pose"),
            ("/clock", "/clock"),
            ("~", "/chaser/dynamics"),
            ("~/set_parameters", "/chaser/dynamics/set_parameters"),
            ("{node}/state", "/chaser/dynamics/state"),
            ("/{ns}/a__b", "/chaser/a__b"),
        ] {
            assert_eq!(node().expand(name).unwrap(), full);
        }
        let root = NodeName::new("/", "dynamics").unwrap();
        assert_eq!(root.expand("joint_states").unwrap(), "/joint_states");
        assert_eq!(root.full(), "/dynamics");
        assert_eq!(NodeName::new("chaser", "dynamics").unwrap(), node());
    }

    #[test]
    fn broken_names_are_refused() {
        for name in [
            "", "/", "a//b", "a/", "2a", "a/2b", "~a", "a~", "a b", "a-b", "{who}", "{ns", "ü",
        ] {
            let text = node().expand(name).unwrap_err().to_string();
            assert!(text.contains(name), "{text}");
        }
        assert!(node().expand(&"a".repeat(300)).is_err());
        for (namespace, name) in [
            ("/", ""),
            ("/", "a/b"),
            ("/", "1a"),
            ("/a/", "b"),
            ("//", "b"),
        ] {
            assert!(
                NodeName::new(namespace, name).is_err(),
                "{namespace} {name}"
            );
        }
    }

    #[test]
    fn remaps_match_full_names() {
        let topic = |from: &str, to: &str| Remap {
            node: None,
            target: Target::Name {
                from: from.into(),
                topics: true,
                services: true,
            },
            to: to.into(),
        };
        let own = |target, to: &str| Remap {
            node: Some("dynamics".into()),
            target,
            to: to.into(),
        };
        let rules = [
            own(Target::Namespace, "/chaser"),
            own(Target::NodeName, "plant"),
            Remap {
                node: Some("camera".into()),
                ..topic("joint_states", "never")
            },
            topic("/chaser/joint_states", "/js"),
            topic("joint_states", "/second"),
            topic("~/reset", "reset"),
        ];
        let names = Names::new("/", "dynamics", &rules).unwrap();
        assert_eq!(names.node().full(), "/chaser/plant");
        assert_eq!(names.topic("joint_states").unwrap(), "/js");
        assert_eq!(names.topic("/joint_states").unwrap(), "/joint_states");
        assert_eq!(names.service("~/reset").unwrap(), "/chaser/reset");
    }
}
