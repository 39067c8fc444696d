//! Small motion about a state at rest: mass, damping and stiffness matrices, and frequencies.

use fuyu_structures::{HybridModel, StructureError, generalized_eigen};
use nalgebra::{DMatrix, DVector};

use super::{FlexibleState, FlexibleSystem, FlexibleWorkspace, RotorModel};
use crate::spatial::{Twist, Wrench};

/// Linear model of a [`FlexibleSystem`] at one posture, undeformed.
///
/// Coordinates: translation of the base frame along its axes, rotation about them, joints, modes, motor angles, wheel
/// angles.
#[derive(Clone, Debug)]
pub struct LinearModel {
    /// Mass matrix.
    pub mass: DMatrix<f64>,
    /// Damping matrix.
    pub damping: DMatrix<f64>,
    /// Stiffness matrix.
    pub stiffness: DMatrix<f64>,
    pub(super) joints: usize,
    pub(super) modes: usize,
    pub(super) motors: usize,
}

impl LinearModel {
    /// The model at joint positions `q`.
    ///
    /// # Panics
    /// If `q` does not have one element per joint.
    pub fn new(system: &FlexibleSystem, q: &DVector<f64>) -> Self {
        let (joints, modes) = (system.model().dof(), system.modes());
        let motors = system.elastic_joints().len();
        let size = 6 + joints + system.extras();
        let mut unit = FlexibleState::at_rest_with(system, q);
        let mut workspace = FlexibleWorkspace::new(system);
        let mut mass = DMatrix::zeros(size, size);
        for i in 0..size {
            let mut base = [0.0; 6];
            let entry = match i {
                0..6 => &mut base[i],
                _ if i < 6 + joints => &mut unit.tree.qd[i - 6],
                _ => &mut unit.xd[i - 6 - joints],
            };
            *entry = 1.0;
            let [x, y, z, a, b, c] = base;
            let V = Twist::new([a, b, c].into(), [x, y, z].into());
            workspace.set_positions(&unit);
            workspace.nodes[0].V = V;
            workspace.propagate_motion(&unit);
            mass.set_column(i, &workspace.momenta(&unit));
            unit.tree.qd.fill(0.0);
            unit.xd.fill(0.0);
        }
        let mass = (&mass + mass.transpose()) * 0.5;
        let (mut damping, mut stiffness) = (DMatrix::zeros(size, size), DMatrix::zeros(size, size));
        for (j, joint) in system.model().joints().iter().enumerate() {
            damping[(6 + j, 6 + j)] += joint.damping;
            stiffness[(6 + j, 6 + j)] += joint.spring.stiffness;
        }
        for body in system.modal_bodies() {
            let (at, n) = (6 + joints + body.offset, body.modes());
            damping
                .view_mut((at, at), (n, n))
                .copy_from(&body.appendage.modal_damping);
            stiffness
                .view_mut((at, at), (n, n))
                .copy_from(&body.appendage.modal_stiffness);
        }
        let joint_of = &system.compiled().joint_of;
        for (e, (joint, j)) in system.elastic_joints().iter().zip(joint_of).enumerate() {
            let (link, motor) = (6 + j, 6 + joints + modes + e);
            for (m, value) in [
                (&mut damping, joint.damping),
                (&mut stiffness, joint.stiffness),
            ] {
                m[(link, link)] += value;
                m[(motor, motor)] += value;
                m[(link, motor)] -= value;
                m[(motor, link)] -= value;
            }
        }
        for (i, wheel) in system.wheels().iter().enumerate() {
            let at = 6 + joints + modes + motors + i;
            damping[(at, at)] += wheel.viscous_friction;
        }
        Self {
            mass,
            damping,
            stiffness,
            joints,
            modes,
            motors,
        }
    }

    /// Indices of the coordinates of base and modes.
    pub fn base_and_modes(&self) -> Vec<usize> {
        let first = 6 + self.joints;
        (0..6).chain(first..first + self.modes).collect()
    }

    /// Indices of all coordinates but the wheels' angles.
    pub fn without_wheels(&self) -> Vec<usize> {
        (0..6 + self.joints + self.modes + self.motors).collect()
    }

    /// Indices of the wheels' angles.
    pub fn wheels(&self) -> std::ops::Range<usize> {
        6 + self.joints + self.modes + self.motors..self.mass.nrows()
    }

    /// The submatrix of the given coordinates.
    pub fn part(matrix: &DMatrix<f64>, coordinates: &[usize]) -> DMatrix<f64> {
        matrix.select_rows(coordinates).select_columns(coordinates)
    }

