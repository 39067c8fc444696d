//! Hard shadows: depth maps in the direction of the sunlight.
//!
//! Sunlight is parallel, so only bodies that overlap in the plane normal to it can shade each other. Each group of
//! such bodies has a map of its own; the smaller the group, the finer the map.

use nalgebra::{Rotation3, Vector3};
use rayon::prelude::*;

use crate::{Scene, projection::Placed};

/// Rows of a map that one task draws.
const BAND: usize = 64;
/// Least and most columns of a map.
const SIZES: (usize, usize) = (64, 8192);

/// The Sun's view of one group of bodies.
#[derive(Debug, Default)]
struct Map {
    size: usize,
    /// Lower corner \[m\].
    origin: [f64; 2],
    /// Length of a texel \[m\].
    texel: f64,
    /// Height toward the Sun of the highest surface over each texel's centre \[m\], from `base`.
    heights: Vec<f32>,
    /// Height from which heights count, so that they are small \[m\].
    base: f64,
}

/// The Sun's view of a scene.
#[derive(Debug, Default)]
pub struct Shadows {
    /// Axes: x and y across the light, z toward the Sun.
    R_LW: Rotation3<f64>,
    maps: Vec<Map>,
    /// The map of each instance.
    map_of: Vec<Option<usize>>,
}

/// Where a body is in the Sun's view.
struct Footprint {
    centre: Vector3<f64>,
    radius: f64,
}

impl Shadows {
    /// Draws the maps again for other poses; memory is used again.
    pub fn draw(&mut self, scene: &Scene, places: &[Placed]) {
        self.R_LW =
            Rotation3::face_towards(&scene.toward_sun(), &across(&scene.toward_sun())).inverse();
        let prints: Vec<Option<Footprint>> = (scene.instances.iter().zip(places))
            .map(|(instance, place)| {
                let (centre, radius) = instance.mesh.bounding_sphere();
                let X = &place.X_WM;
                place.is_drawn.then(|| Footprint {
                    centre: self.R_LW * (X.rotation * centre + X.translation.vector),
                    radius,
                })
            })
            .collect();
        let groups = groups(&prints);
        self.map_of = vec![None; prints.len()];
        let shared = scene.shadow_resolution as f64 / (groups.len().max(1) as f64).sqrt();
        let size = (shared as usize).clamp(SIZES.0, SIZES.1);
        self.maps.resize_with(groups.len(), Map::default);
        for (k, (members, map)) in groups.iter().zip(&mut self.maps).enumerate() {
            for i in members {
                self.map_of[*i] = Some(k);
            }
            map.draw(scene, places, members, &self.R_LW, size);
        }
    }

    /// Whether the Sun reaches the point `p_W` of an instance's surface with the unit normal `n_W`, which faces it.
    pub fn is_lit(&self, instance: usize, p_W: &Vector3<f64>, n_W: &Vector3<f64>) -> bool {
        let Some(map) = self.map_of[instance].map(|k| &self.maps[k]) else {
            return true;
        };
        let n = self.R_LW * n_W;
        // A texel's centre may be half its diagonal away, where the surface is higher by the tangent of its slope. Moved
        // along its normal, the point is above that.
        let sine = (n.x * n.x + n.y * n.y).sqrt().min(1.0);
        let p = self.R_LW * p_W + n * (0.75 * map.texel * sine);
        let height = p.z - map.base + 0.05 * map.texel;
        let column = (p.x - map.origin[0]) / map.texel;
        let row = (p.y - map.origin[1]) / map.texel;
        let inside = 0.0..map.size as f64;
        if !inside.contains(&column) || !inside.contains(&row) {
            return true;
        }
        height as f32 >= map.heights[row as usize * map.size + column as usize]
    }
}

/// Some vector that is not parallel to `v`.
fn across(v: &Vector3<f64>) -> Vector3<f64> {
    if v.x.abs() < 0.5 {
        Vector3::x()
    } else {
        Vector3::y()
    }
}

