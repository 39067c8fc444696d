//! External wrenches on links of the robot, with the momentum and work that they add, and integration of the robot
//! under external wrenches, thrusters and excitations.

use nalgebra::Vector3;

use super::{excitations::Excitations, robot::Robot};
use crate::{
    dynamics::{Floating, Input, Momentum, State, Workspace},
    model::{Frame, Model},
    spatial::{Pose, Wrench},
};

/// Axes in which a wrench is given.
#[derive(Debug, Clone, PartialEq)]
pub enum WrenchAxes {
    /// Axes of a frame of the robot; the wrench turns with the frame.
    Robot(Frame),
    /// Axes of the world.
    World,
}

/// A wrench on a link over a time interval.
#[derive(Debug, Clone, PartialEq)]
pub struct ExternalWrench {
    /// The link that it acts on.
    pub link: Frame,
    /// Axes of force, torque and point.
    pub axes: WrenchAxes,
    /// Where the force acts \[m\]: in the frame that gives the axes, or, in world axes, relative to the link's origin.
    pub point: Vector3<f64>,
    /// Torque \[N m\] and force \[N\] about the point.
    pub wrench: Wrench,
    /// Start \[s\].
    pub from: f64,
    /// End \[s\]; may be infinite.
    pub until: f64,
    /// Whether it came by topic: the next wrench from the topic on the same link replaces it.
    pub is_streamed: bool,
}

/// Momentum and work that external wrenches have added since the start.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ExternalChange {
    /// Change of momentum in world axes.
    pub momentum_W: Momentum,
    /// Work done on the robot \[J\].
    pub work: f64,
}

/// The wrenches on a robot.
pub struct ExternalWrenches {
    wrenches: Vec<ExternalWrench>,
    change: ExternalChange,
    /// The change saved by [`Self::save_change`].
    saved: ExternalChange,
    /// Whether any wrench or thruster has acted since the start.
    has_acted: bool,
    /// Whether the robot's held input contains a wrench.
    is_set: bool,
    /// Poses of the links at a stage of an integration step.
    workspace: Workspace,
    /// Joint positions before an integration step.
    q: Vec<f64>,
    efforts: Vec<f64>,
    excitations: Excitations,
}

/// Maximum number of wrenches that act or wait at a time.
const MOST: usize = 1000;

impl ExternalWrenches {
    /// No wrenches and no excitations.
    pub fn new(model: &Model) -> Self {
        Self {
            wrenches: Vec::new(),
            change: ExternalChange::default(),
            saved: ExternalChange::default(),
            has_acted: false,
            is_set: false,
            workspace: Workspace::new(model),
            q: vec![0.0; model.dof()],
            efforts: vec![0.0; model.dof()],
            excitations: Excitations::default(),
        }
    }

    /// Adds excitations.
    #[must_use]
    pub fn with_excitations(self, excitations: Excitations) -> Self {
        Self {
            excitations,
            ..self
        }
    }

    /// The excitations.
    pub fn excitations(&self) -> &Excitations {
        &self.excitations
    }

    /// Adds a wrench. A streamed wrench replaces the previous streamed one on its link.
    ///
    /// # Errors
    /// A line, if there are too many wrenches.
    pub fn add(&mut self, wrench: ExternalWrench) -> Result<(), String> {
        if wrench.is_streamed {
            self.wrenches
                .retain(|w| !w.is_streamed || w.link.name != wrench.link.name);
        }
        if self.wrenches.len() >= MOST {
            return Err(format!("{MOST} wrenches wait or act already; clear some"));
        }
        self.wrenches.push(wrench);
        Ok(())
    }

    /// Removes the wrenches on `link`, or all. Returns the number removed.
    pub fn clear(&mut self, link: Option<&str>) -> usize {
        let before = self.wrenches.len();
        let is_cleared = |w: &ExternalWrench| link.is_none_or(|link| w.link.name == link);
        self.wrenches.retain(|w| !is_cleared(w));
        before - self.wrenches.len()
    }

    /// Restores the state at the start: no wrenches, and no change of momentum. A change that was published before
    /// continues to be published, as zero.
    pub fn reset(&mut self, robot: &mut Robot) {
        self.wrenches.clear();
        self.unset(robot);
        self.change = ExternalChange::default();
    }

    /// Saves the change so far, before steps that may diverge.
    pub fn save_change(&mut self) {
        self.saved = self.change;
    }

