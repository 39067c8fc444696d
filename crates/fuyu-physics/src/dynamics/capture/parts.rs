//! Robot and target as parts of the joined system: their states, and the robot's input.

use nalgebra::{DVector, Isometry3, UnitQuaternion};

use super::captured::{Captured, Place};
use crate::dynamics::{Floating, Forcing, Input, State};
use crate::model::Model;
use crate::spatial::{Pose, Wrench};

/// The robot's state and input at a stage of a step, and the map of its bodies to the joined model.
#[derive(Debug, Clone)]
pub(super) struct RobotPart {
    state: State,
    input: Input,
    /// For each body of the robot, the body of the joined model that contains it and its pose there.
    pub bodies: Vec<(usize, Pose)>,
}

impl RobotPart {
    pub fn new(robot: &Model, joined: &Model) -> Self {
        let bodies = robot.bodies().iter().map(|body| {
            let frame = |model: &Model| model.frame(&body.name).expect("frames stay").clone();
            let (own, place) = (frame(robot), frame(joined));
            (place.body, place.X_BF * own.X_BF.inverse())
        });
        Self {
            state: State::at_rest(robot),
            input: Input::zero(robot),
            bodies: bodies.collect(),
        }
    }

    /// Writes the robot's input to that of the joined system.
    pub fn write(places: &[Place], bodies: &[(usize, Pose)], from: &Input, to: &mut Input) {
        for (place, effort) in places.iter().zip(&from.efforts) {
            if let Place::Coordinate(j) = *place {
                to.efforts[j] = *effort;
            }
        }
        to.wrenches.fill(Wrench::ZERO);
        for ((b, X_JB), wrench) in bodies.iter().zip(&from.wrenches) {
            if *wrench != Wrench::ZERO {
                to.wrenches[*b] += wrench.shifted_to_parent(X_JB);
            }
        }
    }
}

/// Writes attitude and joints of the robot to `robot`; centre of mass and momentum become those of the joined system.
pub(super) fn read_robot(places: &[Place], whole: &State, robot: &mut State) {
    robot.time = whole.time;
    robot.R_WB = whole.R_WB;
    robot.p_WC = whole.p_WC;
    robot.momentum_W = whole.momentum_W;
    robot.work = whole.work;
    robot.dissipated = whole.dissipated;
    for (k, place) in places.iter().enumerate() {
        (robot.q[k], robot.qd[k]) = match *place {
            Place::Coordinate(j) => (whole.q[j], whole.qd[j]),
            Place::Locked(q) => (q, 0.0),
        };
    }
}

/// The robot's joint accelerations, in its own order, from those of the joined system.
pub(super) fn robot_accelerations(places: &[Place], qdd: &[f64]) -> Vec<f64> {
    let of_robot = places.iter().map(|place| match *place {
        Place::Coordinate(j) => qdd[j],
        Place::Locked(_) => 0.0,
    });
    of_robot.collect()
}

impl Captured {
    /// Copies the robot's motion in the joined system to `robot`, a system of the robot's own model. Its work and
    /// dissipated energy become those of the joined system.
    ///
    /// # Panics
    /// If `robot` is another robot.
    pub fn copy_robot_to(&self, robot: &mut Floating) {
        let (whole, workspace) = (self.floating.state(), self.floating.workspace());
        let X_WB = Isometry3::from_parts(whole.X_WB(workspace).translation, whole.R_WB);
        robot.change_state_with(|state, own| {
            read_robot(&self.places, whole, state);
            state.set_base(own, &X_WB, workspace.V_WB_B());
        });
    }

    /// Copies the target's motion in the joined system to `target`, a system of the target's own model. Its work and
    /// dissipated energy become zero.
    ///
    /// # Panics
    /// If `target` is another target.
    pub fn copy_target_to(&self, target: &mut Floating) {
        let whole = self.floating.state();
        let (X_WO, V_W) = self.target_motion();
        let R_WO = UnitQuaternion::from_rotation_matrix(&X_WO.rotation);
        let mut V_O = V_W;
        V_O.angular = R_WO.inverse() * V_W.angular;
        V_O.linear = R_WO.inverse() * V_W.linear;
        target.change_state_with(|state, own| {
            state.time = whole.time;
            state.work = 0.0;
            state.dissipated = Default::default();
            for (k, j) in self.joined.second.iter().enumerate() {
                (state.q[k], state.qd[k]) = (whole.q[*j], whole.qd[*j]);
            }
            state.set_base(own, &Isometry3::from_parts(X_WO.translation, R_WO), &V_O);
        });
    }

