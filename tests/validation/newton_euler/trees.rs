//! Random trees against the reduced form: accelerations, and forces in every hinge by Newton's law on what lies
//! beyond it.

use fuyu::dynamics::newton_euler::NewtonEuler;
use fuyu::dynamics::{Formulation, Input, TreeAcceleration, TreeMotion};
use fuyu::model::Model;
use fuyu::spatial::{Twist, Wrench};
use nalgebra::UnitQuaternion;
use proptest::prelude::*;
use proptest::test_runner::RngSeed;

use crate::kane::{difference, reduced_form, reduced_state};
use crate::trees::{trees, vector};

/// What moves each body, from the reduced form's accelerations: about the body frame's origin, base axes, less
/// the wrench that acts on the body.
fn needed(
    model: &Model,
    motion: &TreeMotion,
    input: &Input,
    acceleration: &TreeAcceleration,
) -> Vec<(nalgebra::Vector3<f64>, Wrench)> {
    let (state, mut workspace) = reduced_state(model, motion);
    let mut qdd = acceleration.qdd.clone();
    workspace.accelerations(&state, input, &mut qdd);
    workspace.set_accelerations(&qdd);
    let bodies = model
        .bodies()
        .iter()
        .zip(model.frames())
        .zip(&input.wrenches);
    bodies
        .map(|((body, frame), given)| {
            let X = workspace.X_BF(frame);
            let (R, V, A) = (X.rotation, workspace.V_WF_B(frame), workspace.A_WF_B(frame));
            let (w, r) = (V.angular, R * body.inertia.com);
            let force =
                (A.linear + A.angular.cross(&r) + w.cross(&w.cross(&r))) * body.inertia.mass;
            let I = R.matrix() * body.inertia.about_com * R.matrix().transpose();
            let torque = I * A.angular + w.cross(&(I * w)) + r.cross(&force);
            let given = Wrench::new(R * given.torque, R * given.force);
            (X.translation.vector, Wrench::new(torque, force) - given)
        })
        .collect()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 500, failure_persistence: None, rng_seed: RngSeed::Fixed(22), ..ProptestConfig::default() })]

    /// The matrix method knows no joint coordinates and the reduced form no hinge forces: a wrong term in either
    /// is a difference of the order of one. What is left is rounding.
    #[test]
    fn the_matrix_method_and_the_reduced_form_agree_on_random_trees(
        model in trees(1..=29),
        q in prop::collection::vec(-2.0..2.0f64, 29),
        qd in prop::collection::vec(-1.0..1.0f64, 29),
        efforts in prop::collection::vec(-10.0..10.0f64, 29),
        (w, v, turn) in (vector(1.0), vector(1.0), vector(3.0)),
        wrenches in prop::collection::vec((vector(20.0), vector(20.0)), 30),
    ) {
        let n = model.dof();
        let motion = TreeMotion {
            R_WB: UnitQuaternion::new(turn),
            V_WB_B: Twist::new(w, v),
            q: &q[..n],
            qd: &qd[..n],
        };
        let mut input = Input::zero(&model);
        input.efforts.copy_from_slice(&efforts[..n]);
        for (wrench, (torque, force)) in input.wrenches.iter_mut().zip(wrenches) {
            *wrench = Wrench::new(torque, force);
        }
        let mut matrix = NewtonEuler::new(&model).unwrap();
        let mut out = TreeAcceleration::zero(&model);
        matrix.accelerations(&motion, &input, &mut out);
        let expected = reduced_form(&model, &motion, &input);
        let off = difference(&out, &expected);
        prop_assert!(off < 1e-13, "{:e}", off);
        prop_assert_eq!(matrix.method().rank(), 5 * n);

        let bodies = needed(&model, &motion, &input, &expected);
        let (_, workspace) = reduced_state(&model, &motion);
        for j in 0..n {
            let hinge = &matrix.system().hinges()[j + 1];
            let R_0M = workspace.X_BF(&model.frames()[model.joint_parent(j)]).rotation * hinge.X_BM.rotation;
            let mut sum = Wrench::ZERO;
            let mut size = 0.0;
            for (p, wrench) in &bodies[j + 1..model.bodies()[j + 1].subtree_end] {
                let about_hinge = wrench.shifted(&(p - bodies[j + 1].0));
                sum += about_hinge;
                size += about_hinge.force.norm() + about_hinge.torque.norm();
            }
            let ours = matrix.method().hinge_wrench(matrix.system(), j + 1);
            let off = Wrench::new(R_0M * ours.torque, R_0M * ours.force) - sum;
            let off = (off.force.norm() + off.torque.norm()) / size;
            prop_assert!(off < 1e-12, "{}: {:e}", hinge.name, off);
        }
    }
}
