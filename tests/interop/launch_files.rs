//! The launch files. No package index has ROS's own `launch`, so a reader here does what it does with the elements
//! that they use: it refuses any other element, attribute or substitution, and makes the command lines that
//! `launch_ros` makes. What it cannot show is that `launch` itself takes the files.

use roxmltree::{Document, Node as Element};
use serde_json::{Value, json};
use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    process::{Command, Stdio},
};

use crate::{
    binaries::binary,
    child::Running,
    peer::{Peer, python},
    waiting::{PATIENCE, eventually},
};

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// A node as a launch file starts it.
#[derive(Debug, Clone, PartialEq)]
struct Start {
    exec: String,
    name: String,
    namespace: String,
    files: Vec<String>,
    params: Vec<(String, String)>,
    remaps: Vec<(String, String)>,
}

impl Start {
    /// The command line that `launch_ros` makes; parameters with a value go into a file for all nodes.
    fn command(&self, folder: &Path) -> Command {
        let mut command = Command::new(binary(&self.exec));
        command.arg("--ros-args");
        let mut remap = |from: &str, to: &str| {
            command.args(["-r", &format!("{from}:={to}")]);
        };
        remap("__node", &self.name);
        remap("__ns", &self.namespace);
        for (from, to) in &self.remaps {
            remap(from, to);
        }
        for file in &self.files {
            command.args(["--params-file", file]);
        }
        for (name, value) in &self.params {
            let value = if value.is_empty() { "''" } else { value };
            let flat = self.namespace.replace('/', "-");
            let file = folder.join(format!("{flat}{}-{name}.yaml", self.name));
            let text = format!("/**:\n  ros__parameters:\n    {name}: {value}\n");
            fs::write(&file, text).expect("a file");
            command.arg("--params-file").arg(file);
        }
        command.current_dir(folder).stdout(Stdio::null());
        command
    }
}

/// What is in force where an element stands.
#[derive(Debug, Clone, Default)]
struct Scope {
    variables: BTreeMap<String, String>,
    namespace: String,
    remaps: Vec<(String, String)>,
}

impl Scope {
    fn text(&self, text: &str) -> String {
        let mut out = String::new();
        let mut rest = text;
        while let Some((before, inside)) = rest.split_once("$(") {
            let (substitution, after) = inside.split_once(')').expect("a closed substitution");
            out += before;
            out += &match substitution.split_once(' ') {
                Some(("var", name)) => self.variables[name].clone(),
                // The sources are laid out as the install space's share.
                Some(("find-pkg-share", "fuyu")) => root().display().to_string(),
                _ => panic!("substitution {substitution}"),
            };
            rest = after;
        }
        out + rest
    }

    /// An attribute with its substitutions, if it is there.
    fn attribute(&self, element: Element, name: &str) -> Option<String> {
        element.attribute(name).map(|text| self.text(text))
    }

    fn needed(&self, element: Element, name: &str) -> String {
        let found = self.attribute(element, name);
        found.unwrap_or_else(|| panic!("{element:?} lacks {name}"))
    }

    fn holds(&self, element: Element) -> bool {
        let truth = |name, otherwise| match self.attribute(element, name).as_deref() {
            None => otherwise,
            Some("true" | "1") => true,
            Some("false" | "0") => false,
            Some(other) => panic!("{name}={other}"),
        };
        truth("if", true) && !truth("unless", false)
    }

    fn read(&mut self, path: &Path, starts: &mut Vec<Start>) {
        let text = fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        let document = Document::parse(&text).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        let launch = document.root_element();
        assert!(launch.has_tag_name("launch"), "{}", path.display());
        self.children(launch, starts);
    }