    /// Discards the steps since [`Self::save_change`], which have diverged: restores the saved change, and removes all
    /// wrenches.
    pub fn undo_step(&mut self, robot: &mut Robot) {
        self.wrenches.clear();
        self.unset(robot);
        self.change = self.saved;
    }

    /// The change of momentum and the work; `None` if neither a wrench nor a thruster has acted.
    pub fn change(&self) -> Option<&ExternalChange> {
        self.has_acted.then_some(&self.change)
    }

    /// Whether there are neither wrenches nor excitations, acting or scheduled.
    pub fn are_none(&self) -> bool {
        self.wrenches.is_empty() && !self.is_set && self.excitations.are_none()
    }

    /// The first time in `(time, end)` at which a wrench or excitation begins or ends; `end` \[s\] if there is none.
    pub fn next_change(&self, time: f64, end: f64) -> f64 {
        let times = self.wrenches.iter().flat_map(|w| [w.from, w.until]);
        let times = times.chain(self.excitations.changes());
        let within = times.filter(|t| *t > time + 1e-12);
        within.fold(end, f64::min)
    }

    /// Calls `read` on the robot with the excitations at `time` \[s\] added to its held input.
    pub fn while_excited<T>(
        &mut self,
        robot: &mut Robot,
        time: f64,
        read: impl FnOnce(&mut Robot) -> T,
    ) -> T {
        if !self.excitations.act_from(time) {
            return read(robot);
        }
        let Self { excitations, .. } = self;
        excitations.save(robot);
        excitations.add_to(robot, time);
        let found = read(robot);
        excitations.restore(robot);
        found
    }

    /// Advances the robot from `time` \[s\] by `steps` steps of `dt` \[s\], under the wrenches and excitations that act
    /// at `time`. Impulse and work of its thrusters are recorded as well.
    pub fn step(&mut self, robot: &mut Robot, time: f64, dt: f64, steps: usize) {
        let is_excited = self.excitations.act_from(time);
        if self.wrenches.is_empty() && !self.is_set && !is_excited && !robot.is_firing() {
            return robot.step(dt, steps);
        }
        self.wrenches.retain(|w| w.until > time + 1e-12);
        let acts = |w: &ExternalWrench| w.from <= time + 1e-12;
        let any_acts = self.wrenches.iter().any(acts) || self.excitations.link_wave_acts_from(time);
        if !any_acts {
            self.unset(robot);
            if !robot.is_firing() && !is_excited {
                return robot.step(dt, steps);
            }
        }
        self.is_set = any_acts;
        // Simulated time minus time of the robot's state: they differ after a reset of time alone.
        let ahead = time - robot.state().time;
        if is_excited {
            self.excitations.save(robot);
            self.excitations.add_to(robot, time);
        }
        for _ in 0..steps {
            let is_pushed = any_acts || robot.is_firing();
            let before = Before::of(robot);
            self.q.clear();
            self.q.extend(whole(robot).q.iter());
            self.efforts.clear();
            self.efforts.extend(robot.efforts().iter());
            // Joints of a held target, which follow the robot's own joints, have no efforts.
            self.efforts.resize(self.q.len(), 0.0);
            let Self {
                wrenches,
                workspace,
                excitations,
                ..
            } = self;
            let mut set_at = |at: f64, state: &State, input: &mut Input, torques: &mut [f64]| {
                let now = at + ahead;
                if any_acts {
                    let held = wrenches.iter().filter(|w| acts(w)).map(|w| (w, 1.0));
                    let all = held.chain(excitations.wrenches(time, now));
                    set(all, state, workspace, input);
                }
                excitations.add(time, now, input.efforts.as_mut_slice(), torques);
            };
            match any_acts || is_excited {
                true => robot.step_with(dt, &mut set_at),
                false => robot.step(dt, 1),
            }
            if is_pushed {
                self.has_acted = true;
                self.record(robot, &before);
            }
        }
        if is_excited {
            self.excitations.restore(robot);
        }
    }

    /// Removes all wrenches from the robot's held input.
    fn unset(&mut self, robot: &mut Robot) {
        if std::mem::take(&mut self.is_set) {
            robot.input_mut().wrenches.fill(Wrench::ZERO);
        }
    }

