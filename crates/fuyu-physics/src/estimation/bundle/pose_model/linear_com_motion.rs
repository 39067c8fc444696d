//! Torque-free rotation with linear motion of the centre of mass, for a camera that does not rotate.
//!
//! Six unknowns replace three per frame, so attitudes are more certain: a rotation about an axis across the line of
//! sight can no longer be mistaken for a translation. The residuals show whether the motion is linear (it is not if the
//! orbit is curved or the camera accelerates).

use nalgebra::{SMatrix, SVector, UnitQuaternion, Vector3};

use super::super::free_motion::PARAMETERS;
use super::super::intrinsics::Intrinsics;
use super::free_positions::{COMMON, FreePositions};
use super::{FramePose, PoseModel, TumblingModel};

/// Number of unknowns of the line: position and velocity.
pub const LINE: usize = 6;

/// Number of common unknowns: the rotation's, the line's, and the focal length last.
const ALL: usize = COMMON + LINE;

/// A torque-free rotation about a centre of mass on a straight line. The body's origin is its centre of mass.
#[derive(Debug, Clone)]
pub struct LinearComMotion<'a> {
    rotation: FreePositions<'a>,
    start: Vector3<f64>,
    /// Displacement from the first frame to the last.
    displacement: Vector3<f64>,
}

impl<'a> LinearComMotion<'a> {
    /// The line that fits the positions of `free` best, and the centre of mass in the body axes of `free`. If the
    /// rotation does not determine the centre, a prior places it near the mean of the body's `points`.
    pub fn new(free: FreePositions<'a>, points: &[Vector3<f64>]) -> Option<(Self, Vector3<f64>)> {
        let count = points.len().max(1) as f64;
        let mean = points.iter().sum::<Vector3<f64>>() / count;
        let squares = points.iter().map(|p| (p - mean).norm_squared());
        let size = squares.sum::<f64>() / count;
        // t_i + R_i mean = c + τ_i d - R_i b, linear in c, d and b.
        let mut H = SMatrix::<f64, 9, 9>::zeros();
        let mut g = SVector::<f64, 9>::zeros();
        let mut square = 0.0;
        for (i, t_C) in free.t_C.iter().enumerate() {
            let R = free.pose(i).R_CB.to_rotation_matrix();
            let mut J = SMatrix::<f64, 3, 9>::zeros();
            J.fixed_columns_mut::<3>(0).fill_with_identity();
            J.fixed_columns_mut::<3>(3)
                .fill_diagonal(time_share(&free, i));
            J.fixed_columns_mut::<3>(6).copy_from(&-R.matrix());
            let position = t_C + R * mean;
            H += J.tr_mul(&J);
            g += J.tr_mul(&position);
            square += position.norm_squared();
        }
        let solve = |weight: f64| {
            let mut held = H;
            for k in 6..9 {
                held[(k, k)] += weight;
            }
            Some(held.cholesky()?.solve(&g))
        };
        // The residuals without a prior on the centre determine the weight of the prior.
        let count = free.t_C.len() as f64;
        let least = 1e-9 * count;
        let open = solve(least)?;
        let residuals = (square - open.dot(&g)).max(0.0);
        let variance = residuals / (3.0 * count - 9.0).max(1.0);
        let solved = solve(least.max(variance / size.max(1e-12)))?;
        let linear = Self {
            rotation: free,
            start: solved.fixed_rows::<3>(0).into_owned(),
            displacement: solved.fixed_rows::<3>(3).into_owned(),
        };
        Some((linear, mean + solved.fixed_rows::<3>(6)))
    }

    fn position(&self, i: usize) -> Vector3<f64> {
        self.start + self.displacement * time_share(&self.rotation, i)
    }

    /// The rotation, position at the first frame and displacement to the last.
    pub fn into_parts(self) -> (FreePositions<'a>, Vector3<f64>, Vector3<f64>) {
        (self.rotation, self.start, self.displacement)
    }
}

