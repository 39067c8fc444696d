//! `fuyu campaign`.

use std::{
    fs,
    path::Path,
    process::{Command, Stdio},
    thread,
    time::Duration,
};

use serde_json::Value;

use super::fuyu::{file, fuyu};

const CAMPAIGN: &str = "
scenario: package://fuyu/config/positioning.yaml
runs: 600
seed: 42
duration: 0.3
dispersions:
  controller.k_p: {normal: {mean: 75.0, sigma: 5.0}}
  dynamics.base.angular_velocity: {sphere: {radius: 0.01}}
  camera.position_noise: {uniform: {min: 0.0, max: 0.01}}
keep: {results: [tip_position_error, max_tip_speed, 'base_displacement[0]']}
success: [max_tip_speed < 0.4, tip_position_error < 10.0]
";

fn run(config: &Path, output: &Path, more: &[&str]) -> Vec<String> {
    let [config, output] = [config, output].map(|p| p.to_str().unwrap().to_owned());
    let mut args = vec![
        "campaign".into(),
        "run".into(),
        config,
        "--output".into(),
        output,
    ];
    args.extend(more.iter().map(|arg| (*arg).to_owned()));
    args
}

/// The files of the results and their contents.
fn results(output: &Path) -> Vec<(String, Vec<u8>)> {
    let files = fs::read_dir(output.join("results")).unwrap().map(|file| {
        let file = file.unwrap();
        (
            file.file_name().into_string().unwrap(),
            fs::read(file.path()).unwrap(),
        )
    });
    let mut files: Vec<_> = files.collect();
    files.sort();
    files
}

#[test]
fn a_campaign_killed_ten_times_has_the_same_bytes() {
    let (folder, config) = file("campaign.yaml", CAMPAIGN);
    let whole = folder.path().join("whole");
    let summary = fuyu(&run(&config, &whole, &["--json", "--jobs", "1"])).json();
    assert_eq!(summary["completed"], 600);
    let killed = folder.path().join("killed");
    for kill in 0..10 {
        let mut child = Command::new(env!("CARGO_BIN_EXE_fuyu"))
            .args(run(&config, &killed, &["--jobs", "3"]))
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        thread::sleep(Duration::from_millis(80 + 37 * kill));
        child.kill().unwrap();
        child.wait().unwrap();
    }
    let again = Command::new(env!("CARGO_BIN_EXE_fuyu"))
        .args(run(&config, &killed, &["--json", "--jobs", "3"]))
        .output()
        .unwrap();
    assert_eq!(again.status.code(), Some(0));
    let (whole_files, killed_files) = (results(&whole), results(&killed));
    assert_eq!(whole_files.len(), 3);
    assert!(whole_files == killed_files, "the results differ");
    let mut again: Value = serde_json::from_slice(&again.stdout).unwrap();
    let mut summary = summary;
    // Wall times are never the same.
    summary["wall_time"].take();
    again["wall_time"].take();
    assert_eq!(summary, again);
}

#[test]
fn a_run_that_is_shown_repeats_to_the_bit() {
    let text = CAMPAIGN.replace("runs: 600", "runs: 10");
    let (folder, config) = file("campaign.yaml", text);
    let output = folder.path().join("out");
    let run_all = fuyu(&run(&config, &output, &[]));
    assert_eq!((run_all.code, run_all.stderr.as_str()), (0, ""));
    assert!(
        run_all.stdout.contains("success rate"),
        "{}",
        run_all.stdout
    );
    // Where it was started does not matter any more.
    fs::remove_file(&config).unwrap();
    let dataset = fuyu::experiments::campaign::Dataset::open(&output).unwrap();
    for row in dataset.rows().unwrap() {
        let number = row.run.to_string();
        let shown = fuyu(&[
            "campaign",
            "show",
            output.to_str().unwrap(),
            "--run",
            &number,
        ]);
        assert_eq!(shown.code, 0, "{}", shown.stderr);
        let (_folder, scenario) = file("shown.yaml", &shown.stdout);
        let result = fuyu(&["simulate", scenario.to_str().unwrap(), "--json"]);
        // The text of JSON has the shortest digits that give the same number; reading it may lose the last bit.
        for (name, cell) in ["tip_position_error", "max_tip_speed"]
            .iter()
            .zip(&row.results)
        {
            let number = Value::from(cell.number().unwrap());
            let expected = format!("\"{name}\":{number},");
            assert!(
                result.stdout.contains(&expected),
                "{expected} {}",
                result.stdout
            );
        }
    }
}