    /// Hybrid model of base and modes, with joints, motors and wheels locked, as the constrained hybrid model of Kida
    /// 1993, section 2.3: its transmission zeros and poles are those from wrenches on the base to its position and
    /// attitude.
    ///
    /// # Errors
    /// A mass matrix that is not positive definite.
    pub fn hybrid(&self) -> Result<HybridModel, StructureError> {
        let (base, modes) = ((0, 6), (6 + self.joints, self.modes));
        let block = |matrix: &DMatrix<f64>, rows: (usize, usize), columns: (usize, usize)| {
            (matrix.view((rows.0, columns.0), (rows.1, columns.1))).into_owned()
        };
        HybridModel::with_matrices(
            block(&self.mass, base, base),
            block(&self.mass, modes, base),
            block(&self.mass, modes, modes),
            block(&self.damping, modes, modes),
            block(&self.stiffness, modes, modes),
        )
    }

    /// Undamped frequencies \[Hz\] of the given coordinates while the others are held, ascending, without rigid motion.
    ///
    /// # Errors
    /// A mass matrix that is not positive definite.
    pub fn frequencies_hz(&self, coordinates: &[usize]) -> Result<Vec<f64>, StructureError> {
        let M = Self::part(&self.mass, coordinates);
        let K = Self::part(&self.stiffness, coordinates);
        let values = generalized_eigen(&K, &M)?.values;
        // Rigid motion has the eigenvalue zero, up to rounding.
        let least = 1e-10 * values.max();
        let elastic = values.iter().filter(|value| **value > least);
        Ok(elastic
            .map(|value| value.sqrt() / std::f64::consts::TAU)
            .collect())
    }
}

impl FlexibleWorkspace {
    /// Generalized momenta (mass matrix times rates) of base (translation, then rotation, base axes), joints, modes,
    /// motors and wheels, at the twists of the last [`Self::propagate_motion`].
    fn momenta(&self, state: &FlexibleState) -> DVector<f64> {
        let (joints, modes) = (self.system.model().dof(), self.system.modes());
        let mut momenta = DVector::zeros(6 + joints + self.system.extras());
        let compiled = self.system.compiled();
        let extras = 6 + joints;
        let mut carried = vec![Wrench::ZERO; self.nodes.len()];
        let mut at_section = vec![Wrench::ZERO; self.sections.len()];
        for b in (0..self.nodes.len()).rev() {
            let (body, node) = (&compiled.bodies[b], &self.nodes[b]);
            carried[b] += self.own_momentum(b, state);
            for i in &body.rotors {
                let rotor = &compiled.rotors[*i];
                let spin = rotor.spin(state) + rotor.axis.dot(&node.V.angular);
                momenta[extras + modes + rotor.coordinate] = rotor.ratio * rotor.inertia * spin;
            }
            for i in &body.modal_bodies {
                let range = self.system.modal_bodies()[*i].range();
                let (shape, rates) = (&self.modal[*i].shape, &state.mu_dot()[range.clone()]);
                for (k, place) in range.enumerate() {
                    let own = rates.iter().enumerate();
                    let own: f64 = own.map(|(l, rate)| shape.mass[(k, l)] * rate).sum();
                    momenta[extras + place] = own + node.V.dot(&shape.coupling[k]);
                }
            }
            if let Some(s) = body.section {
                let section = &self.sections[s];
                let first = self.system.modal_bodies()[section.modal_body].offset;
                for (k, column) in section.columns.iter().enumerate() {
                    momenta[extras + first + k] += column.dot(&at_section[s]);
                }
                carried[b] += at_section[s].shifted_to_parent(&section.X_BE);
            }
            if b > 0 {
                momenta[6 + b - 1] = body.along_axis(&carried[b]);
                let of_child = carried[b].shifted_to_parent(&node.X);
                match compiled.carrier(b) {
                    Some(s) => at_section[s] += of_child,
                    None => carried[body.parent] += of_child,
                }
            }
        }
        let Wrench { torque, force } = carried[0];
        for i in 0..3 {
            (momenta[i], momenta[3 + i]) = (force[i], torque[i]);
        }
        for (e, joint) in self.system.elastic_joints().iter().enumerate() {
            if joint.rotor == RotorModel::Reduced {
                momenta[extras + modes + e] = joint.reflected_inertia() * state.xd[modes + e];
            }
        }
        momenta
    }
}
