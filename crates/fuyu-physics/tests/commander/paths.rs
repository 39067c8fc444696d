//! Timed poses that the tip follows.

use fuyu_physics::control::commander::{
    ArmMotion, KeptTip, PathFrame, PosePath, PoseSpline, TimedPose,
};
use fuyu_physics::spatial::{Pose, exp_so3};
use nalgebra::{Translation3, Vector3};

use crate::drive::{Driven, POSTURE, between};

/// Four poses around a start, 2 s apart; `size` scales the way.
fn path(frame: PathFrame, start: &Pose, size: f64) -> PosePath {
    let moves = [
        ([0.10, 0.05, 0.0], [0.0, 0.2, 0.1]),
        ([0.10, 0.20, -0.08], [0.1, 0.3, 0.3]),
        ([-0.05, 0.25, -0.10], [0.2, 0.1, 0.4]),
        ([-0.08, 0.10, 0.02], [0.0, -0.1, 0.2]),
    ];
    let poses = moves.iter().enumerate().map(|(i, (p, u))| TimedPose {
        time: 2.0 * (i + 1) as f64,
        pose: Pose::from_parts(
            Translation3::from(start.translation.vector + Vector3::from(*p) * size),
            exp_so3(&(Vector3::from(*u) * size)).to_rotation_matrix() * start.rotation,
        ),
    });
    PosePath::new(frame, poses.collect()).unwrap()
}

fn begin(
    driven: &Driven,
    frame: PathFrame,
    (size, least_reaction): (f64, bool),
) -> (PoseSpline, ArmMotion) {
    let mut follower = driven.follower(KeptTip::Pose, least_reaction);
    let (X, V) = follower.tip(&driven.base(), frame);
    let start = match frame {
        PathFrame::World => driven.X_WE(),
        PathFrame::Base => driven.X_BE(),
    };
    let spline = path(frame, &start, size)
        .spline(0.0, driven.time, &X, &V)
        .unwrap();
    (spline.clone(), ArmMotion::path(spline, follower))
}

/// Largest deviation of the tip from the path, and the turn of the base at the end \[rad\] and at most.
fn follow(driven: &mut Driven, frame: PathFrame, how: (f64, bool)) -> ((f64, f64), (f64, f64)) {
    let (spline, mut motion) = begin(driven, frame, how);
    let (mut most, mut turn) = ((0.0f64, 0.0f64), 0.0f64);
    while driven.time < 9.0 {
        driven.step(&mut motion);
        let tip = match frame {
            PathFrame::World => driven.X_WE(),
            PathFrame::Base => driven.X_BE(),
        };
        let (p, angle) = between(&tip, &spline.at(driven.time).0);
        most = (most.0.max(p), most.1.max(angle));
        turn = turn.max(driven.base_turn());
    }
    (most, (driven.base_turn(), turn))
}

// In the world the tip stays on its path although the base moves by more than the error. Would break with the Jacobian
// of the fixed base.
#[test]
fn the_tip_stays_on_a_path_in_the_world_while_the_base_drifts() {
    let mut driven = Driven::at(&POSTURE);
    let (off, turn) = follow(&mut driven, PathFrame::World, (1.0, false));
    println!("at rest: {off:?}, base {turn:?} rad");
    assert!(off.0 < 1e-3 && off.1 < 1e-3, "{off:?}");
    assert!(turn.1 > 5e-3);
    // With momentum the base drifts by 3 cm and turns while the tip arrives.
    let mut drifting = Driven::with_momentum(&POSTURE, [1.0, 0.0, 0.0], [0.5, -0.4, 0.3]);
    let (off, turn) = follow(&mut drifting, PathFrame::World, (1.0, false));
    let drift = drifting.base().X_WB.translation.vector.norm();
    println!("drifting: {off:?}, base {turn:?} rad, {drift} m");
    assert!(off.0 < 1e-3 && off.1 < 1e-3, "{off:?}");
    assert!(drift > 0.02);
}

#[test]
fn a_path_relative_to_the_base_moves_with_it() {
    let mut driven = Driven::with_momentum(&POSTURE, [1.0, 0.0, 0.0], [0.5, -0.4, 0.3]);
    let (off, _) = follow(&mut driven, PathFrame::Base, (1.0, false));
    println!("relative: {off:?}");
    assert!(off.0 < 1e-3 && off.1 < 1e-3, "{off:?}");
}

#[test]
fn a_path_with_least_reaction_turns_the_base_less() {
    let mut plain = Driven::at(&POSTURE);
    let (_, plain) = follow(&mut plain, PathFrame::World, (0.5, false));
    let mut reduced = Driven::at(&POSTURE);
    let (off, turn) = follow(&mut reduced, PathFrame::World, (0.5, true));
    println!("base {turn:?} rad, without {plain:?} rad; off {off:?}");
    assert!(off.0 < 1e-3 && off.1 < 1e-3, "{off:?}");
    assert!(turn.1 < 0.9 * plain.1);
}

// A path that replaces another one in motion, and a stop: position and rate of the reference do not jump, nor do
// efforts grow.
#[test]
fn changes_of_the_motion_cause_no_jump() {
    let mut driven = Driven::at(&POSTURE);
    let (_, mut motion) = begin(&driven, PathFrame::World, (1.0, false));
    for _ in 0..100 {
        driven.step(&mut motion);
    }
    let before = driven.reference.clone();
    let (_, mut motion) = begin(&driven, PathFrame::Base, (1.0, false));
    driven.step(&mut motion);
    for (before, after) in before.iter().zip(&driven.reference) {
        assert!((before.position - after.position).abs() < 0.01);
        // The rate at the end of the step, too.
        let rate = after.rate + 0.01 * after.acceleration;
        assert!((before.rate - rate).abs() < 0.02, "{before:?} {after:?}");
    }
    let qd = driven.robot.state().qd.clone();
    assert!(qd.norm() > 0.05);
    let mut stop = ArmMotion::Joints(fuyu_physics::control::commander::JointSpline::stop(
        driven.model(),
        driven.time,
        &driven.reference,
    ));
    driven.step(&mut stop);
    assert!((driven.robot.state().qd.clone() - qd).norm() < 0.03);
    for _ in 0..200 {
        driven.step(&mut stop);
    }
    assert!(driven.robot.state().qd.norm() < 1e-4);
}
