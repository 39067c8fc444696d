//! Commanders with the usual tools: clients of `follow_joint_trajectory`, trajectories, paths, twists and positions,
//! from a real rclpy node, on an arm of seven joints.

use fuyu::{
    dynamics::Workspace,
    model::Model,
    msg::geometry_msgs,
    nodes::geometry::{pose_from_msg, with_matrix},
    spatial::Pose,
};
use nalgebra::{DVector, Translation3, UnitQuaternion};
use serde_json::{Value, json};
use std::{
    fs, thread,
    time::{Duration, Instant},
};

use crate::{
    joining::peer_with_interfaces,
    lateness::repeat_if_late,
    observer::{DIAGNOSTICS, JOINT_STATE, ODOMETRY, fresh, now, numbers, reported},
    peer::Peer,
    process::{Running, command, source},
    waiting::{PATIENCE, eventually},
};

const JOINTS: [&str; 7] = [
    "joint1", "joint2", "joint3", "joint4", "joint5", "joint6", "joint7",
];
/// A posture with a bent elbow \[rad\].
pub const POSTURE: [f64; 7] = [0.3, 0.6, -0.2, 1.4, 0.2, 0.9, 0.1];
pub const GOAL: [f64; 7] = [-0.5, 0.9, 0.4, 1.0, -0.4, 1.2, 0.6];

pub const ACTION: &str = "control_msgs/action/FollowJointTrajectory";
pub const TRAJECTORY: &str = "trajectory_msgs/msg/JointTrajectory";
const PATH: &str = "nav_msgs/msg/Path";
const TWIST: &str = "geometry_msgs/msg/TwistStamped";

// Codes of the action.
pub const SUCCEEDED: u64 = 4;
const CANCELED: u64 = 5;
pub const ABORTED: u64 = 6;
const PATH_TOLERANCE_VIOLATED: i64 = -4;
const GOAL_TOLERANCE_VIOLATED: i64 = -5;

/// The dynamics node with the arm, and a peer.
pub struct Session {
    pub dynamics: Running,
    pub peer: Peer,
}

impl Session {
    pub fn start(domain: u16) -> Self {
        Self::start_with(domain, &[])
    }

    /// The same with further parameters.
    pub fn start_with(domain: u16, parameters: &[&str]) -> Self {
        let mut dynamics = command("dynamics", domain);
        let posture = format!("initial_joint_positions:={POSTURE:?}");
        dynamics
            .args([
                "--ros-args",
                "-p",
                "urdf:=package://fuyu/urdf/seven_joints.urdf",
            ])
            .args(["-p", &posture]);
        for parameter in parameters {
            dynamics.args(["-p", parameter]);
        }
        let dynamics = Running::start(dynamics);
        let mut peer = peer_with_interfaces("commander", domain);
        peer.subscribe("joint_states", JOINT_STATE, "reliable");
        peer.subscribe("ground_truth/odom", ODOMETRY, "reliable");
        peer.subscribe("diagnostics", DIAGNOSTICS, "reliable");
        Self { dynamics, peer }
    }

    pub fn act(&mut self, goal: &Value, cancel_after: Option<u64>) -> Value {
        self.peer.does(json!({
            "do": "act", "action": "follow_joint_trajectory", "type": ACTION, "goal": goal, "cancel_after": cancel_after,
        }))
    }

    pub fn publish(&mut self, topic: &str, kind: &str, message: &Value) {
        (self.peer)
            .does(json!({"do": "publish", "topic": topic, "type": kind, "message": message}));
    }

    /// Joint positions and rates now.
    pub fn joints(&mut self) -> (Vec<f64>, Vec<f64>) {
        let state = fresh(&mut self.peer, "joint_states", 1).pop().expect("one");
        (numbers(&state["position"]), numbers(&state["velocity"]))
    }

    /// Waits until the joints are at `goal` and rest.
    pub fn arrives(&mut self, goal: &[f64], within: f64) {
        eventually(&format!("the joints at {goal:?}"), 3 * PATIENCE, || {
            let (q, qd) = self.joints();
            let off = q.iter().zip(goal).map(|(q, g)| (q - g).abs());
            let rate = qd.iter().map(|v| v.abs()).fold(0.0, f64::max);
            (off.fold(0.0, f64::max) < within && rate < 1e-3).then_some(())
        });
    }

