//! Drawn parameters, rows and datasets of small campaigns.

mod datasets;
mod processes;

use std::{
    fs,
    ops::ControlFlow::{Break, Continue},
    path::PathBuf,
};

use super::*;

/// A campaign of the positioning scenario, `seconds` long, with further lines.
fn campaign(runs: u64, seconds: f64, lines: &str) -> Result<Campaign, String> {
    let text = format!(
        "scenario: package://fuyu/config/positioning.yaml\nruns: {runs}\nseed: 5\nduration: {seconds:?}\n{lines}"
    );
    let scenario = resource::resolve("package://fuyu/config/positioning.yaml").unwrap();
    Campaign::new(
        PathBuf::from("test.yaml"),
        text,
        scenario.path(),
        scenario.text(LARGEST_YAML).unwrap(),
        None,
    )
}

// The first file of docs/campaigns.md.
#[test]
fn the_example_of_the_manual_is_a_campaign() {
    let manual = include_str!("../../../docs/campaigns.md");
    let blocks = manual.split("```yaml\n").skip(1);
    let text = blocks.filter_map(|block| block.split("```").next()).next();
    let scenario = resource::resolve("package://fuyu/config/positioning.yaml").unwrap();
    let campaign = Campaign::new(
        PathBuf::from("docs/campaigns.md"),
        text.unwrap().to_owned(),
        scenario.path(),
        scenario.text(LARGEST_YAML).unwrap(),
        Some(3),
    );
    let campaign = campaign.unwrap_or_else(|e| panic!("{e}"));
    assert_eq!((campaign.runs(), campaign.results().len()), (3, 6));
}

fn numbers(campaign: &Campaign, run: u64) -> Vec<f64> {
    let cells = campaign.parameters_of(run);
    cells.iter().map(|cell| cell.number().unwrap()).collect()
}

const DISPERSIONS: &str = "
dispersions:
  controller.k_p: {normal: {mean: 75.0, sigma: 5.0}}
  dynamics.initial_joint_positions[1]: {apply: add, normal: {sigma: 0.02}}
  dynamics.base.angular_velocity: {sphere: {radius: 0.01}}
  camera.goal.orientation: {apply: add, rotation: {max_angle: 0.1}}
  camera.position_noise: {uniform: {min: 0.0, max: 0.002}}
correlated:
  - parameters: ['dynamics.base.velocity[0]', 'dynamics.base.velocity[2]']
    covariance: [[1.0e-6, 9.0e-7], [9.0e-7, 1.0e-6]]
keep: {results: [tip_position_error, 'final.base_position[0]']}
";

#[test]
fn a_run_depends_on_seed_and_number_only() {
    let (a, b) = (
        campaign(50, 1.0, DISPERSIONS).unwrap(),
        campaign(50, 1.0, DISPERSIONS).unwrap(),
    );
    let forwards: Vec<_> = (0..50).map(|run| numbers(&a, run)).collect();
    for run in (0..50).rev() {
        assert_eq!(numbers(&b, run), forwards[run as usize]);
    }
    let names: Vec<_> = a.parameters().iter().map(|c| c.name.as_str()).collect();
    let expected = [
        "controller.k_p",
        "dynamics.initial_joint_positions[1]",
        "dynamics.base.angular_velocity[0]",
        "dynamics.base.angular_velocity[1]",
        "dynamics.base.angular_velocity[2]",
        "camera.goal.orientation[0]",
        "camera.goal.orientation[1]",
        "camera.goal.orientation[2]",
        "camera.goal.orientation[3]",
        "camera.position_noise",
        "dynamics.base.velocity[0]",
        "dynamics.base.velocity[2]",
    ];
    assert_eq!(names, expected);
    for drawn in &forwards {
        let length: f64 = drawn[2..5].iter().map(|x| x * x).sum();
        assert!((length.sqrt() - 0.01).abs() < 1e-15);
        let nominal = [
            0.770_116_743_905_531_8,
            0.274_213_853_258_842_5,
            0.134_413_320_585_938_6,
            -0.560_291_172_116_995_5,
        ];
        let cosine: f64 = drawn[5..9].iter().zip(nominal).map(|(a, b)| a * b).sum();
        assert!(2.0 * cosine.abs().min(1.0).acos() < 0.1 + 1e-7);
    }
    assert!(forwards.windows(2).all(|pair| pair[0] != pair[1]));
}

