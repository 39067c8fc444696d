//! Propagation of a torque-free rotation by the order-8 method: attitude, and optionally its sensitivities to the
//! parameters.

use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};
use pulp::{Arch, Simd, WithSimd};

use super::free_motion::{PARAMETERS, Sensitivity};
use crate::dynamics::Tableau;

const STAGES: usize = 12;

/// Sensitivities by rows, which fill SIMD registers.
const ROWS: usize = 3 * PARAMETERS;

/// Momentum in body axes (3), rotation since the beginning of the step as a quaternion (vector, then scalar), and one
/// unused zero.
type AttitudeState = [f64; 8];

/// The attitude at a time, with its sensitivities.
#[derive(Clone, Copy)]
pub struct PropagatedAttitude {
    /// Body axes in inertial axes.
    pub R: UnitQuaternion<f64>,
    rows: [f64; ROWS],
}

impl PropagatedAttitude {
    /// An attitude that does not depend on the parameters.
    pub fn new(R: UnitQuaternion<f64>) -> Self {
        let rows = [0.0; ROWS];
        Self { R, rows }
    }

    /// Sensitivity of the attitude to the parameters.
    pub fn sensitivity(&self) -> Sensitivity {
        Sensitivity::from_row_slice(&self.rows)
    }
}

/// `steps` integration steps of length `h` \[s\]; with sensitivities if `SENSITIVE`.
pub struct Propagation<'a, const SENSITIVE: bool> {
    /// Inverse of the inertia matrix.
    pub inverse: &'a Matrix3<f64>,
    /// Angular momentum in inertial axes.
    pub momentum: &'a Vector3<f64>,
    /// The attitude that is advanced.
    pub propagated: &'a mut PropagatedAttitude,
    /// Step length \[s\]; negative for backwards.
    pub h: f64,
    /// Number of steps.
    pub steps: usize,
}

impl<const SENSITIVE: bool> Propagation<'_, SENSITIVE> {
    /// Takes the steps with the processor's SIMD instructions.
    pub fn run(self, arch: Arch) {
        arch.dispatch(self);
    }
}

impl<const SENSITIVE: bool> WithSimd for Propagation<'_, SENSITIVE> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let mut weights = [[0.0; STAGES]; STAGES + 1];
        let tableau = &Tableau::DOP8;
        for (scaled, row) in weights.iter_mut().zip(tableau.a.iter().chain([&tableau.b])) {
            for (scaled, weight) in scaled.iter_mut().zip(*row) {
                *scaled = self.h * weight;
            }
        }
        for _ in 0..self.steps {
            step::<S, SENSITIVE>(simd, self.inverse, self.momentum, self.propagated, &weights);
        }
    }
}

#[inline(always)]
fn step<S: Simd, const SENSITIVE: bool>(
    simd: S,
    inverse: &Matrix3<f64>,
    momentum: &Vector3<f64>,
    propagated: &mut PropagatedAttitude,
    weights: &[[f64; STAGES]; STAGES + 1],
) {
    let h = propagated.R.inverse_transform_vector(momentum);
    let begin: AttitudeState = [h.x, h.y, h.z, 0.0, 0.0, 0.0, 1.0, 0.0];
    let R = *propagated.R.to_rotation_matrix().matrix();
    let mut turning = [[0.0; 8]; STAGES];
    let mut sensitivity_rates = [[0.0; ROWS]; STAGES];
    for i in 0..STAGES {
        let now = combined(simd, &begin, &weights[i][..i], &turning);
        let h = Vector3::new(now[0], now[1], now[2]);
        let w = inverse * h;
        turning[i] = rate(&now, &h, &w);
        if SENSITIVE {
            let rows = combined(simd, &propagated.rows, &weights[i][..i], &sensitivity_rates);
            sensitivity_rates[i] =
                sensitivity_rate(simd, inverse, &(R * turn(&now)), &h, &w, &rows);
        }
    }
    let end = combined(simd, &begin, &weights[STAGES], &turning);
    if SENSITIVE {
        propagated.rows = combined(simd, &propagated.rows, &weights[STAGES], &sensitivity_rates);
    }
    let v = Vector3::new(end[3], end[4], end[5]);
    propagated.R *= UnitQuaternion::new_normalize(Quaternion::from_parts(end[6], v));
    propagated.R.renormalize_fast();
}

