//! Meshes of triangles and their materials.

use std::{
    collections::HashMap,
    sync::{Arc, LazyLock},
};

use nalgebra::{Isometry3, Vector3};

/// Most triangles of one mesh.
pub const LARGEST_MESH: usize = 2_000_000;

/// Surface of a triangle.
#[derive(Debug, Clone, PartialEq)]
pub struct Material {
    /// Diffuse reflectance, red, green, blue, linear in [0, 1]; multiplied by the texture if there is one.
    pub diffuse: [f32; 3],
    /// Reflectance of the highlight (Blinn-Phong), in [0, 1].
    pub specular: f32,
    /// Exponent of the highlight.
    pub shininess: f32,
    /// Texture of the diffuse reflectance.
    pub texture: Option<Arc<Texture>>,
}

impl Material {
    /// A diffuse material of this linear reflectance.
    pub fn diffuse(diffuse: [f32; 3]) -> Self {
        Self {
            diffuse,
            specular: 0.0,
            shininess: 30.0,
            texture: None,
        }
    }

    /// A grey diffuse material.
    pub fn grey(reflectance: f32) -> Self {
        Self::diffuse([reflectance; 3])
    }

    /// A diffuse material from an sRGB colour in [0, 1], as URDF and OBJ files have them.
    pub fn from_srgb_colour(colour: [f32; 3]) -> Self {
        Self::diffuse(colour.map(from_srgb))
    }
}

/// An sRGB value in [0, 1] as linear light (IEC 61966-2-1).
pub fn from_srgb(value: f32) -> f32 {
    let value = value.clamp(0.0, 1.0);
    if value <= 0.040_45 {
        value / 12.92
    } else {
        ((value + 0.055) / 1.055).powf(2.4)
    }
}

/// Linear light in [0, 1] as an sRGB value (IEC 61966-2-1).
pub fn to_srgb(value: f32) -> f32 {
    let value = value.clamp(0.0, 1.0);
    if value <= 0.003_130_8 {
        value * 12.92
    } else {
        1.055 * value.powf(1.0 / 2.4) - 0.055
    }
}

static LINEAR: LazyLock<[f32; 256]> =
    LazyLock::new(|| std::array::from_fn(|i| from_srgb(i as f32 / 255.0)));

/// An image that is laid on a surface; it repeats beyond its borders.
#[derive(Debug, Clone, PartialEq)]
pub struct Texture {
    width: usize,
    height: usize,
    /// sRGB, row by row from the top.
    texels: Vec<[u8; 3]>,
}

impl Texture {
    /// A texture of `width` by `height` sRGB texels, row by row from the top.
    ///
    /// # Errors
    /// [`MeshError::Texture`] if there are more or fewer texels, or none.
    pub fn new(width: usize, height: usize, texels: Vec<[u8; 3]>) -> Result<Self, MeshError> {
        let count = texels.len();
        if count == 0 || width.checked_mul(height) != Some(count) {
            return Err(MeshError::Texture {
                width,
                height,
                count,
            });
        }
        Ok(Self {
            width,
            height,
            texels,
        })
    }

    /// Linear reflectance at (`u`, `v`), interpolated between texels; (0, 0) is the lower left corner, (1, 1) the upper
    /// right one.
    pub(crate) fn sample(&self, u: f32, v: f32) -> [f32; 3] {
        let x = (u - u.floor()) * self.width as f32 - 0.5;
        let y = (1.0 - (v - v.floor())) * self.height as f32 - 0.5;
        let (x0, y0) = (x.floor(), y.floor());
        let (fx, fy) = (x - x0, y - y0);
        let wrap = |i: f32, n: usize| (i as i64).rem_euclid(n as i64) as usize;
        let (left, right) = (wrap(x0, self.width), wrap(x0 + 1.0, self.width));
        let (top, bottom) = (wrap(y0, self.height), wrap(y0 + 1.0, self.height));
        let texel = |x: usize, y: usize| self.texels[y * self.width + x];
        let [a, b] = [texel(left, top), texel(right, top)];
        let [c, d] = [texel(left, bottom), texel(right, bottom)];
        let linear: &[f32; 256] = &LINEAR;
        std::array::from_fn(|i| {
            let at = |t: [u8; 3]| linear[usize::from(t[i])];
            let upper = at(a) + (at(b) - at(a)) * fx;
            let lower = at(c) + (at(d) - at(c)) * fx;
            upper + (lower - upper) * fy
        })
    }
}

