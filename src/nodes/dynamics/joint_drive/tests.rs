use super::*;
use crate::{
    control::commander::JointSpline,
    dynamics::{Floating, IntegrationMethod, State},
    model::Model,
    nodes::dynamics::{free_body::Restorable as _, robot::RobotState},
};

/// Two links of 50 kg; the first joint has an effort limit of 5 N m, which accelerates it by about 0.02 rad/s².
fn robot() -> (Robot, JointDrive) {
    robot_with_effort_limit(5.0)
}

/// The same with another effort limit of the first joint \[N m\].
fn robot_with_effort_limit(effort: f64) -> (Robot, JointDrive) {
    let joint = r#"<joint name="joint1" type="continuous">"#;
    let urdf = include_str!("../../../../urdf/planar_two_link.urdf");
    let urdf = urdf.replace(
        joint,
        &format!(r#"{joint}<limit effort="{effort}" velocity="2"/>"#),
    );
    let model = Model::from_urdf(&urdf, "planar").unwrap();
    let state = State::at_rest(&model);
    let robot = Robot::from(Floating::new(model, state, IntegrationMethod::Rk4));
    let drive = JointDrive::new(&robot, &config(), &[]).unwrap();
    (robot, drive)
}

fn config() -> DriveConfig {
    DriveConfig {
        velocity: VelocityServoConfig {
            gains: ServoGains::Bandwidth(10.0),
            integral: 0.0,
        },
        position_bandwidth: 10.0,
    }
}

fn step(drive: &mut JointDrive, robot: &mut Robot, time: f64, seconds: f64, time_step: f64) {
    let mut none = ExternalWrenches::new(robot.model());
    drive.step(robot, &mut none, time, seconds, time_step);
}

#[test]
fn joints_without_a_new_effort_keep_theirs() {
    let (mut robot, mut drive) = robot();
    assert!(!drive.hold_efforts(&mut robot, [(0, 1.0), (1, 2.0)]));
    assert!(!drive.hold_efforts(&mut robot, [(1, -3.0)]));
    assert_eq!(robot.efforts().as_slice(), [1.0, -3.0]);
    assert!(drive.hold_efforts(&mut robot, [(0, 6.0)]));
    assert_eq!(robot.efforts().as_slice(), [5.0, -3.0]);
    // Clamping of an earlier command is not reported again.
    assert!(!drive.hold_efforts(&mut robot, [(1, 1.0)]));
}

// Would break if a command for one joint changed what another one does, or if an effort from before acted on a servo.
#[test]
fn each_joint_has_its_kind_of_command() {
    let (mut robot, mut drive) = robot();
    assert_eq!(drive.mode(), DriveMode::Effort);
    drive.hold_efforts(&mut robot, [(0, 0.2)]);
    drive.command(&mut robot, [(1, Setpoint::Position(0.3))]);
    assert_eq!(drive.mode(), DriveMode::Mixed);
    step(&mut drive, &mut robot, 0.0, 2.0, 0.01);
    let state = robot.state().clone();
    assert_eq!(robot.efforts()[0], 0.2);
    assert!((state.q[1] - 0.3).abs() < 1e-3, "{}", state.q);
    assert!(state.qd[0] > 1e-4);
    drive.drive_rates(&mut robot, [(0, 0.1)]);
    assert_eq!(drive.mode(), DriveMode::Mixed);
    step(&mut drive, &mut robot, 2.0, 2.0, 0.01);
    assert!((robot.state().qd[0] - 0.1).abs() < 1e-3);
    assert!((robot.state().q[1] - 0.3).abs() < 1e-3);
    drive.drive_rates(&mut robot, [(1, 0.0)]);
    assert_eq!(drive.mode(), DriveMode::Rate);
    drive.hold_efforts(&mut robot, [(0, 0.0), (1, 0.0)]);
    assert_eq!(drive.mode(), DriveMode::Effort);
}

// A distant position is approached without overshoot, no faster than the joint's limit and no faster than its effort
// can stop it. Without the second limit the weak joint swings about the position for minutes.
#[test]
fn a_position_is_driven_to_and_held() {
    let (mut robot, mut drive) = robot();
    drive.command(
        &mut robot,
        [(0, Setpoint::Position(1.0)), (1, Setpoint::Position(-0.5))],
    );
    assert_eq!(drive.mode(), DriveMode::Position);
    let mut most = 0.0f64;
    for i in 0..3000 {
        step(&mut drive, &mut robot, f64::from(i) * 0.01, 0.01, 0.01);
        most = most.max(robot.state().q[0]);
        assert!(robot.state().qd[0] < 2.1);
    }
    let state = robot.state();
    assert!(
        (state.q[0] - 1.0).abs() < 1e-4 && (state.q[1] + 0.5).abs() < 1e-4,
        "{}",
        state.q
    );
    assert!(most < 1.0 + 1e-3, "overshoot {}", most - 1.0);
    // Held positions are kept when commands end.
    drive.halt(&mut robot);
    step(&mut drive, &mut robot, 30.0, 1.0, 0.01);
    assert!((robot.state().q[0] - 1.0).abs() < 1e-4);
}

#[test]
fn without_commands_efforts_end_and_driven_joints_stop() {
    let (mut robot, mut drive) = robot();
    drive.hold_efforts(&mut robot, [(0, 1.0)]);
    drive.halt(&mut robot);
    assert_eq!(robot.efforts().as_slice(), [0.0, 0.0]);
    drive.drive_rates(&mut robot, [(0, 0.1), (1, 0.0)]);
    // The effort limit of 5 N m lets the joint accelerate only slowly.
    step(&mut drive, &mut robot, 0.0, 8.0, 0.01);
    assert!((robot.state().qd[0] - 0.1).abs() < 1e-3);
    drive.halt(&mut robot);
    assert_eq!(drive.mode(), DriveMode::Rate);
    step(&mut drive, &mut robot, 8.0, 8.0, 0.01);
    assert!(robot.state().qd[0].abs() < 1e-3);
}

// Would break if a motion that ends let go of the joints, or stopped them at once.
#[test]
fn a_motion_that_is_interrupted_ends_smoothly() {
    let (mut robot, mut drive) = robot_with_effort_limit(500.0);
    let to_rest = |rate: f64| JointPoint {
        rate,
        ..JointPoint::default()
    };
    // Joints that move at 0.05 rad/s are stopped by a motion...
    let mut state = robot.state().clone();
    state.qd.fill(0.05);
    robot.restore(&RobotState::Rigid(state));
    let stop = JointSpline::stop(robot.model(), 0.0, &[to_rest(0.05), to_rest(0.05)]);
    drive.begin(&robot, ArmMotion::Joints(stop), 0.0);
    assert_eq!(drive.mode(), DriveMode::Motion);
    let before = drive.motion_count();
    step(&mut drive, &mut robot, 0.0, 0.05, 0.01);
    let present = drive.current_motion(&robot);
    assert!((present[0].rate - robot.state().qd[0]).abs() < 5e-3);
    // ...which a command for the first joint ends.
    drive.drive_rates(&mut robot, [(0, 0.0)]);
    assert!(drive.motion_count() > before);
    assert_eq!(drive.mode(), DriveMode::Mixed);
    let rate = robot.state().qd[1];
    step(&mut drive, &mut robot, 0.05, 0.01, 0.01);
    let after = robot.state().qd[1];
    assert!(
        rate > 0.03 && after > 0.8 * rate && after < rate,
        "{rate} {after}"
    );
    step(&mut drive, &mut robot, 0.06, 2.0, 0.01);
    assert!(robot.state().qd[1].abs() < 1e-4);
}

// Would break if the joints were driven to references of an earlier motion, or to zero.
#[test]
fn a_motion_that_ends_before_its_first_step_moves_nothing() {
    let (mut robot, mut drive) = robot();
    let mut state = robot.state().clone();
    state.q = nalgebra::dvector![0.4, -0.7];
    robot.restore(&RobotState::Rigid(state));
    let present = drive.current_motion(&robot);
    let stop = JointSpline::stop(robot.model(), 0.0, &present);
    drive.begin(&robot, ArmMotion::Joints(stop), 0.0);
    assert_eq!(drive.current_motion(&robot), present);
    drive.halt(&mut robot);
    step(&mut drive, &mut robot, 0.0, 1.0, 0.01);
    assert!((robot.state().q[0] - 0.4).abs() < 1e-9 && (robot.state().q[1] + 0.7).abs() < 1e-9);
}

// A joint that cannot follow is stopped where it is, not led to where it should be.
#[test]
fn a_joint_that_has_lost_its_reference_stops_where_it_is() {
    let (mut robot, mut drive) = robot();
    let far = JointPoint {
        position: 1.0,
        ..JointPoint::default()
    };
    let there = JointSpline::stop(robot.model(), 0.0, &[far, JointPoint::default()]);
    drive.begin(&robot, ArmMotion::Joints(there), 0.0);
    step(&mut drive, &mut robot, 0.0, 0.01, 0.01);
    let before = robot.state().q[0];
    assert!(before.abs() < 0.1);
    drive.halt(&mut robot);
    step(&mut drive, &mut robot, 0.01, 5.0, 0.01);
    assert!(
        (robot.state().q[0] - before).abs() < 0.05,
        "{}",
        robot.state().q
    );
}

#[test]
fn the_servo_is_sampled_no_slower_than_it_bears() {
    let (mut robot, mut drive) = robot();
    drive.drive_rates(&mut robot, [(0, 0.1), (1, 0.0)]);
    // Twice the limit of stability: one sample per step would diverge.
    for i in 0..20 {
        step(&mut drive, &mut robot, f64::from(i) * 0.4, 0.4, 0.4);
    }
    // A proportional servo leaves an error that balances the Coriolis forces.
    assert!((robot.state().qd[0] - 0.1).abs() < 1e-3);
}

#[test]
fn rounding_does_not_add_a_step() {
    assert_eq!(step_count(0.1 + 0.2, 0.1), 3);
    assert_eq!(step_count(0.301, 0.1), 4);
    assert_eq!(step_count(0.0, 0.1), 1);
}

// Would break if anything but its goals moved a gripper, or if a gripper changed what the other joints do.
#[test]
fn a_gripper_moves_whatever_the_arm_does() {
    let (mut robot, _) = robot_with_effort_limit(1000.0);
    let params = GripperParams {
        name: "hand".to_owned(),
        joint: "joint2".to_owned(),
        max_effort: 300.0,
        max_velocity: 0.5,
        bandwidth: 20.0,
        goal_tolerance: 0.01,
        stall_velocity_threshold: 0.001,
        stall_timeout: 1.0,
        allow_stalling: false,
        close_at: Some(20.0),
        closed_position: -0.2,
    };
    let mut drive = JointDrive::new(&robot, &config(), std::slice::from_ref(&params)).unwrap();
    let finger = |robot: &Robot| (robot.state().q[1], robot.state().qd[1]);
    drive.set_gripper_goal(&robot, 0, GripperGoal::at(0.1));
    let all = [(0, Setpoint::Effort(0.01)), (1, Setpoint::Effort(2.0))];
    drive.command(&mut robot, all);
    assert_eq!(drive.mode(), DriveMode::Effort);
    step(&mut drive, &mut robot, 0.0, 4.0, 0.01);
    assert!(
        (finger(&robot).0 - 0.1).abs() < 1e-3,
        "{:?}",
        finger(&robot)
    );
    assert_eq!(robot.efforts()[0], 0.01);

    drive.drive_rates(&mut robot, [(0, 0.05), (1, 1.0)]);
    assert_eq!(drive.mode(), DriveMode::Rate);
    drive.set_gripper_goal(&robot, 0, GripperGoal::at(0.3));
    step(&mut drive, &mut robot, 4.0, 4.0, 0.01);
    assert!(
        (finger(&robot).0 - 0.3).abs() < 1e-3,
        "{:?}",
        finger(&robot)
    );
    assert!((robot.state().qd[0] - 0.05).abs() < 1e-3);

    let now = drive.current_motion(&robot);
    let stop = JointSpline::stop(robot.model(), 8.0, &now);
    drive.begin(&robot, ArmMotion::Joints(stop), 8.0);
    drive.set_gripper_goal(&robot, 0, GripperGoal::at(0.0));
    step(&mut drive, &mut robot, 8.0, 4.0, 0.01);
    assert_eq!(drive.mode(), DriveMode::Motion);
    assert!(finger(&robot).0.abs() < 1e-3, "{:?}", finger(&robot));
    assert!(robot.state().qd[0].abs() < 1e-3);

    drive.halt(&mut robot);
    drive.release(&mut robot);
    step(&mut drive, &mut robot, 12.0, 8.0, 0.01);
    assert!(finger(&robot).0.abs() < 1e-3, "{:?}", finger(&robot));
    // When it is time, it closes; at the first step, its effort is as large as it may be.
    step(&mut drive, &mut robot, 20.0, 0.01, 0.01);
    assert_eq!(robot.efforts()[1], -300.0);
    step(&mut drive, &mut robot, 20.01, 4.0, 0.01);
    assert!(
        (finger(&robot).0 + 0.2).abs() < 1e-3,
        "{:?}",
        finger(&robot)
    );
    drive.reset(&mut robot);
    assert_eq!(drive.grippers()[0].goal().position, 0.0);
}
