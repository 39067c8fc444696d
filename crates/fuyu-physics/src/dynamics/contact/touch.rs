//! Contact points of two shapes: points of one shape over the surface of the other.
//!
//! Every pair of shapes has a fixed number of possible contact points, so that a point keeps its number while it
//! touches. Pairs without polyhedra have closed forms. Two polyhedra touch at vertices of either that are inside the
//! other, and at their deepest pair of edges, if no face is less deep. A capsule touches a box at the two ends of the
//! part of its axis that is over a face.

use nalgebra::{Point3, Vector3};

use super::polyhedron::{Face, Polyhedron};
use super::shape::Shape;
use crate::spatial::{Pose, closest_points};

/// A possible contact point: a sphere (of radius zero for a vertex) fixed to one shape, over the surface of the other
/// shape.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Touch {
    /// Centre of the sphere, world axes.
    pub centre: Vector3<f64>,
    /// Radius of the sphere.
    pub radius: f64,
    /// Outward normal of the other's surface, world axes.
    pub normal: Vector3<f64>,
    /// Distance of the surfaces, negative inside.
    pub gap: f64,
    /// Whether the sphere is of the second shape.
    pub of_second: bool,
}

impl Touch {
    /// No contact: far away.
    pub const NONE: Self = Self {
        centre: Vector3::new(0.0, 0.0, 0.0),
        radius: 0.0,
        normal: Vector3::new(0.0, 0.0, 1.0),
        gap: f64::INFINITY,
        of_second: false,
    };

    fn new(centre: Vector3<f64>, radius: f64, normal: Vector3<f64>, gap: f64) -> Self {
        let of_second = false;
        Self {
            centre,
            radius,
            normal,
            gap,
            of_second,
        }
    }
}

/// Rank of a shape: the shape of lower rank is the first of a pair.
fn rank(shape: &Shape) -> u8 {
    match shape {
        Shape::Sphere { .. } => 0,
        Shape::Capsule { .. } => 1,
        Shape::Polyhedron(_) | Shape::Cylinder { .. } => 2,
        Shape::HalfSpace => 3,
    }
}

/// Number of possible contact points of a pair; zero for two half-spaces, which are never in contact.
pub(super) fn count(first: &Shape, second: &Shape) -> usize {
    let (a, b) = if rank(first) <= rank(second) {
        (first, second)
    } else {
        (second, first)
    };
    match (a, b) {
        (Shape::Sphere { .. }, _) => 1,
        (Shape::Capsule { .. }, Shape::Capsule { .. }) => 1,
        (Shape::Capsule { .. }, _) => 2,
        _ => match (a.polyhedron(), b.polyhedron()) {
            (Some(a), Some(b)) => a.vertices().len() + b.vertices().len() + 1,
            (Some(a), None) => a.vertices().len(),
            _ => 0,
        },
    }
}

/// Computes the contact points of two shapes at poses in the world; `out` must have [`count`] elements.
pub(super) fn find(first: (&Shape, &Pose), second: (&Shape, &Pose), out: &mut [Touch]) {
    out.fill(Touch::NONE);
    let apart = (first.1.translation.vector - second.1.translation.vector).norm();
    let reach = first.0.bounding_radius() + second.0.bounding_radius();
    if apart > 1.5 * reach {
        for touch in out {
            touch.gap = apart - reach;
        }
        return;
    }
    if rank(first.0) <= rank(second.0) {
        ordered(first, second, out);
    } else {
        ordered(second, first, out);
        for touch in out {
            touch.of_second = !touch.of_second;
        }
    }
}

fn ordered((a, X_WA): (&Shape, &Pose), (b, X_WB): (&Shape, &Pose), out: &mut [Touch]) {
    let p_A = X_WA.translation.vector;
    match (a, b) {
        (Shape::Sphere { radius }, _) => out[0] = sphere(&p_A, *radius, b, X_WB),
        (
            Shape::Capsule {
                radius,
                half_length,
            },
            _,
        ) => {
            let axis = X_WA.rotation * Vector3::z() * *half_length;
            let ends = [p_A + axis, p_A - axis];
            if let Shape::Capsule { half_length, .. } = b {
                let p_B = X_WB.translation.vector;
                let other = X_WB.rotation * Vector3::z() * *half_length;
                let [near, _] = closest_points(&ends, &[p_B + other, p_B - other]);
                out[0] = sphere(&near, *radius, b, X_WB);
            } else if let Some(polyhedron) = b.polyhedron() {
                capsule_on_polyhedron(&ends, *radius, polyhedron, X_WB, out);
            } else {
                for (touch, end) in out.iter_mut().zip(&ends) {
                    *touch = sphere(end, *radius, b, X_WB);
                }
            }
        }
        _ => match (a.polyhedron(), b.polyhedron()) {
            (Some(a), Some(b)) => {
                let (of_a, rest) = out.split_at_mut(a.vertices().len());
                let (of_b, edges) = rest.split_at_mut(b.vertices().len());
                vertices_in_polyhedron((a, X_WA), (b, X_WB), of_a);
                vertices_in_polyhedron((b, X_WB), (a, X_WA), of_b);
                for touch in of_b {
                    touch.of_second = true;
                }
                edges[0] = edges_across((a, X_WA), (b, X_WB));
            }
            (Some(a), None) => {
                for (touch, vertex) in out.iter_mut().zip(a.vertices()) {
                    *touch = sphere(&(X_WA * Point3::from(*vertex)).coords, 0.0, b, X_WB);
                }
            }
            _ => {}
        },
    }
}

