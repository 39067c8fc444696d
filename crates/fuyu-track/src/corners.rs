//! New points to track.

use image::GrayImage;
use nalgebra::{Matrix2, Vector2};
use optical_flow_lk::DetectorContext;

use crate::{Settings, image::sample, region::Region};

/// Cells along columns and along rows, among which new points are divided.
const CELLS: usize = 4;
/// Half of the side of the window that refines a corner \[px\].
const REFINEMENT_RADIUS: i32 = 4;
/// Largest distance of a refined corner from its pixel \[px\].
const LARGEST_REFINEMENT: f64 = 1.5;
/// Strength of the weakest candidate over that of the strongest; the latter may be a star.
const WEAKEST: f32 = 1e-5;

/// Finds corners, and owns the memory for it.
#[derive(Default)]
pub(crate) struct Finder {
    detector: DetectorContext,
    cropped: Vec<u8>,
}

impl Finder {
    /// At most `room` new points in the region, the strongest first, apart from each other and from `existing`.
    pub fn find(
        &mut self,
        image: &GrayImage,
        region: &Region,
        existing: &[Vector2<f64>],
        room: usize,
        settings: &Settings,
    ) -> Vec<Vector2<f64>> {
        let Some(bounds) = region.bounds() else {
            return Vec::new();
        };
        let (width, height) = (image.width() as usize, image.height() as usize);
        // Gradients and windows reach two pixels beyond.
        let [left, top] = [bounds[0], bounds[2]].map(|x| x.saturating_sub(2));
        let right = (bounds[1] + 3).min(width);
        let bottom = (bounds[3] + 3).min(height);
        let mut cropped = std::mem::take(&mut self.cropped);
        cropped.clear();
        for row in image.as_raw().chunks_exact(width).take(bottom).skip(top) {
            cropped.extend_from_slice(&row[left..right]);
        }
        let size = ((right - left) as u32, (bottom - top) as u32);
        let Some(part) = GrayImage::from_raw(size.0, size.1, cropped) else {
            return Vec::new();
        };
        let corners = self.detector.detect(&part, WEAKEST, 1);
        let border = settings.window as f64 / 2.0 + 1.0;
        let inside = |p: &Vector2<f64>| {
            p.x >= border
                && p.y >= border
                && p.x <= width as f64 - 1.0 - border
                && p.y <= height as f64 - 1.0 - border
                && region.contains(p.x, p.y, settings.margin)
        };
        let candidates = corners.iter().filter_map(|corner| {
            let p = Vector2::new(
                f64::from(corner.x) + left as f64,
                f64::from(corner.y) + top as f64,
            );
            let strength = f64::from(corner.score);
            (strength >= settings.strength && inside(&p)).then_some((strength, p))
        });
        let candidates: Vec<_> = candidates.collect();
        self.cropped = part.into_raw();
        let strongest = candidates.first().map_or(0.0, |(strength, _)| *strength);

        let (columns, rows) = (bounds[1] - bounds[0] + 1, bounds[3] - bounds[2] + 1);
        let cell = |p: &Vector2<f64>| {
            let along = |x: f64, first: usize, length: usize| {
                let fraction = (x - first as f64) / length as f64;
                ((fraction.max(0.0) * CELLS as f64) as usize).min(CELLS - 1)
            };
            along(p.y, bounds[2], rows) * CELLS + along(p.x, bounds[0], columns)
        };
        let mut counts = [0; CELLS * CELLS];
        for p in existing {
            counts[cell(p)] += 1;
        }
        // A body fills a part of the cells only.
        let share = (3 * settings.points).div_ceil(counts.len());
        let mut found: Vec<Vector2<f64>> = Vec::new();
        for (strength, p) in candidates {
            if found.len() == room || strength < settings.quality * strongest {
                break;
            }
            let near = |q: &Vector2<f64>| (p - q).norm_squared() < settings.spacing.powi(2);
            if counts[cell(&p)] >= share || existing.iter().any(near) || found.iter().any(near) {
                continue;
            }
            let refined = refine(image, p);
            if inside(&refined) {
                counts[cell(&p)] += 1;
                found.push(refined);
            }
        }
        found
    }
}