/// Vertices and triangles of a mesh, before they are checked.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct MeshData {
    /// Vertices \[m\].
    pub positions: Vec<[f32; 3]>,
    /// Unit normals of the vertices, or none: then surfaces are flat.
    pub normals: Vec<[f32; 3]>,
    /// Texture coordinates of the vertices, or none.
    pub uvs: Vec<[f32; 2]>,
    /// Indices of the triangles' vertices, anticlockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// Materials.
    pub materials: Vec<Material>,
    /// Index of each triangle's material, or none: then all have the first.
    pub triangle_materials: Vec<u32>,
}

impl MeshData {
    /// Adds the triangles of another mesh.
    pub fn append(&mut self, other: Self) {
        let first = self.positions.len();
        let first_material = self.materials.len() as u32;
        self.complete();
        let mut other = other;
        other.complete();
        if !self.normals.is_empty() || !other.normals.is_empty() {
            // Zero stands for the triangle's own normal.
            self.normals.resize(first, [0.0; 3]);
            other.normals.resize(other.positions.len(), [0.0; 3]);
        }
        if !self.uvs.is_empty() || !other.uvs.is_empty() {
            self.uvs.resize(first, [0.0; 2]);
            other.uvs.resize(other.positions.len(), [0.0; 2]);
        }
        self.positions.append(&mut other.positions);
        self.normals.append(&mut other.normals);
        self.uvs.append(&mut other.uvs);
        let offset = first as u32;
        let moved = other.triangles.iter();
        self.triangles
            .extend(moved.map(|t| t.map(|i| i.saturating_add(offset))));
        self.materials.append(&mut other.materials);
        let moved = other.triangle_materials.iter();
        (self.triangle_materials).extend(moved.map(|m| m + first_material));
    }

    fn complete(&mut self) {
        if self.materials.is_empty() && !self.triangles.is_empty() {
            self.materials.push(Material::grey(0.6));
        }
        if self.triangle_materials.is_empty() {
            self.triangle_materials.resize(self.triangles.len(), 0);
        }
    }

    /// Scales along the axes, and then moves. A mirroring scale turns the triangles round, so that they still face outward.
    pub fn transform(&mut self, scale: &Vector3<f64>, X: &Isometry3<f64>) {
        for p in &mut self.positions {
            let scaled = Vector3::from(p.map(f64::from)).component_mul(scale);
            let moved = X.rotation * scaled + X.translation.vector;
            *p = [moved.x as f32, moved.y as f32, moved.z as f32];
        }
        for n in &mut self.normals {
            // Normals transform with the inverse.
            let scaled = Vector3::from(n.map(f64::from)).component_div(scale);
            let turned = X.rotation * scaled;
            let unit = turned.try_normalize(1e-12).unwrap_or_default();
            *n = [unit.x as f32, unit.y as f32, unit.z as f32];
        }
        if scale.product() < 0.0 {
            for t in &mut self.triangles {
                t.swap(1, 2);
            }
        }
    }
}

/// A mesh that can be rendered.
#[derive(Debug, Clone, PartialEq)]
pub struct Mesh {
    data: MeshData,
    is_closed: bool,
    /// Whether its back faces are never seen from outside.
    hides_back_faces: bool,
    centre: Vector3<f64>,
    radius: f64,
}

