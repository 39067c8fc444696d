//! Each kind of repair on a small description, and that strict mode refuses it.

use super::*;
use nalgebra::Matrix3;

/// A base of 10 kg, and an arm of 2 kg behind a hinge.
const BASE: &str = "<link name=\"base\">MASS10</link>";
const ARM: &str = "<link name=\"arm\">MASS2</link>";
const TIP: &str = "<link name=\"tip\">MASS2</link>";

fn text(inside: &str) -> String {
    let mass = |value: &str| {
        format!(
            "<inertial><mass value=\"{value}\"/><inertia ixx=\"1\" ixy=\"0\" ixz=\"0\" iyy=\"1\" iyz=\"0\" izz=\"1\"/></inertial>"
        )
    };
    let inside = inside.replace("MASS10", &mass("10"));
    let inside = inside
        .replace("MASS2", &mass("2"))
        .replace("MASS0", &mass("0"));
    format!("<robot name=\"r\">\n{inside}\n</robot>")
}

fn joint(name: &str, kind: &str, parent: &str, child: &str, rest: &str) -> String {
    format!(
        "<joint name=\"{name}\" type=\"{kind}\"><parent link=\"{parent}\"/><child link=\"{child}\"/>{rest}</joint>"
    )
}

fn hinge(rest: &str) -> String {
    joint("hinge", "continuous", "base", "arm", rest)
}

/// What is repaired in a description that strict mode refuses.
#[track_caller]
fn repaired(inside: &str) -> Repaired {
    let strict = Model::from_urdf(&text(inside), "robot.urdf");
    assert!(strict.is_err(), "strict mode accepts it");
    Model::repaired_from_urdf(&text(inside), "robot.urdf").unwrap()
}

/// The only kind of repair, and its warning.
#[track_caller]
fn repair(inside: &str) -> (Repaired, String) {
    let repaired = repaired(inside);
    let warnings = repaired.warnings();
    assert_eq!(warnings.len(), 1, "{warnings:?}");
    (repaired, warnings[0].clone())
}

#[track_caller]
fn refusal(inside: &str) -> String {
    let error = Model::repaired_from_urdf(&text(inside), "robot.urdf").unwrap_err();
    error.to_string()
}

#[test]
fn valid_descriptions_are_not_touched() {
    for (name, xml) in [
        (
            "servicer",
            include_str!("../../../../../urdf/servicer.urdf"),
        ),
        (
            "dual_arm",
            include_str!("../../../../../urdf/dual_arm.urdf"),
        ),
        ("target", include_str!("../../../../../urdf/target.urdf")),
        (
            "chain",
            include_str!("../../../../../urdf/tr942_chain.urdf"),
        ),
    ] {
        let repaired = Model::repaired_from_urdf(xml, name).unwrap();
        assert_eq!(repaired.model, Model::from_urdf(xml, name).unwrap());
        assert_eq!(repaired.repairs, [], "{name}");
    }
}

#[test]
fn links_without_mass_add_frames_only() {
    let (found, warning) = repair(
        &[
            BASE,
            ARM,
            "<link name=\"tool\">MASS0</link>",
            &hinge(""),
            &joint("flange", "fixed", "arm", "tool", "<origin xyz=\"1 2 3\"/>"),
        ]
        .concat(),
    );
    assert_eq!(found.model.bodies()[1].inertia.mass, 2.0);
    let tool = found.model.frame("tool").unwrap();
    assert_eq!((tool.body, tool.X_BF.translation.vector.x), (1, 1.0));
    assert!(
        warning.contains("no mass") && warning.contains("tool (1.7e0 kg m² dropped)"),
        "{warning}"
    );
    let dropped = 3.0_f64.sqrt();
    assert_eq!(found.repairs[0].kind, RepairKind::NoMass { dropped });
}

#[test]
fn impossible_inertias_become_the_nearest_valid_ones() {
    let bad = ARM.replace(
        "MASS2",
        "<inertial><mass value=\"2\"/><inertia ixx=\"1\" ixy=\"0\" ixz=\"0\" iyy=\"2\" iyz=\"0\" izz=\"4\"/></inertial>",
    );
    let (found, warning) = repair(&[BASE, &bad, &hinge("")].concat());
    let expected = Vector3::new(4.0, 7.0, 11.0) / 3.0;
    let about_com = found.model.bodies()[1].inertia.about_com;
    assert!((about_com - Matrix3::from_diagonal(&expected)).norm() < 1e-12);
    assert!(
        warning.contains("arm (by 5.8e-1 kg m², 12.6 %)"),
        "{warning}"
    );
    let RepairKind::Inertia {
        problem, distance, ..
    } = &found.repairs[0].kind
    else {
        panic!("{:?}", found.repairs);
    };
    assert!(matches!(problem, InertiaError::Triangle(..)));
    assert!((distance - 1.0 / 3.0_f64.sqrt()).abs() < 1e-12);
    // Without a tensor the link is a point, which gets the size of a dense sphere.
    let point = "<inertial><mass value=\"2\"/></inertial>";
    let (found, _) = repair(&[BASE, &ARM.replace("MASS2", point), &hinge("")].concat());
    let moment = found.model.bodies()[1].inertia.about_com[(0, 0)];
    assert!((moment - 6.63e-4).abs() < 1e-6, "{moment}");
}

