//! Collision shapes, and the signed distance of a point from each.

use std::sync::Arc;

use nalgebra::Vector3;

use super::polyhedron::Polyhedron;
use crate::model::CollisionGeometry;

/// Sides of the prism that replaces a cylinder in contact with anything but a sphere.
const CYLINDER_SIDES: usize = 32;

/// Why a shape is refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ShapeError {
    /// A length that is not positive.
    #[error("{field} is {value} m; it must be positive and finite")]
    Length {
        /// Which one.
        field: &'static str,
        /// Its value.
        value: f64,
    },
    /// A mesh without volume.
    #[error("the mesh has no volume: its {0} points are in one plane; give a solid")]
    NoVolume(usize),
    /// A mesh with a vertex that is not finite.
    #[error("vertex {0} of the mesh is not finite")]
    NotFinite(usize),
    /// A mesh with too many vertices.
    #[error(
        "the convex hull of the mesh has {found} vertices; at most {limit} are supported: simplify the mesh"
    )]
    TooFine {
        /// Vertices.
        found: usize,
        /// Limit.
        limit: usize,
    },
}

/// A convex shape in its own frame.
#[derive(Debug, Clone, PartialEq)]
pub enum Shape {
    /// A sphere about the origin.
    Sphere {
        /// Radius \[m\].
        radius: f64,
    },
    /// The points within `radius` of a segment along z, whose ends are the centres of two hemispheres.
    Capsule {
        /// Radius \[m\].
        radius: f64,
        /// Half the length of the segment \[m\].
        half_length: f64,
    },
    /// A convex polyhedron.
    Polyhedron(Arc<Polyhedron>),
    /// A cylinder about z. In contact with anything but a sphere it is replaced by a prism with 32 sides, whose edges
    /// are on the cylinder.
    Cylinder {
        /// Radius \[m\].
        radius: f64,
        /// Half its length \[m\].
        half_length: f64,
        /// The prism.
        prism: Arc<Polyhedron>,
    },
    /// Everything below the plane z = 0.
    HalfSpace,
}

impl Shape {
    /// Whether contact with `other` is refused: the force of a capsule on a polyhedron jumps from face to face, which
    /// only few and wide faces hide.
    pub(super) fn is_unsafe_with(&self, other: &Self) -> bool {
        let is_capsule = |shape: &Self| matches!(shape, Self::Capsule { .. });
        let has_many_faces = |shape: &Self| match shape {
            Self::Cylinder { .. } => true,
            Self::Polyhedron(polyhedron) => polyhedron.faces().len() > 6,
            _ => false,
        };
        (is_capsule(self) && has_many_faces(other)) || (is_capsule(other) && has_many_faces(self))
    }

    /// A sphere of `radius` \[m\].
    ///
    /// # Errors
    /// [`ShapeError::Length`].
    pub fn sphere(radius: f64) -> Result<Self, ShapeError> {
        positive("the radius of a sphere", radius)?;
        Ok(Self::Sphere { radius })
    }

    /// A capsule of `radius` \[m\], with `length` \[m\] between the centres of its ends.
    ///
    /// # Errors
    /// [`ShapeError::Length`].
    pub fn capsule(radius: f64, length: f64) -> Result<Self, ShapeError> {
        positive("the radius of a capsule", radius)?;
        positive("the length of a capsule", length)?;
        let half_length = 0.5 * length;
        Ok(Self::Capsule {
            radius,
            half_length,
        })
    }

    /// A cylinder of `radius` and `length` \[m\].
    ///
    /// # Errors
    /// [`ShapeError::Length`].
    pub fn cylinder(radius: f64, length: f64) -> Result<Self, ShapeError> {
        positive("the radius of a cylinder", radius)?;
        positive("the length of a cylinder", length)?;
        let half_length = 0.5 * length;
        let prism = Arc::new(Polyhedron::prism(radius, half_length, CYLINDER_SIDES));
        Ok(Self::Cylinder {
            radius,
            half_length,
            prism,
        })
    }

    /// A box with these edges \[m\].
    ///
    /// # Errors
    /// [`ShapeError::Length`].
    pub fn cuboid(edges: &Vector3<f64>) -> Result<Self, ShapeError> {
        for edge in edges {
            positive("an edge of a box", *edge)?;
        }
        Ok(Self::Polyhedron(Arc::new(Polyhedron::cuboid(
            &(edges * 0.5),
        ))))
    }

    /// The shape of a `<collision>`; for a mesh, the convex hull of its `vertices` (before scaling).
    ///
    /// # Errors
    /// [`ShapeError`] as the other constructors.
    pub fn from_geometry(
        geometry: &CollisionGeometry,
        vertices: &[Vector3<f64>],
    ) -> Result<Self, ShapeError> {
        match geometry {
            CollisionGeometry::Box { size } => Self::cuboid(size),
            CollisionGeometry::Sphere { radius } => Self::sphere(*radius),
            CollisionGeometry::Cylinder { radius, length } => Self::cylinder(*radius, *length),
            CollisionGeometry::Capsule { radius, length } => Self::capsule(*radius, *length),
            CollisionGeometry::Mesh { scale, .. } => {
                let scaled: Vec<_> = vertices.iter().map(|v| v.component_mul(scale)).collect();
                Self::convex_hull(&scaled)
            }
        }
    }

