//! Convex polyhedra: vertices, faces, edges.

use nalgebra::Vector3;

use super::shape::ShapeError;

/// Largest number of vertices of a convex hull: the cost of a contact grows with it.
const VERTICES: usize = 256;

/// Distance below which points lie in a plane, relative to the size of the hull.
const FLAT: f64 = 1e-9;

/// A face.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Face {
    /// Outward normal.
    pub normal: Vector3<f64>,
    /// Distance of its plane from the origin along the normal.
    pub offset: f64,
    /// Vertices, counterclockwise seen from outside.
    pub vertices: Vec<usize>,
}

/// A convex polyhedron, made by [`Shape::cuboid`](super::Shape::cuboid) or
/// [`Shape::convex_hull`](super::Shape::convex_hull).
#[derive(Debug, Clone, PartialEq)]
pub struct Polyhedron {
    vertices: Vec<Vector3<f64>>,
    faces: Vec<Face>,
    edges: Vec<[usize; 2]>,
}

impl Polyhedron {
    /// Vertices \[m\].
    pub fn vertices(&self) -> &[Vector3<f64>] {
        &self.vertices
    }

    pub(super) fn faces(&self) -> &[Face] {
        &self.faces
    }

    pub(super) fn edges(&self) -> &[[usize; 2]] {
        &self.edges
    }

    pub(super) fn bounding_radius(&self) -> f64 {
        self.vertices.iter().map(|v| v.norm()).fold(0.0, f64::max)
    }

    /// A box with these half edges.
    pub(super) fn cuboid(half: &Vector3<f64>) -> Self {
        let signs = [1.0, -1.0];
        let mut vertices = Vec::new();
        for x in signs {
            for y in signs {
                for z in signs {
                    vertices.push(half.component_mul(&Vector3::new(x, y, z)));
                }
            }
        }
        let mut outlines = Vec::new();
        for axis in [Vector3::<f64>::x(), Vector3::y(), Vector3::z()] {
            for sign in signs {
                let normal = axis * sign;
                let is_on = |i: &usize| normal.dot(&vertices[*i]) > 0.0;
                outlines.push((normal, (0..8).filter(is_on).collect()));
            }
        }
        Self::from_faces(vertices, outlines)
    }

    /// A prism about z with its edges on a cylinder.
    pub(super) fn prism(radius: f64, half_length: f64, sides: usize) -> Self {
        let mut vertices = Vec::new();
        for i in 0..sides {
            let (sin, cos) = (std::f64::consts::TAU * i as f64 / sides as f64).sin_cos();
            for z in [half_length, -half_length] {
                vertices.push(Vector3::new(radius * cos, radius * sin, z));
            }
        }
        let mut outlines = vec![
            (Vector3::z(), (0..sides).map(|i| 2 * i).collect()),
            (-Vector3::z(), (0..sides).map(|i| 2 * i + 1).collect()),
        ];
        for i in 0..sides {
            let j = (i + 1) % sides;
            let middle = vertices[2 * i] + vertices[2 * j + 1];
            let normal = Vector3::new(middle.x, middle.y, 0.0).normalize();
            outlines.push((normal, vec![2 * i, 2 * i + 1, 2 * j, 2 * j + 1]));
        }
        Self::from_faces(vertices, outlines)
    }

    /// A polyhedron from vertices and, for each face, the normal and the indices of its vertices.
    fn from_faces(vertices: Vec<Vector3<f64>>, outlines: Vec<(Vector3<f64>, Vec<usize>)>) -> Self {
        let mut faces = Vec::new();
        let mut edges: Vec<[usize; 2]> = Vec::new();
        for (normal, mut outline) in outlines {
            let centre =
                outline.iter().map(|&i| vertices[i]).sum::<Vector3<f64>>() / outline.len() as f64;
            let first = (vertices[outline[0]] - centre).normalize();
            let second = normal.cross(&first);
            let angle = |i: &usize| {
                let r = vertices[*i] - centre;
                r.dot(&second).atan2(r.dot(&first))
            };
            outline.sort_by(|a, b| angle(a).total_cmp(&angle(b)));
            for (k, &i) in outline.iter().enumerate() {
                let j = outline[(k + 1) % outline.len()];
                let edge = [i.min(j), i.max(j)];
                if !edges.contains(&edge) {
                    edges.push(edge);
                }
            }
            let offset = normal.dot(&centre);
            let vertices = outline;
            faces.push(Face {
                normal,
                offset,
                vertices,
            });
        }
        Self {
            vertices,
            faces,
            edges,
        }
    }