#[test]
fn masses_and_inertias_with_nothing_to_keep_are_refused() {
    let with =
        |inertial: &str| refusal(&[BASE, &ARM.replace("MASS2", inertial), &hinge("")].concat());
    let tensor = "<inertia ixx=\"-1\" ixy=\"0\" ixz=\"0\" iyy=\"-1\" iyz=\"0\" izz=\"-1\"/>";
    let error = with(&format!("<inertial><mass value=\"2\"/>{tensor}</inertial>"));
    assert!(
        error.contains("link 'arm': inertia is not positive definite"),
        "{error}"
    );
    let error = with(&format!(
        "<inertial><mass value=\"-2\"/>{tensor}</inertial>"
    ));
    assert!(error.contains("mass is -2 kg"), "{error}");
    // A slip of the keyboard must not lose the mass.
    let error = with("<Inertial><mass value=\"2\"/></Inertial>");
    assert!(error.contains("<link> cannot hold <Inertial>"), "{error}");
}

#[test]
fn joints_that_move_no_mass_are_held() {
    let empty = "<link name=\"wheel\"/>";
    let wheel = joint(
        "axle",
        "revolute",
        "arm",
        "wheel",
        "<axis xyz=\"0 0 1\"/><limit lower=\"0.5\" upper=\"1\" effort=\"1\" velocity=\"1\"/>",
    );
    let (found, warning) = repair(&[BASE, ARM, empty, &hinge(""), &wheel].concat());
    assert_eq!(found.model.dof(), 1);
    assert!(warning.contains("move no mass, held: axle"), "{warning}");
    // It is held at the position nearest to zero.
    let wheel = found.model.frame("wheel").unwrap();
    assert!((wheel.X_BF.rotation.angle() - 0.5).abs() < 1e-15);
}

#[test]
fn a_root_without_mass_is_the_floating_base() {
    let (cart, pole) = (
        "<link name=\"cart\">MASS2</link>",
        "<link name=\"pole\">MASS2</link>",
    );
    for kind in ["prismatic", "floating", "planar"] {
        let limit = "<limit effort=\"1\" velocity=\"1\" lower=\"-1\" upper=\"1\"/>";
        let (found, warning) = repair(
            &[
                "<link name=\"world\"/>",
                cart,
                pole,
                &joint("rail", kind, "world", "cart", limit),
                &joint("pivot", "continuous", "cart", "pole", ""),
            ]
            .concat(),
        );
        assert_eq!(
            (found.model.dof(), found.model.joints()[0].name.as_str()),
            (1, "pivot")
        );
        assert_eq!(found.model.bodies()[0].inertia.mass, 2.0);
        assert!(warning.contains("floating base: rail"), "{warning}");
    }
    let both = [
        "<link name=\"world\"/>",
        cart,
        pole,
        &joint("a", "continuous", "world", "cart", ""),
        &joint("b", "continuous", "world", "pole", ""),
    ];
    let error = refusal(&both.concat());
    assert!(
        error.contains("several joints move on it (a, b)"),
        "{error}"
    );
    let error = refusal("<link name=\"nothing\"/>");
    assert!(error.contains("no link has mass"), "{error}");
}

#[test]
fn joints_with_several_degrees_of_freedom_are_refused_elsewhere() {
    for kind in ["floating", "planar", "spherical"] {
        let error = refusal(&[BASE, ARM, &joint("hinge", kind, "base", "arm", "")].concat());
        let expected = format!(
            "joint 'hinge': type=\"{kind}\" is not supported: it has several degrees of freedom"
        );
        assert!(error.contains(&expected), "{error}");
    }
}

