//! Euler-Bernoulli beams that bend in one plane, and rods in torsion or tension, as finite elements.

use nalgebra::{DMatrix, DVector, SMatrix, SVector};

use crate::{Matrices, Modes, StructureError, error};

/// A piece of a beam.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BeamElement {
    /// Length \[m\].
    pub length: f64,
    /// Mass per length \[kg/m\].
    pub mass_per_length: f64,
    /// Bending stiffness \[N m²\].
    pub EI: f64,
}

/// A rigid body at a node of a beam.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NodeBody {
    /// The node; the root is node 0.
    pub node: usize,
    /// Mass \[kg\].
    pub mass: f64,
    /// Moment of inertia about the node, about the axis that the beam bends about \[kg m²\].
    pub inertia: f64,
}

/// How the end of a beam is held.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// Free to move and to turn.
    Free,
    /// Free to turn only.
    Pinned,
    /// Free to move only.
    Guided,
    /// Neither moves nor turns.
    Clamped,
}

impl End {
    fn fixed(self, node: usize) -> Vec<usize> {
        match self {
            End::Free => vec![],
            End::Pinned => vec![2 * node],
            End::Guided => vec![2 * node + 1],
            End::Clamped => vec![2 * node, 2 * node + 1],
        }
    }
}

/// Deflection of a beam at one point, and its first two derivatives along the beam.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Deflection {
    /// w.
    pub value: f64,
    /// dw/ds.
    pub slope: f64,
    /// d²w/ds².
    pub curvature: f64,
}

/// A straight beam along x that bends in one plane, made of Hermite cubic elements with consistent mass.
///
/// Degree of freedom `2 i` is the deflection w of node `i` \[m\], `2 i + 1` its slope dw/ds \[rad\]. Shear and the rotary
/// inertia of the cross sections are neglected.
#[derive(Clone, Debug, PartialEq)]
pub struct Beam {
    /// From the root to the tip.
    pub elements: Vec<BeamElement>,
    /// Rigid bodies at nodes, such as a hub or a tip mass.
    pub bodies: Vec<NodeBody>,
}

impl Beam {
    /// A beam with the same properties everywhere, divided into elements of the same length.
    pub fn uniform(length: f64, mass_per_length: f64, EI: f64, elements: usize) -> Self {
        let element = BeamElement {
            length: length / elements as f64,
            mass_per_length,
            EI,
        };
        Self {
            elements: vec![element; elements],
            bodies: Vec::new(),
        }
    }

    /// Length \[m\].
    pub fn length(&self) -> f64 {
        self.elements.iter().map(|e| e.length).sum()
    }

    /// How many nodes there are.
    pub fn node_count(&self) -> usize {
        self.elements.len() + 1
    }

    fn check(&self) -> Result<(), StructureError> {
        error::count("number of beam elements", self.elements.len(), 1, 10_000)?;
        for (i, e) in self.elements.iter().enumerate() {
            error::positive(format_args!("length of beam element {i} [m]"), e.length)?;
            error::positive(
                format_args!("mass per length of beam element {i} [kg/m]"),
                e.mass_per_length,
            )?;
            error::positive(format_args!("EI of beam element {i} [N m²]"), e.EI)?;
        }
        for (i, body) in self.bodies.iter().enumerate() {
            error::count(
                format_args!("node of body {i}"),
                body.node,
                0,
                self.elements.len(),
            )?;
            error::not_negative(format_args!("mass of body {i} [kg]"), body.mass)?;
            error::not_negative(format_args!("inertia of body {i} [kg m²]"), body.inertia)?;
        }
        Ok(())
    }

    /// Mass and stiffness with both ends free (Przemieniecki 1968, sections 5.6 and 11.6, without shear).
    ///
    /// # Errors
    /// No element; length, mass or stiffness that is not positive; a body at a node that does not exist.
    pub fn matrices(&self) -> Result<Matrices, StructureError> {
        self.check()?;
        let n = 2 * self.node_count();
        let (mut M, mut K) = (DMatrix::zeros(n, n), DMatrix::zeros(n, n));
        for (i, e) in self.elements.iter().enumerate() {
            let h = e.length;
            #[rustfmt::skip]
            let mass = SMatrix::<f64, 4, 4>::new(
                156.0, 22.0 * h, 54.0, -13.0 * h,
                22.0 * h, 4.0 * h * h, 13.0 * h, -3.0 * h * h,
                54.0, 13.0 * h, 156.0, -22.0 * h,
                -13.0 * h, -3.0 * h * h, -22.0 * h, 4.0 * h * h,
            ) * (e.mass_per_length * h / 420.0);
            #[rustfmt::skip]
            let stiffness = SMatrix::<f64, 4, 4>::new(
                12.0, 6.0 * h, -12.0, 6.0 * h,
                6.0 * h, 4.0 * h * h, -6.0 * h, 2.0 * h * h,
                -12.0, -6.0 * h, 12.0, -6.0 * h,
                6.0 * h, 2.0 * h * h, -6.0 * h, 4.0 * h * h,
            ) * (e.EI / h.powi(3));
            add(&mut M, 2 * i, &mass);
            add(&mut K, 2 * i, &stiffness);
        }
        for body in &self.bodies {
            M[(2 * body.node, 2 * body.node)] += body.mass;
            M[(2 * body.node + 1, 2 * body.node + 1)] += body.inertia;
        }
        Ok(Matrices { M, K })
    }

