//! `fuyu bag`, as a user calls it.

use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use crate::run::{self, Setup};
use crate::sample;
use fuyu::bag::{Writer, WriterOptions};

fn fuyu(args: &[&str], bag: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_fuyu"))
        .arg("bag")
        .args(args)
        .arg(bag)
        .output()
        .unwrap()
}

fn stderr(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).unwrap()
}

/// A bag without topics in `folder`.
fn empty_bag(folder: &Path) -> PathBuf {
    let path = folder.join("empty");
    let writer = Writer::create(&path, WriterOptions::default()).unwrap();
    writer.finish().unwrap();
    path
}

fn json(output: &Output) -> Value {
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn info_says_what_is_there() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run");
    let recording = sample::write(&path, 300, WriterOptions::default());
    let output = fuyu(&["info", "--json"], &path);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let info = json(&output);
    assert_eq!(info["messages"], recording.messages);
    assert_eq!(info["duration"], 2.99);
    assert_eq!(info["compression"], "zstd");
    assert_eq!(info["complete"], true);
    let joints = &info["topics"][1];
    assert_eq!(joints["name"], "/joint_states");
    assert_eq!(joints["type"], "sensor_msgs/msg/JointState");
    assert_eq!(joints["count"], 300);
    assert_eq!(joints["qos"][0]["reliability"], "reliable");
    let text = String::from_utf8(fuyu(&["info"], &path).stdout).unwrap();
    for part in [
        "2023-11-14 22:13:20.000 UTC",
        "2.990 s",
        "acme_msgs/msg/Gripper",
        "transient_local",
    ] {
        assert!(text.contains(part), "{part} is not in\n{text}");
    }
}

#[test]
fn a_cut_bag_is_read_and_said_to_be_cut() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run");
    sample::write(
        &path,
        3000,
        WriterOptions {
            chunk_size: 10_000,
            ..Default::default()
        },
    );
    let file = path.join("run_0.mcap");
    let bytes = fs::read(&file).unwrap();
    fs::write(&file, &bytes[..bytes.len() / 2]).unwrap();
    fs::remove_file(path.join("metadata.yaml")).unwrap();
    let info = json(&fuyu(&["info", "--json"], &path));
    assert_eq!(info["complete"], false);
    assert!(info["messages"].as_u64().unwrap() > 1000);
    let text = String::from_utf8(fuyu(&["info"], &path).stdout).unwrap();
    assert!(text.contains("the file ends inside a record"), "{text}");
}

#[test]
fn check_tells_with_its_exit_code() {
    let dir = tempfile::tempdir().unwrap();
    let good = dir.path().join("good");
    run::write(&good, &Setup::default());
    let output = fuyu(&["check"], &good);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let report = json(&fuyu(&["check", "--json"], &good));
    assert_eq!(report["passed"], true);
    let output = fuyu(&["check", "--json", "--position-error", "1e-9"], &good);
    assert_eq!(output.status.code(), Some(1));
    assert_eq!(json(&output)["passed"], false);
    assert!(
        stderr(&output).contains("final tip error, controller: position"),
        "{}",
        stderr(&output)
    );
    assert_eq!(
        fuyu(&["check", "--energy=-1"], &good).status.code(),
        Some(2)
    );
}

#[test]
fn plot_draws_what_the_bag_has() {
    let dir = tempfile::tempdir().unwrap();
    let bag = dir.path().join("run");
    run::write(
        &bag,
        &Setup {
            seconds: 2.0,
            ..Setup::default()
        },
    );
    let pictures = dir.path().join("new").join("pictures");
    let output = fuyu(&["plot", "--output", pictures.to_str().unwrap()], &bag);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    for name in [
        "tip_error",
        "base_attitude",
        "momentum_residual",
        "joint_rates",
    ] {
        let svg = fs::read_to_string(pictures.join(format!("{name}.svg"))).unwrap();
        assert!(svg.contains("time [s]"), "{name}");
        let png = fs::read(pictures.join(format!("{name}.png"))).unwrap();
        assert!(png.starts_with(b"\x89PNG"), "{name}");
    }
    // There is nothing to draw in a bag without a recorded run.
    let empty = empty_bag(dir.path());
    let output = fuyu(&["plot"], &empty);
    assert_eq!(output.status.code(), Some(2));
    assert!(
        stderr(&output).contains("nothing to plot"),
        "{}",
        stderr(&output)
    );
}