    /// The convex hull of points.
    pub(super) fn convex_hull(points: &[Vector3<f64>]) -> Result<Self, ShapeError> {
        if let Some(i) = points.iter().position(|p| !p.iter().all(|x| x.is_finite())) {
            return Err(ShapeError::NotFinite(i));
        }
        let triangles = hull_triangles(points)?;
        let mut used: Vec<usize> = triangles.iter().flatten().copied().collect();
        used.sort_unstable();
        used.dedup();
        if used.len() > VERTICES {
            let (found, limit) = (used.len(), VERTICES);
            return Err(ShapeError::TooFine { found, limit });
        }
        let vertices: Vec<_> = used.iter().map(|&i| points[i]).collect();
        let size = vertices
            .iter()
            .map(|v| (v - vertices[0]).norm())
            .fold(0.0, f64::max);
        let mut outlines: Vec<(Vector3<f64>, Vec<usize>)> = Vec::new();
        for [a, b, c] in triangles {
            let Some(normal) = (points[b] - points[a])
                .cross(&(points[c] - points[a]))
                .try_normalize(0.0)
            else {
                continue;
            };
            let offset = normal.dot(&points[a]);
            let is_known = |(other, on): &(Vector3<f64>, Vec<usize>)| {
                other.dot(&normal) > 1.0 - 1e-9
                    && (other.dot(&vertices[on[0]]) - offset).abs() < FLAT * size
            };
            if outlines.iter().any(is_known) {
                continue;
            }
            // Coplanar triangles are merged into one face.
            let on: Vec<usize> = (0..vertices.len())
                .filter(|&i| (normal.dot(&vertices[i]) - offset).abs() <= FLAT * size)
                .collect();
            if on.len() >= 3 {
                outlines.push((normal, on));
            }
        }
        Ok(Self::from_faces(vertices, outlines))
    }

    /// Signed distance of a point from the surface, negative inside, and the outward normal there.
    pub(super) fn distance(&self, point: &Vector3<f64>) -> (f64, Vector3<f64>) {
        let (above, normal) = self.above(point);
        if above <= 0.0 {
            return (above, normal);
        }
        let mut best = (f64::INFINITY, normal);
        for face in &self.faces {
            let height = face.normal.dot(point) - face.offset;
            let is_over = || {
                self.sides(face)
                    .all(|(inward, offset)| inward.dot(point) >= offset)
            };
            if height > 0.0 && height < best.0 && is_over() {
                best = (height, face.normal);
            }
        }
        for &[a, b] in &self.edges {
            let (a, b) = (&self.vertices[a], &self.vertices[b]);
            let along = b - a;
            let t = ((point - a).dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
            let offset = point - (a + along * t);
            let distance = offset.norm();
            if distance == 0.0 {
                return (0.0, self.above(point).1);
            }
            if distance < best.0 {
                best = (distance, offset / distance);
            }
        }
        best
    }

    /// Height of a point over the face that it is furthest above: the exact signed distance if the point is inside or
    /// over that face, otherwise a lower bound.
    pub(super) fn above(&self, point: &Vector3<f64>) -> (f64, Vector3<f64>) {
        let mut best = (f64::NEG_INFINITY, Vector3::z());
        for face in &self.faces {
            let height = face.normal.dot(point) - face.offset;
            if height > best.0 {
                best = (height, face.normal);
            }
        }
        best
    }

    /// Planes through the sides of a face, perpendicular to it: inward normals and offsets.
    pub(super) fn sides<'a>(
        &'a self,
        face: &'a Face,
    ) -> impl Iterator<Item = (Vector3<f64>, f64)> + 'a {
        let count = face.vertices.len();
        (0..count).map(move |k| {
            let (a, b) = (
                self.vertices[face.vertices[k]],
                self.vertices[face.vertices[(k + 1) % count]],
            );
            let inward = face.normal.cross(&(b - a)).normalize();
            (inward, inward.dot(&a))
        })
    }
}

