//! Torque-free rotation as a model to fit: attitudes at given times, and their derivatives by its parameters.
//!
//! The parameters are the constants of the motion: the inertia matrix `I` in body axes (its scale is not observable; it
//! is normalised to trace 3) and the angular momentum `L` in inertial axes, on the same scale. The shape of an inertia is
//! its traceless part, five numbers. With the attitude `R` at one time, `R' = R [w×]`, `w = I⁻¹ Rᵀ L`. No principal axes
//! are chosen, so nothing becomes singular where two or three of the moments are equal.

use nalgebra::{Matrix3, SMatrix, SVector, UnitQuaternion, Vector3};
use pulp::Arch;

use super::sensitivity_propagation::{PropagatedAttitude, Propagation};

/// Number of parameters: five of the inertia's shape, three of the momentum.
pub const PARAMETERS: usize = 8;

/// A rotation vector's derivative by the eight parameters.
pub type Sensitivity = SMatrix<f64, 3, PARAMETERS>;

/// Standard deviation of the prior on each component of the inertia's shape; zero is a sphere. The norm of all five is
/// 0.9 for a thin plate and 1.2 for a thin rod. Boxes whose sides are anything from a fiftieth of the longest to all of
/// it have 0.30 (root mean square of a component), from a third 0.19.
pub const SHAPE_SPREAD: f64 = 0.35;

/// Largest rotation in one integration step \[rad\]. The error of the order-8 method is then below 1e-10 per step.
/// Motions near the separatrix need this, because they amplify errors a million times.
const LARGEST_TURN: f64 = 0.55;

/// Smallest accepted principal moment, for trace 3. The smallest moment of a rod ten times as long as thick is larger.
const SMALLEST_MOMENT: f64 = 5e-3;

/// Largest accepted principal moment. No moment of a body exceeds the sum of the others, 1.5; noise may push a thin
/// plate beyond that.
const LARGEST_MOMENT: f64 = 1.6;

/// A torque-free rotation: its constants, and the attitude at a reference time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FreeMotion {
    /// Inertia matrix in body axes, scaled to trace 3.
    pub inertia: Matrix3<f64>,
    /// Angular momentum in inertial axes, on the scale of `inertia` \[rad/s\].
    pub momentum: Vector3<f64>,
    /// Time of the attitude \[s\].
    pub time: f64,
    /// Body axes in inertial axes at `time`.
    pub R_WB: UnitQuaternion<f64>,
}

/// Orthonormal basis of the symmetric matrices with zero trace.
pub fn shape_basis() -> [Matrix3<f64>; 5] {
    let (h, s) = (0.5f64.sqrt(), (1.0f64 / 6.0).sqrt());
    let pair = |i: usize, j: usize| {
        let mut m = Matrix3::zeros();
        m[(i, j)] = h;
        m[(j, i)] = h;
        m
    };
    [
        Matrix3::from_diagonal(&Vector3::new(h, -h, 0.0)),
        Matrix3::from_diagonal(&Vector3::new(s, s, -2.0 * s)),
        pair(0, 1),
        pair(0, 2),
        pair(1, 2),
    ]
}

/// Components of an inertia in [`shape_basis`].
pub fn shape_of(inertia: &Matrix3<f64>) -> SVector<f64, 5> {
    let basis = shape_basis();
    SVector::from_fn(|i, _| inertia.dot(&basis[i]))
}

/// `E_k v` for every matrix `E_k` of [`shape_basis`], as columns.
pub fn shape_times(v: &Vector3<f64>) -> SMatrix<f64, 3, 5> {
    let (h, s) = (0.5f64.sqrt(), (1.0f64 / 6.0).sqrt());
    #[rustfmt::skip]
    let m = SMatrix::<f64, 3, 5>::new(
        h * v.x,   s * v.x,        h * v.y, h * v.z, 0.0,
        -h * v.y,  s * v.y,        h * v.x, 0.0,     h * v.z,
        0.0,       -2.0 * s * v.z, 0.0,     h * v.x, h * v.y,
    );
    m
}

