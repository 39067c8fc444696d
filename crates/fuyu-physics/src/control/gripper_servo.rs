//! Gripper servo: moves one joint to a position with limited effort and rate, and reports whether it arrives or stalls.

/// Settings of a [`GripperServo`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GripperServoConfig {
    /// Inertia that the joint moves, including coupled joints \[kg or kg m²\].
    pub inertia: f64,
    /// Viscous damping of the joint, including coupled joints \[N s/m or N m s/rad\].
    pub damping: f64,
    /// Natural frequency of the rate loop \[rad/s\].
    pub bandwidth: f64,
    /// Lowest and highest position \[m or rad\].
    pub positions: [f64; 2],
    /// Largest effort \[N or N m\]; infinite for none.
    pub max_effort: f64,
    /// Largest rate \[m/s or rad/s\].
    pub max_rate: f64,
}

/// Goal of a gripper.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GripperGoal {
    /// Position of the gripper's joint \[m or rad\].
    pub position: f64,
    /// Largest effort \[N or N m\], in addition to the servo's own limit.
    pub max_effort: f64,
    /// Largest rate \[m/s or rad/s\], in addition to the servo's own limit.
    pub max_rate: f64,
}

impl GripperGoal {
    /// A goal at `position` \[m or rad\] with the limits of the servo.
    pub fn at(position: f64) -> Self {
        Self {
            position,
            max_effort: f64::INFINITY,
            max_rate: f64::INFINITY,
        }
    }
}

/// A cascade of a proportional position servo and a proportional-integral rate servo:
///
/// ```text
/// r = clamp(ω/4 (q_goal - q), ± r_max)
/// f = clamp(d r + 2 m ω (r - q̇) + m ω² ∫(r - q̇) dt, ± f_max)
/// ```
///
/// A gripper that closes on an object presses with the largest effort after a while, even if the goal is only slightly
/// behind the surface: the integral grows until the effort is limited. Once the joint has been blocked for 0.2 s, the
/// integral grows at least fast enough to reach the largest effort in 3 s: so a gripper can close slowly and press
/// hard. Joint friction changes neither that effort nor the final position of a free gripper. The servo is sampled, and
/// stable up to a period of `1/ω`.
#[derive(Debug, Clone, PartialEq)]
pub struct GripperServo {
    config: GripperServoConfig,
    goal: GripperGoal,
    /// Integral part of the effort \[N or N m\].
    integral: f64,
    /// Time for which the joint has been much slower than commanded \[s\].
    blocked: f64,
}

/// Fraction of the commanded rate below which the joint counts as blocked.
const BLOCKED_SHARE: f64 = 0.1;
/// Time for which the joint must be blocked before the servo presses \[s\].
const BLOCKED_TIME: f64 = 0.2;
/// Time in which the servo then reaches its largest effort \[s\].
const PRESSING_TIME: f64 = 3.0;

impl GripperServo {
    /// A servo that holds `position` \[m or rad\].
    pub fn new(config: GripperServoConfig, position: f64) -> Self {
        let mut servo = Self {
            config,
            goal: GripperGoal::at(position),
            integral: 0.0,
            blocked: 0.0,
        };
        servo.set_goal(servo.goal, position);
        servo
    }

    /// The servo's settings.
    pub fn config(&self) -> &GripperServoConfig {
        &self.config
    }

    /// The goal, within the limits of the servo.
    pub fn goal(&self) -> &GripperGoal {
        &self.goal
    }

    /// Moves to `goal` from now on, within the limits of position, effort and rate; the joint is at `position` \[m or
    /// rad\]. A gripper that presses keeps its effort if the new goal is on the same side.
    pub fn set_goal(&mut self, goal: GripperGoal, position: f64) {
        let [lowest, highest] = self.config.positions;
        self.goal = GripperGoal {
            // `clamp` panics if a description has its limits in the wrong order.
            position: goal.position.max(lowest).min(highest),
            max_effort: goal.max_effort.min(self.config.max_effort),
            max_rate: goal.max_rate.min(self.config.max_rate),
        };
        if self.integral * (self.goal.position - position) < 0.0 {
            self.integral = 0.0;
        }
    }