    fn children(&mut self, parent: Element, starts: &mut Vec<Start>) {
        for element in parent.children().filter(Element::is_element) {
            let name = element.tag_name().name();
            let known: &[&str] = match name {
                "arg" => &["name", "default", "description"],
                "group" => &["if", "unless"],
                "push_ros_namespace" => &["namespace"],
                "set_remap" => &["from", "to"],
                "node" => &["pkg", "exec", "name", "output", "if", "unless"],
                "include" => &["file", "if", "unless"],
                other => panic!("element {other}"),
            };
            for attribute in element.attributes() {
                assert!(known.contains(&attribute.name()), "{name} {attribute:?}");
            }
            if !self.holds(element) {
                continue;
            }
            match name {
                "arg" => {
                    assert!(!self.needed(element, "description").is_empty());
                    let (key, default) = (
                        self.needed(element, "name"),
                        self.attribute(element, "default"),
                    );
                    let default = default.unwrap_or_else(|| panic!("{key} must be given"));
                    self.variables.entry(key).or_insert(default);
                }
                "group" => self.clone().children(element, starts),
                "push_ros_namespace" => {
                    let next = self.needed(element, "namespace");
                    let next = next.trim_matches('/');
                    if !next.is_empty() {
                        self.namespace += &format!("/{next}");
                    }
                }
                "set_remap" => {
                    let rule = (self.needed(element, "from"), self.needed(element, "to"));
                    self.remaps.push(rule);
                }
                "include" => {
                    // Arguments of an include are set for what comes after it, too.
                    for argument in element.children().filter(Element::is_element) {
                        assert!(argument.has_tag_name("arg"), "{argument:?}");
                        let (name, value) = (
                            self.needed(argument, "name"),
                            self.needed(argument, "value"),
                        );
                        self.variables.insert(name, value);
                    }
                    let file = self.needed(element, "file");
                    self.read(Path::new(&file), starts);
                }
                _ => starts.push(self.node(element)),
            }
        }
    }

    fn node(&self, element: Element) -> Start {
        assert_eq!(self.needed(element, "pkg"), "fuyu");
        let mut start = Start {
            exec: self.needed(element, "exec"),
            name: self.needed(element, "name"),
            namespace: match self.namespace.as_str() {
                "" => "/".to_owned(),
                namespace => namespace.to_owned(),
            },
            files: Vec::new(),
            params: Vec::new(),
            remaps: self.remaps.clone(),
        };
        for param in element.children().filter(Element::is_element) {
            assert!(param.has_tag_name("param"), "{param:?}");
            match self.attribute(param, "from") {
                Some(file) => start.files.push(file),
                None => {
                    let pair = (self.needed(param, "name"), self.needed(param, "value"));
                    start.params.push(pair);
                }
            }
        }
        start
    }
}

/// What `ros2 launch fuyu FILE NAME:=VALUE...` would start.
fn starts(file: &Path, arguments: &[(&str, &str)]) -> Vec<Start> {
    let own = |(name, value): &(&str, &str)| ((*name).to_owned(), (*value).to_owned());
    let mut scope = Scope {
        variables: arguments.iter().map(own).collect(),
        ..Scope::default()
    };
    let mut starts = Vec::new();
    scope.read(file, &mut starts);
    starts
}

fn scenarios() -> Vec<PathBuf> {
    let files = fs::read_dir(root().join("config")).expect("config/");
    let paths = files.map(|file| file.expect("a file").path());
    // Campaigns are in a folder of their own.
    paths.filter(|path| path.is_file()).collect()
}

/// Namespaces and names of the nodes that a scenario names; those without a namespace get `otherwise`.
fn named(scenario: &Path, otherwise: &str) -> Vec<(String, String)> {
    let text = fs::read_to_string(scenario).expect("a scenario");
    let keys = text.lines().filter(|line| !line.starts_with([' ', '#']));
    let keys = keys.filter_map(|line| line.strip_suffix(':'));
    let keys = keys.filter(|key| !key.contains('*'));
    let mut keys: Vec<_> = keys
        .map(|key| key.rsplit_once('/').unwrap_or((otherwise, key)))
        .map(|(namespace, name)| (namespace.to_owned(), name.to_owned()))
        .collect();
    keys.sort();
    keys
}

/// Number of dynamics nodes of a scenario.
fn robots(scenario: &Path) -> usize {
    let named = named(scenario, "/").into_iter();
    named.filter(|(_, name)| name == "dynamics").count()
}

