//! Files that are not XML, not URDF or not a tree.

use super::{BASE, BOOM, FLANGE, HERE, SHOULDER, UPPER, refused};
use crate::fuyu::{file, fuyu};

#[test]
fn not_a_urdf() {
    for (text, says) in [
        ("", "not well-formed XML"),
        ("joint_states", "not well-formed XML"),
        (
            "<sdf><model/></sdf>",
            "the document is SDF; convert it to URDF first",
        ),
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
            .contains("urdf: is a folder; give a regular file")
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
        &["link 'base_link'", "${mass}", "expand the file first"],
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
        "<mimic joint=\"sholder\"/>",
        HERE,
        &[
            "joint 'boom'",
            "<mimic joint=\"sholder\"> is not a joint; the joints are shoulder, boom, flange",
        ],
    );
}

#[test]
fn shapes_that_urdf_does_not_have() {
    let visual =
        "<link name=\"tool0\"><visual><geometry><teapot size=\"1\"/></geometry></visual></link>";
    refused(
        "<link name=\"tool0\"/>",
        visual,
        HERE,
        &["link 'tool0'", "has no <geometry> with a <box>"],
    );
}
