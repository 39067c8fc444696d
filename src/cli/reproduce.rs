//! `fuyu reproduce`: published results compared with computed ones.

use serde::Serialize;
use std::path::PathBuf;
use std::time::Instant;

use super::{Failure, print};
use crate::experiments::reproduce::{ALL, Report, Reproduction};

/// Compares a published result with the computed one: table, pictures, verdict.
///
/// Exit code 1 if a number is not reproduced.
#[derive(Debug, clap::Args)]
#[command(after_help = names())]
pub struct Args {
    /// One of the names below, or all
    #[arg(required_unless_present = "list")]
    name: Option<String>,
    /// Write pictures (SVG, PNG) and tables (CSV, Markdown) into this folder
    #[arg(long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
    /// Print only the names, one per line
    #[arg(long, exclusive = true)]
    list: bool,
}

/// The JSON of `fuyu reproduce all --json`.
#[derive(Serialize)]
struct All<'a> {
    passed: bool,
    reports: &'a [Report],
}

/// Runs the command.
///
/// # Errors
/// [`Failure::Input`] for an unknown name or a folder that cannot be created, [`Failure::Check`] if a result is not
/// reproduced, [`Failure::Runtime`] if a file cannot be written.
pub fn run(args: &Args) -> Result<(), Failure> {
    let Some(name) = args.name.as_deref().filter(|_| !args.list) else {
        let list: String = ALL.iter().map(|r| format!("{}\n", r.name)).collect();
        return print(&list);
    };
    let wanted = match (name, Reproduction::named(name)) {
        ("all", _) => ALL,
        (_, Some(one)) => std::slice::from_ref(one),
        (_, None) => return Err(unknown(name)),
    };
    if let Some(folder) = &args.output {
        std::fs::create_dir_all(folder).map_err(|e| {
            let folder = folder.display();
            Failure::Input(format!("--output {folder}: cannot be created: {e}"))
        })?;
    }
    let mut reports = Vec::new();
    for reproduction in wanted {
        let start = Instant::now();
        let report = reproduction.compute();
        if wanted.len() > 1 {
            let verdict = if report.passed {
                "reproduced"
            } else {
                "NOT reproduced"
            };
            let took = start.elapsed().as_secs_f64();
            eprintln!("fuyu: {}: {verdict} ({took:.1} s)", report.name);
        }
        if let Some(folder) = &args.output {
            report.save(folder).map_err(Failure::Runtime)?;
        }
        if !args.json {
            // Print each report when it is complete.
            let gap = if reports.is_empty() { "" } else { "\n" };
            print(&format!("{gap}{}", report.table()))?;
        }
        reports.push(report);
    }
    let passed = reports.iter().all(|r| r.passed);
    if args.json {
        let json = match &reports[..] {
            [one] if name != "all" => serde_json::to_string(one),
            reports => serde_json::to_string(&All { passed, reports }),
        };
        print(&(json.map_err(|e| Failure::Runtime(e.to_string()))? + "\n"))?;
    }
    let failed = reports.iter().flat_map(|report| {
        let rows = report.rows.iter().filter(|row| !row.passed);
        rows.map(|row| format!("{}: not reproduced: {}", report.name, row.quantity))
    });
    let failed: Vec<_> = failed.collect();
    match failed.is_empty() {
        true => Ok(()),
        false => Err(Failure::Check(failed.join("\n"))),
    }
}

fn names() -> String {
    let width = ALL.iter().map(|r| r.name.len()).max().unwrap_or(0);
    let lines = ALL
        .iter()
        .map(|r| format!("\n  {:width$}  {}", r.name, r.shows));
    format!("Names:{}", lines.collect::<String>())
}

fn unknown(name: &str) -> Failure {
    let near = ALL.iter().map(|r| r.name);
    let near = near.min_by_key(|known| strsim::damerau_levenshtein(known, name));
    let near = near.filter(|known| strsim::damerau_levenshtein(known, name) <= known.len() / 2);
    let hint = near.map_or_else(
        || ".".to_owned(),
        |known| format!("; did you mean {known}?"),
    );
    let names: Vec<_> = ALL.iter().map(|r| r.name).collect();
    Failure::Input(format!(
        "'{name}' is not a known result{hint} The names are all, {}",
        names.join(", ")
    ))
}