#[test]
fn a_run_is_that_of_its_printed_scenario_to_the_bit() {
    let campaign = campaign(20, 1.0, DISPERSIONS).unwrap();
    for run in [3, 17] {
        let row = campaign.run_one(run, None).unwrap();
        let text = campaign.scenario_text_of(run).unwrap();
        let scenario = Scenario::parse("shown.yaml".into(), &text).unwrap();
        let mut fleet = Fleet::new(&scenario).unwrap();
        let duration = simulation::duration_of(&fleet, None);
        assert_eq!(duration, 1.0);
        let observed = simulation::simulate(&mut fleet, duration, None, |_, _| Ok(())).unwrap();
        let summaries = simulation::summaries(&fleet, &observed, 0.0);
        let result = simulation::results(&fleet, &observed, &summaries).unwrap();
        let again = [
            &result["tip_position_error"],
            &result["final"]["base_position"][0],
        ];
        let again = again.map(|value| value.as_f64().unwrap().to_bits());
        let bits: Vec<_> = row
            .results
            .iter()
            .map(|c| c.number().unwrap().to_bits())
            .collect();
        assert_eq!(bits, again);
        assert_eq!(row.verdict, Verdict::Success);
    }
}

#[test]
fn seeds_of_sensors_differ_between_runs_and_between_sensors() {
    let campaign = campaign(10, 1.0, "").unwrap();
    let seed = |run, node: &str, name: &str| {
        let scenario = campaign.scenario_of(run);
        let node = scenario
            .nodes()
            .iter()
            .find(|n| n.name() == node)
            .unwrap()
            .clone();
        scenario.declared(&node).unwrap()[name].clone()
    };
    assert_ne!(seed(0, "camera", "seed"), seed(1, "camera", "seed"));
    assert_ne!(seed(0, "camera", "seed"), seed(0, "dynamics", "imu.seed"));
    assert_eq!(seed(3, "camera", "seed"), seed(3, "camera", "seed"));
    // Positions of features are fixed parameters, not noise.
    let fixed = campaign_with_seed();
    assert_eq!(
        fixed.scenario_of(4).camera().map(|c| c.quality.seed),
        Ok(77)
    );
}

fn campaign_with_seed() -> Campaign {
    campaign(10, 1.0, "parameters: {camera.seed: 77}").unwrap()
}

#[test]
fn lists_advance_together_and_grids_have_all_combinations() {
    let text = "
scenario: package://fuyu/config/positioning.yaml
dispersions:
  camera.rate: {list: [1, 2.0]}
  camera.latency: {list: [0.1, 0.2]}
  controller.law: {grid: [transpose_jacobian, joint_pd]}
  controller.k_p: {apply: scale, grid: {min: 1.0, max: 2.0, count: 3}}
";
    let scenario = resource::resolve("package://fuyu/config/positioning.yaml").unwrap();
    let text_of_scenario = scenario.text(LARGEST_YAML).unwrap();
    let campaign = Campaign::new(
        "t.yaml".into(),
        text.to_owned(),
        scenario.path(),
        text_of_scenario,
        None,
    );
    let campaign = campaign.unwrap();
    assert_eq!(campaign.runs(), 12);
    let rows: Vec<_> = (0..12).map(|run| campaign.parameters_of(run)).collect();
    for (run, row) in rows.iter().enumerate() {
        let rate = [1.0, 2.0][run % 2];
        assert_eq!(row[..2], [Cell::Number(rate), Cell::Number(0.1 * rate)]);
        assert_eq!(row[3], Cell::Number([75.0, 112.5, 150.0][run / 2 % 3]));
        let law = ["transpose_jacobian", "joint_pd"][run / 6];
        assert_eq!(row[2], Cell::Text(law.to_owned()));
    }
}