    /// Copies the accelerations that the robot has in the joined system under the held input to `robot`, which
    /// [`Self::copy_robot_to`] has set.
    ///
    /// # Panics
    /// If `robot` is another robot.
    pub fn copy_robot_accelerations_to(&mut self, robot: &mut Floating) {
        let found = self.floating.present_accelerations();
        let qdd = robot_accelerations(&self.places, found.qdd.as_slice());
        let A_WB_B = found.A_WB_B;
        robot.copy_accelerations_to(A_WB_B, &qdd);
    }

    /// Holds this input of the robot, in the robot's order of joints and bodies, from now on, and no other input.
    /// Efforts of locked joints have no effect.
    ///
    /// # Panics
    /// If `input` is that of another robot.
    pub fn hold_robot_input(&mut self, input: &Input) {
        let bodies = &self.part.bodies;
        assert_eq!(
            (input.efforts.len(), input.wrenches.len()),
            (self.places.len(), bodies.len()),
            "the input must be for the robot's joints and bodies"
        );
        RobotPart::write(&self.places, bodies, input, self.floating.input_mut());
    }

    /// Advances by one step of `dt` \[s\]; `forcing` changes the robot's input at every stage, starting from `input`.
    /// `forcing` receives attitude and joints of the robot, but centre of mass and momentum of the joined system.
    /// Afterwards its input for the new state is held, and returned in `input`.
    ///
    /// # Panics
    /// If `input` is that of another robot.
    pub fn step_with(&mut self, dt: f64, input: &mut Input, forcing: &mut impl Forcing) {
        self.step_by(input, forcing, |joined, forces| {
            joined.step_with(dt, &mut |time: f64, state: &State, input: &mut Input| {
                forces(time, state, input);
            });
        });
        self.choose_axes_if_tilted();
    }

    /// As [`Self::step_with`], but `step` advances the joined system, for example together with other bodies in
    /// contact; it must apply the given forces at every stage. The axes of a spherical joint are not redefined: the
    /// joint may turn by half a radian at most before [`Self::choose_axes_if_tilted`] is called.
    ///
    /// # Panics
    /// If `input` is that of another robot.
    pub fn step_by(
        &mut self,
        input: &mut Input,
        forcing: &mut impl Forcing,
        step: impl FnOnce(&mut Floating, &mut dyn FnMut(f64, &State, &mut Input)),
    ) {
        self.part.input.copy_from(input);
        let Self {
            floating,
            places,
            part,
            ..
        } = self;
        let mut of_whole = |time: f64, whole: &State, to: &mut Input| {
            read_robot(places, whole, &mut part.state);
            forcing.apply(time, &part.state, &mut part.input);
            RobotPart::write(places, &part.bodies, &part.input, to);
        };
        step(floating, &mut of_whole);
        input.copy_from(&self.part.input);
    }

    /// Joint positions and rates of the robot, in its own order; those of locked joints do not change.
    pub fn robot_joints(&self) -> (DVector<f64>, DVector<f64>) {
        let state = self.floating.state();
        let at = |place: &Place| match *place {
            Place::Coordinate(j) => (state.q[j], state.qd[j]),
            Place::Locked(q) => (q, 0.0),
        };
        let (q, qd): (Vec<f64>, Vec<f64>) = self.places.iter().map(at).unzip();
        (q.into(), qd.into())
    }

    /// Joint positions and rates of the target, in its own order.
    pub fn target_joints(&self) -> (DVector<f64>, DVector<f64>) {
        let state = self.floating.state();
        let of = |values: &DVector<f64>| {
            let of_target = self.joined.second.iter().map(|j| values[*j]);
            DVector::from_iterator(self.joined.second.len(), of_target)
        };
        (of(&state.q), of(&state.qd))
    }

    /// Holds joint efforts of the robot \[N m or N\], in its own order, each within its limit; those of locked
    /// joints have no effect.
    ///
    /// # Panics
    /// If `efforts` does not have one element per joint of the robot.
    pub fn hold_robot_efforts(&mut self, efforts: &[f64]) {
        assert_eq!(
            efforts.len(),
            self.places.len(),
            "efforts must have one element per joint of the robot"
        );
        let held = &mut self.floating.input_mut().efforts;
        for ((place, effort), joint) in self.places.iter().zip(efforts).zip(self.robot.joints()) {
            if let Place::Coordinate(j) = *place {
                held[j] = effort.clamp(-joint.limits.effort, joint.limits.effort);
            }
        }
    }
}
