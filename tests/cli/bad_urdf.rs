//! Broken robot descriptions: each is refused in one line that names the file, the line, the element and
//! the value. Every case spoils one thing in a robot that is accepted, so that no other check can answer.

use super::fuyu::{file, fuyu};

/// Six links, one of them a fixed frame; line numbers matter below.
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
    let run = fuyu(&["inspect".as_ref(), path.as_os_str()]);
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

#[test]
fn not_a_urdf() {
    for (text, says) in [
        ("", "not well-formed XML"),
        ("joint_states", "not well-formed XML"),
        ("<sdf><model/></sdf>", "root element is <sdf>"),
        ("<robot name=\"r\"/>", "no <link>"),
        (
            "<robot name=\"r\"><joint/></robot>",
            "<joint> has no attribute 'name'",
        ),
    ] {
        let (_folder, path) = file("robot.urdf", text);
        let run = fuyu(&["inspect".as_ref(), path.as_os_str()]);
        let message = run.refusal();
        assert!(
            message.contains("robot.urdf:1: ") && message.contains(says),
            "{message}"
        );
    }
    let (_folder, path) = file("robot.urdf", [0x66, 0xff, 0xfe]);
    let run = fuyu(&["inspect".as_ref(), path.as_os_str()]);
    assert!(run.refusal().contains("byte 1 is not UTF-8"));
    assert!(
        fuyu(&["inspect", "urdf/no_such.urdf"])
            .refusal()
            .contains("urdf/no_such.urdf")
    );
    assert!(
        fuyu(&["inspect", "urdf"])
            .refusal()
            .contains("urdf: cannot be read")
    );
}

#[test]
fn malformed_xml_names_line_and_column() {
    refused(
        "</link>\n  <joint name=\"shoulder\"",
        "</lin>\n  <joint name=\"shoulder\"",
        "</lin>",
        &["not well-formed XML", "9:3"],
    );
    refused(
        "</robot>",
        "",
        "<?xml",
        &["not well-formed XML", "never closed"],
    );
}

#[test]
fn elements_without_end_do_not_overflow_the_stack() {
    let deep = "<a>".repeat(100_000) + &"</a>".repeat(100_000);
    refused(
        "<link name=\"tool0\"/>",
        &deep,
        "<robot",
        &["nested deeper than 64"],
    );
}

#[test]
fn xacro_that_nobody_expanded() {
    let with_macro =
        "<robot name=\"arm\" xmlns:xacro=\"http://www.ros.org/wiki/xacro\">\n<xacro:arm/>";
    refused(
        "<robot name=\"arm\">",
        with_macro,
        "<xacro:arm",
        &["xacro:arm", "expand the file first"],
    );
    refused(
        "value=\"100\"",
        "value=\"${mass}\"",
        HERE,
        &["link 'base_link'", "${mass}", "a finite number"],
    );
}

#[test]
fn trees_that_are_none() {
    refused(
        "<link name=\"tool0\"/>",
        "<link name=\"tool0\"/>\n<link name=\"stray\"/>",
        "<link name=\"stray\"",
        &["2 links have no parent", "base_link, stray"],
    );
}

#[test]
fn cycles() {
    let back = "<link name=\"tool0\"/><joint name=\"back\" type=\"fixed\"><parent link=\"tool0\"/><child link=\"base_link\"/></joint>";
    refused(
        "<link name=\"tool0\"/>",
        back,
        BASE,
        &["cycle", "base_link -> upper -> lower -> tool0 -> base_link"],
    );
    refused(
        "<parent link=\"base_link\"/>",
        "<parent link=\"tool0\"/>",
        UPPER,
        &["cycle", "upper -> lower -> tool0 -> upper"],
    );
    refused(
        "<child link=\"upper\"/>",
        "<child link=\"base_link\"/>",
        SHOULDER,
        &["joint 'shoulder'", "'base_link' to itself"],
    );
}

#[test]
fn two_parents() {
    refused(
        "<child link=\"tool0\"/>",
        "<child link=\"upper\"/>",
        FLANGE,
        &[
            "joint 'flange'",
            "link 'upper'",
            "already the child of joint 'shoulder'",
        ],
    );
}

#[test]
fn duplicate_and_missing_names() {
    refused(
        "<link name=\"lower\">",
        "<link name=\"upper\">",
        HERE,
        &["link 'upper'", "already taken on line 18"],
    );
    refused(
        "<joint name=\"boom\"",
        "<joint name=\"shoulder\"",
        HERE,
        &["joint 'shoulder'", "already taken on line 10"],
    );
    refused(
        "<link name=\"upper\">",
        "<link>",
        HERE,
        &["<link> has no attribute 'name'"],
    );
    refused(
        "<link name=\"upper\">",
        "<link name=\" \">",
        HERE,
        &["<link> has no attribute 'name'"],
    );
}

