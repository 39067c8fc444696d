//! The equations of motion of several floating systems in contact.
//!
//! The state of each system is its attitude relative to the start of the step, centre of mass, joint positions, joint
//! rates, and momentum; the angular momentum of all systems is taken about one common point. A contact force then
//! changes two momenta by exactly opposite amounts. Total momentum is a linear function of this state, so any
//! Runge-Kutta method conserves it.

use std::ops::Range;

use nalgebra::{DVector, UnitQuaternion, Vector3};

use super::law::ContactLaw;
use super::shape::Shape;
use super::touch::{self, Touch};
use crate::dynamics::rate::turn;
use crate::dynamics::{Floating, ForwardDynamics, Input, State, TreeAcceleration, Workspace};
use crate::spatial::{Pose, Wrench};

/// Distance \[m\] of the bounding spheres of two shapes above which contact points are not computed.
const FAR: f64 = 0.1;

/// A shape fixed to a body.
#[derive(Debug, Clone)]
pub(super) struct Collider {
    pub system: usize,
    pub body: usize,
    pub X_BS: Pose,
    pub shape: Shape,
    /// Name in messages, if it is not that of the body.
    pub name: Option<String>,
    /// Pose in the world.
    pub X_WS: Pose,
}

/// Two colliders that may touch.
#[derive(Debug, Clone)]
pub(super) struct Pair {
    pub first: usize,
    pub second: usize,
    pub law: ContactLaw,
    /// Indices of its contact points.
    pub points: Range<usize>,
    /// Whether the pair is ignored until all its points have separated.
    pub is_suspended: bool,
}

/// Contact mode of a point; it changes only at events, so that forces are smooth in between.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Mode {
    Apart,
    Touching,
    /// In contact, but separating so fast that the force is zero.
    Parting,
}

/// A possible contact point.
#[derive(Debug, Clone)]
pub(super) struct Point {
    pub touch: Touch,
    pub mode: Mode,
    /// Rate of the depth \[m/s\].
    pub rate: f64,
    /// Where the forces act, world.
    pub at: Vector3<f64>,
    /// Force on the first body, world axes \[N\], and its normal part.
    pub force: Vector3<f64>,
    pub normal_force: f64,
    /// Velocity of the first body relative to the second along the surface, world axes.
    pub slip: Vector3<f64>,
    /// Power of the forces on the first and the second body \[W\].
    pub power: [f64; 2],
    /// Index of the bristle's deflection in the state vector.
    pub deflection: Option<usize>,
}

/// A system in the scene.
#[derive(Debug, Clone)]
pub(super) struct Member {
    pub state: State,
    pub workspace: Workspace,
    pub dynamics: ForwardDynamics,
    /// Held efforts and wrenches, and the same with contact forces added.
    pub held: Input,
    pub input: Input,
    pub out: TreeAcceleration,
    /// Attitude at the start of the step.
    pub R_start: UnitQuaternion<f64>,
    /// Index of the first entry in the state vector, and of the entries of work, dissipation, and contact work.
    pub offset: usize,
    pub quadrature: usize,
    /// Force of contacts on each body, and torque about its origin; world axes.
    pub loads: Vec<Wrench>,
    /// Poses of the bodies.
    pub X_WB: Vec<Pose>,
}

/// Number of entries of a system that are integrals over time: work, dissipation, and contact work.
const QUADRATURES: usize = 3;

impl Member {
    fn new(system: &Floating) -> Self {
        let model = system.model();
        Self {
            state: system.state().clone(),
            workspace: system.workspace().clone(),
            dynamics: ForwardDynamics::articulated_body(model),
            held: Input::zero(model),
            input: Input::zero(model),
            out: TreeAcceleration::zero(model),
            R_start: system.state().R_WB,
            offset: 0,
            quadrature: 0,
            loads: vec![Wrench::ZERO; model.bodies().len()],
            X_WB: vec![Pose::identity(); model.bodies().len()],
        }
    }

    fn dof(&self) -> usize {
        self.state.q.len()
    }

