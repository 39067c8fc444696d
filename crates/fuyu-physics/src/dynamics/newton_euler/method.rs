//! Solution of the equations of motion and constraints of all bodies and hinges.

use nalgebra::{DVector, Vector3};

use super::bodies::Bodies;
use super::gear::Gear;
use super::hinge_motion::{BodyPlacement, HingeMotion};
use super::qr_factorization::QrFactorization;
use super::{Axis, BodyState, System};
use crate::spatial::{Twist, Wrench};

/// Constraints with a relative remainder below this are redundant.
const TOLERANCE: f64 = 1e-8;

/// Efforts, driven accelerations and wrenches on a system, in addition to its springs and dampers.
#[derive(Debug, Clone, PartialEq)]
pub struct Load {
    /// For each hinge, the forces and torques of actuators along its axes \[N, N m\]; they act forward on the outer
    /// body and back on the inner one. Entries of constrained axes are ignored.
    pub efforts: Vec<[f64; 6]>,
    /// For each hinge, the prescribed accelerations of its constrained axes \[m/s², rad/s²\], `α` and `γ` of TR-942
    /// eqs. (2.2.3)-(2.2.4); zero holds them. Entries of free axes are ignored.
    pub driven: Vec<[f64; 6]>,
    /// Force on each body at its centre of mass and torque, body axes: `f_j` and `t_j` of eqs. (2.2.1)-(2.2.2).
    pub wrenches: Vec<Wrench>,
}

impl Load {
    /// Zero load; constrained axes are held.
    pub fn zero(system: &System) -> Self {
        Self {
            efforts: vec![[0.0; 6]; system.hinges.len()],
            driven: vec![[0.0; 6]; system.hinges.len()],
            wrenches: vec![Wrench::ZERO; system.bodies.len()],
        }
    }
}

/// Solves the equations of one system; scratch that every evaluation reuses without allocating.
///
/// The unknowns of TR-942 eq. (2.2.10), accelerations and constraint forces, are found together. The rows of
/// the free axes, whose forces are known (2.2.5), are eliminated first; the others become `Gᵀ z = γ` in
/// accelerations weighted by the roots of the masses, which an orthogonal factorization of `G` solves with the
/// smallest deviation from the unconstrained accelerations (Gauss's principle). In a singular position, where
/// constraints become redundant, the factorization reveals the rank and omits the redundant ones.
#[derive(Debug, Clone)]
pub struct MatrixMethod {
    pub(super) bodies: Bodies,
    pub(super) motions: Vec<HingeMotion>,
    /// Constrained axes, hinge by hinge, and their columns' lengths.
    constrained: Vec<(usize, Axis)>,
    /// The gears, whose constraints follow those of the axes.
    gears: Vec<Gear>,
    lengths: Vec<f64>,
    columns: QrFactorization,
    tolerance: f64,
    /// Weighted accelerations, linear and angular of each body in turn.
    pub(super) z: Vec<f64>,
    right: Vec<f64>,
    pivoted: Vec<f64>,
    efforts: Vec<[f64; 6]>,
}

impl MatrixMethod {
    /// Scratch for `system`.
    pub fn new(system: &System) -> Self {
        let axes = (0..system.hinges.len()).flat_map(|i| Axis::ALL.map(|axis| (i, axis)));
        let constrained: Vec<_> = axes.filter(|(i, axis)| system.holds(*i, *axis)).collect();
        let rest = vec![0.0; system.state_len()];
        let columns = constrained.len() + system.gears.len();
        let rows = 6 * system.bodies.len();
        Self {
            bodies: Bodies::new(system),
            motions: (0..system.hinges.len())
                .map(|i| system.hinge_motion(&rest, i))
                .collect(),
            constrained,
            gears: system.gears.clone(),
            lengths: vec![0.0; columns],
            columns: QrFactorization::new(rows, columns),
            tolerance: TOLERANCE,
            z: vec![0.0; rows],
            right: vec![0.0; columns],
            pivoted: vec![0.0; rows.max(columns)],
            efforts: vec![[0.0; 6]; system.hinges.len()],
        }
    }

    /// Sets the tolerance below which a constraint is redundant: the fraction of its mass-weighted length that is
    /// independent of the others. The default is 1e-8. A system that passes singular positions needs 1e-5 to 1e-4, more
    /// at higher speed: within a step loops are slightly open, so that nearly redundant constraints contradict each
    /// other. A light body between heavy ones needs less than the square root of the ratio of masses.
    pub fn with_tolerance(mut self, tolerance: f64) -> Self {
        self.tolerance = tolerance;
        self
    }

