use std::sync::Arc;

use super::{Declare, Override, ParameterStore, ParameterValue as V, Source};
use crate::ros::{NodeName, ParamsFile};

fn store(yaml: &str) -> Arc<ParameterStore> {
    let node = NodeName::new("/", "camera").unwrap();
    let file = ParamsFile::parse("x.yaml", yaml).unwrap();
    Arc::new(ParameterStore::new(node.clone(), file.overrides(&node)))
}

#[test]
fn given_values_replace_defaults_and_live_ones_follow() {
    let store =
        store("camera: {ros__parameters: {rate: 20.0, gain: 1.5, names: [], bytes: [1, 2]}}");
    let mut declare = Declare::new(Arc::clone(&store));
    let rate = declare
        .param("rate", 30.0, "Frames [Hz]")
        .range(1.0, 100.0)
        .read_only()
        .value();
    let gain = declare.param("gain", 0.5, "Gain").range(0.0, 2.0).live();
    let tip = declare.param("tip", "tool0", "Tip link").value();
    let count = declare.param("count", 4, "Count").value();
    let names = declare.param("names", ["a"], "Names").value();
    let bytes = declare.required::<Vec<u8>>("bytes", "Bytes").value();
    declare.finish().unwrap();
    assert_eq!((rate, tip.as_str(), count), (20.0, "tool0", 4));
    assert_eq!((names, bytes), (Vec::<String>::new(), vec![1, 2]));
    assert_eq!(gain.get(), 1.5);
    assert!(!gain.changed());
    store.set(vec![("gain".into(), V::Double(2.0))]).unwrap();
    assert!(gain.changed() && !gain.changed());
    assert_eq!(gain.get(), 2.0);
}

#[test]
fn everything_wrong_is_reported_at_once() {
    let store = store(
        "camera:\n  ros__parameters:\n    gian: 1.0\n    rate: 30\n    noise: -1.0\n    even: 3\n",
    );
    let mut declare = Declare::new(store);
    let _ = declare.param("gain", 0.5, "Gain").value();
    let _ = declare.param("rate", 30.0, "Frames [Hz]").value();
    let _ = declare
        .param("noise", 0.0, "Noise [m]")
        .range(0.0, 1.0)
        .value();
    let _ = declare
        .param("even", 2, "Even")
        .check("even", |v| match v % 2 {
            0 => Ok(()),
            _ => Err(format!("{v} is odd")),
        })
        .value();
    let _ = declare.required::<String>("urdf", "The robot").value();
    let text = declare.finish().unwrap_err().to_string();
    let lines: Vec<_> = text.lines().collect();
    assert_eq!(
        lines,
        [
            "x.yaml:4: parameter rate of /camera: 30 is an integer, expected a double; write 30.0",
            "x.yaml:5: parameter noise of /camera: -1.0 is out of range, expected 0 to 1",
            "x.yaml:6: parameter even of /camera: 3 is odd",
            "node /camera: parameter urdf is not given; expected a string (The robot)",
            "x.yaml:3: parameter gian: node /camera has no such parameter; did you mean gain?",
        ]
    );
}

