//! Plane trusses of pin-jointed rods.

use nalgebra::{DMatrix, Vector2, Vector3};

use crate::{Axis, Matrices, NodalModel, StructureError, error};

/// A rod between two nodes of a truss.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rod {
    /// The nodes at its ends, from 0.
    pub nodes: [usize; 2],
    /// Young's modulus times cross section \[N\].
    pub EA: f64,
    /// Mass per length \[kg/m\].
    pub mass_per_length: f64,
}

/// A plane truss. Degree of freedom `2 i` is the displacement of node `i` along x, `2 i + 1` that along y \[m\].
#[derive(Clone, Debug, PartialEq)]
pub struct Truss {
    /// Positions of the nodes \[m\].
    pub nodes: Vec<Vector2<f64>>,
    /// The rods.
    pub rods: Vec<Rod>,
}

impl Truss {
    /// Mass and stiffness. The displacement varies linearly along a rod, so its consistent mass is `ρAL/6 [2 1; 1 2]` in both
    /// directions (Przemieniecki 1968, section 11.4).
    ///
    /// # Errors
    /// A rod with a node that does not exist, of no length, or with negative stiffness or mass.
    pub fn matrices(&self) -> Result<Matrices, StructureError> {
        let n = 2 * self.nodes.len();
        let (mut M, mut K) = (DMatrix::zeros(n, n), DMatrix::zeros(n, n));
        for (number, rod) in self.rods.iter().enumerate() {
            for node in rod.nodes {
                let field = format_args!("node of rod {number}");
                error::index(field, node, self.nodes.len())?;
            }
            let [i, j] = rod.nodes;
            let along = self.nodes[j] - self.nodes[i];
            let length = error::positive(format_args!("length of rod {number} [m]"), along.norm())?;
            let EA = error::not_negative(format_args!("EA of rod {number} [N]"), rod.EA)?;
            let mass = length
                * error::not_negative(
                    format_args!("mass per length of rod {number} [kg/m]"),
                    rod.mass_per_length,
                )?;
            let direction = along / length;
            let stiffness = direction * direction.transpose() * (EA / length);
            for (a, b, sign, share) in [
                (i, i, 1.0, 2.0),
                (j, j, 1.0, 2.0),
                (i, j, -1.0, 1.0),
                (j, i, -1.0, 1.0),
            ] {
                for row in 0..2 {
                    M[(2 * a + row, 2 * b + row)] += share * mass / 6.0;
                    for column in 0..2 {
                        K[(2 * a + row, 2 * b + column)] += sign * stiffness[(row, column)];
                    }
                }
            }
        }
        Ok(Matrices { M, K })
    }

    /// The truss in the x-y plane of the attachment frame, to be made an [`Appendage`](crate::Appendage).
    ///
    /// # Errors
    /// As [`Truss::matrices`].
    pub fn nodal_model(&self) -> Result<NodalModel, StructureError> {
        Ok(NodalModel {
            matrices: self.matrices()?,
            positions: self
                .nodes
                .iter()
                .map(|p| Vector3::new(p.x, p.y, 0.0))
                .collect(),
            dofs: (0..self.nodes.len())
                .flat_map(|i| [(i, Axis::X), (i, Axis::Y)])
                .collect(),
        })
    }
}