    /// Accelerations of all bodies and forces in all hinges, under `load`, of a system in `state`.
    ///
    /// # Panics
    /// If `state` or `load` is of another system.
    pub fn solve(&mut self, system: &System, state: &[f64], load: &Load) {
        self.set_motion(system, state);
        self.set_unconstrained(system, load);
        self.set_right_hand_side(0.0, |motion, i, k| {
            // Prescribed accelerations of free axes are ignored.
            let is_free = system.hinges[i].freedom.is_free(Axis::ALL[k]);
            (if is_free { 0.0 } else { load.driven[i][k] }) - motion.bias[k]
        });
        self.constrain(system);
        for ((i, axis), force) in self.constrained.iter().zip(&self.right) {
            self.efforts[*i][axis.index()] = *force;
        }
        let multipliers = &self.right[self.constrained.len()..];
        for (gear, multiplier) in self.gears.iter().zip(multipliers) {
            for (i, axis, weight) in gear.ends() {
                self.efforts[i][axis.index()] += weight * multiplier;
            }
        }
    }

    /// Time derivative of the state, 13 numbers per body: the solution of TR-942 eq. (2.2.10) and the kinematic equations.
    /// The results of [`MatrixMethod::solve`] can be read afterwards.
    ///
    /// # Panics
    /// If `state`, `load` or `rates` is of another system.
    pub fn derivative(&mut self, system: &System, state: &[f64], load: &Load, rates: &mut [f64]) {
        self.solve(system, state, load);
        for b in 0..system.bodies.len() {
            let at = BodyState::read(state, b);
            let acceleration = self.acceleration(b);
            let (p_WC, Q_WB) = at.rates();
            let rate = BodyState {
                p_WC,
                Q_WB,
                v_WC_B: acceleration.linear - at.w_WB_B.cross(&at.v_WC_B),
                w_WB_B: acceleration.angular,
            };
            rate.write(rates, b);
        }
    }

    /// Angular acceleration of body `body` and acceleration of its centre of mass, body axes.
    pub fn acceleration(&self, body: usize) -> Twist {
        self.bodies.motion(body, &self.z)
    }

    /// Accelerations along and about the axes of a hinge, in the order of [`Axis::ALL`].
    pub fn hinge_acceleration(&self, system: &System, hinge: usize) -> [f64; 6] {
        let motion = &self.motions[hinge];
        Axis::ALL.map(|axis| {
            let bodies = self.bodies.acted_on(&system.joined[hinge], motion, axis);
            let moved = bodies.map(|(b, unit)| self.acceleration(b).dot(&unit));
            moved.sum::<f64>() + motion.bias[axis.index()]
        })
    }

    /// Forces and torques that the hinge transmits along and about its axes \[N, N m\], in the order of
    /// [`Axis::ALL`]: those of constraints, and of springs, dampers and actuators on free axes. They push the
    /// outer body forward. (TR-942 defines `f` as acting on the inner body, but eq. (2.2.20) is a restoring
    /// force only for the outer.)
    pub fn hinge_efforts(&self, hinge: usize) -> &[f64; 6] {
        &self.efforts[hinge]
    }

    /// Wrench of the inner body on the outer through the hinge, about N's origin in M's axes.
    pub fn hinge_wrench(&self, system: &System, hinge: usize) -> Wrench {
        let (efforts, joined) = (&self.efforts[hinge], &system.joined[hinge]);
        let inner = self.bodies.get(joined.inner);
        let directions = &self.motions[hinge].directions;
        let sum = |axes: std::ops::Range<usize>| -> Vector3<f64> {
            let sum_W: Vector3<f64> = axes.map(|k| directions[k] * efforts[k]).sum();
            joined.R_BM.inverse() * inner.R.tr_mul(&sum_W)
        };
        Wrench::new(sum(3..6), sum(0..3))
    }

    /// Number of independent constraints in the last solution.
    pub fn rank(&self) -> usize {
        self.columns.rank
    }

    pub(super) fn set_motion(&mut self, system: &System, state: &[f64]) {
        for (b, placed) in self.bodies.placed.iter_mut().enumerate() {
            *placed = BodyPlacement::new(&BodyState::read(state, b));
        }
        for (i, motion) in self.motions.iter_mut().enumerate() {
            let joined = &system.joined[i];
            let inner = self.bodies.get(joined.inner);
            let outer = self.bodies.get(joined.outer);
            *motion = HingeMotion::new(&system.hinges[i], joined, &inner, &outer);
        }
    }