impl FreeMotion {
    /// The motion with inertia `1 + Σ shape_k E_k`. `None` if no body has such an inertia.
    pub fn new(
        shape: &SVector<f64, 5>,
        momentum: Vector3<f64>,
        time: f64,
        R_WB: UnitQuaternion<f64>,
    ) -> Option<Self> {
        let mut inertia = Matrix3::identity();
        for (e, d) in shape_basis().iter().zip(shape.iter()) {
            inertia += e * *d;
        }
        let moments = inertia.symmetric_eigenvalues();
        let possible = moments.min() > SMALLEST_MOMENT && moments.max() < LARGEST_MOMENT;
        let finite = momentum.iter().all(|x| x.is_finite());
        (possible && finite).then_some(Self {
            inertia,
            momentum,
            time,
            R_WB,
        })
    }

    /// The motion with its eight parameters changed by `step`; attitude and time stay the same. `None` as in
    /// [`FreeMotion::new`], or if the momentum would change by more than half, where no linearisation is valid.
    pub fn moved(&self, step: &SVector<f64, PARAMETERS>) -> Option<Self> {
        let shape = shape_of(&self.inertia) + step.fixed_rows::<5>(0);
        let change = step.fixed_rows::<3>(5).into_owned();
        if change.norm() > 0.5 * self.momentum.norm() {
            return None;
        }
        let momentum = self.momentum + change;
        Self::new(&shape, momentum, self.time, self.R_WB)
    }

    /// Angular velocity in body axes at attitude `R_WB` \[rad/s\].
    pub fn w_WB_B(&self, R_WB: &UnitQuaternion<f64>) -> Vector3<f64> {
        let h = R_WB.inverse_transform_vector(&self.momentum);
        self.inertia.cholesky().map_or(h, |c| c.solve(&h))
    }

    /// Derivative of the inertia's shape by a rotation of the body, in the axes before the rotation.
    pub fn shape_by_turn(&self) -> SMatrix<f64, 5, 3> {
        let basis = shape_basis();
        SMatrix::from_fn(|k, j| {
            let turn = Vector3::ith(j, 1.0).cross_matrix();
            basis[k].dot(&(turn * self.inertia - self.inertia * turn))
        })
    }

    /// Derivative of the rotation at a time with sensitivity `S` by a rotation of the body at the reference time, both
    /// in body axes. A body that starts rotated by θ moves like a body with its inertia rotated by θ, then rotated.
    pub fn turn_by_turn(&self, S: &Sensitivity) -> Matrix3<f64> {
        Matrix3::identity() + S.fixed_columns::<5>(0) * self.shape_by_turn()
    }

    /// Attitudes at `times` (ascending).
    pub fn attitudes(&self, times: &[f64]) -> Vec<UnitQuaternion<f64>> {
        let mut out = Vec::with_capacity(times.len());
        self.propagate::<false>(times, |propagated| out.push(propagated.R));
        out
    }

    /// Attitudes at `times` (ascending), each with its sensitivity `S` to the parameters: `R exp([S δ]×)` is the
    /// attitude of the motion changed by `δ`. The attitude at [`FreeMotion::time`] does not depend on the parameters.
    pub fn attitudes_and_sensitivities(
        &self,
        times: &[f64],
    ) -> Vec<(UnitQuaternion<f64>, Sensitivity)> {
        let mut out = Vec::with_capacity(times.len());
        self.propagate::<true>(times, |propagated| {
            out.push((propagated.R, propagated.sensitivity()))
        });
        out
    }

