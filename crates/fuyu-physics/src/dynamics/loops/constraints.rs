//! The loop closures of one model: projection onto the constraints, and constrained accelerations.

use nalgebra::{DMatrix, DVector, Matrix6xX};

use super::normals::Normals;
use super::singular::NearbyState;
use super::{LoopClosure, LoopError, LoopGap};
use crate::dynamics::{Input, Momentum, State, Workspace, checks};
use crate::model::Model;
use crate::spatial::exp_so3;

/// Normals whose remainder is below this fraction of their size are dropped. Gaps are closed to rounding, some 1e-15;
/// near a singular state, the error of a vanishing normal's direction grows with the square of this fraction's inverse.
const DEPENDENT: f64 = 5e-4;

/// Normals shorter than this multiple of the gap are dropped: a gap in the positions changes normals by as much as the
/// gap.
const GAPS: f64 = 10.0;

/// Normals longer than this are kept, however large the gap is.
const INDEPENDENT: f64 = 0.03;

/// Gaps below this, relative to the size of the mechanism, are rounding.
const CLOSED: f64 = 4e-15;

/// Limit of Newton's iterations, each of which doubles the number of correct digits: more would not help.
const CORRECTIONS: usize = 8;

/// The loop closures of one model, and their scratch memory. Part of an [`Integrator`](crate::dynamics::Integrator) or
/// [`Floating`](crate::dynamics::Floating). To use it directly, [`Loops::assemble`] a state, then call
/// [`Loops::accelerations`] instead of the workspace's.
#[derive(Debug, Clone)]
pub struct Loops {
    pub(in crate::dynamics) model: Model,
    pub(super) closures: Vec<LoopClosure>,
    pub(super) normals: Normals,
    pub(super) gradients: DMatrix<f64>,
    jacobians: (Matrix6xX<f64>, Matrix6xX<f64>),
    /// Change that each constraint requires: the negative of a gap, rate or acceleration, rotations times `length`.
    pub(super) target: DVector<f64>,
    /// Change of joint positions.
    pub(super) change: DVector<f64>,
    /// Projection of joint rates onto the constraints.
    projected: DMatrix<f64>,
    /// Size of the mechanism, by which angles are multiplied to compare them with translations \[m\].
    pub(super) length: f64,
    /// Positions at which `normals` were computed.
    pub(super) normals_at: DVector<f64>,
    /// Gap of the positions before the projection.
    pub(super) gap_before: f64,
    /// Number of independent constraints except at singular states.
    pub(super) rank: usize,
    /// Scratch at singular states; `None` while in use.
    pub(super) nearby: Option<Box<NearbyState>>,
}

impl Loops {
    /// Constraints for `model`. Without closures, they have no effect and almost no cost.
    ///
    /// # Errors
    /// [`LoopError`] for a closure without directions, between frames of one body, or with a name given
    /// twice.
    ///
    /// # Panics
    /// If a frame belongs to a body that the model does not have.
    pub fn new(model: &Model, closures: Vec<LoopClosure>) -> Result<Self, LoopError> {
        for (i, closure) in closures.iter().enumerate() {
            let name = || closure.name.clone();
            if closures[..i].iter().any(|c| c.name == closure.name) {
                return Err(LoopError::DuplicateName(name()));
            }
            if closure.directions().next().is_none() {
                return Err(LoopError::NoDirection(name()));
            }
            let body = &model.bodies()[closure.frame_b.body];
            if closure.frame_a.body == closure.frame_b.body {
                return Err(LoopError::SameBody {
                    closure: name(),
                    frame_a: closure.frame_a.name.clone(),
                    frame_b: closure.frame_b.name.clone(),
                    body: body.name.clone(),
                });
            }
        }
        Ok(Self::with_valid(model, closures))
    }

    fn with_valid(model: &Model, closures: Vec<LoopClosure>) -> Self {
        let n = model.dof();
        let closure_of_row = |(i, c): (usize, &LoopClosure)| vec![i; c.directions().count()];
        let rows: Vec<usize> = (closures.iter().enumerate())
            .flat_map(closure_of_row)
            .collect();
        let m = rows.len();
        let length = model
            .tree_joints()
            .map(|joint| joint.X_PJ.translation.vector.norm())
            .fold(0.0, f64::max);
        Self {
            model: model.clone(),
            closures,
            normals: Normals::new(n, rows),
            gradients: DMatrix::zeros(n, m),
            jacobians: (Matrix6xX::zeros(n), Matrix6xX::zeros(n)),
            target: DVector::zeros(m),
            change: DVector::zeros(n),
            projected: DMatrix::zeros(n, n),
            length: if length > 0.0 { length } else { 1.0 },
            normals_at: DVector::from_element(n, f64::NAN),
            gap_before: 0.0,
            rank: 0,
            nearby: Some(Box::new(NearbyState::new(model))),
        }
    }

    /// No closures: the model is a tree.
    pub(in crate::dynamics) fn none(model: &Model) -> Self {
        Self::with_valid(model, Vec::new())
    }

    /// The closures.
    pub fn closures(&self) -> &[LoopClosure] {
        &self.closures
    }

    /// Degrees of freedom of the joints: their number minus that of independent constraints (known after
    /// [`Loops::assemble`]).
    pub fn mobility(&self) -> usize {
        self.change.len() - self.rank
    }

    /// Gap of each closure at the positions of `workspace`.
    pub fn gaps(&self, workspace: &Workspace) -> impl Iterator<Item = (&LoopClosure, LoopGap)> {
        let gap = |closure: &LoopClosure| closure.gap(workspace);
        self.closures.iter().map(move |c| (c, gap(c)))
    }

