//! The tables of `docs/performance.md`, and its picture.

use super::{Kernel, Maker, Measured, Row};

/// A formulation counts as precise if its error is at most so many times Pinocchio's.
const PRECISE: f64 = 10.0;

/// Three digits, in a suitable unit.
fn time(nanoseconds: f64) -> String {
    let (value, unit) = match nanoseconds {
        ns if ns < 1e3 => (ns, "ns"),
        ns if ns < 1e6 => (ns / 1e3, "µs"),
        ns => (ns / 1e6, "ms"),
    };
    let digits = match value {
        v if v < 10.0 => 2,
        v if v < 100.0 => 1,
        _ => 0,
    };
    format!("{value:.digits$} {unit}")
}

impl Row {
    fn all_of(&self, maker: Maker) -> impl Iterator<Item = &Measured> {
        self.measured.iter().filter(move |m| m.maker == maker)
    }

    /// Fastest program of one library.
    fn best_of(&self, maker: Maker) -> Option<&Measured> {
        fastest(self.all_of(maker))
    }

    /// Our fastest formulation that is precise enough.
    fn ours(&self) -> &Measured {
        let pinocchio = self.best_of(Maker::Pinocchio).and_then(|m| m.error);
        let precise = |m: &&Measured| match (m.error, pinocchio) {
            (Some(error), Some(of_pinocchio)) => error <= PRECISE * of_pinocchio,
            _ => true,
        };
        let precise = fastest(self.all_of(Maker::Fuyu).filter(precise));
        let any = || self.best_of(Maker::Fuyu);
        precise.or_else(any).expect("fuyu has every kernel")
    }
}

fn fastest<'a>(measured: impl Iterator<Item = &'a Measured>) -> Option<&'a Measured> {
    measured.min_by(|a, b| a.times.median().total_cmp(&b.times.median()))
}

fn cost(measured: Option<&Measured>) -> String {
    measured.map_or("".to_owned(), |m| time(m.times.median()))
}

fn with_variant(measured: &Measured) -> String {
    match measured.variant.as_str() {
        "" => cost(Some(measured)),
        variant => format!("{} ({variant})", cost(Some(measured))),
    }
}

/// Median of the ratios and what half of the rounds lie between.
fn ratio(ours: &Measured, theirs: Option<&Measured>) -> String {
    theirs.map_or("".to_owned(), |theirs| {
        let [low, median, high] = ours.times.over(&theirs.times);
        let digits = if median < 0.095 { 4 } else { 2 };
        format!("**{median:.digits$}** ({low:.digits$}-{high:.digits$})")
    })
}

fn ratio_of_errors(measured: &Measured, pinocchio: Option<f64>) -> String {
    match (measured.error, pinocchio) {
        (Some(error), Some(of_pinocchio)) => format!("{error:.1e} ({:.2})", error / of_pinocchio),
        _ => String::new(),
    }
}

/// Every kernel of every robot: our best next to each peer's best.
pub fn comparison(rows: &[Row]) {
    println!("\n| robot | kernel | fuyu | Pinocchio | MuJoCo | fuyu / Pinocchio | fuyu / MuJoCo |");
    println!("| --- | --- | ---: | ---: | ---: | ---: | ---: |");
    for row in rows {
        let ours = row.ours();
        let (pinocchio, mujoco) = (row.best_of(Maker::Pinocchio), row.best_of(Maker::Mujoco));
        println!(
            "| {} | {} | {} | {} | {} | {} | {} |",
            row.robot,
            row.kernel.name(),
            cost(Some(ours)),
            cost(pinocchio),
            cost(mujoco),
            ratio(ours, pinocchio),
            ratio(ours, mujoco)
        );
    }
    let variants = |maker| {
        let best = rows.iter().filter_map(move |row| row.best_of(maker));
        let mut names: Vec<_> = best.map(|m| m.variant.as_str()).collect();
        names.sort_unstable();
        names.dedup();
        names.join(", ")
    };
    eprintln!("best of Pinocchio: {}", variants(Maker::Pinocchio));
    eprintln!("best of MuJoCo: {}", variants(Maker::Mujoco));
}

/// Forward dynamics by every formulation: cost and error.
pub fn formulations(rows: &[Row]) {
    println!(
        "\n| robot | program | forward dynamics | of Pinocchio's | error (times Pinocchio's) |"
    );
    println!("| --- | --- | ---: | ---: | ---: |");
    for row in rows.iter().filter(|row| row.kernel == Kernel::Forward) {
        let pinocchio = row.best_of(Maker::Pinocchio);
        let error = pinocchio.and_then(|m| m.error);
        let line = |name: &str, m: &Measured| {
            println!(
                "| {} | {name} | {} | {} | {} |",
                row.robot,
                with_variant(m),
                ratio(m, pinocchio),
                ratio_of_errors(m, error)
            );
        };
        for m in row.all_of(Maker::Fuyu) {
            line("fuyu", m);
        }
        for (name, maker) in [("Pinocchio", Maker::Pinocchio), ("MuJoCo", Maker::Mujoco)] {
            if let Some(m) = row.best_of(maker) {
                line(name, m);
            }
        }
    }
}