    /// Waits for a report of the `part` of the node that contains `words`.
    pub fn reports(&mut self, part: &str, since: f64, words: &str) {
        let part = format!("dynamics: {part}");
        eventually(&format!("{words:?} in {part}"), PATIENCE, || {
            let contains = |level: u64, text: &str| level >= 1 && text.contains(words);
            reported(&mut self.peer, &part, since, 0.0, contains)
        });
    }

    /// Poses of the base in the world and of the tip in the base frame, of a robot at rest.
    fn tip(&mut self) -> (Pose, Pose) {
        let xml = fs::read_to_string(source("urdf/seven_joints.urdf")).expect("the robot");
        let model = Model::from_urdf(&xml, "seven_joints").expect("a robot");
        let mut workspace = Workspace::new(&model);
        workspace.set_positions(&DVector::from_vec(self.joints().0));
        let odom = fresh(&mut self.peer, "ground_truth/odom", 1).pop();
        let pose = odom.expect("one")["pose"]["pose"].clone();
        let base: geometry_msgs::Pose = serde_json::from_value(pose).expect("a pose");
        let X_WB = with_matrix(&pose_from_msg(&base).expect("a sound pose"));
        (X_WB, workspace.X_BF(model.frame("tool0").expect("the tip")))
    }

    /// Sends a path in `frame` through `poses` at times \[s\].
    fn follow(&mut self, frame: &str, poses: &[(f64, Pose)]) {
        let stamped = |(seconds, X): &(f64, Pose)| {
            let (p, q) = (X.translation.vector, UnitQuaternion::from(X.rotation));
            json!({
                "header": {"stamp": duration(*seconds)},
                "pose": {"position": {"x": p.x, "y": p.y, "z": p.z}, "orientation": {"x": q.i, "y": q.j, "z": q.k, "w": q.w}},
            })
        };
        let poses: Vec<_> = poses.iter().map(stamped).collect();
        let path = json!({"header": {"frame_id": frame}, "poses": poses});
        self.publish("cartesian_path", PATH, &path);
    }

    /// Attitude of the base: the angle from that at the start, which is none \[rad\].
    pub fn base_turn(&mut self) -> f64 {
        let odom = fresh(&mut self.peer, "ground_truth/odom", 1)
            .pop()
            .expect("one");
        let w = odom["pose"]["pose"]["orientation"]["w"]
            .as_f64()
            .expect("a number");
        2.0 * w.abs().min(1.0).acos()
    }
}

pub fn duration(seconds: f64) -> Value {
    let nanos = (seconds * 1e9).round() as i64;
    json!({"sec": nanos / 1_000_000_000, "nanosec": nanos % 1_000_000_000})
}

/// A point of a trajectory at rest.
pub fn at_rest(seconds: f64, positions: &[f64]) -> Value {
    json!({
        "positions": positions, "velocities": vec![0.0; positions.len()], "time_from_start": duration(seconds),
    })
}

/// What MoveIt sends: positions, velocities and accelerations every 0.2 s.
pub fn moveit(from: &[f64], to: &[f64], seconds: f64) -> Value {
    let count = (seconds / 0.2).round() as usize;
    let point = |i: usize| {
        let s = i as f64 / count as f64;
        let scaled = |factor: f64| -> Vec<f64> {
            from.iter().zip(to).map(|(a, b)| (b - a) * factor).collect()
        };
        let way = scaled(s.powi(3) * (10.0 - 15.0 * s + 6.0 * s * s));
        json!({
            "positions": from.iter().zip(way).map(|(a, way)| a + way).collect::<Vec<_>>(),
            "velocities": scaled(30.0 * (s * (1.0 - s)).powi(2) / seconds),
            "accelerations": scaled(60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / (seconds * seconds)),
            "time_from_start": duration(seconds * s),
        })
    };
    let points: Vec<_> = (0..=count).map(point).collect();
    json!({"joint_names": JOINTS, "points": points})
}

pub fn tolerances(position: f64) -> Value {
    let of = |name: &&str| json!({"name": name, "position": position});
    JOINTS.iter().map(of).collect()
}