    /// Projects positions and rates of `state` onto the constraints with the smallest change in the metric of the reduced
    /// inertia. Centre of mass and momentum do not change; the base's attitude changes as the motion of the joints at zero
    /// momentum requires. On return, `workspace` has the new positions.
    pub fn project(&mut self, state: &mut State, workspace: &mut Workspace) {
        if self.closures.is_empty() {
            return;
        }
        checks::same_robot("the loops", &self.model, "the workspace", workspace.model());
        checks::state(state, &self.model);
        self.project_positions(state, workspace);
        self.normals.remove_normal(&mut state.qd);
        if self.normals.rank() < self.rank {
            self.limit_rates(state, workspace);
        }
    }

    /// Writes the joints' damping matrix within the closed loops: `Πᵀ D Π` with the projection `Π` of joint rates onto
    /// the constraints. Call [`Loops::project`] before.
    pub(in crate::dynamics) fn project_damping(&mut self, model: &Model, out: &mut DMatrix<f64>) {
        let n = model.dof();
        out.fill(0.0);
        self.projected.fill(0.0);
        for j in 0..n {
            self.change.fill(0.0);
            self.change[j] = 1.0;
            self.normals.remove_normal(&mut self.change);
            self.projected.set_column(j, &self.change);
        }
        for (k, joint) in model.joints().iter().enumerate() {
            for j in 0..n {
                for i in 0..n {
                    out[(i, j)] += self.projected[(k, i)] * joint.damping * self.projected[(k, j)];
                }
            }
        }
    }

    /// Joint accelerations \[rad/s² or m/s²\] under `input` and the constraint forces. `state` must be on the
    /// constraints; `workspace` must hold its positions and motion, and still does afterwards.
    pub fn accelerations(
        &mut self,
        state: &State,
        workspace: &mut Workspace,
        input: &Input,
        qdd: &mut DVector<f64>,
    ) {
        if self.closures.is_empty() {
            workspace.accelerations(state, input, qdd);
            return;
        }
        checks::same_robot("the loops", &self.model, "the workspace", workspace.model());
        checks::state(state, &self.model);
        if self.normals_at != state.q {
            self.gap_before = 0.0;
            self.set_normals(workspace, &state.q);
        }
        self.constrained_accelerations(state, workspace, input, qdd);
        if self.normals.rank() < self.rank {
            self.limit_accelerations(state, workspace, input, qdd);
        }
    }

    /// [`Loops::accelerations`] at a state that is not singular.
    pub(super) fn constrained_accelerations(
        &mut self,
        state: &State,
        workspace: &mut Workspace,
        input: &Input,
        qdd: &mut DVector<f64>,
    ) {
        workspace.accelerations(state, input, qdd);
        // The constraint forces must cancel the tree's relative accelerations at the closures.
        workspace.set_accelerations(qdd);
        let mut row = 0;
        for closure in &self.closures {
            let acceleration = closure.acceleration(workspace);
            for direction in closure.directions() {
                self.target[row] =
                    -acceleration[direction as usize] * scale(direction, self.length);
                row += 1;
            }
        }
        self.normals.add_smallest_change(&self.target, qdd);
    }

    /// Projects positions by Newton's method, then sets the normals there.
    pub(super) fn project_positions(&mut self, state: &mut State, workspace: &mut Workspace) {
        workspace.set_positions(&state.q);
        if self.normals_at == state.q {
            return;
        }
        let mut gap = self.set_target(workspace);
        self.gap_before = gap;
        for correction in 0..CORRECTIONS {
            if gap <= CLOSED * self.length || gap.is_nan() {
                break;
            }
            // With a large gap the normals change in each iteration; with a small one, the first ones are sufficient.
            if correction == 0 || gap > 1e-4 * self.length {
                self.set_normals(workspace, &state.q);
            }
            self.change.fill(0.0);
            self.normals
                .add_smallest_change(&self.target, &mut self.change);
            let base = workspace.base_twist(&Momentum::default(), &self.change);
            state.q += &self.change;
            state.R_WB *= exp_so3(&base.angular);
            workspace.set_positions(&state.q);
            let before = gap;
            gap = self.set_target(workspace);
            if gap > 0.5 * before {
                // The remaining gap is rounding, or along a dropped normal.
                break;
            }
        }
        self.set_normals(workspace, &state.q);
    }

    /// Sets `target` to the changes that close the gaps; returns the largest \[m\].
    pub(super) fn set_target(&mut self, workspace: &Workspace) -> f64 {
        let (mut row, mut largest) = (0, 0.0);
        for closure in &self.closures {
            let displacement = closure.displacement(workspace);
            for direction in closure.directions() {
                let open = displacement[direction as usize] * scale(direction, self.length);
                self.target[row] = -open;
                row += 1;
                if open.abs() > largest || open.is_nan() {
                    largest = open.abs();
                }
            }
        }
        largest
    }

    /// Sets the normals at positions `q`, which `workspace` must have.
    pub(super) fn set_normals(&mut self, workspace: &mut Workspace, q: &DVector<f64>) {
        let mut row = 0;
        for closure in &self.closures {
            let (J_A, J_B) = &mut self.jacobians;
            let out = &mut self.gradients;
            closure.gradients(workspace, self.length, (J_A, J_B), row, out);
            row += closure.directions().count();
        }
        let tolerance = (GAPS * self.gap_before / self.length).clamp(DEPENDENT, INDEPENDENT);
        let inertia = workspace.reduced_inertia();
        self.normals.set(inertia, &self.gradients, tolerance);
        self.normals_at.copy_from(q);
    }
}

/// Factor that makes a displacement in `direction` a length: `length` for rotations, 1 for translations.
pub(super) fn scale(direction: super::Direction, length: f64) -> f64 {
    if direction.is_rotation() { length } else { 1.0 }
}