#[test]
fn joints_between_unknown_links() {
    refused(
        "<child link=\"upper\"/>",
        "<child link=\"uper\"/>",
        SHOULDER,
        &[
            "joint 'shoulder'",
            "child link 'uper' is not defined",
            "base_link, upper, lower, tool0",
        ],
    );
    refused(
        "<parent link=\"upper\"/>",
        "<parent link=\"Upper\"/>",
        BOOM,
        &["joint 'boom'", "parent link 'Upper'"],
    );
    refused(
        "<parent link=\"upper\"/>",
        "",
        BOOM,
        &["joint 'boom'", "has no <parent link"],
    );
    refused(
        "<child link=\"upper\"/>",
        "<child/>",
        HERE,
        &["joint 'shoulder'", "<child> has no attribute 'link'"],
    );
}

#[test]
fn joint_types() {
    refused(
        "type=\"revolute\"",
        "type=\"hinge\"",
        SHOULDER,
        &[
            "joint 'shoulder'",
            "\"hinge\" is unknown",
            "revolute, continuous, prismatic or fixed",
        ],
    );
    refused(
        "type=\"revolute\"",
        "",
        SHOULDER,
        &["joint 'shoulder'", "has no attribute 'type'"],
    );
    refused(
        "type=\"revolute\"",
        "type=\"floating\"",
        SHOULDER,
        &["joint 'shoulder'", "\"floating\" is not supported"],
    );
    refused(
        "type=\"revolute\"",
        "type=\"planar\"",
        SHOULDER,
        &["joint 'shoulder'", "\"planar\" is not supported"],
    );
    refused(
        "<axis xyz=\"1 0 0\"/>",
        "<mimic joint=\"shoulder\"/>",
        HERE,
        &[
            "joint 'boom'",
            "<mimic joint=\"shoulder\"> is not supported",
        ],
    );
}

#[test]
fn masses() {
    refused(
        "value=\"5\"",
        "value=\"-5\"",
        UPPER,
        &["link 'upper'", "mass is -5 kg", "must be positive"],
    );
    refused(
        "value=\"5\"",
        "value=\"0\"",
        UPPER,
        &["link 'upper'", "mass is 0 kg"],
    );
    refused(
        "value=\"5\"",
        "value=\"NaN\"",
        HERE,
        &["link 'upper'", "<mass> value=\"NaN\"", "a finite number"],
    );
    refused(
        "value=\"5\"",
        "value=\"1e999\"",
        HERE,
        &["link 'upper'", "<mass> value=\"1e999\""],
    );
    refused(
        "value=\"5\"",
        "value=\"5 kg\"",
        HERE,
        &["link 'upper'", "<mass> value=\"5 kg\""],
    );
    refused(
        "<mass value=\"5\"/>",
        "",
        "<inertial>\n      \n",
        &["link 'upper'", "<inertial> has no <mass value"],
    );
    refused(
        "<mass value=\"5\"/>",
        "<mass value=\"5\"/><mass value=\"6\"/>",
        HERE,
        &["link 'upper'", "more than one <mass>"],
    );
}

#[test]
fn a_moving_body_or_a_root_without_mass() {
    let upper = "\n    <inertial>\n      <mass value=\"5\"/>\n      <inertia ixx=\"1\" ixy=\"0\" ixz=\"0\" iyy=\"0.8\" iyz=\"0\" izz=\"0.6\"/>\n    </inertial>";
    refused(
        upper,
        "",
        UPPER,
        &["link 'upper'", "what joint 'shoulder' moves has no mass"],
    );
    let base = &GOOD[GOOD.find("<inertial>").unwrap()..GOOD.find("</link>").unwrap()];
    refused(
        base,
        "",
        BASE,
        &["link 'base_link'", "the root has no mass"],
    );
    // A slip of the keyboard must not lose the mass either.
    refused(
        upper,
        &upper.replace("inertial", "Inertial"),
        "<Inertial>",
        &["link 'upper'", "<Inertial>", "inertial"],
    );
}

#[test]
fn inertias() {
    refused(
        "iyy=\"0.8\"",
        "iyy=\"-0.8\"",
        UPPER,
        &["link 'upper'", "not positive definite", "-0.8"],
    );
    refused(
        "izz=\"0.6\"",
        "izz=\"0\"",
        UPPER,
        &["link 'upper'", "not positive definite"],
    );
    refused(
        "ixy=\"0\" ixz=\"0\" iyy=\"0.8\"",
        "ixy=\"0.95\" ixz=\"0\" iyy=\"0.8\"",
        UPPER,
        &["link 'upper'", "not positive definite"],
    );
    refused(
        "izz=\"0.6\"",
        "izz=\"1.9\"",
        UPPER,
        &["link 'upper'", "triangle inequality", "1.9"],
    );
    refused(
        "izz=\"0.6\"",
        "izz=\"inf\"",
        HERE,
        &["link 'upper'", "<inertia> izz=\"inf\""],
    );
    refused(
        "ixx=\"1\" ixy",
        "ixx=\"1,0\" ixy",
        HERE,
        &["link 'upper'", "<inertia> ixx=\"1,0\""],
    );
    refused(
        " izz=\"0.6\"",
        "",
        HERE,
        &["link 'upper'", "<inertia> has no attribute 'izz'"],
    );
}