/// Why a mesh cannot be rendered.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MeshError {
    /// It has no triangle with an area.
    #[error("the mesh has no triangle")]
    Empty,
    /// It is too large.
    #[error("the mesh has {0} triangles; at most {LARGEST_MESH} can be rendered")]
    Huge(usize),
    /// A vertex is not finite or too far away.
    #[error("vertex {0} of the mesh is not finite, or farther than 1e9 m from its origin")]
    NotFinite(usize),
    /// An index is out of range.
    #[error("triangle {triangle} of the mesh has {what} {index}, but there are {count}")]
    Index {
        /// The triangle.
        triangle: usize,
        /// `vertex` or `material`.
        what: &'static str,
        /// The index.
        index: u32,
        /// How many there are.
        count: usize,
    },
    /// Normals, texture coordinates or materials are for another number of vertices or triangles.
    #[error("the mesh has {count} {what} for {expected}")]
    Count {
        /// What there are too many or too few of.
        what: &'static str,
        /// How many there are.
        count: usize,
        /// How many there must be, or 0.
        expected: usize,
    },
    /// A texture has the wrong number of texels.
    #[error("a texture of {width} x {height} has {count} texels")]
    Texture {
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
        /// Texels.
        count: usize,
    },
}

impl Mesh {
    /// Checks a mesh. Triangles without area are left out.
    ///
    /// # Errors
    /// [`MeshError`] says what is wrong. Meshes that are not closed are fine: both sides of their triangles are drawn.
    pub fn new(mut data: MeshData) -> Result<Self, MeshError> {
        match data.triangles.len() {
            0 => return Err(MeshError::Empty),
            count if count > LARGEST_MESH => return Err(MeshError::Huge(count)),
            _ => {}
        }
        data.complete();
        let vertices = data.positions.len();
        for (what, count, expected) in [
            ("normals", data.normals.len(), vertices),
            ("texture coordinates", data.uvs.len(), vertices),
        ] {
            if count != 0 && count != expected {
                return Err(MeshError::Count {
                    what,
                    count,
                    expected,
                });
            }
        }
        let (count, expected) = (data.triangle_materials.len(), data.triangles.len());
        if count != expected {
            return Err(MeshError::Count {
                what: "materials of triangles",
                count,
                expected,
            });
        }
        let is_usable = |p: &[f32; 3]| p.iter().all(|x| x.abs() <= 1e9);
        if let Some(wrong) = data.positions.iter().position(|p| !is_usable(p)) {
            return Err(MeshError::NotFinite(wrong));
        }
        for (triangle, t) in data.triangles.iter().enumerate() {
            let wrong = t.iter().find(|i| **i as usize >= vertices);
            let material = data.triangle_materials[triangle];
            let (what, index, count) = match wrong {
                Some(index) => ("vertex", *index, vertices),
                None if material as usize >= data.materials.len() => {
                    ("material", material, data.materials.len())
                }
                None => continue,
            };
            return Err(MeshError::Index {
                triangle,
                what,
                index,
                count,
            });
        }
        drop_degenerate(&mut data);
        if data.triangles.is_empty() {
            return Err(MeshError::Empty);
        }
        for n in &mut data.normals {
            let unit = Vector3::from(*n).try_normalize(1e-6).unwrap_or_default();
            // Zero, also for a normal that is not finite, stands for the triangle's own normal.
            *n = if unit.iter().all(|x| x.is_finite()) {
                unit.into()
            } else {
                [0.0; 3]
            };
        }
        for uv in &mut data.uvs {
            *uv = uv.map(|x| if x.is_finite() { x } else { 0.0 });
        }
        let (mut low, mut high) = (Vector3::repeat(f64::MAX), Vector3::repeat(f64::MIN));
        for p in used(&data) {
            (low, high) = (low.inf(&p), high.sup(&p));
        }
        let centre = 0.5 * (low + high);
        let radius = used(&data).map(|p| (p - centre).norm()).fold(0.0, f64::max);
        let is_closed = is_closed(&data);
        let hides_back_faces = is_closed && volume(&data) > 0.0;
        Ok(Self {
            data,
            is_closed,
            hides_back_faces,
            centre,
            radius,
        })
    }

    /// Vertices, triangles and materials.
    pub fn data(&self) -> &MeshData {
        &self.data
    }