    /// Mass-weighted accelerations without constraints: eqs. (2.2.14)-(2.2.17), (2.2.20)-(2.2.21).
    fn set_unconstrained(&mut self, system: &System, load: &Load) {
        self.z.fill(0.0);
        for (b, (body, wrench)) in system.bodies.iter().zip(&load.wrenches).enumerate() {
            let at = &self.bodies.placed[b];
            let w = at.R.tr_mul(&at.w);
            let torque = wrench.torque - w.cross(&(body.inertia.about_com * w));
            let wrench = Wrench::new(torque, wrench.force);
            self.bodies.add_weighted(b, &wrench, &mut self.z);
        }
        for (i, hinge) in system.hinges.iter().enumerate() {
            let (joined, motion) = (&system.joined[i], &self.motions[i]);
            for axis in Axis::ALL.into_iter().filter(|a| hinge.freedom.is_free(*a)) {
                let k = axis.index();
                let (spring, y) = (&hinge.springs[k], motion.displacement[k]);
                let passive =
                    spring.stiffness * (spring.rest - y) - hinge.damping[k] * motion.rate[k];
                let effort = passive + load.efforts[i][k];
                self.efforts[i][k] = effort;
                if effort != 0.0 {
                    for (b, unit) in self.bodies.acted_on(joined, motion, axis) {
                        self.bodies.add_weighted(b, &(unit * effort), &mut self.z);
                    }
                }
            }
        }
    }

    /// Sets `G = L⁻¹Jᵀ`, with its columns normalized.
    fn set_columns(&mut self, system: &System) {
        self.columns.clear();
        for (j, (i, axis)) in self.constrained.iter().enumerate() {
            let (column, motion) = (self.columns.column_mut(j), &self.motions[*i]);
            for (b, unit) in self.bodies.acted_on(&system.joined[*i], motion, *axis) {
                self.bodies.add_weighted(b, &unit, column);
            }
            self.lengths[j] = normalize(column);
        }
        for (j, gear) in (self.constrained.len()..).zip(&self.gears) {
            let column = self.columns.column_mut(j);
            for (i, axis, weight) in gear.ends() {
                let motion = &self.motions[i];
                for (b, unit) in self.bodies.acted_on(&system.joined[i], motion, axis) {
                    self.bodies.add_weighted(b, &(unit * weight), column);
                }
            }
            self.lengths[j] = normalize(column);
        }
    }

    /// The columns of `G` for a system in `state`, in the order of the hinges, each with its hinge and axis.
    pub(super) fn constraint_columns(
        &mut self,
        system: &System,
        state: &[f64],
    ) -> Vec<(usize, Axis, DVector<f64>)> {
        self.set_motion(system, state);
        self.set_columns(system);
        let columns = self.constrained.iter().enumerate();
        columns
            .map(|(j, (i, axis))| {
                let column = self.columns.column_mut(j);
                (*i, *axis, DVector::from_column_slice(column))
            })
            .collect()
    }

    /// Sets the right-hand side of the constraints; returns its largest entry. The entry of a gear combines the values
    /// of its two axes as its constraint does, plus `offset` times its offset.
    pub(super) fn set_right_hand_side(
        &mut self,
        offset: f64,
        value: impl Fn(&HingeMotion, usize, usize) -> f64,
    ) -> f64 {
        let mut largest = 0.0_f64;
        let motions = &self.motions;
        let of_axes = self.constrained.iter();
        let of_axes = of_axes.map(|(i, axis)| value(&motions[*i], *i, axis.index()));
        let of_gears = self.gears.iter().map(|gear| {
            let ends = gear.ends().into_iter();
            let values = ends.map(|(i, axis, weight)| weight * value(&motions[i], i, axis.index()));
            values.sum::<f64>() + offset * gear.offset
        });
        for (right, value) in self.right.iter_mut().zip(of_axes.chain(of_gears)) {
            *right = value;
            // NaN if one of them is NaN.
            if right.abs().total_cmp(&largest).is_gt() {
                largest = right.abs();
            }
        }
        largest
    }

    /// Applies to `z` the smallest change that satisfies the constraints; `right` becomes their multipliers. A redundant
    /// constraint is omitted, and its multiplier is zero.
    pub(super) fn constrain(&mut self, system: &System) {
        self.set_columns(system);
        self.columns.factor(self.tolerance);
        let (rank, order) = (self.columns.rank, &self.columns.order);
        let pivoted = &mut self.pivoted[..rank];
        for (pivoted, j) in pivoted.iter_mut().zip(order) {
            *pivoted = self.right[*j] / self.lengths[*j];
        }
        self.columns.solve_transposed(pivoted);
        self.columns.transpose_multiply(&mut self.z);
        for (pivoted, z) in pivoted.iter_mut().zip(&mut self.z) {
            (*pivoted, *z) = (*pivoted - *z, *pivoted);
        }
        self.columns.multiply(&mut self.z);
        self.columns.solve(pivoted);
        self.right.fill(0.0);
        for (pivoted, j) in pivoted.iter().zip(order) {
            self.right[*j] = *pivoted / self.lengths[*j];
        }
    }
}

/// Divides a column by its length, which it returns.
fn normalize(column: &mut [f64]) -> f64 {
    let length = column.iter().map(|x| x * x).sum::<f64>().sqrt();
    column.iter_mut().for_each(|x| *x /= length);
    length
}
