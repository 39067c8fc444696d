//! Batches against single robots, to the last bit.

#![cfg(feature = "batch")]

use fuyu_physics::dynamics::{Batch, Floating, IntegrationMethod, JointPhysics, State};
use fuyu_physics::model::{Joint, Model};
use nalgebra::DVector;

use crate::robots::{arm, moving};

fn start(model: &Model, index: usize) -> State {
    let mut state = moving(model);
    state.qd *= 0.2 * index as f64;
    state.q += DVector::from_element(6, 0.01 * index as f64);
    state
}

#[test]
fn a_batch_moves_as_single_robots_do() {
    let efforts = [0.5, -0.4, 0.3, 2.0, -0.1, 0.05];
    let limits = |_: usize, joint: &mut Joint| {
        (joint.limits.lower, joint.limits.upper) = (-0.9, 0.9);
        joint.limits.velocity = 0.4;
    };
    let all = |j: usize, joint: &mut Joint| {
        limits(j, joint);
        (joint.damping, joint.friction) = ([0.0, 10.0, 100.0][j % 3], 0.02 * j as f64);
    };
    for model in [arm(|_, joint| joint.damping = 3.0), arm(limits), arm(all)] {
        let settings = JointPhysics {
            restitution: 0.3,
            ..JointPhysics::default()
        };
        for method in [IntegrationMethod::Rk4, IntegrationMethod::Dop8] {
            let mut batch = Batch::new(&model, method, 11).with_joint_physics(&settings);
            let mut singles: Vec<Floating> = (0..batch.len())
                .map(|index| {
                    batch.set_state(index, &start(&model, index));
                    batch.hold_efforts(index, &efforts);
                    let single = Floating::new(model.clone(), start(&model, index), method);
                    let mut single = single.with_joint_physics(&settings);
                    single.hold_efforts(&efforts);
                    single
                })
                .collect();
            batch.step(0.01, 60);
            batch.accelerate();
            for (index, single) in singles.iter_mut().enumerate() {
                single.step(0.01, 60);
                assert_eq!(&batch.state(index), single.state(), "{index}");
                let qdd = single.accelerations();
                assert!((0..6).all(|j| batch.qdd(index, j) == qdd[j]), "{index}");
            }
            // Efforts at every stage, with data of each state.
            let mut data: Vec<f64> = (0..11).map(|index| 0.1 * f64::from(index)).collect();
            batch.step_with(0.01, 20, &mut data, |gain, state, efforts| {
                efforts[0] = -*gain * state.qd[0];
            });
            for (index, single) in singles.iter().enumerate() {
                use fuyu_physics::dynamics::{Input, Integrator, Workspace};
                let mut state = single.state().clone();
                let mut integrator = Integrator::new(&model, method).with_joint_physics(&settings);
                let mut forcing = |_: f64, state: &State, input: &mut Input| {
                    input.efforts.copy_from_slice(&efforts);
                    input.efforts[0] = -0.1 * index as f64 * state.qd[0];
                };
                let mut workspace = Workspace::new(&model);
                integrator.steps(&mut state, &mut workspace, 0.01, 20, &mut forcing);
                assert_eq!(batch.state(index), state, "{index}");
            }
        }
    }
}
