//! Splines of joint trajectories against closed forms, with the rules of ros2_control's joint_trajectory_controller.

use fuyu_physics::control::commander::{JointPoint, JointTrajectory, TrajectoryError, Waypoint};

use crate::drive::{POSTURE, model};

fn names(joints: &[&str]) -> Vec<String> {
    joints.iter().map(|&name| name.to_owned()).collect()
}

fn present() -> Vec<JointPoint> {
    let rest = |&position: &f64| JointPoint {
        position,
        ..JointPoint::default()
    };
    POSTURE.iter().map(rest).collect()
}

fn waypoint(time: f64, lists: [&[f64]; 3]) -> Waypoint {
    Waypoint {
        time,
        positions: lists[0].to_vec(),
        velocities: lists[1].to_vec(),
        accelerations: lists[2].to_vec(),
    }
}

// With positions only the joints move at constant rates between the points, once they have left the motion that they
// begin with. Would break with any smoother polynomial between points, or if the rate jumped at the start.
#[test]
fn positions_alone_are_joined_linearly() {
    let model = model();
    let points = vec![
        waypoint(2.0, [&[1.3], &[], &[]]),
        waypoint(3.0, [&[0.8], &[], &[]]),
    ];
    let trajectory = JointTrajectory::new(&model, &names(&["joint1"]), points).unwrap();
    let spline = trajectory.spline(&model, 10.0, 10.0, &present()).unwrap();
    let begin = spline.at(0, 10.0);
    assert_eq!((begin.position, begin.rate), (0.3, 0.0));
    let knot = spline.at(0, 12.0 - 1e-9);
    assert!((knot.position - 1.3).abs() < 1e-8 && (knot.rate - 0.5).abs() < 1e-8);
    for (time, position, rate) in [(12.5, 1.05, -0.5), (13.0, 0.8, 0.0), (99.0, 0.8, 0.0)] {
        let point = spline.at(0, time);
        assert!(
            (point.position - position).abs() < 1e-12,
            "{time}: {point:?}"
        );
        assert!((point.rate - rate).abs() < 1e-12 && point.acceleration.abs() < 1e-12);
    }
    assert_eq!(trajectory.duration(), 3.0);
}

// A cubic motion of a joint that begins at rest elsewhere is met from its first point on if rates are given, and
// sin(t), with accelerations, to the order of the quintic polynomial.
#[test]
fn rates_and_accelerations_raise_the_degree() {
    let model = model();
    let q = |t: f64| 0.1 * (t.powi(3) - 3.0 * t);
    let v = |t: f64| 0.3 * (t * t - 1.0);
    // The last point is at the minimum, where the joint rests.
    let points = [-1.0, -0.5, 0.1, 1.0].map(|t| waypoint(t + 2.0, [&[q(t)], &[v(t)], &[]]));
    let trajectory = JointTrajectory::new(&model, &names(&["joint3"]), points.to_vec()).unwrap();
    let spline = trajectory.spline(&model, 0.0, 0.0, &present()).unwrap();
    for i in 0..200 {
        let t = -1.0 + f64::from(i) * 0.01;
        let point = spline.at(2, t + 2.0);
        assert!((point.position - q(t)).abs() < 1e-12 && (point.rate - v(t)).abs() < 1e-12);
    }
    let h = 0.25;
    let end = std::f64::consts::FRAC_PI_2;
    let times: Vec<f64> = (0..=6).map(|i| end - h * f64::from(6 - i)).collect();
    let sine = times.iter().map(|&t| {
        let rate = if t == end { 0.0 } else { t.cos() };
        waypoint(t + 1.0, [&[t.sin()], &[rate], &[-t.sin()]])
    });
    let sine = JointTrajectory::new(&model, &names(&["joint3"]), sine.collect()).unwrap();
    let spline = sine.spline(&model, 0.0, 0.0, &present()).unwrap();
    for i in 0..150 {
        let t = times[0] + f64::from(i) * 0.01;
        let off = spline.at(2, t + 1.0).position - t.sin();
        // Error of quintic Hermite interpolation: h⁶/46080 times the sixth derivative, at most 1.
        assert!(off.abs() < 1.01 * h.powi(6) / 46080.0, "{t}: {off}");
    }
}