/// Largest element of a list of every feedback.
fn largest(outcome: &Value, part: &str, list: &str) -> f64 {
    let feedback = outcome["feedback"].as_array().expect("a list");
    let values = feedback.iter().flat_map(|f| numbers(&f[part][list]));
    values.fold(0.0, |most, value| value.abs().max(most))
}

// A client as MoveIt's: acceptance, feedback, result, cancellation, violated tolerances, replacement, and goals that
// are refused. Would break with a server of other codes or types, or if the arm were let go at the end.
#[test]
fn clients_of_follow_joint_trajectory_move_the_arm() {
    repeat_if_late(|| {
        let mut session = Session::start(116);
        let goal = json!({
            "trajectory": moveit(&POSTURE, &GOAL, 4.0),
            "path_tolerance": tolerances(0.02), "goal_tolerance": tolerances(0.005),
            "goal_time_tolerance": duration(1.0),
        });
        let done = session.act(&goal, None);
        assert_eq!(done["status"], SUCCEEDED, "{}", done["result"]);
        assert_eq!(done["result"]["error_code"], 0, "{}", done["result"]);
        let (error, rate) = (
            largest(&done, "error", "positions"),
            largest(&done, "actual", "velocities"),
        );
        let count = done["feedback"].as_array().expect("a list").len();
        println!(
            "{count} feedbacks, largest error {error:.1e} rad, base turned {:.4} rad",
            session.base_turn()
        );
        assert!(
            count > 40 && error < 2e-4 && rate > 0.2,
            "{count} {error} {rate}"
        );
        assert_eq!(done["feedback"][0]["joint_names"], json!(JOINTS));
        session.arrives(&GOAL, 1e-3);

        // Cancelled on its way, the arm comes to rest there, and stays.
        let back = json!({"trajectory": moveit(&GOAL, &POSTURE, 8.0)});
        let cancelled = session.act(&back, Some(60));
        assert_eq!(
            (cancelled["status"].clone(), cancelled["cancelled"].clone()),
            (json!(CANCELED), json!(0))
        );
        eventually("rest", PATIENCE, || {
            let (_, qd) = session.joints();
            qd.iter().all(|v| v.abs() < 1e-3).then_some(())
        });
        let (q, _) = session.joints();
        assert!(
            (q[0] - GOAL[0]).abs() > 0.05 && (q[0] - POSTURE[0]).abs() > 0.05,
            "{q:?}"
        );

        // Too fast for the arm: the path is violated. The joints are stopped.
        let mut fast = json!({"joint_names": ["joint2"], "points": [at_rest(0.3, &[q[1] - 2.0])]});
        let outcome = session.act(
            &json!({
                "trajectory": fast, "path_tolerance": [{"name": "joint2", "position": 0.05}],
            }),
            None,
        );
        assert_eq!(outcome["status"], ABORTED, "{}", outcome["result"]);
        assert_eq!(outcome["result"]["error_code"], PATH_TOLERANCE_VIOLATED);
        let said = outcome["result"]["error_string"].as_str().expect("a text");
        println!("{said}");
        assert!(said.contains("joint 'joint2': position error") && said.contains("tolerance 0.05"));
        // The same with a tolerance of the goal only, which is not reached in time.
        fast["points"][0]["positions"][0] = json!(q[1] - 1.5);
        let outcome = session.act(
            &json!({
                "trajectory": fast, "goal_tolerance": [{"name": "joint2", "position": 1e-9}],
                "goal_time_tolerance": duration(0.1),
            }),
            None,
        );
        assert_eq!(
            outcome["result"]["error_code"], GOAL_TOLERANCE_VIOLATED,
            "{}",
            outcome["result"]
        );

        // Some joints only: the others stay.
        eventually("rest", PATIENCE, || {
            let (_, qd) = session.joints();
            qd.iter().all(|v| v.abs() < 1e-3).then_some(())
        });
        let (mut q, _) = session.joints();
        let part =
            json!({"joint_names": ["joint6", "joint1"], "points": [at_rest(2.0, &[0.7, 0.1])]});
        let outcome = session.act(&json!({"trajectory": part}), None);
        assert_eq!(outcome["status"], SUCCEEDED, "{}", outcome["result"]);
        (q[0], q[5]) = (0.1, 0.7);
        session.arrives(&q, 1e-3);

        // Another client's goal replaces the present one, which ends at once.
        let mut other = peer_with_interfaces("other_commander", 116);
        let slow = json!({"trajectory": moveit(&q, &GOAL, 20.0)});
        let begin = Instant::now();
        let replaced = thread::scope(|scope| {
            let slow = scope.spawn(|| session.act(&slow, None));
            thread::sleep(Duration::from_secs(2));
            let quick = json!({"trajectory": {"joint_names": ["joint7"], "points": [at_rest(1.0, &[0.0])]}});
            let outcome = other.does(json!({
                "do": "act", "action": "follow_joint_trajectory", "type": ACTION, "goal": quick,
            }));
            assert_eq!(outcome["status"], SUCCEEDED, "{}", outcome["result"]);
            slow.join().expect("an outcome")
        });
        assert_eq!(replaced["status"], ABORTED, "{}", replaced["result"]);
        assert_eq!(
            replaced["result"]["error_string"],
            "it is replaced by another goal"
        );
        assert!(begin.elapsed() < Duration::from_secs(15));

        refusals(&mut session);
        session.dynamics.interrupt().well();
    });
}