    /// The convex hull of points \[m\].
    ///
    /// # Errors
    /// [`ShapeError`] if they have no volume, if one is not finite, or if there are too many.
    pub fn convex_hull(points: &[Vector3<f64>]) -> Result<Self, ShapeError> {
        Ok(Self::Polyhedron(Arc::new(Polyhedron::convex_hull(points)?)))
    }

    /// Radius of the sphere about the origin that contains the shape \[m\]; infinite for a half-space.
    pub fn bounding_radius(&self) -> f64 {
        match self {
            Self::Sphere { radius } => *radius,
            Self::Capsule {
                radius,
                half_length,
            } => radius + half_length,
            Self::Cylinder {
                radius,
                half_length,
                ..
            } => radius.hypot(*half_length),
            Self::Polyhedron(polyhedron) => polyhedron.bounding_radius(),
            Self::HalfSpace => f64::INFINITY,
        }
    }

    /// Signed distance of `point` from the surface \[m\], negative inside, and the outward normal there.
    pub fn distance(&self, point: &Vector3<f64>) -> (f64, Vector3<f64>) {
        match self {
            Self::Sphere { radius } => from_centre(point, *radius),
            Self::Capsule {
                radius,
                half_length,
            } => {
                let z = point.z.clamp(-half_length, *half_length);
                from_centre(&(point - Vector3::new(0.0, 0.0, z)), *radius)
            }
            Self::Cylinder {
                radius,
                half_length,
                ..
            } => from_cylinder(point, *radius, *half_length),
            Self::Polyhedron(polyhedron) => polyhedron.distance(point),
            Self::HalfSpace => (point.z, Vector3::z()),
        }
    }

    /// The polyhedron of the shape, or the prism that replaces it.
    pub(super) fn polyhedron(&self) -> Option<&Polyhedron> {
        match self {
            Self::Polyhedron(polyhedron)
            | Self::Cylinder {
                prism: polyhedron, ..
            } => Some(polyhedron),
            _ => None,
        }
    }
}

fn positive(field: &'static str, value: f64) -> Result<(), ShapeError> {
    if value > 0.0 && value.is_finite() {
        Ok(())
    } else {
        Err(ShapeError::Length { field, value })
    }
}

fn from_centre(point: &Vector3<f64>, radius: f64) -> (f64, Vector3<f64>) {
    let distance = point.norm();
    let normal = if distance > 0.0 {
        point / distance
    } else {
        Vector3::z()
    };
    (distance - radius, normal)
}

fn from_cylinder(point: &Vector3<f64>, radius: f64, half_length: f64) -> (f64, Vector3<f64>) {
    let across = Vector3::new(point.x, point.y, 0.0);
    let (side, outward) = from_centre(&across, radius);
    let outward = if across.norm() > 0.0 {
        outward
    } else {
        Vector3::x()
    };
    let end = point.z.abs() - half_length;
    let along = Vector3::z() * point.z.signum();
    if side > 0.0 && end > 0.0 {
        let offset = outward * side + along * end;
        let distance = offset.norm();
        (distance, offset / distance)
    } else if side > end {
        (side, outward)
    } else {
        (end, along)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_from_a_cylinder() {
        let cylinder = Shape::cylinder(0.5, 2.0).unwrap();
        for (point, distance, normal) in [
            ([0.8, 0.0, 0.3], 0.3, [1.0, 0.0, 0.0]),
            ([0.0, 0.4, 0.3], -0.1, [0.0, 1.0, 0.0]),
            ([0.1, 0.0, -0.95], -0.05, [0.0, 0.0, -1.0]),
            ([0.8, 0.0, 1.4], 0.5, [0.6, 0.0, 0.8]),
        ] {
            let found = cylinder.distance(&Vector3::from(point));
            assert!((found.0 - distance).abs() < 1e-15, "{point:?}: {found:?}");
            assert!(
                (found.1 - Vector3::from(normal)).norm() < 1e-15,
                "{point:?}: {found:?}"
            );
        }
    }

    #[test]
    fn shapes_without_volume_are_refused() {
        let message = Shape::sphere(0.0).unwrap_err().to_string();
        assert_eq!(
            message,
            "the radius of a sphere is 0 m; it must be positive and finite"
        );
        let flat = [
            [0.0, 0.0, 0.0],
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [1.0, 1.0, 0.0],
        ]
        .map(Vector3::from);
        assert_eq!(Shape::convex_hull(&flat), Err(ShapeError::NoVolume(4)));
    }
}