    /// Adds the changes of momentum and work in one step.
    fn record(&mut self, robot: &Robot, before: &Before) {
        let (state, momentum_W) = (whole(robot), robot.whole_momentum());
        self.change.momentum_W.linear += momentum_W.linear - before.momentum_W.linear;
        self.change.momentum_W.angular += momentum_W.angular - before.momentum_W.angular;
        self.change.work += match robot.flexible() {
            Some(robot) => robot.state().partial_work().external - before.external_work,
            None => {
                let of_joints = self.work_of_joints(robot);
                let of_contacts = robot.contact_work() - before.contact_work;
                state.work + state.dissipated.total() - before.energy - of_joints - of_contacts
            }
        };
    }

    /// Work of joint efforts and springs in a step of a rigid robot \[J\], from the positions `self.q` and efforts
    /// `self.efforts` before the step.
    fn work_of_joints(&self, robot: &Robot) -> f64 {
        let Some(robot) = robot.rigid_whole() else {
            return 0.0;
        };
        let state = robot.state();
        let joints = robot.model().joints().iter().zip(robot.efforts());
        let of_joints = joints.enumerate().map(|(j, (joint, effort))| {
            let (a, b) = (self.q[j], state.q[j]);
            let effort = 0.5 * (self.efforts[j] + effort);
            let spring = joint.spring.stiffness * (joint.spring.rest - 0.5 * (a + b));
            (effort + spring) * (b - a)
        });
        of_joints.sum()
    }
}

/// State of the robot including a held target.
fn whole(robot: &Robot) -> &State {
    robot.rigid_whole().map_or(robot.state(), Floating::state)
}

/// Momentum and energies before a step.
struct Before {
    momentum_W: Momentum,
    /// Work and dissipation of a rigid robot \[J\].
    energy: f64,
    /// External work on a robot with flexible parts \[J\].
    external_work: f64,
    /// Work of contacts \[J\].
    contact_work: f64,
}

impl Before {
    fn of(robot: &Robot) -> Self {
        let state = whole(robot);
        Self {
            momentum_W: robot.whole_momentum(),
            energy: state.work + state.dissipated.total(),
            contact_work: robot.contact_work(),
            external_work: robot
                .flexible()
                .map_or(0.0, |robot| robot.state().partial_work().external),
        }
    }
}

/// Sets the wrenches of `input` to those that act in `state`, each multiplied by its factor.
fn set<'a>(
    wrenches: impl Iterator<Item = (&'a ExternalWrench, f64)>,
    state: &State,
    workspace: &mut Workspace,
    input: &mut Input,
) {
    workspace.set_positions(&state.q);
    input.wrenches.fill(Wrench::ZERO);
    for (wrench, factor) in wrenches {
        input.wrenches[wrench.link.body] += on_body(wrench, state, workspace) * factor;
    }
}

