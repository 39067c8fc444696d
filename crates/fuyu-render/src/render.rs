//! From a scene to a frame.

use nalgebra::{Isometry3, Rotation3, Vector3};
use rayon::prelude::*;

use crate::{
    Camera, Frame, Scene,
    camera::{Sample, TILE, TILE_PIXELS, Tile},
    earth::EarthView,
    projection::{Placed, Projected, placed, project},
    raster::{NOTHING, Seen},
    shade::{Lights, Point},
    shadow::Shadows,
    stars,
};

/// Renders frames; it keeps the memory of shadow maps from one frame to the next.
#[derive(Debug, Default)]
pub struct Renderer {
    shadows: Shadows,
}

/// Image of a scene by a camera. For many frames, a [`Renderer`] is faster.
pub fn render(scene: &Scene, camera: &Camera) -> Frame {
    Renderer::default().render(scene, camera)
}

/// One sample of a frame.
struct View<'a> {
    scene: &'a Scene,
    camera: &'a Camera,
    sample: &'a Sample,
    places: Vec<Placed>,
    triangles: Vec<Projected>,
    X_WC: Isometry3<f64>,
    /// Its rotation.
    R_WC: Rotation3<f64>,
    earth: Option<EarthView>,
    /// The rotation in single precision, for what is far away.
    sky_R_WC: Rotation3<f32>,
}

impl Renderer {
    /// Image of a scene by a camera, on all threads of rayon's pool.
    ///
    /// A camera or body whose pose is not finite sees or shows nothing.
    pub fn render(&mut self, scene: &Scene, camera: &Camera) -> Frame {
        let size = camera.intrinsics();
        let mut frame = Frame::empty(size.width as usize, size.height as usize);
        if !camera.pose.is_finite() {
            return frame;
        }
        let samples = camera.samples();
        for sample in samples {
            let view = View::new(scene, camera, sample);
            self.shadows.draw(scene, &view.places);
            view.draw(&mut frame, &self.shadows, samples.len());
        }
        if samples.len() > 1 {
            View::new(scene, camera, camera.centre()).measure(&mut frame);
        }
        frame
    }
}

impl<'a> View<'a> {
    fn new(scene: &'a Scene, camera: &'a Camera, sample: &'a Sample) -> Self {
        let places = placed(scene, sample.fraction);
        let X_WC = camera.pose.at(sample.fraction);
        let near = camera.near.max(1e-6);
        let triangles = project(scene, &places, &X_WC.inverse(), &sample.rays, near);
        Self {
            scene,
            camera,
            sample,
            places,
            triangles,
            X_WC,
            R_WC: X_WC.rotation.to_rotation_matrix(),
            sky_R_WC: X_WC.rotation.to_rotation_matrix().cast(),
            earth: (scene.earth.as_ref())
                .map(|earth| EarthView::new(earth, &X_WC.translation.vector, &scene.toward_sun())),
        }
    }

    /// Visible triangles of the tiles of a row.
    fn seen(&self, row: usize) -> Vec<Seen> {
        let rays = &self.sample.rays;
        let mut seen = vec![Seen::NOTHING; rays.columns];
        let nearest = (1.0 / self.camera.near.max(1e-6)) as f32;
        for (index, triangle) in (0..).zip(&self.triangles) {
            let [first, last] = triangle.rows;
            if row < usize::from(first) || row > usize::from(last) {
                continue;
            }
            let [left, right] = triangle.columns.map(usize::from);
            let tiles = &rays.tiles[row * rays.columns..][left..=right];
            for (seen, tile) in seen[left..=right].iter_mut().zip(tiles) {
                seen.draw(index, triangle, tile, nearest);
            }
        }
        seen
    }

