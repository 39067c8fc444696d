//! `check_bag` on runs that pass, and on runs with one defect each.

use std::path::Path;

use fuyu::bag::{Bag, Writer, WriterOptions};
use fuyu::experiments::{CheckLimits, CheckReport, Verdict, check_bag, plot_bag};

use crate::run::{self, Setup, Spoil};

fn check(setup: &Setup) -> CheckReport {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run");
    run::write(&path, setup);
    check_bag(&Bag::open(&path).unwrap(), &CheckLimits::default())
}

fn value(report: &CheckReport, name: &str) -> f64 {
    let line = report.checks.iter().find(|c| c.name == name);
    line.and_then(|l| l.value)
        .unwrap_or_else(|| panic!("no value of {name}: {report:#?}"))
}

fn failed(report: &CheckReport) -> Vec<&str> {
    let failed = report
        .checks
        .iter()
        .filter(|c| c.verdict == Verdict::Failed);
    failed.map(|c| c.name.as_str()).collect()
}

#[test]
fn a_run_that_converges_holds() {
    let report = check(&Setup::default());
    assert!(report.passed, "{:#?}", report.checks);
    assert!(
        report.checks.iter().all(|c| c.verdict == Verdict::Passed),
        "{:#?}",
        report.checks
    );
    for name in [
        "linear momentum",
        "angular momentum",
        "momentum from velocities",
    ] {
        assert!(
            value(&report, name) < 1e-12,
            "{name}: {}",
            value(&report, name)
        );
    }
    // Efforts are constant between samples, so the energy balance is exact up to rounding.
    assert!(
        value(&report, "energy balance") < 1e-10,
        "{}",
        value(&report, "energy balance")
    );
    // The final error from three sources must agree.
    let errors = ["controller", "camera", "tf"]
        .map(|source| value(&report, &format!("final tip error, {source}: position")));
    assert!(
        errors
            .iter()
            .all(|e| *e < 1e-3 && (e - errors[0]).abs() < 1e-12),
        "{errors:?}"
    );
    let joints = report
        .topics
        .iter()
        .find(|t| t.name == "/joint_states")
        .unwrap();
    assert!(joints.periodic && joints.by_stamp);
    assert!((joints.median_period.unwrap() - 0.01).abs() < 1e-12);
}

#[test]
fn damping_is_part_of_the_balance() {
    let report = check(&Setup {
        damping: 1.0,
        ..Setup::default()
    });
    assert!(
        value(&report, "energy balance") < 1e-4,
        "{}",
        value(&report, "energy balance")
    );
}

#[test]
fn a_run_that_has_not_arrived_does_not_hold() {
    let report = check(&Setup {
        seconds: 10.0,
        namespace: "/chaser",
        ..Setup::default()
    });
    assert_eq!(
        failed(&report),
        [
            "chaser: final tip error, controller: position",
            "chaser: final tip error, controller: attitude",
            "chaser: final tip error, camera: position",
            "chaser: final tip error, camera: attitude",
            "chaser: final tip error, tf: position",
            "chaser: final tip error, tf: attitude",
        ]
    );
}

#[test]
fn each_fault_is_found_by_its_own_check() {
    let spoiled = |spoil| {
        check(&Setup {
            spoil,
            ..Setup::default()
        })
    };
    let none = Spoil::default();
    let report = spoiled(Spoil { push: 1e-6, ..none });
    assert_eq!(failed(&report), ["linear momentum"]);
    let report = spoiled(Spoil {
        effort: 0.01,
        ..none
    });
    assert_eq!(failed(&report), ["energy balance"]);
    let report = spoiled(Spoil { gap: 50, ..none });
    assert_eq!(failed(&report), ["gaps in time"]);
    let gap = report
        .checks
        .iter()
        .find(|c| c.name == "gaps in time")
        .unwrap();
    assert!(
        gap.detail.contains("/joint_states at 29.99 s"),
        "{}",
        gap.detail
    );
    assert!((gap.value.unwrap() - 0.51).abs() < 1e-9);
    let report = spoiled(Spoil {
        backwards: true,
        ..none
    });
    assert!(
        failed(&report).contains(&"stamps running backwards"),
        "{:?}",
        failed(&report)
    );
    let report = spoiled(Spoil { nan: true, ..none });
    // NaN must not disappear in the values that are computed from it.
    assert_eq!(
        failed(&report),
        ["momentum from velocities", "values that are not finite"]
    );
    let line = report
        .checks
        .iter()
        .find(|c| c.name == "values that are not finite")
        .unwrap();
    assert!(
        line.detail.contains("/joint_states, field velocity[2]"),
        "{}",
        line.detail
    );
}

