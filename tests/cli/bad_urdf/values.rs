//! Masses, inertias, axes, frames and limits that are physically impossible.

use super::{BASE, GOOD, HERE, SHOULDER, UPPER, refused};

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
        &["link 'upper'", "not positive definite", "-8.0000e-1"],
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
fn numbers_of_frames() {
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
fn springs() {
    let block = |joint: &str, inside: &str| {
        format!("<link name=\"tool0\"/>\n<gazebo reference=\"{joint}\">{inside}</gazebo>")
    };
    let stiffness = |value: &str| format!("<springStiffness>{value}</springStiffness>");
    let spoil = |with: &str, at: &str, says: &[&str]| {
        refused("<link name=\"tool0\"/>", with, at, says);
    };
    let at = "<gazebo";
    spoil(
        &block("elbow", &stiffness("3")),
        at,
        &["reference=\"elbow\"", "no joint", "boom, flange, shoulder"],
    );
    spoil(&block("", &stiffness("3")), at, &["no joint"]);
    // Links may be referenced too, but have no springs.
    spoil(&block("lower", &stiffness("3")), at, &["no joint"]);
    spoil(
        &block("flange", &stiffness("3")),
        at,
        &["joint 'flange'", "a fixed joint cannot have a spring"],
    );
    for (bad, wanted) in [
        ("-3", "zero or positive"),
        ("NaN", "a finite number"),
        ("1e999", "a finite number"),
        ("3 N/m", "a finite number"),
        ("", "a finite number"),
    ] {
        let says = format!("<springStiffness>{bad}</springStiffness> must be {wanted}");
        spoil(
            &block("shoulder", &stiffness(bad)),
            at,
            &["joint 'shoulder'", &says],
        );
    }
    spoil(
        &block("shoulder", "<springReference>0.1</springReference>"),
        at,
        &["joint 'shoulder'", "no <springStiffness>"],
    );
    spoil(
        &block("shoulder", &(stiffness("3") + &stiffness("4"))),
        at,
        &["joint 'shoulder'", "more than one <springStiffness>"],
    );
    let twice = block("boom", &stiffness("3"))
        + "<gazebo reference=\"boom\">\n<springStiffness>4</springStiffness></gazebo>";
    spoil(
        &twice,
        "<springStiffness>4",
        &["joint 'boom'", "more than one <springStiffness>"],
    );
}
