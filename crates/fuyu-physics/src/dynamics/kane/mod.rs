//! Kane's method, TR-942 section 2.3.
//!
//! An independent check of the reduced form of [`Workspace`](super::Workspace): its state contains the base's twist
//! instead of momentum, it solves for all `6 + n` accelerations at once, and it shares no code with the reduced form.

mod bodies;
mod cut;
mod equations;
mod error;
mod matching;

use nalgebra::{DMatrix, DVector};

use super::expanded_motion::ExpandedMotion;
use super::{Formulation, Input, TreeAcceleration, TreeMotion, checks};
use crate::model::Model;
use crate::spatial::{Twist, Wrench};
use bodies::KaneBody;
use cut::Cut;

pub use cut::CutHinge;
pub use error::CutError;

/// Forward dynamics by Kane's equations, recursively from composite bodies, with loops cut open.
///
/// The generalized speeds are the main body's velocity and angular velocity in world axes and the hinge
/// rates, eq. (2.3.16). Loops use the direct solution (2.3.46): where their constraints lose rank (a
/// stretched pantograph, or directions constrained twice) the accelerations are wrong or not finite.
///
/// ```
/// use fuyu_physics::dynamics::{CutHinge, Formulation, Input, Kane, TreeAcceleration, TreeMotion};
/// use fuyu_physics::model::{JointKind, ModelBuilder};
/// use fuyu_physics::spatial::{Pose, RigidInertia, Twist};
/// use nalgebra::{Matrix3, Translation3, UnitQuaternion, Vector3};
///
/// // A parallelogram: two cranks on the base, and a coupler that one of them carries.
/// let ball = RigidInertia { mass: 1.0, com: Vector3::zeros(), about_com: Matrix3::identity() };
/// let (z, at) = (Vector3::z_axis(), |x| Pose::from(Translation3::new(x, 0.0, 0.0)));
/// let turn = JointKind::Continuous;
/// let mut robot = ModelBuilder::new("parallelogram", "base_link", ball);
/// let crank = robot.body("crank", 0, turn, z, at(0.0), ball);
/// let coupler = robot.body("coupler", crank, turn, z, at(1.0), ball);
/// let rocker = robot.body("rocker", 0, turn, z, Translation3::new(0.0, 2.0, 0.0).into(), ball);
/// let model = robot.build();
/// let pin = CutHinge {
///     body_k: coupler,
///     X_KH: Translation3::new(0.0, 2.0, 0.0).into(),
///     body_l: rocker,
///     X_LH: at(1.0),
///     translations: [true, true, false],
///     rotations: [false; 3],
/// };
/// let mut kane = Kane::with_cuts(&model, &[pin])?;
/// let motion = TreeMotion {
///     R_WB: UnitQuaternion::identity(),
///     V_WB_B: Twist::ZERO,
///     q: &[0.0; 3],
///     qd: &[0.0; 3],
/// };
/// let mut input = Input::zero(&model);
/// input.efforts[0] = 1.0;
/// let mut out = TreeAcceleration::zero(&model);
/// kane.accelerations(&motion, &input, &mut out);
/// // The cranks stay parallel; the pin's force moves the rocker.
/// assert!((out.qdd[0] - out.qdd[2]).abs() < 1e-12 && out.qdd[0] > 0.0);
/// assert!(kane.cut_wrench(0).force.norm() > 0.1);
/// # Ok::<(), fuyu_physics::dynamics::CutError>(())
/// ```
#[derive(Debug, Clone)]
pub struct Kane {
    model: Model,
    speed: BaseSpeed,
    bodies: Vec<KaneBody>,
    cuts: Vec<Cut>,
    /// Motion of all hinges.
    expanded: ExpandedMotion,
    /// Efforts of all hinges on input, their accelerations on output.
    hinges: Vec<f64>,
    /// Equations with a generalized speed for each hinge.
    of_hinges: Equations,
    /// Equations with a generalized speed for each coordinate, of a robot with mimic joints.
    of_coordinates: Option<Equations>,
    /// `Gᵀ M⁻¹ G`.
    GMG: DMatrix<f64>,
    /// `Ġᵀ u`, afterwards `f_c`.
    multipliers: DVector<f64>,
}

/// The equations of motion for a choice of generalized speeds.
#[derive(Debug, Clone)]
struct Equations {
    /// `M`, lower triangle; afterwards its Cholesky factor `L`. Without the main body's velocity if the
    /// system's centre of mass stands for it.
    M: DMatrix<f64>,
    /// `-g`; afterwards the derivatives of the generalized speeds.
    speeds: DVector<f64>,
    /// `G = -H` of (2.3.43); afterwards `L⁻¹ G`.
    G: DMatrix<f64>,
}

