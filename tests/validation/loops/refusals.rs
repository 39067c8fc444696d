//! Impossible loop closures: each is refused in one line that names the closure and what is wrong.

use fuyu::dynamics::{Direction, LoopClosure, LoopError, Loops, State};

use super::mechanisms::*;

const ENDS: (&str, &str) = ("coupler_tip", "rocker_tip");

fn four_bar_with(ends: (&str, &str), directions: &[Direction]) -> Result<Loops, LoopError> {
    let model = four_bar();
    let closure = LoopClosure::between(&model, "cut", ends.0, ends.1, directions)?;
    Loops::new(&model, vec![closure])
}

fn assembled(q: [f64; 3], qd: [f64; 3], directions: &[Direction]) -> Result<State, LoopError> {
    let model = four_bar();
    let mut state = State::at_rest(&model);
    state.q.copy_from_slice(&q);
    state.qd.copy_from_slice(&qd);
    four_bar_with(ENDS, directions)?.assemble(&mut state, 1e-3)?;
    Ok(state)
}

/// Crank up, coupler and rocker where they meet.
fn upright() -> [f64; 3] {
    let [a, b, c] = FOUR_BAR;
    let (x, y) = (1.0f64, -a);
    let d = x.hypot(y);
    let coupler = y.atan2(x) + ((d * d + b * b - c * c) / (2.0 * d * b)).acos();
    let end = (b * coupler.cos() - x, b * coupler.sin() - y);
    let up = std::f64::consts::FRAC_PI_2;
    [up, coupler - up, end.1.atan2(end.0)]
}

#[track_caller]
fn says<T: std::fmt::Debug>(result: Result<T, LoopError>, parts: &[&str]) {
    let message = result.unwrap_err().to_string();
    assert!(!message.contains('\n'));
    for part in parts {
        assert!(message.contains(part), "no {part:?} in: {message}");
    }
}

#[test]
fn ends_and_directions() {
    says(
        four_bar_with(("coupler_tip", "roker_tip"), IN_PLANE),
        &["'cut'", "no link 'roker_tip'", "rocker_tip"],
    );
    says(
        four_bar_with(ENDS, &[]),
        &["'cut'", "no direction", "about_z"],
    );
    says(
        four_bar_with(("coupler_tip", "coupler"), IN_PLANE),
        &["'cut'", "'coupler_tip'", "same body 'coupler'"],
    );
    let model = four_bar();
    let cut = LoopClosure::between(&model, "cut", ENDS.0, ENDS.1, IN_PLANE).unwrap();
    says(
        Loops::new(&model, vec![cut.clone(), cut]),
        &["'cut' is given twice"],
    );
}

#[test]
fn joints_that_do_not_close_the_loop() {
    let mut q = upright();
    assert_eq!(assembled(q, [0.0; 3], HINGE).unwrap().q.len(), 3);
    // The rocker's tip is 0.07 m away.
    q[2] += 0.1;
    says(
        assembled(q, [0.0; 3], HINGE),
        &["'cut'", "open by 0.0", " m along_", "up to 0.001 m"],
    );
    says(
        assembled(q, [0.0; 3], &[Direction::Yaw]),
        &["'cut'", "rad about_z", "up to 0.001 rad"],
    );
    q[0] = f64::NAN;
    says(assembled(q, [0.0; 3], HINGE), &["'cut'", "open by NaN"]);
}

#[test]
fn joints_that_almost_close_the_loop_are_moved() {
    let mut q = upright();
    q[2] += 1e-3;
    q[0] -= 4e-4;
    let state = assembled(q, [0.0; 3], HINGE).unwrap();
    let given = nalgebra::DVector::from_row_slice(&q);
    let moved = (&state.q - given).amax();
    assert!(moved > 1e-4 && moved < 2e-3, "{moved}");
    // Again, and nothing moves.
    let again = assembled([state.q[0], state.q[1], state.q[2]], [0.0; 3], HINGE).unwrap();
    assert!((again.q - state.q).amax() < 1e-15);
}

#[test]
fn rates_that_open_the_loop() {
    says(
        assembled(upright(), [0.0, 0.0, 0.5], HINGE),
        &["'cut' opens at 0.", " m/s along_", "up to 0.001 m/s"],
    );
}

#[test]
fn closures_that_lock_everything() {
    says(
        assembled(upright(), [0.0; 3], &[X, Y, Yaw]),
        &["'cut'", "open by"],
    );
    // A frame welded where it stands closes in all directions, and nothing is left to move.
    let model = four_bar();
    let mut state = State::at_rest(&model);
    state.q.copy_from_slice(&upright());
    let mut workspace = fuyu::dynamics::Workspace::new(&model);
    workspace.set_positions(&state.q);
    let mut closure =
        LoopClosure::between(&model, "weld", ENDS.0, ENDS.1, &Direction::ALL).unwrap();
    let X_AB = workspace.X_BF(&closure.frame_b).inverse() * workspace.X_BF(&closure.frame_a);
    closure.frame_b.X_BF *= X_AB;
    let mut loops = Loops::new(&model, vec![closure]).unwrap();
    says(
        loops.assemble(&mut state, 1e-3),
        &["(weld)", "lock all 3 joints", "fewer directions"],
    );
}
