use super::*;
use crate::spatial::SpatialInertia;
use nalgebra::{Matrix3, Vector3};

const BODY: &str = r#"<inertial><origin xyz="0.1 -0.2 0.3" rpy="0.3 -0.4 0.5"/><mass value="2"/>
    <inertia ixx="3" ixy="0.1" ixz="-0.2" iyy="2.5" iyz="0.3" izz="2"/></inertial>"#;

fn robot(inside: &str) -> String {
    let inside = inside.replace("BODY", BODY);
    format!("<robot name=\"r\">{inside}</robot>")
}

fn joint(name: &str, kind: &str, parent: &str, child: &str, rest: &str) -> String {
    format!(
        "<joint name=\"{name}\" type=\"{kind}\"><parent link=\"{parent}\"/><child link=\"{child}\"/>{rest}</joint>"
    )
}

fn compile(inside: &str) -> Model {
    Model::from_urdf(&robot(inside), "test").unwrap()
}

fn rejection(inside: &str) -> UrdfProblem {
    *Model::from_urdf(&robot(inside), "test")
        .unwrap_err()
        .problem
}

fn assert_same(a: &SpatialInertia, b: &SpatialInertia) {
    let difference = (a.mass - b.mass).abs()
        + (a.first_moment - b.first_moment).norm()
        + (a.about_origin.to_matrix() - b.about_origin.to_matrix()).norm();
    assert!(difference < 1e-13, "{a:?}\n{b:?}");
}

/// The inertia of `BODY` in its link, by definition: products of inertia are the tensor's entries.
fn body() -> RigidInertia {
    #[rustfmt::skip]
    let i = Matrix3::new(
        3.0, 0.1, -0.2,
        0.1, 2.5, 0.3,
        -0.2, 0.3, 2.0,
    );
    let axis = |axis, angle| Rotation3::from_axis_angle(&axis, angle).into_inner();
    let turn =
        axis(Vector3::z_axis(), 0.5) * axis(Vector3::y_axis(), -0.4) * axis(Vector3::x_axis(), 0.3);
    RigidInertia {
        mass: 2.0,
        com: Vector3::new(0.1, -0.2, 0.3),
        about_com: turn * i * turn.transpose(),
    }
}

#[test]
fn inertial_frames_turn_about_fixed_axes_and_products_keep_their_sign() {
    let model = compile("<link name=\"a\">BODY</link>");
    assert_same(&model.bodies()[0].spatial_inertia, &(&body()).into());
    assert_eq!((model.dof(), model.frames().len()), (0, 1));
}

#[test]
fn links_fixed_to_a_moving_link_are_welded_to_it() {
    let model = compile(
        &["<link name=\"a\">BODY</link><link name=\"b\">BODY</link><link name=\"c\"/><link name=\"d\">BODY</link>".to_owned(),
          joint("ab", "continuous", "a", "b", ""),
          joint("bc", "fixed", "b", "c", "<origin xyz=\"1 2 3\" rpy=\"0.2 0.7 -1\"/>"),
          joint("cd", "fixed", "c", "d", "<origin xyz=\"0.5 0 -1\" rpy=\"-1 0.4 2\"/>")].concat(),
    );
    assert_eq!(model.dof(), 1);
    let step = |x, y, z, roll, pitch, yaw| {
        Pose::from_parts(
            Translation3::new(x, y, z),
            Rotation3::from_euler_angles(roll, pitch, yaw),
        )
    };
    let X_BC = step(1.0, 2.0, 3.0, 0.2, 0.7, -1.0);
    let X_BD = X_BC * step(0.5, 0.0, -1.0, -1.0, 0.4, 2.0);
    let own = SpatialInertia::from(&body());
    let mut welded = own
        .rotated(X_BD.rotation.matrix())
        .shifted(&X_BD.translation.vector);
    welded += own;
    assert_same(&model.bodies()[1].spatial_inertia, &welded);
    let d = model.frame("d").unwrap();
    assert_eq!((d.body, d.parent.as_deref()), (1, Some("c")));
    assert!((d.X_BF.to_homogeneous() - X_BD.to_homogeneous()).norm() < 1e-15);
}

#[test]
fn a_root_without_inertia_takes_that_of_its_fixed_child() {
    let model = compile(
        &["<link name=\"footprint\"/><link name=\"hull\">BODY</link><link name=\"arm\">BODY</link>".to_owned(),
          joint("f", "fixed", "footprint", "hull", "<origin xyz=\"0 0 2\"/>"),
          joint("j", "continuous", "hull", "arm", "<origin xyz=\"1 0 0\"/>")].concat(),
    );
    let base = &model.bodies()[0];
    assert_eq!((base.name.as_str(), base.inertia.mass), ("footprint", 2.0));
    assert!((base.inertia.com - Vector3::new(0.1, -0.2, 2.3)).norm() < 1e-15);
    // The joint is placed in the base's frame, but its parent link keeps its name.
    let placed = model.joints()[0].X_PJ.translation.vector;
    assert_eq!(placed, Vector3::new(1.0, 0.0, 2.0));
    assert_eq!(model.frame("arm").unwrap().parent.as_deref(), Some("hull"));
}

