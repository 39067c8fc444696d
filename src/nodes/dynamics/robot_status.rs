//! Diagnostics of the robot: divergence, joint limits, closed loops and deformation.

use std::time::{Duration, Instant};

use super::{params::DynamicsParams, robot::Robot, step_status::StepStatus};
use crate::{dynamics::State, model::Model, ros::Node};

/// Largest gap of a closed loop that counts as closed \[m or rad\].
const LARGEST_GAP: f64 = 1e-6;

/// Shortest time between two reports of the gaps. Diagnostics are published once a second.
const GAPS_PERIOD: Duration = Duration::from_millis(500);

/// Shortest time between two log messages about a divergence.
const LOG_PERIOD: Duration = Duration::from_secs(10);

/// The statuses `motion` and `limits`, with closed loops also `loop closures`, with appendages also `deformation`.
pub struct RobotStatus {
    motion: StepStatus,
    /// Number of times that a body was restored after its motion had diverged.
    restored: u64,
    logged: Option<Instant>,
    limits: StepStatus,
    loops: Option<StepStatus>,
    /// Whether the deformation is within the range of first-order modes; `None` for a robot without appendages.
    deformation: Option<StepStatus>,
    /// Time of the next report of the gaps.
    gaps_due: Instant,
}

impl RobotStatus {
    /// The statuses, before any report.
    pub fn new(node: &Node, params: &DynamicsParams) -> Self {
        let status = |name| StepStatus::new(node.diagnostics().status(name));
        Self {
            motion: status("motion"),
            restored: 0,
            logged: None,
            limits: status("limits"),
            loops: (!params.loop_closures.is_empty()).then(|| status("loop closures")),
            deformation: (!params.flexible.appendages.is_empty()).then(|| status("deformation")),
            gaps_due: Instant::now(),
        }
    }

    /// Reports the outcome of a step: an error if a body was restored after divergence.
    pub fn stepped(&mut self, outcome: Result<(), String>) {
        let Err(problem) = outcome else {
            self.motion.ok("finite");
            return;
        };
        let text = format!(
            "{problem}. It is stopped in its last state; efforts are zero until the next command"
        );
        self.restored += 1;
        if self.logged.is_none_or(|at| at.elapsed() > LOG_PERIOD) {
            tracing::error!("{text}");
            self.logged = Some(Instant::now());
        }
        self.motion.error(text);
        self.motion.set("restored", self.restored);
    }

    /// Reports the current state of the robot.
    pub fn report(&mut self, robot: &Robot) {
        match beyond_limits(robot.model(), robot.state()) {
            Some(problem) => self.limits.warn(problem),
            None => self.limits.ok("within the joints' limits"),
        }
        self.report_loops(robot);
        self.report_deformation(robot);
    }

    fn report_deformation(&mut self, robot: &Robot) {
        if let (Some(status), Some(robot)) = (&mut self.deformation, robot.flexible()) {
            match robot.workspace().first_order_excess(robot.state()) {
                Some(excess) => status.warn(excess.to_string()),
                None => status.ok("within what the modes describe"),
            }
        }
    }

    fn report_loops(&mut self, robot: &Robot) {
        let (Some(status), Some(robot)) = (&mut self.loops, robot.rigid()) else {
            return;
        };
        let now = Instant::now();
        let with_values = now >= self.gaps_due;
        if with_values {
            self.gaps_due = now + GAPS_PERIOD;
        }
        let mut open = None;
        for (closure, gap) in robot.loops().gaps(robot.workspace()) {
            let (name, m, rad) = (&closure.name, gap.translation, gap.rotation);
            if with_values {
                status.set(&format!("{name} gap [m]"), format!("{m:.1e}"));
                status.set(&format!("{name} gap [rad]"), format!("{rad:.1e}"));
            }
            if m.max(rad) > LARGEST_GAP {
                open = Some(format!(
                    "loop closure '{name}' is open by {m:.1e} m, {rad:.1e} rad: lower time_step"
                ));
            }
        }
        match open {
            Some(problem) => status.warn(problem),
            None => status.ok("closed"),
        }
    }
}

/// The first joint beyond its limits, as a line. Checked whether or not stops and speed limits are simulated.
fn beyond_limits(model: &Model, state: &State) -> Option<String> {
    let motion = state.q.iter().zip(&state.qd);
    (model.joints().iter().zip(motion)).find_map(|(joint, (q, qd))| {
        let (name, limits) = (&joint.name, &joint.limits);
        if *q < limits.lower || *q > limits.upper {
            let (lower, upper) = (limits.lower, limits.upper);
            Some(format!(
                "joint '{name}' is at {q:.4}, beyond its limits {lower} to {upper}"
            ))
        } else if qd.abs() > limits.velocity {
            let limit = limits.velocity;
            Some(format!(
                "joint '{name}' moves at {qd:.4}, faster than its limit {limit}"
            ))
        } else {
            None
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_joint_beyond_a_limit_is_named() {
        let joint = r#"<joint name="joint1" type="continuous">"#;
        let limited = r#"<joint name="joint1" type="revolute">
            <limit lower="-1" upper="1" effort="5" velocity="2"/>"#;
        let urdf = include_str!("../../../urdf/planar_two_link.urdf").replace(joint, limited);
        let model = Model::from_urdf(&urdf, "planar").unwrap();
        let mut state = State::at_rest(&model);
        assert_eq!(beyond_limits(&model, &state), None);
        state.qd[0] = -2.1;
        let line = beyond_limits(&model, &state).unwrap();
        assert!(
            line.contains("'joint1' moves at -2.1000, faster than its limit 2"),
            "{line}"
        );
        state.q[0] = 1.1;
        let line = beyond_limits(&model, &state).unwrap();
        assert!(
            line.contains("'joint1' is at 1.1000, beyond its limits -1 to 1"),
            "{line}"
        );
    }
}
