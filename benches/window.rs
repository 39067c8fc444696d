//! Run time of the bundle estimator for one window: 601 frames of 20 points, clean and with the defects of real tracks, in CPU
//! time of one thread: `cargo bench --bench window` prints the table of `docs/estimation.md`.
//!
//! Each row is every twentieth of chapter 3's 294 motions, except those next to the separatrix (s_alpha 0).

use std::time::Instant;

use fuyu::estimation::bundle::{CameraMotion, Options, estimate};
use nalgebra::Vector3;

#[allow(dead_code)]
#[path = "../tests/validation/tumbling.rs"]
mod tumbling;

use tumbling::{Motion, View};

fn main() {
    let clean = View::chapter_3(1024);
    let grid: Vec<(f64, f64)> = (0..294)
        .step_by(20)
        .map(|k| (k / 21, k % 21 - 10))
        .map(|(e, s)| (0.35 + 0.05 * f64::from(e), 0.1 * f64::from(s)))
        .collect();
    let on_separatrix = [0.35, 0.5, 0.65, 0.8, 0.95].map(|e| (e, 0.0));
    let outliers = View {
        outliers: 0.1,
        ..clean.clone()
    };
    let noisy = View {
        noise: 1.0,
        ..clean.clone()
    };
    let gappy = View {
        dropped: 0.3,
        gap: Some((150.0, 210.0)),
        ..clean.clone()
    };
    let moving = View {
        camera_rate: Vector3::new(0.0, 0.1f64.to_radians(), 0.0),
        ..clean.clone()
    };
    let short = View {
        lifetime: Some(30.0),
        ..clean.clone()
    };
    let all = View {
        outliers: 0.1,
        noise: 1.0,
        ..short.clone()
    };
    println!("| tracks | median | largest |\n| --- | --- | --- |");
    for (name, view, motions) in [
        ("whole pixels", &clean, &grid[..]),
        ("next to the separatrix", &clean, &on_separatrix[..]),
        ("10 % outliers", &outliers, &grid[..]),
        ("1 px of noise", &noisy, &grid[..]),
        ("30 % of the frames and 60 s lost", &gappy, &grid[..]),
        ("a camera that turns, with its gyro", &moving, &grid[..]),
        ("tracks of 30 frames on average", &short, &grid[..]),
        ("short tracks, outliers and noise", &all, &grid[..]),
    ] {
        let mut times: Vec<f64> = motions.iter().map(|m| cost(view, *m)).collect();
        times.sort_by(f64::total_cmp);
        let (median, largest) = (times[times.len() / 2], times[times.len() - 1]);
        println!("| {name} | {median:.2} s | {largest:.2} s |");
    }
}

/// Processor time of one window \[s\].
fn cost(view: &View, (e, s_alpha): (f64, f64)) -> f64 {
    let motion = Motion::new(e, 0.0, s_alpha, 0.8, Vector3::z());
    let tracks = view.tracks(&motion, &view.sphere());
    let mut options = Options::default();
    if view.camera_rate != Vector3::zeros() {
        let rates = (0..=720).map(|k| (0.5 * f64::from(k), view.camera_rate));
        options.camera_motion = CameraMotion::Rates(rates.collect());
    }
    let (since, before) = (Instant::now(), processor_time());
    let found = estimate(&tracks, &view.camera, &options);
    let wall = since.elapsed().as_secs_f64();
    if let Err(e) = found {
        println!("refused: {e}");
    }
    before
        .zip(processor_time())
        .map_or(wall, |(from, to)| to - from)
}

/// Processor time of this thread so far \[s\], where the system reports it.
fn processor_time() -> Option<f64> {
    let statistics = std::fs::read_to_string("/proc/thread-self/schedstat").ok()?;
    Some(1e-9 * statistics.split_whitespace().next()?.parse::<f64>().ok()?)
}
