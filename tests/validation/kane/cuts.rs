//! Cut hinges against real ones: two trees of the same robot, one of which has a hinge that is only a cut.

use fuyu::dynamics::{
    BaseSpeed, CutError, CutHinge, Formulation, Input, Kane, TreeAcceleration, TreeMotion,
    Workspace,
};
use fuyu::model::{JointKind, Model, ModelBuilder};
use fuyu::spatial::{Pose, RigidInertia, Twist, Wrench, roll_pitch_yaw_intrinsic};
use nalgebra::{DVector, Matrix3, Rotation3, Translation3, Unit, UnitQuaternion, Vector3};
use proptest::prelude::*;
use proptest::test_runner::RngSeed;

use super::{difference, reduced_form, reduced_state};
use crate::trees::{direction, inertia, rotation, vector};

/// Two arms, one carried by the other.
#[derive(Debug, Clone)]
struct Robot {
    inertias: [RigidInertia; 3],
    shoulder: (Pose, Unit<Vector3<f64>>),
    elbow: (Pose, Unit<Vector3<f64>>),
    kind: JointKind,
}

impl Robot {
    fn base_and_arm1(&self) -> ModelBuilder {
        let mut robot = ModelBuilder::new("robot", "base_link", self.inertias[0]);
        let (X, axis) = &self.shoulder;
        robot.body(
            "arm1",
            0,
            JointKind::Continuous,
            *axis,
            *X,
            self.inertias[1],
        );
        robot
    }

    /// The elbow is a hinge of the tree.
    fn tree(&self) -> Model {
        let mut robot = self.base_and_arm1();
        let (X, axis) = &self.elbow;
        robot.body("arm2", 1, self.kind, *axis, *X, self.inertias[2]);
        robot.build()
    }

    /// Arm 2 moves freely on the base, by six hinges with massless bodies between; the elbow is a cut.
    fn cut(&self) -> (Model, CutHinge) {
        let mut robot = self.base_and_arm1();
        let axes = [Vector3::x_axis(), Vector3::y_axis(), Vector3::z_axis()];
        let kinds = [JointKind::Prismatic, JointKind::Continuous];
        let freedoms = kinds.iter().flat_map(|kind| axes.map(|axis| (*kind, axis)));
        for (i, (kind, axis)) in freedoms.enumerate() {
            let parent = if i == 0 { 0 } else { i + 1 };
            let (name, inertia) = if i == 5 {
                ("arm2".to_owned(), self.inertias[2])
            } else {
                (format!("between{i}"), RigidInertia::zero())
            };
            robot.body(&name, parent, kind, axis, Pose::identity(), inertia);
        }
        let (X, axis) = &self.elbow;
        // z of the hinge frame is the free axis.
        let R =
            Rotation3::rotation_between(&Vector3::z(), axis).unwrap_or_else(Rotation3::identity);
        let slides = self.kind == JointKind::Prismatic;
        let hinge = CutHinge {
            body_k: 1,
            X_KH: X * R,
            body_l: 7,
            X_LH: Pose::from_parts(Translation3::identity(), R),
            translations: [true, true, !slides],
            rotations: [true, true, slides],
        };
        (robot.build(), hinge)
    }
}

fn robot() -> impl Strategy<Value = Robot> {
    let joint = || {
        (vector(1.0), rotation(), direction())
            .prop_map(|(p, R, axis)| (Pose::from_parts(Translation3::from(p), R), axis))
    };
    (
        inertia(5.0..100.0),
        inertia(1.0..20.0),
        inertia(1.0..20.0),
        joint(),
        joint(),
        any::<bool>(),
    )
        .prop_map(|(base, arm1, arm2, shoulder, elbow, slides)| Robot {
            inertias: [base, arm1, arm2],
            shoulder,
            elbow,
            kind: if slides {
                JointKind::Prismatic
            } else {
                JointKind::Continuous
            },
        })
}

