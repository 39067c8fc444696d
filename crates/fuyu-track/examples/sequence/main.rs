//! Renders a tumbling body, tracks it, and writes images, truth and tracks, for a comparison with other trackers:
//!
//! ```sh
//! cargo run --release -p fuyu-track --example sequence -- FOLDER box front 300
//! python scripts/compare_trackers.py FOLDER
//! ```
//!
//! Bodies: `box`, `plain` (a box without texture), `cylinder`, `mesh`. Light: `front`, `side`, `behind`, `eclipse` (front, none from 20 to 40 s),
//! `arm` (front; an arm passes between camera and body within 6 s, and the tracker gets the true pixels of the body).
//! With `--tracks-only` no images are written.
//!
//! FOLDER gets `000000.pgm` and so on, `000000.depth` (32-bit floats \[m\]) and `000000.ids` (16 bit), `poses.csv` (from the body's
//! frame to the camera's, row by row), `tracks.csv` (t,id,u,v), `ideal.csv` (the same without errors), `attitudes.csv` (t,x,y,z,w from the body's
//! axes to the camera's, also for 60 s after the images), `times.csv` (of each frame \[ms\]) and `tracks.png` (the last image
//! with the paths of its points).

mod picture;
#[path = "../../tests/rendered/world.rs"]
#[allow(dead_code, reason = "shared with the tests")]
mod world;

use std::{collections::BTreeMap, error::Error, fmt::Write as _, fs, path::Path, time::Instant};

use fuyu_render::{Material, Mesh, MeshData, primitives};
use fuyu_track::{Image, Settings, Tracker};
use nalgebra::{Isometry3, Vector3};
use picture::Paths;
use world::{World, material, textured_box};

/// Frames a second.
const RATE: f64 = 10.0;
/// Frames after the last image for which the attitude is written.
const PREDICTED: usize = 600;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (arguments, with_images) = match arguments.split_last() {
        Some((last, rest)) if last == "--tracks-only" => (rest.to_vec(), false),
        _ => (arguments, true),
    };
    let [folder, body, light, count] = arguments.as_slice() else {
        return Err("give a folder, a body, a light and the number of frames".into());
    };
    let folder = Path::new(folder);
    let world = World {
        sun: sun(light)?,
        moments: Vector3::new(1.0, 0.8, 0.55),
        eclipse: if light == "eclipse" {
            [20.0, 40.0]
        } else {
            [f64::INFINITY; 2]
        },
        arm: light == "arm",
        ..World::new(mesh(body)?)
    };
    fs::create_dir_all(folder)?;
    let mut tracker = Tracker::new(Settings::default())?;
    let [mut poses, mut tracks, mut ideal, mut times] = [const { String::new() }; 4];
    let mut points = BTreeMap::new();
    tracks.push_str("t,id,u,v\n");
    ideal.push_str("t,id,u,v\n");
    let mut paths = Paths::default();
    let mut costs = Vec::new();
    let mut views = Vec::new();
    let mut size = (0, 0);
    for k in 0..count.parse::<u32>()? {
        let time = f64::from(k) / RATE;
        let mut view = world.view(time);
        let (w, h) = (view.frame.width, view.frame.height);
        size = (w, h);
        let X = view.X_CB.to_homogeneous();
        let rows = X.transpose();
        let numbers: Vec<String> = rows.iter().take(12).map(f64::to_string).collect();
        writeln!(poses, "{}", numbers.join(","))?;
        if with_images {
            let mut pgm = format!("P5 {w} {h} 255\n").into_bytes();
            pgm.extend(&view.grey);
            fs::write(folder.join(format!("{k:06}.pgm")), pgm)?;
            fs::write(
                folder.join(format!("{k:06}.depth")),
                view.frame.depth_32fc1(),
            )?;
            fs::write(folder.join(format!("{k:06}.ids")), view.frame.ids_16uc1())?;
        }
        // Radiance takes most of the memory.
        view.frame.radiance = Vec::new();
        views.push(view);
    }
    // Alone, so that the time of the processor, which is counted in its ticks, is that of the tracker.
    let began = processor_time()?;
    for (k, view) in views.iter().enumerate() {
        let time = k as f64 / RATE;
        let image = Image::new(size.0, size.1, size.0, &view.grey)?;
        let body = view.frame.ids.iter().map(|id| u8::from(*id == world::BODY));
        let body: Vec<u8> = body.collect();
        let mask = Image::new(size.0, size.1, size.0, &body)?;
        let mask = world.arm.then_some(mask);
        let start = Instant::now();
        let features = tracker.track(time, image, mask)?;
        let cost = start.elapsed().as_secs_f64() * 1e3;
        writeln!(times, "{cost}")?;
        costs.push(cost);
        paths.add(&features);
        for f in features {
            writeln!(tracks, "{time},{},{},{}", f.id, f.u, f.v)?;
            let first = points.entry(f.id);
            if let Some(p) = first.or_insert_with(|| view.point(&world.camera, f.u, f.v)) {
                let ([u, v], _) = view.project(&world.camera, p);
                writeln!(ideal, "{time},{},{u},{v}", f.id)?;
            }
        }
    }
    if let Some(view) = views.last() {
        paths.write(&view.grey, size.0, &folder.join("tracks.png"))?;
    }
    let mean = (processor_time()? - began) / views.len() as f64;
    let mut attitudes = String::from("t,x,y,z,w\n");
    for k in 0..views.len() + PREDICTED {
        let time = k as f64 / RATE;
        let q = world.rotation(time);
        writeln!(attitudes, "{time},{},{},{},{}", q.i, q.j, q.k, q.w)?;
    }
    fs::write(folder.join("attitudes.csv"), attitudes)?;
    fs::write(folder.join("poses.csv"), poses)?;
    fs::write(folder.join("tracks.csv"), tracks)?;
    fs::write(folder.join("ideal.csv"), ideal)?;
    fs::write(folder.join("times.csv"), times)?;
    costs.sort_by(f64::total_cmp);
    let at = |fraction: f64| costs[((costs.len() - 1) as f64 * fraction) as usize];
    println!(
        "{body}, {light}: {mean:.2} ms of processor time a frame; wall {:.2} ms, quarter {:.2} ms, 95 % {:.2} ms, most {:.2} ms; {:?}",
        at(0.5),
        at(0.25),
        at(0.95),
        at(1.0),
        tracker.losses()
    );
    Ok(())
}

