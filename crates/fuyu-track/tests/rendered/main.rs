//! Tracks in rendered images against the projection of the body's points.

mod accuracy;
mod input;
mod masks;
mod world;

use std::collections::BTreeMap;

use fuyu_track::{Feature, Image, Settings, Tracker};
use nalgebra::Vector3;
use world::{View, World};

/// Frames a second.
const RATE: f64 = 10.0;

/// One observation of a point of the body.
struct Observation {
    /// Distance from where the point is that was seen first under this id \[px\].
    error: f64,
    /// Frames since then.
    age: usize,
    /// Whether the point is out of sight.
    hidden: bool,
}

/// What a tracker did in a sequence.
struct Run {
    observations: Vec<Observation>,
    /// Features of each frame.
    frames: Vec<Vec<Feature>>,
    views: Vec<View>,
}

/// Tracks `count` frames; `masked` gives the true pixels of the body.
fn run(world: &World, settings: Settings, count: usize, masked: bool) -> Run {
    let mut tracker = Tracker::new(settings).unwrap();
    let mut first: BTreeMap<u32, Option<(usize, Vector3<f64>)>> = BTreeMap::new();
    let mut run = Run {
        observations: Vec::new(),
        frames: Vec::new(),
        views: Vec::new(),
    };
    for k in 0..count {
        let time = k as f64 / RATE;
        let view = world.view(time);
        let (w, h) = (view.frame.width, view.frame.height);
        let image = Image::new(w, h, w, &view.grey).unwrap();
        let mask: Vec<u8> = (view.frame.ids.iter())
            .map(|id| u8::from(*id == world::BODY))
            .collect();
        let mask = masked.then(|| Image::new(w, h, w, &mask).unwrap());
        let features = tracker.track(time, image, mask).unwrap();
        for f in &features {
            let seen = (first.entry(f.id))
                .or_insert_with(|| view.point(&world.camera, f.u, f.v).map(|p| (k, p)));
            if let Some((since, p)) = seen {
                let ([u, v], hidden) = view.project(&world.camera, p);
                run.observations.push(Observation {
                    error: (u - f.u).hypot(v - f.v),
                    age: k - *since,
                    hidden,
                });
            }
        }
        run.frames.push(features);
        run.views.push(view);
    }
    run
}

/// The value below which a fraction of the values are.
fn quantile(values: impl Iterator<Item = f64>, fraction: f64) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values[((values.len() - 1) as f64 * fraction) as usize]
}
