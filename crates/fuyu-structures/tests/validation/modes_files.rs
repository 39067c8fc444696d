//! Modes files: what is written is read, and what is wrong is named.

use fuyu_structures::{Appendage, Kinetics, modes_file};
use nalgebra::Vector3;

use crate::support::panel;

fn same(a: &Appendage, b: &Appendage) {
    assert_eq!((&a.name, &a.mode_names), (&b.name, &b.mode_names));
    assert_eq!(a.invariants.mass(), b.invariants.mass());
    let close = |x: f64, y: f64| (x - y).abs() <= 4e-16 * x.abs().max(y.abs()) * 4.0;
    assert!(
        a.modal_stiffness
            .iter()
            .zip(&b.modal_stiffness)
            .all(|(x, y)| close(*x, *y))
    );
    assert!(
        a.modal_damping
            .iter()
            .zip(&b.modal_damping)
            .all(|(x, y)| close(*x, *y))
    );
    for i in 0..=a.modes() {
        assert_eq!(a.invariants.first(i), b.invariants.first(i));
        for j in 0..=a.modes() {
            let difference = (a.invariants.second(i, j) - b.invariants.second(i, j)).amax();
            // The second moment of mass is written as moments of inertia.
            assert!(
                difference <= if i + j == 0 { 1e-12 * 1024.0 } else { 0.0 },
                "{i} {j}: {difference:e}"
            );
        }
    }
    for (x, y) in a.outputs.iter().zip(&b.outputs) {
        assert_eq!(
            (&x.name, x.position, &x.translation, &x.rotation),
            (&y.name, y.position, &y.translation, &y.rotation)
        );
    }
    assert_eq!(a.outputs.len(), b.outputs.len());
}

#[test]
fn both_formats_read_what_they_write() {
    let body = panel(false);
    let yaml = modes_file::to_yaml(&body).unwrap();
    same(&body, &modes_file::from_yaml(&yaml, "panel.yaml").unwrap());
    let csv = modes_file::to_csv(&body).unwrap();
    same(&body, &modes_file::from_csv(&csv, "panel.csv").unwrap());
    // Files that were read are written the same way again.
    let again = modes_file::from_csv(&csv, "panel.csv").unwrap();
    assert_eq!(
        modes_file::to_csv(&again).unwrap().lines().count(),
        csv.lines().count()
    );
}

// A file keeps the second-order integrals that the linear equations about a steady spin need: the frequencies are the same.
#[test]
fn second_order_integrals_survive_a_file() {
    let body = panel(true);
    let text = modes_file::to_yaml(&body).unwrap();
    let read = modes_file::from_yaml(&text, "panel.yaml").unwrap();
    assert_eq!(
        modes_file::to_csv(&read).unwrap(),
        modes_file::to_csv(
            &modes_file::from_csv(&modes_file::to_csv(&read).unwrap(), "p").unwrap()
        )
        .unwrap()
    );
    let (w, p) = (Vector3::new(0.0, 0.3, 0.4), Vector3::new(1.2, 0.0, 0.0));
    let frequencies = [&body, &read].map(|b| b.spin_frequencies(&w, &p).unwrap());
    for (a, b) in frequencies[0].iter().zip(&frequencies[1]) {
        assert!((a / b - 1.0).abs() < 1e-12, "{frequencies:?}");
    }
    let bias = |b: &Appendage, size: f64| {
        let mut kinetics = Kinetics::new(b);
        kinetics.update(b, &[size, 0.0, 0.0, size], &[0.0; 4], &w);
        kinetics.bias.clone()
    };
    let difference = |size: f64| (bias(&body, size) - bias(&read, size)).amax();
    let ratio = difference(0.2) / difference(0.1);
    assert!(
        ratio > 3.9,
        "forces of what is left out are of second order in the amplitude: {ratio}"
    );
}

