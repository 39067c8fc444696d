//! Streamed twists of the tip.

use fuyu_physics::control::commander::{
    ArmMotion, KeptTip, TipFollower, TipResolver, TwistAxes, TwistServo, TwistServoConfig,
    TwistStatus,
};
use fuyu_physics::spatial::Twist;
use nalgebra::{UnitQuaternion, Vector3};

use crate::drive::{Driven, POSTURE};

fn servo(driven: &Driven, config: TwistServoConfig) -> TwistServo {
    let resolver = TipResolver::new(driven.model(), &driven.tip, KeptTip::Pose, false);
    let follower = TipFollower::new(driven.model(), resolver.without_limits(), &driven.reference);
    TwistServo::new(driven.model(), follower, config)
}

fn status(motion: &ArmMotion) -> TwistStatus {
    let ArmMotion::Twist(servo) = motion else {
        unreachable!("it was made as one")
    };
    servo.status()
}

fn command(motion: &mut ArmMotion, axes: TwistAxes, twist: Twist, time: f64) {
    let ArmMotion::Twist(servo) = motion else {
        unreachable!("it was made as one")
    };
    servo.command(axes, twist, time);
}

fn linear(x: f64, y: f64, z: f64) -> Twist {
    Twist::new(Vector3::zeros(), Vector3::new(x, y, z))
}

/// Velocity of the tip's origin in the world.
fn v_W(driven: &Driven) -> Vector3<f64> {
    driven.robot.state().R_WB * driven.robot.workspace().V_WF_B(&driven.tip).linear
}

// The tip moves in inertial space along the axes of the frame, while the base reacts.
#[test]
fn a_twist_moves_the_tip_in_inertial_space_in_the_axes_of_its_frame() {
    for frame in ["world", "link3", "tool0", "base_link"] {
        let mut driven = Driven::at(&POSTURE);
        let mut motion = ArmMotion::Twist(Box::new(servo(&driven, TwistServoConfig::default())));
        let axes = |driven: &Driven| match frame {
            "world" => TwistAxes::World(UnitQuaternion::identity()),
            name => TwistAxes::Robot(driven.model().frame(name).unwrap().clone()),
        };
        for _ in 0..100 {
            let now = driven.time;
            command(&mut motion, axes(&driven), linear(0.03, -0.02, 0.01), now);
            driven.step(&mut motion);
        }
        assert_eq!(status(&motion), TwistStatus::Following);
        let R_WF = match frame {
            "world" => UnitQuaternion::identity(),
            name => {
                let frame = driven.model().frame(name).unwrap();
                let X_BF = driven.robot.workspace().X_BF(frame);
                driven.robot.state().R_WB * UnitQuaternion::from(X_BF.rotation)
            }
        };
        let wanted = R_WF * Vector3::new(0.03, -0.02, 0.01);
        let off = (v_W(&driven) - wanted).norm();
        println!("{frame}: {off} m/s");
        assert!(off < 5e-4, "{frame}");
        let w = driven.robot.workspace().V_WF_B(&driven.tip).angular.norm();
        assert!(w < 2e-3, "{w}");
    }
}

#[test]
fn the_joints_are_halted_when_twists_end() {
    let mut driven = Driven::at(&POSTURE);
    let mut motion = ArmMotion::Twist(Box::new(servo(&driven, TwistServoConfig::default())));
    command(
        &mut motion,
        TwistAxes::World(UnitQuaternion::identity()),
        linear(0.05, 0.0, 0.0),
        0.0,
    );
    for _ in 0..10 {
        driven.step(&mut motion);
    }
    assert_eq!(status(&motion), TwistStatus::Following);
    assert!(driven.robot.state().qd.norm() > 0.02);
    for _ in 0..100 {
        driven.step(&mut motion);
    }
    assert_eq!(status(&motion), TwistStatus::Silent);
    assert!(driven.robot.state().qd.norm() < 1e-4);
}

/// Drives the tip in one direction until `done`, for 60 s at most.
fn drive(
    driven: &mut Driven,
    motion: &mut ArmMotion,
    twist: Twist,
    done: impl Fn(&Driven, TwistStatus) -> bool,
) -> Vec<TwistStatus> {
    let mut seen: Vec<TwistStatus> = Vec::new();
    for _ in 0..6000 {
        let now = driven.time;
        command(
            motion,
            TwistAxes::World(UnitQuaternion::identity()),
            twist,
            now,
        );
        driven.step(motion);
        let now = status(motion);
        if seen.last() != Some(&now) {
            seen.push(now);
        }
        if done(driven, now) {
            break;
        }
    }
    seen
}