// Scenarios of which one does not control the attitude, one neither, and one has a noisy camera.
#[test]
fn scenarios_that_come_with_fuyu_pass() {
    let dir = tempfile::tempdir().unwrap();
    for (name, seconds) in [
        ("straight_path", "30"),
        ("approximate_jacobian", "120"),
        ("tracking", "60"),
    ] {
        let path = dir.path().join(name);
        let fuyu = |args: &[&str]| {
            let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_fuyu"));
            let command = command.current_dir(env!("CARGO_MANIFEST_DIR")).args(args);
            let output = command.output().unwrap();
            let log = String::from_utf8_lossy(&output.stderr).into_owned();
            assert_eq!(output.status.code(), Some(0), "{args:?}: {log}");
            String::from_utf8(output.stdout).unwrap()
        };
        let (config, bag) = (format!("config/{name}.yaml"), path.to_str().unwrap());
        fuyu(&["simulate", &config, "--duration", seconds, "--output", bag]);
        let report = fuyu(&["bag", "check", bag]);
        let is_noted = report.contains("the law does not control it: k_o is 0");
        assert_eq!(is_noted, name != "tracking", "{report}");
        let is_noisy = report.contains("their noise is");
        assert_eq!(is_noisy, name == "tracking", "{report}");
    }
}

/// A bag with the messages of another one twice, as after a reset.
fn repeated(from: &Path, to: &Path) {
    let bag = Bag::open(from).unwrap();
    let mut writer = Writer::create(to, WriterOptions::default()).unwrap();
    let end = bag.info().unwrap().duration_ns();
    for run in 0..2 {
        for message in bag.messages() {
            // Latched messages are not repeated after a reset.
            if run == 1 && message.topic.type_name == "std_msgs/msg/String" {
                continue;
            }
            let id = writer.add_described((*message.topic).clone()).unwrap();
            let time = message.log_time + run * end;
            writer.write_cdr(id, time, time, &message.data).unwrap();
        }
    }
    writer.finish().unwrap();
}

#[test]
fn the_runs_before_and_after_a_reset_are_checked_and_plotted_separately() {
    let dir = tempfile::tempdir().unwrap();
    let (one, two) = (dir.path().join("one"), dir.path().join("two"));
    run::write(&one, &Setup::default());
    repeated(&one, &two);
    let check = |path: &Path| check_bag(&Bag::open(path).unwrap(), &CheckLimits::default());
    let (single, report) = (check(&one), check(&two));
    assert!(report.passed, "{:#?}", report.checks);
    for name in [
        "linear momentum",
        "energy balance",
        "momentum from velocities",
    ] {
        for run in 1..=2 {
            let both = value(&report, &format!("run {run}: {name}"));
            assert_eq!(both, value(&single, name), "{name}");
        }
    }
    assert!(report.checks.iter().any(|c| c.name == "runs"));
    // A defect in one of the runs is found there.
    let (spoilt, third) = (dir.path().join("spoilt"), dir.path().join("third"));
    let push = Spoil {
        push: 1.0,
        ..Spoil::default()
    };
    let setup = Setup {
        spoil: push,
        ..Setup::default()
    };
    run::write(&spoilt, &setup);
    repeated(&spoilt, &third);
    let report = check(&third);
    assert!(
        failed(&report).contains(&"run 2: linear momentum"),
        "{:?}",
        failed(&report)
    );

    let pictures = dir.path().join("pictures");
    std::fs::create_dir(&pictures).unwrap();
    let paths = plot_bag(&Bag::open(&two).unwrap(), &pictures).unwrap();
    for name in [
        "run1_tip_error.svg",
        "run2_tip_error.svg",
        "run2_momentum_residual.png",
    ] {
        assert!(paths.contains(&pictures.join(name)), "{paths:?}");
    }
}
