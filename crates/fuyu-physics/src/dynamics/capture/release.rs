//! Release: a joined system separates into robot and target.

use nalgebra::{Isometry3, UnitQuaternion, Vector3};

use super::captured::{Captured, total_momentum};
use super::grasp::Grasp;
use super::impulse::{Latch, LatchPair, System, push_apart};
use crate::dynamics::{Dissipated, Momentum, State, Workspace};
use crate::model::Frame;
use crate::spatial::Pose;

/// A spring at the grasp point that pushes the two apart at release.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReleaseSpring {
    /// Direction of the push on the target, axes of the robot's grasp frame.
    pub direction: Vector3<f64>,
    /// Energy that the spring gives to both bodies together \[J\].
    pub energy: f64,
}

/// Robot and target after a release.
#[derive(Debug, Clone, PartialEq)]
pub struct Released {
    /// State of the robot.
    pub robot: State,
    /// State of the target.
    pub target: State,
}

impl Captured {
    /// States of robot and target when the grasp opens, pushed apart by `spring`. Their total momentum is that of the
    /// joined system.
    pub fn release(&self, spring: Option<&ReleaseSpring>) -> Released {
        let (state, workspace) = (self.floating().state(), self.floating().workspace());
        let (mut of_robot, mut of_target) =
            (Workspace::new(self.robot()), Workspace::new(self.target()));
        let (q, qd) = self.target_joints();
        let mut target = State {
            time: state.time,
            q,
            qd,
            work: 0.0,
            dissipated: Dissipated::default(),
            ..State::at_rest(self.target())
        };
        let (X_WO, V_W) = self.target_motion();
        let mut V_O = V_W;
        V_O.angular = X_WO.rotation.inverse() * V_W.angular;
        V_O.linear = X_WO.rotation.inverse() * V_W.linear;
        target.set_base(&mut of_target, &isometry(&X_WO), &V_O);

        let (q, qd) = self.robot_joints();
        let mut robot = State {
            q,
            qd,
            ..state.clone()
        };
        let X_WB = state.X_WB(workspace);
        robot.set_base(&mut of_robot, &isometry(&X_WB), workspace.V_WB_B());
        robot.R_WB = state.R_WB;
        // The robot's momentum is the total minus the target's, so that the sum is exact.
        let total = total_momentum(&[state], &robot.p_WC);
        let taken = total_momentum(&[&target], &robot.p_WC);
        robot.momentum_W = Momentum {
            linear: total.linear - taken.linear,
            angular: total.angular - taken.angular,
        };
        let Some(spring) = spring else {
            return Released { robot, target };
        };
        let [robot, target] = push(
            (&robot, &mut of_robot),
            (&target, &mut of_target),
            self.grasp(),
            spring,
        );
        Released { robot, target }
    }
}

/// Pushes robot and target, each with its scratch memory, apart by `spring` at the robot's frame of `grasp`. The
/// spring's energy counts as work on the robot.
pub(super) fn push(
    (robot, of_robot): (&State, &mut Workspace),
    (target, of_target): (&State, &mut Workspace),
    grasp: &Grasp,
    spring: &ReleaseSpring,
) -> [State; 2] {
    of_robot.set_positions(&robot.q);
    of_target.set_positions(&target.q);
    let X_WG = robot.X_WB(of_robot) * of_robot.X_BF(&grasp.robot);
    let at = Frame {
        X_BF: target.X_WB(of_target).inverse() * X_WG,
        ..grasp.target.clone()
    };
    let pair = LatchPair {
        first: (0, &grasp.robot),
        second: (1, &at),
        latch: Latch::Ball,
    };
    let mut systems = [
        System {
            state: robot,
            workspace: of_robot,
            joints: &[],
        },
        System {
            state: target,
            workspace: of_target,
            joints: &[],
        },
    ];
    let direction = X_WG.rotation * spring.direction;
    let pushed = push_apart(&mut systems, &pair, &direction, spring.energy);
    let [mut robot, target]: [State; 2] = pushed.states.try_into().expect("two systems");
    robot.work -= pushed.energy_lost;
    [robot, target]
}

fn isometry(X: &Pose) -> Isometry3<f64> {
    Isometry3::from_parts(
        X.translation,
        UnitQuaternion::from_rotation_matrix(&X.rotation),
    )
}