/// The point near `start` to which the gradients around it are orthogonal (Förstner and Gülch 1987); `start` if there is none.
fn refine(image: &GrayImage, start: Vector2<f64>) -> Vector2<f64> {
    let (width, height) = (image.width() as usize, image.height() as usize);
    let at = |p: Vector2<f64>| sample(image.as_raw(), width, height, p.x, p.y).map(f64::from);
    let mut p = start;
    for _ in 0..8 {
        let mut normal = Matrix2::zeros();
        let mut moment = Vector2::zeros();
        for y in -REFINEMENT_RADIUS..=REFINEMENT_RADIUS {
            for x in -REFINEMENT_RADIUS..=REFINEMENT_RADIUS {
                let d = Vector2::new(f64::from(x), f64::from(y));
                let q = p + d;
                let (dx, dy) = (Vector2::x(), Vector2::y());
                let (Some(a), Some(b), Some(c), Some(e)) =
                    (at(q - dx), at(q + dx), at(q - dy), at(q + dy))
                else {
                    return start;
                };
                let gradient = 0.5 * Vector2::new(b - a, e - c);
                let weight = (-d.norm_squared() / f64::from(REFINEMENT_RADIUS).powi(2)).exp();
                let outer = weight * gradient * gradient.transpose();
                normal += outer;
                moment += outer * d;
            }
        }
        let Some(step) = normal.try_inverse().map(|inverse| inverse * moment) else {
            return start;
        };
        p += step;
        let distance = (p - start).norm();
        if distance.is_nan() || distance > LARGEST_REFINEMENT {
            return start;
        }
        if step.norm() < 0.01 {
            break;
        }
    }
    p
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Image, Target};

    /// A chequered square, smoothed by the area of pixels; corners are at multiples of `cell` from `origin`.
    fn chequers(size: u32, origin: [f64; 2], cell: f64) -> GrayImage {
        GrayImage::from_fn(size, size, |u, v| {
            let mut sum = 0.0;
            for k in 0..64 {
                let x = f64::from(u) - 0.5 + (f64::from(k % 8) + 0.5) / 8.0 - origin[0];
                let y = f64::from(v) - 0.5 + (f64::from(k / 8) + 0.5) / 8.0 - origin[1];
                let odd = ((x / cell).floor() + (y / cell).floor()).rem_euclid(2.0);
                sum += 60.0 + 120.0 * odd;
            }
            image::Luma([(sum / 64.0_f64).round() as u8])
        })
    }

    fn found(image: &GrayImage, settings: &Settings) -> Vec<Vector2<f64>> {
        let size = image.width() as usize;
        let view = Image::new(size, size, size, image.as_raw()).unwrap();
        let mut region = Region::default();
        region.set_target(&view, Target::Everything);
        Finder::default().find(image, &region, &[], settings.points, settings)
    }

    #[test]
    fn corners_of_chequers_are_found_to_a_tenth_of_a_pixel() {
        let (origin, cell) = ([20.3, 17.6], 16.0);
        let image = chequers(128, origin, cell);
        let found = found(&image, &Settings::default());
        assert!(found.len() >= 30, "{}", found.len());
        for p in &found {
            for (x, origin) in [(p.x, origin[0]), (p.y, origin[1])] {
                let off = ((x - origin) / cell).fract() * cell;
                let off = off.rem_euclid(cell).min(cell - off.rem_euclid(cell));
                assert!(off < 0.1, "{p}");
            }
        }
    }

    #[test]
    fn points_keep_their_distance_and_number() {
        let image = chequers(128, [20.3, 17.6], 8.0);
        let settings = Settings {
            points: 20,
            spacing: 15.0,
            ..Settings::default()
        };
        let found = found(&image, &settings);
        assert_eq!(found.len(), 20);
        for (i, p) in found.iter().enumerate() {
            // Refinement moves each of them a little.
            assert!(found[..i].iter().all(|q| (p - q).norm() > 12.0));
        }
    }
}
