//! Kane's method against the reduced form on random trees, against real hinges where a loop is cut, and against
//! what was printed.

mod cuts;
mod descriptions;
mod tr942;

use allocation_counter::measure;
use fuyu::dynamics::{
    BaseSpeed, Formulation, Input, Kane, RungeKutta, State, Tableau, TreeAcceleration, TreeMotion,
    VectorState, Workspace,
};
use fuyu::experiments::tr942::pantograph;
use fuyu::model::Model;
use fuyu::spatial::{Twist, Wrench};
use nalgebra::{DVector, Isometry3, Translation3, UnitQuaternion};
use proptest::prelude::*;
use proptest::test_runner::RngSeed;

use crate::trees::{trees, vector};

/// The reduced form's state and workspace for the same motion.
pub fn reduced_state(model: &Model, motion: &TreeMotion) -> (State, Workspace) {
    let mut state = State::at_rest_with(model, &DVector::from_column_slice(motion.q));
    state.qd.copy_from_slice(motion.qd);
    let mut workspace = Workspace::new(model);
    let X_WB = Isometry3::from_parts(Translation3::identity(), motion.R_WB);
    state.set_base(&mut workspace, &X_WB, &motion.V_WB_B);
    workspace.set_motion(&state);
    (state, workspace)
}

/// The reduced form's answer.
pub fn reduced_form(model: &Model, motion: &TreeMotion, input: &Input) -> TreeAcceleration {
    let (state, mut workspace) = reduced_state(model, motion);
    let mut out = TreeAcceleration::zero(model);
    workspace.accelerations(&state, input, &mut out.qdd);
    workspace.set_accelerations(&out.qdd);
    out.A_WB_B = workspace.A_WF_B(&model.frames()[0]);
    out
}

/// Difference relative to the size of the whole answer.
pub fn difference(a: &TreeAcceleration, b: &TreeAcceleration) -> f64 {
    let squares = |x: Twist, qdd: &DVector<f64>| {
        x.angular.norm_squared() + x.linear.norm_squared() + qdd.norm_squared()
    };
    let off = squares(a.A_WB_B - b.A_WB_B, &(&a.qdd - &b.qdd));
    (off / squares(b.A_WB_B, &b.qdd)).sqrt()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 100, failure_persistence: None, rng_seed: RngSeed::Fixed(1987), ..ProptestConfig::default() })]

    /// Two derivations that share neither coordinates nor code. Any wrong or missing term in either (a sign in
    /// (2.3.22)-(2.3.64), a Coriolis term, a wrench's arm, a spring) is a difference of the order of one;
    /// what is left is rounding, amplified by the conditioning of trees of up to 30 bodies.
    #[test]
    fn kane_and_the_reduced_form_agree_on_random_trees(
        model in trees(0..=29),
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
        let expected = reduced_form(&model, &motion, &input);
        let mut out = TreeAcceleration::zero(&model);
        for speed in [BaseSpeed::MainBody, BaseSpeed::SystemCom] {
            let mut kane = Kane::new(&model).with_base_speed(speed);
            kane.accelerations(&motion, &input, &mut out);
            let off = difference(&out, &expected);
            prop_assert!(off < 1e-12, "{:?}: {:e}", speed, off);
        }
    }
}

#[test]
fn kane_and_its_stepper_do_not_allocate() {
    let model = pantograph::model();
    let cuts = pantograph::cuts(&model);
    let layout = VectorState::new(&model);
    let mut x = layout.at_rest_with(&pantograph::initial());
    let mut stepper = RungeKutta::new(&Tableau::RK_GILL, layout.length());
    let mut scratch = TreeAcceleration::zero(&model);
    let input = Input::zero(&model);
    for speed in [BaseSpeed::MainBody, BaseSpeed::SystemCom] {
        let mut kane = Kane::with_cuts(&model, &cuts)
            .unwrap()
            .with_base_speed(speed);
        let used = measure(|| {
            for _ in 0..10 {
                stepper.step(&mut x, pantograph::STEP, |x, rate| {
                    layout.rate(&mut kane, &input, x, &mut scratch, rate);
                });
            }
            assert!(kane.cut_wrench(0).force.norm() > 0.0);
            assert!(kane.cut_velocity(1).linear.norm() < 1e-9);
        });
        assert_eq!(used.count_total, 0, "{speed:?}: {used:?}");
    }
}
