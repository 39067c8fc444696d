//! The estimator between batch solutions: accuracy and cost of the filter, and what restarts it.

use nalgebra::Vector3;
use serde_json::{Value, json};
use std::time::{Duration, Instant};

use crate::{
    joining::peer_with_interfaces,
    lateness::repeat_if_late,
    peer::Peer,
    tumbling::{
        VECTOR, cpu_time, estimator, publish, rate_errors, recorded, rms, stamp, told_for, truth,
    },
    waiting::{PATIENCE, eventually},
};

// Two estimators receive the same frames and solve their batches at the same times, 20 s apart; one has the filter.
// Fails when the filter is worse than none, loses track in a gap, or costs too much.
#[test]
fn between_solutions_and_after_gaps_the_filter_knows_more() {
    repeat_if_late(|| {
        let domain = 92;
        let topics = [
            "/with/estimator/angular_velocity",
            "/without/estimator/angular_velocity",
        ];
        let mut with = estimator(
            domain,
            "/with",
            &["solve_period:=20.0", "prediction_period:=1.0"],
        );
        let mut without = estimator(domain, "/without", &["solve_period:=20.0", "filter:=false"]);
        let mut peer = peer_with_interfaces("eye", domain);
        for topic in topics {
            peer.subscribe(topic, VECTOR, "reliable");
        }
        peer.subscribe(
            "/with/estimator/prediction",
            "nav_msgs/msg/Path",
            "reliable",
        );
        let frames = recorded(220);
        let show = |peer: &mut Peer, from: usize, to: usize| {
            for frame in &frames[from..to] {
                peer.does(json!({
                    "do": "publish", "topic": "/camera/features", "type": "fuyu_msgs/msg/FeatureTracks",
                    "message": frame, "qos_name": "sensor_data", "matched": 2
                }));
                // The frames come twenty times as fast as they were taken, which leaves the solver its time.
                std::thread::sleep(Duration::from_millis(5));
            }
        };
        // Six seconds are enough for a first solution; they are shown frame by frame until both have one.
        show(&mut peer, 0, 60);
        for topic in topics {
            eventually("a first motion", 4 * PATIENCE, || {
                let reported = json!({"do": "wait", "topic": topic, "count": 1, "timeout": 1.0});
                (!peer.does(reported).as_array().unwrap().is_empty()).then_some(())
            });
        }
        let (before, started) = (cpu_time(&with), Instant::now());
        // The next batch is due 20 s after the last of the first ones, which ended at 2 s at the earliest.
        show(&mut peer, 60, 120);
        show(&mut peer, 170, 220);
        for topic in topics {
            eventually("the last frame's", PATIENCE, || {
                told_for(&mut peer, topic, 21.9)
            });
        }
        // At 30 frames a second a quarter of a core is 8 ms a frame; looking for messages takes its time, too.
        let taken = cpu_time(&with) - before - 0.05 * started.elapsed().as_secs_f64();
        println!("{:.2} ms of processor time a frame", 1e3 * taken / 110.0);
        assert!(taken / 110.0 < 0.25 / 30.0, "{taken} s");
        let [filtered, batch] = topics.map(|topic| rate_errors(&mut peer, topic, 10.0));
        println!(
            "with {:.2e}, without {:.2e} rad/s",
            rms(&filtered),
            rms(&batch)
        );
        assert!(filtered.len() > 60 && batch.len() > 60);
        assert!(rms(&filtered) < 0.5 * rms(&batch));
        let after_gap = topics.map(|topic| rms(&rate_errors(&mut peer, topic, 16.95)));
        println!("after the gap {after_gap:?}");
        assert!(after_gap[0] < 0.5 * after_gap[1]);
        // Predictions come in their period, not with every frame.
        let paths = peer.receive("/with/estimator/prediction", 1);
        let times: Vec<f64> = paths.iter().map(|p| stamp(&p["message"])).collect();
        assert!(times.len() > 5 && times.len() < 40, "{times:?}");
        for path in &paths {
            let poses = path["message"]["poses"].as_array().unwrap();
            assert_eq!(poses.len(), 61);
            let last = stamp(&poses[60]) - stamp(&path["message"]);
            assert!((last - 30.0).abs() < 1e-6, "{last}");
        }
        with.interrupt().well();
        without.interrupt().well();
    });
}

// After a push the body moves differently. Fails when the estimator keeps the motion
// from before.
#[test]
fn a_push_is_noticed_and_the_new_motion_found() {
    repeat_if_late(|| {
        let domain = 93;
        let mut estimator = estimator(domain, "/", &["solve_period:=5.0"]);
        let mut peer = peer_with_interfaces("eye", domain);
        peer.subscribe(
            "estimator/motion",
            "fuyu_msgs/msg/MotionEstimate",
            "reliable",
        );
        peer.subscribe("estimator/angular_velocity", VECTOR, "reliable");
        let frames = recorded(600);
        // Frames are lost before the estimator has discovered the publisher, and when they come too fast for it.
        let show = |peer: &mut Peer, frame: &Value| {
            publish(peer, frame);
            std::thread::sleep(Duration::from_millis(20));
        };
        for frame in &frames[..200] {
            show(&mut peer, frame);
        }
        eventually("the motion before", 4 * PATIENCE, || {
            let motion = peer.receive("estimator/motion", 1).pop()?["message"].clone();
            (motion["duration"].as_f64()? > 10.0).then_some(())
        });
        // From here on it turns the other way: the frames before 60 s, backwards.
        let mut pushed = (200..800).map(|k: usize| {
            let mut frame = frames[799 - k].clone();
            frame["header"]["stamp"] = json!({"sec": k / 10, "nanosec": k % 10 * 100_000_000});
            frame
        });
        let newest = |peer: &mut Peer| {
            let rate = peer.receive("estimator/angular_velocity", 1).pop()?;
            Some(rate["message"].clone())
        };
        for frame in pushed.by_ref().take(400) {
            show(&mut peer, &frame);
            // A busy computer computes longer than it is shown: no frame more than two seconds ahead, while there is a motion.
            let has_followed = |peer: &mut Peer| {
                newest(peer).is_some_and(|rate| stamp(&rate) > stamp(&frame) - 2.0)
            };
            let shown = Instant::now();
            while !has_followed(&mut peer) && shown.elapsed() < Duration::from_millis(500) {
                std::thread::sleep(Duration::from_millis(20));
            }
        }
        eventually("the new motion", 4 * PATIENCE, || {
            // The estimator reports with frames.
            if let Some(frame) = pushed.next() {
                show(&mut peer, &frame);
            }
            let rate = newest(&mut peer)?;
            let w = ["x", "y", "z"].map(|axis| rate["vector"][axis].as_f64().unwrap());
            let right = -truth().angular_velocity(79.9 - stamp(&rate));
            let found = (Vector3::from(w) - right).norm() < 2e-3 && stamp(&rate) > 59.0;
            found.then_some(())
        });
        // The push was detected; its frames were not rejected as outliers until the window had passed.
        let (_, said) = estimator.said();
        assert!(
            said.contains("the motion of the target has changed"),
            "{said}"
        );
        estimator.interrupt().well();
    });
}

#[test]
fn a_prediction_that_would_flood_the_graph_is_refused() {
    let mut estimator = estimator(95, "/", &["horizon:=3600.0", "prediction_rate:=100.0"]);
    let ended = estimator.wait(PATIENCE);
    assert_eq!(ended.code, Some(2), "{ended:?}");
    let said = "horizon 3600 and prediction_rate 100 are more than 10000 attitudes";
    assert!(ended.stderr.contains(said), "{}", ended.stderr);
}