#[test]
fn a_running_node_refuses_with_the_reason() {
    let store = store("");
    let mut declare = Declare::new(Arc::clone(&store));
    let _ = declare
        .param("near", 0.1, "Near [m]")
        .range(0.0, 10.0)
        .live();
    let _ = declare.param("far", 5.0, "Far [m]").range(0.0, 10.0).live();
    let _ = declare.param("urdf", "a.urdf", "Robot").read_only().value();
    declare.check_together(|get| match (get("near"), get("far")) {
        (V::Double(near), V::Double(far)) if near >= far => Err("near must be below far".into()),
        _ => Ok(()),
    });
    declare.finish().unwrap();
    let set = |values: &[(&str, V)]| {
        let values = values.iter().map(|(n, v)| ((*n).to_owned(), v.clone()));
        store.set(values.collect()).map_err(|e| e.to_string())
    };
    for (values, reason) in [
        (vec![("nothing", V::Bool(true))], "not declared"),
        (vec![("near", V::Integer(1))], "write 1.0"),
        (vec![("near", V::NotSet)], "expected a double"),
        (vec![("near", V::Double(f64::NAN))], "out of range"),
        (vec![("near", V::Double(11.0))], "expected 0 to 10"),
        (vec![("urdf", V::String("b".into()))], "read-only"),
        (vec![("near", V::Double(6.0))], "near must be below far"),
        // All values are set or none: the first one alone is valid.
        (
            vec![("far", V::Double(9.0)), ("near", V::Double(-1.0))],
            "out of range",
        ),
    ] {
        let error = set(&values).unwrap_err();
        assert!(
            error.contains(values.last().unwrap().0) && error.contains(reason),
            "{error}"
        );
    }
    assert_eq!(store.get("far"), Some(V::Double(5.0)));
    // The values are valid together, but would not be if they were set one after the other.
    set(&[("near", V::Double(6.0)), ("far", V::Double(7.0))]).unwrap();
    assert_eq!(store.get("near"), Some(V::Double(6.0)));
}

#[test]
fn dynamic_names_are_found_below_a_prefix() {
    let store = store("camera: {ros__parameters: {j: {b: {kp: 1.0, kd: 2.0}, a: {kp: 3.0}}}}");
    let mut declare = Declare::new(store);
    let names = declare.children("j");
    assert_eq!(names, ["b", "a"]);
    for name in names {
        let _ = declare.param(&format!("j.{name}.kp"), 0.0, "Gain").value();
    }
    let error = declare.finish().unwrap_err().to_string();
    assert!(
        error.contains("j.b.kd") && error.lines().count() == 1,
        "{error}"
    );
}

#[test]
fn the_last_source_wins() {
    let given = |value, source| Override {
        name: "a".into(),
        value,
        source,
        shared: false,
    };
    let node = NodeName::new("/", "n").unwrap();
    let overrides = vec![
        given(V::Integer(1), Source::Program),
        given(V::Integer(2), Source::Argument),
    ];
    let mut declare = Declare::new(Arc::new(ParameterStore::new(node, overrides)));
    assert_eq!(declare.param("a", 0, "A").value(), 2);
    declare.finish().unwrap();
}

// Fails if `/**` or an unscoped `-p`, which apply only to nodes with such a parameter, prevent a launch, or if a
// misspelt parameter of one node is accepted.
#[test]
fn what_is_given_to_all_nodes_may_be_for_others() {
    let finish = |text: &str, arguments: &str, only_node| {
        let arguments = arguments.split_whitespace().map(str::to_owned);
        let (mut args, _) = crate::ros::RosArgs::parse(arguments).unwrap();
        args.only_node = only_node;
        let node = NodeName::new("/", "arm").unwrap();
        let file = ParamsFile::parse("x.yaml", text).unwrap();
        let mut overrides = file.overrides(&node);
        overrides.extend(args.overrides(&node, "arm").unwrap());
        let mut declare = Declare::new(Arc::new(ParameterStore::new(node, overrides)));
        let gain = declare.param("gain", 1.0, "Gain").value();
        declare.finish().map(|()| gain)
    };
    let (all, arm) = ("/**: {ros__parameters: {", "arm: {ros__parameters: {");
    assert_eq!(
        finish(&format!("{all}gain: 2.0, tip: a}}}}"), "", true),
        Ok(2.0)
    );
    assert!(finish(&format!("{arm}gain: 2.0, tip: a}}}}"), "", false).is_err());
    let text = format!("{arm}gain: 2.0}}}}");
    assert_eq!(
        finish(&text, "--ros-args -p tip:=a -p gain:=3.0", false),
        Ok(3.0)
    );
    assert!(finish(&text, "--ros-args -p tip:=a", true).is_err());
    assert!(finish(&text, "--ros-args -p arm:tip:=a", false).is_err());
}