#[test]
fn bodies_without_mass_between_joints_are_kept() {
    let cross = "<link name=\"cross\"/>";
    let second = |axis: &str, at: &str| {
        joint(
            "second",
            "continuous",
            "cross",
            "arm",
            &format!("<axis xyz=\"{axis}\"/><origin xyz=\"{at}\"/>"),
        )
    };
    let first = joint(
        "first",
        "continuous",
        "base",
        "cross",
        "<axis xyz=\"0 0 1\"/>",
    );
    let with = |axis: &str, at: &str| [BASE, cross, ARM, &first, &second(axis, at)].concat();
    let (found, warning) = repair(&with("1 0 0", "0 0 0"));
    assert_eq!(
        (found.model.dof(), found.model.bodies()[1].inertia.mass),
        (2, 0.0)
    );
    assert!(
        warning.contains("without mass, with others on it: first"),
        "{warning}"
    );
    // Parallel axes at a distance move different masses; the same axis twice does not.
    repair(&with("0 0 1", "0.5 0 0"));
    let error = refusal(&with("0 0 -1", "0 0 0.7"));
    assert!(
        error.contains("joint 'first'") && error.contains("same axis as joint 'second'"),
        "{error}"
    );
}

#[test]
fn limits_that_are_missing_reversed_or_empty() {
    let with = |kind: &str, limit: &str| {
        repaired(&[BASE, ARM, &joint("hinge", kind, "base", "arm", limit)].concat())
    };
    let none = with("revolute", "");
    assert_eq!(none.model.joints()[0].limits, JointLimits::NONE);
    assert_eq!(none.repairs[0].kind, RepairKind::NoRange);
    let part = with("revolute", "<limit lower=\"-1\" upper=\"2\" effort=\"3\"/>");
    let limits = part.model.joints()[0].limits;
    assert_eq!(
        (limits.lower, limits.upper, limits.effort),
        (-1.0, 2.0, 3.0)
    );
    assert!(limits.velocity.is_infinite());
    assert_eq!(part.repairs[0].kind, RepairKind::NoLimit);
    let reversed = with(
        "prismatic",
        "<limit lower=\"0\" upper=\"-1\" effort=\"3\" velocity=\"1\"/>",
    );
    assert!(reversed.model.joints()[0].limits.upper.is_infinite());
    assert_eq!(reversed.repairs[0].kind, RepairKind::EmptyRange);
    // A range of one position is a lock: strict mode keeps the joint, with its limits.
    let locked = text(&[BASE, ARM, &joint("hinge", "prismatic", "base", "arm",
        "<axis xyz=\"1 0 0\"/><limit lower=\"0.3\" upper=\"0.3\" effort=\"3\" velocity=\"1\"/>")].concat());
    let held = Model::repaired_from_urdf(&locked, "robot.urdf").unwrap();
    assert_eq!(
        (held.model.dof(), &held.repairs[0].kind),
        (0, &RepairKind::Immobile)
    );
    assert_eq!(held.model.frame("arm").unwrap().X_BF.translation.x, 0.3);
    assert_eq!(Model::from_urdf(&locked, "robot.urdf").unwrap().dof(), 1);
    // Exporters write zeros if they know no limits.
    let zeros = "<limit lower=\"0\" upper=\"0\" effort=\"0\" velocity=\"0\"/>";
    let zeros = text(&[BASE, ARM, &joint("hinge", "revolute", "base", "arm", zeros)].concat());
    let free = Model::repaired_from_urdf(&zeros, "robot.urdf").unwrap();
    assert_eq!(free.model.joints()[0].limits, JointLimits::NONE);
    assert_eq!(free.repairs[0].kind, RepairKind::EmptyRange);
    let strict = Model::from_urdf(&zeros, "robot.urdf").unwrap();
    assert_eq!(strict.joints()[0].limits.effort, 0.0);
    // Negative ones stay errors.
    let negative = hinge("<limit effort=\"-1\" velocity=\"1\"/>");
    let error = refusal(&[BASE, ARM, &negative].concat());
    assert!(error.contains("effort=\"-1\" is negative"), "{error}");
}

#[test]
fn axes_are_normalised_but_need_a_direction() {
    let (found, warning) = repair(&[BASE, ARM, &hinge("<axis xyz=\"0 3 4\"/>")].concat());
    assert!((*found.model.joints()[0].axis - Vector3::new(0.0, 0.6, 0.8)).norm() < 1e-15);
    assert!(warning.contains("hinge (length 5.000000)"), "{warning}");
    let error = refusal(&[BASE, ARM, &hinge("<axis xyz=\"0 0 0\"/>")].concat());
    assert!(error.contains("has no direction"), "{error}");
}

