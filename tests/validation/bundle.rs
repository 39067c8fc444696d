//! The bundle against chapter 3's motions.

use fuyu::estimation::bundle::{Options, estimate};
use nalgebra::Vector3;

use crate::tumbling::{Motion, View, prediction_errors};

#[test]
#[ignore]
fn sweep() {
    let res: u32 = std::env::var("RES").map_or(1024, |r| r.parse().unwrap());
    let stride: usize = std::env::var("STRIDE").map_or(1, |r| r.parse().unwrap());
    let mut view = View::chapter_3(res);
    let get = |k: &str| std::env::var(k).ok().map(|v| v.parse::<f64>().unwrap());
    if let Some(x) = get("OUT") {
        view.outliers = x;
    }
    if let Some(x) = get("DROP") {
        view.dropped = x;
    }
    if let Some(x) = get("GAP") {
        view.gap = Some((150.0, 150.0 + x));
    }
    if let Some(x) = get("LIFE") {
        view.lifetime = Some(x);
    }
    if let Some(x) = get("DUR") {
        view.duration = x;
    }
    if let Some(x) = get("NOISE") {
        view.noise = x;
    }
    if let Some(x) = get("DIST") {
        view.distance = x;
    }
    if let Some(x) = get("DT") {
        view.interval = x;
    }
    if let Some(x) = get("POINTS") {
        view.points = x as usize;
    }
    if let Some(x) = get("SEED") {
        view.seed = x as u64;
    }
    if get("OCC").is_some() {
        view.occlusion = true;
    }
    let beta = get("BETA").unwrap_or(0.8);
    let mut phis = Vec::new();
    let mut total = 0.0;
    let mut n = 0;
    for ie in 0..14 {
        for ia in 0..21 {
            n += 1;
            if (n - 1) % stride != 0 {
                continue;
            }
            let (e, sa) = (0.35 + 0.05 * ie as f64, -1.0 + 0.1 * ia as f64);
            let motion = Motion::new(e, 0.0, sa, beta, Vector3::z());
            let points = view.sphere();
            let tracks = view.tracks(&motion, &points);
            let mut camera = view.camera;
            let mut options = Options::default();
            if let Some(x) = get("FOCAL") {
                camera.fx *= 1.0 + x;
                camera.fy *= 1.0 + x;
                options.estimate_focal_length = true;
            }
            let start = std::time::Instant::now();
            let solved = estimate(&tracks, &camera, &options);
            let took = start.elapsed().as_secs_f64();
            total += took;
            match solved {
                Ok(s) => {
                    let (theta, phi) =
                        prediction_errors(&motion, view.duration, |t| s.motion.attitude(t));
                    println!(
                        "e {e:.2} sa {sa:+.1} theta {theta:.4} phi {phi:.4} {:?} rms {:.3} out {:.3} took {took:.2} J {:?} true {:?} {:?}",
                        s.motion.model(),
                        s.motion.rms(),
                        s.outliers,
                        s.motion.J().map(|j| j.as_slice().to_vec()),
                        motion.J.as_slice(),
                        s.diagnosis.first()
                    );
                    phis.push(phi);
                }
                Err(error) => {
                    println!("e {e:.2} sa {sa:+.1} ERROR {error} took {took:.2}");
                    phis.push(180.0);
                }
            }
        }
    }
    phis.sort_by(f64::total_cmp);
    println!(
        "SUMMARY n {} median {:.4} p95 {:.4} max {:.4} mean time {:.3}",
        phis.len(),
        phis[phis.len() / 2],
        phis[phis.len() * 95 / 100],
        phis[phis.len() - 1],
        total / phis.len() as f64
    );
}