/// Goals that are refused, each with a line in `diagnostics` and in the log.
fn refusals(session: &mut Session) {
    let one = |names: &[&str], points: Value| json!({"joint_names": names, "points": points});
    let point = || at_rest(1.0, &[0.1]);
    for (trajectory, words) in [
        (
            one(&["elbow"], json!([point()])),
            "it names joint 'elbow'; the robot has joint1",
        ),
        (one(&[], json!([])), "it names no joint"),
        (one(&["joint1"], json!([])), "it has no points"),
        (
            one(&["joint1"], json!([point(), point()])),
            "point 2 is at 1 s, not after",
        ),
        (
            one(&["joint1"], json!([at_rest(2.0, &[0.1]), point()])),
            "times must increase",
        ),
        (
            one(
                &["joint1"],
                json!([{"positions": [null], "time_from_start": duration(1.0)}]),
            ),
            "gives joint 'joint1' NaN in positions",
        ),
        (
            one(&["joint1"], json!([at_rest(1.0, &[0.1, 0.2])])),
            "2 positions for 1 joints",
        ),
        (
            one(&["joint1"], json!([at_rest(1.0, &[9.0])])),
            "beyond its limits -2.9 to 2.9",
        ),
    ] {
        let since = now();
        let refused = session.act(&json!({"trajectory": trajectory}), None);
        assert_eq!(refused, json!({"accepted": false}), "{trajectory}");
        session.reports("motions", since, words);
    }
    // The same by topic.
    for (trajectory, words) in [
        (one(&["joint9"], json!([point()])), "'joint9'"),
        (
            one(&["joint1"], json!([point(), point()])),
            "point 2 is at 1 s, not after",
        ),
        (
            one(
                &["joint1"],
                json!([{"positions": [null], "time_from_start": duration(1.0)}]),
            ),
            "gives joint 'joint1' NaN in positions",
        ),
    ] {
        let since = now();
        session.publish("joint_trajectory", TRAJECTORY, &trajectory);
        session.reports("motions", since, words);
    }
    let since = now();
    let tolerance = json!([{"name": "joint9", "position": 0.1}]);
    let trajectory = one(&["joint1"], json!([point()]));
    let refused = session.act(
        &json!({"trajectory": trajectory, "goal_tolerance": tolerance}),
        None,
    );
    assert_eq!(refused, json!({"accepted": false}));
    session.reports(
        "motions",
        since,
        "it names joint 'joint9' in goal_tolerance",
    );
}