#[test]
fn axes() {
    refused(
        "<axis xyz=\"0 0 1\"/>",
        "<axis xyz=\"0 0 0\"/>",
        SHOULDER,
        &["joint 'shoulder'", "<axis> xyz=\"0 0 0\" has no direction"],
    );
    refused(
        "<axis xyz=\"0 0 1\"/>",
        "<axis xyz=\"0 3 4\"/>",
        SHOULDER,
        &[
            "joint 'shoulder'",
            "<axis> xyz=\"0 3 4\" has length 5",
            "xyz=\"0 0.6 0.8\"",
        ],
    );
    refused(
        "<axis xyz=\"0 0 1\"/>",
        "<axis xyz=\"0 1\"/>",
        HERE,
        &[
            "joint 'shoulder'",
            "<axis> xyz=\"0 1\"",
            "three finite numbers",
        ],
    );
    refused(
        "<axis xyz=\"0 0 1\"/>",
        "<axis xyz=\"0 nan 1\"/>",
        HERE,
        &["joint 'shoulder'", "<axis> xyz=\"0 nan 1\""],
    );
    refused(
        "<axis xyz=\"0 0 1\"/>",
        "<axis/>",
        HERE,
        &["joint 'shoulder'", "<axis> has no attribute 'xyz'"],
    );
}

#[test]
fn numbers_that_urdf_rs_would_drop_in_silence() {
    // It keeps the words that are numbers and counts those.
    refused(
        "xyz=\"0 0 1\" rpy",
        "xyz=\"0 O 0 1\" rpy",
        HERE,
        &[
            "joint 'shoulder'",
            "<origin> xyz=\"0 O 0 1\"",
            "three finite numbers",
        ],
    );
    refused(
        "rpy=\"0 0.5 0\"",
        "rpy=\"0 0.5 inf\"",
        HERE,
        &["joint 'shoulder'", "<origin> rpy=\"0 0.5 inf\""],
    );
    refused(
        "rpy=\"0 0.5 0\"",
        "rgy=\"0 0.5 0\"",
        HERE,
        &[
            "joint 'shoulder'",
            "<origin> cannot hold attribute 'rgy'",
            "xyz, rpy",
        ],
    );
    refused(
        "rpy=\"0 0.5 0\"",
        "quat_xyzw=\"0 0 1 0\"",
        HERE,
        &[
            "joint 'shoulder'",
            "quat_xyzw=\"0 0 1 0\"",
            "version=\"1.1\"",
        ],
    );
    refused(
        "<origin xyz=\"0 0 1\"",
        "<orgin xyz=\"0 0 1\"",
        HERE,
        &["joint 'shoulder'", "<joint> cannot hold <orgin>"],
    );
}

#[test]
fn limits_and_damping() {
    refused(
        "lower=\"-1\" upper=\"2\"",
        "lower=\"2\" upper=\"-1\"",
        SHOULDER,
        &["joint 'shoulder'", "lower=\"2\" is above upper=\"-1\""],
    );
    refused(
        "effort=\"30\"",
        "effort=\"-30\"",
        SHOULDER,
        &["joint 'shoulder'", "<limit> effort=\"-30\" is negative"],
    );
    refused(
        "velocity=\"4\"",
        "velocity=\"fast\"",
        HERE,
        &["joint 'shoulder'", "<limit> velocity=\"fast\""],
    );
    refused(
        " effort=\"30\"",
        "",
        HERE,
        &["joint 'shoulder'", "<limit> has no attribute 'effort'"],
    );
    refused(
        "lower=\"-1\"",
        "Lower=\"-1\"",
        HERE,
        &["joint 'shoulder'", "<limit> cannot hold attribute 'Lower'"],
    );
    refused(
        "<limit lower=\"-1\" upper=\"2\" effort=\"30\" velocity=\"4\"/>",
        "",
        SHOULDER,
        &["joint 'shoulder'", "a revolute joint needs <limit"],
    );
    refused(
        "damping=\"0.5\"",
        "damping=\"-0.5\"",
        SHOULDER,
        &[
            "joint 'shoulder'",
            "<dynamics> damping=\"-0.5\" is negative",
        ],
    );
    refused(
        "friction=\"0.1\"",
        "friction=\"-inf\"",
        HERE,
        &["joint 'shoulder'", "<dynamics> friction=\"-inf\""],
    );
    refused(
        "damping=\"0.5\" friction=\"0.1\"",
        "dampening=\"0.5\"",
        HERE,
        &[
            "joint 'shoulder'",
            "<dynamics> cannot hold attribute 'dampening'",
        ],
    );
}

#[test]
fn what_only_urdf_rs_refuses_is_traced_to_its_element() {
    let visual =
        "<link name=\"tool0\"><visual><geometry><teapot size=\"1\"/></geometry></visual></link>";
    refused(
        "<link name=\"tool0\"/>",
        visual,
        HERE,
        &["link 'tool0'", "not a valid URDF", "teapot"],
    );
}