    /// Effort \[N or N m\] for the next `dt` \[s\], at position `q` \[m or rad\] and rate `qd` \[m/s or rad/s\].
    pub fn effort(&mut self, q: f64, qd: f64, dt: f64) -> f64 {
        let GripperServoConfig {
            inertia,
            damping,
            bandwidth,
            ..
        } = self.config;
        let GripperGoal {
            position,
            max_effort,
            max_rate,
        } = self.goal;
        let rate = (0.25 * bandwidth * (position - q)).clamp(-max_rate, max_rate);
        let error = rate - qd;
        let direct = damping * rate + 2.0 * inertia * bandwidth * error;
        let mut step = inertia * bandwidth * bandwidth * error * dt;
        self.blocked = match qd.abs() < BLOCKED_SHARE * rate.abs() {
            true => self.blocked + dt,
            false => 0.0,
        };
        if self.blocked > BLOCKED_TIME && max_effort.is_finite() {
            step = (max_effort / PRESSING_TIME * dt)
                .max(step.abs())
                .copysign(rate);
        }
        // The integral must not grow while the effort is limited: it would have to shrink before the joint can reverse.
        let is_cut = (direct + self.integral).abs() >= max_effort;
        if !(is_cut && step * (direct + self.integral) > 0.0) {
            self.integral += step;
        }
        self.integral = self.integral.clamp(-max_effort, max_effort);
        (direct + self.integral).clamp(-max_effort, max_effort)
    }
}

/// Progress of a gripper towards its goal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GripperProgress {
    /// The gripper moves.
    Moving,
    /// The gripper is at the goal.
    Reached,
    /// The gripper has not moved for some time, away from the goal: it holds an object, or is blocked.
    Stalled,
}

/// Decides when a gripper has reached its goal or stalls.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GripperMonitor {
    /// Largest distance from the goal at which it counts as reached \[m or rad\].
    pub tolerance: f64,
    /// Rate below which the gripper does not move \[m/s or rad/s\].
    pub stall_rate: f64,
    /// Time without motion after which the gripper has stalled \[s\].
    pub stall_time: f64,
    /// Time of the last motion \[s\].
    moved: f64,
}

impl GripperMonitor {
    /// Watches from `time` \[s\] on.
    pub fn new(tolerance: f64, stall_rate: f64, stall_time: f64, time: f64) -> Self {
        Self {
            tolerance,
            stall_rate,
            stall_time,
            moved: time,
        }
    }

