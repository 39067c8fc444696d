//! Broken robot descriptions: in strict mode each is refused in one line that names the file, the line, the element and
//! the value. Every case changes one thing in a valid description, so that no other check can cause the error.

mod structure;
mod values;

use super::fuyu::{file, fuyu};

/// A base, two moving links and a fixed frame.
const GOOD: &str = r#"<?xml version="1.0"?>
<robot name="arm">
  <link name="base_link">
    <inertial>
      <origin xyz="0 0 0.1" rpy="0 0 0.5"/>
      <mass value="100"/>
      <inertia ixx="10" ixy="0.1" ixz="0" iyy="9" iyz="0" izz="8"/>
    </inertial>
  </link>
  <joint name="shoulder" type="revolute">
    <parent link="base_link"/>
    <child link="upper"/>
    <origin xyz="0 0 1" rpy="0 0.5 0"/>
    <axis xyz="0 0 1"/>
    <limit lower="-1" upper="2" effort="30" velocity="4"/>
    <dynamics damping="0.5" friction="0.1"/>
  </joint>
  <link name="upper">
    <inertial>
      <mass value="5"/>
      <inertia ixx="1" ixy="0" ixz="0" iyy="0.8" iyz="0" izz="0.6"/>
    </inertial>
  </link>
  <joint name="boom" type="prismatic">
    <parent link="upper"/>
    <child link="lower"/>
    <axis xyz="1 0 0"/>
    <limit lower="0" upper="1" effort="30" velocity="4"/>
  </joint>
  <link name="lower">
    <inertial>
      <mass value="3"/>
      <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.2" iyz="0" izz="0.3"/>
    </inertial>
  </link>
  <joint name="flange" type="fixed">
    <parent link="lower"/>
    <child link="tool0"/>
  </joint>
  <link name="tool0"/>
</robot>
"#;

/// The place of what was put in.
const HERE: &str = "";
const BASE: &str = "<link name=\"base_link\">";
const SHOULDER: &str = "<joint name=\"shoulder\"";
const UPPER: &str = "<link name=\"upper\">";
const BOOM: &str = "<joint name=\"boom\"";
const FLANGE: &str = "<joint name=\"flange\"";

/// `GOOD` with the first `from` replaced by `to` must be refused with a message that starts with
/// `robot.urdf:` and the line that holds `at`, and says all of `says`.
#[track_caller]
fn refused(from: &str, to: &str, at: &str, says: &[&str]) {
    assert!(GOOD.contains(from), "the good robot has no {from}");
    let bad = GOOD.replacen(from, to, 1);
    let at = match at {
        HERE => GOOD.find(from),
        _ => bad.find(at),
    };
    let at = at.expect("the place is in the bad robot") + 1;
    let line = bad[..at].lines().count().max(1);
    let (_folder, path) = file("robot.urdf", bad);
    let run = fuyu(&["inspect".as_ref(), path.as_os_str(), "--strict".as_ref()]);
    let message = run.refusal();
    let place = format!("robot.urdf:{line}: ");
    assert!(message.contains(&place), "no {place:?} in: {message}");
    for part in says {
        assert!(message.contains(part), "no {part:?} in: {message}");
    }
}

#[test]
fn the_good_robot_is_accepted() {
    let (_folder, path) = file("robot.urdf", GOOD);
    let run = fuyu(&["inspect".as_ref(), path.as_os_str(), "--json".as_ref()]);
    assert_eq!(
        run.json()["joints"],
        serde_json::json!(["shoulder", "boom"])
    );
}
