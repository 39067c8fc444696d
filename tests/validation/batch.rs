//! A batch of states gives the same as each state alone.

use fuyu::dynamics::{Batch, Floating, Method, State};
use nalgebra::{DVector, UnitQuaternion};

use crate::formulations::Draw;

/// 37 states of a random tree, which no number of lanes divides, each with its own momentum and efforts.
fn run(threads: usize) -> (Vec<State>, Vec<State>) {
    let mut draw = Draw::new(37);
    let model = draw.tree(12);
    let n = model.dof();
    let mut batch = Batch::new(&model, 37);
    let mut alone = Vec::new();
    for index in 0..batch.len() {
        let motion = draw.motion(&model);
        let mut state = State::at_rest_with(&model, &DVector::from_row_slice(&motion.q));
        state.qd = DVector::from_row_slice(&motion.qd);
        state.R_WB = UnitQuaternion::new(draw.vector(2.0));
        state.momentum_W.linear = draw.vector(20.0);
        state.momentum_W.angular = draw.vector(20.0);
        batch.set_state(index, &state);
        batch.hold_efforts(index, motion.input.efforts.as_slice());
        let mut robot = Floating::new(model.clone(), state, Method::Rk4);
        robot.hold_efforts(motion.input.efforts.as_slice());
        alone.push(robot);
    }
    batch.accelerate();
    for (index, robot) in alone.iter_mut().enumerate() {
        let qdd = robot.accelerations();
        let scale = qdd.amax();
        for j in 0..n {
            assert!((batch.qdd(index, j) - qdd[j]).abs() <= 1e-13 * scale);
        }
        robot.step(1e-3, 20);
    }
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
    pool.build().unwrap().install(|| batch.step(1e-3, 20));
    let together = (0..batch.len()).map(|index| batch.state(index));
    let alone = alone.iter().map(|robot| robot.state().clone());
    (together.collect(), alone.collect())
}

#[test]
fn states_in_a_batch_move_as_they_do_alone() {
    let (together, alone) = run(2);
    for (a, b) in together.iter().zip(&alone) {
        let scale = b.qd.amax().max(1.0);
        assert!(
            (&a.qd - &b.qd).amax() <= 1e-13 * scale,
            "{}",
            (&a.qd - &b.qd).amax()
        );
        assert!((&a.q - &b.q).amax() <= 1e-13 * b.q.amax().max(1.0));
        assert!((a.R_WB.coords - b.R_WB.coords).amax() <= 1e-13);
        assert!((a.p_WC - b.p_WC).amax() <= 1e-13 * b.p_WC.amax().max(1.0));
        assert!((a.time - b.time).abs() <= 1e-13);
        assert_eq!(a.momentum_W, b.momentum_W);
    }
}

#[test]
fn the_number_of_threads_does_not_change_a_bit() {
    let (one, many) = (run(1).0, run(3).0);
    for (a, b) in one.iter().zip(&many) {
        assert_eq!((&a.q, &a.qd, a.R_WB, a.p_WC), (&b.q, &b.qd, b.R_WB, b.p_WC));
    }
}
