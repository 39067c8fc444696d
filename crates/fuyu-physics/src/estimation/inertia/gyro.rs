//! Identification from gyro, attitude and joint encoders.
//!
//! Let `p`, `h`, `M`, `S` be the robot's linear momentum, angular momentum, mass and first moment, with moments about
//! the base's origin and velocities relative to it, and `r`, `R`, `u`, `w` the grasp frame's position, rotation,
//! velocity and angular velocity. The angular momentum about the common centre of mass is then linear in `β = (m', c',
//! I')`, where `m' = m/(M + m)`, `c' = mc/(M + m)`, `I' = I - [mc]ᵀ[mc]/(M + m)`:
//!
//! ```text
//! L = h - S × p / M + (M r × u - r × p - S × u + S × p / M) m'
//!     + (M ([r][w] - [u]) + [p] - [S][w]) R c' + R I' Rᵀ w
//! ```
//!
//! In inertial axes this angular momentum is constant (Y. Murotsu, K. Senda, M. Ozaki and S. Tsujio, Parameter
//! identification of unknown object handled by free-flying space robot, J. Guidance, Control, and Dynamics 17, 1994,
//! use conservation of momentum; the form above needs no velocity of the base). It is also linear in the gyro's
//! measurement, which a model can therefore predict: [`identify`] solves the linear equations, then minimises the error
//! of the predicted gyro rate by the Gauss-Newton method. For white noise of the gyro this is the maximum-likelihood
//! estimate, whose covariance is the Cramér-Rao bound.

use nalgebra::{DMatrix, DVector, Matrix3, Matrix6xX, SMatrix, SVector, UnitQuaternion, Vector3};

use super::linear::{Excitation, IdentificationError, Scaled};
use super::parameters::{
    InertiaCovariance, InertiaParameters, jacobian, point_inertia, unit_inertia,
};
use crate::dynamics::Workspace;
use crate::model::{Frame, Model};
use crate::spatial::Twist;

/// Limit of the iterations; the start is usually within one standard deviation.
const ITERATIONS: usize = 50;

/// Standard deviation of the mass, relative to it, beyond which a result is refused.
const UNCERTAIN: f64 = 0.5;

/// One measurement of gyro, attitude and encoders.
#[derive(Debug, Clone, PartialEq)]
pub struct GyroSample {
    /// Attitude of the base.
    pub R_WB: UnitQuaternion<f64>,
    /// Angular velocity of the base, base axes \[rad/s\].
    pub w_WB_B: Vector3<f64>,
    /// Joint positions.
    pub q: DVector<f64>,
    /// Joint rates.
    pub qd: DVector<f64>,
    /// Angular momentum of the wheels relative to the base, base axes \[N m s\]; zero without wheels. The robot's inertia
    /// contains them as if they were locked.
    pub wheels: Vector3<f64>,
}

/// The result of [`identify`].
#[derive(Debug, Clone, PartialEq)]
pub struct Identified {
    /// The target's inertia about the grasp frame's origin, in its axes.
    pub inertia: InertiaParameters,
    /// Its covariance: the Cramér-Rao bound.
    pub covariance: InertiaCovariance,
    /// Angular momentum of robot and target about their centre of mass, inertial axes \[N m s\]; the given one if it
    /// was known.
    pub momentum: Vector3<f64>,
    /// Excitation of the parameters by the motion.
    pub excitation: Excitation,
    /// Root mean square of the residuals of the gyro's measurements \[rad/s\].
    pub residual: f64,
}

/// Angular momentum of one sample as `constant + linear β`: the part of moving joints and wheels on a base that does
/// not turn, and the parts of a base that turns at unit rate about each axis with joints and wheels at rest.
struct Momentum {
    R_WB: Matrix3<f64>,
    measured: Vector3<f64>,
    own: (Vector3<f64>, SMatrix<f64, 3, 10>),
    turning: [(Vector3<f64>, SMatrix<f64, 3, 10>); 3],
}

impl Momentum {
    fn new(sample: &GyroSample, workspace: &mut Workspace, frame: &Frame) -> Self {
        workspace.set_positions(&sample.q);
        let at_rest = DVector::zeros(sample.qd.len());
        let axis = |i: usize| terms(workspace, frame, &Vector3::ith(i, 1.0), &at_rest);
        let (constant, linear) = terms(workspace, frame, &Vector3::zeros(), &sample.qd);
        Self {
            R_WB: *sample.R_WB.to_rotation_matrix().matrix(),
            measured: sample.w_WB_B,
            own: (constant + sample.wheels, linear),
            turning: [axis(0), axis(1), axis(2)],
        }
    }

    /// The constant part, and the coefficients of `β`, for a base that turns at `w`; base axes.
    fn at(&self, w: &Vector3<f64>) -> (Vector3<f64>, SMatrix<f64, 3, 10>) {
        let (mut constant, mut linear) = self.own;
        for (i, (c, l)) in self.turning.iter().enumerate() {
            constant += c * w[i];
            linear += l * w[i];
        }
        (constant, linear)
    }

