//! `fuyu reproduce`: names, tables, JSON, pictures, exit codes. The command itself
//! and tests/validation check the numbers.

use serde_json::Value;
use std::fs;

use crate::fuyu::{Run, fuyu};

fn names() -> Vec<String> {
    let Run { code, stdout, .. } = fuyu(&["reproduce", "--list"]);
    assert_eq!(code, 0);
    stdout.lines().map(str::to_owned).collect()
}

fn keys(object: &Value) -> Vec<&str> {
    let mut keys: Vec<_> = object
        .as_object()
        .unwrap()
        .keys()
        .map(String::as_str)
        .collect();
    keys.sort_unstable();
    keys
}

/// Checks the form of a report that scripts rely on; true if all of its rows passed.
fn well_formed(report: &Value) -> bool {
    assert_eq!(
        keys(report),
        ["name", "notes", "passed", "rows"],
        "{report}"
    );
    assert!(
        report["notes"]
            .as_array()
            .unwrap()
            .iter()
            .all(Value::is_string)
    );
    let rows = report["rows"].as_array().unwrap();
    assert!(!rows.is_empty(), "{report}");
    for row in rows {
        let expected = [
            "computed",
            "own_claim",
            "passed",
            "published",
            "quantity",
            "tolerance",
        ];
        assert_eq!(keys(row), expected, "{row}");
        assert_eq!(row["own_claim"], row["published"].is_null(), "{row}");
        assert!(
            row["quantity"].is_string() && row["computed"].is_f64(),
            "{row}"
        );
        if let (Some(published), Some(tolerance)) =
            (row["published"].as_f64(), row["tolerance"].as_f64())
        {
            let near = (row["computed"].as_f64().unwrap() - published).abs() <= tolerance;
            assert_eq!(row["passed"], near, "{row}");
        }
    }
    let passed = rows.iter().all(|row| row["passed"] == true);
    assert_eq!(report["passed"], passed);
    passed
}

/// Names of the results that need hundreds of motions, some of which take minutes.
fn sweeps(name: &str) -> bool {
    name.starts_with("masutani-fig-3.") || name.starts_with("masutani-table-3.")
}

#[test]
fn all_that_is_published_is_reproduced() {
    let names = names();
    for name in names.iter().filter(|name| !sweeps(name)) {
        let json = fuyu(&["reproduce", name, "--json"]).json();
        assert_eq!(json["name"], name.as_str());
        assert!(well_formed(&json), "{json}");
    }
    for number in 2..=7 {
        assert!(names.contains(&format!("masutani-table-3.{number}")));
    }
    for number in 18..=52 {
        assert!(names.contains(&format!("masutani-fig-3.{number}")));
    }
    for number in 1..=12 {
        assert!(names.contains(&format!("kida-table-2.{number}")));
    }
}

/// A sweep by the thesis's method: a second on two cores.
#[test]
fn a_table_of_models_is_reproduced_cell_by_cell() {
    let name = "masutani-table-3.3";
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().to_str().unwrap();
    let run = fuyu(&["reproduce", name, "--output", output]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    // Rows of letters: printed, computed, and where they differ.
    assert!(
        run.stdout
            .contains("OOOOOOOOOOOOOv   OOOOOOOOOOOOO/   .............x")
    );
    let svg = fs::read_to_string(folder.path().join(format!("{name}.svg"))).unwrap();
    assert!(svg.contains("printed") && svg.contains("axisymmetric"));
    let run = fuyu(&["reproduce", name, "--json"]);
    let json: Value = serde_json::from_str(&run.stdout).expect("one JSON object");
    assert!(run.code == 0 && well_formed(&json), "{json}");
}

#[test]
fn one_is_a_table_an_object_and_files() {
    let name = "masutani-fig-5.3";
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("new").join("folder");
    let output = output.to_str().unwrap();
    let json = fuyu(&["reproduce", name, "--json", "--output", output]).json();
    assert_eq!(json["name"], name);
    assert!(well_formed(&json));

    let read = |ending: &str| fs::read(format!("{output}/{name}.{ending}")).unwrap();
    let text = |ending: &str| String::from_utf8(read(ending)).unwrap();
    assert!(text("svg").contains("path of the tip"));
    let png = read("png");
    assert!(png.starts_with(b"\x89PNG") && png.len() > 10_000);
    let rows = json["rows"].as_array().unwrap();
    assert_eq!(text("csv").lines().count(), 1 + rows.len());

    let table = fuyu(&["reproduce", name]);
    assert_eq!((table.code, table.stderr.as_str()), (0, ""));
    for row in rows {
        let quantity = row["quantity"].as_str().unwrap();
        assert!(table.stdout.contains(quantity), "{}", table.stdout);
        assert!(text("md").contains(quantity));
    }
    assert!(
        table
            .stdout
            .contains("\n  reproduced; 2 published numbers, 2 claims of our own\n"),
        "{}",
        table.stdout
    );
}

/// Pictures of all kinds: shapes, gains and phases over frequency, a Nyquist curve, poles, a response in time.
#[test]
fn control_theory_has_its_diagrams() {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().to_str().unwrap();
    let svg = |stem: &str| fs::read_to_string(folder.path().join(format!("{stem}.svg"))).unwrap();
    let run = fuyu(&["reproduce", "kida-fig-3.6", "--output", output]);
    assert_eq!(run.code, 0, "{}", run.stdout);
    for (stem, texts) in [
        ("bode", &["phase [deg]", "-180", "0.1"][..]),
        ("nyquist", &["unit circle", "real part"]),
        ("poles", &["closed loop", "stability limit"]),
        ("step", &["angle [deg]", "torque [N m]", "time [s]"]),
    ] {
        let svg = svg(&format!("kida-fig-3.6-{stem}"));
        for text in texts {
            assert!(svg.contains(text), "{stem}: no {text:?}");
        }
    }
    fuyu(&["reproduce", "kida-fig-2.3", "--output", output]);
    // The first zero of the truss, 15.2 Hz in Table 2.1.
    assert!(svg("kida-fig-2.3").contains("15.2 Hz"));
}

/// What is known not to be reproducible says so in its row and in the verdict.
#[test]
fn a_wrong_print_is_marked() {
    let run = fuyu(&["reproduce", "kida-table-2.9"]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    for text in [
        "not the exact zeros: NOT REPRODUCED",
        "reproduced, except for what is marked; 14 published numbers",
        "0.278    0.258 x",
    ] {
        assert!(run.stdout.contains(text), "no {text:?} in\n{}", run.stdout);
    }
}

#[test]
fn an_unknown_name_is_refused_with_those_that_are_known() {
    let run = fuyu(&["reproduce", "masutani-fig-53"]);
    let refusal = run.refusal();
    assert!(
        refusal.contains("did you mean masutani-fig-5.3?"),
        "{refusal}"
    );
    for name in names() {
        assert!(refusal.contains(&name), "{name} is not in {refusal}");
        let help = fuyu(&["reproduce", "--help"]).stdout;
        assert!(help.contains(&name), "{name} is not in {help}");
    }
    assert!(
        !fuyu(&["reproduce", "moon"])
            .refusal()
            .contains("did you mean")
    );
    assert_eq!(fuyu(&["reproduce"]).code, 2);
    let run = fuyu(&["reproduce", "tr942-chain", "--output", "/dev/null/folder"]);
    assert!(run.refusal().contains("--output /dev/null/folder"));
}