#[test]
fn what_is_unknown_is_named_once() {
    let properties = "<joint_properties damping=\"1\"/><joint_properties/>";
    let found = repaired(
        &[
            BASE,
            ARM,
            TIP,
            &hinge(properties),
            &joint(
                "wrist",
                "continuous",
                "arm",
                "tip",
                "<joint_properties/><limit effort=\"1\" velocity=\"1\" stiffness=\"3\"/>",
            ),
        ]
        .concat(),
    );
    let warnings = found.warnings();
    assert_eq!(
        warnings,
        [
            "robot.urdf:2: unknown elements and attributes, ignored: <joint_properties> in <joint> (3 times), stiffness of <limit>"
        ]
    );
    // These are known, and no reason for a warning.
    let known = [
        BASE,
        ARM,
        &hinge(""),
        "<transmission name=\"t\"/><gazebo/><material name=\"m\"/>",
    ];
    assert_eq!(
        Model::repaired_from_urdf(&text(&known.concat()), "r")
            .unwrap()
            .repairs,
        []
    );
}

#[test]
fn shapes_repeated_elements_products_numbers_and_surroundings() {
    let mesh = "<visual><geometry><mesh/></geometry></visual><collision/>";
    let (_, warning) = repair(
        &[
            BASE,
            ARM,
            &format!("<link name=\"cam\">{mesh}</link>"),
            &hinge(""),
            &joint("f", "fixed", "arm", "cam", ""),
        ]
        .concat(),
    );
    assert!(
        warning.contains("without a known geometry, ignored: cam (2 times)"),
        "{warning}"
    );
    let (found, warning) = repair(
        &[
            BASE,
            ARM,
            &hinge("<axis xyz=\"0 0 1\"/><axis xyz=\"0 1 0\"/>"),
        ]
        .concat(),
    );
    assert_eq!(found.model.joints()[0].axis, Vector3::z_axis());
    assert!(warning.contains("hinge (<axis>)"), "{warning}");
    let products = BASE.replace(
        "MASS10",
        "<inertial><mass value=\"9\"/><inertia ixx=\"1\" iyy=\"1\" izz=\"1\"/></inertial>",
    );
    assert_eq!(repair(&products).0.repairs.len(), 3);
    let (found, warning) =
        repair(&[BASE, ARM, &hinge("<origin xyz=\"0.07, 0, -0.69\"/>")].concat());
    assert_eq!(
        found.model.joints()[0].X_PJ.translation.vector,
        Vector3::new(0.07, 0.0, -0.69)
    );
    assert!(
        warning.contains("<origin> xyz=\"0.07, 0, -0.69\""),
        "{warning}"
    );
    let more = hinge("<origin xyz=\"1 2 3 4\" rpy=\"0 0. 0\"/>");
    let (found, _) = repair(&[BASE, ARM, &more].concat());
    let placed = found.model.joints()[0].X_PJ.translation.vector;
    assert_eq!(placed, Vector3::new(1.0, 2.0, 3.0));
    let limit = |lower: &str| {
        let limit = format!("<limit lower=\"{lower}\" upper=\"1\" effort=\"1\" velocity=\"1\"/>");
        [
            BASE,
            ARM,
            &joint("hinge", "revolute", "base", "arm", &limit),
        ]
        .concat()
    };
    let (found, _) = repair(&limit("-1.57."));
    assert_eq!(found.model.joints()[0].limits.lower, -1.57);
    for lower in ["-1,57", "-1.57 rad", "1 2", "."] {
        let error = refusal(&limit(lower));
        assert!(error.contains("a finite number"), "{error}");
    }
    assert!(
        refusal(&[BASE, ARM, &hinge("<origin xyz=\"0 0\"/>")].concat())
            .contains("three finite numbers")
    );
    assert!(refusal(&[BASE, ARM, &hinge("<origin xyz=\"0 0 ${h}\"/>")].concat()).contains("xacro"));
    let (_, warning) = repair(&[BASE, "<link name=\"lost\"/>"].concat());
    assert!(
        warning.contains("no joint connects, ignored: lost"),
        "{warning}"
    );
    let (_, warning) = repair(
        &[
            BASE,
            ARM,
            &hinge(""),
            "<gazebo reference=\"none\"><springStiffness>1</springStiffness></gazebo>",
        ]
        .concat(),
    );
    assert!(warning.contains("springs"), "{warning}");
    let surrounded = format!("\n\n<?xml version=\"1.0\"?>\n{}\r\n\0", text(BASE));
    let found = Model::repaired_from_urdf(&surrounded, "robot.urdf").unwrap();
    assert_eq!(found.model.total_mass(), 10.0);
    assert!(Model::from_urdf(&surrounded, "robot.urdf").is_err());
    let late = format!("\n\n<?xml version=\"1.0\"?>\n{}", text("<link/>"));
    let error = Model::repaired_from_urdf(&late, "robot.urdf").unwrap_err();
    assert_eq!(error.line, Some(5));
}

