//! A free rotation as a function of time.

use nalgebra::{Matrix3, Rotation3, SymmetricEigen, UnitQuaternion, UnitVector3, Vector3};

use super::aperiodic::{self, Aperiodic};
use super::periodic::Periodic;
use super::{DynamicParameters, ParametersError};

/// The rotation of a free rigid body in closed form, at any time in the past or the future.
///
/// C is inertial (for a camera at rest: its optical frame). B is fixed to the body. R, the reference frame, is
/// inertial with z along the angular momentum.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FreeRotation {
    solution: Solution,
    reference_time: f64,
    R_CR: UnitQuaternion<f64>,
    /// Rotation from B to the axes S of the solution.
    R_SB: UnitQuaternion<f64>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Solution {
    /// Argument `u0` at the reference time.
    Periodic { periodic: Periodic, u0: f64 },
    /// Reference time `s0` after the fastest moment \[s\].
    Aperiodic { aperiodic: Aperiodic, s0: f64 },
    /// Rotation at `rate` \[rad/s\] about the momentum.
    SingleAxis {
        rate: f64,
        alpha: f64,
        parameters: Option<DynamicParameters>,
    },
}

/// The four solutions of Euler's equations in Masutani 1995.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SolutionKind {
    /// Three different moments: elliptic functions (2.9).
    Asymmetric,
    /// On the separatrix: hyperbolic functions (2.12).
    Aperiodic,
    /// Two equal moments: circular functions (2.13).
    Axisymmetric,
    /// Constant angular velocity (2.15).
    SingleAxis,
}

/// Why an initial state is no free rotation.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FreeRotationError {
    /// The inertia is not positive definite, or not finite.
    #[error("inertia has the principal moments {}, {}, {}; all must be positive and finite", .0.x, .0.y, .0.z)]
    Inertia(Vector3<f64>),
    /// The body is at rest, or its angular velocity is not finite.
    #[error("angular velocity is ({}, {}, {}) rad/s; it must be finite and not zero", .0.x, .0.y, .0.z)]
    Rate(Vector3<f64>),
    /// The dynamic parameters belong to no motion.
    #[error(transparent)]
    Parameters(#[from] ParametersError),
}

/// Below this sine of the angle between momentum and angular velocity, the velocity is constant to rounding.
const ALIGNED: f64 = 1e-15;

impl FreeRotation {
    /// The motion of a body with rotational inertia `I_B` (any unit, B axes, not necessarily principal) that
    /// at `time` \[s\] has attitude `R_CB` and angular velocity `w_B` \[rad/s\], B axes.
    ///
    /// # Errors
    /// [`FreeRotationError`] if the inertia is not positive definite or the body is at rest.
    pub fn new(
        I_B: &Matrix3<f64>,
        R_CB: UnitQuaternion<f64>,
        w_B: &Vector3<f64>,
        time: f64,
    ) -> Result<Self, FreeRotationError> {
        let (moments, R_BP) = principal_axes(I_B);
        if !moments.iter().all(|m| m.is_finite() && *m > 0.0) {
            return Err(FreeRotationError::Inertia(moments));
        }
        let square = w_B.norm_squared();
        if !(square.is_finite() && square > 0.0) {
            return Err(FreeRotationError::Rate(*w_B));
        }
        let w_P = R_BP.inverse_transform_vector(w_B);
        let (parameters, axes) = DynamicParameters::from_motion(&moments, &w_P);
        let R_TP = thesis_axes(axes, &w_P);
        let R_TB = R_TP * R_BP.inverse();
        let w_T = R_TB * w_B;
        let L_T = parameters.J().component_mul(&w_T);
        let n_C = R_CB * R_TB.inverse_transform_vector(&L_T);
        if parameters.is_single_axis()
            || L_T.cross(&w_T).norm() <= ALIGNED * L_T.norm() * w_T.norm()
        {
            let R_CR = frame(&n_C, None);
            return Ok(Self {
                solution: Solution::SingleAxis {
                    rate: square.sqrt(),
                    alpha: parameters.alpha(),
                    parameters: Some(parameters),
                },
                reference_time: time,
                R_CR,
                R_SB: R_CR.inverse() * R_CB,
            });
        }
        let periodic = Periodic::new(parameters);
        let u0 = periodic.argument(&w_T);
        if parameters.modulus().complement() == 0.0 {
            let s0 = u0 / periodic.lambda;
            let aperiodic = Aperiodic {
                alpha: parameters.alpha(),
                lambda: periodic.lambda.abs(),
                parameters: Some(parameters),
            };
            let now = frame(&n_C, Some(&(R_CB * w_B)));
            let angle = s0 / parameters.alpha().sqrt();
            let R_CR = now * UnitQuaternion::from_axis_angle(&Vector3::z_axis(), -angle);
            return Ok(Self {
                solution: Solution::Aperiodic { aperiodic, s0 },
                reference_time: time,
                R_CR,
                R_SB: (R_CR * aperiodic.attitude(s0)).inverse() * R_CB,
            });
        }
        Ok(Self {
            solution: Solution::Periodic { periodic, u0 },
            reference_time: time,
            R_CR: R_CB * (periodic.attitude(u0, 0.0) * R_TB).inverse(),
            R_SB: R_TB,
        })
    }

