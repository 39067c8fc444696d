//! A picture of an image with the paths of its points.

use std::{
    collections::{BTreeMap, VecDeque},
    error::Error,
    fs,
    path::Path,
};

use fuyu_render::encode;
use fuyu_track::Feature;

/// Frames that a path goes back.
const PATH: usize = 25;
/// Points along a pixel of a path.
const DENSE: f64 = 3.0;
/// Pixels around the paths.
const BORDER: usize = 30;

/// The paths of the points that are tracked at present.
#[derive(Default)]
pub struct Paths {
    paths: BTreeMap<u32, VecDeque<[f64; 2]>>,
}

impl Paths {
    /// Adds the points of the next image; the paths of all others end.
    pub fn add(&mut self, features: &[Feature]) {
        (self.paths).retain(|id, _| features.iter().any(|f| f.id == *id));
        for f in features {
            let path = self.paths.entry(f.id).or_default();
            path.push_back([f.u, f.v]);
            if path.len() > PATH {
                path.pop_front();
            }
        }
    }

    /// Writes the image with the paths that end in it, in colours of their ids, as PNG.
    pub fn write(&self, grey: &[u8], width: usize, to: &Path) -> Result<(), Box<dyn Error>> {
        let height = grey.len() / width;
        // Darker, so that the paths are seen, and without the noise of the sky, which takes most of the file.
        let dim = |x: &u8| {
            if *x < 8 {
                0
            } else {
                (u16::from(*x) * 3 / 4) as u8
            }
        };
        let mut pixels: Vec<u8> = grey.iter().flat_map(|x| [dim(x); 3]).collect();
        let mut bounds = [width, 0, height, 0];
        let mut dot = |[u, v]: [f64; 2], colour: [u8; 3], radius: i64| {
            let (u, v) = (u.round() as i64, v.round() as i64);
            for (x, y) in (-radius..=radius).flat_map(|x| (-radius..=radius).map(move |y| (x, y))) {
                let (x, y) = ((u + x) as usize, (v + y) as usize);
                if x < width && y < height {
                    let i = 3 * (y * width + x);
                    pixels[i..i + 3].copy_from_slice(&colour);
                    bounds = [
                        bounds[0].min(x),
                        bounds[1].max(x),
                        bounds[2].min(y),
                        bounds[3].max(y),
                    ];
                }
            }
        };
        for (id, path) in &self.paths {
            let colour = hue(f64::from(*id) * 0.618);
            for (a, b) in path.iter().zip(path.iter().skip(1)) {
                let steps = (DENSE * (b[0] - a[0]).hypot(b[1] - a[1])).ceil().max(1.0);
                for k in 0..=steps as usize {
                    let part = k as f64 / steps;
                    dot([0, 1].map(|c| a[c] + part * (b[c] - a[c])), colour, 0);
                }
            }
            if let Some(last) = path.back() {
                dot(*last, colour, 1);
            }
        }
        if self.paths.is_empty() {
            bounds = [0, width, 0, height];
        }
        let first = [bounds[0], bounds[2]].map(|x| x.saturating_sub(BORDER));
        let end = [
            (bounds[1] + BORDER).min(width),
            (bounds[3] + BORDER).min(height),
        ];
        let rows = (first[1]..end[1]).flat_map(|v| {
            let row = 3 * v * width;
            pixels[row + 3 * first[0]..row + 3 * end[0]].to_vec()
        });
        let cut: Vec<u8> = rows.collect();
        let size = [end[0] - first[0], end[1] - first[1]].map(|x| x as u32);
        fs::write(to, encode::png(&cut, size[0], size[1], 3)?)?;
        Ok(())
    }
}

/// A bright colour; the fraction of `turn` counts.
fn hue(turn: f64) -> [u8; 3] {
    [0.0, 1.0, 2.0].map(|k| {
        let x = (6.0 * (turn + k / 3.0).fract() - 3.0).abs() - 1.0;
        (80.0 + 175.0 * x.clamp(0.0, 1.0)) as u8
    })
}
