//! Robot and target joined by a grasp: one floating system.

use nalgebra::Vector3;

use super::grasp::{CaptureError, Grasp};
use super::impulse::{JointReaction, Latch, LatchImpulses, LatchPair, System, close_latches};
use super::parts::RobotPart;
use crate::dynamics::{
    Direction, Floating, IntegrationMethod, JointPhysics, LoopClosure, Loops, Momentum, State,
};
use crate::model::{Connection, Frame, Joined, Model};
use crate::spatial::{Pose, Twist};

/// Second angle of a spherical joint \[rad\] beyond which its three axes are redefined: well before the singularity at
/// 90°, where two of them coincide.
const TILTED: f64 = 1.0;

/// Rounding tolerance for the gap of a loop that an impulse has closed \[m, rad, m/s, rad/s\].
const ROUNDING: f64 = 1e-9;

/// Where a joint coordinate of the robot is in the joined system: a coordinate, or locked at a value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Place {
    Coordinate(usize),
    Locked(f64),
}

/// A second grasp, which closes a loop.
#[derive(Debug, Clone)]
struct SecondGrasp {
    robot: String,
    /// On the target's base.
    target: Frame,
    latch: Latch,
}

/// Robot and target joined by a grasp, as one floating system. The target's links become part of the robot's tree,
/// their names prefixed by the target's name and a slash. A ball joint is modelled as three joints with intersecting
/// axes, which are redefined before two of them coincide (gimbal lock).
#[derive(Debug, Clone)]
pub struct Captured {
    pub(super) floating: Floating,
    method: IntegrationMethod,
    joint_physics: JointPhysics,
    /// The original robot, the robot with its locked joints, and the target.
    pub(super) robot: Model,
    carrier: Model,
    target: Model,
    grasp: Grasp,
    second: Vec<SecondGrasp>,
    pub(super) joined: Joined,
    pub(super) places: Vec<Place>,
    pub(super) part: RobotPart,
    prefix: String,
}

impl Captured {
    /// Joins robot and target in their present states. Returns the impulse; system 0 is the robot.
    ///
    /// # Errors
    /// [`CaptureError`] if the robot's frame is none of its model, or the target's not on its base.
    pub fn new(
        robot: &Floating,
        target: &Floating,
        grasp: &Grasp,
        method: IntegrationMethod,
    ) -> Result<(Self, LatchImpulses), CaptureError> {
        grasp.check(robot.model(), target)?;
        if !robot.loops().closures().is_empty() {
            return Err(CaptureError::ClosedLoops(robot.model().name().to_owned()));
        }
        let mut of_robot = robot.workspace().clone();
        let impulses = grasp.close((robot.state(), &mut of_robot), target);
        let mut captured = Self::joined(robot, target, grasp, method, &impulses.states);
        captured.lose(impulses.energy_lost);
        Ok((captured, impulses))
    }

    /// Subtracts the energy lost in an impulse from the work, so that kinetic energy minus work stays constant.
    pub(super) fn lose(&mut self, energy: f64) {
        self.floating.change_state(|state| state.work -= energy);
    }

