use super::*;
use crate::ros::params::ParameterValue as V;

const SCENARIO: &str = "
/**:
  ros__parameters:
    use_sim_time: true
    gain: 0.5
dynamics:
  ros__parameters:
    time_step: 0.01
    steps: 3
    urdf: 'urdf/servicer.urdf'
    target: {mass: 900.0, inertia: [1.0, 2.0, 3.0]}
    joints:
      names: [a, \"b\"]
      a.kp: 1e3
    tags: []
    on: yes
    flags: [true, false]
    version: '7'
    big: -9223372036854775808
    odd: .inf
/chaser/camera:
  ros__parameters:
    gain: 2.5
chaser:
  controller: {ros__parameters: {gain: 3.5}}
/chaser/*:
  ros__parameters: {everyone: 1}
idle:
  ros__parameters:
";

fn given(namespace: &str, name: &str) -> Vec<(String, V)> {
    let file = ParamsFile::parse("a.yaml", SCENARIO).unwrap();
    let node = NodeName::new(namespace, name).unwrap();
    let overrides = file.overrides(&node).into_iter();
    overrides.map(|o| (o.name, o.value)).collect()
}

fn value(all: &[(String, V)], name: &str) -> V {
    let found = all.iter().rfind(|(n, _)| n == name);
    found.map(|(_, v)| v.clone()).unwrap_or_default()
}

#[test]
fn values_keep_their_types_and_nested_names_are_dotted() {
    let all = given("/", "dynamics");
    for (name, expected) in [
        ("use_sim_time", V::Bool(true)),
        ("time_step", V::Double(0.01)),
        ("steps", V::Integer(3)),
        ("urdf", V::String("urdf/servicer.urdf".into())),
        ("target.mass", V::Double(900.0)),
        ("target.inertia", V::DoubleArray(vec![1.0, 2.0, 3.0])),
        ("joints.names", V::StringArray(vec!["a".into(), "b".into()])),
        ("joints.a.kp", V::Double(1000.0)),
        ("tags", V::IntegerArray(vec![])),
        ("on", V::Bool(true)),
        ("flags", V::BoolArray(vec![true, false])),
        ("version", V::String("7".into())),
        ("big", V::Integer(i64::MIN)),
        ("odd", V::Double(f64::INFINITY)),
        ("absent", V::NotSet),
    ] {
        assert_eq!(value(&all, name), expected, "{name}");
    }
}

#[test]
fn nodes_are_matched_by_name_namespace_and_wildcard() {
    let gain = |namespace, name| value(&given(namespace, name), "gain");
    assert_eq!(gain("/", "anything"), V::Double(0.5));
    assert_eq!(gain("/chaser", "camera"), V::Double(2.5));
    assert_eq!(gain("/other", "camera"), V::Double(0.5));
    assert_eq!(gain("/chaser", "controller"), V::Double(3.5));
    // A name without a slash matches the node in any namespace.
    let steps = value(&given("/chaser", "dynamics"), "steps");
    assert_eq!(steps, V::Integer(3));
    // `*` matches one name, not two.
    let everyone = |namespace| value(&given(namespace, "x"), "everyone");
    assert_eq!(everyone("/chaser"), V::Integer(1));
    assert_eq!(everyone("/chaser/arm"), V::NotSet);
    assert_eq!(everyone("/"), V::NotSet);
}

#[test]
fn nodes_are_listed_once_and_without_wildcards() {
    let nodes = ParamsFile::parse("a.yaml", SCENARIO).unwrap().nodes();
    let names: Vec<_> = nodes.iter().map(NodeName::full).collect();
    assert_eq!(
        names,
        ["/dynamics", "/chaser/camera", "/chaser/controller", "/idle"]
    );
}

#[test]
fn overrides_know_their_line() {
    let file = ParamsFile::parse("a.yaml", SCENARIO).unwrap();
    let node = NodeName::new("/", "dynamics").unwrap();
    let step = file.overrides(&node);
    let step = step.iter().find(|o| o.name == "time_step").unwrap();
    assert_eq!(step.source.to_string(), "a.yaml:8");
}

/// The error of each broken file must state file, line, field and the allowed values.
#[test]
fn broken_files_are_explained() {
    for (text, line, field, expected) in [
        ("dynamics: 3", 1, "dynamics", "expected `ros__parameters:`"),
        (
            "dynamics:\n  time_step: 0.01",
            2,
            "dynamics/time_step",
            "belongs below `ros__parameters:`",
        ),
        (
            "ros__parameters:\n  a: 1",
            1,
            "ros__parameters",
            "expected a node's name above it",
        ),
        (
            "dynamics:\n  ros__parameters: [1, 2]",
            2,
            "dynamics: ros__parameters",
            "expected `name: value`",
        ),
        (
            "dynamics:\n  ros__parameters:\n    a:",
            3,
            "dynamics: a",
            "no value",
        ),
        (
            "n:\n  ros__parameters:\n    a: [1.0, 2]",
            3,
            "n: a",
            "write 2.0",
        ),
        (
            "n:\n  ros__parameters:\n    a: [[1], [2]]",
            3,
            "n: a",
            "flatten it",
        ),
        (
            "n:\n  ros__parameters:\n    a: [{b: 1}]",
            3,
            "n: a",
            "flatten it",
        ),
        (
            "n:\n  ros__parameters:\n    a: 1\n   b: 2",
            4,
            "",
            "not valid YAML",
        ),
        ("n:\n  ros__parameters:\n\ta: 1", 3, "", "not valid YAML"),
        (
            "n:\n  ros__parameters:\n    a: 'open",
            3,
            "",
            "not valid YAML",
        ),
        (
            "n:\n  ros__parameters:\n    a: 1\n    a: 2",
            4,
            "",
            "duplicate mapping key: a",
        ),
        (
            "my node:\n  ros__parameters: {a: 1}",
            1,
            "my node",
            "only letters, digits",
        ),
        ("- a\n- b", 1, "", "expected `node_name:`"),
    ] {
        let error = ParamsFile::parse("config/x.yaml", text)
            .unwrap_err()
            .to_string();
        let place = format!("config/x.yaml:{line}: ");
        assert!(error.starts_with(&place), "{text:?} gave {error}");
        assert!(error.contains(field), "{text:?} gave {error}");
        assert!(error.contains(expected), "{text:?} gave {error}");
        assert!(!error.contains('\n'), "{error}");
    }
    let error = ParamsFile::read("no/such.yaml").unwrap_err().to_string();
    assert!(error.starts_with("no/such.yaml: cannot be read"), "{error}");
}

#[test]
fn an_empty_file_gives_nothing() {
    assert!(ParamsFile::parse("a.yaml", "").unwrap().nodes().is_empty());
}
