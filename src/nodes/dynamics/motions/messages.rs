//! Validation and conversion of messages that command motions.

use crate::{
    control::commander::{
        JointTrajectory, PathFrame, PosePath, StateTolerance, TimedPose, TrajectoryTolerances,
        Waypoint,
    },
    model::Model,
    msg::{
        builtin_interfaces,
        control_msgs::{JointTolerance, follow_joint_trajectory::Goal},
        geometry_msgs::TwistStamped,
        nav_msgs, trajectory_msgs,
    },
    nodes::{
        dynamics::{messages::WORLD, params::MotionParams},
        geometry::{pose_from_msg, vector_from_msg, with_matrix},
    },
    spatial::Twist,
};

/// Maximum number of points of a trajectory, and of poses of a path.
const MOST: usize = 100_000;

fn seconds(duration: &builtin_interfaces::Duration) -> f64 {
    f64::from(duration.sec) + f64::from(duration.nanosec) * 1e-9
}

/// Longest time that a motion may wait for its start \[s\].
const LONGEST_WAIT: f64 = 86_400.0;

/// Start of a motion \[s\]: its stamp, or `now` if the stamp is zero.
fn start_of(stamp: &builtin_interfaces::Time, now: f64) -> Result<f64, String> {
    let start = match stamp.nanos() {
        0 => now,
        _ => stamp.seconds(),
    };
    match start > now + LONGEST_WAIT {
        true => Err(format!(
            "begins at {start:.3} s, and simulated time is {now:.3} s; set use_sim_time, or leave the stamp zero to start at once"
        )),
        false => Ok(start),
    }
}

/// Names of the robot's links, for a message.
pub fn link_names(model: &Model) -> String {
    let names: Vec<_> = model.frames().iter().map(|f| f.name.as_str()).collect();
    names.join(", ")
}

/// A trajectory and its start time \[s\].
///
/// # Errors
/// The mistake, as a phrase that completes "the message ...".
pub fn trajectory(
    message: &trajectory_msgs::JointTrajectory,
    model: &Model,
    now: f64,
) -> Result<(JointTrajectory, f64), String> {
    if message.points.len() > MOST {
        let count = message.points.len();
        return Err(format!("has {count} points; send at most {MOST}"));
    }
    if let Some(i) = message.points.iter().position(|p| !p.effort.is_empty()) {
        return Err(format!(
            "gives efforts in point {}; leave effort empty, it follows from the motion",
            i + 1
        ));
    }
    let waypoints = message.points.iter().map(|point| Waypoint {
        time: seconds(&point.time_from_start),
        positions: point.positions.clone(),
        velocities: point.velocities.clone(),
        accelerations: point.accelerations.clone(),
    });
    let trajectory = JointTrajectory::new(model, &message.joint_names, waypoints.collect())
        .map_err(|e| e.to_string())?;
    Ok((trajectory, start_of(&message.header.stamp, now)?))
}

/// The tolerances of a goal for the joints of its trajectory.
///
/// # Errors
/// The mistake, as a phrase that completes "the goal ...".
pub fn tolerances(
    goal: &Goal,
    model: &Model,
    params: &MotionParams,
) -> Result<TrajectoryTolerances, String> {
    if !goal.multi_dof_trajectory.joint_names.is_empty()
        || !goal.multi_dof_trajectory.points.is_empty()
    {
        return Err("has a multi_dof_trajectory; the robot's joints have one degree of freedom, use trajectory".to_owned());
    }
    if !goal.component_path_tolerance.is_empty() || !goal.component_goal_tolerance.is_empty() {
        return Err("has component tolerances; the robot's joints have one degree of freedom, use path_tolerance and goal_tolerance".to_owned());
    }
    let names = &goal.trajectory.joint_names;
    let time = seconds(&goal.goal_time_tolerance);
    let goal_time = match time {
        0.0 => params.goal_time,
        time if time < 0.0 => 0.0,
        time => time,
    };
    Ok(TrajectoryTolerances {
        path: of_joints(
            "path_tolerance",
            &goal.path_tolerance,
            (names, model),
            params.path,
        )?,
        goal: of_joints(
            "goal_tolerance",
            &goal.goal_tolerance,
            (names, model),
            params.goal,
        )?,
        goal_time,
    })
}