    /// Whether every edge joins two triangles that face the same side.
    pub fn is_closed(&self) -> bool {
        self.is_closed
    }

    pub(crate) fn hides_back_faces(&self) -> bool {
        self.hides_back_faces
    }

    /// Centre \[m\] and radius \[m\] of a sphere around it.
    pub fn bounding_sphere(&self) -> (Vector3<f64>, f64) {
        (self.centre, self.radius)
    }

    /// Whether a closed mesh contains the point `p` \[m\], by its winding number. A point on the surface is outside.
    pub fn contains(&self, p: &Vector3<f64>) -> bool {
        if !self.is_closed || (p - self.centre).norm() > self.radius {
            return false;
        }
        // Solid angles of the triangles (van Oosterom and Strackee, IEEE Trans. Biomed. Eng. 30 (1983) 125).
        let solid_angle = |t: &[u32; 3]| {
            let [a, b, c] = self.corners(t).map(|v| v - p);
            let volume = a.dot(&b.cross(&c));
            if volume == 0.0 {
                return 0.0;
            }
            let lengths = [a.norm(), b.norm(), c.norm()];
            let denominator = lengths.iter().product::<f64>()
                + a.dot(&b) * lengths[2]
                + b.dot(&c) * lengths[0]
                + c.dot(&a) * lengths[1];
            2.0 * volume.atan2(denominator)
        };
        let total: f64 = self.data.triangles.iter().map(solid_angle).sum();
        // The faces around a point of the surface fill half of the sphere.
        total.abs() > 3.0 * std::f64::consts::PI
    }

    fn corners(&self, t: &[u32; 3]) -> [Vector3<f64>; 3] {
        corners(&self.data, t)
    }
}

fn corners(data: &MeshData, t: &[u32; 3]) -> [Vector3<f64>; 3] {
    t.map(|i| Vector3::from(data.positions[i as usize].map(f64::from)))
}

/// The vertices of all triangles.
fn used(data: &MeshData) -> impl Iterator<Item = Vector3<f64>> {
    data.triangles.iter().flat_map(|t| corners(data, t))
}

fn drop_degenerate(data: &mut MeshData) {
    let keep: Vec<bool> = (data.triangles.iter())
        .map(|t| {
            let [a, b, c] = corners(data, t);
            (b - a).cross(&(c - a)).norm_squared() > 0.0
        })
        .collect();
    let mut kept = keep.iter();
    data.triangles.retain(|_| *kept.next().unwrap_or(&true));
    let mut kept = keep.iter();
    (data.triangle_materials).retain(|_| *kept.next().unwrap_or(&true));
}

/// Whether every directed edge has its opposite. Vertices at the same position are the same vertex here.
fn is_closed(data: &MeshData) -> bool {
    let mut known: HashMap<[u32; 3], u32> = HashMap::with_capacity(data.positions.len());
    let mut welded = Vec::with_capacity(data.positions.len());
    for p in &data.positions {
        // Adding zero makes a negative zero positive.
        let key = p.map(|x| (x + 0.0).to_bits());
        let next = known.len() as u32;
        welded.push(*known.entry(key).or_insert(next));
    }
    let mut edges: HashMap<(u32, u32), i32> = HashMap::with_capacity(2 * data.triangles.len());
    for t in &data.triangles {
        let t = t.map(|i| welded[i as usize]);
        for (a, b) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
            match a < b {
                true => *edges.entry((a, b)).or_default() += 1,
                false => *edges.entry((b, a)).or_default() -= 1,
            }
        }
    }
    edges.values().all(|balance| *balance == 0)
}