/// Width, height and the fraction of pixels brighter than a star's surroundings.
fn picture(path: &Path) -> (u32, u32, f64, Vec<u8>) {
    let picture = image::open(path).unwrap().to_rgb8();
    let bright = picture.pixels().filter(|p| p.0.iter().any(|c| *c > 40));
    let share = bright.count() as f64 / f64::from(picture.width() * picture.height());
    let (width, height) = picture.dimensions();
    (width, height, share, picture.into_raw())
}

#[test]
fn render_draws_the_bodies_at_the_times_that_are_asked_for() {
    let dir = tempfile::tempdir().unwrap();
    let bag = dir.path().join("run");
    let setup = Setup {
        seconds: 2.0,
        ..Setup::default()
    };
    run::write(&bag, &setup);
    let folder = dir.path().join("pictures");
    let to = folder.to_str().unwrap();
    let render = |options: &[&str]| {
        let fixed = ["render", "--output", to, "--size", "320x180"];
        fuyu(&[&fixed[..], options].concat(), &bag)
    };
    let output = render(&["--at", "0,1.98"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert_eq!(stderr(&output), "");
    let listed = String::from_utf8(output.stdout).unwrap();
    let names = ["scene_00000.000s.png", "scene_00001.980s.png"];
    let paths = names.map(|name| folder.join(name));
    let lines: Vec<&Path> = listed.lines().map(Path::new).collect();
    assert_eq!(lines, paths);
    let [first, last] = paths.map(|path| picture(&path));
    for (width, height, bodies, _) in [&first, &last] {
        assert_eq!((*width, *height), (320, 180));
        // The robot and not much more than the robot: the sky is dark.
        assert!((0.03..0.5).contains(bodies), "{bodies}");
    }
    // The arm has moved.
    assert!(first.3 != last.3);
    // Twice as close, the bodies are larger.
    render(&["--at", "0", "--distance", "0.5"]);
    let (.., closer, _) = picture(&folder.join(names[0]));
    assert!(closer > 1.5 * first.2, "{closer} {}", first.2);
    // A film has equal intervals, and the default is an overview.
    let count = |output: Output| String::from_utf8(output.stdout).unwrap().lines().count();
    assert_eq!(count(render(&["--every", "0.5"])), 5);
    assert_eq!(count(render(&[])), 6);
    for (options, words) in [
        (&["--at", "99"][..], "--at 99: the run lasts from 0 to"),
        (&["--every", "0"], "--every 0:"),
        (&["--run", "2"], "--run 2: the bag has the runs 1 to 1"),
        (&["--elevation", "91"], "--elevation 91:"),
        (&["--distance", "0"], "--distance 0:"),
        (&["--size", "0x180"], "it must be like 960x540"),
    ] {
        let output = match options[0] {
            "--size" => fuyu(&[&["render"][..], options].concat(), &bag),
            _ => render(options),
        };
        assert_eq!(output.status.code(), Some(2), "{options:?}");
        assert!(stderr(&output).contains(words), "{}", stderr(&output));
    }
    let empty = empty_bag(dir.path());
    let output = fuyu(&["render"], &empty);
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("nothing to draw: no ground_truth/odom"));
}

#[test]
fn what_is_no_bag_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let text = dir.path().join("notes.mcap");
    fs::write(&text, "not a recording").unwrap();
    for command in ["info", "check", "plot", "render"] {
        for (path, words) in [
            (dir.path().join("none"), "no such file or folder"),
            (text.clone(), "not an MCAP file"),
        ] {
            let output = fuyu(&[command], &path);
            assert_eq!(output.status.code(), Some(2), "{command}");
            let message = stderr(&output);
            assert!(
                message.contains(words) && message.lines().count() == 1,
                "{message}"
            );
        }
    }
}
