//! Wrong input is refused before anything runs: exit code 2, and an error message that names the position, what is
//! wrong and what would be right.

use std::{fs, path::Path};

use crate::{
    process::{Ended, Running, command, fuyu, scenario, source},
    waiting::PATIENCE,
};

const POSITIONING: &str = "config/positioning.yaml";

/// Checks for exit code 2, an empty stdout, and an error of one to three lines on stderr that contains `words`; no panic.
fn refused(what: &str, ended: &Ended, words: &[&str]) {
    let said = &ended.stderr;
    println!("{what}: {}", said.trim_end());
    assert_eq!(ended.code, Some(2), "{what}: {said}");
    assert_eq!(ended.stdout, "", "{what}");
    assert!(
        !said.contains("panick") && !said.contains("RUST_BACKTRACE"),
        "{what}: {said}"
    );
    let errors: Vec<_> = said.lines().filter(|l| !l.starts_with('[')).collect();
    assert!((1..=3).contains(&errors.len()), "{what}: {said}");
    for word in words {
        assert!(
            errors.iter().any(|line| line.contains(word)),
            "{what}: no {word:?} in {errors:?}"
        );
    }
}

/// A scenario with a mistake: the text that is replaced, and words that the error message must contain.
struct Broken {
    what: &'static str,
    from: &'static str,
    to: &'static str,
    words: &'static [&'static str],
}

const fn broken(
    what: &'static str,
    from: &'static str,
    to: &'static str,
    words: &'static [&'static str],
) -> Broken {
    Broken {
        what,
        from,
        to,
        words,
    }
}

const BROKEN: [Broken; 20] = [
    broken(
        "no YAML",
        "duration: 60.0",
        "duration: [60.0",
        &["scenario.yaml:"],
    ),
    broken(
        "tabs",
        "    duration: 60.0",
        "\tduration: 60.0",
        &["scenario.yaml:", "tab"],
    ),
    broken(
        "no ros__parameters",
        "dynamics:\n  ros__parameters:",
        "dynamics:\n  parameters:",
        &["scenario.yaml:", "ros__parameters"],
    ),
    broken(
        "unknown node",
        "camera:\n",
        "kamera:\n",
        &["scenario.yaml", "kamera", "camera"],
    ),
    broken(
        "unknown parameter",
        "time_step: 0.01",
        "timestep: 0.01",
        &["scenario.yaml:", "timestep", "did you mean time_step"],
    ),
    broken(
        "wrong type",
        "k_p: 75.0",
        "k_p: strong",
        &["scenario.yaml:", "k_p", "strong", "double"],
    ),
    broken(
        "integer for a double",
        "k_p: 75.0",
        "k_p: 75",
        &["scenario.yaml:", "k_p", "75.0"],
    ),
    broken(
        "out of range",
        "state_rate: 100.0",
        "state_rate: -5.0",
        &["scenario.yaml:", "state_rate", "-5", "1000"],
    ),
    broken(
        "negative gain",
        "k_o: 100.0",
        "k_o: -100.0",
        &["scenario.yaml:", "k_o", "-100"],
    ),
    broken(
        "NaN",
        "e_p_max: 0.2",
        "e_p_max: .nan",
        &["scenario.yaml:", "e_p_max", "NaN"],
    ),
    broken(
        "no such choice",
        "integrator: rk4",
        "integrator: euler",
        &["scenario.yaml:", "integrator", "euler", "rk4"],
    ),
    broken(
        "too few joint positions",
        "[1.1344640137963142, ",
        "[",
        &["scenario.yaml", "initial_joint_positions", "5 values", "6"],
    ),
    broken(
        "no unit quaternion",
        "orientation: [0.77",
        "orientation: [2.77",
        &["scenario.yaml", "goal.orientation", "norm", "1"],
    ),
    broken(
        "short position",
        "position: [3.662078985521887, ",
        "position: [",
        &["scenario.yaml:", "goal.position", "3"],
    ),
    broken(
        "no such file",
        "package://fuyu/urdf/servicer.urdf",
        "nowhere/robot.urdf",
        &[
            "scenario.yaml",
            "urdf",
            "nowhere/robot.urdf",
            "no such file",
        ],
    ),
    broken(
        "no such tip",
        "tip_link: tool0",
        "tip_link: hand",
        &["scenario.yaml", "tip_link", "hand", "tool0"],
    ),
    broken(
        "k_v too short",
        "k_v: [400.0, ",
        "k_v: [",
        &["scenario.yaml", "k_v", "5 values", "6"],
    ),
    broken(
        "negative damping",
        "k_v: [400.0, 100.0",
        "k_v: [400.0, -100.0",
        &["scenario.yaml:", "k_v", "-100"],
    ),
    broken(
        "a kick of no size",
        "    joint_k_p:",
        "    singularity_escape.rate: -1.0\n    joint_k_p:",
        &["scenario.yaml:", "singularity_escape.rate", "-1"],
    ),
    broken(
        "two at once",
        "k_p: 75.0\n    k_o: 100.0",
        "k_p: 75\n    ko: 100.0",
        &["k_p", "75.0", "ko", "did you mean k_o"],
    ),
];

