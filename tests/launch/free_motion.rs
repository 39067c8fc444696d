//! A scenario without camera and controller, with closed loops: the robot moves by its springs.

use fuyu::msg::diagnostic_msgs::DiagnosticArray;
use std::time::Duration;

use crate::process::{Check, Running, read, scenario};

/// Six times as fast as real time, through the pantograph's first singular state at 9 s.
#[test]
fn the_pantograph_unfolds_over_dds() {
    let factor = (
        "duration: 40.0",
        "duration: 12.0\n    real_time_factor: 6.0",
    );
    let (_folder, config) = scenario("config/tr942_pantograph.yaml", &[factor]);
    let mut launch = Running::launch(89, &config, &[]);
    let ended = launch.wait(Duration::from_secs(60)).well();
    assert!(
        ended.stdout.contains("simulated time          12.00 s"),
        "{}",
        ended.stdout
    );
    assert!(
        ended.stdout.contains("momentum residual"),
        "{}",
        ended.stdout
    );
    assert!(!ended.stdout.contains("tip"), "{}", ended.stdout);

    let check = Check::of(&launch.bag());
    check.momentum_holds();
    assert!(check.failed().is_empty(), "{:?}", check.failed());
    // The energy balance includes the work of springs and dampers, without which it would not close.
    assert!(check.value("energy balance") < 1e-3);

    let diagnostics: Vec<DiagnosticArray> = read(&launch.bag(), "/diagnostics");
    let statuses = diagnostics.iter().flat_map(|d| &d.status);
    let loops: Vec<_> = statuses
        .filter(|s| s.name == "dynamics: loop closures")
        .collect();
    let last = loops.last().expect("loop closures are diagnosed");
    assert_eq!(last.message, "closed");
    let gap = last.values.iter().find(|v| v.key == "h7 gap [m]");
    let gap: f64 = gap.expect("the gap is reported").value.parse().unwrap();
    assert!(gap < 1e-12, "{gap}");
}
