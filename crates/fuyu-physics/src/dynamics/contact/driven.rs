//! Right-hand side of the equations of motion, with forces that are evaluated at every stage of a step.

use nalgebra::Vector3;

use super::radau::Equations;
use super::scene::{Mode, Scene};
use crate::dynamics::rate::turn_rate;
use crate::dynamics::{Formulation as _, Input, State, TreeMotion};
use crate::spatial::Wrench;

/// Function that sets the input of a system at every stage of a step, from time \[s\] and state.
pub(super) type Forces<'a> = &'a mut dyn FnMut(f64, &State, &mut Input);

/// Forces that are evaluated at every stage of a step.
pub(super) struct Drive<'a> {
    /// The system, and its forces; `None` if all inputs are held.
    pub forces: Option<(usize, Forces<'a>)>,
    /// Time at the start of the call \[s\].
    pub start: f64,
}

/// The equations of a scene in a step that begins `elapsed` \[s\] after the start of the call.
pub(super) struct Driven<'a, 'b> {
    pub scene: &'a mut Scene,
    pub drive: &'a mut Drive<'b>,
    pub elapsed: f64,
}

impl Equations for Driven<'_, '_> {
    fn rates(&mut self, after: f64, y: &[f64], rates: &mut [f64]) {
        self.scene.locate(y);
        if let Some((system, forces)) = &mut self.drive.forces {
            let member = &mut self.scene.members[*system];
            let time = self.drive.start + self.elapsed + after;
            forces(time, &member.state, &mut member.held);
        }
        self.scene.touch(y);
        self.scene.rates(y, rates);
    }

    fn scale(&self) -> &[f64] {
        &self.scene.scale
    }
}

impl Scene {
    /// Computes the rates of the state `y`, for which [`Self::locate`] and [`Self::touch`] must have been called.
    fn rates(&mut self, y: &[f64], rates: &mut [f64]) {
        rates.fill(0.0);
        for pair in &self.pairs {
            let (first, second) = (&self.colliders[pair.first], &self.colliders[pair.second]);
            for point in &self.points[pair.points.clone()] {
                if point.mode != Mode::Touching {
                    continue;
                }
                let torque = (point.at - self.origin).cross(&point.force);
                for (collider, sign, power) in
                    [(first, 1.0, point.power[0]), (second, -1.0, point.power[1])]
                {
                    let member = &mut self.members[collider.system];
                    rates[member.quadrature + 2] += power;
                    let momenta = member.offset + 6 + member.state.q.len();
                    let force = point.force * sign;
                    for i in 0..3 {
                        rates[momenta + i] += force[i];
                        rates[momenta + 3 + i] += sign * torque[i];
                    }
                    let arm = point.at - member.X_WB[collider.body].translation.vector;
                    member.loads[collider.body] += Wrench::new(arm.cross(&force), force);
                }
                if let (Some(bristle), Some(at)) = (&pair.law.bristle, point.deflection) {
                    let R_W2 = &self.members[second.system].X_WB[second.body].rotation;
                    let z = Vector3::from_column_slice(&y[at..at + 3]);
                    let slip = R_W2.inverse_transform_vector(&point.slip);
                    let rate = pair.law.deflection_rate(bristle, &slip, &z);
                    rates[at..at + 3].copy_from_slice(rate.as_slice());
                }
            }
        }
        for member in &mut self.members {
            let n = member.state.q.len();
            let (mut work, mut damping) = (0.0, 0.0);
            let part = &mut rates[member.offset..][..12 + 2 * n];
            for (b, load) in member.loads.iter_mut().enumerate() {
                let X_WB = &member.X_WB[b];
                let held = &member.held.wrenches[b];
                let mut wrench = Wrench {
                    torque: X_WB.rotation.inverse_transform_vector(&load.torque),
                    force: X_WB.rotation.inverse_transform_vector(&load.force),
                };
                if *held != Wrench::ZERO {
                    let force = X_WB.rotation * held.force;
                    let arm = X_WB.translation.vector - self.origin;
                    let torque = X_WB.rotation * held.torque + arm.cross(&force);
                    for i in 0..3 {
                        part[6 + n + i] += force[i];
                        part[9 + n + i] += torque[i];
                    }
                    wrench += *held;
                }
                if wrench != Wrench::ZERO {
                    // Twist of the body's frame, body axes.
                    let twist = &member.workspace.bodies[b].twist;
                    let X_0B = member.X_WB[0].inverse() * X_WB;
                    let from = X_0B.translation.vector - member.workspace.p_BK(b);
                    let linear = twist.linear + twist.angular.cross(&from);
                    let to_body = X_0B.rotation.inverse();
                    work += (to_body * twist.angular).dot(&wrench.torque)
                        + (to_body * linear).dot(&wrench.force);
                }
                member.input.wrenches[b] = wrench;
            }
            let state = &member.state;
            let turned = Vector3::from_column_slice(&y[member.offset..][..3]);
            let w = member.workspace.V_WB_B().angular;
            part[..3].copy_from_slice(turn_rate(&turned, &w).as_slice());
            let v = state.momentum_W.linear / member.workspace.mass;
            part[3..6].copy_from_slice(v.as_slice());
            part[6..6 + n].copy_from_slice(state.qd.as_slice());
            if n > 0 {
                member.input.efforts.copy_from(&member.held.efforts);
                let motion = TreeMotion {
                    R_WB: state.R_WB,
                    V_WB_B: *member.workspace.V_WB_B(),
                    q: state.q.as_slice(),
                    qd: state.qd.as_slice(),
                };
                member
                    .dynamics
                    .accelerations(&motion, &member.input, &mut member.out);
                part[12 + n..].copy_from_slice(member.out.qdd.as_slice());
                let joints = member.workspace.model().joints();
                for (j, joint) in joints.iter().enumerate() {
                    let (q, qd) = (state.q[j], state.qd[j]);
                    work += (member.input.efforts[j] + joint.passive_effort(q, qd)) * qd;
                    damping += joint.damping * qd * qd;
                }
            }
            rates[member.quadrature] = work;
            rates[member.quadrature + 1] = damping;
        }
    }
}
