//! `check_bag` on runs that pass, and on runs with one defect each.

use fuyu::bag::Bag;
use fuyu::experiments::{CheckLimits, CheckReport, Verdict, check_bag};

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