    /// Velocity of the point `p` of body `b`, world axes.
    fn velocity(&self, b: usize, p: &Vector3<f64>) -> Vector3<f64> {
        let twist = &self.workspace.bodies[b].twist;
        let X_WB = &self.X_WB[0];
        let from_origin = X_WB
            .rotation
            .inverse_transform_vector(&(p - X_WB.translation.vector))
            - self.workspace.p_BK(b);
        X_WB.rotation * (twist.linear + twist.angular.cross(&from_origin))
    }
}

/// Several floating systems and their contacts.
#[derive(Debug, Clone)]
pub(super) struct Scene {
    pub members: Vec<Member>,
    pub colliders: Vec<Collider>,
    pub pairs: Vec<Pair>,
    pub points: Vec<Point>,
    /// Common reference point of the angular momenta.
    pub origin: Vector3<f64>,
    /// For each entry of the state vector, the size of one unit of error.
    pub scale: Vec<f64>,
    touches: Vec<Touch>,
}

impl Scene {
    pub fn new<'a>(systems: impl Iterator<Item = &'a Floating>) -> Self {
        Self {
            members: systems.map(Member::new).collect(),
            colliders: Vec::new(),
            pairs: Vec::new(),
            points: Vec::new(),
            origin: Vector3::zeros(),
            scale: Vec::new(),
            touches: Vec::new(),
        }
    }

    /// Assigns the indices of the state vector; returns its length.
    pub fn assign(&mut self, tolerance: f64) -> usize {
        let mut next = 0;
        for member in &mut self.members {
            member.offset = next;
            next += 12 + 2 * member.dof();
        }
        let deflections = next;
        self.points.clear();
        let mut most = 0;
        for pair in &mut self.pairs {
            let count = touch::count(
                &self.colliders[pair.first].shape,
                &self.colliders[pair.second].shape,
            );
            pair.points = self.points.len()..self.points.len() + count;
            most = most.max(count);
            for _ in 0..count {
                let deflection = pair.law.bristle.is_some().then_some(next);
                next += if deflection.is_some() { 3 } else { 0 };
                self.points.push(Point {
                    touch: Touch::NONE,
                    mode: Mode::Apart,
                    rate: 0.0,
                    at: Vector3::zeros(),
                    force: Vector3::zeros(),
                    normal_force: 0.0,
                    slip: Vector3::zeros(),
                    power: [0.0; 2],
                    deflection,
                });
            }
        }
        self.touches = vec![Touch::NONE; most];
        let quadratures = next;
        for member in &mut self.members {
            member.quadrature = next;
            next += QUADRATURES;
        }
        // In units of one metre, radian, metre per second or radian per second; momentum as at these speeds.
        self.scale = vec![tolerance; next];
        for member in &self.members {
            let (mass, inverse) = (
                member.workspace.mass,
                member.workspace.H_B_inverse.to_matrix(),
            );
            let inertia = 1.0 / inverse.diagonal().max();
            let momenta = member.offset + 6 + member.dof();
            self.scale[momenta..momenta + 3].fill(tolerance * mass);
            self.scale[momenta + 3..momenta + 6].fill(tolerance * inertia);
            self.scale[member.quadrature..][..QUADRATURES].fill(tolerance * mass);
        }
        for pair in &self.pairs {
            let Some(bristle) = &pair.law.bristle else {
                continue;
            };
            for point in &self.points[pair.points.clone()] {
                let Some(at) = point.deflection else { continue };
                self.scale[at..at + 3].fill(tolerance / bristle.stiffness.max(1.0));
            }
        }
        debug_assert!(deflections <= quadratures);
        next
    }

    /// Copies the state of every system, and writes it to the state vector `y`.
    pub fn start<'a>(&mut self, systems: impl Iterator<Item = &'a State>, y: &mut [f64]) {
        for (member, state) in self.members.iter_mut().zip(systems) {
            member.state.copy_from(state);
        }
        let masses = self.members.iter().map(|m| m.workspace.mass);
        let total: f64 = masses.sum();
        let weighted = self.members.iter().map(|m| m.state.p_WC * m.workspace.mass);
        self.origin = weighted.sum::<Vector3<f64>>() / total;
        for member in &mut self.members {
            let (state, n) = (&member.state, member.dof());
            member.R_start = state.R_WB;
            let part = &mut y[member.offset..][..12 + 2 * n];
            part[..3].fill(0.0);
            part[3..6].copy_from_slice((state.p_WC - self.origin).as_slice());
            part[6..6 + n].copy_from_slice(state.q.as_slice());
            let momentum = &state.momentum_W;
            let angular = momentum.angular + (state.p_WC - self.origin).cross(&momentum.linear);
            part[6 + n..9 + n].copy_from_slice(momentum.linear.as_slice());
            part[9 + n..12 + n].copy_from_slice(angular.as_slice());
            part[12 + n..].copy_from_slice(state.qd.as_slice());
            y[member.quadrature..][..QUADRATURES].fill(0.0);
        }
    }

    /// Makes the attitudes of `y` the new reference attitudes.
    pub fn turn_on(&mut self, y: &mut [f64]) {
        for member in &mut self.members {
            let turned = &mut y[member.offset..][..3];
            member.R_start = turn(&member.R_start, &Vector3::from_column_slice(turned));
            member.R_start.renormalize_fast();
            turned.fill(0.0);
        }
    }

    /// Writes the state of system `i` in `y` to `state`, with work and dissipation so far.
    pub fn read(&self, i: usize, y: &[f64], state: &mut State) {
        let member = &self.members[i];
        set_state(member, &self.origin, y, state);
        state.work += y[member.quadrature];
        state.dissipated.damping += y[member.quadrature + 1];
    }

    /// Work of contacts on system `i` in `y` \[J\].
    pub fn contact_work(&self, i: usize, y: &[f64]) -> f64 {
        y[self.members[i].quadrature + 2]
    }

    /// Computes poses, velocities and contact geometry at `y`.
    pub fn locate(&mut self, y: &[f64]) {
        for member in &mut self.members {
            let mut state = std::mem::replace(&mut member.state, State::empty());
            set_state(member, &self.origin, y, &mut state);
            let workspace = &mut member.workspace;
            workspace.set_positions(&state.q);
            workspace.set_motion(&state);
            member.X_WB[0] = state.X_WB(workspace);
            for b in 1..member.X_WB.len() {
                member.X_WB[b] = member.X_WB[0] * workspace.X_0B(b);
            }
            member.state = state;
            member.loads.fill(Wrench::ZERO);
        }
        for collider in &mut self.colliders {
            collider.X_WS = self.members[collider.system].X_WB[collider.body] * collider.X_BS;
        }
    }

    /// Computes the contact forces at `y` in the present modes.
    pub fn touch(&mut self, y: &[f64]) {
        for pair in &self.pairs {
            let (first, second) = (&self.colliders[pair.first], &self.colliders[pair.second]);
            let points = &mut self.points[pair.points.clone()];
            let gap = bound_of_gap(first, second);
            if gap > FAR && points.iter().all(|point| point.mode == Mode::Apart) {
                for point in points {
                    point.touch = Touch { gap, ..Touch::NONE };
                    (point.force, point.normal_force) = (Vector3::zeros(), 0.0);
                    point.power = [0.0; 2];
                }
                continue;
            }
            let found = &mut self.touches[..pair.points.len()];
            touch::find(
                (&first.shape, &first.X_WS),
                (&second.shape, &second.X_WS),
                found,
            );
            for (point, touch) in points.iter_mut().zip(found) {
                point.touch = *touch;
                let depth = -touch.gap;
                let law = &pair.law;
                // The normal points from the second body to the first; the fraction of the depth is counted from the
                // first one's side.
                let (normal, weight) = match touch.of_second {
                    false => (touch.normal, law.point_weight),
                    true => (-touch.normal, 1.0 - law.point_weight),
                };
                let reach = if depth.is_finite() {
                    touch.radius - weight * depth
                } else {
                    touch.radius
                };
                point.at = touch.centre - touch.normal * reach;
                let of = |collider: &Collider| {
                    self.members[collider.system].velocity(collider.body, &point.at)
                };
                let velocities = [of(first), of(second)];
                let relative = velocities[0] - velocities[1];
                point.rate = -normal.dot(&relative);
                point.slip = relative + normal * point.rate;
                (point.force, point.normal_force) = (Vector3::zeros(), 0.0);
                point.power = [0.0; 2];
                if point.mode != Mode::Touching || !depth.is_finite() {
                    continue;
                }
                point.normal_force =
                    law.elastic_force(depth) * (1.0 + law.dissipation * point.rate);
                let friction = match (&law.bristle, point.deflection) {
                    (Some(bristle), Some(at)) => {
                        let R_W2 = &self.members[second.system].X_WB[second.body].rotation;
                        let z = R_W2 * Vector3::from_column_slice(&y[at..at + 3]);
                        let z = z - normal * normal.dot(&z);
                        let rate = law.deflection_rate(bristle, &point.slip, &z);
                        (z * bristle.stiffness + rate * bristle.damping) * -point.normal_force
                    }
                    _ => law.friction_force(point.normal_force, &point.slip),
                };
                point.force = normal * point.normal_force + friction;
                let [of_first, of_second] = velocities.map(|v| point.force.dot(&v));
                point.power = [of_first, -of_second];
            }
        }
    }

    /// Computes contacts at `y`, but no accelerations.
    pub fn look(&mut self, y: &[f64]) {
        self.locate(y);
        self.touch(y);
    }

    /// Largest violation of the contact modes: positive if at least one mode should have changed.
    pub fn violation(&self) -> f64 {
        let mut worst = f64::NEG_INFINITY;
        for pair in self.pairs.iter().filter(|pair| !pair.is_suspended) {
            for point in &self.points[pair.points.clone()] {
                worst = worst.max(violation(point, &pair.law));
            }
        }
        worst
    }

    /// Ends the suspension of pairs whose points are all apart.
    pub fn resume_pairs(&mut self) {
        for pair in self.pairs.iter_mut().filter(|pair| pair.is_suspended) {
            let mut points = self.points[pair.points.clone()].iter();
            pair.is_suspended = points.any(|point| point.touch.gap < 0.0);
        }
    }

    /// Suspends pairs of the systems that were `replaced` if they overlap.
    pub fn suspend_pairs(&mut self, replaced: &[bool]) {
        for pair in &mut self.pairs {
            let systems = [pair.first, pair.second].map(|i| self.colliders[i].system);
            let mut points = self.points[pair.points.clone()].iter();
            pair.is_suspended |=
                systems.iter().any(|i| replaced[*i]) && points.any(|point| point.touch.gap < 0.0);
        }
    }

    /// Updates the modes of points that violate them; bristles of points that begin to touch start undeflected. Calls
    /// `note` for each point that begins or ends to touch, with the two colliders, the number of the point, and whether
    /// it begins.
    pub fn change_modes(&mut self, y: &mut [f64], mut note: impl FnMut(usize, usize, usize, bool)) {
        for pair in self.pairs.iter().filter(|pair| !pair.is_suspended) {
            for (i, point) in self.points[pair.points.clone()].iter_mut().enumerate() {
                if violation(point, &pair.law) <= 0.0 {
                    continue;
                }
                let begins = point.mode == Mode::Apart;
                point.mode = if point.touch.gap > 0.0 {
                    Mode::Apart
                } else if 1.0 + pair.law.dissipation * point.rate < 0.0 {
                    Mode::Parting
                } else {
                    Mode::Touching
                };
                if begins || point.mode == Mode::Apart {
                    note(pair.first, pair.second, i, begins);
                }
                if let (true, Some(at)) = (begins, point.deflection) {
                    y[at..at + 3].fill(0.0);
                }
            }
        }
    }

    /// The longest step \[s\] in which no contact can begin and end unnoticed.
    pub fn longest_step(&self) -> f64 {
        let times = self
            .approaches()
            .map(|(gap, size, speed)| (gap + 0.25 * size) / speed);
        times.fold(f64::INFINITY, f64::min)
    }

    /// Whether no bodies are in contact or can be within `dt` \[s\], even at several times the present speed.
    pub fn is_apart(&self, dt: f64) -> bool {
        const MARGIN: f64 = 0.02;
        let is_apart = self
            .points
            .iter()
            .all(|point| point.mode == Mode::Apart && point.touch.gap > MARGIN);
        is_apart
            && self
                .approaches()
                .all(|(gap, _, speed)| gap - MARGIN > 4.0 * speed * dt)
    }

    /// For each pair with points that are apart: the smallest gap, the size of the smaller shape, and an upper bound of
    /// the approach speed.
    fn approaches(&self) -> impl Iterator<Item = (f64, f64, f64)> + '_ {
        self.pairs.iter().filter_map(|pair| {
            let points = &self.points[pair.points.clone()];
            let apart = points.iter().filter(|p| p.mode == Mode::Apart);
            let gap = apart
                .map(|p| p.touch.gap.max(0.0))
                .fold(f64::INFINITY, f64::min);
            if !gap.is_finite() {
                return None;
            }
            let (first, second) = (&self.colliders[pair.first], &self.colliders[pair.second]);
            let size = (first.shape.bounding_radius()).min(second.shape.bounding_radius());
            let member = |collider: &Collider| &self.members[collider.system];
            let centre = |collider: &Collider| collider.X_WS.translation.vector;
            // A half-space has no centre: use the centre of the other shape.
            let at = match (&first.shape, &second.shape) {
                (Shape::HalfSpace, _) => [centre(second); 2],
                (_, Shape::HalfSpace) => [centre(first); 2],
                _ => [centre(first), centre(second)],
            };
            let motion = |collider: &Collider, at: &Vector3<f64>| {
                let spin = member(collider).workspace.bodies[collider.body]
                    .twist
                    .angular
                    .norm();
                (member(collider).velocity(collider.body, at), spin)
            };
            let ((v_1, w_1), (v_2, w_2)) = (motion(first, &at[0]), motion(second, &at[1]));
            let sizes = [first, second].map(|collider| collider.shape.bounding_radius());
            let reach = |size: f64| if size.is_finite() { size } else { 0.0 };
            let speed = (v_1 - v_2).norm() + w_1 * reach(sizes[0]) + w_2 * reach(sizes[1]);
            (speed > 0.0).then_some((gap, size, speed))
        })
    }

    /// Energy stored in the contacts that act \[J\].
    pub fn stored_energy(&self) -> f64 {
        let of = |pair: &Pair| {
            let points = self.points[pair.points.clone()].iter();
            points
                .map(|p| pair.law.stored_energy(-p.touch.gap))
                .sum::<f64>()
        };
        let acting = self.pairs.iter().filter(|pair| !pair.is_suspended);
        acting.map(of).sum()
    }
}

