//! Motions of the arm and what happens around them: lockstep, a reset of the state, stamps in the future, and a
//! parameter that changes while the arm moves.

use serde_json::{Value, json};
use std::{thread, time::Duration};

use crate::{
    commanders::{
        ABORTED, GOAL, POSTURE, SUCCEEDED, Session, TRAJECTORY, at_rest, duration, moveit,
        tolerances,
    },
    lateness::repeat_if_late,
    observer::{JOINT_STATE, fresh, now, numbers},
    waiting::{PATIENCE, eventually},
};

/// Stamp of joint states \[s\].
fn stamp(state: &Value) -> f64 {
    let part = |name: &str| state["header"]["stamp"][name].as_f64().expect("a time");
    part("sec") + 1e-9 * part("nanosec")
}

/// Time of the newest joint states \[s\].
fn time(session: &mut Session) -> f64 {
    let state = fresh(&mut session.peer, "joint_states", 1).pop();
    stamp(&state.expect("one"))
}

/// A trajectory of joint 2 to `position` in one second, from the `stamp` \[s\] on.
fn of_joint2(position: f64, stamp: f64) -> Value {
    json!({
        "header": {"stamp": duration(stamp)}, "joint_names": ["joint2"],
        "points": [at_rest(1.0, &[position])],
    })
}

// In lockstep a motion needs no answers, but after it every state waits for its answer again. Would break if time stood
// still during the motion, or ran away after it.
#[test]
fn lockstep_waits_again_when_a_motion_is_over() {
    repeat_if_late(|| {
        let mut session = Session::start_with(133, &["lockstep:=true", "real_time_factor:=0.0"]);
        eventually("states", PATIENCE, || Some(session.joints()));
        assert_eq!(time(&mut session), 0.0);
        session.publish("joint_trajectory", TRAJECTORY, &of_joint2(0.8, 0.0));
        let mut goal = POSTURE;
        goal[1] = 0.8;
        session.arrives(&goal, 1e-3);
        let stands = eventually("time stands still", PATIENCE, || {
            let times = [(); 2].map(|()| time(&mut session));
            (times[0] == times[1] && times[0] > 0.9).then_some(times[0])
        });
        println!("time stands still at {stands} s");
        // An answer to that state lets time advance by one state.
        let answer = json!({
            "header": {"stamp": duration(stands)}, "name": ["joint2"], "position": [0.8],
        });
        session.publish("joint_commands", JOINT_STATE, &answer);
        eventually("one more state", PATIENCE, || {
            let now = time(&mut session);
            assert!(now < stands + 0.015, "{now} after {stands}");
            (now > stands + 0.005).then_some(())
        });
        session.dynamics.interrupt().well();
    });
}

// Would break if a goal survived the reset, if the joints kept their rates, or if time restarted as well.
#[test]
fn a_reset_of_the_state_alone_ends_a_motion() {
    repeat_if_late(|| {
        let mut session = Session::start(134);
        let goal = json!({"trajectory": moveit(&POSTURE, &GOAL, 20.0)});
        let mut other = crate::joining::peer_with_interfaces("resetter", 134);
        let outcome = thread::scope(|scope| {
            let outcome = scope.spawn(|| session.act(&goal, None));
            thread::sleep(Duration::from_secs(4));
            let reset = other.does(json!({
                "do": "call", "service": "dynamics/reset_simulation",
                "type": "simulation_interfaces/srv/ResetSimulation", "request": {"scope": 2},
            }));
            assert_eq!(reset["response"]["result"]["result"], 1, "{reset}");
            outcome.join().expect("an outcome")
        });
        assert_eq!(outcome["status"], ABORTED, "{}", outcome["result"]);
        let said = outcome["result"]["error_string"].as_str().expect("a text");
        assert!(said.contains("the simulation was reset"), "{said}");
        let (q, qd) = session.joints();
        for (j, start) in POSTURE.iter().enumerate() {
            assert!(
                (q[j] - start).abs() < 1e-6 && qd[j].abs() < 1e-6,
                "{q:?} {qd:?}"
            );
        }
        assert!(time(&mut session) > 3.0, "time restarted, too");
        // The arm is free for the next one.
        let next = json!({"trajectory": moveit(&POSTURE, &GOAL, 2.0)});
        let done = session.act(&next, None);
        assert_eq!(done["status"], SUCCEEDED, "{}", done["result"]);
        session.dynamics.interrupt().well();
    });
}