#[test]
fn bodies_are_numbered_depth_first_in_document_order() {
    let mut inside = String::new();
    for name in ["e", "d", "c", "b", "a"] {
        inside += &format!("<link name=\"{name}\">BODY</link>");
    }
    for (name, parent, child) in [
        ("j1", "a", "b"),
        ("j2", "a", "c"),
        ("j3", "b", "d"),
        ("j4", "d", "e"),
    ] {
        inside += &joint(name, "continuous", parent, child, "");
    }
    let model = compile(&inside);
    let names: Vec<&str> = model.bodies().iter().map(|b| b.name.as_str()).collect();
    assert_eq!(names, ["a", "b", "d", "e", "c"]);
    let ends: Vec<usize> = model.bodies().iter().map(|b| b.subtree_end).collect();
    assert_eq!(ends, [5, 4, 4, 4, 5]);
    let joints: Vec<&str> = model.joints().iter().map(|j| j.name.as_str()).collect();
    assert_eq!(joints, ["j1", "j3", "j4", "j2"]);
}

#[test]
fn limits_damping_and_axis_are_kept() {
    let pair = "<link name=\"a\">BODY</link><link name=\"b\">BODY</link>";
    let of = |kind: &str, rest: &str| {
        compile(&(pair.to_owned() + &joint("j", kind, "a", "b", rest))).joints()[0].clone()
    };
    let limit = "<limit lower=\"-1\" upper=\"2\" effort=\"3\" velocity=\"4\"/>";
    let slide = of(
        "prismatic",
        &(limit.to_owned()
            + "<dynamics damping=\"5\" friction=\"6\"/><axis xyz=\"0 1.0000004 0\"/>"),
    );
    let limits = JointLimits {
        lower: -1.0,
        upper: 2.0,
        velocity: 4.0,
        effort: 3.0,
    };
    assert_eq!((slide.kind, slide.limits), (JointKind::Prismatic, limits));
    assert_eq!((slide.damping, slide.friction), (5.0, 6.0));
    assert_eq!(slide.axis, Vector3::y_axis());
    // An axis that is not given is x; a continuous joint has no range, and without <limit> no limits.
    let turn = of("continuous", limit);
    assert_eq!(turn.axis, Vector3::x_axis());
    let limits = JointLimits {
        velocity: 4.0,
        effort: 3.0,
        ..JointLimits::NONE
    };
    assert_eq!((turn.kind, turn.limits), (JointKind::Continuous, limits));
    assert_eq!(of("continuous", "").limits, JointLimits::NONE);
}

#[test]
fn quaternions_of_urdf_1_1_are_exact_even_at_the_singularity() {
    // urdf-rs rounds a pitch this near 90 deg to 90 deg: 2e-3 rad off.
    let half = 0.5 * (std::f64::consts::FRAC_PI_2 - 2e-3);
    let inside = format!(
        "<link name=\"a\">BODY</link><link name=\"b\"/>{}",
        joint(
            "j",
            "fixed",
            "a",
            "b",
            &format!(
                "<origin quat_xyzw=\"0 {:?} 0 {:?}\"/>",
                half.sin(),
                half.cos()
            )
        )
    );
    let xml = robot(&inside).replace("<robot", "<robot version=\"1.1\"");
    let model = Model::from_urdf(&xml, "test").unwrap();
    let expected = Rotation3::from_axis_angle(&Vector3::y_axis(), 2.0 * half);
    let found = model.frame("b").unwrap().X_BF.rotation;
    assert!((found.matrix() - expected.matrix()).norm() < 1e-15);
}

#[test]
fn elements_of_other_tools_are_ignored() {
    let model = Model::from_urdf(
        &("\u{feff}".to_owned()
            + &robot(
                &["<gazebo reference=\"a\"><mass value=\"-1\"/></gazebo><transmission name=\"t\"><joint name=\"j\"/></transmission>",
                  "<link name=\"a\">BODY<contact/></link><link name=\"b\">BODY</link>",
                  &joint("j", "continuous", "a", "b", "<dynamics damping=\"1\" armature=\"2\"/><safety_controller k_velocity=\"1\"/><calibration rising=\"0\"/>")].concat(),
            )
            .replace("<robot", "<robot xmlns:drake=\"http://drake.mit.edu\" drake:x=\"1\"")),
        "test",
    )
    .unwrap();
    assert_eq!(model.joints()[0].damping, 1.0);
}

#[test]
fn a_chain_of_ten_thousand_links_compiles() {
    let n = 10_000;
    let links: String = (0..n)
        .map(|k| format!("<link name=\"l{k}\">{BODY}</link>"))
        .collect();
    let joints: String = (1..n)
        .map(|k| {
            joint(
                &format!("j{k}"),
                "continuous",
                &format!("l{}", k - 1),
                &format!("l{k}"),
                "",
            )
        })
        .collect();
    assert_eq!(compile(&(links + &joints)).dof(), n - 1);
}

