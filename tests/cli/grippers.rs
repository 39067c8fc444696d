//! Grippers in scenarios: `config/gripping.yaml`, in which one closes on a tumbling satellite.

use nalgebra::Vector3;
use serde_json::Value;

use crate::fuyu::fuyu;

const CONFIG: &str = "config/gripping.yaml";

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value}"))
}

fn vector(value: &Value) -> Vector3<f64> {
    let numbers: Vec<f64> = serde_json::from_value(value.clone()).unwrap();
    Vector3::from_column_slice(&numbers)
}

/// Would break if the fingers did not press with the effort of the gripper, if contact changed momentum, or if the work of
/// the gripper were not among that of the joints.
#[test]
fn a_gripper_closes_on_a_tumbling_satellite_and_holds_it() {
    let folder = tempfile::tempdir().unwrap();
    let bag = folder.path().join("bag");
    let bag = bag.to_str().unwrap();
    let start = fuyu(&["simulate", CONFIG, "--duration", "0.01", "--json"]).json();
    let run = fuyu(&["simulate", CONFIG, "--json", "--output", bag]).json();
    let events = run["events"].as_array().expect("a list");
    for finger in ["left_finger", "right_finger"] {
        let begin = format!("contact of {finger} and satellite begins");
        let first = events.iter().find(|event| event["what"] == begin.as_str());
        let time = number(&first.unwrap_or_else(|| panic!("{begin}: {events:?}"))["time"]);
        // It closes from 1 s on, by 45 mm at 50 mm/s; the bar is a few millimetres off the middle by then.
        assert!(time > 1.5 && time < 4.0, "{begin}: {time}");
    }
    let last = &run["final"];
    assert!((number(&last["q"]["left_finger_joint"]) - 0.045).abs() < 1e-3);
    assert!(number(&last["qd"]["left_finger_joint"]).abs() < 1e-6);
    // 100 N of each finger at two points: k = 1e6 N/m stores (50 N)^2 / 2k at each, or more if the bar is not parallel.
    assert_eq!(last["contact"]["points"], 4);
    let stored = number(&last["contact"]["stored_energy"]);
    assert!(stored > 0.005 - 1e-6 && stored < 0.0055, "{stored}");
    for (part, limit) in [("linear", 1e-9), ("angular", 1e-8)] {
        let momentum = |run: &Value| vector(&run["final"]["momentum"][part]);
        let change = (momentum(&run) - momentum(&start)).norm();
        assert!(change < limit, "{part}: {change}");
    }
    let check = fuyu(&["bag", "check", bag, "--json"]).json();
    let energy = (check["checks"].as_array().expect("a list").iter())
        .find(|line| line.to_string().contains("energy balance"));
    let energy = energy.expect("a balance").to_string();
    assert!(energy.contains("passed"), "{energy}");
}

#[test]
fn wrong_grippers_are_refused() {
    let good = std::fs::read_to_string(CONFIG).unwrap();
    let folder = tempfile::tempdir().unwrap();
    for (from, to, says) in [
        (
            "joint: left_finger_joint",
            "joint: thumb",
            "parameter hand.joint: the robot has no joint 'thumb' that moves on its own; it has joint1,",
        ),
        (
            "joint: left_finger_joint",
            "joint: right_finger_joint",
            "no joint 'right_finger_joint' that moves on its own",
        ),
        (
            "grippers: [hand]",
            "grippers: [hand, hand]",
            "parameter grippers: 'hand' is given twice",
        ),
        (
            "grippers: [hand]",
            "grippers: [hand, other]\n    other:\n      joint: left_finger_joint",
            "parameter other.joint: 'left_finger_joint' is the joint of gripper 'hand' already",
        ),
        (
            "max_effort: 200.0",
            "max_effort: -1.0",
            "hand.max_effort of /dynamics: -1 is out of range",
        ),
        (
            "max_effort: 200.0",
            "max_efort: 200.0",
            "did you mean hand.max_effort?",
        ),
    ] {
        assert!(good.contains(from), "{from}");
        let path = folder.path().join("wrong.yaml");
        std::fs::write(&path, good.replacen(from, to, 1)).unwrap();
        let run = fuyu(&["simulate", path.to_str().unwrap()]);
        let message = run.refusal();
        assert!(message.contains(says), "{says}: {message}");
    }
}