/// Triangles of the convex hull of points, outward counterclockwise, by adding one point after the other.
fn hull_triangles(points: &[Vector3<f64>]) -> Result<Vec<[usize; 3]>, ShapeError> {
    let no_volume = || ShapeError::NoVolume(points.len());
    let farthest = |measure: &dyn Fn(&Vector3<f64>) -> f64| {
        let values = points.iter().map(measure).enumerate();
        values
            .max_by(|a, b| a.1.total_cmp(&b.1))
            .ok_or_else(no_volume)
    };
    let origin = *points.first().ok_or_else(no_volume)?;
    let (a, size) = farthest(&|p| (p - origin).norm())?;
    let (b, length) = farthest(&|p| (p - points[a]).norm())?;
    let flat = FLAT * size.max(length);
    let along = (points[b] - points[a])
        .try_normalize(flat)
        .ok_or_else(no_volume)?;
    let (c, width) = farthest(&|p| (p - points[a]).cross(&along).norm())?;
    if width <= flat {
        return Err(no_volume());
    }
    let normal = along.cross(&(points[c] - points[a])).normalize();
    let (d, height) = farthest(&|p| (p - points[a]).dot(&normal).abs())?;
    if height <= flat {
        return Err(no_volume());
    }
    let is_above = |[i, j, k]: [usize; 3], p: &Vector3<f64>| {
        let normal = (points[j] - points[i]).cross(&(points[k] - points[i]));
        (p - points[i]).dot(&normal) > flat * normal.norm()
    };
    let centre = (points[a] + points[b] + points[c] + points[d]) / 4.0;
    let mut triangles: Vec<[usize; 3]> = [[a, b, c], [a, b, d], [a, c, d], [b, c, d]]
        .map(|[i, j, k]| {
            if is_above([i, j, k], &centre) {
                [i, k, j]
            } else {
                [i, j, k]
            }
        })
        .to_vec();
    for (p, point) in points.iter().enumerate() {
        let (seen, kept): (Vec<[usize; 3]>, Vec<[usize; 3]>) =
            triangles.iter().partition(|t| is_above(**t, point));
        if seen.is_empty() {
            continue;
        }
        // Boundary edges of the visible triangles: edges whose reverse belongs to no visible triangle.
        let directed: Vec<[usize; 2]> = seen
            .iter()
            .flat_map(|&[i, j, k]| [[i, j], [j, k], [k, i]])
            .collect();
        triangles = kept;
        for &[i, j] in &directed {
            if !directed.contains(&[j, i]) {
                triangles.push([i, j, p]);
            }
        }
    }
    Ok(triangles)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hull_of_a_box_and_points_inside_is_the_box() {
        let half = Vector3::new(0.3, 0.2, 0.5);
        let cuboid = Polyhedron::cuboid(&half);
        let mut points = cuboid.vertices.clone();
        points.insert(3, Vector3::new(0.1, 0.0, 0.2));
        points.insert(0, Vector3::zeros());
        // In a face and on an edge.
        points.push(Vector3::new(0.3, 0.1, 0.2));
        points.push(Vector3::new(0.3, 0.2, 0.2));
        let hull = Polyhedron::convex_hull(&points).unwrap();
        assert_eq!(hull.faces.len(), 6);
        for point in [
            [0.5, 0.0, 0.0],
            [0.1, 0.1, 0.1],
            [0.5, 0.4, 0.9],
            [0.29, 0.0, 0.0],
            [0.4, 0.5, 0.0],
        ] {
            let point = Vector3::from(point);
            let (one, other) = (hull.distance(&point), cuboid.distance(&point));
            assert!(
                (one.0 - other.0).abs() < 1e-15 && (one.1 - other.1).norm() < 1e-15,
                "{point}: {one:?} {other:?}"
            );
        }
        assert!((cuboid.distance(&Vector3::new(0.6, 0.6, 0.5)).0 - 0.5).abs() < 1e-15);
        assert_eq!(
            (
                cuboid.edges.len(),
                Polyhedron::prism(1.0, 1.0, 5).edges.len()
            ),
            (12, 15)
        );
    }

    #[test]
    fn points_on_a_sphere_are_all_part_of_their_hull() {
        let points: Vec<_> = (0..60)
            .map(|i| {
                let (z, turn) = (1.0 - (2 * i + 1) as f64 / 60.0, 2.4 * i as f64);
                let across = (1.0 - z * z).sqrt();
                Vector3::new(across * turn.cos(), across * turn.sin(), z)
            })
            .collect();
        let hull = Polyhedron::convex_hull(&points).unwrap();
        assert_eq!(hull.vertices.len(), 60);
        // Euler: a hull of triangles with v vertices has 2 v - 4 faces and 3 v - 6 edges.
        assert_eq!((hull.faces.len(), hull.edges.len()), (116, 174));
        assert!(hull.faces.iter().all(|f| f.offset > 0.8));
        // Normals are cross products of edges as short as 0.1, which loses a digit and a half.
        let off = points
            .iter()
            .map(|p| hull.distance(p).0.abs())
            .fold(0.0, f64::max);
        assert!(off < 1e-13, "{off:e}");
    }
}