/// A sphere over the surface of `b`.
fn sphere(centre: &Vector3<f64>, radius: f64, b: &Shape, X_WB: &Pose) -> Touch {
    let p_B = X_WB.inverse_transform_point(&Point3::from(*centre)).coords;
    let (distance, normal) = b.distance(&p_B);
    Touch::new(*centre, radius, X_WB.rotation * normal, distance - radius)
}

/// The vertices of `a` over the faces of `b`.
fn vertices_in_polyhedron(
    (a, X_WA): (&Polyhedron, &Pose),
    (b, X_WB): (&Polyhedron, &Pose),
    out: &mut [Touch],
) {
    let X_BA = X_WB.inverse() * X_WA;
    for (touch, vertex) in out.iter_mut().zip(a.vertices()) {
        let (height, normal) = b.above(&(X_BA * Point3::from(*vertex)).coords);
        let centre = (X_WA * Point3::from(*vertex)).coords;
        *touch = Touch::new(centre, 0.0, X_WB.rotation * normal, height);
    }
}

/// The deepest pair of edges of which each passes through the other polyhedron. None if a face is less deep: vertices
/// then carry the contact.
fn edges_across((a, X_WA): (&Polyhedron, &Pose), (b, X_WB): (&Polyhedron, &Pose)) -> Touch {
    let X_BA = X_WB.inverse() * X_WA;
    let X_AB = X_BA.inverse();
    let least = depth_of_faces(b, a, &X_BA).min(depth_of_faces(a, b, &X_AB)) * (1.0 - 1e-9);
    let mut best = Touch::NONE;
    best.gap = 0.0;
    for edge in a.edges() {
        let ends = edge.map(|i| (X_BA * Point3::from(a.vertices()[i])).coords);
        // An edge beyond one face does not pass through.
        let is_beyond = |face: &Face| ends.iter().all(|p| face.normal.dot(p) > face.offset);
        if b.faces().iter().any(is_beyond) {
            continue;
        }
        for other in b.edges() {
            let others = other.map(|i| b.vertices()[i]);
            let [p, q] = closest_points(&ends, &others);
            let depth = (p - q).norm();
            if depth <= -best.gap
                || depth >= least
                || b.above(&p).0 > 0.0
                || a.above(&(X_AB * Point3::from(q)).coords).0 > 0.0
            {
                continue;
            }
            let normal = X_WB.rotation * ((q - p) / depth);
            best = Touch::new((X_WB * Point3::from(p)).coords, 0.0, normal, -depth);
        }
    }
    if best.gap == 0.0 {
        best.gap = f64::INFINITY;
    }
    best
}

/// Least depth of `other`, at `X_AO`, behind a face of `a`; negative if it is in front of one.
fn depth_of_faces(a: &Polyhedron, other: &Polyhedron, X_AO: &Pose) -> f64 {
    let depth = |face: &Face| {
        let normal_O = X_AO.rotation.inverse() * face.normal;
        let heights = other.vertices().iter().map(|v| normal_O.dot(v));
        let lowest = heights.fold(f64::INFINITY, f64::min);
        face.offset - lowest - face.normal.dot(&X_AO.translation.vector)
    };
    a.faces().iter().map(depth).fold(f64::INFINITY, f64::min)
}