    /// The joined system, from states after the impulse.
    pub(super) fn joined(
        robot: &Floating,
        target: &Floating,
        grasp: &Grasp,
        method: IntegrationMethod,
        states: &[State],
    ) -> Self {
        let (robot_model, target_model) = (robot.model().clone(), target.model().clone());
        let [of_robot, of_target] = states else {
            unreachable!("two systems")
        };
        let locked = vec![grasp.joints == JointReaction::Locked; robot_model.dof()];
        let carrier = match grasp.joints {
            JointReaction::Locked => robot_model.with_locked_joints(of_robot.q.as_slice(), &locked),
            _ => robot_model.clone(),
        };
        let mut prefix = format!("{}/", target_model.name());
        let is_taken = |prefix: &str| {
            robot_model
                .frames()
                .iter()
                .any(|f| f.name.starts_with(prefix))
        };
        while is_taken(&prefix) {
            prefix.insert(0, '_');
        }
        // The impulse changes no poses.
        let X_WR = of_robot.X_WB(robot.workspace());
        let X_WG = X_WR * robot.workspace().X_BF(&grasp.robot);
        let X_WO = of_target.X_WB(target.workspace());
        let frame = carrier
            .frame(&grasp.robot.name)
            .expect("frames stay")
            .clone();
        let X_WB = X_WG * frame.X_BF.inverse();
        let joined = join(
            &carrier,
            &frame,
            &target_model,
            grasp.latch,
            &(X_WB.inverse() * X_WO),
            &prefix,
        );

        let mut state = State::at_rest(&joined.model);
        state.time = of_robot.time;
        state.R_WB = of_robot.R_WB;
        state.work = of_robot.work + of_target.work;
        state.dissipated = of_robot.dissipated;
        state.dissipated += of_target.dissipated;
        let (m_r, m_t) = (robot_model.total_mass(), target_model.total_mass());
        state.p_WC = (of_robot.p_WC * m_r + of_target.p_WC * m_t) / (m_r + m_t);
        state.momentum_W = total_momentum(&[of_robot, of_target], &state.p_WC);
        let places: Vec<Place> = match grasp.joints {
            JointReaction::Locked => of_robot.q.iter().map(|q| Place::Locked(*q)).collect(),
            _ => joined.first.iter().map(|j| Place::Coordinate(*j)).collect(),
        };
        for (place, (q, qd)) in places.iter().zip(of_robot.q.iter().zip(&of_robot.qd)) {
            if let Place::Coordinate(j) = *place {
                (state.q[j], state.qd[j]) = (*q, *qd);
            }
        }
        for (&j, (q, qd)) in joined
            .second
            .iter()
            .zip(of_target.q.iter().zip(&of_target.qd))
        {
            (state.q[j], state.qd[j]) = (*q, *qd);
        }
        if grasp.latch == Latch::Ball {
            let of = |system: &Floating, state: &State, frame: &Frame| {
                let mut workspace = system.workspace().clone();
                workspace.set_motion(state);
                state.R_WB * workspace.V_WF_B(frame).angular
            };
            let relative = of(target, of_target, &grasp.target) - of(robot, of_robot, &grasp.robot);
            set_cardan_rates(&mut state, &joined, &(X_WO.rotation.inverse() * relative));
        }
        let mut floating = Floating::new(joined.model.clone(), state, method);
        let efforts = places.iter().zip(robot.efforts().iter());
        for (place, effort) in efforts {
            if let Place::Coordinate(j) = *place {
                floating.input_mut().efforts[j] = *effort;
            }
        }
        Self {
            part: RobotPart::new(&robot_model, &joined.model),
            floating,
            method,
            joint_physics: JointPhysics::default(),
            robot: robot_model,
            carrier,
            target: target_model,
            grasp: grasp.clone(),
            second: Vec::new(),
            joined,
            places,
            prefix,
        }
    }

    /// Lets another frame of the robot grasp the target, too, which closes a loop. Returns the impulse on the robot's
    /// frame.
    ///
    /// [`CaptureError`] if the frame does not exist, if the grasp is not on the target's base, or if the loop locks all
    /// joints.
    /// locks all joints.
    pub fn grasp_again(
        &mut self,
        robot: &Frame,
        target: &Frame,
        latch: Latch,
    ) -> Result<LatchImpulses, CaptureError> {
        if target.body != 0 {
            let (target, body) = (self.target.name().to_owned(), target.body);
            return Err(CaptureError::NotOnBase { target, body });
        }
        let model = self.floating.model().clone();
        let Some(first) = model.frame(&robot.name).cloned() else {
            return Err(CaptureError::UnknownFrame {
                frame: robot.name.clone(),
                robot: self.robot.name().to_owned(),
            });
        };
        // The loop closes at the relative pose that the frames have now.
        let root = self.target_root().clone();
        let mut workspace = self.floating.workspace().clone();
        let X_OG = workspace.X_BF(&root).inverse() * workspace.X_BF(&first);
        let own = SecondGrasp {
            robot: robot.name.clone(),
            target: Frame {
                X_BF: X_OG,
                ..target.clone()
            },
            latch,
        };
        let mut all = self.second.clone();
        all.push(own);
        let frames: Vec<(Frame, Frame, Latch)> =
            all.iter().map(|grasp| self.closing_frames(grasp)).collect();
        let pairs: Vec<LatchPair> = frames
            .iter()
            .map(|(first, second, latch)| LatchPair {
                first: (0, first),
                second: (0, second),
                latch: *latch,
            })
            .collect();
        let state = self.floating.state().clone();
        let mut system = [System {
            state: &state,
            workspace: &mut workspace,
            joints: &[],
        }];
        let impulses = close_latches(&mut system, &pairs);
        let floating = closed(&model, &frames, impulses.states[0].clone(), self.method)?;
        self.replace(floating);
        self.lose(impulses.energy_lost);
        self.second = all;
        Ok(impulses)
    }

