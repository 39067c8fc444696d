//! State of a robot with flexible parts.

use nalgebra::{DVector, Vector3};

use super::FlexibleSystem;
use crate::dynamics::{Dissipated, Input, Momentum, State};
use crate::spatial::Wrench;

/// State of a [`FlexibleSystem`].
///
/// `tree` contains joints, attitude, centre of mass and momentum of the whole system: the momentum includes modal
/// rates, motor rotors and wheels, so that internal motion never changes it. `tree.work` is the work of joint efforts
/// (at the motors of elastic joints), springs and dampers of the description, wheel motors, external wrenches and
/// thrusters. Kinetic plus strain energy is `work - losses().total()`, up to a constant.
#[derive(Clone, Debug, PartialEq)]
pub struct FlexibleState {
    /// Joints, base attitude, centre of mass, momentum of the whole system, work.
    pub tree: State,
    /// Modal coordinates, motor angles of elastic joints, wheel angles.
    pub(super) x: DVector<f64>,
    /// Rates of `x`.
    pub(super) xd: DVector<f64>,
    pub(super) losses: Losses,
    pub(super) partial_work: PartialWork,
    /// For each thruster, the remaining time until it switches off \[s\].
    pub(super) on_time: Vec<f64>,
    /// Time since each thruster's valve opened \[s\]; zero if it is closed.
    pub(super) open_for: Vec<f64>,
    /// For each thruster, its impulse so far \[N s\].
    pub(super) impulse: Vec<f64>,
    modes: usize,
    motors: usize,
}

/// Energy that damping has dissipated since the start, by cause \[J\].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Losses {
    /// Loss in modal damping.
    pub modal_damping: f64,
    /// Loss in the damping of elastic joints.
    pub elastic_joints: f64,
    /// Loss in the bearings of wheels.
    pub wheel_friction: f64,
}

impl Losses {
    /// Sum of all losses \[J\].
    pub fn total(&self) -> f64 {
        self.modal_damping + self.elastic_joints + self.wheel_friction
    }

    pub(super) fn add_scaled(&mut self, rate: &Self, k: f64) {
        self.modal_damping += rate.modal_damping * k;
        self.elastic_joints += rate.elastic_joints * k;
        self.wheel_friction += rate.wheel_friction * k;
    }
}

/// Parts of the work done since the start \[J\].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PartialWork {
    /// Work of the wheels' motors.
    pub wheel_motors: f64,
    /// Work of external wrenches and thrusters.
    pub external: f64,
}

impl PartialWork {
    pub(super) fn add_scaled(&mut self, rate: &Self, k: f64) {
        self.wheel_motors += rate.wheel_motors * k;
        self.external += rate.external * k;
    }
}

impl FlexibleState {
    /// A state at rest and undeformed at joint positions `q`, with the base frame at the world's origin and along its
    /// axes.
    ///
    /// # Panics
    /// If `q` does not have one element per joint.
    pub fn at_rest_with(system: &FlexibleSystem, q: &DVector<f64>) -> Self {
        assert_eq!(
            q.len(),
            system.model().dof(),
            "q must have one element per joint"
        );
        let modes = system.modes();
        let motors = system.elastic_joints().len();
        let n = system.extras();
        let thrusters = system.thrusters().len();
        let mut state = Self {
            tree: State {
                time: 0.0,
                R_WB: nalgebra::UnitQuaternion::identity(),
                p_WC: Vector3::zeros(),
                momentum_W: Momentum::default(),
                q: q.clone(),
                qd: DVector::zeros(q.len()),
                work: 0.0,
                dissipated: Dissipated::default(),
            },
            x: DVector::zeros(n),
            xd: DVector::zeros(n),
            losses: Losses::default(),
            partial_work: PartialWork::default(),
            on_time: vec![0.0; thrusters],
            open_for: vec![0.0; thrusters],
            impulse: vec![0.0; thrusters],
            modes,
            motors,
        };
        state.unwind_joints(system);
        let mut workspace = super::FlexibleWorkspace::new(system);
        workspace.set_positions(&state);
        state.tree.p_WC = *workspace.p_BC();
        state
    }