// Fails when a scenario has no launch file, or one that starts other nodes or reads another file.
#[test]
fn every_scenario_has_a_launch_file() {
    for scenario in scenarios() {
        let stem = scenario
            .file_stem()
            .expect("a name")
            .to_str()
            .expect("text");
        let file = root().join(format!("launch/{stem}.launch.xml"));
        let starts = starts(&file, &[("namespace", "chaser")]);
        let mut names: Vec<_> = starts
            .iter()
            .map(|start| (start.namespace.clone(), start.name.clone()))
            .collect();
        names.sort();
        let robots = robots(&scenario);
        let otherwise = if robots > 1 { "/" } else { "/chaser" };
        assert_eq!(names, named(&scenario, otherwise), "{stem}");
        for start in starts {
            binary(&start.exec);
            assert_eq!(start.exec, start.name);
            assert_eq!(start.files, [scenario.display().to_string()]);
            for topic in ["clock", "tf", "tf_static"] {
                let rule = (format!("/{topic}"), topic.to_owned());
                // Robots of one world share its clock.
                let is_renamed = topic != "clock" || robots == 1;
                assert_eq!(start.remaps.contains(&rule), is_renamed, "{stem} {topic}");
            }
        }
    }
}

// Fails when messages of one robot reach the other: clock, transforms, commands.
#[test]
fn two_robots_share_a_graph() {
    let domain = 14;
    let folder = tempfile::tempdir().expect("a folder");
    let starts = starts(&root().join("launch/two_robots.launch.xml"), &[]);
    assert_eq!(starts.len(), 6);
    let mut nodes: Vec<_> = starts
        .iter()
        .map(|start| (start, Running::start(start.command(folder.path()), domain)))
        .collect();
    // A peer of Fast DDS may miss endpoints that are made while it comes.
    for (start, node) in &nodes {
        if start.name == "dynamics" {
            node.says("bodies");
        }
    }
    let mut peer = Peer::start("observer", domain);
    for robot in ["/chaser1", "/chaser2"] {
        for (topic, kind) in [
            ("joint_states", "sensor_msgs/msg/JointState"),
            ("joint_commands", "sensor_msgs/msg/JointState"),
            ("clock", "rosgraph_msgs/msg/Clock"),
        ] {
            peer.subscribe(&format!("{robot}/{topic}"), kind, "reliable");
        }
    }
    for topic in [
        "/chaser1/joint_commands",
        "/chaser2/joint_commands",
        "/chaser1/clock",
    ] {
        peer.receive(topic, 20);
    }
    // One robot loses its controller and its dynamics; the other does not notice.
    nodes.retain_mut(|(start, node)| {
        let first = start.namespace == "/chaser1";
        if first {
            node.signal("KILL");
        }
        !first
    });
    let now = peer.does(json!({"do": "wait", "topic": "/chaser2/joint_commands"}));
    let since = now.as_array().and_then(|all| all.last()).expect("commands")["time"].clone();
    let later = eventually("the other robot goes on", PATIENCE, || {
        let wait = json!({
            "do": "wait", "topic": "/chaser2/joint_commands", "since": since, "count": 50
        });
        let later = peer.does(wait).as_array().expect("a list").clone();
        (later.len() >= 50).then_some(later)
    });
    println!("{} commands after the first robot's end", later.len());
    for kind in ["publishers", "subscribers"] {
        for node in ["dynamics", "camera", "controller"] {
            let graph = peer.graph(node, "/chaser2", &json!({}));
            for topic in graph[kind].as_object().expect("names").keys() {
                let shared = ["/rosout", "/parameter_events"].contains(&topic.as_str());
                assert!(shared || topic.starts_with("/chaser2/"), "{node}: {topic}");
            }
        }
    }
    for (_, node) in nodes {
        node.interrupt();
    }
}

// Fails when the launch file in Python starts other nodes than the scenario names, or with other arguments.
#[test]
fn the_launch_file_in_python_starts_what_a_scenario_names() {
    for scenario in scenarios() {
        let output = Command::new(python())
            .arg(root().join("tests/interop/read_launch.py"))
            .arg(root().join("launch/scenario.launch.py"))
            .arg(format!("config:={}", scenario.display()))
            .arg("namespace:=/chaser")
            .stderr(Stdio::inherit())
            .output()
            .expect("python can be started");
        let found: Vec<Value> = serde_json::from_slice(&output.stdout).expect("JSON");
        for key in ["name", "executable"] {
            let text = |node: &Value, key: &str| node[key].as_str().expect("text").to_owned();
            let mut all: Vec<_> = found
                .iter()
                .map(|node| (text(node, "namespace"), text(node, key)))
                .collect();
            all.sort_unstable();
            assert_eq!(all, named(&scenario, "/chaser"));
        }
        for node in &found {
            assert_eq!(node["parameters"], json!([scenario.display().to_string()]));
            assert_eq!(node["ends_all"], node["name"] == "dynamics");
        }
    }
}