#[test]
fn a_chain_of_thousands_of_mimic_joints_and_massless_links_compiles() {
    let n = 20_000;
    let mut inside = String::from("<link name=\"l0\"/>");
    for k in 1..n {
        let mimic = match k {
            1 => String::new(),
            _ => format!("<unknown{k}/><mimic joint=\"j{}\"/>", k - 1),
        };
        let (child, parent) = (format!("l{k}"), format!("l{}", k - 1));
        inside += &joint(&format!("j{k}"), "continuous", &parent, &child, &mimic);
        inside += &format!(
            "<link name=\"{child}\">{}</link>",
            if k + 1 < n { "" } else { "BODY" }
        );
    }
    let repaired = Model::repaired_from_urdf(&robot(&inside), "test").unwrap();
    // The root has no mass: its joint, and with it all that follow, are held.
    assert_eq!(
        (repaired.model.dof(), repaired.model.frames().len()),
        (0, n)
    );
    assert_eq!(repaired.warnings().len(), 2);
}

#[test]
fn huge_masses_are_errors_instead_of_nan() {
    let huge = "<link name=\"a\"><inertial><origin xyz=\"1e300 0 0\"/><mass value=\"1e300\"/><inertia ixx=\"1\" ixy=\"0\" ixz=\"0\" iyy=\"1\" iyz=\"0\" izz=\"1\"/></inertial></link>";
    let pair =
        huge.to_owned() + &huge.replace("\"a\"", "\"b\"") + &joint("j", "fixed", "a", "b", "");
    assert!(matches!(rejection(&pair), UrdfProblem::Inertia(_)));
    assert!(matches!(rejection(huge), UrdfProblem::Inertia(_)));
}

#[test]
fn deep_nesting_does_not_overflow_a_thread_s_stack() {
    let deep = "<x>".repeat(1_000_000) + &"</x>".repeat(1_000_000);
    assert!(matches!(rejection(&deep), UrdfProblem::TooDeep { .. }));
}

proptest::proptest! {
    #![proptest_config(proptest::prelude::ProptestConfig::with_cases(2000))]

    /// Random edits of a description give an error or a valid model, never a panic.
    #[test]
    fn corrupted_descriptions_never_panic(
        edits in proptest::collection::vec((0.0..1.0f64, 0usize..30, 0usize..20), 1..4)
    ) {
        let words = [
            "", "<", ">", "/>", "\"", "0", "-1", "1e999", "nan", "<link name=\"link1\"/>", "<joint>", "</robot>",
            "&amp;", "&x;", "link2", "\u{1f6f0}",
            "<mimic joint=\"joint1\"/>", "<mimic joint=\"joint2\" multiplier=\"-2\"/>", "planar", "floating",
        ];
        let mut text = include_str!("../../../../../urdf/servicer.urdf").to_owned();
        for (place, length, word) in edits {
            let boundary = |mut at: usize| {
                while !text.is_char_boundary(at) {
                    at -= 1;
                }
                at
            };
            let start = boundary((place * text.len() as f64) as usize);
            let end = boundary((start + length).min(text.len()));
            text.replace_range(start..end, words[word]);
        }
        if let Ok(repaired) = Model::repaired_from_urdf(&text, "corrupted") {
            repaired.warnings();
            for body in repaired.model.bodies().iter().filter(|b| b.inertia.mass != 0.0) {
                proptest::prop_assert_eq!(body.inertia.check(), Ok(()));
            }
            proptest::prop_assert!(repaired.model.total_mass() > 0.0);
        }
        if let Ok(model) = Model::from_urdf(&text, "corrupted") {
            for body in model.bodies() {
                proptest::prop_assert_eq!(body.inertia.check(), Ok(()));
            }
        }
    }
}

#[test]
fn springs_come_from_gazebo_elements() {
    let spring = |inside: &str| {
        let arm = joint("j", "continuous", "a", "b", "");
        let inside =
            format!("<link name=\"a\">BODY</link><link name=\"b\">BODY</link>{inside}{arm}");
        compile(&inside).joints()[0].spring
    };
    let block = |text: &str| format!("<gazebo reference=\"j\">{text}</gazebo>");
    let given = block(
        "<springStiffness> 4.5 </springStiffness><springReference>-0.2</springReference><kp>1</kp>",
    );
    let expected = crate::model::Spring {
        stiffness: 4.5,
        rest: -0.2,
    };
    assert_eq!(spring(&given), expected);
    let slack_at_zero = spring(&block("<springStiffness>4.5</springStiffness>"));
    assert_eq!((slack_at_zero.stiffness, slack_at_zero.rest), (4.5, 0.0));
    assert_eq!(spring(&block("<kp>1</kp>")), Default::default());
}