    /// Stiffness that the tension of a rotation adds, for 1 rad/s: `∫ N w'² ds` with `N(s) = ∫ m (r + ξ) dξ` from `s` to the
    /// tip, where `r` is the distance of the root from the axis. Multiply by Ω². A beam that bends in the plane of rotation
    /// (lag) has Ω² times the part of `M` that belongs to translation (without the bodies' rotary inertia) subtracted in
    /// addition; one that bends along the axis (flap) has not.
    ///
    /// # Errors
    /// As [`Beam::matrices`]; a hub radius that is negative or not finite.
    pub fn centrifugal_stiffness(&self, hub_radius: f64) -> Result<DMatrix<f64>, StructureError> {
        self.check()?;
        error::not_negative("hub radius [m]", hub_radius)?;
        let n = 2 * self.node_count();
        let mut K = DMatrix::zeros(n, n);
        let gauss = crate::quadrature::Gauss::new();
        let mut end = hub_radius + self.length();
        let mut beyond = 0.0; // tension at the end of the element
        for (i, e) in self.elements.iter().enumerate().rev() {
            let at_end = self.bodies.iter().filter(|b| b.node == i + 1);
            beyond += at_end.map(|b| b.mass * end).sum::<f64>();
            let start = end - e.length;
            let mut stiffness = SMatrix::<f64, 4, 4>::zeros();
            for (x, weight) in gauss.points.iter().zip(gauss.weights) {
                let radius = start + x * e.length;
                let tension = beyond + e.mass_per_length * (end * end - radius * radius) / 2.0;
                let slopes = hermite(*x, e.length)[1];
                stiffness += slopes * slopes.transpose() * (weight * e.length * tension);
            }
            add(&mut K, 2 * i, &stiffness);
            beyond += e.mass_per_length * (end * end - start * start) / 2.0;
            end = start;
        }
        Ok(K)
    }

    /// The `count` lowest modes, mass-normalised (kg^-1/2), positive at the tip, or in slope at the tip if the tip is held.
    ///
    /// # Errors
    /// As [`Beam::matrices`]; more modes than free degrees of freedom.
    pub fn modes(&self, root: End, tip: End, count: usize) -> Result<Modes, StructureError> {
        let last = self.node_count() - 1;
        let fixed: Vec<usize> = root.fixed(0).into_iter().chain(tip.fixed(last)).collect();
        let mut modes = self.matrices()?.modes(&fixed, count)?;
        for mut shape in modes.shapes.column_iter_mut() {
            let (tip, slope) = (shape[2 * last], shape[2 * last + 1]);
            let leading = if tip.abs() > 1e-6 * shape.amax() {
                tip
            } else {
                slope
            };
            if leading < 0.0 {
                shape.neg_mut();
            }
        }
        Ok(modes)
    }

    /// Deflection at `s` \[m\] from the root, between 0 and the length, for values of all degrees of freedom.
    pub fn deflection(&self, dofs: &DVector<f64>, s: f64) -> Deflection {
        let Some((i, start, e)) = self.element_at(s) else {
            return Deflection::default();
        };
        let local: SVector<f64, 4> = dofs.fixed_rows::<4>(2 * i).into_owned();
        let [value, slope, curvature] = hermite((s - start) / e.length, e.length);
        Deflection {
            value: value.dot(&local),
            slope: slope.dot(&local),
            curvature: curvature.dot(&local),
        }
    }

    /// Number, start \[m\] and properties of the element at `s` \[m\]: the last one beyond the tip, none if there is none.
    fn element_at(&self, s: f64) -> Option<(usize, f64, &BeamElement)> {
        let (mut found, mut end) = (None, 0.0);
        for (i, e) in self.elements.iter().enumerate() {
            found = Some((i, end, e));
            end += e.length;
            if s <= end {
                break;
            }
        }
        found
    }

    /// Positions of the nodes \[m\] from the root.
    pub(crate) fn nodes(&self) -> Vec<f64> {
        let mut nodes = vec![0.0];
        for e in &self.elements {
            nodes.push(nodes[nodes.len() - 1] + e.length);
        }
        nodes
    }

    /// Mass per length \[kg/m\] at `s` \[m\].
    pub(crate) fn mass_per_length(&self, s: f64) -> f64 {
        self.element_at(s).map_or(0.0, |(.., e)| e.mass_per_length)
    }
}