/// Costs of chains, by program: name, and links with nanoseconds.
fn chains(rows: &[Row], kernel: Kernel) -> Vec<(String, Vec<(f64, f64)>)> {
    let chains = || {
        let of_kernel = rows.iter().filter(move |row| row.kernel == kernel);
        of_kernel.filter(|row| row.robot.starts_with("chain"))
    };
    let mut curves = Vec::new();
    let Some(first) = chains().next() else {
        return curves;
    };
    for ours in first.all_of(Maker::Fuyu) {
        // Some programs do not run long chains.
        let points = chains().filter_map(|row| {
            let same = row
                .all_of(Maker::Fuyu)
                .find(|m| m.variant == ours.variant)?;
            Some((row.links as f64, same.times.median()))
        });
        curves.push((format!("fuyu {}", ours.variant), points.collect()));
    }
    for (name, maker) in [("Pinocchio", Maker::Pinocchio), ("MuJoCo", Maker::Mujoco)] {
        let best = chains().filter_map(|row| {
            let best = row.best_of(maker)?;
            Some((row.links as f64, best.times.median()))
        });
        let points: Vec<_> = best.collect();
        if !points.is_empty() {
            curves.push((name.to_owned(), points));
        }
    }
    for (name, _) in &mut curves {
        name.truncate(name.trim_end().len());
    }
    curves
}

/// Exponent `p` of `links^p` that fits best.
fn exponent(points: &[(f64, f64)]) -> f64 {
    let logs = || points.iter().map(|(x, y)| (x.ln(), y.ln()));
    let n = points.len() as f64;
    let (x, y) = logs().fold((0.0, 0.0), |s, p| (s.0 + p.0 / n, s.1 + p.1 / n));
    let (xy, xx) = logs().fold((0.0, 0.0), |s, p| {
        (s.0 + (p.0 - x) * (p.1 - y), s.1 + (p.0 - x) * (p.0 - x))
    });
    xy / xx
}

/// How costs grow with the links of a chain.
pub fn growth(rows: &[Row]) {
    for kernel in Kernel::ALL {
        let curves = chains(rows, kernel);
        let Some((_, points)) = curves.first() else {
            return;
        };
        let links: Vec<_> = points.iter().map(|(links, _)| links.to_string()).collect();
        println!(
            "\n| {}, links | {} | exponent |",
            kernel.name(),
            links.join(" | ")
        );
        println!("| --- |{} ---: |", " ---: |".repeat(links.len()));
        for (name, points) in curves {
            let mut costs: Vec<_> = points.iter().map(|p| time(p.1)).collect();
            costs.resize(links.len(), String::new());
            let exponent = exponent(&points);
            println!("| {name} | {} | {exponent:.2} |", costs.join(" | "));
        }
    }
}

/// Kernels that the peers do not have.
pub fn alone(rows: &[(String, Vec<(&'static str, f64)>)]) {
    let Some((_, kernels)) = rows.first() else {
        return;
    };
    let robots: Vec<_> = rows.iter().map(|(robot, _)| robot.as_str()).collect();
    println!("\n| fuyu alone | {} |", robots.join(" | "));
    println!("| --- |{}", " ---: |".repeat(rows.len()));
    for (k, (name, _)) in kernels.iter().enumerate() {
        let costs: Vec<_> = rows.iter().map(|(_, costs)| time(costs[k].1)).collect();
        println!("| {name} | {} |", costs.join(" | "));
    }
}

/// Draws cost per link over links.
#[cfg(feature = "ros")]
pub fn draw(rows: &[Row], stem: &str) {
    use fuyu::experiments::{Figure, Panel, Series};

    let panel = |kernel: Kernel| Panel {
        y_label: "µs per link".to_owned(),
        series: (chains(rows, kernel).into_iter())
            .map(|(name, points)| Series {
                name,
                points: (points.iter())
                    .map(|(links, cost)| (links.log10(), cost / links / 1e3))
                    .collect(),
            })
            .collect(),
        log: true,
        ..Panel::default()
    };
    let figure = Figure {
        title: "Forward dynamics of chains".to_owned(),
        x_label: "log10 of links".to_owned(),
        panels: vec![panel(Kernel::Forward)],
        ..Figure::default()
    };
    match figure.save(std::path::Path::new(stem)) {
        Ok(_) => eprintln!("drew {stem}.svg and .png"),
        Err(e) => eprintln!("{e}"),
    }
}

/// Pictures come with the feature `ros`.
#[cfg(not(feature = "ros"))]
pub fn draw(_: &[Row], _: &str) {
    eprintln!("no picture: this was built without the feature ros");
}