#[test]
fn other_formats_are_named() {
    for (xml, says) in [
        ("<sdf version=\"1.9\"/>", "SDF"),
        ("<mujoco model=\"arm\"/>", "MJCF"),
        (
            "<robot name=\"r\" xmlns:xacro=\"http://www.ros.org/wiki/xacro\"><xacro:include filename=\"x\"/></robot>",
            "pip install xacro",
        ),
    ] {
        let error = Model::repaired_from_urdf(xml, "robot")
            .unwrap_err()
            .to_string();
        assert!(error.contains(says), "{error}");
    }
}

#[test]
fn mimic_joints_are_couplings_also_in_strict_mode() {
    let finger = |name: &str| format!("<link name=\"{name}\">MASS2</link>");
    let slide = |name: &str, rest: &str| {
        joint(
            &format!("slide_{name}"),
            "prismatic",
            "base",
            name,
            &format!("<limit lower=\"0\" upper=\"0.1\" effort=\"9\" velocity=\"1\"/>{rest}"),
        )
    };
    // The leader comes last in the document; c follows b, which follows a.
    let chain = [
        BASE,
        &finger("c"),
        &finger("b"),
        &finger("a"),
        &slide(
            "c",
            "<mimic joint=\"slide_b\" multiplier=\"0.5\" offset=\"0.01\"/>",
        ),
        &slide("b", "<mimic joint=\"slide_a\"/>"),
        &slide("a", ""),
    ];
    let strict = Model::from_urdf(&text(&chain.concat()), "robot.urdf").unwrap();
    assert_eq!((strict.dof(), strict.bodies().len()), (1, 4));
    assert_eq!(strict.joint_index("slide_a"), Some(0));
    let couplings: Vec<_> = strict
        .mimics()
        .map(|m| (m.joint.name.as_str(), m.coupling.ratio, m.coupling.offset))
        .collect();
    assert_eq!(couplings, [("slide_c", 0.5, 0.01), ("slide_b", 1.0, 0.0)]);
    let lenient = Model::repaired_from_urdf(&text(&chain.concat()), "robot.urdf").unwrap();
    assert_eq!((lenient.model, lenient.repairs), (strict, vec![]));

    let pair = |a: &str, b: &str| {
        [
            BASE,
            &finger("a"),
            &finger("b"),
            &slide("a", a),
            &slide("b", b),
        ]
        .concat()
    };
    for (a, b, says) in [
        (
            "",
            "<mimic joint=\"slide_x\"/>",
            "<mimic joint=\"slide_x\"> is not a joint; the joints are slide_a, slide_b",
        ),
        (
            "<mimic joint=\"slide_b\"/>",
            "<mimic joint=\"slide_a\"/>",
            "follow each other: slide_a -> slide_b -> slide_a",
        ),
        (
            "<mimic joint=\"slide_a\"/>",
            "",
            "follow each other: slide_a -> slide_a",
        ),
        ("", "<mimic/>", "<mimic> has no attribute 'joint'"),
        (
            "",
            "<mimic joint=\"slide_a\" multiplier=\"x\"/>",
            "multiplier=\"x\"",
        ),
    ] {
        let error = refusal(&pair(a, b));
        assert!(error.contains(says), "{error}");
        assert!(Model::from_urdf(&text(&pair(a, b)), "r").is_err());
    }
    // Never within its own range while the leader is: 0 to 0.1 becomes 1 to 1.1.
    let (found, warning) = repair(&pair("", "<mimic joint=\"slide_a\" offset=\"1\"/>"));
    assert_eq!(found.model.joints()[0].limits.upper, 0.1);
    assert!(warning.contains("exclude every position"), "{warning}");
}

#[test]
fn followers_of_fixed_joints_do_not_move() {
    let inside = [
        BASE,
        ARM,
        TIP,
        &joint("hinge", "fixed", "base", "arm", ""),
        &joint(
            "wrist",
            "continuous",
            "base",
            "tip",
            "<axis xyz=\"0 0 1\"/><mimic joint=\"hinge\" offset=\"0.7\"/>",
        ),
    ];
    let model = Model::from_urdf(&text(&inside.concat()), "r").unwrap();
    assert_eq!(model.dof(), 0);
    assert!((model.frame("tip").unwrap().X_BF.rotation.angle() - 0.7).abs() < 1e-15);
}