/// The part of a capsule's axis over the face from which the axis is furthest, or otherwise the edge closest to the
/// axis.
fn capsule_on_polyhedron(
    ends: &[Vector3<f64>; 2],
    radius: f64,
    b: &Polyhedron,
    X_WB: &Pose,
    out: &mut [Touch],
) {
    let local = ends.map(|end| X_WB.inverse_transform_point(&Point3::from(end)).coords);
    let along = local[1] - local[0];
    let height = |face: &super::polyhedron::Face| {
        let heights = local.map(|p| face.normal.dot(&p) - face.offset);
        heights[0].min(heights[1])
    };
    let Some(face) = b
        .faces()
        .iter()
        .max_by(|f, g| height(f).total_cmp(&height(g)))
    else {
        return;
    };
    let (mut from, mut to) = (0.0_f64, 1.0_f64);
    for (inward, offset) in b.sides(face) {
        let (start, slope) = (inward.dot(&local[0]) - offset, inward.dot(&along));
        if slope > 0.0 {
            from = from.max(-start / slope);
        } else if slope < 0.0 {
            to = to.min(-start / slope);
        } else if start < 0.0 {
            to = -1.0;
        }
    }
    if from <= to {
        for (touch, t) in out.iter_mut().zip([from, to]) {
            let p = local[0] + along * t;
            let gap = face.normal.dot(&p) - face.offset - radius;
            *touch = Touch::new(
                (X_WB * Point3::from(p)).coords,
                radius,
                X_WB.rotation * face.normal,
                gap,
            );
        }
        return;
    }
    for edge in b.edges() {
        let [p, q] = closest_points(&local, &edge.map(|i| b.vertices()[i]));
        let distance = (p - q).norm();
        if distance > 0.0 && distance - radius < out[0].gap {
            let normal = X_WB.rotation * ((p - q) / distance);
            out[0] = Touch::new(
                (X_WB * Point3::from(p)).coords,
                radius,
                normal,
                distance - radius,
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Rotation3, Translation3};

    fn at(x: f64, y: f64, z: f64) -> Pose {
        Pose::translation(x, y, z)
    }

    fn touches(first: (&Shape, Pose), second: (&Shape, Pose)) -> Vec<Touch> {
        let mut out = vec![Touch::NONE; count(first.0, second.0)];
        find((first.0, &first.1), (second.0, &second.1), &mut out);
        out.retain(|t| t.gap < 0.0);
        out
    }

    /// Compares with depth and normal computed by hand, in either order of the pair.
    #[test]
    fn simple_pairs_touch_where_geometry_says() {
        let ball = Shape::sphere(0.1).unwrap();
        let bar = Shape::capsule(0.05, 0.4).unwrap();
        let block = Shape::cuboid(&Vector3::new(0.4, 0.6, 0.2)).unwrap();
        let drum = Shape::cylinder(0.3, 0.8).unwrap();
        let lying = Pose::from_parts(
            Translation3::new(0.0, 0.0, 0.13),
            Rotation3::from_axis_angle(&Vector3::x_axis(), std::f64::consts::FRAC_PI_2),
        );
        for (first, second, count, depth) in [
            (
                (&ball, at(0.0, 0.0, 0.19)),
                (&ball, at(0.0, 0.0, 0.0)),
                1,
                0.01,
            ),
            (
                (&ball, at(0.1, 0.2, 0.18)),
                (&block, at(0.0, 0.0, 0.0)),
                1,
                0.02,
            ),
            (
                (&ball, at(0.0, 0.0, 0.095)),
                (&Shape::HalfSpace, at(0.0, 0.0, 0.0)),
                1,
                0.005,
            ),
            (
                (&ball, at(0.38, 0.0, 0.3)),
                (&drum, at(0.0, 0.0, 0.0)),
                1,
                0.02,
            ),
            ((&bar, lying), (&block, at(0.0, 0.0, 0.0)), 2, 0.02),
            (
                (&bar, lying),
                (&Shape::HalfSpace, at(0.0, 0.0, 0.1)),
                2,
                0.02,
            ),
            ((&bar, lying), (&bar, at(0.0, 0.0, -0.16)), 1, 0.01),
            (
                (&block, at(0.3, 0.1, 0.17)),
                (&block, at(0.0, 0.0, 0.0)),
                // One vertex of each.
                2,
                0.03,
            ),
            (
                (&block, at(0.3, 0.1, 0.07)),
                (&Shape::HalfSpace, at(0.0, 0.0, 0.0)),
                4,
                0.03,
            ),
        ] {
            for (a, b, sign) in [(first, second, 1.0), (second, first, -1.0)] {
                let found = touches(a, b);
                assert_eq!(found.len(), count, "{first:?} {second:?} {found:?}");
                for touch in found {
                    assert!((touch.gap + depth).abs() < 1e-14, "{touch:?}");
                    // From the second to the first.
                    let normal = touch.normal * if touch.of_second { -sign } else { sign };
                    assert!(
                        normal.z.abs() > 0.999 && normal.z > 0.0 || normal.x > 0.999,
                        "{touch:?}"
                    );
                }
            }
        }
    }

    /// Two boxes that cross on edges, of which no vertex is inside of the other.
    #[test]
    fn edges_that_cross_touch() {
        let block = Shape::cuboid(&Vector3::new(2.0, 0.2, 0.2)).unwrap();
        let quarter = std::f64::consts::FRAC_PI_4;
        let turned = Rotation3::from_axis_angle(&Vector3::x_axis(), quarter);
        let across = Rotation3::from_axis_angle(&Vector3::z_axis(), 2.0 * quarter) * turned;
        let height = 0.2 * 2f64.sqrt() - 0.01;
        let upper = Pose::from_parts(Translation3::new(0.0, 0.0, height), across);
        let lower = Pose::from_parts(Translation3::identity(), turned);
        let found = touches((&block, upper), (&block, lower));
        assert_eq!(found.len(), 1, "{found:?}");
        assert!(
            (found[0].gap + 0.01).abs() < 1e-14 && (found[0].normal - Vector3::z()).norm() < 1e-12,
            "{found:?}"
        );
    }
}