    /// The asymmetric or axisymmetric motion with these parameters whose `|w|²` is largest at `time` \[s\]
    /// (axisymmetric: any time). Then φ = 0 and ψ = π/2, eqs. (2.42) and (2.43): the angular velocity lies in
    /// the plane of y and z of the reference frame `R_CR`. B has the thesis's axes.
    pub fn from_parameters(
        parameters: DynamicParameters,
        R_CR: UnitQuaternion<f64>,
        time: f64,
    ) -> Self {
        Self {
            solution: Solution::Periodic {
                periodic: Periodic::new(parameters),
                u0: 0.0,
            },
            reference_time: time,
            R_CR,
            R_SB: UnitQuaternion::identity(),
        }
    }

    /// The aperiodic motion with momentum parameter `alpha` \[s²\] and rate `lambda` \[rad/s\] that is fastest
    /// at `time` \[s\], when the angular velocity lies in the plane of x and z of the reference frame. The
    /// moments of the body are not known; B coincides with R at `time`.
    pub fn aperiodic(alpha: f64, lambda: f64, R_CR: UnitQuaternion<f64>, time: f64) -> Self {
        let aperiodic = Aperiodic {
            alpha,
            lambda: lambda.abs(),
            parameters: None,
        };
        Self {
            solution: Solution::Aperiodic { aperiodic, s0: 0.0 },
            reference_time: time,
            R_CR,
            R_SB: UnitQuaternion::identity(),
        }
    }

    /// The motion with constant angular velocity `w_C` \[rad/s\], not zero. B coincides with R at `time`.
    pub fn single_axis(w_C: &Vector3<f64>, time: f64) -> Self {
        Self {
            solution: Solution::SingleAxis {
                rate: w_C.norm(),
                alpha: w_C.norm_squared().recip(),
                parameters: None,
            },
            reference_time: time,
            R_CR: frame(w_C, None),
            R_SB: UnitQuaternion::identity(),
        }
    }

    /// Attitude of the body `R_CB` at `time` \[s\].
    pub fn attitude(&self, time: f64) -> UnitQuaternion<f64> {
        self.solution_attitude(time) * self.R_SB
    }

    /// Attitude at `time` \[s\] of the axes of the solution: the principal axes in the thesis's order if the moments
    /// are known. z is the axis that the angular velocity circles.
    pub fn solution_attitude(&self, time: f64) -> UnitQuaternion<f64> {
        let elapsed = time - self.reference_time;
        let R_RS = match &self.solution {
            Solution::Periodic { periodic, u0 } => {
                let u = u0 + periodic.lambda * elapsed;
                periodic.attitude(u, periodic.precession(*u0, u, elapsed))
            }
            Solution::Aperiodic { aperiodic, s0 } => aperiodic.attitude(s0 + elapsed),
            Solution::SingleAxis { rate, .. } => {
                UnitQuaternion::from_axis_angle(&Vector3::z_axis(), rate * elapsed)
            }
        };
        self.R_CR * R_RS
    }

    /// Angular velocity in C \[rad/s\] at `time` \[s\].
    pub fn angular_velocity(&self, time: f64) -> Vector3<f64> {
        let elapsed = time - self.reference_time;
        match &self.solution {
            Solution::Periodic { periodic, u0 } => {
                let w_T = periodic.rates(u0 + periodic.lambda * elapsed);
                self.solution_attitude(time) * w_T
            }
            Solution::Aperiodic { aperiodic, s0 } => self.R_CR * aperiodic.velocity(s0 + elapsed),
            Solution::SingleAxis { rate, .. } => self.R_CR * Vector3::new(0.0, 0.0, *rate),
        }
    }

    /// Angular velocity in the principal axes, in the thesis's order \[rad/s\], at `time` \[s\]: a point of the
    /// polhode. `None` if the axes are not known.
    pub fn principal_rates(&self, time: f64) -> Option<Vector3<f64>> {
        let elapsed = time - self.reference_time;
        match &self.solution {
            Solution::Periodic { periodic, u0 } => {
                Some(periodic.rates(u0 + periodic.lambda * elapsed))
            }
            Solution::Aperiodic { aperiodic, s0 } => {
                let parameters = aperiodic.parameters.as_ref()?;
                let u = parameters.lambda() * (s0 + elapsed);
                Some(aperiodic::rates(parameters, u))
            }
            Solution::SingleAxis { .. } => None,
        }
    }