fn launch(config: &Path, more: &[&str]) -> Ended {
    Running::launch(86, config, more).wait(PATIENCE)
}

#[test]
fn broken_scenarios_are_refused_by_simulate() {
    for Broken {
        what,
        from,
        to,
        words,
    } in BROKEN
    {
        let (_folder, path) = scenario(POSITIONING, &[(from, to)]);
        refused(what, &fuyu(&["simulate", path.to_str().unwrap()]), words);
    }
    let none = [
        ("    goal:\n", "    # goal:\n"),
        ("      position:", "      # position:"),
        ("      orientation:", "      # "),
    ];
    let (_folder, path) = scenario(POSITIONING, &none);
    let ended = fuyu(&["simulate", path.to_str().unwrap()]);
    refused(
        "no goal",
        &ended,
        &["scenario.yaml", "goal.position", "needs a goal"],
    );
    refused(
        "no file",
        &fuyu(&["simulate", "nowhere.yaml"]),
        &["nowhere.yaml", "no such file"],
    );
    refused(
        "a folder",
        &fuyu(&["simulate", "config"]),
        &["config", "is a folder; give a regular file"],
    );
}

#[test]
fn broken_scenarios_are_refused_by_launch() {
    for Broken {
        what,
        from,
        to,
        words,
    } in BROKEN
    {
        let (_folder, path) = scenario(POSITIONING, &[(from, to)]);
        let mut launch = Running::launch(86, &path, &[]);
        refused(what, &launch.wait(PATIENCE), words);
        assert!(!launch.bag().exists(), "{what}: a bag was begun");
    }
    refused(
        "no file",
        &launch(Path::new("nowhere.yaml"), &[]),
        &["nowhere.yaml", "no such file"],
    );
}

#[test]
fn a_broken_robot_is_refused() {
    let urdf = fs::read_to_string(source("urdf/servicer.urdf")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let robot = folder.path().join("robot.urdf");
    let text = urdf.replacen("<mass value=\"", "<mass value=\"-", 1);
    assert_ne!(text, urdf);
    fs::write(&robot, text).unwrap();
    let change = ("package://fuyu/urdf/servicer.urdf", robot.to_str().unwrap());
    let (_folder, config) = scenario(POSITIONING, &[change]);
    let words = ["robot.urdf", "mass", "positive"];
    refused(
        "simulate",
        &fuyu(&["simulate", config.to_str().unwrap()]),
        &words,
    );
    refused("launch", &launch(&config, &[]), &words);
}

#[test]
fn an_occupied_bag_folder_is_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    let bag = folder.path().join("bag");
    let bag = bag.to_str().unwrap();
    fuyu(&["simulate", POSITIONING, "--duration", "1", "--output", bag]).well();
    let contents = || {
        let files = fs::read_dir(bag).unwrap().map(|f| f.unwrap().path());
        let mut files: Vec<_> = files.map(|f| (f.clone(), fs::read(f).unwrap())).collect();
        files.sort();
        files
    };
    let before = contents();
    let words = [bag, "already"];
    let again = fuyu(&["simulate", POSITIONING, "--output", bag]);
    refused("simulate", &again, &words);
    let mut again = command("fuyu", 87);
    again.args(["launch", POSITIONING, "--bag", bag]);
    refused("launch", &Running::start(again).wait(PATIENCE), &words);
    let mut again = command("recorder", 87);
    again.args(["--ros-args", "-p", &format!("bag:={bag}")]);
    refused("recorder", &Running::start(again).wait(PATIENCE), &words);
    assert!(contents() == before, "the bag has changed");
}