fn yaml_error(from: &str, to: &str) -> String {
    let text = modes_file::to_yaml(&panel(false)).unwrap();
    assert!(text.contains(from), "{from} is not in\n{text}");
    modes_file::from_yaml(&text.replacen(from, to, 1), "panel.yaml")
        .unwrap_err()
        .to_string()
}

#[test]
fn a_wrong_yaml_file_is_named_with_line_and_field() {
    let b2 = "frequency_hz: 1.2252598";
    let message = yaml_error(b2, "frequency_hz: -1.2252598");
    assert!(
        message.starts_with("panel.yaml, line 12, mode b2, frequency_hz: is -1.22525"),
        "{message}"
    );
    assert!(message.ends_with("it must be positive [Hz]"), "{message}");
    let message = yaml_error("damping: 0.005", "damping: -0.1");
    assert!(
        message.contains("line 6, mode b1, damping: is -0.1; it must be a ratio"),
        "{message}"
    );
    let message = yaml_error("damping: 0.005", "dampng: 0.005");
    assert!(
        message.contains("line ") && message.contains("dampng"),
        "{message}"
    );
    assert_eq!(message.lines().count(), 1, "{message}");
    let message = yaml_error("modes: [\"b1\", \"b2\"]", "modes: [\"b1\", \"b9\"]");
    assert!(
        message.contains("there is no mode 'b9'; the modes are b1, b2, b3, t1"),
        "{message}"
    );
    let message = yaml_error("- name: \"b2\"", "- name: \"b1\"");
    assert!(
        message.contains("line 12") && message.contains("names two modes"),
        "{message}"
    );
    let message = yaml_error("mass: 48.0", "mass: 0.0048");
    assert!(
        message.contains("line 2") && message.contains("check units"),
        "{message}"
    );
    let message = yaml_error("mass: 48.0", "mass: heavy");
    assert!(
        message.starts_with("panel.yaml, line 2, YAML: "),
        "{message}"
    );
    let message = yaml_error("inertia: [", "inertia: [-");
    assert!(message.contains("principal moments"), "{message}");
    let message = yaml_error("modal_mass: 1.0", "modal_mass: 0.1");
    assert!(
        message.contains("D of modes b1 and b1: has trace"),
        "{message}"
    );
    let message = yaml_error("S: [", "S: [.nan, ");
    assert!(message.starts_with("panel.yaml, line "), "{message}");
}

fn csv_error(change: impl Fn(&str) -> String) -> String {
    let text = modes_file::to_csv(&panel(false)).unwrap();
    modes_file::from_csv(&change(&text), "panel.csv")
        .unwrap_err()
        .to_string()
}

#[test]
fn a_wrong_csv_file_is_named_with_line_and_column() {
    let message = csv_error(|t| t.replacen("frequency_hz", "frequency", 1));
    assert!(
        message.starts_with("panel.csv, line 1, columns: are 'record,name,with,frequency,"),
        "{message}"
    );
    let message = csv_error(|t| t.replacen("mode,b1,", "mod,b1,", 1));
    assert!(
        message.starts_with("panel.csv, line 3, record: is 'mod'; it must be one of body, mode, D"),
        "{message}"
    );
    let message = csv_error(|t| t.replacen("mode,b1,,0.1955", "mode,b1,,x0.1955", 1));
    assert!(
        message.starts_with("panel.csv, line 3, frequency_hz: is 'x0.1955"),
        "{message}"
    );
    let message = csv_error(|t| t.replacen("mode,b1,,", "mode,b1,t1,", 1));
    assert_eq!(
        message,
        "panel.csv, line 3, with: is 't1'; it must be empty in a record 'mode'"
    );
    let message = csv_error(|t| t.replacen("mode,b1,,", "mode,,,", 1));
    assert!(message.contains("line 3, name: is empty"), "{message}");
    let message = csv_error(|t| t.replacen("body,panel,,", "body,panel,", 1));
    assert!(
        message.contains("line 2, cells: there are 20 of them; there must be 21"),
        "{message}"
    );
    let message = csv_error(|t| {
        t.lines()
            .filter(|l| !l.starts_with("body"))
            .fold(String::new(), |a, l| a + l + "\n")
    });
    assert!(message.contains("there is no record 'body'"), "{message}");
    let message = csv_error(|t| t.replacen("shape,b1,tip,", "shape,b1,top,", 1));
    assert!(
        message.contains("there is no output point 'top' above; there are tip"),
        "{message}"
    );
    let message = csv_error(|t| t.replacen("D,b1,b1,", "D,b1,b7,", 1));
    assert!(message.contains("there is no mode 'b7'"), "{message}");
    assert!(modes_file::from_csv("", "empty.csv").is_err());
}