    /// [`FlexibleState::at_rest_with`] all joint positions zero.
    pub fn at_rest(system: &FlexibleSystem) -> Self {
        Self::at_rest_with(system, &DVector::zeros(system.model().dof()))
    }

    /// Modal coordinates μ \[kg^1/2 m for mass-normalised modes\], in the order of [`FlexibleSystem::modal_bodies`].
    pub fn mu(&self) -> &[f64] {
        &self.x.as_slice()[..self.modes]
    }

    /// Modal coordinates, mutable. [`FlexibleState::set_base`] then moves the base back to its pose.
    pub fn mu_mut(&mut self) -> &mut [f64] {
        &mut self.x.as_mut_slice()[..self.modes]
    }

    /// Modal rates.
    pub fn mu_dot(&self) -> &[f64] {
        &self.xd.as_slice()[..self.modes]
    }

    /// Modal rates, mutable.
    pub fn mu_dot_mut(&mut self) -> &mut [f64] {
        &mut self.xd.as_mut_slice()[..self.modes]
    }

    /// Motor angles of the elastic joints on the output side \[rad\], in the order of
    /// [`FlexibleSystem::elastic_joints`].
    pub fn motor_angles(&self) -> &[f64] {
        &self.x.as_slice()[self.modes..self.modes + self.motors]
    }

    /// Motor angles, mutable.
    pub fn motor_angles_mut(&mut self) -> &mut [f64] {
        &mut self.x.as_mut_slice()[self.modes..self.modes + self.motors]
    }

    /// Motor rates \[rad/s\], on the output side.
    pub fn motor_rates(&self) -> &[f64] {
        &self.xd.as_slice()[self.modes..self.modes + self.motors]
    }

    /// Motor rates, mutable.
    pub fn motor_rates_mut(&mut self) -> &mut [f64] {
        &mut self.xd.as_mut_slice()[self.modes..self.modes + self.motors]
    }

    /// Angles of the wheels relative to their bodies since the start \[rad\].
    pub fn wheel_angles(&self) -> &[f64] {
        &self.x.as_slice()[self.modes + self.motors..]
    }

    /// Speeds of the wheels relative to their bodies \[rad/s\].
    pub fn wheel_speeds(&self) -> &[f64] {
        &self.xd.as_slice()[self.modes + self.motors..]
    }

    /// Wheel speeds, mutable.
    pub fn wheel_speeds_mut(&mut self) -> &mut [f64] {
        &mut self.xd.as_mut_slice()[self.modes + self.motors..]
    }

    /// Sets the motors of elastic joints to the positions and rates of their joints: no joint is wound up.
    ///
    /// # Panics
    /// If the state is of another system.
    pub fn unwind_joints(&mut self, system: &FlexibleSystem) {
        assert!(self.fits(system), "the state is of another system");
        for (e, j) in system.compiled().joint_of.iter().enumerate() {
            self.x[self.modes + e] = self.tree.q[*j];
            self.xd[self.modes + e] = self.tree.qd[*j];
        }
    }

    /// Energy that damping has dissipated.
    pub fn losses(&self) -> &Losses {
        &self.losses
    }

    /// The parts of `tree.work` done by wheel motors and by external wrenches and thrusters.
    pub fn partial_work(&self) -> &PartialWork {
        &self.partial_work
    }

    /// Stops all internal motion: joints, modes and motors of elastic joints, at their present positions. Wheel speeds
    /// and momentum do not change; the base's motion follows from both.
    pub fn stop_internal_motion(&mut self) {
        self.tree.qd.fill(0.0);
        self.xd.rows_mut(0, self.modes + self.motors).fill(0.0);
    }

    /// Stops all motion: internal motion, wheels, and, by zero momentum, the base. Closes the valves.
    pub fn stop(&mut self) {
        self.tree.qd.fill(0.0);
        self.xd.fill(0.0);
        self.tree.momentum_W = Momentum::default();
        self.close_valves();
    }