    /// Integrates from the reference time backwards and forwards through `times`; visits them in ascending order.
    fn propagate<const SENSITIVE: bool>(
        &self,
        times: &[f64],
        mut visit: impl FnMut(&PropagatedAttitude),
    ) {
        let Some(inverse) = self.inertia.try_inverse() else {
            return;
        };
        // Upper bound of the angular rate: all energy about the axis of the smallest moment.
        let h = self.R_WB.inverse_transform_vector(&self.momentum);
        let fastest = (h.dot(&(inverse * h)) * inverse.symmetric_eigenvalues().max()).sqrt();
        let split = times.partition_point(|t| *t < self.time);
        let begin = PropagatedAttitude::new(self.R_WB);
        let arch = Arch::new();
        let advance = |propagated: &mut PropagatedAttitude, span: f64| {
            let steps = (fastest * span.abs() / LARGEST_TURN).ceil().max(1.0);
            if span == 0.0 || !steps.is_finite() {
                return;
            }
            let advance = Propagation::<SENSITIVE> {
                inverse: &inverse,
                momentum: &self.momentum,
                propagated,
                h: span / steps,
                steps: steps as usize,
            };
            advance.run(arch);
        };
        let mut now = (self.time, begin);
        let mut before = Vec::with_capacity(split);
        for &t in times[..split].iter().rev() {
            advance(&mut now.1, t - now.0);
            now.0 = t;
            before.push(now.1);
        }
        before.iter().rev().for_each(&mut visit);
        now = (self.time, begin);
        for &t in &times[split..] {
            advance(&mut now.1, t - now.0);
            now.0 = t;
            visit(&now.1);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn motion() -> FreeMotion {
        let shape = SVector::<f64, 5>::new(0.3, -0.2, 0.1, 0.05, -0.15);
        let R = UnitQuaternion::from_scaled_axis(Vector3::new(0.4, -0.7, 1.1));
        FreeMotion::new(&shape, Vector3::new(0.3, -0.5, 0.6), 10.0, R).unwrap()
    }

    #[test]
    fn energy_is_conserved_over_six_minutes() {
        // Momentum is conserved by construction, energy is not: a wrong sign in w changes it at once.
        let m = motion();
        let energy = |R: &UnitQuaternion<f64>| {
            let w = m.w_WB_B(R);
            w.dot(&(m.inertia * w))
        };
        let times: Vec<f64> = (0..600).map(|i| 0.6 * f64::from(i)).collect();
        let attitudes = m.attitudes(&times);
        for R in &attitudes {
            assert!((energy(R) / energy(&m.R_WB) - 1.0).abs() < 1e-9);
        }
        // Body rates obey Euler's equation: I w' = (I w) × w, by a difference over 2 ms.
        let near = m.attitudes(&[19.999, 20.0, 20.001]);
        let w = |i: usize| m.w_WB_B(&near[i]);
        let rate = (w(2) - w(0)) / 0.002;
        let torque = m.inertia * rate - (m.inertia * w(1)).cross(&w(1));
        assert!(torque.norm() < 1e-6, "{torque}");
        let turn = (near[0].inverse() * near[2]).scaled_axis() / 0.002;
        assert!((turn - w(1)).norm() < 1e-6);
    }

    #[test]
    fn sensitivities_match_finite_differences() {
        let m = motion();
        let times = [-25.0, -0.3, 10.0, 12.0, 80.0];
        let analytic = m.attitudes_and_sensitivities(&times);
        for k in 0..PARAMETERS {
            let h = 1e-6;
            let mut step = SVector::<f64, PARAMETERS>::zeros();
            step[k] = h;
            let (up, down) = (m.moved(&step).unwrap(), m.moved(&-step).unwrap());
            let (up, down) = (up.attitudes(&times), down.attitudes(&times));
            for (i, (R, S)) in analytic.iter().enumerate() {
                let numeric = ((R.inverse() * up[i]).scaled_axis()
                    - (R.inverse() * down[i]).scaled_axis())
                    / (2.0 * h);
                let scale = 1.0 + numeric.norm();
                assert!(
                    (S.column(k) - numeric).norm() < 1e-6 * scale,
                    "{k} {i}: {} {numeric}",
                    S.column(k)
                );
            }
        }
    }

    #[test]
    fn an_inertia_that_is_not_positive_is_refused() {
        let shape = SVector::<f64, 5>::new(0.0, 1.3, 0.0, 0.0, 0.0);
        assert!(FreeMotion::new(&shape, Vector3::z(), 0.0, UnitQuaternion::identity()).is_none());
    }
}
