//! Robots whose only flexible parts are wheels and thrusters: as rigid trees, and as parts of larger robots.

use nalgebra::Unit;

use super::{
    FlexibleError, FlexibleFloating, FlexibleState, FlexibleSystem, FlexibleWorkspace, Thruster,
    Wheel,
};
use crate::dynamics::State;
use crate::model::{Frame, Model};
use crate::spatial::{Pose, RigidInertia, Twist};

impl FlexibleSystem {
    /// Whether the robot has neither deformable bodies nor elastic joints.
    pub fn is_gyrostat(&self) -> bool {
        self.modal_bodies().is_empty() && self.elastic_joints().is_empty()
    }

    /// The robot as an impulse acts on it: the wheels contribute no inertia about their axes, because bearing and motor
    /// transmit no impulse about them.
    pub(in crate::dynamics) fn free_wheel_model(&self) -> Model {
        let mut model = self.model().clone();
        for rotor in self.wheel_rotors() {
            let inertia = model.bodies()[rotor.body].inertia;
            let about_com = inertia.about_com - rotor.axis * rotor.axis.transpose() * rotor.inertia;
            let without = RigidInertia {
                about_com,
                ..inertia
            };
            model = model.with_body_inertia(rotor.body, without);
        }
        model
    }

    /// The same wheels and thrusters on `model`, which contains the bodies of this robot: each is part of a body of
    /// `model`, at a pose in its frame.
    ///
    /// # Errors
    /// [`FlexibleError`] if `model` has mimic joints.
    pub(in crate::dynamics) fn on_model(
        &self,
        model: &Model,
        bodies: &[(usize, Pose)],
    ) -> Result<Self, FlexibleError> {
        let frame = |b: usize| -> &Frame {
            let name = &model.bodies()[b].name;
            model.frame(name).expect("bodies have frames")
        };
        let mut builder = Self::builder(model);
        for (rotor, wheel) in self.wheel_rotors().iter().zip(self.wheels()) {
            let (b, X_JB) = &bodies[rotor.body];
            let frame = frame(*b);
            let axis_J = X_JB.rotation * rotor.axis;
            let axis = Unit::new_normalize(frame.X_BF.rotation.inverse() * axis_J);
            let wheel = Wheel {
                axis,
                ..wheel.clone()
            };
            builder = builder.wheel(frame, wheel);
        }
        for (i, thruster) in self.thrusters().iter().enumerate() {
            let (body, position, force) = self.thruster_force(i);
            let (b, X_JB) = &bodies[body];
            let frame = frame(*b);
            let X_FB = frame.X_BF.inverse() * X_JB;
            let thruster = Thruster {
                position: (X_FB * nalgebra::Point3::from(position)).coords,
                direction: Unit::new_normalize(X_FB.rotation * force),
                ..thruster.clone()
            };
            builder = builder.thruster(frame, thruster);
        }
        builder.build()
    }
}

impl FlexibleState {
    /// This robot's wheels and thrusters, with another tree.
    pub(in crate::dynamics) fn with_tree(&self, tree: State) -> Self {
        let mut state = self.clone();
        state.tree = tree;
        state
    }

    /// Copies wheels, thrusters and energies of `other`.
    pub(in crate::dynamics) fn copy_wheels_and_thrusters(&mut self, other: &Self) {
        self.x.copy_from(&other.x);
        self.xd.copy_from(&other.xd);
        self.losses = other.losses;
        self.partial_work = other.partial_work;
        self.impulse.copy_from_slice(&other.impulse);
        self.copy_valves(other);
    }

    /// Copies the remaining open times of the thrusters' valves.
    pub(in crate::dynamics) fn copy_valves(&mut self, other: &Self) {
        self.on_time.copy_from_slice(&other.on_time);
        self.open_for.copy_from_slice(&other.open_for);
    }
}

impl FlexibleFloating {
    /// Changes the state without allocating; the content of the scratch memory does not matter.
    pub(in crate::dynamics) fn change_state_with(
        &mut self,
        change: impl FnOnce(&mut FlexibleState, &mut FlexibleWorkspace),
    ) {
        let (state, workspace) = self.parts_mut();
        change(state, workspace);
        workspace.set_state(state);
    }

    /// Sets the accelerations of all bodies in the workspace from those of base and joints, for a robot with rigid
    /// links.
    pub(in crate::dynamics) fn copy_accelerations_to(&mut self, A_WB_B: Twist, qdd: &[f64]) {
        let (_, workspace) = self.parts_mut();
        workspace.nodes[0].A = A_WB_B;
        for b in 1..workspace.nodes.len() {
            let body = &workspace.system.compiled().bodies[b];
            let parent = workspace.nodes[body.parent].A;
            let own = body.joint_twist(qdd[b - 1]);
            let node = &mut workspace.nodes[b];
            node.A = parent.shifted_to_child(&node.X) + node.bias + own;
        }
    }
}