/// Six times the signed volume: positive if triangles face outward.
fn volume(data: &MeshData) -> f64 {
    let triangles = data.triangles.iter();
    let volumes = triangles.map(|t| {
        let [a, b, c] = corners(data, t);
        a.dot(&b.cross(&c))
    });
    volumes.sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::primitives;

    #[test]
    fn wrong_meshes_are_refused() {
        let cube = primitives::cuboid(Vector3::repeat(1.0), Material::grey(0.5));
        let data = cube.data().clone();
        let refused = |change: &dyn Fn(&mut MeshData)| {
            let mut data = data.clone();
            change(&mut data);
            Mesh::new(data).unwrap_err().to_string()
        };
        assert!(refused(&|d| d.triangles.clear()).contains("no triangle"));
        assert!(
            refused(&|d| d.triangles[3][1] = 99).contains("triangle 3 of the mesh has vertex 99")
        );
        assert!(refused(&|d| d.positions[2][0] = f32::NAN).contains("vertex 2"));
        assert!(refused(&|d| d.triangle_materials[5] = 4).contains("has material 4"));
        assert!(refused(&|d| d.uvs = vec![[0.0; 2]; 3]).contains("3 texture coordinates"));
        let huge = MeshData {
            triangles: vec![[0; 3]; LARGEST_MESH + 1],
            ..MeshData::default()
        };
        assert!(
            Mesh::new(huge)
                .unwrap_err()
                .to_string()
                .contains("at most 2000000")
        );
    }

    #[test]
    fn open_and_inside_out_meshes_are_recognised() {
        let cube = primitives::cuboid(Vector3::repeat(1.0), Material::grey(0.5));
        assert!(cube.is_closed() && cube.hides_back_faces());
        let mut open = cube.data().clone();
        open.triangles.pop();
        open.triangle_materials.pop();
        let open = Mesh::new(open).unwrap();
        assert!(!open.is_closed() && !open.hides_back_faces());
        let mut inside_out = cube.data().clone();
        inside_out.triangles.iter_mut().for_each(|t| t.swap(0, 1));
        let inside_out = Mesh::new(inside_out).unwrap();
        assert!(inside_out.is_closed() && !inside_out.hides_back_faces());
        assert!(inside_out.contains(&Vector3::new(0.1, 0.2, 0.3)));
    }

    #[test]
    fn points_inside_are_distinguished_from_those_on_the_surface() {
        let ball = primitives::sphere(2.0, Material::grey(0.5));
        assert!(ball.contains(&Vector3::new(0.3, -0.4, 1.8)));
        assert!(!ball.contains(&Vector3::new(0.0, 1.5, 1.5)));
        let cube = primitives::cuboid(Vector3::repeat(1.0), Material::grey(0.5));
        assert!(!cube.contains(&Vector3::new(0.1, 0.5, 0.2)));
        assert!(cube.contains(&Vector3::new(0.1, 0.49, 0.2)));
    }

    #[test]
    fn a_mirrored_mesh_still_faces_outward() {
        let mut data = primitives::sphere(1.0, Material::grey(0.5)).data().clone();
        data.transform(
            &Vector3::new(-2.0, 1.0, 1.0),
            &Isometry3::translation(0.0, 3.0, 0.0),
        );
        let mesh = Mesh::new(data).unwrap();
        assert!(mesh.hides_back_faces());
        let (centre, radius) = mesh.bounding_sphere();
        assert!(
            (centre - Vector3::new(0.0, 3.0, 0.0)).norm() < 1e-6 && (radius - 2.0).abs() < 1e-6
        );
    }

    #[test]
    fn textures_interpolate_and_repeat() {
        let texture = Texture::new(2, 1, vec![[0; 3], [255; 3]]).unwrap();
        assert_eq!(texture.sample(0.25, 0.5), [0.0; 3]);
        assert_eq!(texture.sample(1.75, 3.5), [1.0; 3]);
        assert!((texture.sample(0.5, 0.1)[0] - 0.5).abs() < 1e-6);
        assert!(Texture::new(2, 2, vec![[0; 3]; 3]).is_err());
    }

    #[test]
    fn srgb_and_linear_light_are_inverse() {
        for value in [0.0, 0.02, 0.2, 0.5, 1.0] {
            assert!((from_srgb(to_srgb(value)) - value).abs() < 1e-5);
        }
        // IEC 61966-2-1: half of the code range is a fifth of the light.
        assert!((from_srgb(0.5) - 0.214_04).abs() < 1e-4);
    }
}