/// Groups of bodies whose footprints overlap, directly or through others.
fn groups(prints: &[Option<Footprint>]) -> Vec<Vec<usize>> {
    let mut group_of: Vec<usize> = (0..prints.len()).collect();
    for (i, a) in prints.iter().enumerate() {
        for (j, b) in prints.iter().enumerate().take(i) {
            let (Some(a), Some(b)) = (a, b) else { continue };
            let apart = (a.centre - b.centre).xy().norm();
            if apart < (a.radius + b.radius) * (1.0 + 1e-9) && group_of[i] != group_of[j] {
                let (kept, merged) = (group_of[j], group_of[i]);
                for g in &mut group_of[..=i] {
                    if *g == merged {
                        *g = kept;
                    }
                }
            }
        }
    }
    let mut groups: Vec<Vec<usize>> = vec![Vec::new(); prints.len()];
    for (i, print) in prints.iter().enumerate() {
        if print.is_some() {
            groups[group_of[i]].push(i);
        }
    }
    groups.retain(|members| !members.is_empty());
    groups
}

/// A triangle in texels: corners, and height as a plane.
struct Flat {
    corners: [[f64; 2]; 3],
    heights: [f64; 3],
}

impl Map {
    fn draw(
        &mut self,
        scene: &Scene,
        places: &[Placed],
        members: &[usize],
        R_LW: &Rotation3<f64>,
        size: usize,
    ) {
        let (mut low, mut high) = (Vector3::repeat(f64::MAX), Vector3::repeat(f64::MIN));
        let mut vertices = Vec::with_capacity(members.len());
        for i in members {
            let place = &places[*i].X_WM;
            let R = R_LW * place.rotation.to_rotation_matrix();
            let p = R_LW * place.translation.vector;
            let positions = scene.instances[*i].mesh.data().positions.iter();
            let moved = positions.map(|v| R * Vector3::from(v.map(f64::from)) + p);
            let moved: Vec<Vector3<f64>> = moved.collect();
            for v in &moved {
                (low, high) = (low.inf(v), high.sup(v));
            }
            vertices.push(moved);
        }
        let extent = (high - low).xy().max().max(1e-9);
        // One texel is left free at each border.
        self.size = size;
        self.texel = extent / (size - 2) as f64;
        self.origin = [low.x - self.texel, low.y - self.texel];
        self.base = high.z;
        self.heights.clear();
        self.heights.resize(size * size, f32::NEG_INFINITY);
        let mut flat = Vec::new();
        for (i, vertices) in members.iter().zip(&vertices) {
            let mesh = &scene.instances[*i].mesh;
            for t in &mesh.data().triangles {
                let corners = t.map(|i| vertices[i as usize]);
                let plane = corners.map(|v| {
                    [
                        (v.x - self.origin[0]) / self.texel,
                        (v.y - self.origin[1]) / self.texel,
                    ]
                });
                // The side of a closed mesh that faces away from the Sun is below one that faces it.
                if mesh.hides_back_faces() && doubled_area(&plane) <= 0.0 {
                    continue;
                }
                flat.push(Flat {
                    corners: plane,
                    heights: corners.map(|v| v.z - self.base),
                });
            }
        }
        let bands = self.heights.par_chunks_mut(BAND * size).enumerate();
        bands.for_each(|(k, band)| {
            let first = k * BAND;
            let rows = band.len() / size;
            for triangle in &flat {
                triangle.draw(band, first, rows, size);
            }
        });
    }
}