    /// The principal axes in the axes B, by rows, in the thesis's order. `None` if they are not known.
    pub fn principal_axes(&self) -> Option<Matrix3<f64>> {
        match &self.solution {
            Solution::Periodic { .. } => Some(*self.R_SB.to_rotation_matrix().matrix()),
            _ => None,
        }
    }

    /// The kind of solution.
    pub fn kind(&self) -> SolutionKind {
        match &self.solution {
            Solution::Periodic { periodic, .. } if periodic.parameters.is_axisymmetric() => {
                SolutionKind::Axisymmetric
            }
            Solution::Periodic { .. } => SolutionKind::Asymmetric,
            Solution::Aperiodic { .. } => SolutionKind::Aperiodic,
            Solution::SingleAxis { .. } => SolutionKind::SingleAxis,
        }
    }

    /// Argument of the elliptic functions (of the hyperbolic ones in the aperiodic case) at `time` \[s\]; zero
    /// for a single axis.
    pub fn phase_at(&self, time: f64) -> f64 {
        let elapsed = time - self.reference_time;
        match &self.solution {
            Solution::Periodic { periodic, u0 } => u0 + periodic.lambda * elapsed,
            Solution::Aperiodic { aperiodic, s0 } => aperiodic.lambda * (s0 + elapsed),
            Solution::SingleAxis { .. } => 0.0,
        }
    }

    /// The dynamic parameters, if all are known.
    pub fn parameters(&self) -> Option<&DynamicParameters> {
        match &self.solution {
            Solution::Periodic { periodic, .. } => Some(&periodic.parameters),
            Solution::Aperiodic { aperiodic, .. } => aperiodic.parameters.as_ref(),
            Solution::SingleAxis { parameters, .. } => parameters.as_ref(),
        }
    }

    /// `alpha = L² / 4E²` \[s²\].
    pub fn alpha(&self) -> f64 {
        match &self.solution {
            Solution::Periodic { periodic, .. } => periodic.parameters.alpha(),
            Solution::Aperiodic { aperiodic, .. } => aperiodic.alpha,
            Solution::SingleAxis { alpha, .. } => *alpha,
        }
    }

    /// Direction of the angular momentum in C.
    pub fn momentum_direction(&self) -> UnitVector3<f64> {
        self.R_CR * Vector3::z_axis()
    }

    /// Reference time \[s\].
    pub fn reference_time(&self) -> f64 {
        self.reference_time
    }
}

/// Principal moments and the attitude `R_BP` of right-handed principal axes P.
fn principal_axes(I_B: &Matrix3<f64>) -> (Vector3<f64>, Rotation3<f64>) {
    let eigen = SymmetricEigen::new(*I_B);
    let mut axes = eigen.eigenvectors;
    if axes.determinant() < 0.0 {
        axes.column_mut(2).neg_mut();
    }
    (eigen.eigenvalues, Rotation3::from_matrix_unchecked(axes))
}

/// The rotation `R_TP` to axes T: x, y and z are the given axes of P, with signs that make the rates about x
/// and z nonnegative.
fn thesis_axes(axes: [usize; 3], w_P: &Vector3<f64>) -> UnitQuaternion<f64> {
    let sign = |x: f64| if x < 0.0 { -1.0 } else { 1.0 };
    let [x, y, z] = axes.map(|i| Vector3::ith(i, 1.0));
    let x = x * sign(w_P[axes[0]]);
    let z = z * sign(w_P[axes[2]]);
    // The third follows from the handedness.
    let y = y * sign(z.cross(&x).dot(&y));
    let rows = [x, y, z].map(|a| a.transpose());
    let R_TP = Rotation3::from_matrix_unchecked(Matrix3::from_rows(&rows));
    UnitQuaternion::from_rotation_matrix(&R_TP)
}

/// The frame with z along `z_C` and x as near to `x_C` as possible; an arbitrary x without `x_C`.
pub(crate) fn frame(z_C: &Vector3<f64>, x_C: Option<&Vector3<f64>>) -> UnitQuaternion<f64> {
    let z = z_C.normalize();
    let towards = x_C.copied().unwrap_or_else(|| Vector3::ith(z.iamin(), 1.0));
    let x = (towards - z * z.dot(&towards)).normalize();
    let axes = Matrix3::from_columns(&[x, z.cross(&x), z]);
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes))
}
