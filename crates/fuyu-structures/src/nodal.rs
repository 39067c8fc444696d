//! Structures as nodes with matrices, from a truss or from another finite-element program.

use nalgebra::{DMatrix, Matrix3, Vector3};

use crate::{Appendage, Invariants, Matrices, OutputPoint, StructureError, error};

/// A direction in which a node moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axis {
    /// Along x.
    X,
    /// Along y.
    Y,
    /// Along z.
    Z,
}

const AXES: [Axis; 3] = [Axis::X, Axis::Y, Axis::Z];

/// A structure whose degrees of freedom are displacements of nodes along axes of the attachment frame.
///
/// Rotations of nodes have to be condensed first ([`Matrices::condensed`]). A node may lack a direction; it does not move that way
/// then. At least one direction has to exist at all nodes, because mass and inertia are computed with it.
#[derive(Clone, Debug, PartialEq)]
pub struct NodalModel {
    /// Mass and stiffness, lumped or consistent.
    pub matrices: Matrices,
    /// Positions of the nodes \[m\], in the attachment frame.
    pub positions: Vec<Vector3<f64>>,
    /// Node and direction of each degree of freedom.
    pub dofs: Vec<(usize, Axis)>,
}

impl NodalModel {
    fn check(&self) -> Result<(), StructureError> {
        error::size(
            "degrees of freedom",
            (self.dofs.len(), 1),
            (self.matrices.len(), 1),
        )?;
        for (i, (node, _)) in self.dofs.iter().enumerate() {
            let field = format_args!("node of degree of freedom {i}");
            error::index(field, *node, self.positions.len())?;
        }
        let M = &self.matrices.M;
        let largest = M.amax();
        for (i, j) in (0..M.nrows()).flat_map(|i| (0..i).map(move |j| (i, j))) {
            if self.dofs[i].1 != self.dofs[j].1 && M[(i, j)].abs() > 1e-9 * largest {
                return Err(StructureError::Value {
                    field: format!(
                        "mass matrix M, entry ({i}, {j}), which couples two directions,"
                    ),
                    value: M[(i, j)],
                    requirement: "zero; use the axes of the elements, or lumped masses".to_owned(),
                });
            }
        }
        Ok(())
    }

    /// Four fields along one axis, one a column: 1, and the node's x, y and z. Zero in the other directions.
    fn fields(&self, axis: Axis) -> DMatrix<f64> {
        DMatrix::from_fn(self.dofs.len(), 4, |row, column| {
            let (node, a) = self.dofs[row];
            match column {
                _ if a != axis => 0.0,
                0 => 1.0,
                _ => self.positions[node][column - 1],
            }
        })
    }

    /// Place in [`AXES`] of a direction in which all nodes move.
    fn complete_axis(&self) -> Result<usize, StructureError> {
        let complete =
            |axis: &Axis| (0..self.positions.len()).all(|node| self.dofs.contains(&(node, *axis)));
        AXES.iter()
            .position(complete)
            .ok_or_else(|| StructureError::Size {
                field: "degrees of freedom".to_owned(),
                found: "no direction that all nodes have".to_owned(),
                expected:
                    "at least one, fixed nodes included; the structure's mass is computed with it"
                        .to_owned(),
            })
    }

    /// The structure with its `count` lowest constrained modes. The degrees of freedom in `fixed` are attached to the rigid body,
    /// `damping` is the ratio of every mode, `outputs` are nodes of interest with their names. Modes are mass-normalised with the sign of
    /// [`Modes`](crate::Modes).
    ///
    /// # Errors
    /// Sizes that differ, a mass matrix that couples directions, `fixed` too small to hold the structure, too many modes.
    pub fn appendage(
        &self,
        name: &str,
        fixed: &[usize],
        count: usize,
        damping: f64,
        outputs: &[(&str, usize)],
    ) -> Result<Appendage, StructureError> {
        self.check()?;
        let complete = self.complete_axis()?;
        let modes = self.matrices.modes(fixed, count)?;
        let fields = AXES.map(|axis| self.fields(axis));
        let parts = AXES.map(|axis| self.parts(&modes.shapes, axis));
        let masses = AXES.map(|axis| self.scalar_mass(axis));
        let body = fields[complete].transpose() * &self.matrices.M * &fields[complete];
        let second: Matrix3<f64> = body.fixed_view::<3, 3>(1, 1).into_owned();
        let inertia = Matrix3::identity() * second.trace() - second;
        let first = body.fixed_view::<3, 1>(1, 0).into_owned();
        let mut invariants = Invariants::rigid(body[(0, 0)], first, inertia, count, false);
        let weighted = &self.matrices.M * &modes.shapes;
        let moments = fields.map(|field| field.transpose() * &weighted);
        // The mass between two nodes is the same in all directions; products of different ones take it from the complete axis.
        let products: [[DMatrix<f64>; 3]; 3] = std::array::from_fn(|i| {
            std::array::from_fn(|j| {
                let mass = &masses[if i == j { i } else { complete }];
                parts[i].transpose() * (mass * &parts[j])
            })
        });
        for k in 0..count {
            invariants.set_first(1 + k, Vector3::from_fn(|j, _| moments[j][(0, k)]));
            let moment = Matrix3::from_fn(|i, j| moments[j][(1 + i, k)]);
            invariants.set_second(0, 1 + k, moment);
            for l in k..count {
                let product = Matrix3::from_fn(|i, j| products[i][j][(k, l)]);
                invariants.set_second(1 + k, 1 + l, product);
            }
        }
        let frequencies: Vec<f64> = modes.frequencies.iter().copied().collect();
        let mut appendage =
            Appendage::with_frequencies(name, invariants, &frequencies, &vec![damping; count])?;
        for (label, node) in outputs {
            let field = format_args!("node of output point {label}");
            error::index(field, *node, self.positions.len())?;
            let displacement = |k: usize| Vector3::from_fn(|j, _| parts[j][(*node, k)]);
            appendage.outputs.push(OutputPoint {
                name: (*label).to_owned(),
                position: self.positions[*node],
                translation: (0..count).map(displacement).collect(),
                rotation: vec![Vector3::zeros(); count],
                chi: Vec::new(),
            });
        }
        Ok(appendage)
    }

    /// Displacements of all nodes along one axis, one column for each mode; zero where a node lacks the axis.
    fn parts(&self, shapes: &DMatrix<f64>, axis: Axis) -> DMatrix<f64> {
        let mut parts = DMatrix::zeros(self.positions.len(), shapes.ncols());
        for (row, (node, a)) in self.dofs.iter().enumerate() {
            if *a == axis {
                parts.set_row(*node, &shapes.row(row));
            }
        }
        parts
    }

    /// Mass between nodes along one axis.
    fn scalar_mass(&self, axis: Axis) -> DMatrix<f64> {
        let n = self.positions.len();
        let mut mass = DMatrix::zeros(n, n);
        for (i, (node_i, axis_i)) in self.dofs.iter().enumerate() {
            for (j, (node_j, axis_j)) in self.dofs.iter().enumerate() {
                if *axis_i == axis && *axis_j == axis {
                    mass[(*node_i, *node_j)] = self.matrices.M[(i, j)];
                }
            }
        }
        mass
    }
}