// Towards the outstretched arm: slower and slower, then a halt, and back out of it. The thresholds are those of the
// test's posture.
#[test]
fn the_tip_slows_down_before_singular_positions_and_may_leave_them() {
    let mut driven = Driven::at(&POSTURE);
    let mut resolver = TipResolver::new(driven.model(), &driven.tip, KeptTip::Pose, false);
    let start = resolver.condition(
        &driven.robot.state().q,
        fuyu_physics::control::commander::PathFrame::World,
    );
    let config = TwistServoConfig {
        lower_singularity_threshold: 1.5 * start,
        hard_stop_singularity_threshold: 3.0 * start,
        ..TwistServoConfig::default()
    };
    let mut motion = ArmMotion::Twist(Box::new(servo(&driven, config)));
    // Away from the shoulder.
    let away = driven.X_WE().translation.vector - Vector3::new(0.0, 0.0, 0.74);
    let out = Twist::new(Vector3::zeros(), away.normalize() * 0.05);
    let seen = drive(&mut driven, &mut motion, out, |driven, status| {
        status == TwistStatus::Halted && driven.robot.state().qd.norm() < 1e-3
            || (status == TwistStatus::Approaching && driven.robot.state().qd.norm() < 1e-3)
    });
    println!("{seen:?}");
    assert!(seen.contains(&TwistStatus::Approaching), "{seen:?}");
    let condition = resolver.condition(
        &driven.robot.state().q,
        fuyu_physics::control::commander::PathFrame::World,
    );
    assert!(condition < 3.1 * start, "{condition}, at the start {start}");
    assert!(condition > 2.0 * start, "{condition}, at the start {start}");
    let back = Twist::new(Vector3::zeros(), -out.linear);
    let seen = drive(&mut driven, &mut motion, back, |_, status| {
        status == TwistStatus::Following
    });
    println!("{seen:?}");
    assert!(seen.contains(&TwistStatus::Leaving) && seen.contains(&TwistStatus::Following));
}

#[test]
fn joints_slow_down_at_their_limits() {
    let mut driven = Driven::at(&POSTURE);
    let config = TwistServoConfig {
        lower_singularity_threshold: 1e6,
        hard_stop_singularity_threshold: 2e6,
        ..TwistServoConfig::default()
    };
    let mut motion = ArmMotion::Twist(Box::new(servo(&driven, config)));
    // Turning about the tip's axis moves the last joint above all.
    let mut bound = None;
    for _ in 0..3000 {
        let now = driven.time;
        let twist = Twist::new(Vector3::new(0.0, 0.0, 0.4), Vector3::zeros());
        let axes = TwistAxes::Robot(driven.tip.clone());
        command(&mut motion, axes, twist, now);
        driven.step(&mut motion);
        if let TwistStatus::JointBound(j) = status(&motion) {
            bound = Some(j);
        }
        for (q, joint) in driven.robot.state().q.iter().zip(driven.model().joints()) {
            assert!(*q < joint.limits.upper + 1e-3 && *q > joint.limits.lower - 1e-3);
        }
    }
    assert!(bound.is_some());
    assert!(driven.robot.state().qd.norm() < 0.01);
}

#[test]
fn fast_twists_are_cut_and_wrong_settings_refused() {
    let mut driven = Driven::at(&POSTURE);
    let mut motion = ArmMotion::Twist(Box::new(servo(&driven, TwistServoConfig::default())));
    command(
        &mut motion,
        TwistAxes::World(UnitQuaternion::identity()),
        linear(50.0, 0.0, 0.0),
        0.0,
    );
    driven.step(&mut motion);
    assert!(matches!(
        status(&motion),
        TwistStatus::TooFast | TwistStatus::RateLimit(_)
    ));
    let exchanged = TwistServoConfig {
        hard_stop_singularity_threshold: 10.0,
        ..TwistServoConfig::default()
    };
    let line = exchanged.check().unwrap_err().to_string();
    assert!(line.contains("hard_stop_singularity_threshold"), "{line}");
}