// One commander after the other on the same arm. Each begins with the motion that it finds, so no joint's rate jumps
// from one state to the next.
#[test]
fn the_arm_changes_between_commanders_without_a_jump() {
    repeat_if_late(|| {
        let mut session = Session::start(117);
        let begin = now();
        session.publish(
            "joint_trajectory",
            TRAJECTORY,
            &moveit(&POSTURE, &GOAL, 4.0),
        );
        eventually("the start of the trajectory", PATIENCE, || {
            let (_, qd) = session.joints();
            qd.iter().any(|v| v.abs() > 1e-3).then_some(())
        });
        // A goal while a trajectory of the topic is executed is refused, and names its sender.
        let since = now();
        let goal =
            json!({"trajectory": {"joint_names": ["joint1"], "points": [at_rest(1.0, &[0.0])]}});
        assert_eq!(session.act(&goal, None), json!({"accepted": false}));
        session.reports("motions", since, "while node /commander commands the robot");
        session.arrives(&GOAL, 1e-3);

        // Positions by joint_commands, of two joints; then a rate for another one. The rest is held.
        let mut q = GOAL;
        (q[3], q[6]) = (1.2, 0.0);
        let wanted = json!({"name": ["joint7", "joint4"], "position": [0.0, 1.2]});
        // The trajectory lasts a little longer than its last millimetre.
        eventually("joint 4 on its way", PATIENCE, || {
            session.publish("joint_commands", JOINT_STATE, &wanted);
            (session.joints().0[3] > GOAL[3] + 0.01).then_some(())
        });
        session.arrives(&q, 1e-3);
        session.publish(
            "joint_commands",
            JOINT_STATE,
            &json!({
                "name": ["joint1", "joint7"], "velocity": [0.1, null], "position": [null, 0.2],
            }),
        );
        eventually(
            "joint 7 at 0.2 rad, joint 1 at rest where it was left",
            PATIENCE,
            || {
                let (q, qd) = session.joints();
                ((q[6] - 0.2).abs() < 1e-3 && qd[0].abs() < 1e-3 && q[0] > GOAL[0] + 0.01)
                    .then_some(())
            },
        );
        let (q, _) = session.joints();
        assert!((q[3] - 1.2).abs() < 1e-3, "{q:?}");

        // Paths that are refused do not disturb.
        let since = now();
        let there = json!({"position": {"x": 9.0, "y": 0.0, "z": 0.0}, "orientation": {"w": 1.0}});
        let stamped = |pose: &Value, seconds: f64| json!({"header": {"stamp": duration(seconds)}, "pose": pose});
        for (path, words) in [
            (json!({"poses": []}), "it has no poses"),
            (
                json!({"header": {"frame_id": "map"}, "poses": [stamped(&there, 1.0)]}),
                "frame_id 'map'; give world or base_link",
            ),
            (
                json!({"poses": [stamped(&there, 2.0), stamped(&there, 1.0)]}),
                "pose 2 is at 1 s, not after",
            ),
            (
                json!({"poses": [stamped(&json!({"position": {"x": null}, "orientation": {"w": 1.0}}), 1.0)]}),
                "position.x is NaN",
            ),
        ] {
            session.publish("cartesian_path", PATH, &path);
            session.reports("motions", since, words);
        }

        // Twists along the tip's own axis, and one that is not a number.
        let twist =
            |z: Value| json!({"header": {"frame_id": "tool0"}, "twist": {"linear": {"z": z}}});
        // The first one may come three seconds late (docs/upstream.md).
        eventually("a motion along the tip's axis", PATIENCE, || {
            session.publish("delta_twist_cmds", TWIST, &twist(json!(-0.05)));
            let (_, qd) = session.joints();
            qd.iter().any(|v| v.abs() > 0.01).then_some(())
        });
        let since = now();
        session.publish("delta_twist_cmds", TWIST, &twist(Value::Null));
        session.reports("motions", since, "gives twist.linear.z NaN");
        eventually("rest without twists", PATIENCE, || {
            let (_, qd) = session.joints();
            qd.iter().all(|v| v.abs() < 1e-3).then_some(())
        });

        // Rates of consecutive states.
        let wait = json!({"do": "wait", "topic": "joint_states", "count": 1, "since": begin});
        let states = session.peer.does(wait);
        let states: Vec<_> = states
            .as_array()
            .expect("a list")
            .iter()
            .map(|s| &s["message"])
            .collect();
        let stamp = |s: &Value| {
            s["header"]["stamp"]["sec"].as_f64().unwrap()
                + 1e-9 * s["header"]["stamp"]["nanosec"].as_f64().unwrap()
        };
        let mut most = 0.0f64;
        for pair in states.windows(2) {
            let dt = stamp(pair[1]) - stamp(pair[0]);
            if dt > 0.0 && dt < 0.015 {
                let (a, b) = (numbers(&pair[0]["velocity"]), numbers(&pair[1]["velocity"]));
                let change = a
                    .iter()
                    .zip(b)
                    .map(|(a, b)| (b - a).abs() / dt)
                    .fold(0.0, f64::max);
                most = most.max(change);
            }
        }
        println!("largest acceleration {most:.1} rad/s²");
        // The stiffest change is the step of a position by 0.2 rad: 20² rad/s² per rad.
        assert!(most < 100.0, "{most}");
        session.dynamics.interrupt().well();
    });
}