#[test]
fn wrong_campaigns_are_refused_with_a_hint() {
    for (lines, expected) in [
        (
            "dispersions: {controller.kp: {normal: {sigma: 1.0}}}",
            "did you mean controller.k_p?",
        ),
        (
            "dispersions: {contoller.k_p: {normal: {sigma: 1.0}}}",
            "did you mean controller.k_p?",
        ),
        (
            "dispersions: {k_p: {normal: {sigma: 1.0}}}",
            "NODE.PARAMETER",
        ),
        (
            "dispersions: {controller.k_p: {normal: {sigma: -1.0}}}",
            "sigma is -1",
        ),
        (
            "dispersions: {controller.k_p: {uniform: {min: 2.0, max: 1.0}}}",
            "min must be below max",
        ),
        (
            "dispersions: {controller.k_p: {gaussian: {sigma: 1.0}}}",
            "gaussian",
        ),
        ("dispersions: {controller.k_p: {apply: add}}", "give one of"),
        (
            "dispersions: {controller.k_p: {integers: {min: 1, max: 2}, list: [1.0]}}",
            "list and integers are given",
        ),
        (
            "dispersions: {controller.law: {normal: {sigma: 1.0}}}",
            "use list, grid or choice",
        ),
        (
            "dispersions: {camera.seed: {uniform: {min: 0.0, max: 9.0}}}",
            "use integers",
        ),
        (
            "dispersions: {controller.k_p: {rotation: {}}}",
            "a quaternion",
        ),
        (
            "dispersions: {camera.goal.position: {normal: {sigma: [1.0, 2.0]}}}",
            "the parameter has 3",
        ),
        (
            "dispersions: {'camera.goal.position[3]': {normal: {sigma: 1.0}}}",
            "has 3 elements",
        ),
        (
            "dispersions: {dynamics.initial_joint_velocities: {normal: {sigma: 1.0}}}",
            "is empty",
        ),
        (
            "dispersions: {camera.goal.position: {normal: {sigma: 1.0}}, 'camera.goal.position[0]': {normal: {sigma: 1.0}}}",
            "dispersed twice",
        ),
        (
            "correlated: [{parameters: [controller.k_p, controller.k_o], covariance: [[1.0, 2.0], [2.0, 1.0]]}]",
            "positive semidefinite",
        ),
        ("parameters: {controller.k_p: big}", "expected a double"),
        (
            "keep: {results: [tip_positon_error]}",
            "did you mean tip_position_error?",
        ),
        (
            "keep: {series: {period: 1.0, values: [q.joint_9]}}",
            "keep.series.values",
        ),
        (
            "keep: {series: {period: 0.0, values: []}}",
            "keep.series.period",
        ),
        ("success: ['tip_position_error << 1']", "no criterion"),
        (
            "success: ['tip_error < 1']",
            "a run has no result tip_error",
        ),
        ("time_limit: -1.0", "time_limit is -1"),
        ("samplig: sobol", "samplig"),
    ] {
        let Err(error) = campaign(10, 1.0, lines) else {
            panic!("{lines} is accepted");
        };
        assert!(error.contains(expected), "{lines}: {error}");
        assert!(error.contains("test.yaml"), "{lines}: {error}");
        assert_eq!(error.lines().count(), 1, "{error}");
    }
}

// Coverage of the interval over 200 campaigns of 100 runs with a known probability, through drawn parameters and
// criteria. For a coverage of at least 95 %, fewer than 180 hits have probability 0.001.
#[test]
fn the_success_interval_contains_a_known_probability() {
    let mut contained = 0;
    let lines = "dispersions: {camera.position_noise: {uniform: {min: 0.0, max: 1.0}}}\nsuccess: ['camera.position_noise < 0.9']";
    let base = campaign(20_000, 1.0, lines).unwrap();
    let criterion = &base.criteria()[0];
    for part in 0..200 {
        let runs = part * 100..(part + 1) * 100;
        let met = runs
            .filter(|run| criterion.is_met(Some(numbers(&base, *run)[0])))
            .count();
        let interval = fuyu_campaign::success_interval(met as u64, 100, 0.95);
        contained += u32::from((interval.lower..=interval.upper).contains(&0.9));
    }
    assert!((180..=200).contains(&contained), "{contained} of 200");
    println!("the interval contains the probability in {contained} of 200 campaigns");
}

fn options(jobs: usize) -> RangeOptions {
    RangeOptions {
        jobs,
        workers: Workers::Threads,
    }
}

#[test]
fn what_goes_wrong_in_a_run_is_a_row() {
    let lines = "dispersions: {camera.dropout: {list: [0.0, 2.0, 0.5]}}\nsuccess: ['tip_position_error < 1.0e-9']";
    let campaign = campaign(3, 0.5, lines).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let dataset = Dataset::create(&campaign, &folder.path().join("out")).unwrap();
    run_range(&campaign, &dataset, 0..=2, &options(2), |_| Continue(())).unwrap();
    let rows = dataset.rows().unwrap();
    assert_eq!(rows[0].verdict, Verdict::Failure);
    assert_eq!(
        rows[0].reason.as_deref(),
        Some("tip_position_error < 1.0e-9")
    );
    assert_eq!(rows[1].verdict, Verdict::Error);
    let reason = rows[1].reason.as_deref().unwrap();
    assert!(
        reason.contains("dropout") && reason.contains("out of range"),
        "{reason}"
    );
    assert_eq!(rows[1].parameters, [Cell::Number(2.0)]);
    let summary = Summary::of(&dataset, 0.95).unwrap();
    assert_eq!(
        (
            summary.completed,
            summary.verdicts["error"],
            summary.verdicts["failure"]
        ),
        (3, 1, 2)
    );
    assert_eq!(summary.success_rate, Some(0.0));
}