    /// Derivative of the angular momentum with respect to the base's angular velocity: the inertia of the whole.
    fn inertia(&self, beta: &SVector<f64, 10>) -> Matrix3<f64> {
        Matrix3::from_columns(&self.turning.each_ref().map(|(c, l)| c + l * beta))
    }

    /// The gyro's measurement predicted from parameters and momentum, and its derivatives with respect to both.
    fn predicted(
        &self,
        beta: &SVector<f64, 10>,
        momentum: &Vector3<f64>,
    ) -> Option<(Vector3<f64>, SMatrix<f64, 3, 10>, Matrix3<f64>)> {
        let inverse = self.inertia(beta).try_inverse()?;
        let (constant, linear) = &self.own;
        let w = inverse * (self.R_WB.tr_mul(momentum) - constant - linear * beta);
        let (_, at) = self.at(&w);
        Some((w, -(inverse * at), inverse * self.R_WB.transpose()))
    }
}

/// The equation of the module's description, for a base that turns at `w` (base axes, origin at rest).
fn terms(
    workspace: &Workspace,
    frame: &Frame,
    w: &Vector3<f64>,
    qd: &DVector<f64>,
) -> (Vector3<f64>, SMatrix<f64, 3, 10>) {
    let mass = workspace.model().total_mass();
    let own = workspace.momentum_of(&Twist::new(*w, Vector3::zeros()), qd);
    let (p_BC, p) = (workspace.p_BC(), own.linear);
    let (h, S) = (own.angular + p_BC.cross(&p), p_BC * mass);
    let X_BF = workspace.X_BF(frame);
    let (r, R) = (X_BF.translation.vector, X_BF.rotation.into_inner());
    let mut jacobian = Matrix6xX::zeros(qd.len());
    workspace.fixed_base_jacobian(frame, &mut jacobian);
    let moving = &jacobian * qd;
    let u = w.cross(&r) + moving.fixed_rows::<3>(0);
    let w_F = w + moving.fixed_rows::<3>(3);
    let [of_r, of_u, of_w, of_p, of_S] = [r, u, w_F, p, S].map(|v| v.cross_matrix());
    let constant = h - S.cross(&p) / mass;
    let mut linear = SMatrix::<f64, 3, 10>::zeros();
    let of_mass = r.cross(&u) * mass - r.cross(&p) - S.cross(&u) + S.cross(&p) / mass;
    linear.set_column(0, &of_mass);
    let of_moment = (of_r * of_w - of_u) * mass + of_p - of_S * of_w;
    linear
        .fixed_view_mut::<3, 3>(0, 1)
        .copy_from(&(of_moment * R));
    for k in 0..6 {
        linear.set_column(4 + k, &(R * (unit_inertia(k) * R.tr_mul(&w_F))));
    }
    (constant, linear)
}

/// `φ` from `β`, with the robot's mass.
fn physical(beta: &SVector<f64, 10>, robot: f64) -> InertiaParameters {
    let reduced = InertiaParameters::from_vector(beta);
    let mass = robot * reduced.mass / (1.0 - reduced.mass);
    let whole = robot + mass;
    let first_moment = reduced.first_moment * whole;
    InertiaParameters {
        mass,
        first_moment,
        about_origin: reduced.about_origin + point_inertia(&first_moment) / whole,
    }
}

/// Identifies the body that `robot` holds at `frame` from samples of its motion, in which no external couple acts.
/// `momentum` is the angular momentum of both about their centre of mass (inertial axes) if it is known, such as
/// zero; `gyro_sd` the standard deviation of the gyro's noise \[rad/s\], for the covariance.
///
/// # Errors
/// [`IdentificationError`] if the motion does not determine all parameters, or if the measurements do not fit.
pub fn identify(
    robot: &Model,
    frame: &Frame,
    samples: &[GyroSample],
    momentum: Option<Vector3<f64>>,
    gyro_sd: f64,
) -> Result<Identified, IdentificationError> {
    let mut workspace = Workspace::new(robot);
    for (index, sample) in samples.iter().enumerate() {
        let n = robot.dof();
        let values = sample.q.iter().chain(&sample.qd).chain(&sample.w_WB_B);
        let values = values.chain(&sample.wheels);
        let problem = if sample.q.len() != n || sample.qd.len() != n {
            "it must have one position and one rate per joint of the robot"
        } else if !values
            .chain(sample.R_WB.coords.iter())
            .all(|x| x.is_finite())
        {
            "a value is not finite"
        } else {
            continue;
        };
        return Err(IdentificationError::Sample { index, problem });
    }
    let data: Vec<Momentum> = samples
        .iter()
        .map(|sample| Momentum::new(sample, &mut workspace, frame))
        .collect();
    let unknowns = if momentum.is_some() { 10 } else { 13 };
    let mut solution = start(&data, momentum, unknowns)?;
    let mut last = f64::INFINITY;
    for iteration in 0..=ITERATIONS {
        if iteration == ITERATIONS {
            return Err(IdentificationError::NotConverged(ITERATIONS));
        }
        let (jacobian, error) =
            linearised(&data, &solution, momentum).ok_or(IdentificationError::Mass(f64::NAN))?;
        let scaled = Scaled::new(jacobian);
        scaled.check()?;
        let step = scaled.solve(&error);
        solution += &step;
        // Relative to the sizes of the parameters, since the gyro sees their products with the columns.
        let size = step
            .iter()
            .zip(&solution)
            .map(|(s, x)| (s / x.abs().max(1e-3 * solution.amax())).abs())
            .fold(0.0, f64::max);
        if size < 1e-13 || size < 1e-9 && size >= 0.5 * last {
            break;
        }
        last = size;
    }
    finish(&data, &solution, momentum, gyro_sd, robot.total_mass())
}