#[test]
fn modes_that_are_not_orthogonal_have_no_file() {
    let mut body = panel(false);
    body.modal_stiffness[(0, 1)] = 0.1;
    body.modal_stiffness[(1, 0)] = 0.1;
    body.modal_damping.fill(0.0);
    let message = modes_file::to_yaml(&body).unwrap_err().to_string();
    assert!(
        message.contains("modal stiffness is not diagonal; a modes file has one frequency"),
        "{message}"
    );
    let diagonal = body.diagonalised().unwrap();
    assert!(modes_file::to_yaml(&diagonal).is_ok());
}

/// The first modes file in a language in docs/flexible.md.
fn documented(language: &str) -> String {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/flexible.md");
    let text = std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{path}: {e}"));
    let name = text.find("name: solar_plus").unwrap();
    let text = &text[text[..name].rfind("```").unwrap()..];
    let start = text.find(&format!("```{language}\n")).unwrap() + language.len() + 4;
    text[start..].split("```").next().unwrap().to_owned()
}

#[test]
fn the_documented_files_are_read_and_are_the_same() {
    let yaml = modes_file::from_yaml(&documented("yaml"), "docs").unwrap();
    let csv = modes_file::from_csv(&documented("csv"), "docs").unwrap();
    assert_eq!(yaml, csv);
    let body = panel(false).selected(&[0]).unwrap();
    assert!((yaml.coupling() - body.coupling()).amax() < 1e-12);
    let tip = &body.outputs[0];
    assert!((yaml.outputs[0].translation[0] - tip.translation[0]).amax() < 1e-10);
    assert!(
        (yaml.outputs[0].rotation[0] - tip.rotation[0]).amax() < 1e-9,
        "{}",
        tip.rotation[0]
    );
}

#[test]
fn names_of_any_language_survive() {
    let mut body = panel(false);
    body.name = "太陽電池 \"+\" \\ ü, # x".to_owned();
    body.mode_names[0] = "曲げ: 1".to_owned();
    let yaml = modes_file::from_yaml(&modes_file::to_yaml(&body).unwrap(), "p").unwrap();
    let csv = modes_file::from_csv(&modes_file::to_csv(&body).unwrap(), "p").unwrap();
    for read in [yaml, csv] {
        assert_eq!(
            (&read.name, &read.mode_names),
            (&body.name, &body.mode_names)
        );
    }
}

// Numbers that are none must not reach an eigenvalue iteration.
#[test]
fn not_a_number_is_rejected_everywhere() {
    let text = documented("yaml");
    for field in [
        "mass: 48.0",
        "first_moment: [192",
        "inertia: [16",
        "frequency_hz: 0.19551312267198",
        "damping: 0.005",
        "S: [0",
        "N: [0",
        "value: [0",
        "position: [8",
        "translation: [0",
    ] {
        assert!(text.contains(field), "{field}");
        let start = field.trim_end_matches(|c: char| c.is_ascii_digit() || c == '.');
        let wrong = text.replacen(field, &format!("{start}.nan"), 1);
        let message = modes_file::from_yaml(&wrong, "panel.yaml")
            .unwrap_err()
            .to_string();
        assert!(
            message.starts_with("panel.yaml, line "),
            "{field}: {message}"
        );
    }
}
