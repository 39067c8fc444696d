//! Operability: how much a free base distorts an operator's commands; the indices of Masutani 1995 section 8.4.

use nalgebra::{DVector, Matrix2, Matrix2xX, Matrix6xX, Vector2};
use std::f64::consts::PI;

use crate::{
    dynamics::Workspace,
    model::{Frame, Model},
};

/// The indices at one posture of a planar arm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Operability {
    /// `I₁`, eq. (8.8): largest `|V_E - v_c|` over all commands `v_c` of length one that are resolved with the
    /// fixed-base Jacobian. Infinite if that Jacobian is singular.
    pub distortion: f64,
    /// `I₂`, eq. (8.9): largest angle between `V_E` and `v_c` \[rad\], at most π.
    pub misdirection: f64,
    /// `√det Ĵ Ĵᵀ`, eq. (8.10) \[m²\].
    pub manipulability: f64,
}

impl Operability {
    /// The indices from generalized and fixed-base Jacobian of the tip's velocity in the plane, eqs. (8.5), (8.6).
    /// Redundant joints are resolved with the least norm of their rates.
    pub fn of(generalized: &Matrix2xX<f64>, fixed_base: &Matrix2xX<f64>) -> Self {
        let manipulability = (generalized * generalized.transpose())
            .determinant()
            .max(0.0)
            .sqrt();
        let square: Matrix2<f64> = fixed_base * fixed_base.transpose();
        // V_E = A v_c, eq. (8.7).
        let inverse = square.try_inverse();
        let Some(A) = inverse.map(|inverse| generalized * fixed_base.transpose() * inverse) else {
            return Self {
                distortion: f64::INFINITY,
                misdirection: PI,
                manipulability,
            };
        };
        Self {
            distortion: largest_singular_value(&(A - Matrix2::identity())),
            misdirection: largest_turn(&A),
            manipulability,
        }
    }
}

fn largest_singular_value(A: &Matrix2<f64>) -> f64 {
    let (turn, stretch) = turn_and_stretch(A);
    turn.norm() + stretch
}

/// Decomposes a 2 × 2 matrix: it maps the unit vector at angle θ to `turn + stretch (cos α, sin α)` in axes along that
/// vector, where α makes full turns with θ.
fn turn_and_stretch(A: &Matrix2<f64>) -> (Vector2<f64>, f64) {
    let turn = Vector2::new(A[(0, 0)] + A[(1, 1)], A[(1, 0)] - A[(0, 1)]) / 2.0;
    let stretch = (A[(0, 0)] - A[(1, 1)]).hypot(A[(0, 1)] + A[(1, 0)]) / 2.0;
    (turn, stretch)
}

fn largest_turn(A: &Matrix2<f64>) -> f64 {
    let (turn, stretch) = turn_and_stretch(A);
    let length = turn.norm();
    if length <= stretch {
        // The circle contains the origin: some command moves the tip backwards.
        return PI;
    }
    (turn.y.atan2(turn.x).abs() + (stretch / length).asin()).min(PI)
}

/// Why a map cannot be computed.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum MapError {
    /// The position of the tip does not determine the posture.
    #[error("the robot has {0} joints; a map over the tip's plane needs two")]
    Joints(usize),
}

/// The indices at a posture, and the position of the tip there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapPoint {
    /// Joint positions \[rad or m\].
    pub q: [f64; 2],
    /// The tip in the base frame, its two coordinates in the plane \[m\].
    pub tip: Vector2<f64>,
    /// Area that the point represents in the plane \[m²\].
    pub area: f64,
    /// The indices.
    pub operability: Operability,
}

/// The indices over the postures of a planar arm.
#[derive(Debug, Clone, PartialEq)]
pub struct OperabilityMap {
    /// Mid-points of the cells, second joint within first.
    pub points: Vec<MapPoint>,
}