fn distance(a: &Pose, b: &Pose) -> (f64, f64) {
    let off = a.translation.vector - b.translation.vector;
    (off.norm(), (a.rotation.inverse() * b.rotation).angle())
}

// A path in inertial space while the base drifts, then one that moves with the base. Would break if the frames were
// confused: the base turns by more than the tip may be off.
#[test]
fn the_tip_follows_paths_in_the_world_and_relative_to_the_base() {
    repeat_if_late(|| {
        let mut session = Session::start(122);
        let (X_WB, X_BE) = session.tip();
        let start = X_WB * X_BE;
        let moved = |x: f64, y: f64, z: f64| Translation3::new(x, y, z) * start;
        let goal = moved(-0.05, 0.12, -0.1);
        session.follow("world", &[(1.5, moved(0.0, 0.1, 0.0)), (4.0, goal)]);
        eventually("the tip at the end of its path", 3 * PATIENCE, || {
            let (_, qd) = session.joints();
            let (X_WB, X_BE) = session.tip();
            let (off, turned) = distance(&(X_WB * X_BE), &goal);
            let rest = qd.iter().all(|v| v.abs() < 1e-3);
            (rest && off < 5e-4 && turned < 1e-3).then_some(())
        });
        let (X_WB, there) = session.tip();
        let (base_off, base_turned) = distance(&X_WB, &Pose::identity());
        println!("the base moved by {base_off:.4} m and {base_turned:.4} rad");
        assert!(base_turned > 5e-3, "{base_turned}");
        // Back to where the tip was relative to the base.
        session.follow("base_link", &[(3.0, X_BE)]);
        eventually("the tip back relative to the base", 3 * PATIENCE, || {
            let (_, qd) = session.joints();
            let (off, turned) = distance(&session.tip().1, &X_BE);
            let rest = qd.iter().all(|v| v.abs() < 1e-3);
            (rest && off < 5e-4 && turned < 1e-3).then_some(())
        });
        assert!(distance(&there, &X_BE).0 > 0.05);
        session.dynamics.interrupt().well();
    });
}

// The trajectory of a seven-joint arm with less reaction of the base: the parameter changes while the node runs.
#[test]
fn redundant_joints_turn_the_base_less() {
    repeat_if_late(|| {
        let mut turns = Vec::new();
        for (domain, reaction) in [
            (119, "free"),
            (120, "least_with_tip_pose"),
            (121, "least_with_tip_position"),
        ] {
            let mut session = Session::start(domain);
            let set = json!({"do": "set_parameters", "node": "/dynamics", "values": [["base_reaction", reaction]]});
            let answer = session.peer.does(set);
            assert_eq!(
                answer["response"]["results"][0]["successful"], true,
                "{answer}"
            );
            let goal = json!({
                "trajectory": moveit(&POSTURE, &GOAL, 4.0), "path_tolerance": tolerances(0.02),
            });
            let done = session.act(&goal, None);
            assert_eq!(done["status"], SUCCEEDED, "{}", done["result"]);
            turns.push(session.base_turn());
            session.dynamics.interrupt().well();
        }
        println!("the base turned by {turns:?} rad");
        assert!(
            turns[1] < 0.8 * turns[0] && turns[2] < 0.8 * turns[0],
            "{turns:?}"
        );
    });
}