    /// The progress at `time` \[s\] towards `goal`, at position `q` \[m or rad\] and rate `qd` \[m/s or rad/s\].
    pub fn progress(&mut self, time: f64, goal: f64, q: f64, qd: f64) -> GripperProgress {
        if qd.abs() > self.stall_rate {
            self.moved = time;
        }
        if (goal - q).abs() <= self.tolerance {
            GripperProgress::Reached
        } else if time - self.moved >= self.stall_time {
            GripperProgress::Stalled
        } else {
            GripperProgress::Moving
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD: f64 = 0.01;

    fn servo() -> GripperServo {
        let config = GripperServoConfig {
            inertia: 2.0,
            damping: 500.0,
            bandwidth: 20.0,
            positions: [0.0, 0.1],
            max_effort: 100.0,
            max_rate: 0.05,
        };
        GripperServo::new(config, 0.0)
    }

    fn goal(position: f64, max_effort: f64) -> GripperGoal {
        GripperGoal {
            max_effort,
            ..GripperGoal::at(position)
        }
    }

    /// Position, rate and effort after `seconds` of a mass with a viscous damper \[N s/m\] in front of a wall, a spring of
    /// 1e6 N/m. The motion within a period is computed in small steps.
    fn moved(servo: &mut GripperServo, q: f64, damping: f64, wall: f64, seconds: f64) -> [f64; 3] {
        let (mut q, mut qd, mut effort) = (q, 0.0, 0.0);
        for _ in 0..(seconds / PERIOD).round() as usize {
            effort = servo.effort(q, qd, PERIOD);
            let dt = PERIOD / 1000.0;
            for _ in 0..1000 {
                let depth = f64::max(q - wall, 0.0);
                let contact = 1e6 * depth * (1.0 + 10.0 * qd).max(0.0);
                qd += (effort - damping * qd - contact) / 2.0 * dt;
                q += qd * dt;
            }
        }
        [q, qd, effort]
    }

    // Fails without the integral: unknown damping holds back a servo of 80 N s/m.
    #[test]
    fn it_arrives_at_the_limited_rate() {
        for (known, damping) in [(0.0, 0.0), (500.0, 500.0), (300.0, 500.0), (500.0, 300.0)] {
            let mut servo = servo();
            servo.config.damping = known;
            servo.set_goal(goal(0.06, 60.0), 0.0);
            let [q, qd, _] = moved(&mut servo.clone(), 0.0, damping, 1.0, 0.8);
            let is_known = known == damping;
            assert!(
                !is_known || (qd - 0.05).abs() < 1e-3,
                "{known} {damping}: {q} {qd}"
            );
            let [q, qd, _] = moved(&mut servo, 0.0, damping, 1.0, 8.0);
            assert!(
                (q - 0.06).abs() < 1e-4 && qd.abs() < 1e-4,
                "{known} {damping}: {q} {qd}"
            );
        }
    }

    // Fails if the force depends on how far the goal is behind the surface.
    #[test]
    fn it_presses_with_the_effort_of_the_goal() {
        for (position, effort) in [(0.1, 30.0), (0.06, 30.0), (0.1, 250.0)] {
            let mut servo = servo();
            servo.set_goal(goal(position, effort), 0.0);
            let [q, qd, pressed] = moved(&mut servo, 0.0, 500.0, 0.05, 12.0);
            let expected = f64::min(effort, 100.0);
            assert!((pressed - expected).abs() < 1e-9, "{position}: {pressed}");
            assert!((q - 0.05).abs() < 2e-4 && qd.abs() < 1e-3, "{q} {qd}");
            // A weaker grip on the same side has no gap; opening does not have to wait for the integral.
            servo.set_goal(goal(position, 20.0), q);
            assert!((servo.effort(q, 0.0, PERIOD) - 20.0).abs() < 1e-9);
            servo.set_goal(goal(0.0, 20.0), q);
            assert!(servo.effort(q, 0.0, PERIOD) < 0.0);
        }
    }

    // Fails without the faster integral of a blocked joint: at 5 mm/s it grows by 4 N/s only, to 12 N.
    #[test]
    fn a_slow_gripper_presses_as_hard_as_a_fast_one() {
        for rate in [0.005, 0.05] {
            let mut servo = servo();
            servo.config.max_rate = rate;
            servo.set_goal(goal(0.06, 90.0), 0.0);
            let [q, _, pressed] = moved(&mut servo, 0.0, 500.0, 0.005, 4.5);
            assert!((pressed - 90.0).abs() < 1e-9, "{rate}: {pressed}");
            assert!((q - 0.005).abs() < 2e-4, "{q}");
        }
    }

    #[test]
    fn goals_are_within_the_limits() {
        let mut servo = servo();
        let far = GripperGoal {
            position: 3.0,
            max_effort: 1e9,
            max_rate: 1e9,
        };
        servo.set_goal(far, 0.0);
        let expected = GripperGoal {
            position: 0.1,
            max_effort: 100.0,
            max_rate: 0.05,
        };
        assert_eq!(servo.goal(), &expected);
    }

    #[test]
    fn a_gripper_that_does_not_move_stalls_after_a_while() {
        let mut monitor = GripperMonitor::new(0.001, 0.001, 1.0, 0.0);
        for (time, q, qd, expected) in [
            (0.5, 0.0, 0.0, GripperProgress::Moving),
            (0.9, 0.0, 0.02, GripperProgress::Moving),
            (1.8, 0.03, 0.0, GripperProgress::Moving),
            (2.0, 0.03, 0.0, GripperProgress::Stalled),
            (1.9, 0.0495, 0.0, GripperProgress::Reached),
        ] {
            let progress = monitor.progress(time, 0.05, q, qd);
            assert_eq!(progress, expected, "at {time} s");
        }
    }
}