// A trajectory in the near future begins on time; one in years is refused, and neither it nor the largest stamp there is ends
// the node or takes the arm.
#[test]
fn stamps_in_the_future_are_waited_for_or_refused() {
    repeat_if_late(|| {
        let mut session = Session::start(135);
        eventually("states", PATIENCE, || Some(session.joints()));
        for stamp in [
            json!({"sec": 2 * 86_400}),
            json!({"sec": i32::MAX, "nanosec": 999_999_999}),
            json!({"sec": i32::MAX, "nanosec": u32::MAX}),
        ] {
            let since = now();
            let mut far = of_joint2(0.9, 0.0);
            far["header"]["stamp"] = stamp;
            session.publish("joint_trajectory", TRAJECTORY, &far);
            session.reports(
                "motions",
                since,
                "set use_sim_time, or leave the stamp zero",
            );
        }
        let (q, _) = session.joints();
        assert!((q[1] - POSTURE[1]).abs() < 1e-3, "{q:?}");
        let begin = time(&mut session) + 2.0;
        // The way to the first point takes the time until then, as in ros2_control: it is where the joint is.
        let mut ahead = of_joint2(0.8, begin);
        ahead["points"] = json!([at_rest(0.5, &[POSTURE[1]]), at_rest(1.5, &[0.8])]);
        session.publish("joint_trajectory", TRAJECTORY, &ahead);
        eventually("the trajectory begins", PATIENCE, || {
            let state = fresh(&mut session.peer, "joint_states", 1).pop()?;
            let off = (numbers(&state["position"])[1] - POSTURE[1]).abs();
            let has_begun = stamp(&state) > begin + 0.5;
            assert!(has_begun || off < 1e-3, "it moves too early: {state}");
            has_begun.then_some(())
        });
        let mut goal = POSTURE;
        goal[1] = 0.8;
        session.arrives(&goal, 1e-3);
        assert!(time(&mut session) > begin + 1.4);
        session.dynamics.interrupt().well();
    });
}

// A motion keeps what it began with; the next one is planned with the new value. Would break if the change made the joints
// jump, or ended the goal.
#[test]
fn base_reaction_that_changes_during_a_motion_holds_for_the_next() {
    repeat_if_late(|| {
        let mut session = Session::start(136);
        let goal = |from: &[f64], to: &[f64]| {
            json!({
                "trajectory": moveit(from, to, 6.0), "path_tolerance": tolerances(0.02),
                "goal_tolerance": tolerances(0.005), "goal_time_tolerance": duration(1.0),
            })
        };
        let mut other = crate::joining::peer_with_interfaces("setter", 136);
        let first = thread::scope(|scope| {
            let first = scope.spawn(|| session.act(&goal(&POSTURE, &GOAL), None));
            thread::sleep(Duration::from_secs(3));
            let set = other.does(json!({
                "do": "set_parameters", "node": "/dynamics",
                "values": [["base_reaction", "least_with_tip_position"]],
            }));
            assert_eq!(set["response"]["results"][0]["successful"], true, "{set}");
            first.join().expect("an outcome")
        });
        // Every joint follows its own trajectory to the end, which a motion with least reaction does not.
        assert_eq!(first["status"], SUCCEEDED, "{}", first["result"]);
        session.arrives(&GOAL, 1e-3);
        let turned = session.base_turn();
        let back = json!({"trajectory": moveit(&GOAL, &POSTURE, 6.0)});
        let second = session.act(&back, None);
        assert_eq!(second["status"], SUCCEEDED, "{}", second["result"]);
        let (q, _) = session.joints();
        let off = q.iter().zip(&POSTURE).map(|(q, p)| (q - p).abs());
        let off = off.fold(0.0, f64::max);
        println!("the base was turned by {turned} rad; joints end {off} rad from the trajectory's");
        assert!(off > 0.02, "the new value has no effect");
        session.dynamics.interrupt().well();
    });
}