    /// The two frames, in the joined model, that a second grasp joins, and its latch.
    fn closing_frames(&self, grasp: &SecondGrasp) -> (Frame, Frame, Latch) {
        let model = &self.joined.model;
        let first = model.frame(&grasp.robot).expect("frames stay").clone();
        let root = self.target_root();
        let second = Frame {
            body: root.body,
            X_BF: root.X_BF * grasp.target.X_BF,
            ..grasp.target.clone()
        };
        (first, second, grasp.latch)
    }

    /// Replaces the system by another one of the same topology; held efforts and joint physics stay.
    fn replace(&mut self, mut floating: Floating) {
        let held = self.floating.input_mut().clone();
        floating.input_mut().copy_from(&held);
        self.floating = floating.with_joint_physics(&self.joint_physics);
    }

    /// The same system, with other settings for friction, stops and speed limits of the joints.
    #[must_use]
    pub fn with_joint_physics(mut self, settings: &JointPhysics) -> Self {
        self.floating = self.floating.with_joint_physics(settings);
        self.joint_physics = *settings;
        self
    }

    /// The joined system.
    pub fn floating(&self) -> &Floating {
        &self.floating
    }

    /// The joined system, to set held efforts and wrenches.
    pub fn floating_mut(&mut self) -> &mut Floating {
        &mut self.floating
    }

    /// The robot before the capture.
    pub fn robot(&self) -> &Model {
        &self.robot
    }

    /// The target before the capture.
    pub fn target(&self) -> &Model {
        &self.target
    }

    /// The grasp.
    pub fn grasp(&self) -> &Grasp {
        &self.grasp
    }

    /// The frame of the target's base.
    pub fn target_root(&self) -> &Frame {
        self.target_frame(&self.target.bodies()[0].name)
            .expect("the target's base is part of the joined model")
    }

    /// Advances by `steps` steps of `dt` \[s\] with held inputs.
    pub fn step(&mut self, dt: f64, steps: usize) {
        if self.joined.connection.is_empty() {
            self.floating.step(dt, steps);
            return;
        }
        for _ in 0..steps {
            self.floating.step(dt, 1);
            self.choose_axes_if_tilted();
        }
    }

    /// The frame of the joined model that corresponds to frame `name` of the target's own model.
    pub fn target_frame(&self, name: &str) -> Option<&Frame> {
        self.joined.model.frame(&format!("{}{name}", self.prefix))
    }

    /// Relative angular speed in a ball joint: norm of the rates of the joint's angles \[rad/s\]; `None` for a weld.
    pub fn ball_joint_rate(&self) -> Option<f64> {
        let rates = self.joined.connection.iter();
        let square: f64 = rates.map(|j| self.floating.state().qd[*j].powi(2)).sum();
        (!self.joined.connection.is_empty()).then_some(square.sqrt())
    }

    /// Whether grasps form closed loops.
    pub fn has_loops(&self) -> bool {
        !self.second.is_empty()
    }

    /// Redefines the axes of a spherical joint if two of them come close to each other. Returns whether they changed:
    /// the joined system then has another model.
    pub fn choose_axes_if_tilted(&mut self) -> bool {
        if let [_, tilt, _] = self.joined.connection[..]
            && self.floating.state().q[tilt].abs() > TILTED
        {
            self.choose_axes();
            return true;
        }
        false
    }