/// Hermite cubic shape functions for (w0, w0', w1, w1') at `x` in 0..1 of an element of length `h`, and their first and second
/// derivatives along the beam.
fn hermite(x: f64, h: f64) -> [SVector<f64, 4>; 3] {
    let (x2, x3) = (x * x, x * x * x);
    [
        SVector::from([
            1.0 - 3.0 * x2 + 2.0 * x3,
            h * (x - 2.0 * x2 + x3),
            3.0 * x2 - 2.0 * x3,
            h * (x3 - x2),
        ]),
        SVector::from([
            6.0 * (x2 - x) / h,
            1.0 - 4.0 * x + 3.0 * x2,
            6.0 * (x - x2) / h,
            3.0 * x2 - 2.0 * x,
        ]),
        SVector::from([
            (12.0 * x - 6.0) / (h * h),
            (6.0 * x - 4.0) / h,
            (6.0 - 12.0 * x) / (h * h),
            (6.0 * x - 2.0) / h,
        ]),
    ]
}

fn add<const N: usize>(matrix: &mut DMatrix<f64>, at: usize, part: &SMatrix<f64, N, N>) {
    let mut view = matrix.fixed_view_mut::<N, N>(at, at);
    view += part;
}

/// A straight rod in torsion (angles, GJ, moment of inertia per length) or tension (displacements, EA, mass per length),
/// made of quadratic elements with consistent mass.
///
/// Degree of freedom `2 i` belongs to node `i`, `2 i + 1` to the middle of element `i`.
#[derive(Clone, Debug, PartialEq)]
pub struct QuadraticRod {
    /// Length \[m\].
    pub length: f64,
    /// Mass per length \[kg/m\], or polar moment of inertia per length \[kg m\].
    pub mass_per_length: f64,
    /// EA \[N\], or GJ \[N m²\].
    pub stiffness: f64,
    /// How many elements of the same length.
    pub elements: usize,
}

impl QuadraticRod {
    /// Mass and stiffness with both ends free (Zienkiewicz and Taylor 2000, chapter 8: quadratic Lagrange elements).
    ///
    /// # Errors
    /// No element; a length, mass or stiffness that is not positive.
    pub fn matrices(&self) -> Result<Matrices, StructureError> {
        error::count("number of rod elements", self.elements, 1, 10_000)?;
        let h = error::positive("length of the rod [m]", self.length)? / self.elements as f64;
        let mass = error::positive(
            "mass or inertia per length of the rod",
            self.mass_per_length,
        )? * h
            / 30.0;
        let stiffness = error::positive("stiffness of the rod", self.stiffness)? / (3.0 * h);
        let m = SMatrix::<f64, 3, 3>::new(4.0, 2.0, -1.0, 2.0, 16.0, 2.0, -1.0, 2.0, 4.0) * mass;
        let k =
            SMatrix::<f64, 3, 3>::new(7.0, -8.0, 1.0, -8.0, 16.0, -8.0, 1.0, -8.0, 7.0) * stiffness;
        let n = 2 * self.elements + 1;
        let (mut M, mut K) = (DMatrix::zeros(n, n), DMatrix::zeros(n, n));
        for i in 0..self.elements {
            add(&mut M, 2 * i, &m);
            add(&mut K, 2 * i, &k);
        }
        Ok(Matrices { M, K })
    }

    /// The `count` lowest modes with the root fixed, mass-normalised, positive at the tip.
    ///
    /// # Errors
    /// As [`QuadraticRod::matrices`]; more modes than free degrees of freedom.
    pub fn modes(&self, count: usize) -> Result<Modes, StructureError> {
        let mut modes = self.matrices()?.modes(&[0], count)?;
        let tip = modes.shapes.nrows() - 1;
        for mut shape in modes.shapes.column_iter_mut() {
            if shape[tip] < 0.0 {
                shape.neg_mut();
            }
        }
        Ok(modes)
    }

    /// Value and slope at `s` \[m\] from the root, between 0 and the length, for values of all degrees of freedom.
    pub fn twist(&self, dofs: &DVector<f64>, s: f64) -> (f64, f64) {
        let h = self.length / self.elements as f64;
        let i = ((s / h).floor().max(0.0) as usize).min(self.elements - 1);
        let x = s / h - i as f64;
        let local = dofs.fixed_rows::<3>(2 * i);
        let value = SVector::from([
            (1.0 - x) * (1.0 - 2.0 * x),
            4.0 * x * (1.0 - x),
            x * (2.0 * x - 1.0),
        ]);
        let slope = SVector::from([4.0 * x - 3.0, 4.0 - 8.0 * x, 4.0 * x - 1.0]) / h;
        (value.dot(&local), slope.dot(&local))
    }
}