/// Time of frame `i` as a fraction of the time from the first frame to the last, 0 to 1.
fn time_share(rotation: &FreePositions, i: usize) -> f64 {
    let times = rotation.times();
    let whole = times[times.len() - 1] - times[0];
    (times[i] - times[0]) / whole.max(f64::MIN_POSITIVE)
}

impl TumblingModel for LinearComMotion<'_> {
    fn turn(&self) -> f64 {
        self.rotation.turn()
    }

    fn rate(&self) -> Vector3<f64> {
        self.rotation.rate()
    }

    fn middle_attitude(&self) -> UnitQuaternion<f64> {
        self.rotation.middle_attitude()
    }

    fn with_scaled_depths(&self, factor: f64, centre: &Vector3<f64>) -> Option<Self> {
        let at = |i: usize| self.pose(i).R_CB * centre + self.position(i);
        let (first, last) = (at(0), at(self.rotation.times().len() - 1));
        Some(Self {
            rotation: self.rotation.with_scaled_depths(factor, centre)?,
            start: first,
            displacement: last - first,
        })
    }

    fn nutation(&self) -> f64 {
        self.rotation.nutation()
    }

    fn with_spherical_inertia(&self) -> Option<Self> {
        Some(Self {
            rotation: self.rotation.with_spherical_inertia()?,
            ..self.clone()
        })
    }

    fn in_frames(&self, chosen: &[usize]) -> Self {
        Self {
            rotation: self.rotation.in_frames(chosen),
            ..*self
        }
    }

    fn with_motion_of(&self, other: &Self) -> Self {
        Self {
            rotation: self.rotation.with_motion_of(&other.rotation),
            ..*other
        }
    }
}

impl PoseModel<0, ALL> for LinearComMotion<'_> {
    const CAMERA: usize = 1;

    fn pose(&self, i: usize) -> FramePose {
        FramePose {
            t_C: self.position(i),
            ..self.rotation.pose(i)
        }
    }

    fn pose_by_common(&self, i: usize) -> SMatrix<f64, 6, ALL> {
        let mut pose = SMatrix::<f64, 6, ALL>::zeros();
        let turn = self.rotation.pose_by_common(i);
        let turn = turn.fixed_view::<3, PARAMETERS>(0, 0);
        pose.fixed_view_mut::<3, PARAMETERS>(0, 0).copy_from(&turn);
        let mut start = pose.fixed_view_mut::<3, 3>(3, PARAMETERS);
        start.fill_with_identity();
        let mut displacement = pose.fixed_view_mut::<3, 3>(3, PARAMETERS + 3);
        displacement.fill_diagonal(time_share(&self.rotation, i));
        pose
    }

    fn intrinsics(&self) -> Intrinsics {
        Intrinsics::of_focal(self.rotation.log_focal)
    }

    fn moved(&self, _: &[SVector<f64, 0>], common: &SVector<f64, ALL>) -> Option<Self> {
        let mut of_rotation = SVector::<f64, COMMON>::zeros();
        of_rotation
            .fixed_rows_mut::<PARAMETERS>(0)
            .copy_from(&common.fixed_rows::<PARAMETERS>(0));
        of_rotation[COMMON - 1] = common[ALL - 1];
        let still = vec![SVector::<f64, 3>::zeros(); self.rotation.t_C.len()];
        Some(Self {
            rotation: self.rotation.moved(&still, &of_rotation)?,
            start: self.start + common.fixed_rows::<3>(PARAMETERS),
            displacement: self.displacement + common.fixed_rows::<3>(PARAMETERS + 3),
        })
    }

    fn prior(&self) -> (SVector<f64, ALL>, SVector<f64, ALL>) {
        let (own, off) = self.rotation.prior();
        let (mut weights, mut distance) = (SVector::zeros(), SVector::zeros());
        for k in 0..PARAMETERS {
            (weights[k], distance[k]) = (own[k], off[k]);
        }
        (weights[ALL - 1], distance[ALL - 1]) = (own[COMMON - 1], off[COMMON - 1]);
        (weights, distance)
    }
}