/// Positions and rates of the six hinges that carry arm 2 as it moves in `workspace`.
fn freedoms(workspace: &Workspace, model: &Model) -> ([f64; 6], [f64; 6]) {
    let arm2 = model.frame("arm2").unwrap();
    let (X, V, V_0) = (
        workspace.X_BF(arm2),
        workspace.V_WF_B(arm2),
        workspace.V_WB_B(),
    );
    let p = X.translation.vector;
    let angles = roll_pitch_yaw_intrinsic(&X.rotation);
    let Rx = Rotation3::from_axis_angle(&Vector3::x_axis(), angles[0]);
    let Ry = Rotation3::from_axis_angle(&Vector3::y_axis(), angles[1]);
    let axes = Matrix3::from_columns(&[Vector3::x(), Rx * Vector3::y(), Rx * Ry * Vector3::z()]);
    let turning = axes.try_inverse().unwrap() * (V.angular - V_0.angular);
    let v = V.linear - V_0.linear - V_0.angular.cross(&p);
    (
        [p.x, p.y, p.z, angles[0], angles[1], angles[2]],
        [v.x, v.y, v.z, turning.x, turning.y, turning.z],
    )
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 100, failure_persistence: None, rng_seed: RngSeed::Fixed(942), ..ProptestConfig::default() })]

    /// Pins and sliders in space, bodies that move in every way: the cut robot accelerates like the tree, and
    /// its constraint wrench, given as an external one to the arms of the open tree, does the same. A sign or a
    /// term lost in (2.3.43) or (2.3.47), also that of a slot along which the end slides, is of first order.
    #[test]
    fn a_cut_hinge_holds_like_a_hinge_of_the_tree(
        robot in robot(),
        q in prop::array::uniform2(-1.5..1.5f64),
        qd in prop::array::uniform2(-1.0..1.0f64),
        (w, v, turn) in (vector(1.0), vector(1.0), vector(3.0)),
        (torque, force) in (vector(20.0), vector(20.0)),
        effort in -10.0..10.0f64,
        reversed in any::<bool>(),
    ) {
        let tree = robot.tree();
        let motion = TreeMotion { R_WB: UnitQuaternion::new(turn), V_WB_B: Twist::new(w, v), q: &q, qd: &qd };
        let mut input = Input::zero(&tree);
        input.efforts[0] = effort;
        input.wrenches[2] = Wrench::new(torque, force);
        let (state, mut of_tree) = reduced_state(&tree, &motion);
        let mut expected = TreeAcceleration::zero(&tree);
        of_tree.accelerations(&state, &input, &mut expected.qdd);
        of_tree.set_accelerations(&expected.qdd);
        let arm2 = tree.frame("arm2").unwrap();
        let (positions, rates) = freedoms(&of_tree, &tree);
        // The angles of arm 2 must determine its attitude.
        prop_assume!(positions[4].abs() < 1.3);

        let (open, mut hinge) = robot.cut();
        // A pin may as well be described on the other arm.
        if reversed && robot.kind == JointKind::Continuous {
            (hinge.body_k, hinge.body_l) = (hinge.body_l, hinge.body_k);
            (hinge.X_KH, hinge.X_LH) = (hinge.X_LH, hinge.X_KH);
        }
        let all_q: Vec<f64> = std::iter::once(q[0]).chain(positions).collect();
        let all_qd: Vec<f64> = std::iter::once(qd[0]).chain(rates).collect();
        let motion = TreeMotion { q: &all_q, qd: &all_qd, ..motion };
        let mut input = Input::zero(&open);
        input.efforts[0] = effort;
        input.wrenches[7] = Wrench::new(torque, force);
        for speed in [BaseSpeed::MainBody, BaseSpeed::SystemCom] {
            let mut kane = Kane::with_cuts(&open, std::slice::from_ref(&hinge)).unwrap().with_base_speed(speed);
            let mut out = TreeAcceleration::zero(&open);
            kane.accelerations(&motion, &input, &mut out);
            let base = of_tree.A_WF_B(&tree.frames()[0]);
            let (state, mut of_open) = reduced_state(&open, &motion);
            of_open.accelerations(&state, &input, &mut DVector::zeros(7));
            of_open.set_accelerations(&out.qdd);
            for (ours, theirs) in [
                (out.A_WB_B, base),
                (of_open.A_WF_B(open.frame("arm2").unwrap()), of_tree.A_WF_B(arm2)),
            ] {
                let size = 1.0 + theirs.linear.norm() + theirs.angular.norm();
                prop_assert!((ours - theirs).linear.norm() < 1e-10 * size, "{} {}", ours.linear, theirs.linear);
                prop_assert!((ours - theirs).angular.norm() < 1e-10 * size, "{} {}", ours.angular, theirs.angular);
            }
            prop_assert!((out.qdd[0] - expected.qdd[0]).abs() < 1e-10 * (1.0 + expected.qdd.norm()));

            // Nothing opens but the free direction, and that at the elbow's rate.
            let opening = kane.cut_velocity(0);
            let along = Vector3::z() * if hinge.body_k == 1 { qd[1] } else { -qd[1] };
            let free = if robot.kind == JointKind::Prismatic {
                Twist::new(Vector3::zeros(), along)
            } else {
                Twist::new(along, Vector3::zeros())
            };
            prop_assert!((opening - free).linear.norm() < 1e-12 && (opening - free).angular.norm() < 1e-12);

            // The same wrench by hand, without any cut.
            let (k, l) = (hinge.body_k, hinge.body_l);
            let pose = |body: usize| of_open.X_BF(&open.frames()[body]);
            let X_KL = pose(k).inverse() * pose(l);
            let point = X_KL * hinge.X_LH;
            let on_k = Pose::from_parts(point.translation, hinge.X_KH.rotation);
            let wrench = kane.cut_wrench(0);
            let mut held = input.clone();
            held.wrenches[k] += wrench.shifted_to_parent(&on_k);
            held.wrenches[l] -= wrench.shifted_to_parent(&(X_KL.inverse() * on_k));
            let by_hand = reduced_form(&open, &motion, &held);
            prop_assert!(difference(&out, &by_hand) < 1e-10, "{:e}", difference(&out, &by_hand));
        }
    }
}

