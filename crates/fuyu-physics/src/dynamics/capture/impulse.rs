//! The impulse at which latches close.
//!
//! The velocity of a floating system has three parts: the velocity of its centre of mass, the angular velocity `H_B⁻¹
//! L` (`L`: angular momentum about the centre of mass, `H_B`: inertia about it with locked joints), and the joint
//! rates. In these variables the kinetic energy has no mixed products (Masutani 1995 eqs. (4.45)-(4.48)): an impulse
//! changes momentum as for a rigid body, and the joint rates through the reduced inertia `Ĥ` and the generalized
//! Jacobian `Ĵ`. The latches' relative velocity is `u = G v` for the velocity `v`; `W` is the inverse of the inertia.
//! `A = G W Gᵀ` (the Delassus matrix, whose inverse is the effective mass at the grasp) gives the impulse `Λ = -A⁻¹ u`
//! that removes `u`: the equations of unilateral contact, with equalities (F. Pfeiffer and C. Glocker, Multibody
//! Dynamics with Unilateral Contacts, 1996, chapter 6; R. Featherstone, Rigid Body Dynamics Algorithms, 2008, section
//! 11.7). The lost energy is the kinetic energy of the change of velocity (Carnot's theorem).

use nalgebra::{
    Cholesky, DMatrix, DVector, Dyn, Matrix3, Matrix6xX, Rotation3, SymmetricEigen, Vector3,
};

use crate::dynamics::{State, Workspace, checks};
use crate::model::Frame;
use crate::spatial::Wrench;

/// Directions in which a latch holds one frame relative to another.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Latch {
    /// Position and attitude.
    #[default]
    Weld,
    /// Position only: a spherical joint.
    Ball,
}