#[test]
fn wrong_input_is_refused_in_one_line() {
    let (folder, config) = file("campaign.yaml", CAMPAIGN);
    let output = folder.path().join("out");
    let edited = |from: &str, to: &str| {
        assert!(CAMPAIGN.contains(from));
        fs::write(
            folder.path().join("edited.yaml"),
            CAMPAIGN.replace(from, to),
        )
        .unwrap();
        let run = fuyu(&run(&folder.path().join("edited.yaml"), &output, &[]));
        let refusal = run.refusal().to_owned();
        assert!(refusal.contains("edited.yaml"), "{refusal}");
        assert!(!output.exists());
        refusal
    };
    for (from, to, expected) in [
        (
            "controller.k_p:",
            "controller.kp:",
            "did you mean controller.k_p?",
        ),
        ("sigma: 5.0", "sigma: -5.0", "sigma is -5"),
        (
            "min: 0.0, max: 0.01",
            "min: 0.02, max: 0.01",
            "min must be below max",
        ),
        (
            "max_tip_speed,",
            "max_tip_sped,",
            "did you mean max_tip_speed?",
        ),
        ("positioning.yaml", "positoning.yaml", "positoning.yaml"),
        ("seed: 42", "seed: [", "edited.yaml"),
    ] {
        let refusal = edited(from, to);
        assert!(refusal.contains(expected), "{refusal}");
    }
    let other = |args: &[&str], expected: &str| {
        let run = fuyu(args);
        assert!(run.refusal().contains(expected), "{}", run.stderr);
    };
    let config = config.to_str().unwrap();
    let out = output.to_str().unwrap();
    other(
        &["campaign", "show", out, "--run", "1"],
        "is no folder of a campaign",
    );
    other(&["campaign", "summary", out], "is no folder of a campaign");
    other(
        &[
            "campaign",
            "run",
            config,
            "--output",
            folder.path().to_str().unwrap(),
        ],
        "is not empty and holds no campaign",
    );
    other(
        &[
            "campaign", "run", config, "--output", out, "--engine", "dask",
        ],
        "--address",
    );
    // Nothing listens at port 1.
    let dask = [
        "campaign",
        "run",
        config,
        "--output",
        out,
        "--engine",
        "dask",
        "--address",
    ];
    for (address, problem) in [
        ("tcp://127.0.0.1:1", "Connection refused"),
        ("127.0.0.1:1", "Connection refused"),
        ("tcp://127.0.0.1", "invalid socket address"),
        (
            "tcp://no-such-host.invalid:8786",
            "failed to lookup address",
        ),
    ] {
        let refused = format!("--address {address}: no Dask scheduler answers: {problem}");
        other(&[&dask[..], &[address]].concat(), &refused);
    }
    other(
        &[
            "campaign",
            "run-range",
            config,
            "--output",
            out,
            "--first",
            "5",
            "--last",
            "600",
        ],
        "runs 0 to 599",
    );
    assert!(!output.exists());
}

// A limit of the size of files stands for a full disk: both make `write` fail.
#[test]
fn a_full_disk_is_one_line_and_the_campaign_continues_later() {
    let text = CAMPAIGN.replace("runs: 600", "runs: 40");
    let (folder, config) = file("campaign.yaml", text);
    let output = folder.path().join("out");
    let limited = Command::new("bash")
        .args([
            "-c",
            "trap '' XFSZ; ulimit -f 6; exec \"$0\" \"$@\"",
            env!("CARGO_BIN_EXE_fuyu"),
        ])
        .args(run(&config, &output, &[]))
        .output()
        .unwrap();
    let stderr = String::from_utf8(limited.stderr).unwrap();
    assert_eq!(limited.status.code(), Some(1), "{stderr}");
    assert_eq!(stderr.lines().count(), 1, "{stderr}");
    assert!(
        stderr.contains("part-000000") && stderr.contains("cannot be written"),
        "{stderr}"
    );
    let again = fuyu(&run(&config, &output, &["--json"]));
    assert_eq!(again.code, 0, "{}", again.stderr);
    let whole = folder.path().join("whole");
    assert_eq!(fuyu(&run(&config, &whole, &[])).code, 0);
    assert!(results(&output) == results(&whole));
}

