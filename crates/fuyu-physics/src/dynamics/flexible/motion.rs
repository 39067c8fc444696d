//! Positions, momentum and velocities: the inward sweep that sums inertia and momentum, the base's twist from the momentum of the
//! state, and the outward sweep of twists.

use nalgebra::{Matrix3, Rotation3, Unit, Vector3};

use super::composite::{Composite, wrench_in_parent};
use super::system::CompiledBody;
use super::{FlexibleState, FlexibleWorkspace};
use crate::dynamics::Momentum;
use crate::spatial::{Pose, Twist, Wrench};

impl CompiledBody {
    /// Twist of the body relative to the frame that carries it, in its axes.
    pub fn joint_twist(&self, rate: f64) -> Twist {
        let along = self.axis * rate;
        if self.is_prismatic {
            Twist::new(Vector3::zeros(), along)
        } else {
            Twist::new(along, Vector3::zeros())
        }
    }

    /// What moving along the axis takes of `wrench`.
    pub fn along_axis(&self, wrench: &Wrench) -> f64 {
        if self.is_prismatic {
            self.axis.dot(&wrench.force)
        } else {
            self.axis.dot(&wrench.torque)
        }
    }
}

impl FlexibleWorkspace {
    /// Poses of the joints, shapes, composite inertias, and the momentum that joints, modes and rotors have while the base is at
    /// rest.
    pub(super) fn set_positions(&mut self, state: &FlexibleState) {
        assert!(
            state.fits(&self.system),
            "the state is of another system than the workspace"
        );
        self.set_shapes(state);
        let compiled = self.system.compiled();
        for b in (0..self.nodes.len()).rev() {
            let body = &compiled.bodies[b];
            let mut composite = Composite {
                mass: body.mass,
                S: body.S,
                J: body.J,
            };
            let mut momentum = Wrench::ZERO;
            for i in &body.modal_bodies {
                let shape = &self.modal[*i].shape;
                composite.add(&Composite {
                    mass: self.system.modal_bodies()[*i].integrals.mass,
                    S: shape.S,
                    J: shape.J,
                });
                momentum.force += shape.S_dot;
                momentum.torque += shape.h;
            }
            for i in &body.rotors {
                let rotor = &compiled.rotors[*i];
                let speed = self.rotor_speed(state, rotor);
                momentum.torque += rotor.axis * (rotor.inertia * speed);
            }
            if let Some(link) = body.link
                && let Some(section) = &self.modal[link].section
            {
                let carried = section.composite;
                let motion = Twist {
                    angular: section.R_BE.tr_mul(&section.relative.angular),
                    linear: section.R_BE.tr_mul(&section.relative.linear),
                };
                let carried_momentum = section.momentum + carried.momentum(&motion);
                composite.add(&carried.in_parent(&section.R_BE, &section.p_BE));
                momentum += wrench_in_parent(&carried_momentum, &section.R_BE, &section.p_BE);
            }
            let node = &mut self.nodes[b];
            node.composite.add(&composite);
            node.momentum += momentum;
            if b == 0 {
                break;
            }
            let motion = body.joint_twist(state.tree.qd[b - 1]);
            let momentum = node.momentum + node.composite.momentum(&motion);
            let momentum = wrench_in_parent(&momentum, &node.R, &node.p);
            let composite = node.composite.in_parent(&node.R, &node.p);
            let (into, into_momentum) = match compiled.bodies[body.parent].link {
                Some(link) => match &mut self.modal[link].section {
                    Some(section) => (&mut section.composite, &mut section.momentum),
                    None => continue,
                },
                None => {
                    let parent = &mut self.nodes[body.parent];
                    (&mut parent.composite, &mut parent.momentum)
                }
            };
            into.add(&composite);
            *into_momentum += momentum;
        }
        self.whole = self.nodes[0].composite;
        self.at_rest = self.nodes[0].momentum;
        self.p_BC = self.whole.S / self.whole.mass;
    }

    /// Joint poses and shapes of the deformable bodies; clears the sums.
    fn set_shapes(&mut self, state: &FlexibleState) {
        let compiled = self.system.compiled();
        for (b, (node, body)) in self.nodes.iter_mut().zip(&compiled.bodies).enumerate() {
            node.composite = Composite::zero();
            node.momentum = Wrench::ZERO;
            if b == 0 {
                continue;
            }
            let q = state.tree.q[b - 1];
            if body.is_prismatic {
                node.R = body.R_PJ;
                node.p = body.p_PJ + body.R_PJ * (body.axis * q);
            } else {
                let axis = Unit::new_unchecked(body.axis);
                node.R = body.R_PJ * Rotation3::from_axis_angle(&axis, q).into_inner();
                node.p = body.p_PJ;
            }
        }
        for (modal, body) in self.modal.iter_mut().zip(self.system.modal_bodies()) {
            let (mu, mu_dot) = (&state.mu()[body.range()], &state.mu_dot()[body.range()]);
            modal.shape.set_shape(body, mu, mu_dot);
            if let (Some(section), Some(output)) = (&mut modal.section, body.section) {
                section.set_shape(body, output, mu, mu_dot);
                section.clear_carried();
            }
        }
    }

