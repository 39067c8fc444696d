//! Outlines of deformable bodies, for pictures.

use nalgebra::Vector3;

use crate::OutputPoint;

/// Points of a deformable body that show its shape, first order: the line of a beam from root to tip, or the edge of a
/// panel, on the side of +y from root to tip and back on the other side.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Outline {
    /// In order along the line or edge.
    pub points: Vec<OutputPoint>,
    /// Whether they surround a surface; point `i` then lies across from the `i`-th last.
    pub is_surface: bool,
}

impl Outline {
    /// A line through points.
    pub fn of_points(points: Vec<OutputPoint>) -> Self {
        Self {
            points,
            is_surface: false,
        }
    }

    /// Positions of the points at modal coordinates `mu`, in the attachment frame \[m\].
    pub fn deformed(&self, mu: &[f64]) -> Vec<Vector3<f64>> {
        let at = |point: &OutputPoint| point.position + point.displacement(mu);
        self.points.iter().map(at).collect()
    }
}