// A file system that is really full.
#[test]
fn a_full_file_system_is_one_line() {
    let text = CAMPAIGN.replace("runs: 600", "runs: 40");
    let (folder, config) = file("campaign.yaml", text);
    let mount = folder.path().join("small");
    fs::create_dir(&mount).unwrap();
    // In namespaces of its own, so that neither root nor cleaning up is needed.
    let in_namespace = |command: &[String]| {
        let script = r#"mount -t tmpfs -o size=16k tmpfs "$1" || exit 77; shift; exec "$@""#;
        let output = Command::new("unshare")
            .args(["--user", "--map-root-user", "--mount", "bash", "-c", script])
            .args(["bash", mount.to_str().unwrap()])
            .args(command)
            .output();
        output.ok()
    };
    let works = in_namespace(&["true".to_owned()]);
    if works.is_none_or(|output| output.status.code() != Some(0)) {
        eprintln!("SKIPPED: no file system can be mounted in a user namespace here");
        return;
    }
    let mut command = vec![env!("CARGO_BIN_EXE_fuyu").to_owned()];
    command.extend(run(&config, &mount.join("out"), &[]));
    let output = in_namespace(&command).unwrap();
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{stderr}");
    assert_eq!(stderr.lines().count(), 1, "{stderr}");
    let says = "cannot be written: No space left on device";
    assert!(
        stderr.contains("journal/part-000000") && stderr.contains(says),
        "{stderr}"
    );
}

#[test]
fn the_summary_has_interval_worst_runs_sensitivities_and_pictures() {
    let text = CAMPAIGN.replace("runs: 600", "runs: 60");
    let (folder, config) = file("campaign.yaml", text);
    let output = folder.path().join("out");
    assert_eq!(fuyu(&run(&config, &output, &[])).code, 0);
    let out = output.to_str().unwrap();
    let summary = fuyu(&["campaign", "summary", out, "--json", "--plots"]).json();
    let interval = &summary["confidence_interval"];
    let rate = summary["success_rate"].as_f64().unwrap();
    assert!(
        interval["lower"].as_f64().unwrap() <= rate && rate <= interval["upper"].as_f64().unwrap()
    );
    assert_eq!(summary["worst"].as_array().unwrap().len(), 10);
    // A larger gain gives a faster tip.
    let sensitivities = summary["sensitivities"].as_array().unwrap();
    let found = sensitivities
        .iter()
        .find(|s| s["result"] == "max_tip_speed" && s["parameter"] == "controller.k_p");
    assert!(found.unwrap()["rho"].as_f64().unwrap() > 0.4, "{found:?}");
    assert!(output.join("plots/success_rate.svg").exists());
    assert!(output.join("plots/distribution-max_tip_speed.png").exists());
    let text = fuyu(&["campaign", "summary", out]).stdout;
    for words in [
        "60 of 60 runs",
        "success rate",
        "worst runs",
        "rank correlations",
    ] {
        assert!(text.contains(words), "{words}: {text}");
    }
}

#[test]
fn every_campaign_that_comes_with_fuyu_can_run() {
    let folder = tempfile::tempdir().unwrap();
    let configs = concat!(env!("CARGO_MANIFEST_DIR"), "/config/campaigns");
    for config in fs::read_dir(configs).unwrap() {
        let config = config.unwrap().path();
        let output = folder.path().join(config.file_stem().unwrap());
        // Progress of a slow one goes to stderr.
        let done = fuyu(&run(&config, &output, &["--runs", "1", "--json"]));
        assert_eq!(done.code, 0, "{}", done.stderr);
        let summary: Value = serde_json::from_str(&done.stdout).unwrap();
        assert_eq!(summary["completed"], 1, "{}", config.display());
        for broken in ["error", "panic", "crash", "timeout"] {
            assert_eq!(
                summary["verdicts"][broken],
                0,
                "{}: {summary}",
                config.display()
            );
        }
    }
}