#[test]
fn cuts_that_cannot_be_are_refused_in_one_line() {
    let ball = RigidInertia {
        mass: 1.0,
        com: Vector3::zeros(),
        about_com: Matrix3::identity(),
    };
    let mut robot = ModelBuilder::new("three", "base_link", ball);
    for (k, name) in ["arm1", "arm2", "arm3"].into_iter().enumerate() {
        robot.body(
            name,
            k,
            JointKind::Continuous,
            Vector3::z_axis(),
            Translation3::new(1.0, 0.0, 0.0).into(),
            ball,
        );
    }
    let model = robot.build();
    let good = CutHinge {
        body_k: 0,
        X_KH: Pose::identity(),
        body_l: 3,
        X_LH: Pose::identity(),
        translations: [true, true, false],
        rotations: [false; 3],
    };
    let said = |cuts: &[CutHinge]| Kane::with_cuts(&model, cuts).unwrap_err();
    assert!(Kane::with_cuts(&model, std::slice::from_ref(&good)).is_ok());

    let nothing = CutHinge {
        translations: [false; 3],
        ..good.clone()
    };
    assert_eq!(
        said(&[good.clone(), nothing]),
        CutError::Unconstrained { cut: 1 }
    );
    let missing = CutHinge {
        body_k: 4,
        ..good.clone()
    };
    assert_eq!(
        said(&[missing]).to_string(),
        "cut 0 is on body 4, but the model's bodies are 0 to 3"
    );
    let itself = CutHinge {
        body_k: 3,
        ..good.clone()
    };
    assert_eq!(
        said(&[itself]).to_string(),
        "cut 0 connects arm3 with itself; a loop needs two bodies"
    );
    let lost = CutHinge {
        X_LH: Translation3::new(0.0, f64::NAN, 0.0).into(),
        ..good.clone()
    };
    assert_eq!(
        said(&[lost]),
        CutError::NotFinite {
            cut: 0,
            body: "arm3".to_owned()
        }
    );
    // A pin in space takes 5 directions, but 3 hinges in a plane can only give it 2.
    let over = |hinges| CutError::OverConstrained {
        cut: 1,
        constraints: hinges + 1,
        hinges,
    };
    let pin = CutHinge {
        translations: [true; 3],
        rotations: [true, true, false],
        ..good.clone()
    };
    assert_eq!(
        said(std::slice::from_ref(&pin)).to_string(),
        "cut 0 over-constrains its loop: 3 hinges cannot satisfy 4 constrained directions; \
         leave out directions in which those hinges never move"
    );
    // The same hinges cannot meet the same constraints twice.
    assert_eq!(said(&[good.clone(), good.clone()]), over(3));
    // Arms that slide do not turn: hinges enough, but none for the rotation.
    let mut robot = ModelBuilder::new("sliding", "base_link", ball);
    for (name, axis) in [("x", Vector3::x_axis()), ("y", Vector3::y_axis())] {
        let parent = usize::from(name == "y");
        robot.body(
            name,
            parent,
            JointKind::Prismatic,
            axis,
            Pose::identity(),
            ball,
        );
    }
    let model = robot.build();
    let one = CutHinge {
        body_l: 2,
        translations: [true, false, false],
        ..good.clone()
    };
    let turned = CutHinge {
        translations: [false; 3],
        rotations: [false, false, true],
        ..one.clone()
    };
    assert_eq!(
        Kane::with_cuts(&model, &[one, turned]).unwrap_err(),
        over(0)
    );
}