/// Tolerances of the joints in `names`: those given, otherwise the default. Tolerances of the robot's other joints are
/// ignored.
fn of_joints(
    field: &str,
    given: &[JointTolerance],
    (names, model): (&[String], &Model),
    default: StateTolerance,
) -> Result<Vec<StateTolerance>, String> {
    let mut tolerances = vec![default; names.len()];
    for JointTolerance {
        name,
        position,
        velocity,
        acceleration,
    } in given
    {
        let Some(j) = names.iter().position(|joint| joint == name) else {
            if model.joint_index(name).is_some() {
                continue;
            }
            return Err(format!(
                "names joint '{name}' in {field}; the trajectory has {}",
                names.join(", ")
            ));
        };
        let one = |what: &str, value: f64, default: f64| match value {
            0.0 => Ok(default),
            -1.0 => Ok(0.0),
            value if value > 0.0 && value.is_finite() => Ok(value),
            value => Err(format!(
                "gives joint '{name}' the {what} {value} in {field}; give a positive number, 0 for the default or -1 for none"
            )),
        };
        let tolerance = &mut tolerances[j];
        tolerance.position = one("position", *position, default.position)?;
        tolerance.rate = one("velocity", *velocity, default.rate)?;
        tolerance.acceleration = one("acceleration", *acceleration, default.acceleration)?;
    }
    Ok(tolerances)
}

/// A path of the tip and its start time \[s\]. The times of its poses are their stamps minus the path's stamp.
///
/// # Errors
/// The mistake, as a phrase that completes "the message ...".
pub fn path(message: &nav_msgs::Path, base: &str, now: f64) -> Result<(PosePath, f64), String> {
    let frame_id = message.header.frame_id.as_str();
    let frame = match frame_id {
        "" | WORLD => PathFrame::World,
        name if name == base => PathFrame::Base,
        name => return Err(format!("has frame_id '{name}'; give world or {base}")),
    };
    if message.poses.len() > MOST {
        let count = message.poses.len();
        return Err(format!("has {count} poses; send at most {MOST}"));
    }
    let zero = message.header.stamp.nanos();
    let poses = message.poses.iter().enumerate().map(|(i, pose)| {
        let number = i + 1;
        let of_pose = pose.header.frame_id.as_str();
        if !of_pose.is_empty() && of_pose != frame_id {
            return Err(format!(
                "has pose {number} in frame '{of_pose}', but its own frame_id is '{frame_id}'; give all poses in one frame"
            ));
        }
        let X = pose_from_msg(&pose.pose).map_err(|e| format!("has a wrong pose {number}: {e}"))?;
        Ok(TimedPose {
            time: (pose.header.stamp.nanos() - zero) as f64 * 1e-9,
            pose: with_matrix(&X),
        })
    });
    let poses = poses.collect::<Result<_, _>>()?;
    let path = PosePath::new(frame, poses).map_err(|e| e.to_string())?;
    Ok((path, start_of(&message.header.stamp, now)?))
}