/// Lower bound of the distance of two shapes \[m\], from their bounding spheres.
fn bound_of_gap(first: &Collider, second: &Collider) -> f64 {
    let reach = first.shape.bounding_radius() + second.shape.bounding_radius();
    let offset = first.X_WS.translation.vector - second.X_WS.translation.vector;
    offset.norm() - reach
}

fn violation(point: &Point, law: &ContactLaw) -> f64 {
    /// Scales the damping factor to metres; only the sign matters.
    const FACTOR: f64 = 1e-3;
    let gap = point.touch.gap;
    let damping = 1.0 + law.dissipation * point.rate;
    match point.mode {
        Mode::Apart => -gap,
        Mode::Touching => gap.max(-damping * FACTOR),
        Mode::Parting => gap.max(damping * FACTOR),
    }
}

fn set_state(member: &Member, origin: &Vector3<f64>, y: &[f64], state: &mut State) {
    let n = member.workspace.model().dof();
    let part = &y[member.offset..][..12 + 2 * n];
    let vector = |at: usize| Vector3::from_column_slice(&part[at..at + 3]);
    let from_origin = vector(3);
    state.R_WB = turn(&member.R_start, &vector(0));
    state.p_WC = origin + from_origin;
    state.q.as_mut_slice().copy_from_slice(&part[6..6 + n]);
    state.momentum_W.linear = vector(6 + n);
    state.momentum_W.angular = vector(9 + n) - from_origin.cross(&state.momentum_W.linear);
    state.qd.as_mut_slice().copy_from_slice(&part[12 + n..]);
}

impl State {
    /// A placeholder state, without allocation.
    fn empty() -> Self {
        Self {
            time: 0.0,
            R_WB: UnitQuaternion::identity(),
            p_WC: Vector3::zeros(),
            momentum_W: Default::default(),
            q: DVector::zeros(0),
            qd: DVector::zeros(0),
            work: 0.0,
            dissipated: Default::default(),
        }
    }
}