fn doubled_area([a, b, c]: &[[f64; 2]; 3]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

impl Flat {
    /// Draws the rows `first..first + rows` of the map.
    fn draw(&self, band: &mut [f32], first: usize, rows: usize, size: usize) {
        let [a, b, c] = &self.corners;
        let (low, high) = (a[1].min(b[1]).min(c[1]), a[1].max(b[1]).max(c[1]));
        // Centres of texels are at halves.
        let begin = ((low - 0.5).ceil().max(first as f64)) as usize;
        let end = ((high - 0.5).floor() + 1.0).clamp(0.0, (first + rows) as f64) as usize;
        if begin >= end {
            return;
        }
        let area = doubled_area(&self.corners);
        if area == 0.0 {
            return;
        }
        let [ha, hb, hc] = self.heights;
        let slope_x = ((hb - ha) * (c[1] - a[1]) - (hc - ha) * (b[1] - a[1])) / area;
        let slope_y = ((hc - ha) * (b[0] - a[0]) - (hb - ha) * (c[0] - a[0])) / area;
        for row in begin..end {
            let y = row as f64 + 0.5;
            let (mut left, mut right) = (f64::MAX, f64::MIN);
            for (p, q) in [(a, b), (b, c), (c, a)] {
                if (p[1] <= y) == (q[1] <= y) {
                    continue;
                }
                let x = p[0] + (q[0] - p[0]) * (y - p[1]) / (q[1] - p[1]);
                (left, right) = (left.min(x), right.max(x));
            }
            if left > right {
                continue;
            }
            let start = (left - 0.5).ceil().max(0.0) as usize;
            let stop = (((right - 0.5).floor() + 1.0).max(0.0) as usize).min(size);
            if start >= stop {
                continue;
            }
            let at_start = ha + slope_x * (start as f64 + 0.5 - a[0]) + slope_y * (y - a[1]);
            let line = &mut band[(row - first) * size..][start..stop];
            let (from, step) = (at_start as f32, slope_x as f32);
            for (k, height) in line.iter_mut().enumerate() {
                *height = height.max(from + step * k as f32);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Instance, Material, Motion, primitives, projection::placed};
    use nalgebra::Isometry3;

    fn scene(heights: &[f64]) -> Scene {
        let mut scene = Scene::new();
        for z in heights {
            let mesh = primitives::cuboid(Vector3::new(1.0, 1.0, 0.1), Material::grey(0.5));
            let motion = Motion::at_rest(Isometry3::translation(0.2 * z, 0.0, *z));
            scene.instances.push(Instance::new(mesh.into(), 1, motion));
        }
        scene
    }

    #[test]
    fn what_lies_below_another_body_is_in_its_shadow() {
        let scene = scene(&[0.0, 1.0]);
        let mut shadows = Shadows::default();
        shadows.draw(&scene, &placed(&scene, 0.5));
        let lit = |x: f64| shadows.is_lit(0, &Vector3::new(x, 0.1, 0.05), &Vector3::z());
        // The upper plate covers -0.3 to 0.7.
        assert!(lit(-0.31) && !lit(-0.29) && !lit(0.49));
        assert!(shadows.is_lit(1, &Vector3::new(0.2, 0.0, 1.05), &Vector3::z()));
    }

    #[test]
    fn a_lit_slope_does_not_shade_itself() {
        for angle in [0.1, 0.8, 1.3, 1.5] {
            let mut scene = Scene::new();
            let mesh = primitives::cuboid(Vector3::new(1.0, 1.0, 1.0), Material::grey(0.5));
            let motion = Motion::at_rest(Isometry3::rotation(Vector3::x() * 0.0));
            scene.instances.push(Instance::new(mesh.into(), 1, motion));
            scene.sun.direction = Vector3::new(f64::sin(angle), 0.02, f64::cos(angle));
            scene.shadow_resolution = 256;
            let mut shadows = Shadows::default();
            shadows.draw(&scene, &placed(&scene, 0.5));
            for i in -48..=48 {
                for j in -48..=48 {
                    let p = Vector3::new(f64::from(i) * 0.01, f64::from(j) * 0.01, 0.5);
                    assert!(shadows.is_lit(0, &p, &Vector3::z()), "{angle} {p}");
                }
            }
        }
    }

    #[test]
    fn bodies_that_cannot_shade_each_other_have_maps_of_their_own() {
        let mut scene = scene(&[0.0, 1.0]);
        let far = Motion::at_rest(Isometry3::translation(1000.0, 0.0, 0.0));
        scene.instances.push(Instance {
            motion: far,
            ..scene.instances[0].clone()
        });
        let mut shadows = Shadows::default();
        shadows.draw(&scene, &placed(&scene, 0.5));
        assert_eq!(shadows.map_of, [Some(0), Some(0), Some(1)]);
        assert!(shadows.maps.iter().all(|map| map.texel < 0.001));
    }
}
