//! Runs in processes that hang, die or do not start.

use std::{ops::ControlFlow, os::unix::fs::PermissionsExt};

use super::*;

// A row must be available before later runs are done.
#[test]
fn a_row_is_there_before_the_next_run_begins() {
    let lines = "keep: {series: {period: 0.1, values: [tip_position_error]}}";
    let campaign = campaign(3, 0.2, lines).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let mut seen = Vec::new();
    let ended = campaign.run_together(&[0, 1, 2], Some(folder.path()), |row| {
        let series = fs::read_dir(folder.path().join("series")).unwrap().count();
        seen.push((row.run, series));
        match row.run {
            1 => Err(CampaignError::Runtime("enough".to_owned())),
            _ => Ok(()),
        }
    });
    assert_eq!(ended, Err(CampaignError::Runtime("enough".to_owned())));
    assert_eq!(seen, [(0, 1), (1, 2)]);
}

/// An executable that is not a worker.
fn worker(folder: &Path, script: &str) -> Workers {
    let path = folder.join("worker.sh");
    fs::write(&path, format!("#!/bin/sh\n{script}\n")).unwrap();
    fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).unwrap();
    Workers::Processes(vec![path.into()])
}

/// Computes all runs of a campaign in a new dataset below `folder`, with one process of a script. Returns the dataset
/// and the progress.
fn computed(
    campaign: &Campaign,
    folder: &Path,
    script: &str,
    progress: impl FnMut(Progress) -> ControlFlow<()>,
) -> (Dataset, Result<Progress, CampaignError>) {
    let dataset = Dataset::create(campaign, &folder.join("out")).unwrap();
    let options = RangeOptions {
        jobs: 1,
        workers: worker(folder, script),
    };
    let all = 0..=campaign.runs() - 1;
    let reached = run_range(campaign, &dataset, all, &options, progress);
    (dataset, reached)
}

#[test]
fn a_process_that_hangs_or_dies_is_a_row() {
    for (script, verdict, reason) in [
        (
            "echo '\"ready\"'; exec sleep 600",
            Verdict::Timeout,
            "exceeded the time limit of 0.1 s",
        ),
        (
            "echo '\"ready\"'; read run; kill -11 $$",
            Verdict::Crash,
            "signal: 11",
        ),
        (
            "echo '\"ready\"'; read run; exit 3",
            Verdict::Crash,
            "exit status: 3",
        ),
    ] {
        let campaign = campaign(1, 1.0, "time_limit: 0.1").unwrap();
        let folder = tempfile::tempdir().unwrap();
        let (dataset, reached) = computed(&campaign, folder.path(), script, |_| Continue(()));
        reached.unwrap();
        let rows = dataset.rows().unwrap();
        assert_eq!(rows[0].verdict, verdict, "{rows:?}");
        assert!(
            rows[0].reason.as_deref().unwrap().contains(reason),
            "{rows:?}"
        );
    }
}

// A process that cannot start is not the fault of a run, even if it is not the first process: rows would be permanent.
#[test]
fn a_process_that_cannot_start_ends_the_campaign_without_rows() {
    for (script, expected) in [
        ("exit 3", "ended before it was ready: exit status: 3"),
        ("echo hello", "its first line on stdout is \"hello\""),
        (
            "echo '{\"error\": \"another description\"}'",
            "worker.sh: another description",
        ),
        (
            "test -e $1/started && exit 4; touch $1/started; echo '\"ready\"'; read run; exit 3",
            "ended before it was ready: exit status: 4",
        ),
    ] {
        for runs in [1, 40] {
            let campaign = campaign(runs, 1.0, "").unwrap();
            let folder = tempfile::tempdir().unwrap();
            let (dataset, ended) = computed(&campaign, folder.path(), script, |_| Continue(()));
            let Err(CampaignError::Runtime(problem)) = ended else {
                panic!("{script}: {ended:?}");
            };
            assert!(problem.contains(expected), "{problem}");
            assert_eq!(dataset.rows().unwrap(), []);
        }
    }
}

// The run would take ten minutes, and so would the test if the stop request were ignored.
#[test]
fn a_stop_request_ends_a_run() {
    for script in [
        "echo $$ > $1/pid; echo '\"ready\"'; exec sleep 600",
        // During the start.
        "echo $$ > $1/pid; exec sleep 600",
    ] {
        for runs in [1, 40] {
            let campaign = campaign(runs, 1.0, "time_limit: 600.0").unwrap();
            let folder = tempfile::tempdir().unwrap();
            let pid = folder.path().join("out/pid");
            let written = || fs::read_to_string(&pid).is_ok_and(|text| text.ends_with('\n'));
            let stop = |_| match written() {
                true => Break(()),
                false => Continue(()),
            };
            let (dataset, reached) = computed(&campaign, folder.path(), script, stop);
            assert_eq!(reached.unwrap().done, 0);
            assert_eq!(dataset.rows().unwrap(), []);
            let pid = fs::read_to_string(&pid).unwrap();
            let process = Path::new("/proc").join(pid.trim());
            assert!(!process.exists(), "the process is still there");
        }
    }
}

// If only bags of failed runs are kept, a failed run is simulated twice, each time up to the limit.
#[test]
fn a_repetition_for_the_bag_has_its_own_time() {
    let lines = |bags: &str| {
        format!(
            "time_limit: 100.0\nsuccess: ['tip_position_error < 1.0e-9']\nkeep: {{bags: {bags}}}"
        )
    };
    let once = campaign(1, 1.0, &lines("none")).unwrap();
    assert!((engine::longest_wait(&once, 0) - 115.0).abs() < 1e-9);
    let twice = campaign(1, 1.0, &lines("failed")).unwrap();
    assert!((engine::longest_wait(&twice, 0) - 225.0).abs() < 1e-9);
    let folder = tempfile::tempdir().unwrap();
    // The repetition takes at least as long but does not count in the wall time; other load may interrupt the first
    // attempt.
    let is_first = (0..10).any(|_| {
        let start = std::time::Instant::now();
        let row = twice.run_one(0, Some(folder.path())).unwrap();
        assert_eq!(row.verdict, Verdict::Failure);
        row.wall_time < 0.7 * start.elapsed().as_secs_f64()
    });
    assert!(is_first);
}