impl Latch {
    /// All by name, the default first.
    pub const NAMES: [(&'static str, Self); 2] = [("weld", Self::Weld), ("ball", Self::Ball)];

    /// Number of constrained directions.
    fn rows(self) -> usize {
        match self {
            Self::Weld => 6,
            Self::Ball => 3,
        }
    }
}

/// Reaction of a joint to an impulse.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum JointReaction {
    /// The joint turns freely. Damping, friction and actuators of finite effort do not matter in an impulse.
    #[default]
    Free,
    /// A brake stops the joint in the same instant.
    Locked,
    /// An ideal servo keeps the joint's rate.
    RateHeld,
}

impl JointReaction {
    /// All by name, the default first.
    pub const NAMES: [(&'static str, Self); 3] = [
        ("free", Self::Free),
        ("locked", Self::Locked),
        ("rate_held", Self::RateHeld),
    ];
}

/// A floating system that takes part in an impulse.
#[derive(Debug)]
pub struct System<'a> {
    /// State before the impulse.
    pub state: &'a State,
    /// Its scratch memory.
    pub workspace: &'a mut Workspace,
    /// Reaction of each joint; joints beyond the end are free.
    pub joints: &'a [JointReaction],
}

/// Two frames that a latch joins, each with the index of its system. The impulse acts on both bodies at the origin of
/// the first frame.
#[derive(Debug, Clone, Copy)]
pub struct LatchPair<'a> {
    /// The first frame.
    pub first: (usize, &'a Frame),
    /// The second frame, on another system or on another body of the same one.
    pub second: (usize, &'a Frame),
    /// The directions that the latch holds.
    pub latch: Latch,
}

/// The result of [`close_latches`].
#[derive(Debug, Clone, PartialEq)]
pub struct LatchImpulses {
    /// State of each system afterwards.
    pub states: Vec<State>,
    /// For each latch, the impulse on the first frame's body, about that frame's origin, world axes \[N s, N m s\]. The
    /// opposite impulse acts on the second frame's body.
    pub on_first: Vec<Wrench>,
    /// For each system, the impulses of brakes and servos along the joints \[N m s or N s\]; zero for free joints.
    pub joints: Vec<DVector<f64>>,
    /// Kinetic energy before minus after \[J\]; negative if rate-holding servos or a spring supply more than is lost.
    pub energy_lost: f64,
}

/// Mass properties of a system and changes of its velocity, in the three parts of the module's description; world axes.
struct Terms {
    mass: f64,
    /// Inverse of the whole system's rotational inertia about its centre of mass.
    inertia_inverse: Matrix3<f64>,
    /// `Ĥ`, in the order free joints, held joints.
    reduced: DMatrix<f64>,
    /// Cholesky factor of the block of free joints.
    free_inertia: Option<Cholesky<f64, Dyn>>,
    /// Coordinates in the order free, held; and the number of free ones.
    order: Vec<usize>,
    free: usize,
    /// Changes of linear and angular momentum and, in `order`, joint rates.
    linear: Vector3<f64>,
    angular: Vector3<f64>,
    rates: DVector<f64>,
    /// Rows of `G` for all latches: velocity of the centre of mass, angular velocity, joint rates in `order`.
    rows: DMatrix<f64>,
}

/// Closes latches between floating systems in one impulse: afterwards the frames of each pair have no relative
/// velocity, in position and, for a weld, attitude. The frames should coincide; otherwise the second one is extended
/// rigidly to the first. If latches are redundant (two locked arms, for example), the impulse with the least `Σ A_ii
/// Λ_i²` is chosen, with the Delassus matrix `A`. Without latches only brakes act.
///
/// # Panics
/// If a state does not fit its workspace, or a frame its system.
pub fn close_latches(systems: &mut [System], latches: &[LatchPair]) -> LatchImpulses {
    let count: usize = latches.iter().map(|pair| pair.latch.rows()).sum();
    let mut terms: Vec<Terms> = systems
        .iter_mut()
        .map(|system| Terms::new(system, count))
        .collect();
    let mut row = 0;
    let mut points = Vec::new();
    for pair in latches {
        let point = origin(&systems[pair.first.0], pair.first.1);
        for ((s, frame), sign) in [(pair.first, 1.0), (pair.second, -1.0)] {
            terms[s].add_rows(&systems[s], frame, &point, sign, row, pair.latch.rows());
        }
        row += pair.latch.rows();
        points.push(point);
    }
    let mut delassus = DMatrix::zeros(count, count);
    for term in &terms {
        term.add_delassus(&mut delassus);
    }
    let mut impulse = DVector::zeros(count);
    let inverse = (count > 0).then(|| PseudoInverse::new(delassus));
    // Further passes remove the rounding errors of the first.
    for inverse in inverse.iter().cycle().take(3) {
        let mut relative = DVector::zeros(count);
        for (term, system) in terms.iter().zip(&*systems) {
            term.add_velocity(system.state, &mut relative);
        }
        let added = -inverse.times(&relative);
        for term in &mut terms {
            term.apply(&added);
        }
        impulse += added;
    }
    finish(systems, latches, &terms, &impulse, &points)
}

/// Pushes the bodies of a pair of frames apart along `direction` (world axes, from the first to the second) with a
/// spring at the first frame's origin that releases `energy` \[J\] in an instant. The pair's latch is ignored. Unless
/// brakes and servos act, the energy lost is `-energy`. If `direction` is zero, or if `energy` is negative and exceeds
/// the energy that the pair can give, states are NaN.
///
/// # Panics
/// As [`close_latches`].
pub fn push_apart(
    systems: &mut [System],
    pair: &LatchPair,
    direction: &Vector3<f64>,
    energy: f64,
) -> LatchImpulses {
    let mut terms: Vec<Terms> = systems
        .iter_mut()
        .map(|system| Terms::new(system, 3))
        .collect();
    let point = origin(&systems[pair.first.0], pair.first.1);
    for ((s, frame), sign) in [(pair.first, 1.0), (pair.second, -1.0)] {
        terms[s].add_rows(&systems[s], frame, &point, sign, 0, 3);
    }
    let mut delassus = DMatrix::zeros(3, 3);
    let mut velocity = DVector::zeros(3);
    for (term, system) in terms.iter().zip(&*systems) {
        term.add_delassus(&mut delassus);
        term.add_velocity(system.state, &mut velocity);
    }
    let direction = direction.normalize();
    let mobility = direction.dot(&(delassus.fixed_view::<3, 3>(0, 0) * direction));
    let opening = -direction.dot(&velocity.fixed_rows::<3>(0));
    // opening λ + mobility λ² / 2 = energy.
    let push = ((opening * opening + 2.0 * mobility * energy).sqrt() - opening) / mobility;
    let impulse = DVector::from_column_slice((direction * -push).as_slice());
    for term in &mut terms {
        term.apply(&impulse);
    }
    let pair = LatchPair {
        latch: Latch::Ball,
        ..*pair
    };
    let mut parting = DVector::zeros(3);
    for (term, system) in terms.iter().zip(&*systems) {
        term.add_velocity(system.state, &mut parting);
    }
    let mut result = finish(systems, &[pair], &terms, &impulse, &[point]);
    // The relative velocity is not zero afterwards: the impulse adds `Λ u` to the energy of the change.
    result.energy_lost -= impulse.dot(&parting);
    result
}

fn finish(
    systems: &[System],
    latches: &[LatchPair],
    terms: &[Terms],
    impulse: &DVector<f64>,
    points: &[Vector3<f64>],
) -> LatchImpulses {
    let mut states: Vec<State> = systems.iter().map(|system| system.state.clone()).collect();
    let mut on_first = Vec::new();
    let mut row = 0;
    for (pair, point) in latches.iter().zip(points) {
        let of = |k: usize| Vector3::from(impulse.fixed_rows::<3>(row + k));
        let wrench = Wrench {
            force: of(0),
            torque: if pair.latch == Latch::Weld {
                of(3)
            } else {
                Vector3::zeros()
            },
        };
        for ((s, _), wrench) in [(pair.first, wrench), (pair.second, -wrench)] {
            let state = &mut states[s];
            state.momentum_W.linear += wrench.force;
            state.momentum_W.angular += wrench.shifted(&(point - state.p_WC)).torque;
        }
        on_first.push(wrench);
        row += pair.latch.rows();
    }
    let mut energy_lost = 0.0;
    let mut joints = Vec::new();
    for ((term, system), state) in terms.iter().zip(systems).zip(&mut states) {
        let held = term.held_impulses(impulse);
        energy_lost += term.energy();
        let mut on_joints = DVector::zeros(term.order.len());
        for (k, &j) in term.order.iter().enumerate() {
            if k < term.free {
                state.qd[j] = system.state.qd[j] + term.rates[k];
            } else {
                // Exactly the held rate, without the rounding errors of the sum.
                state.qd[j] = held_rate(system, j);
                on_joints[j] = held[k - term.free];
                energy_lost -= state.qd[j] * on_joints[j];
            }
        }
        joints.push(on_joints);
    }
    LatchImpulses {
        states,
        on_first,
        joints,
        energy_lost,
    }
}

/// Rate of a held joint after the impulse.
fn held_rate(system: &System, j: usize) -> f64 {
    match system.joints.get(j) {
        Some(JointReaction::Locked) => 0.0,
        _ => system.state.qd[j],
    }
}

/// Origin of a frame in the world.
fn origin(system: &System, frame: &Frame) -> Vector3<f64> {
    let X_WB = system.state.X_WB(system.workspace);
    (X_WB * system.workspace.X_BF(frame)).translation.vector
}

impl Terms {
    fn new(system: &mut System, count: usize) -> Self {
        let workspace = &mut *system.workspace;
        checks::state(system.state, workspace.model());
        workspace.set_positions(&system.state.q);
        workspace.set_motion(system.state);
        let n = workspace.model().dof();
        let reaction = |j: &usize| system.joints.get(*j).copied().unwrap_or_default();
        let (mut order, held): (Vec<usize>, Vec<usize>) =
            (0..n).partition(|j| reaction(j) == JointReaction::Free);
        let free = order.len();
        order.extend(held);
        let inertia = workspace.reduced_inertia();
        let reduced = DMatrix::from_fn(n, n, |i, j| inertia[(order[i], order[j])]);
        let R_WB = *system.state.R_WB.to_rotation_matrix().matrix();
        let mut terms = Self {
            mass: workspace.mass,
            inertia_inverse: R_WB * workspace.H_B_inverse.to_matrix() * R_WB.transpose(),
            free_inertia: Cholesky::new(reduced.view((0, 0), (free, free)).into_owned()),
            reduced,
            free,
            linear: Vector3::zeros(),
            angular: Vector3::zeros(),
            rates: DVector::zeros(n),
            rows: DMatrix::zeros(count, 6 + n),
            order,
        };
        // Effect of the brakes on the free joints, without any other impulse.
        for k in free..n {
            let j = terms.order[k];
            terms.rates[k] = held_rate(system, j) - system.state.qd[j];
        }
        let coupled =
            terms.reduced.view((0, free), (free, n - free)) * terms.rates.rows(free, n - free);
        let change = terms.free_response(-coupled);
        terms.rates.rows_mut(0, free).copy_from(&change);
        terms
    }

    /// `Ĥ⁻¹` of the free joints times `efforts`.
    fn free_response(&self, efforts: DVector<f64>) -> DVector<f64> {
        match &self.free_inertia {
            Some(factors) if self.free > 0 => factors.solve(&efforts),
            // Without free joints there is nothing to solve; without a factor, positions are not finite.
            _ => efforts * f64::NAN,
        }
    }

    /// Adds the rows of the velocity of `point`, fixed to the body of `frame`, times `sign`, to `count` rows from
    /// `first` on.
    fn add_rows(
        &mut self,
        system: &System,
        frame: &Frame,
        point: &Vector3<f64>,
        sign: f64,
        first: usize,
        count: usize,
    ) {
        let mut jacobian = Matrix6xX::zeros(self.order.len());
        system.workspace.generalized_jacobian(frame, &mut jacobian);
        let R_WB: Rotation3<f64> = system.state.R_WB.to_rotation_matrix();
        let (arm, offset) = (point - system.state.p_WC, point - origin(system, frame));
        let mut add = |column: usize, linear: Vector3<f64>, angular: Vector3<f64>| {
            let all = linear.iter().chain(angular.iter());
            for (k, value) in all.take(count).enumerate() {
                self.rows[(first + k, column)] += sign * value;
            }
        };
        for i in 0..3 {
            let axis = Vector3::ith(i, 1.0);
            add(i, axis, Vector3::zeros());
            add(3 + i, axis.cross(&arm), axis);
        }
        for (k, &j) in self.order.iter().enumerate() {
            let angular = R_WB * jacobian.fixed_view::<3, 1>(3, j);
            let linear = R_WB * jacobian.fixed_view::<3, 1>(0, j) + angular.cross(&offset);
            add(6 + k, linear, angular);
        }
    }

    /// Adds `G W Gᵀ`.
    fn add_delassus(&self, out: &mut DMatrix<f64>) {
        let m = self.rows.nrows();
        for j in 0..m {
            let row = self.rows.row(j);
            let angular = self.inertia_inverse * Vector3::new(row[3], row[4], row[5]);
            let free = DVector::from_fn(self.free, |k, _| row[6 + k]);
            let rates = self.free_response(free);
            for i in 0..m {
                let other = self.rows.row(i);
                let mut sum = 0.0;
                for k in 0..3 {
                    sum += other[k] * row[k] / self.mass + other[3 + k] * angular[k];
                }
                for k in 0..self.free {
                    sum += other[6 + k] * rates[k];
                }
                out[(i, j)] += sum;
            }
        }
    }

    /// Adds the relative velocities of the rows, including the changes so far.
    fn add_velocity(&self, state: &State, out: &mut DVector<f64>) {
        let momentum = &state.momentum_W;
        let linear = (momentum.linear + self.linear) / self.mass;
        let angular = self.inertia_inverse * (momentum.angular + self.angular);
        let mut velocity = DVector::zeros(self.rows.ncols());
        velocity.fixed_rows_mut::<3>(0).copy_from(&linear);
        velocity.fixed_rows_mut::<3>(3).copy_from(&angular);
        for (k, &j) in self.order.iter().enumerate() {
            velocity[6 + k] = state.qd[j] + self.rates[k];
        }
        *out += &self.rows * velocity;
    }

    /// Adds the changes of velocity due to impulses along the rows.
    fn apply(&mut self, impulse: &DVector<f64>) {
        let generalized = self.rows.tr_mul(impulse);
        self.linear += generalized.fixed_rows::<3>(0);
        self.angular += generalized.fixed_rows::<3>(3);
        let change = self.free_response(generalized.rows(6, self.free).into_owned());
        let mut rates = self.rates.rows_mut(0, self.free);
        rates += change;
    }

    /// Impulses of brakes and servos.
    fn held_impulses(&self, impulse: &DVector<f64>) -> DVector<f64> {
        let (n, free) = (self.order.len(), self.free);
        let generalized = self.rows.tr_mul(impulse);
        self.reduced.view((free, 0), (n - free, n)) * &self.rates
            - generalized.rows(6 + free, n - free)
    }

    /// Kinetic energy of the velocity changes.
    fn energy(&self) -> f64 {
        let linear = self.linear.norm_squared() / self.mass;
        let angular = self.angular.dot(&(self.inertia_inverse * self.angular));
        0.5 * (linear + angular + self.rates.dot(&(&self.reduced * &self.rates)))
    }
}

/// Inverse of a symmetric positive semidefinite matrix on its range.
struct PseudoInverse {
    scale: DVector<f64>,
    eigen: SymmetricEigen<f64, Dyn>,
    smallest: f64,
}

/// Eigenvalues below this fraction of the largest belong to dependent rows. The condition number of a grasp by a long
/// arm, with all rows scaled to the same size, is at most some 1e6.
const DEPENDENT: f64 = 1e-11;

impl PseudoInverse {
    fn new(mut matrix: DMatrix<f64>) -> Self {
        let scale = matrix
            .diagonal()
            .map(|x| 1.0 / x.max(f64::MIN_POSITIVE).sqrt());
        for j in 0..matrix.ncols() {
            for i in 0..matrix.nrows() {
                matrix[(i, j)] *= scale[i] * scale[j];
            }
        }
        let eigen = SymmetricEigen::new(matrix);
        let smallest = DEPENDENT * eigen.eigenvalues.amax();
        Self {
            scale,
            eigen,
            smallest,
        }
    }

    fn times(&self, vector: &DVector<f64>) -> DVector<f64> {
        let mut modal = self
            .eigen
            .eigenvectors
            .tr_mul(&vector.component_mul(&self.scale));
        for (x, value) in modal.iter_mut().zip(&self.eigen.eigenvalues) {
            *x = if *value > self.smallest {
                *x / value
            } else {
                0.0
            };
        }
        (&self.eigen.eigenvectors * modal).component_mul(&self.scale)
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::UnitQuaternion;

    use super::*;
    use crate::model::Model;

    /// A base of 1 kg with a slider of 1 kg along x.
    fn slider() -> Model {
        let link = |name: &str| {
            format!(
                "<link name=\"{name}\"><inertial><mass value=\"1\"/><inertia ixx=\"1\" ixy=\"0\" ixz=\"0\" iyy=\"1\" iyz=\"0\" izz=\"1\"/></inertial></link>"
            )
        };
        let joint = "<joint name=\"j\" type=\"prismatic\"><parent link=\"base\"/><child link=\"slider\"/><axis xyz=\"1 0 0\"/><limit lower=\"-9\" upper=\"9\" velocity=\"9\" effort=\"9\"/></joint>";
        let xml = format!(
            "<robot name=\"r\">{}{}{joint}</robot>",
            link("base"),
            link("slider")
        );
        Model::from_urdf(&xml, "r").unwrap()
    }

    /// Two such robots, whose sliders move at 1 m/s.
    fn pair(
        joints: [&[JointReaction]; 2],
        act: impl Fn(&mut [System], &Frame) -> LatchImpulses,
    ) -> (f64, LatchImpulses) {
        let model = slider();
        let frame = model.frame("base").unwrap().clone();
        let mut state = State::at_rest(&model);
        state.qd[0] = 1.0;
        let mut other = state.clone();
        other.R_WB = UnitQuaternion::from_euler_angles(0.3, -0.5, 0.2);
        let mut workspaces = [Workspace::new(&model), Workspace::new(&model)];
        let kinetic = |states: [&State; 2], workspaces: &mut [Workspace; 2]| {
            let both = states.into_iter().zip(workspaces);
            both.map(|(state, workspace)| {
                workspace.set_positions(&state.q);
                workspace.set_motion(state);
                workspace.kinetic_energy()
            })
            .sum::<f64>()
        };
        let before = kinetic([&state, &other], &mut workspaces);
        let [first, second] = &mut workspaces;
        let mut systems = [
            System {
                state: &state,
                workspace: first,
                joints: joints[0],
            },
            System {
                state: &other,
                workspace: second,
                joints: joints[1],
            },
        ];
        let found = act(&mut systems, &frame);
        let after = kinetic([&found.states[0], &found.states[1]], &mut workspaces);
        (before - after, found)
    }

    // Brakes and servos take energy, too: minus the spring's energy alone would be wrong by 0.25 J for one locked
    // slider.
    #[test]
    fn the_energy_of_a_push_counts_brakes_and_servos() {
        use JointReaction::{Free, Locked, RateHeld};
        for (joints, is_free) in [
            ([Free, Free], true),
            ([Locked, Free], false),
            ([RateHeld, Locked], false),
        ] {
            let (lost, found) = pair([&joints[..1], &joints[1..]], |systems, frame| {
                let pair = LatchPair {
                    first: (0, frame),
                    second: (1, frame),
                    latch: Latch::Ball,
                };
                push_apart(systems, &pair, &Vector3::new(1.0, 0.5, -0.2), 0.7)
            });
            assert!((lost - found.energy_lost).abs() < 1e-13, "{lost} {found:?}");
            assert_eq!((lost + 0.7).abs() < 1e-13, is_free, "{lost}");
        }
    }

    // The matrix without rows has no eigenvalues.
    #[test]
    fn without_latches_only_brakes_act() {
        let locked = [JointReaction::Locked];
        let (lost, found) = pair([&locked, &[]], |systems, _| close_latches(systems, &[]));
        assert!((lost - 0.25).abs() < 1e-15 && (found.energy_lost - 0.25).abs() < 1e-15);
        assert_eq!((found.states[0].qd[0], found.states[1].qd[0]), (0.0, 1.0));
        assert!(found.on_first.is_empty());
    }
}