// A trajectory that replaces another begins with the motion of that moment: position, rate and, to a point with
// acceleration, acceleration.
#[test]
fn a_replaced_trajectory_continues_without_a_jump() {
    let model = model();
    let all = names(&[
        "joint1", "joint2", "joint3", "joint4", "joint5", "joint6", "joint7",
    ]);
    let rest = [0.0; 7];
    let goal = waypoint(2.0, [&[0.0, 1.0, 0.2, 1.0, 0.0, 1.0, 0.5], &rest, &rest]);
    let first = JointTrajectory::new(&model, &all, vec![goal]).unwrap();
    let first = first.spline(&model, 0.0, 0.0, &present()).unwrap();
    let at = |spline: &fuyu_physics::control::commander::JointSpline, t: f64| -> Vec<JointPoint> {
        (0..7).map(|j| spline.at(j, t)).collect()
    };
    let now = 0.8;
    let moving = at(&first, now);
    assert!(moving[0].rate.abs() > 0.1);
    // Only two joints get a new goal; the first point lies in the past, the others of them come to rest.
    let points = vec![
        waypoint(0.0, [&[9e-1, 0.0], &[0.0, 0.0], &[]]),
        waypoint(3.0, [&[0.5, -0.5], &[0.0, 0.0], &[0.0, 0.0]]),
    ];
    let second = JointTrajectory::new(&model, &names(&["joint7", "joint1"]), points).unwrap();
    let second = second.spline(&model, now, now, &moving).unwrap();
    for (j, (before, after)) in moving.iter().zip(at(&second, now)).enumerate() {
        assert!((before.position - after.position).abs() < 1e-12);
        assert!((before.rate - after.rate).abs() < 1e-12);
        assert!(
            (before.acceleration - after.acceleration).abs() < 1e-12,
            "{j}"
        );
    }
    let end = at(&second, 5.0);
    assert!((end[6].position - 0.5).abs() < 1e-12 && (end[0].position + 0.5).abs() < 1e-12);
    assert_eq!(end[3].rate, 0.0);
    // They stop within the way of a braking joint, not at the old goal.
    assert!((end[3].position - moving[3].position).abs() < 0.2);
}

// A stamp in the past drops the points that are over; a continuous joint takes the shorter way.
#[test]
fn stamps_and_turns() {
    let model = model();
    let point = |t: f64, q: f64| waypoint(t, [&[q], &[], &[]]);
    let points = vec![point(1.0, 0.1), point(2.0, 0.2), point(4.0, 0.4)];
    let trajectory = JointTrajectory::new(&model, &names(&["joint1"]), points).unwrap();
    let spline = trajectory.spline(&model, 0.0, 2.0, &present()).unwrap();
    // From rest at 0.3, where the joint is, to 0.4 in two seconds: half of the way less (0.05 rad/s)(1 s)/4.
    assert!((spline.at(0, 3.0).position - (0.35 - 0.0125)).abs() < 1e-12);
    let refused = trajectory.spline(&model, 0.0, 4.0, &present()).unwrap_err();
    assert_eq!(refused, TrajectoryError::Past { end: 4.0, now: 4.0 });
    assert!(
        refused
            .to_string()
            .contains("ends at 4.000 s, but it is 4.000 s already")
    );
    // As MoveIt plans to where the arm is: one point, now.
    let there = vec![point(0.0, 0.5)];
    let there = JointTrajectory::new(&model, &names(&["joint1"]), there).unwrap();
    let spline = there.spline(&model, 4.0, 4.0, &present()).unwrap();
    assert!(spline.end() > 4.2 && spline.end() < 6.0);
    let end = spline.at(0, spline.end());
    assert!((end.position - 0.5).abs() < 1e-12 && end.rate == 0.0);
    let refused = there.spline(&model, 3.0, 4.0, &present());
    assert!(matches!(refused, Err(TrajectoryError::Past { .. })));

    let xml = include_str!("../../../../urdf/planar_two_link.urdf");
    let planar = fuyu_physics::model::Model::from_urdf(xml, "planar").unwrap();
    let turned = [7.0, 0.0].map(|position| JointPoint {
        position,
        ..JointPoint::default()
    });
    let trajectory =
        JointTrajectory::new(&planar, &names(&["joint1"]), vec![point(1.0, 0.5)]).unwrap();
    let spline = trajectory.spline(&planar, 0.0, 0.0, &turned).unwrap();
    assert!((spline.at(0, 1.0).position - (0.5 + std::f64::consts::TAU)).abs() < 1e-12);
}