/// `begin + Σ weight rate`.
#[inline(always)]
fn combined<S: Simd, const N: usize>(
    simd: S,
    begin: &[f64; N],
    weights: &[f64],
    rates: &[[f64; N]; STAGES],
) -> [f64; N] {
    let mut out = [0.0; N];
    let lanes = S::as_mut_simd_f64s(&mut out).0.iter_mut();
    for (c, (out, begin)) in lanes.zip(S::as_simd_f64s(begin).0).enumerate() {
        let mut sum = *begin;
        for (weight, rate) in weights.iter().zip(rates) {
            if *weight != 0.0 {
                let rate = S::as_simd_f64s(rate).0[c];
                sum = simd.mul_add_e_f64s(simd.splat_f64s(*weight), rate, sum);
            }
        }
        *out = sum;
    }
    out
}

/// Time derivative of momentum and rotation at angular velocity `w`, body axes.
#[inline(always)]
fn rate(now: &AttitudeState, h: &Vector3<f64>, w: &Vector3<f64>) -> AttitudeState {
    let (v, s) = (Vector3::new(now[3], now[4], now[5]), now[6]);
    let (dh, dv) = (h.cross(w), (w * s + v.cross(w)) * 0.5);
    [dh.x, dh.y, dh.z, dv.x, dv.y, dv.z, -0.5 * v.dot(w), 0.0]
}

/// The rotation since the beginning of the step, as a matrix.
#[inline(always)]
fn turn(now: &AttitudeState) -> Matrix3<f64> {
    let ([x, y, z], s) = ([now[3], now[4], now[5]], now[6]);
    #[rustfmt::skip]
    let m = Matrix3::new(
        1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - s * z), 2.0 * (x * z + s * y),
        2.0 * (x * y + s * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - s * x),
        2.0 * (x * z - s * y), 2.0 * (y * z + s * x), 1.0 - 2.0 * (x * x + y * y),
    );
    m
}

/// Time derivative of the sensitivities at attitude `R`, body momentum `h` and rate `w`: a small rotation `θ` obeys
/// `θ' = θ × w + δw` with `δw = I⁻¹ (Rᵀ δL + h × θ - δI w)`.
#[inline(always)]
fn sensitivity_rate<S: Simd>(
    simd: S,
    inverse: &Matrix3<f64>,
    R: &Matrix3<f64>,
    h: &Vector3<f64>,
    w: &Vector3<f64>,
    rows: &[f64; ROWS],
) -> [f64; ROWS] {
    let homogeneous = inverse * h.cross_matrix() - w.cross_matrix();
    // Rᵀ δL - δI w, the columns of `shape_times` first.
    let (a, b) = (0.5f64.sqrt() * w, (1.0f64 / 6.0).sqrt() * w);
    #[rustfmt::skip]
    let torques = [
        -a.x, -b.x,      -a.y, -a.z, 0.0,  R[(0, 0)], R[(1, 0)], R[(2, 0)],
        a.y,  -b.y,      -a.x, 0.0,  -a.z, R[(0, 1)], R[(1, 1)], R[(2, 1)],
        0.0,  2.0 * b.z, 0.0,  -a.x, -a.y, R[(0, 2)], R[(1, 2)], R[(2, 2)],
    ];
    let mut out = [0.0; ROWS];
    for (r, out) in out.chunks_exact_mut(PARAMETERS).enumerate() {
        let lanes = S::as_mut_simd_f64s(out).0.iter_mut();
        for (c, out) in lanes.enumerate() {
            let mut sum = simd.splat_f64s(0.0);
            for k in 0..3 {
                let row = k * PARAMETERS..(k + 1) * PARAMETERS;
                let (own, torque) = (&rows[row.clone()], &torques[row]);
                let factor = simd.splat_f64s(homogeneous[(r, k)]);
                sum = simd.mul_add_e_f64s(factor, S::as_simd_f64s(own).0[c], sum);
                let factor = simd.splat_f64s(inverse[(r, k)]);
                sum = simd.mul_add_e_f64s(factor, S::as_simd_f64s(torque).0[c], sum);
            }
            *out = sum;
        }
    }
    out
}
