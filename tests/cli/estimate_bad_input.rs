//! How `fuyu estimate` refuses tables and bags from which no motion can be estimated.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use fuyu::bag::{Topic, Writer, WriterOptions};
use fuyu::msg::{builtin_interfaces::Time, fuyu_msgs::FeatureTracks, std_msgs::Header};
use fuyu::ros::Qos;
use nalgebra::Vector3;

use crate::estimate::{CAMERA, rates, refused, table, tracks, truth};

#[test]
fn what_cannot_be_estimated_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, text: &str| table(folder.path(), name, text);
    let all = tracks();
    let first = |frames: usize| -> String {
        let lines = all.lines().take(1 + 20 * frames);
        lines.flat_map(|l| [l, "\n"]).collect()
    };
    let full = file("full.csv", &all);
    assert!(refused(&full, &[]).contains("--fx"));
    assert!(
        refused(&full, &["--fx", "0", "--fy", "1", "--cx", "1", "--cy", "1"]).contains("fx is 0")
    );
    assert!(refused(&full, &[&CAMERA[..], &["--method", "sorcery"]].concat()).contains("bundle"));
    assert!(refused(Path::new("nowhere.csv"), &CAMERA).contains("nowhere.csv"));
    assert!(refused(&file("columns.csv", "a,b\n1,2\n"), &CAMERA).contains("t,id,u,v"));
    assert!(refused(&file("empty.csv", "t,id,u,v\n"), &CAMERA).contains("no feature"));
    let nan = all.replacen("\n0,1,", "\n0,1,NaN", 1);
    assert!(refused(&file("nan.csv", &nan), &CAMERA).contains("NaN"));
    let backwards = format!("{}{}", first(5), "0.1,0,5,5\n");
    assert!(refused(&file("back.csv", &backwards), &CAMERA).contains("sort the rows"));
    // Relative poses of two frames need eight points; a fit of the motion to all frames needs four.
    for (method, needed) in [("bundle", 4), ("masutani1995", 8)] {
        let args = [&CAMERA[..], &["--method", method]].concat();
        let two = refused(&file("two.csv", &first(1)), &args);
        assert!(two.contains("frames"), "{two}");
        let is_kept = |line: &&str| {
            let id = line.split(',').nth(1).and_then(|id| id.parse::<i32>().ok());
            id.is_none_or(|id| id < needed - 1)
        };
        let few: String = (all.lines().filter(is_kept))
            .flat_map(|l| [l, "\n"])
            .collect();
        let few = refused(&file("few.csv", &few), &args);
        assert!(few.contains(&format!("at least {needed}")), "{few}");
        let still: String = (0..50)
            .flat_map(|k| (0..20).map(move |id| (k, id)))
            .map(|(k, id)| {
                format!(
                    "{},{id},{},{}\n",
                    0.1 * f64::from(k),
                    100 + 37 * id,
                    90 + id * id
                )
            })
            .collect();
        let still = refused(&file("still.csv", &format!("t,id,u,v\n{still}")), &args);
        println!("{still}");
        let line: String = (0..50)
            .flat_map(|k| (0..20).map(move |id| (k, id)))
            .map(|(k, id)| {
                format!(
                    "{},{id},{},{}\n",
                    0.1 * f64::from(k),
                    100 + 37 * id + k,
                    90 + 2 * k
                )
            })
            .collect();
        let line = refused(&file("line.csv", &format!("t,id,u,v\n{line}")), &args);
        assert!(line.contains("line"), "{line}");
    }
    let rates = file("rates.csv", &rates());
    assert!(refused(&rates, &["--method", "bundle"]).contains("feature tracks"));
}

/// A table of 50 frames of 20 features; `at` gives u and v for a frame and an id.
fn made(at: impl Fn(u32, u32) -> (f64, f64)) -> String {
    let mut text = String::from("t,id,u,v\n");
    for (k, id) in (0..50).flat_map(|k| (0..20).map(move |id| (k, id))) {
        let (u, v) = at(k, id);
        writeln!(
            text,
            "{},{id},{},{}",
            0.1 * f64::from(k),
            u.round(),
            v.round()
        )
        .unwrap();
    }
    text
}

