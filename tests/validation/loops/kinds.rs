//! Every kind of closure on a spatial arm: the tip of the servicer held to its own base.

use fuyu::dynamics::{
    Direction, Floating, IntegrationMethod, LoopClosure, Loops, State, Workspace,
};
use fuyu::spatial::Twist;
use nalgebra::{DVector, Isometry3};

use super::mechanisms::*;
use crate::fixtures::{degrees, servicer};

/// A constraint's gradient and its second derivative are two derivations of one gap. Were either wrong, the
/// accelerations would leave the constraint, projection would bring rates back by force, and energy would
/// not be kept: a wrong sign in a Coriolis term shows as 1e-3. The robot turns as a whole.
#[test]
fn every_kind_of_closure_does_no_work() {
    let model = servicer();
    assert!(model.joints().iter().all(|j| j.damping == 0.0));
    let tip = model.frame("tool0").unwrap().clone();
    let q = degrees(&[65.0, 99.0, -95.0, -22.0, 3.0, -42.0]);
    let kinds: [&[Direction]; 9] = [
        &[X],
        &[X, Y],
        &[X, Y, Z],
        HINGE,
        &[X, Y, Roll, Pitch, Yaw],
        &[X, Y, Z, Yaw],
        &[Z, Roll],
        &[Pitch],
        &[Roll, Yaw],
    ];
    for directions in kinds {
        let mut state = State::at_rest_with(&model, &q);
        state.qd = DVector::from_row_slice(&[0.11, -0.07, 0.13, 0.2, -0.15, 0.1]);
        let mut workspace = Workspace::new(&model);
        workspace.set_positions(&q);
        let mut held = model.frames()[0].clone();
        held.X_BF = workspace.X_BF(&tip);
        let closure = LoopClosure {
            name: "held".to_owned(),
            frame_a: held,
            frame_b: tip.clone(),
            constrained: Direction::ALL.map(|d| directions.contains(&d)),
        };
        let mut loops = Loops::new(&model, vec![closure]).unwrap();
        // Whatever opens the loop is taken off the rates.
        loops.assemble(&mut state, 10.0).unwrap();
        assert_eq!(loops.mobility(), 6 - directions.len());
        let turning = Twist::new([0.05, 0.1, -0.08].into(), [0.0; 3].into());
        let base = Isometry3::identity();
        state.set_base(&mut workspace, &base, &turning);
        let mut floating = Floating::with_loops(loops, state, IntegrationMethod::Dop8);
        let energy = floating.workspace().kinetic_energy();
        for _ in 0..300 {
            floating.step(0.01, 1);
            let (_, gap) = floating.loops().gaps(floating.workspace()).next().unwrap();
            assert!(
                gap.translation.max(gap.rotation) < 1e-12,
                "{directions:?} {gap:?}"
            );
        }
        let now = floating.workspace().kinetic_energy();
        assert!(
            (now / energy - 1.0).abs() < 1e-10,
            "{directions:?} {now} {energy}"
        );
        let moved = (&floating.state().q - &q).amax();
        assert!(moved > 0.01, "{directions:?} moves: {moved}");
    }
}