#[test]
fn wrong_arguments_are_refused() {
    let config = source(POSITIONING);
    for (what, args, words) in [
        (
            "negative duration",
            &["--duration", "-1"][..],
            &["--duration", "positive"][..],
        ),
        (
            "duration of NaN",
            &["--duration", "nan"],
            &["--duration", "nan", "positive"],
        ),
        (
            "unknown option",
            &["--lockstepp"],
            &["--lockstepp", "--lockstep"],
        ),
        (
            "bad remap",
            &["--ros-args", "-r", "bad"],
            &["bad", "FROM:=TO"],
        ),
        (
            "unknown ROS argument",
            &["--ros-args", "--rate"],
            &["--rate", "not a ROS argument"],
        ),
        (
            "unknown parameter",
            &["--ros-args", "-p", "dynamics:nosuch:=1"],
            &["nosuch", "/dynamics"],
        ),
    ] {
        let mut launch = Running::launch(88, &config, args);
        let ended = launch.wait(PATIENCE);
        let said = ended.stderr.lines().filter(|l| !l.starts_with('['));
        let said: Vec<_> = said.collect();
        println!("{what}: {}", said.join("\n"));
        assert_eq!(ended.code, Some(2), "{what}: {}", ended.stderr);
        for word in words {
            assert!(
                said.iter().any(|l| l.contains(word)),
                "{what}: no {word:?} in {said:?}"
            );
        }
        assert!(!launch.bag().exists(), "{what}: a bag was begun");
    }
    let dynamics = |what: &str, args: &[&str], words: &[&str]| {
        let mut dynamics = command("dynamics", 88);
        dynamics.args(args);
        refused(what, &Running::start(dynamics).wait(PATIENCE), words);
    };
    dynamics(
        "unknown parameter",
        &["--ros-args", "-p", "nosuch:=1"],
        &["nosuch", "/dynamics"],
    );
    dynamics(
        "bad remap",
        &["--ros-args", "-r", "bad"],
        &["bad", "FROM:=TO"],
    );
    dynamics(
        "no ROS argument",
        &["--duration", "3"],
        &["--duration", "--ros-args"],
    );
    dynamics(
        "no such parameter file",
        &["--ros-args", "--params-file", "nowhere.yaml"],
        &["nowhere.yaml"],
    );
    dynamics(
        "broken robot",
        &["--ros-args", "-p", "robot_description:=<robot"],
        &["robot_description"],
    );
    for (domain, words) in [
        ("300", ["300", "232"]),
        ("-1", ["-1", "232"]),
        ("abc", ["abc", "232"]),
    ] {
        let mut wrong = command("dynamics", 88);
        wrong.env("ROS_DOMAIN_ID", domain);
        let ended = Running::start(wrong).wait(PATIENCE);
        refused(
            "ROS_DOMAIN_ID",
            &ended,
            &["ROS_DOMAIN_ID", words[0], words[1]],
        );
    }
    let mut launch = command("fuyu", 88);
    launch
        .args(["launch", POSITIONING, "--bag", "/nowhere/bag"])
        .env("ROS_DOMAIN_ID", "300");
    let ended = Running::start(launch).wait(PATIENCE);
    refused("ROS_DOMAIN_ID", &ended, &["ROS_DOMAIN_ID", "300"]);
    let ended = fuyu(&["simulate", POSITIONING, "--duration", "-1"]);
    refused_by_clap(&ended, &["--duration", "positive"]);
    refused_by_clap(&fuyu(&["simulate"]), &["CONFIG"]);
    refused_by_clap(&fuyu(&["levitate"]), &["levitate"]);
}

/// An error of clap, which adds a usage hint below the message.
fn refused_by_clap(ended: &Ended, words: &[&str]) {
    assert_eq!(ended.code, Some(2), "{ended:?}");
    for word in words {
        assert!(ended.stderr.contains(word), "no {word:?} in {ended:?}");
    }
}