fn sun(light: &str) -> Result<Vector3<f64>, String> {
    match light {
        "front" | "eclipse" | "arm" => Ok(Vector3::new(-0.4, -0.5, -1.0)),
        "side" => Ok(Vector3::new(-1.0, -0.3, -0.2)),
        // A quarter of what is seen is lit.
        "behind" => Ok(Vector3::new(-0.9, -0.3, 0.5)),
        other => Err(format!(
            "no light '{other}'; there are front, side, behind, eclipse (from 20 to 40 s) and arm (which passes in front)"
        )),
    }
}

fn mesh(body: &str) -> Result<Mesh, String> {
    match body {
        "box" => Ok(textured_box()),
        "plain" => Ok(primitives::cuboid(
            Vector3::new(1.8, 1.4, 1.4),
            Material::grey(0.6),
        )),
        "cylinder" => Ok(primitives::cylinder(0.8, 1.9, material(1))),
        "mesh" => {
            let mut all = MeshData::default();
            let panel = primitives::cuboid(Vector3::new(2.0, 0.05, 0.9), material(4));
            for (part, place) in [
                (textured_box(), Vector3::zeros()),
                (panel.clone(), Vector3::new(2.0, 0.0, 0.0)),
                (panel, Vector3::new(-2.0, 0.0, 0.0)),
                (
                    primitives::cylinder(0.4, 0.5, material(6)),
                    Vector3::new(0.0, 0.0, -0.9),
                ),
            ] {
                let mut data = part.data().clone();
                let pose = Isometry3::new(place, Vector3::zeros());
                data.transform(&Vector3::repeat(1.0), &pose);
                all.append(data);
            }
            Mesh::new(all).map_err(|e| e.to_string())
        }
        other => Err(format!(
            "no body '{other}'; there are box, plain, cylinder and mesh"
        )),
    }
}

/// Processor time of this thread so far \[ms\]: what other programs take does not count.
fn processor_time() -> Result<f64, Box<dyn Error>> {
    let text = fs::read_to_string("/proc/thread-self/schedstat")?;
    let running = text.split(' ').next().unwrap_or("");
    Ok(running.parse::<u64>()? as f64 * 1e-6)
}