/// The solution of the linear equations, in which the gyro's noise is an error of the coefficients.
fn start(
    data: &[Momentum],
    known: Option<Vector3<f64>>,
    unknowns: usize,
) -> Result<DVector<f64>, IdentificationError> {
    let mut matrix = DMatrix::zeros(3 * data.len(), unknowns);
    let mut rhs = DVector::zeros(3 * data.len());
    for (k, sample) in data.iter().enumerate() {
        let (constant, linear) = sample.at(&sample.measured);
        set_rows(
            &mut matrix,
            k,
            &(sample.R_WB * linear),
            known.is_none().then_some(-Matrix3::identity()),
        );
        let rest = known.unwrap_or_default() - sample.R_WB * constant;
        rhs.fixed_rows_mut::<3>(3 * k).copy_from(&rest);
    }
    let scaled = Scaled::new(matrix);
    scaled.check()?;
    Ok(scaled.solve(&rhs))
}

fn set_rows(
    matrix: &mut DMatrix<f64>,
    k: usize,
    of_beta: &SMatrix<f64, 3, 10>,
    of_momentum: Option<Matrix3<f64>>,
) {
    matrix.fixed_view_mut::<3, 10>(3 * k, 0).copy_from(of_beta);
    if let Some(of_momentum) = of_momentum {
        matrix
            .fixed_view_mut::<3, 3>(3 * k, 10)
            .copy_from(&of_momentum);
    }
}

fn parts(solution: &DVector<f64>, known: Option<Vector3<f64>>) -> (SVector<f64, 10>, Vector3<f64>) {
    let beta = solution.fixed_rows::<10>(0).into_owned();
    (
        beta,
        known.unwrap_or_else(|| solution.fixed_rows::<3>(10).into_owned()),
    )
}

/// Derivatives of the predicted gyro and the errors of its measurements.
fn linearised(
    data: &[Momentum],
    solution: &DVector<f64>,
    known: Option<Vector3<f64>>,
) -> Option<(DMatrix<f64>, DVector<f64>)> {
    let (beta, momentum) = parts(solution, known);
    let mut matrix = DMatrix::zeros(3 * data.len(), solution.len());
    let mut error = DVector::zeros(3 * data.len());
    for (k, sample) in data.iter().enumerate() {
        let (w, of_beta, of_momentum) = sample.predicted(&beta, &momentum)?;
        set_rows(
            &mut matrix,
            k,
            &of_beta,
            known.is_none().then_some(of_momentum),
        );
        error
            .fixed_rows_mut::<3>(3 * k)
            .copy_from(&(sample.measured - w));
    }
    Some((matrix, error))
}

fn finish(
    data: &[Momentum],
    solution: &DVector<f64>,
    known: Option<Vector3<f64>>,
    gyro_sd: f64,
    robot: f64,
) -> Result<Identified, IdentificationError> {
    let (beta, momentum) = parts(solution, known);
    let inertia = physical(&beta, robot);
    if !(inertia.mass > 0.0 && inertia.mass.is_finite()) {
        return Err(IdentificationError::Mass(inertia.mass));
    }
    let (jacobian_of_gyro, error) =
        linearised(data, solution, known).ok_or(IdentificationError::Mass(f64::NAN))?;
    let of_beta = Scaled::new(jacobian_of_gyro).covariance() * (gyro_sd * gyro_sd);
    let to_physical = jacobian(&beta, |beta| physical(beta, robot).to_vector());
    let of_beta: SMatrix<f64, 10, 10> = of_beta.fixed_view::<10, 10>(0, 0).into_owned();
    let covariance =
        InertiaCovariance::new(&inertia, to_physical * of_beta * to_physical.transpose());
    if covariance.mass() > UNCERTAIN * inertia.mass {
        let (mass, sd) = (inertia.mass, covariance.mass());
        return Err(IdentificationError::Uncertain { mass, sd });
    }
    // The linear equations at the motion without noise.
    let mut matrix = DMatrix::zeros(3 * data.len(), solution.len());
    for (k, sample) in data.iter().enumerate() {
        let Some((w, ..)) = sample.predicted(&beta, &momentum) else {
            continue;
        };
        let (_, linear) = sample.at(&w);
        set_rows(
            &mut matrix,
            k,
            &(sample.R_WB * linear),
            known.is_none().then_some(-Matrix3::identity()),
        );
    }
    Ok(Identified {
        inertia,
        covariance,
        momentum,
        excitation: Scaled::new(matrix).excitation,
        residual: error.norm() / (error.len() as f64).sqrt(),
    })
}