    /// Closes the valves of all thrusters at once.
    pub fn close_valves(&mut self) {
        self.on_time.fill(0.0);
        self.open_for.fill(0.0);
    }

    /// Remaining time until each thruster switches off \[s\].
    pub fn on_times(&self) -> &[f64] {
        &self.on_time
    }

    /// Impulse of each thruster since the start \[N s\]; the propellant used is the impulse divided by the exhaust
    /// speed.
    pub fn thruster_impulses(&self) -> &[f64] {
        &self.impulse
    }

    /// Opens the valve of thruster `i` for `duration` \[s\] from now, which replaces an earlier command; a duration of
    /// zero or less closes the valve. An open valve stays open at least for its shortest on-time.
    ///
    /// # Panics
    /// If there are fewer thrusters, or `duration` is not finite.
    pub fn fire(&mut self, system: &FlexibleSystem, i: usize, duration: f64) {
        let thruster = &system.thrusters()[i];
        assert!(
            duration.is_finite(),
            "duration must be finite, not {duration}"
        );
        let is_open = self.on_time[i] > 0.0;
        let least = (thruster.min_on_time - self.open_for[i]).max(0.0);
        self.on_time[i] = match duration > 0.0 || is_open {
            true => duration.max(least),
            false => 0.0,
        };
        if self.on_time[i] == 0.0 {
            self.open_for[i] = 0.0;
        }
    }

    /// Copies `other`'s values without allocating.
    ///
    /// # Panics
    /// If the two are not of one system.
    pub fn copy_from(&mut self, other: &Self) {
        self.tree.copy_from(&other.tree);
        self.x.copy_from(&other.x);
        self.xd.copy_from(&other.xd);
        self.losses = other.losses;
        self.partial_work = other.partial_work;
        self.on_time.copy_from_slice(&other.on_time);
        self.open_for.copy_from_slice(&other.open_for);
        self.impulse.copy_from_slice(&other.impulse);
    }

    /// Whether all numbers of the state are finite.
    pub fn is_finite(&self) -> bool {
        self.tree.is_finite()
            && self.losses.total().is_finite()
            && self.x.iter().chain(&self.xd).all(|x| x.is_finite())
            && self.on_time.iter().all(|x| x.is_finite())
    }

    /// Rates of the motors, then of the wheels.
    pub(super) fn rotor_rates(&self) -> &[f64] {
        &self.xd.as_slice()[self.modes..]
    }

    pub(super) fn fits(&self, system: &FlexibleSystem) -> bool {
        self.tree.q.len() == system.model().dof()
            && self.tree.qd.len() == system.model().dof()
            && self.modes == system.modes()
            && self.motors == system.elastic_joints().len()
            && self.x.len() == system.extras()
            && self.on_time.len() == system.thrusters().len()
    }
}

/// Input of a robot with flexible parts: efforts, torques, wrenches.
#[derive(Clone, Debug, PartialEq)]
pub struct FlexibleInput {
    /// Joint efforts (of elastic joints: of the motor, on the output side) and external wrenches. A wrench on an
    /// elastic link is about the origin and in the axes of the link's frame
    /// ([`FlexibleWorkspace::X_BF`](super::FlexibleWorkspace::X_BF)), which moves with the section that carries the
    /// next link.
    pub tree: Input,
    /// Torques commanded to the wheels' motors \[N m\], before their limits.
    pub wheel_torques: DVector<f64>,
}

impl FlexibleInput {
    /// Zero input.
    pub fn zero(system: &FlexibleSystem) -> Self {
        Self {
            tree: Input::zero(system.model()),
            wheel_torques: DVector::zeros(system.wheels().len()),
        }
    }

    /// Copies `other`'s values without allocating.
    ///
    /// # Panics
    /// If the two are not of one system.
    pub fn copy_from(&mut self, other: &Self) {
        self.tree.copy_from(&other.tree);
        self.wheel_torques.copy_from(&other.wheel_torques);
    }

    pub(super) fn has_wrench(&self) -> bool {
        Wrench::any(&self.tree.wrenches)
    }
}
