//! Positions, momentum and velocities: the inward sweep that sums inertia and momentum, the base's twist from the
//! momentum of the state, and the outward sweep of twists.

use nalgebra::{Matrix3, Rotation3, Unit, Vector3};

use super::composite::Composite;
use super::section::Section;
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

    /// Component of `wrench` along the axis.
    pub fn along_axis(&self, wrench: &Wrench) -> f64 {
        if self.is_prismatic {
            self.axis.dot(&wrench.force)
        } else {
            self.axis.dot(&wrench.torque)
        }
    }
}

impl FlexibleWorkspace {
    /// Sets poses of the joints, shapes, composite inertias, and the momentum of joints, modes and rotors with the base
    /// at rest.
    pub(super) fn set_positions(&mut self, state: &FlexibleState) {
        assert!(
            state.fits(&self.system),
            "the state is of another system than the workspace"
        );
        self.set_shapes(state);
        let Self {
            system,
            nodes,
            modal,
            sections,
            ..
        } = self;
        let compiled = system.compiled();
        for b in (0..nodes.len()).rev() {
            let (body, node) = (&compiled.bodies[b], &mut nodes[b]);
            node.composite.add(&body.rigid);
            for i in &body.modal_bodies {
                let shape = &modal[*i].shape;
                node.composite.add(&shape.locked);
                node.momentum += shape.momentum;
            }
            for i in &body.rotors {
                node.momentum.torque += compiled.rotors[*i].momentum(state);
            }
            if let Some(s) = body.section {
                let Section {
                    X_BE,
                    relative,
                    composite,
                    momentum,
                    ..
                } = &sections[s];
                let carried = *momentum + composite.momentum(relative);
                node.composite.add(&composite.in_parent(X_BE));
                node.momentum += carried.shifted_to_parent(X_BE);
            }
            if b == 0 {
                break;
            }
            let motion = body.joint_twist(state.tree.qd[b - 1]);
            let momentum = node.momentum + node.composite.momentum(&motion);
            let momentum = momentum.shifted_to_parent(&node.X);
            let composite = node.composite.in_parent(&node.X);
            let (into, into_momentum) = match compiled.carrier(b) {
                Some(s) => {
                    let section = &mut sections[s];
                    (&mut section.composite, &mut section.momentum)
                }
                None => {
                    let parent = &mut nodes[body.parent];
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

    /// Sets joint poses and shapes of the deformable bodies; clears the sums.
    fn set_shapes(&mut self, state: &FlexibleState) {
        let compiled = self.system.compiled();
        for (b, (node, body)) in self.nodes.iter_mut().zip(&compiled.bodies).enumerate() {
            node.composite = Composite::zero();
            node.momentum = Wrench::ZERO;
            if b == 0 {
                continue;
            }
            let q = state.tree.q[b - 1];
            node.X = body.X_PJ;
            if body.is_prismatic {
                node.X.translation.vector += body.X_PJ.rotation * (body.axis * q);
            } else {
                let axis = Unit::new_unchecked(body.axis);
                node.X.rotation *= Rotation3::from_axis_angle(&axis, q);
            }
        }
        let bodies = self.system.modal_bodies();
        for (modal, body) in self.modal.iter_mut().zip(bodies) {
            let (mu, mu_dot) = (&state.mu()[body.range()], &state.mu_dot()[body.range()]);
            modal.shape.set_shape(body, mu, mu_dot);
        }
        for section in &mut self.sections {
            let body = &bodies[section.modal_body];
            let (mu, mu_dot) = (&state.mu()[body.range()], &state.mu_dot()[body.range()]);
            section.set_shape(body, mu, mu_dot);
        }
    }

    /// Sets the base's twist from the momentum of `state`: Masutani 1995 eq. (4.23) with the momentum of modes and
    /// rotors.
    pub(super) fn set_base_twist(&mut self, state: &FlexibleState) {
        let momentum = state.tree.momentum_W.expressed_in(&state.tree.R_WB);
        self.nodes[0].V = self.base_twist(&momentum);
    }

    /// The base's twist for a momentum, base axes, at the rates of the last [`Self::set_positions`].
    pub(super) fn base_twist(&self, momentum: &Momentum) -> Twist {
        let c = self.p_BC;
        let Wrench { torque, force } = &self.at_rest;
        let rest = momentum.angular - (torque - c.cross(force));
        let inverse = self.whole.about_com().try_inverse();
        let w = inverse.unwrap_or(Matrix3::from_element(f64::NAN)) * rest;
        Twist {
            angular: w,
            linear: (momentum.linear - force) / self.whole.mass - w.cross(&c),
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

    /// Sets twists and bias accelerations of all bodies, from the base's twist.
    pub(super) fn propagate_motion(&mut self, state: &FlexibleState) {
        let compiled = self.system.compiled();
        for b in 0..self.nodes.len() {
            let body = &compiled.bodies[b];
            if b > 0 {
                let parent = self.nodes[body.parent].V;
                let V = match compiled.carrier(b) {
                    Some(s) => self.sections[s].twist(&parent),
                    None => parent,
                };
                let node = &mut self.nodes[b];
                let (R, p) = (&node.X.rotation, &node.X.translation.vector);
                let own = body.joint_twist(state.tree.qd[b - 1]);
                let carried = V.shifted_to_child(&node.X);
                let centripetal = V.angular.cross(&V.angular.cross(p));
                let w = carried.angular;
                node.V = carried + own;
                node.bias = Twist {
                    angular: w.cross(&own.angular),
                    linear: R.inverse_transform_vector(&centripetal) + w.cross(&own.linear) * 2.0,
                };
            }
            if let Some(s) = body.section {
                self.sections[s].set_bias(&self.nodes[b].V.angular);
            }
        }
    }

    /// Sets the poses of all bodies in the base frame.
    pub(super) fn set_poses(&mut self) {
        let compiled = self.system.compiled();
        for b in 1..self.nodes.len() {
            let mut X = self.nodes[compiled.bodies[b].parent].X_0;
            if let Some(s) = compiled.carrier(b) {
                X *= self.sections[s].X_BE;
            }
            self.nodes[b].X_0 = X * self.nodes[b].X;
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