    /// Adds the radiance of this sample, one of `samples`; sets depth and ids if it is the only one.
    fn draw(&self, frame: &mut Frame, shadows: &Shadows, samples: usize) {
        let lights = Lights::new(self.scene, &self.X_WC.translation.vector);
        let share = 1.0 / samples as f32;
        let mut sky = vec![false; frame.radiance.len()];
        let width = frame.width;
        let chunk = TILE * width;
        let rows = (frame.radiance.par_chunks_mut(chunk))
            .zip(frame.depth.par_chunks_mut(chunk))
            .zip(frame.ids.par_chunks_mut(chunk))
            .zip(sky.par_chunks_mut(chunk));
        rows.enumerate()
            .for_each(|(row, (((radiance, depth), ids), sky))| {
                let seen = self.seen(row);
                self.each_pixel(row, width, radiance.len(), &seen, |pixel, tile, i, seen| {
                    let colour = match seen {
                        Some((triangle, inverse_depth)) => {
                            if samples == 1 {
                                depth[pixel] = 1.0 / inverse_depth;
                                ids[pixel] = self.scene.instances[triangle.instance as usize].id;
                            }
                            self.surface(tile, i, triangle, inverse_depth, &lights, shadows)
                        }
                        None => {
                            sky[pixel] = true;
                            self.background(tile, i)
                        }
                    };
                    for (total, part) in radiance[pixel].iter_mut().zip(colour) {
                        *total += share * part;
                    }
                });
            });
        stars::add(
            self.scene,
            self.camera,
            &self.X_WC,
            frame,
            |i| sky[i],
            samples,
        );
    }

    /// Sets depth and ids.
    fn measure(&self, frame: &mut Frame) {
        let width = frame.width;
        let chunk = TILE * width;
        let rows = (frame.depth.par_chunks_mut(chunk)).zip(frame.ids.par_chunks_mut(chunk));
        rows.enumerate().for_each(|(row, (depth, ids))| {
            let seen = self.seen(row);
            self.each_pixel(row, width, depth.len(), &seen, |pixel, _, _, seen| {
                if let Some((triangle, inverse_depth)) = seen {
                    depth[pixel] = 1.0 / inverse_depth;
                    ids[pixel] = self.scene.instances[triangle.instance as usize].id;
                }
            });
        });
    }

    /// Calls `visit` for each pixel of a row of tiles: its index in the row's `length` pixels, its tile, index in the tile,
    /// triangle and inverse depth.
    fn each_pixel(
        &self,
        row: usize,
        width: usize,
        length: usize,
        seen: &[Seen],
        mut visit: impl FnMut(usize, &Tile, usize, Option<(&Projected, f32)>),
    ) {
        let columns = self.sample.rays.columns;
        for (column, seen) in seen.iter().enumerate() {
            let tile = &self.sample.rays.tiles[row * columns + column];
            for i in 0..TILE_PIXELS {
                let (x, y) = (column * TILE + i % TILE, i / TILE);
                let pixel = y * width + x;
                if x >= width || pixel >= length || tile.x[i].is_nan() {
                    continue;
                }
                let triangle = match seen.triangle[i] {
                    NOTHING => None,
                    index => Some((&self.triangles[index as usize], seen.inverse_depth[i])),
                };
                visit(pixel, tile, i, triangle);
            }
        }
    }

    fn surface(
        &self,
        tile: &Tile,
        i: usize,
        triangle: &Projected,
        inverse_depth: f32,
        lights: &Lights,
        shadows: &Shadows,
    ) -> [f32; 3] {
        let (x, y) = (tile.x[i], tile.y[i]);
        let edges = triangle.edges.map(|[a, b, c]| a * x + b * y + c);
        let total: f32 = edges.iter().sum();
        let direction = self.R_WC * Vector3::new(f64::from(x), f64::from(y), 1.0);
        let p_W = self.X_WC.translation.vector + direction / f64::from(inverse_depth);
        let instance = triangle.instance as usize;
        let point = Point {
            instance,
            mesh: &self.scene.instances[instance].mesh,
            place: &self.places[instance],
            triangle: triangle.triangle as usize,
            weights: edges.map(|e| e / total),
            p_W,
            toward_camera: -direction.normalize(),
        };
        lights.radiance(&point, shadows)
    }

    fn background(&self, tile: &Tile, i: usize) -> [f32; 3] {
        let Some(earth) = &self.earth else {
            return [0.0; 3];
        };
        let ray = Vector3::new(tile.x[i], tile.y[i], 1.0);
        let seen = earth.radiance(&(self.sky_R_WC * ray.normalize()));
        let sun = self.scene.sun.intensity.max(0.0) as f32;
        seen.map_or([0.0; 3], |colour| colour.map(|x| x * sun))
    }
}
