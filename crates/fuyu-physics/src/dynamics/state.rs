//! State of a free-floating robot.

use std::ops::AddAssign;

use nalgebra::{DVector, Translation3, UnitQuaternion, Vector3};

use super::Workspace;
use crate::model::Model;
use crate::spatial::{Pose, Twist};

/// Momentum of the whole system.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Momentum {
    /// Linear momentum `P` \[N s\], Masutani 1995 eq. (4.7).
    pub linear: Vector3<f64>,
    /// Angular momentum about the system's centre of mass \[N m s\]: `L - R_C × P` with `L` of
    /// Masutani 1995 eq. (4.8), which the thesis takes about the world's origin.
    pub angular: Vector3<f64>,
}

impl Momentum {
    /// The same momentum in other axes: components in B for components in W, given `R_WB`.
    pub fn expressed_in(&self, R_WB: &UnitQuaternion<f64>) -> Self {
        Self {
            linear: R_WB.inverse_transform_vector(&self.linear),
            angular: R_WB.inverse_transform_vector(&self.angular),
        }
    }
}

/// State of a free-floating robot. Small, owned by the caller, independent of a [`Workspace`].
#[derive(Debug, Clone, PartialEq)]
pub struct State {
    /// Time \[s\].
    pub time: f64,
    /// Attitude of the base (`base_link`) in the world.
    pub R_WB: UnitQuaternion<f64>,
    /// The system's centre of mass C in the world \[m\].
    pub p_WC: Vector3<f64>,
    /// Momentum about the system's centre of mass, world axes.
    pub momentum_W: Momentum,
    /// Joint positions \[rad or m\], in the model's order.
    pub q: DVector<f64>,
    /// Joint rates \[rad/s or m/s\].
    pub qd: DVector<f64>,
    /// Work done on the system since the start by joint efforts, springs, dampers, friction, stops, speed limits and
    /// external wrenches \[J\]. Kinetic energy minus work is constant.
    pub work: f64,
    /// Energy dissipated by the joints, by cause, which `work` contains with a negative sign: actuators, springs and
    /// external wrenches have done `work + dissipated.total()`.
    pub dissipated: Dissipated,
}

/// Energy that the joints have dissipated since the start, by cause \[J\].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Dissipated {
    /// Loss by viscous damping.
    pub damping: f64,
    /// Loss by Coulomb friction.
    pub friction: f64,
    /// Loss by impacts on stops.
    pub stops: f64,
    /// Loss by drives that brake joints to their speed limits.
    pub velocity_limits: f64,
}

impl AddAssign for Dissipated {
    fn add_assign(&mut self, other: Self) {
        self.damping += other.damping;
        self.friction += other.friction;
        self.stops += other.stops;
        self.velocity_limits += other.velocity_limits;
    }
}

impl Dissipated {
    /// Sum of all losses \[J\].
    pub fn total(&self) -> f64 {
        self.damping + self.friction + self.stops + self.velocity_limits
    }
}

impl State {
    /// A state at rest with all joints at zero, with the base frame at the world's origin and along its axes.
    pub fn at_rest(model: &Model) -> Self {
        Self::at_rest_with(model, &DVector::zeros(model.dof()))
    }

    /// A state at rest at joint positions `q`, with the base frame at the world's origin and along its axes.
    ///
    /// # Panics
    /// If `q` does not have one element per joint.
    pub fn at_rest_with(model: &Model, q: &DVector<f64>) -> Self {
        let mut state = Self {
            time: 0.0,
            R_WB: UnitQuaternion::identity(),
            p_WC: Vector3::zeros(),
            momentum_W: Momentum::default(),
            q: q.clone(),
            qd: DVector::zeros(model.dof()),
            work: 0.0,
            dissipated: Dissipated::default(),
        };
        let mut workspace = Workspace::new(model);
        workspace.set_positions(&state.q);
        state.p_WC = *workspace.p_BC();
        state
    }

    /// Moves the robot so that its base has the pose `X_WB` and the twist `V_WB_B` (of the base
    /// frame's origin, components in B). Joint positions and rates stay; centre of mass and momentum follow.
    ///
    /// # Panics
    /// If the state does not fit the robot of `workspace`.
    pub fn set_base(
        &mut self,
        workspace: &mut Workspace,
        X_WB: &nalgebra::Isometry3<f64>,
        V_WB_B: &Twist,
    ) {
        workspace.set_positions(&self.q);
        self.R_WB = X_WB.rotation;
        self.p_WC = X_WB * nalgebra::Point3::from(*workspace.p_BC()) - nalgebra::Point3::origin();
        let momentum_B = workspace.momentum_of(V_WB_B, &self.qd);
        self.momentum_W = Momentum {
            linear: self.R_WB * momentum_B.linear,
            angular: self.R_WB * momentum_B.angular,
        };
    }

    /// Pose of the base frame in the world; `workspace` holds this state's positions.
    pub fn X_WB(&self, workspace: &Workspace) -> Pose {
        let R_WB = self.R_WB.to_rotation_matrix();
        Pose::from_parts(
            Translation3::from(self.p_WC - R_WB * workspace.p_BC()),
            R_WB,
        )
    }

    /// Copies `other`'s values without allocating.
    ///
    /// # Panics
    /// If the two do not have the same number of joints.
    pub fn copy_from(&mut self, other: &Self) {
        self.time = other.time;
        self.R_WB = other.R_WB;
        self.p_WC = other.p_WC;
        self.momentum_W = other.momentum_W;
        self.q.as_mut_slice().copy_from_slice(other.q.as_slice());
        self.qd.as_mut_slice().copy_from_slice(other.qd.as_slice());
        self.work = other.work;
        self.dissipated = other.dissipated;
    }

    /// Whether all numbers of the state are finite.
    pub fn is_finite(&self) -> bool {
        let m = &self.momentum_W;
        self.time.is_finite()
            && self.work.is_finite()
            && self.dissipated.total().is_finite()
            && self.R_WB.coords.iter().all(|x| x.is_finite())
            && [&self.p_WC, &m.linear, &m.angular]
                .iter()
                .all(|v| v.iter().all(|x| x.is_finite()))
            && self.q.iter().chain(self.qd.iter()).all(|x| x.is_finite())
    }
}