impl OperabilityMap {
    /// The map over `cells` × `cells` postures of a robot with two joints, whose positions range from `from` to `to`.
    /// `tip` moves in the plane of the base frame's axes `plane` (0, 1, 2 for x, y, z).
    ///
    /// # Errors
    /// [`MapError`] unless the robot has two joints.
    ///
    /// # Panics
    /// If `plane` contains other axes than 0, 1, 2.
    pub fn over(
        model: &Model,
        tip: &Frame,
        plane: [usize; 2],
        from: [f64; 2],
        to: [f64; 2],
        cells: usize,
    ) -> Result<Self, MapError> {
        let mut map = Mapping::new(model, tip, plane)?;
        let size = [0, 1].map(|j| (to[j] - from[j]) / cells as f64);
        let at = |j: usize, i: usize| from[j] + (i as f64 + 0.5) * size[j];
        let mut points = Vec::with_capacity(cells * cells);
        for first in 0..cells {
            for second in 0..cells {
                let mut point = map.at([at(0, first), at(1, second)]);
                point.area *= (size[0] * size[1]).abs();
                points.push(point);
            }
        }
        Ok(Self { points })
    }

    /// Fraction of the area selected by `among` in which `holds` is true; zero if nothing is selected.
    pub fn share(
        &self,
        among: impl Fn(&MapPoint) -> bool,
        holds: impl Fn(&Operability) -> bool,
    ) -> f64 {
        let (mut area, mut held) = (0.0, 0.0);
        for point in self.points.iter().filter(|p| among(p)) {
            area += point.area;
            held += f64::from(u8::from(holds(&point.operability))) * point.area;
        }
        if area > 0.0 { held / area } else { 0.0 }
    }

    /// The point with the least value of `figure`.
    pub fn least(&self, figure: impl Fn(&MapPoint) -> f64) -> Option<&MapPoint> {
        let by = |a: &&MapPoint, b: &&MapPoint| figure(a).total_cmp(&figure(b));
        self.points.iter().min_by(by)
    }
}

/// Computes the indices at postures of a robot with two joints.
#[derive(Debug, Clone)]
pub struct Mapping<'a> {
    tip: &'a Frame,
    plane: [usize; 2],
    workspace: Workspace,
    q: DVector<f64>,
    matrix: Matrix6xX<f64>,
}

impl<'a> Mapping<'a> {
    /// A mapping for `tip`, which moves in the plane of the base frame's axes `plane`.
    ///
    /// # Errors
    /// [`MapError`] unless the robot has two joints.
    pub fn new(model: &Model, tip: &'a Frame, plane: [usize; 2]) -> Result<Self, MapError> {
        let n = model.dof();
        if n != 2 {
            return Err(MapError::Joints(n));
        }
        Ok(Self {
            tip,
            plane,
            workspace: Workspace::new(model),
            q: DVector::zeros(n),
            matrix: Matrix6xX::zeros(n),
        })
    }

    /// The indices at joint positions `q`; the point's area is the area per unit of both joints.
    ///
    /// # Panics
    /// If the plane's axes are not among 0, 1, 2.
    pub fn at(&mut self, q: [f64; 2]) -> MapPoint {
        self.q.copy_from_slice(&q);
        self.workspace.set_positions(&self.q);
        let rows = |matrix: &Matrix6xX<f64>| -> Matrix2xX<f64> {
            Matrix2xX::from_fn(2, |i, j| matrix[(self.plane[i], j)])
        };
        self.workspace
            .fixed_base_jacobian(self.tip, &mut self.matrix);
        let fixed_base = rows(&self.matrix);
        self.workspace
            .generalized_jacobian(self.tip, &mut self.matrix);
        let generalized = rows(&self.matrix);
        let p_BE = self.workspace.X_BF(self.tip).translation.vector;
        MapPoint {
            q,
            tip: Vector2::new(p_BE[self.plane[0]], p_BE[self.plane[1]]),
            area: fixed_base.fixed_columns::<2>(0).determinant().abs(),
            operability: Operability::of(&generalized, &fixed_base),
        }
    }
}