#[test]
fn a_run_beyond_its_time_is_a_row() {
    let campaign = campaign(2, 60.0, "time_limit: 1.0e-6").unwrap();
    let row = campaign.run_one(1, None).unwrap();
    assert_eq!(row.verdict, Verdict::Timeout);
    assert_eq!(
        row.reason.as_deref(),
        Some("exceeded the time limit of 0.000001 s")
    );
}

fn together(campaign: &Campaign, runs: &[u64]) -> Vec<Row> {
    let mut rows = Vec::new();
    let computed = campaign.run_together(runs, None, |row| {
        rows.push(row);
        Ok(())
    });
    computed.unwrap();
    rows
}

// Other runs in the lanes, and how they end, must not change a run.
#[test]
fn runs_together_are_those_alone() {
    let lines = "dispersions:\n  camera.dropout: {list: [0.0, 0.3, 2.0, 0.5, 0.1, 0.0, 0.2, 0.9, 0.4, 0.7]}\n  \
                 dynamics.initial_joint_positions: {apply: add, normal: {sigma: 0.1}}\n  \
                 dynamics.time_step: {list: [0.01, 0.005, 0.01, 0.01, 0.01, 0.005, 0.01, 0.01, 0.01, 0.01]}\n\
                 success: ['tip_position_error < 1.7']";
    let campaign = campaign(10, 2.0, lines).unwrap();
    let runs: Vec<_> = (0..10).collect();
    let without_time = |mut row: Row| {
        row.wall_time = 0.0;
        row
    };
    let together = together(&campaign, &runs);
    let together: Vec<_> = together.into_iter().map(without_time).collect();
    let alone = runs.iter().map(|run| campaign.run_one(*run, None).unwrap());
    let alone: Vec<_> = alone.map(without_time).collect();
    assert_eq!(together, alone);
    let verdicts: Vec<_> = alone.iter().map(|row| row.verdict).collect();
    assert_eq!(verdicts[2], Verdict::Error);
    assert!(verdicts.contains(&Verdict::Success) || verdicts.contains(&Verdict::Failure));
}

// Runs together compute only the figures that are kept or judged, runs alone compute all: this fails if one of the
// former is left out.
#[test]
fn kept_figures_of_runs_together_are_those_alone() {
    for lines in [
        "keep: {results: [tip_position_error, max_tip_speed, 'final.base_position[0]']}",
        "keep: {results: [max_tip_acceleration]}",
        "keep: {results: [max_base_angular_acceleration]}",
        "keep: {results: [momentum_residual.angular]}",
        "keep: {results: [tip_attitude_error]}\nsuccess: ['energy_residual < 1.0']",
    ] {
        let campaign = campaign(2, 0.2, lines).unwrap();
        let together = together(&campaign, &[0, 1]);
        for (row, run) in together.iter().zip([0, 1]) {
            let alone = campaign.run_one(run, None).unwrap();
            assert!(row.results.iter().all(|cell| cell.number().is_some()));
            assert_eq!((&row.results, row.verdict), (&alone.results, alone.verdict));
        }
    }
}

#[test]
fn runs_together_that_take_too_long_are_rows() {
    let campaign = campaign(2, 60.0, "time_limit: 1.0e-6").unwrap();
    let rows = together(&campaign, &[0, 1]);
    assert!(rows.iter().all(|row| row.verdict == Verdict::Timeout));
}

#[test]
fn series_and_bags_are_kept() {
    let lines = "dispersions: {camera.rate: {list: [10.0, 20.0]}}\n\
        success: ['camera.rate > 15']\n\
        keep: {bags: failed, series: {period: 0.1, values: [tip_position_error, 'base_position[0]']}}";
    let campaign = campaign(2, 0.5, lines).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let dataset = Dataset::create(&campaign, &folder.path().join("out")).unwrap();
    run_range(&campaign, &dataset, 0..=1, &options(1), |_| Continue(())).unwrap();
    let out = dataset.folder();
    assert!(out.join("bags/run-000000000/metadata.yaml").exists());
    assert!(!out.join("bags/run-000000001").exists());
    let (names, rows) = table::read(&out.join("series/run-000000001.parquet")).unwrap();
    assert_eq!(names, ["time", "tip_position_error", "base_position[0]"]);
    assert_eq!(rows.len(), 6);
    assert!((rows[5][0].number().unwrap() - 0.5).abs() < 1e-9);
    assert!(rows.iter().all(|row| row[1].number().unwrap() > 0.0));
}