    /// Redefines the axes of the spherical joint so that all three angles are zero now.
    fn choose_axes(&mut self) {
        let workspace = self.floating.workspace();
        let root = self.target_root();
        let frame = self
            .joined
            .model
            .frame(&self.grasp.robot.name)
            .expect("frames stay");
        let (X_0G, X_0O) = (workspace.X_BF(frame), workspace.X_BF(root));
        let relative = workspace.V_WF_B(root).angular - workspace.V_WF_B(frame).angular;
        let mut state = self.floating.state().clone();
        let carrier = self
            .carrier
            .frame(&self.grasp.robot.name)
            .expect("frames stay");
        let X_BO = carrier.X_BF * (X_0G.inverse() * X_0O);
        self.joined = join(
            &self.carrier,
            carrier,
            &self.target,
            Latch::Ball,
            &X_BO,
            &self.prefix,
        );
        for j in &self.joined.connection {
            state.q[*j] = 0.0;
        }
        set_cardan_rates(
            &mut state,
            &self.joined,
            &(X_0O.rotation.inverse() * relative),
        );
        let model = &self.joined.model;
        let frames: Vec<(Frame, Frame, Latch)> = self
            .second
            .iter()
            .map(|grasp| self.closing_frames(grasp))
            .collect();
        // The loops were closed before, and a change of coordinates does not open them.
        if let Ok(floating) = closed(model, &frames, state, self.method) {
            self.replace(floating);
        }
    }

    /// Pose of the target's base in the world, and its twist there, world axes.
    pub fn target_motion(&self) -> (Pose, Twist) {
        let (state, workspace) = (self.floating.state(), self.floating.workspace());
        let root = self.target_root();
        let X_WB = state.X_WB(workspace);
        let V_B = workspace.V_WF_B(root);
        let V_W = Twist::new(X_WB.rotation * V_B.angular, X_WB.rotation * V_B.linear);
        (X_WB * workspace.X_BF(root), V_W)
    }
}

/// `carrier` with `target` attached to the body of `frame`, at pose `X_BO`.
fn join(
    carrier: &Model,
    frame: &Frame,
    target: &Model,
    latch: Latch,
    X_BO: &Pose,
    prefix: &str,
) -> Joined {
    let connection = match latch {
        Latch::Weld => Connection::Weld,
        Latch::Ball => Connection::Cardan,
    };
    // Axes of the target's base: where the angles are zero, its relative angular velocity is that of the joints.
    let X_BJ = Pose::from_parts(frame.X_BF.translation, X_BO.rotation);
    carrier.joined(frame.body, target, connection, &X_BJ, X_BO, prefix)
}

/// Sets the rates of the three joints of a spherical joint at zero angles; `w_J` is the relative angular velocity, in
/// the joint's axes.
fn set_cardan_rates(state: &mut State, joined: &Joined, w_J: &Vector3<f64>) {
    for (j, rate) in joined.connection.iter().zip([w_J.z, w_J.y, w_J.x]) {
        state.qd[*j] = rate;
    }
}

/// The floating system with closed loops.
fn closed(
    model: &Model,
    frames: &[(Frame, Frame, Latch)],
    mut state: State,
    method: IntegrationMethod,
) -> Result<Floating, CaptureError> {
    let closures = frames
        .iter()
        .enumerate()
        .map(|(k, (first, second, latch))| LoopClosure {
            name: format!("grasp {}", k + 2),
            frame_a: first.clone(),
            frame_b: second.clone(),
            constrained: Direction::ALL.map(|d| *latch == Latch::Weld || !d.is_rotation()),
        });
    let mut loops = Loops::new(model, closures.collect())?;
    loops.assemble(&mut state, ROUNDING)?;
    Ok(Floating::with_loops(loops, state, method))
}

/// Momentum of several systems, angular about `p_WC`.
pub(super) fn total_momentum(states: &[&State], p_WC: &Vector3<f64>) -> Momentum {
    let mut sum = Momentum::default();
    for state in states {
        let Momentum { linear, angular } = state.momentum_W;
        sum.linear += linear;
        sum.angular += angular + (state.p_WC - p_WC).cross(&linear);
    }
    sum
}