/// The wrench about the origin of its body's frame, in body axes. `workspace` has the positions of `state`.
fn on_body(wrench: &ExternalWrench, state: &State, workspace: &Workspace) -> Wrench {
    let link = &wrench.link;
    let X_BL = &link.X_BF;
    let X_BA = match &wrench.axes {
        WrenchAxes::Robot(frame) if frame.body == link.body => frame.X_BF,
        WrenchAxes::Robot(frame) => X_BL * workspace.X_BF(link).inverse() * workspace.X_BF(frame),
        WrenchAxes::World => {
            let R_WL = state.R_WB.to_rotation_matrix() * workspace.X_BF(link).rotation;
            Pose::from_parts(X_BL.translation, X_BL.rotation * R_WL.inverse())
        }
    };
    let at = X_BA * nalgebra::Point3::from(wrench.point);
    let at_point = Pose::from_parts(at.coords.into(), X_BA.rotation);
    wrench.wrench.shifted_to_parent(&at_point)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        dynamics::{Floating, IntegrationMethod, State},
        nodes::dynamics::FreeBody as _,
    };
    use nalgebra::UnitQuaternion;

    fn robot() -> Robot {
        let xml = include_str!("../../../urdf/seven_joints.urdf");
        let model = Model::from_urdf(xml, "seven_joints").unwrap();
        let q = nalgebra::DVector::from_row_slice(&[0.3, 0.6, -0.2, 1.4, 0.2, 0.9, 0.1]);
        let mut state = State::at_rest_with(&model, &q);
        state.R_WB = UnitQuaternion::from_euler_angles(0.3, -0.5, 1.1);
        Floating::new(model, state, IntegrationMethod::Rk4).into()
    }

    fn wrench(robot: &Robot, link: &str, axes: WrenchAxes) -> ExternalWrench {
        ExternalWrench {
            link: robot.model().frame(link).unwrap().clone(),
            axes,
            point: Vector3::zeros(),
            wrench: Wrench::new(Vector3::new(0.1, 0.2, -0.3), Vector3::new(3.0, -1.0, 2.0)),
            from: 0.5,
            until: 1.25,
            is_streamed: false,
        }
    }

    /// Steps to `end` as the world does.
    fn run(robot: &mut Robot, wrenches: &mut ExternalWrenches, end: f64) {
        let mut time = 0.0;
        while time < end - 1e-12 {
            let next = wrenches.next_change(time, f64::min(time + 0.01, end));
            wrenches.step(robot, time, next - time, 1);
            time = next;
        }
    }

    // A constant force in the world's axes changes momentum by force times time, to the last digits, although the link
    // turns and the duration is no multiple of the step. The recorded change accounts for the momentum that the bodies
    // carry, and the work for the energy.
    #[test]
    fn a_force_in_world_axes_changes_momentum_by_force_times_time() {
        let mut robot = robot();
        let mut wrenches = ExternalWrenches::new(robot.model());
        // The last link is light and turns fast.
        let given = wrench(&robot, "tool0", WrenchAxes::World);
        let force = given.wrench.force;
        wrenches
            .add(ExternalWrench {
                until: 1.2534,
                ..given
            })
            .unwrap();
        assert!(wrenches.change().is_none());
        run(&mut robot, &mut wrenches, 2.0);
        let change = *wrenches.change().unwrap();
        let off = (change.momentum_W.linear - force * 0.7534).norm();
        println!("off by {off} N s");
        assert!(off < 1e-12, "{off}");
        let carried = robot.carried_momentum();
        let linear = carried.linear - change.momentum_W.linear;
        let angular = carried.angular - change.momentum_W.angular;
        assert!(
            linear.norm() < 1e-12 && angular.norm() < 1e-12,
            "{linear} {angular}"
        );
        // The last joint runs into its stop.
        let energy = robot.kinetic_energy() + robot.state().dissipated.total();
        assert!(
            (energy - change.work).abs() < 1e-9 * energy,
            "{energy} {}",
            change.work
        );
        assert!(energy > 0.01);
    }

    // A force in the link's own axes at a point of it, against the torque about the centre of mass of a robot that
    // hardly moves.
    #[test]
    fn the_point_of_a_force_gives_its_torque() {
        let mut robot = robot();
        let mut wrenches = ExternalWrenches::new(robot.model());
        let frame = robot.model().frame("tool0").unwrap().clone();
        let X_0F = robot.X_BF(&frame);
        let point = Vector3::new(0.02, -0.04, 0.05);
        let mut given = wrench(&robot, "link7", WrenchAxes::Robot(frame));
        (given.point, given.from, given.until) = (point, 0.0, 1e-4);
        let Wrench { torque, force } = given.wrench;
        wrenches.add(given).unwrap();
        let R = robot.state().R_WB * UnitQuaternion::from(X_0F.rotation);
        let at = X_0F * nalgebra::Point3::from(point);
        let p_BC = *robot.rigid().unwrap().workspace().p_BC();
        let arm = robot.state().R_WB * (at.coords - p_BC);
        let expected = (R * torque + arm.cross(&(R * force))) * 1e-4;
        run(&mut robot, &mut wrenches, 0.01);
        let change = wrenches.change().unwrap();
        let off = (change.momentum_W.angular - expected).norm() / expected.norm();
        assert!(off < 1e-6, "{off}");
    }

    #[test]
    fn streamed_wrenches_replace_each_other_and_all_can_be_cleared() {
        let robot = robot();
        let mut wrenches = ExternalWrenches::new(robot.model());
        for link in ["link6", "link6", "link7"] {
            let mut streamed = wrench(&robot, link, WrenchAxes::World);
            streamed.is_streamed = true;
            wrenches.add(streamed).unwrap();
        }
        wrenches
            .add(wrench(&robot, "link6", WrenchAxes::World))
            .unwrap();
        assert_eq!(wrenches.clear(Some("link6")), 2);
        assert_eq!(wrenches.clear(None), 1);
        for _ in 0..MOST {
            wrenches
                .add(wrench(&robot, "link6", WrenchAxes::World))
                .unwrap();
        }
        let refused = wrenches.add(wrench(&robot, "link6", WrenchAxes::World));
        assert!(refused.unwrap_err().contains("clear some"));
    }
}