impl Equations {
    fn zero(size: usize, constraints: usize) -> Self {
        Self {
            M: DMatrix::zeros(size, size),
            speeds: DVector::zeros(size),
            G: DMatrix::zeros(size, constraints),
        }
    }
}

/// The point whose velocity is the generalized speed of the translation; accelerations do not depend on the choice.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum BaseSpeed {
    /// The main body's, (2.3.16).
    #[default]
    MainBody,
    /// That of the whole system's centre of mass (end of section 2.3.2): its equation separates from the others,
    /// which leaves `3 + n` to be solved.
    SystemCom,
}

impl Kane {
    /// Scratch for a tree.
    pub fn new(model: &Model) -> Self {
        Self::assemble(
            model.clone(),
            KaneBody::all(model),
            Vec::new(),
            BaseSpeed::default(),
        )
    }

    /// Scratch for a tree whose loops are closed by `cuts`. The caller's motion must satisfy the constraints, which is
    /// neither checked nor corrected.
    ///
    /// # Errors
    /// [`CutError`] for a cut that constrains nothing, has an unknown body or the same body twice, is not finite, or
    /// constrains more directions than the hinges of the loops can satisfy.
    pub fn with_cuts(model: &Model, cuts: &[CutHinge]) -> Result<Self, CutError> {
        let cuts = Cut::all(model, cuts)?;
        let bodies = KaneBody::all(model);
        Ok(Self::assemble(
            model.clone(),
            bodies,
            cuts,
            BaseSpeed::default(),
        ))
    }

    /// The same with another generalized speed for the translation.
    pub fn with_base_speed(self, speed: BaseSpeed) -> Self {
        Self::assemble(self.model, self.bodies, self.cuts, speed)
    }

    fn assemble(model: Model, bodies: Vec<KaneBody>, cuts: Vec<Cut>, speed: BaseSpeed) -> Self {
        let base = match speed {
            BaseSpeed::MainBody => 6,
            BaseSpeed::SystemCom => 3,
        };
        let hinges = bodies.len() - 1;
        let constraints = cuts.iter().map(Cut::count).sum();
        let of_coordinates =
            (model.has_mimics()).then(|| Equations::zero(base + model.dof(), constraints));
        Self {
            expanded: ExpandedMotion::new(&model),
            model,
            speed,
            bodies,
            cuts,
            hinges: vec![0.0; hinges],
            of_hinges: Equations::zero(base + hinges, constraints),
            of_coordinates,
            GMG: DMatrix::zeros(constraints, constraints),
            multipliers: DVector::zeros(constraints),
        }
    }

    /// Constraint force \[N\] and torque \[N m\] of cut `cut` on its body `k`, axes of the hinge frame, as of the
    /// last evaluation; the opposite acts on body `l`. Free directions are zero.
    ///
    /// # Panics
    /// If there is no such cut.
    pub fn cut_wrench(&self, cut: usize) -> Wrench {
        self.cuts[cut].wrench(&self.multipliers)
    }

    /// Velocity of body `l` relative to body `k` at cut `cut`, axes of the hinge frame, as of the last evaluation. In
    /// constrained directions it is zero, except for integration errors.
    ///
    /// # Panics
    /// If there is no such cut.
    pub fn cut_velocity(&self, cut: usize) -> Twist {
        self.cuts[cut].relative_velocity(&self.bodies)
    }
}

impl Formulation for Kane {
    /// Steps (i)-(v) of section 2.3.4.
    fn accelerations(&mut self, motion: &TreeMotion, input: &Input, out: &mut TreeAcceleration) {
        checks::formulation(motion, input, out, &self.model);
        KaneBody::set_motion(&mut self.bodies, &self.expanded.of(&self.model, motion));
        KaneBody::set_outer_sets(&mut self.bodies, &input.wrenches);
        // A mimic joint has neither an actuator nor a spring or damper.
        self.hinges.fill(0.0);
        let positions = motion.q.iter().zip(motion.qd);
        let acting = self
            .model
            .joints()
            .iter()
            .zip(input.efforts.iter())
            .zip(positions);
        for (j, ((joint, effort), (q, qd))) in acting.enumerate() {
            let hinge = self.model.joint_body(j) - 1;
            self.hinges[hinge] = effort + joint.passive_effort(*q, *qd);
        }
        self.solve(out);
    }
}