// Fails if the kind of a table is mistaken, or if an error message names neither file nor position or has more
// than one line.
#[test]
fn what_is_wrong_with_a_table_is_said_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    // A rod: points on a line that tumbles in front of the camera.
    let rod = made(|k, id| {
        let R = truth().attitude(0.1 * f64::from(k));
        let p = R * Vector3::new(0.3, -0.2, 0.25) * (f64::from(id) / 10.0 - 1.0);
        let z = 0.9 + p.z;
        (511.5 + 819.2 * p.x / z, 511.5 + 819.2 * p.y / z)
    });
    let trembling = made(|k, id| {
        let place = f64::from(id);
        let jump = |by: u32| f64::from((k * 7919 + id * 104_729 + by) % 3) - 1.0;
        (
            100.0 + 37.0 * place + jump(0),
            90.0 + place * place + jump(1),
        )
    });
    let tables = [
        ("nothing.csv", String::new(), "nothing.csv: is empty"),
        ("blank.csv", "\n\n".into(), "blank.csv: is empty"),
        (
            "names.csv",
            "time,id,u,v\n0,1,2,3\n".into(),
            "its first line is 'time,id,u,v'",
        ),
        (
            "nameless.csv",
            "0,1,2,3\n0,2,3,4\n".into(),
            "its first line is '0,1,2,3'",
        ),
        (
            "mixed.csv",
            "t,id,u,v,wx,wy,wz\n0,1,2,3,4,5,6\n".into(),
            "leave out u,v or wx,wy,wz",
        ),
        (
            "short.csv",
            "t,id,u,v\n0,1,2,3\n0,2,3\n".into(),
            "line 3 has 3 values",
        ),
        (
            "late.csv",
            "t,id,u,v\n1,1,2,3\n0.5,1,2,3\n".into(),
            "line 3: t is '0.5'",
        ),
        (
            "twice.csv",
            "t,id,u,v\n1,4,2,3\n1,5,2,3\n1,4,2,3\n".into(),
            "line 4: id is '4'",
        ),
        (
            "pixel.csv",
            "t,id,u,v\n1,4,2,inf\n".into(),
            "line 2: v is 'inf'",
        ),
        (
            "time.csv",
            "t,id,u,v\nnan,4,2,3\n".into(),
            "line 2: t is 'nan'",
        ),
        (
            "id.csv",
            "t,id,u,v\n1,one,2,3\n".into(),
            "line 2: id is 'one'",
        ),
        (
            "rod.csv",
            rod,
            "rod.csv: the points lie on a line in every frame",
        ),
        (
            "trembling.csv",
            trembling,
            "trembling.csv: the view is constant",
        ),
        (
            "rate.csv",
            "t,wx,wy,wz\n0,1,2,x\n".into(),
            "line 2: wz is 'x'",
        ),
        (
            "rates.csv",
            "t,wx,wy,wz\n0,1,2,3\n1,1,2,3\n".into(),
            "2 angular velocities",
        ),
    ];
    for (name, text, needle) in tables {
        let input = table(folder.path(), name, &text);
        let rates = text.starts_with("t,wx");
        for method in [&["--method", "masutani1995"][..], &["--method", "bundle"]] {
            if rates && method[1] == "bundle" {
                continue;
            }
            let said = refused(&input, &[&CAMERA[..], method].concat());
            assert!(said.contains(needle), "{said}");
            assert!(said.contains(name) && said.lines().count() == 1, "{said}");
        }
    }
}

/// Frame `k` of a bag, with 20 features, modified by `change`.
fn features(k: i64, change: impl FnOnce(&mut FeatureTracks)) -> FeatureTracks {
    let mut message = FeatureTracks {
        header: Header {
            stamp: Time::from_nanos(k * 100_000_000),
            frame_id: "camera_optical_frame".into(),
        },
        ids: (0..20).collect(),
        u: (0..20).map(|id| f64::from(id * 31 % 17)).collect(),
        v: (0..20).map(|id| f64::from(id * 13 % 19)).collect(),
    };
    change(&mut message);
    message
}

/// A bag with these messages on these topics, two frames each.
fn bag(folder: &Path, name: &str, topics: &[(&str, [FeatureTracks; 2])]) -> PathBuf {
    let path = folder.join(name);
    let mut writer = Writer::create(&path, WriterOptions::default()).unwrap();
    for (topic, messages) in topics {
        let topic = Topic::of::<FeatureTracks>(*topic, Qos::SENSOR_DATA);
        let topic = writer.add_topic(topic).unwrap();
        for (k, message) in (0u64..).zip(messages) {
            writer
                .write_message(topic, k * 100_000_000, message)
                .unwrap();
        }
    }
    writer.finish().unwrap();
    path
}

#[test]
fn what_is_wrong_with_a_bag_is_said_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let good = || [features(0, |_| {}), features(1, |_| {})];
    let second = |change: fn(&mut FeatureTracks)| [features(0, |_| {}), features(1, change)];
    let topic = "/camera/features";
    let bags = [
        ("none", vec![], "holds no message on /camera/features"),
        (
            "two",
            vec![
                ("/a/camera/features", good()),
                ("/b/camera/features", good()),
            ],
            "two cameras, /a/camera/features and /b/camera/features",
        ),
        (
            "nan",
            vec![(topic, second(|m| m.u[3] = f64::NAN))],
            "feature 3 is at pixel (NaN,",
        ),
        (
            "lists",
            vec![(topic, second(|m| m.v.truncate(4)))],
            "20, 20 and 4 values",
        ),
        (
            "ids",
            vec![(topic, second(|m| m.ids[1] = 7))],
            "feature 7 is there twice",
        ),
        (
            "back",
            vec![(topic, [features(5, |_| {}), features(2, |_| {})])],
            "times must increase",
        ),
        (
            "empty",
            vec![(
                topic,
                second(|_| {}).map(|_| features(0, |m| *m = FeatureTracks::default())),
            )],
            "no frame has a feature",
        ),
    ];
    for (name, topics, needle) in bags {
        let input = bag(folder.path(), name, &topics);
        let said = refused(&input, &CAMERA);
        assert!(said.contains(needle), "{said}");
        assert!(said.contains(name) && said.lines().count() == 1, "{said}");
        assert_eq!(said.matches(topic).count().min(1), 1, "{said}");
    }
    // First the calibration is missing; with a calibration, there are too few frames.
    let input = bag(folder.path(), "good", &[(topic, good())]);
    assert!(refused(&input, &[]).contains("--fx"));
    assert!(refused(&input, &CAMERA).contains("at least 8"));
}

// Fails if the camera mixes up two targets, if a target gets the description of another, or if the estimator
// estimates the wrong one.