    /// The base's twist from the momentum of `state`: Masutani 1995 eq. (4.23) with the momentum of modes and rotors.
    pub(super) fn set_base_twist(&mut self, state: &FlexibleState) {
        let momentum = state.tree.momentum_W.expressed_in(&state.tree.R_WB);
        self.nodes[0].V = self.base_twist(&momentum);
    }

    /// The base's twist for a momentum, base axes, at the rates of the last [`Self::set_positions`].
    pub(super) fn base_twist(&self, momentum: &Momentum) -> Twist {
        let (m, c) = (self.whole.mass, self.p_BC);
        let about_com =
            self.whole.J - (Matrix3::identity() * c.norm_squared() - c * c.transpose()) * m;
        let Wrench { torque, force } = &self.at_rest;
        let rest = momentum.angular - (torque - c.cross(force));
        let inverse = about_com
            .try_inverse()
            .unwrap_or(Matrix3::from_element(f64::NAN));
        let w = inverse * rest;
        Twist {
            angular: w,
            linear: (momentum.linear - force) / m - w.cross(&c),
        }
    }

    /// Momentum (base axes, angular about the centre of mass) while the base moves with `V`, at the rates of the last
    /// [`Self::set_positions`].
    pub(super) fn momentum_at(&self, V: &Twist) -> Momentum {
        let sum = self.whole.momentum(V) + self.at_rest;
        Momentum {
            linear: sum.force,
            angular: sum.torque - self.p_BC.cross(&sum.force),
        }
    }

    /// Twists and bias accelerations of all bodies, from that of the base.
    pub(super) fn propagate_motion(&mut self, state: &FlexibleState) {
        let compiled = self.system.compiled();
        for b in 0..self.nodes.len() {
            let body = &compiled.bodies[b];
            if b > 0 {
                let carrier = match compiled.bodies[body.parent].link {
                    Some(link) => self.modal[link].section.as_deref(),
                    None => None,
                };
                let V = match carrier {
                    Some(section) => section.twist(&self.nodes[body.parent].V),
                    None => self.nodes[body.parent].V,
                };
                let node = &mut self.nodes[b];
                let turned = V.angular.cross(&node.p);
                let w = node.R.tr_mul(&V.angular);
                let own = body.joint_twist(state.tree.qd[b - 1]);
                node.V = Twist {
                    angular: w + own.angular,
                    linear: node.R.tr_mul(&(V.linear + turned)) + own.linear,
                };
                node.bias = Twist {
                    angular: w.cross(&own.angular),
                    linear: node.R.tr_mul(&V.angular.cross(&turned)) + w.cross(&own.linear) * 2.0,
                };
            }
            if let Some(link) = body.link
                && let Some(section) = &mut self.modal[link].section
            {
                section.set_bias(&self.nodes[b].V.angular);
            }
        }
    }

    /// Poses of all bodies in the base frame.
    pub(super) fn set_poses(&mut self) {
        let compiled = self.system.compiled();
        for b in 1..self.nodes.len() {
            let body = &compiled.bodies[b];
            let parent = &self.nodes[body.parent];
            let (mut R, mut p) = (parent.R_0, parent.p_0);
            if let Some(link) = compiled.bodies[body.parent].link
                && let Some(section) = &self.modal[link].section
            {
                p += R * section.p_BE;
                R *= section.R_BE;
            }
            let node = &mut self.nodes[b];
            node.R_0 = R * node.R;
            node.p_0 = p + R * node.p;
        }
    }
}

impl FlexibleState {
    /// Moves the robot so that its base has the pose `X_WB` and the twist `V_WB_B` (of the base frame's origin, base
    /// axes). Joints, modes and rotors keep positions and rates; centre of mass and momentum follow.
    ///
    /// # Panics
    /// If the state is of another system than `workspace`.
    pub fn set_base(&mut self, workspace: &mut FlexibleWorkspace, X_WB: &Pose, V_WB_B: &Twist) {
        workspace.set_positions(self);
        let rotation = nalgebra::UnitQuaternion::from_rotation_matrix(&X_WB.rotation);
        self.tree.R_WB = rotation;
        self.tree.p_WC = X_WB.translation.vector + X_WB.rotation * workspace.p_BC;
        let momentum = workspace.momentum_at(V_WB_B);
        self.tree.momentum_W = Momentum {
            linear: rotation * momentum.linear,
            angular: rotation * momentum.angular,
        };
    }
}
