//! Datasets filled by several processes, or continued.

use super::*;

#[test]
fn a_range_may_be_ended_and_continued() {
    let campaign = campaign(40, 0.1, DISPERSIONS).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let dataset = Dataset::create(&campaign, &folder.path().join("out")).unwrap();
    let until = |least: u64| {
        let control = move |p: Progress| match p.done >= least {
            true => Break(()),
            false => Continue(()),
        };
        run_range(&campaign, &dataset, 0..=39, &options(2), control).unwrap()
    };
    assert_eq!(until(0), Progress { done: 0, total: 40 });
    // Rows computed before the stop are kept: 4 waiting to be written, and 1 in each of the 2 threads.
    let Progress { done, total: 40 } = until(5) else {
        unreachable!("the range has 40 runs")
    };
    assert!((5..=11).contains(&done), "{done}");
    assert_eq!(dataset.rows().unwrap().len() as u64, done);
    assert_eq!(until(41).done, 40);
    assert_eq!(dataset.rows().unwrap().len(), 40);
}

/// The contents of the result files.
fn bytes(dataset: &Dataset) -> Vec<(String, Vec<u8>)> {
    let files = fs::read_dir(dataset.folder().join("results")).unwrap();
    let read = files.map(|file| {
        let file = file.unwrap();
        (
            file.file_name().into_string().unwrap(),
            fs::read(file.path()).unwrap(),
        )
    });
    let mut all: Vec<_> = read.collect();
    all.sort();
    all
}

#[test]
fn ranges_order_and_threads_do_not_change_the_dataset() {
    let campaign = campaign(300, 0.02, DISPERSIONS).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let dataset = |name: &str| Dataset::create(&campaign, &folder.path().join(name)).unwrap();
    let whole = dataset("whole");
    run_range(&campaign, &whole, 0..=299, &options(1), |_| Continue(())).unwrap();
    // Ranges that do not end at table boundaries, computed at the same time in any order, one of them twice.
    let parts = dataset("parts");
    std::thread::scope(|scope| {
        for range in [200..=299, 0..=99, 100..=199, 0..=99, 50..=260] {
            let (campaign, parts) = (&campaign, &parts);
            scope.spawn(move || {
                run_range(campaign, parts, range, &options(2), |_| Continue(())).unwrap()
            });
        }
    });
    assert_eq!(bytes(&whole).len(), 2);
    assert_eq!(bytes(&whole), bytes(&parts));
    let rows = whole.rows().unwrap();
    assert_eq!(
        rows.iter().map(|row| row.run).collect::<Vec<_>>(),
        (0..300).collect::<Vec<_>>()
    );
}

#[test]
fn a_journal_with_a_line_that_was_cut_off_continues() {
    let campaign = campaign(8, 0.02, "").unwrap();
    let folder = tempfile::tempdir().unwrap();
    let dataset = |name: &str| Dataset::create(&campaign, &folder.path().join(name)).unwrap();
    let whole = dataset("whole");
    run_range(&campaign, &whole, 0..=7, &options(1), |_| Continue(())).unwrap();
    let cut = dataset("cut");
    run_range(&campaign, &cut, 0..=4, &options(1), |_| Continue(())).unwrap();
    let journal = cut.folder().join("journal/part-000000.0-4.jsonl");
    let text = fs::read(&journal).unwrap();
    fs::write(&journal, &text[..text.len() - 7]).unwrap();
    assert_eq!(cut.rows().unwrap().len(), 4);
    run_range(&campaign, &cut, 0..=4, &options(1), |_| Continue(())).unwrap();
    run_range(&campaign, &cut, 0..=7, &options(1), |_| Continue(())).unwrap();
    assert_eq!(bytes(&whole), bytes(&cut));
    assert!(!journal.exists());
}

// A process with fewer runs completes its table while another one adds rows beyond it: these rows must not be removed
// with the journal.
#[test]
fn rows_of_a_process_with_more_runs_stay() {
    let sized = |runs| {
        let small = campaign(300, 0.02, "").unwrap();
        Campaign::new(
            small.path.clone(),
            small.text.clone(),
            small.scenario.path().to_owned(),
            small.scenario_text.clone(),
            Some(runs),
        )
        .unwrap()
    };
    let (few, many) = (sized(300), sized(500));
    let row = |run| many.lost(run, Verdict::Timeout, "late".to_owned(), 1.0);
    for is_removed in [false, true] {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("out");
        let datasets = [&few, &many].map(|campaign| Dataset::create(campaign, &out).unwrap());
        let [less, more] = datasets.each_ref();
        let mut long = range::RangeWriter::new(more, 256..=499).unwrap();
        (300..=400).for_each(|run| long.add(&row(run)).unwrap());
        let mut short = range::RangeWriter::new(less, 256..=299).unwrap();
        (256..=299).for_each(|run| short.add(&row(run)).unwrap());
        assert_eq!(more.rows().unwrap().len(), 44 + 101);
        drop(short);
        let journal = out.join("journal/part-000001.256-499.jsonl");
        assert!(journal.exists());
        // Removed, as if the other process had read it just before a row was added.
        if is_removed {
            fs::remove_file(&journal).unwrap();
        }
        (401..=499).for_each(|run| long.add(&row(run)).unwrap());
        (256..=299).for_each(|run| long.add(&row(run)).unwrap());
        assert_eq!(more.rows().unwrap().len(), 244);
        assert!(!journal.exists());
        // Repeating the first range changes nothing.
        range::RangeWriter::new(less, 256..=299).unwrap();
        assert_eq!(more.rows().unwrap().len(), 244);
    }
}

#[test]
fn a_campaign_can_grow_and_a_latin_hypercube_cannot() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let grown = |runs, sampling: &str, out: &Path| {
        let lines = format!(
            "sampling: {sampling}\ndispersions: {{controller.k_p: {{uniform: {{min: 70.0, max: 80.0}}}}}}"
        );
        let small = campaign(10, 0.02, &lines).unwrap();
        let scenario = (
            small.scenario.path().to_owned(),
            small.scenario_text.clone(),
        );
        let large = Campaign::new(
            small.path.clone(),
            small.text.clone(),
            scenario.0,
            scenario.1,
            Some(runs),
        );
        let large = large.unwrap();
        Dataset::create(&large, out).map(|dataset| (large, dataset))
    };
    for runs in [4, 10] {
        let (campaign, dataset) = grown(runs, "random", &out).unwrap();
        run_range(&campaign, &dataset, 0..=runs - 1, &options(1), |_| {
            Continue(())
        })
        .unwrap();
        assert_eq!(dataset.rows().unwrap().len() as u64, runs);
    }
    let fewer = grown(4, "random", &out).map(drop).unwrap_err().to_string();
    assert!(fewer.contains("10 runs; give at least as many"), "{fewer}");
    let other = grown(10, "sobol", &out).map(drop).unwrap_err().to_string();
    assert!(other.contains("another text"), "{other}");
    let cube = folder.path().join("cube");
    grown(4, "latin_hypercube", &cube).unwrap();
    let error = grown(10, "latin_hypercube", &cube)
        .map(drop)
        .unwrap_err()
        .to_string();
    assert!(error.contains("cannot grow"), "{error}");
}
