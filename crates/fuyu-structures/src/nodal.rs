//! Structures as nodes with matrices, from a truss or from another finite-element program.

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

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
        let last = self.positions.len().saturating_sub(1);
        for (i, (node, _)) in self.dofs.iter().enumerate() {
            error::count(&format!("node of degree of freedom {i}"), *node, 0, last)?;
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

    /// The field that is `value` of the node's position in one direction and zero in the others.
    fn field(&self, axis: Axis, value: impl Fn(&Vector3<f64>) -> f64) -> DVector<f64> {
        let entry = |(node, a): &(usize, Axis)| {
            if *a == axis {
                value(&self.positions[*node])
            } else {
                0.0
            }
        };
        DVector::from_iterator(self.dofs.len(), self.dofs.iter().map(entry))
    }

    /// A direction in which all nodes move.
    fn complete_axis(&self) -> Result<Axis, StructureError> {
        let complete =
            |axis: &Axis| (0..self.positions.len()).all(|node| self.dofs.contains(&(node, *axis)));
        [Axis::X, Axis::Y, Axis::Z]
            .into_iter()
            .find(complete)
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
        let axis = self.complete_axis()?;
        let modes = self.matrices.modes(fixed, count)?;
        let M = &self.matrices.M;
        let axes = [Axis::X, Axis::Y, Axis::Z];
        let ones = self.field(axis, |_| 1.0);
        let moments: Vec<DVector<f64>> = (0..3).map(|i| self.field(axis, |X| X[i])).collect();
        let mass = (M * &ones).dot(&ones);
        let first = Vector3::from_fn(|i, _| (M * &ones).dot(&moments[i]));
        let second = Matrix3::from_fn(|i, j| (M * &moments[i]).dot(&moments[j]));
        let inertia = Matrix3::identity() * second.trace() - second;
        let mut invariants = Invariants::rigid(mass, first, inertia, count, false);
        for k in 0..count {
            let shape = modes.shapes.column(k);
            let weighted = M * shape;
            invariants.set_first(
                1 + k,
                Vector3::from_fn(|j, _| self.field(axes[j], |_| 1.0).dot(&weighted)),
            );
            let moment = Matrix3::from_fn(|i, j| self.field(axes[j], |X| X[i]).dot(&weighted));
            invariants.set_second(0, 1 + k, moment);
            for l in k..count {
                let product = Matrix3::from_fn(|i, j| {
                    let part = |column: usize, axis: Axis| self.part(&modes.shapes, column, axis);
                    part(k, axes[i]).dot(&(self.scalar_mass(axes[i], axes[j]) * part(l, axes[j])))
                });
                invariants.set_second(1 + k, 1 + l, product);
            }
        }
        let frequencies: Vec<f64> = modes.frequencies.iter().copied().collect();
        let mut appendage =
            Appendage::with_frequencies(name, invariants, &frequencies, &vec![damping; count])?;
        for (label, node) in outputs {
            error::count(
                &format!("node of output point {label}"),
                *node,
                0,
                self.positions.len().saturating_sub(1),
            )?;
            let displacement = |k: usize| {
                Vector3::from_fn(|j, _| {
                    let place = self.dofs.iter().position(|d| *d == (*node, axes[j]));
                    place.map_or(0.0, |row| modes.shapes[(row, k)])
                })
            };
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

    /// Displacements of all nodes along one axis, zero where a node lacks it.
    fn part(&self, shapes: &DMatrix<f64>, column: usize, axis: Axis) -> DVector<f64> {
        let mut part = DVector::zeros(self.positions.len());
        for (row, (node, a)) in self.dofs.iter().enumerate() {
            if *a == axis {
                part[*node] = shapes[(row, column)];
            }
        }
        part
    }

    /// Mass between nodes for products of two directions. The mass matrix has it for equal directions; it is the same for
    /// different ones, for which that of an axis that all nodes have is used.
    fn scalar_mass(&self, a: Axis, b: Axis) -> DMatrix<f64> {
        let complete = self.complete_axis().unwrap_or(a);
        let axis = if a == b && self.dofs.iter().any(|d| d.1 == a) {
            a
        } else {
            complete
        };
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