/// A twist of the tip.
///
/// # Errors
/// The mistake, as a phrase that completes "the message ...".
pub fn twist(message: &TwistStamped, now: f64, timeout: f64) -> Result<Twist, String> {
    let parts = [
        ("linear", vector_from_msg(&message.twist.linear)),
        ("angular", vector_from_msg(&message.twist.angular)),
    ];
    for (name, part) in parts {
        for (axis, value) in ["x", "y", "z"].iter().zip(part.iter()) {
            // This is false for NaN, too.
            let is_valid = value.abs() <= 1e6;
            if !is_valid {
                return Err(format!(
                    "gives twist.{name}.{axis} {value}; it must be finite and at most 1e6"
                ));
            }
        }
    }
    let stamp = &message.header.stamp;
    let age = now - stamp.seconds();
    if stamp.nanos() != 0 && age > timeout {
        return Err(format!(
            "is {age:.2} s old by its stamp; twists act for {timeout} s (twist_servo.incoming_command_timeout)"
        ));
    }
    Ok(Twist::new(parts[1].1, parts[0].1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::msg::{
        geometry_msgs::{Pose, PoseStamped, Quaternion},
        trajectory_msgs::JointTrajectoryPoint,
    };

    fn params() -> MotionParams {
        MotionParams {
            interfaces: true,
            tip_link: String::new(),
            path: StateTolerance::default(),
            goal: StateTolerance {
                position: 0.02,
                rate: 0.01,
                acceleration: 0.0,
            },
            goal_time: 2.0,
            twist: Default::default(),
            wrench_timeout: 0.5,
        }
    }

    fn tolerance(name: &str, position: f64) -> JointTolerance {
        JointTolerance {
            name: name.to_owned(),
            position,
            ..JointTolerance::default()
        }
    }

    // The rules of control_msgs/JointTolerance: 0 is the default, -1 none.
    #[test]
    fn tolerances_of_a_goal_replace_the_defaults() {
        let xml = include_str!("../../../../urdf/planar_two_link.urdf");
        let model = Model::from_urdf(xml, "planar").unwrap();
        let mut goal = Goal::default();
        goal.trajectory.joint_names = vec!["a".into(), "b".into(), "c".into()];
        goal.goal_tolerance = vec![tolerance("c", 0.5), tolerance("b", -1.0)];
        // joint1 is a joint of the robot that the goal does not move.
        goal.path_tolerance = vec![tolerance("a", 0.1), tolerance("joint1", 0.1)];
        let found = tolerances(&goal, &model, &params()).unwrap();
        let positions =
            |list: &[StateTolerance]| -> Vec<f64> { list.iter().map(|t| t.position).collect() };
        assert_eq!(positions(&found.goal), [0.02, 0.0, 0.5]);
        assert_eq!(positions(&found.path), [0.1, 0.0, 0.0]);
        assert_eq!((found.goal[2].rate, found.goal_time), (0.01, 2.0));
        goal.goal_time_tolerance.sec = -1;
        assert_eq!(tolerances(&goal, &model, &params()).unwrap().goal_time, 0.0);
        for (wrong, expected) in [
            (
                tolerance("d", 0.1),
                "'d' in goal_tolerance; the trajectory has a, b, c",
            ),
            (tolerance("a", -0.5), "the position -0.5"),
            (tolerance("a", f64::NAN), "the position NaN"),
        ] {
            goal.goal_tolerance = vec![wrong];
            let line = tolerances(&goal, &model, &params()).unwrap_err();
            assert!(line.contains(expected), "{line}");
        }
        goal.goal_tolerance.clear();
        goal.multi_dof_trajectory.joint_names = vec!["base".into()];
        assert!(
            tolerances(&goal, &model, &params())
                .unwrap_err()
                .contains("multi_dof")
        );
    }

    #[test]
    fn efforts_of_a_trajectory_are_refused() {
        let xml = include_str!("../../../../urdf/planar_two_link.urdf");
        let model = Model::from_urdf(xml, "planar").unwrap();
        let mut message = trajectory_msgs::JointTrajectory {
            joint_names: vec!["joint1".into()],
            points: vec![JointTrajectoryPoint {
                positions: vec![0.1],
                effort: vec![1.0],
                ..JointTrajectoryPoint::default()
            }],
            ..trajectory_msgs::JointTrajectory::default()
        };
        let refused = trajectory(&message, &model, 3.0).unwrap_err();
        assert!(refused.contains("efforts in point 1"));
        message.points[0].effort.clear();
        assert_eq!(trajectory(&message, &model, 3.0).unwrap().1, 3.0);
        message.header.stamp.sec = 7;
        assert_eq!(trajectory(&message, &model, 3.0).unwrap().1, 7.0);
    }

    fn pose(sec: i32, frame_id: &str) -> PoseStamped {
        let mut stamped = PoseStamped {
            pose: Pose {
                orientation: Quaternion {
                    w: 1.0,
                    ..Quaternion::default()
                },
                ..Pose::default()
            },
            ..PoseStamped::default()
        };
        stamped.header.stamp.sec = sec;
        stamped.header.frame_id = frame_id.to_owned();
        stamped
    }

    #[test]
    fn poses_of_a_path_are_timed_by_their_stamps() {
        let mut message = nav_msgs::Path {
            poses: vec![pose(1, ""), pose(3, "base_link")],
            ..nav_msgs::Path::default()
        };
        message.header.frame_id = "base_link".to_owned();
        let (found, start) = path(&message, "base_link", 5.0).unwrap();
        assert_eq!(
            (found.frame(), found.duration(), start),
            (PathFrame::Base, 3.0, 5.0)
        );
        // If the path has a stamp, the stamp is its start.
        message.header.stamp.sec = 1;
        let (found, start) = path(&message, "base_link", 5.0).unwrap();
        assert_eq!((found.duration(), start), (2.0, 1.0));
        let refusal = |message: &nav_msgs::Path| path(message, "base_link", 0.0).unwrap_err();
        message.poses[1].header.frame_id = "world".to_owned();
        assert!(refusal(&message).contains("pose 2 in frame 'world'"));
        message.header.frame_id = "map".to_owned();
        assert!(refusal(&message).contains("'map'; give world or base_link"));
        message.header.frame_id = String::new();
        message.poses = vec![pose(2, "")];
        message.poses[0].pose.orientation.w = 0.0;
        assert!(refusal(&message).contains("wrong pose 1: orientation"));
    }

    #[test]
    fn invalid_and_old_twists_are_refused() {
        let mut message = TwistStamped::default();
        message.twist.linear.x = 0.5;
        assert_eq!(twist(&message, 9.0, 0.1).unwrap().linear.x, 0.5);
        message.header.stamp.sec = 8;
        assert!(
            twist(&message, 9.0, 0.1)
                .unwrap_err()
                .contains("1.00 s old")
        );
        message.twist.angular.z = f64::NAN;
        assert!(
            twist(&message, 8.0, 0.1)
                .unwrap_err()
                .contains("twist.angular.z NaN")
        );
    }
}
