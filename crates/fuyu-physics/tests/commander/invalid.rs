//! Invalid trajectories are refused with a line that says what is wrong.

use fuyu_physics::control::commander::{JointTrajectory, Waypoint};

use crate::drive::model;

/// Names, points (time, positions, velocities), and part of the line.
type Case<'a> = (&'a [&'a str], &'a [(f64, &'a [f64], &'a [f64])], &'a str);

fn refusal(names: &[&str], points: &[(f64, &[f64], &[f64])]) -> String {
    let names: Vec<String> = names.iter().map(|&n| n.to_owned()).collect();
    let points = points.iter().map(|(time, positions, velocities)| Waypoint {
        time: *time,
        positions: positions.to_vec(),
        velocities: velocities.to_vec(),
        ..Waypoint::default()
    });
    let refused = JointTrajectory::new(&model(), &names, points.collect());
    let line = refused.unwrap_err().to_string();
    assert!(!line.contains('\n'));
    line
}

#[test]
fn invalid_trajectories_are_refused_with_the_reason() {
    let one: &[(f64, &[f64], &[f64])] = &[(1.0, &[0.1], &[])];
    let cases: &[Case<'_>] = &[
        (
            &["elbow"],
            one,
            "joint 'elbow'; the robot has joint1, joint2",
        ),
        (&[], one, "names no joint; expected some of joint1"),
        (&["joint1", "joint1"], one, "names joint 'joint1' twice"),
        (&["joint1"], &[], "has no points"),
        (
            &["joint1"],
            &[(1.0, &[], &[])],
            "point 1 has 0 positions for 1 joints",
        ),
        (
            &["joint1"],
            &[(1.0, &[0.0], &[0.0, 0.0])],
            "point 1 has 2 velocities for 1 joints",
        ),
        (
            &["joint1"],
            &[(1.0, &[f64::NAN], &[])],
            "joint 'joint1' NaN in positions",
        ),
        (
            &["joint1"],
            &[(1.0, &[0.0], &[f64::INFINITY])],
            "joint 'joint1' inf in velocities",
        ),
        (
            &["joint1"],
            &[(1.0, &[0.1], &[]), (1.0, &[0.2], &[])],
            "point 2 is at 1 s, not after",
        ),
        (
            &["joint1"],
            &[(2.0, &[0.1], &[]), (1.0, &[0.2], &[])],
            "times must increase",
        ),
        (&["joint1"], &[(-1.0, &[0.1], &[])], "point 1 is at -1 s"),
        (
            &["joint1"],
            &[(f64::NAN, &[0.1], &[])],
            "point 1 is at NaN s",
        ),
        (
            &["joint2"],
            &[(1.0, &[2.5], &[])],
            "'joint2' to 2.5, beyond its limits -2.1 to 2.1",
        ),
        (
            &["joint1"],
            &[(1.0, &[0.1], &[0.3])],
            "joint 'joint1' moves at 0.3",
        ),
    ];
    for (names, points, expected) in cases {
        let line = refusal(names, points);
        assert!(line.contains(expected), "{line}");
    }
}
