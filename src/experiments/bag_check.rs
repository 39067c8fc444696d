//! Physical checks of a recording: `fuyu bag check`.

use serde::Serialize;

use super::recorded::{RecordedRun, RecordedRuns};
use super::recorded_mission::{STOPPED_RATE, base_rate_at, phases};
use super::recorded_names::{is_of_target, title_of};
use super::recorded_physics::{
    EnergyBalance, Missing, energy_balance, max, momentum_residuals, motion_momentum,
};
use super::recorded_runs::RunCounter;
use super::tip_check::{controlled, final_errors};
use super::topic_health::{TopicHealth, TopicWatch};
use crate::bag::{Bag, Damage};
use crate::msg::fuyu_msgs::MissionState;

/// Limits of the checks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CheckLimits {
    /// Change of momentum, relative to the initial momentum or the sum over the bodies.
    pub momentum: f64,
    /// Energy that the balance does not explain, relative to the energy exchanged. The default cannot be smaller, since
    /// changes of efforts between samples are not recorded.
    pub energy: f64,
    /// Final distance of the tip from its goal \[m\].
    pub position: f64,
    /// Final angle of the tip from its goal \[rad\].
    pub attitude: f64,
    /// A gap in a periodic topic is a failure if it exceeds this many median periods and [`Self::gap_seconds`].
    pub gap_periods: f64,
    /// See [`Self::gap_periods`] \[s\].
    pub gap_seconds: f64,
}

impl Default for CheckLimits {
    fn default() -> Self {
        Self {
            momentum: 1e-12,
            energy: 1e-3,
            position: 0.01,
            attitude: 2f64.to_radians(),
            gap_periods: 10.0,
            gap_seconds: 0.25,
        }
    }
}

/// Result of a check.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// Within the limit.
    Passed,
    /// Beyond the limit.
    Failed,
    /// The bag lacks the data.
    Skipped,
    /// Information only.
    Noted,
}

/// One line of the report.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CheckLine {
    /// Name of the check, prefixed with the robot's namespace if it has one.
    pub name: String,
    /// Result.
    pub verdict: Verdict,
    /// Measured value.
    pub value: Option<f64>,
    /// Allowed value.
    pub limit: Option<f64>,
    /// Unit of both; empty for ratios and counts.
    pub unit: &'static str,
    /// Explanation.
    pub detail: String,
}

/// Report of `fuyu bag check`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CheckReport {
    /// The bag.
    pub bag: String,
    /// Whether no check failed.
    pub passed: bool,
    /// The checks.
    pub checks: Vec<CheckLine>,
    /// Health of each topic.
    pub topics: Vec<TopicHealth>,
}

/// Checks a bag.
pub fn check_bag(bag: &Bag, limits: &CheckLimits) -> CheckReport {
    let mut runs_of_all = RecordedRuns::default();
    let mut watch = TopicWatch::default();
    let mut counter = RunCounter::default();
    let mut messages = bag.messages();
    for message in messages.by_ref() {
        runs_of_all.accept(&message);
        watch.accept(&message, counter.run_of(&message));
    }
    let topics = watch.finish();
    let mut report = Report::default();
    report.wholeness(&messages.damage());
    report.restarts(counter.restarts());
    for (namespace, runs) in runs_of_all.robot_runs() {
        let robot = match title_of(namespace).as_str() {
            "" => String::new(),
            name => format!("{name}: "),
        };
        for (i, run) in runs.iter().enumerate() {
            report.prefix = match runs.len() {
                1 => robot.clone(),
                _ => format!("{robot}run {}: ", i + 1),
            };
            match runs_of_all.was_touched(namespace) {
                true => report.touched(),
                false => {
                    report.momentum(run, limits);
                    report.momentum_from_motion(run, limits);
                    report.energy(run, limits);
                }
            }
            if !is_of_target(namespace) {
                let is_last = i + 1 == runs.len();
                match &run.mission {
                    Some(mission) => report.mission(run, mission, is_last),
                    None => report.tip_error(run, limits, is_last),
                }
            }
        }
    }
    report.prefix.clear();
    report.topics(&topics, limits);
    CheckReport {
        bag: bag.path().display().to_string(),
        passed: report.lines.iter().all(|l| l.verdict != Verdict::Failed),
        checks: report.lines,
        topics,
    }
}

#[derive(Default)]
struct Report {
    prefix: String,
    lines: Vec<CheckLine>,
}

impl Report {
    fn add(
        &mut self,
        name: &str,
        verdict: Verdict,
        value: Option<(f64, f64, &'static str)>,
        detail: impl Into<String>,
    ) {
        self.lines.push(CheckLine {
            name: format!("{}{name}", self.prefix),
            verdict,
            value: value.map(|v| v.0),
            limit: value.map(|v| v.1),
            unit: value.map_or("", |v| v.2),
            detail: detail.into(),
        });
    }

    /// Passed if `value` is within `limit`; NaN fails.
    fn compare(
        &mut self,
        name: &str,
        value: f64,
        limit: f64,
        unit: &'static str,
        detail: impl Into<String>,
    ) {
        let verdict = if value <= limit {
            Verdict::Passed
        } else {
            Verdict::Failed
        };
        self.add(name, verdict, Some((value, limit, unit)), detail);
    }

    fn skip(&mut self, name: &str, why: impl Into<String>) {
        self.add(name, Verdict::Skipped, None, why);
    }

    fn wholeness(&mut self, damage: &[Damage]) {
        match damage {
            [] => self.add("recording", Verdict::Passed, None, "closed and intact"),
            [only] if only.what.contains("not closed") || only.what.contains("ends") => self.add(
                "recording",
                Verdict::Noted,
                None,
                format!("truncated: {}; checked up to there", only.what),
            ),
            [first, ..] => self.add(
                "recording",
                Verdict::Failed,
                None,
                format!("damaged in {} places, first {first}", damage.len()),
            ),
        }
    }

    fn momentum(&mut self, run: &RecordedRun, limits: &CheckLimits) {
        let Some(residuals) = momentum_residuals(run) else {
            self.skip("linear momentum", "no ground_truth/momentum");
            self.skip("angular momentum", "no ground_truth/momentum");
            return;
        };
        let names = [("linear momentum", "N s"), ("angular momentum", "N m s")];
        for ((name, unit), r) in names.into_iter().zip(residuals) {
            let change = max(r.values.iter().map(|v| v.1));
            let (absolute, scale, what) = (change * r.scale, r.scale, r.scale_of);
            self.compare(
                name,
                change,
                limits.momentum,
                "",
                format!(
                    "changes by {absolute:.1e} {unit} at most, relative to {scale:.3} {unit} {what}"
                ),
            );
        }
    }

    /// Skips the balances of a target that was touched: they are part of the robot's checks.
    fn touched(&mut self) {
        let names = [
            "linear momentum",
            "angular momentum",
            "momentum from velocities",
            "energy balance",
        ];
        for name in names {
            self.skip(
                name,
                "something has touched this body, and what it has changed of it is not recorded",
            );
        }
    }

    /// Checks the momentum computed from recorded velocities, independent of `ground_truth/momentum`.
    fn momentum_from_motion(&mut self, run: &RecordedRun, limits: &CheckLimits) {
        const NAME: &str = "momentum from velocities";
        let moved = match motion_momentum(run) {
            Ok(moved) => moved,
            Err(Missing::Data(why)) => return self.skip(NAME, why),
            Err(Missing::Model(why)) => return self.add(NAME, Verdict::Failed, None, why),
        };
        let (linear, angular) = moved.scales;
        self.compare(
            NAME,
            moved.change,
            limits.momentum,
            "",
            format!(
                "computed from {} joint states and odometries; relative to {linear:.3} N s and {angular:.3} N m s",
                moved.samples
            ),
        );
    }

    /// Checks kinetic and strain energy against the work of joint efforts and wheel torques.
    fn energy(&mut self, run: &RecordedRun, limits: &CheckLimits) {
        const NAME: &str = "energy balance";
        let balance = match energy_balance(run) {
            Ok(balance) => balance,
            Err(why) => return self.skip(NAME, why),
        };
        let EnergyBalance {
            residual,
            unresolved,
            flow,
            peak,
        } = balance;
        let relative = if residual == 0.0 {
            0.0
        } else {
            residual / flow
        };
        self.compare(
            NAME,
            relative,
            limits.energy,
            "",
            format!(
                "{residual:.1e} J unexplained, of {flow:.3} J exchanged (peak kinetic energy {peak:.3} J); {unresolved:.1e} J \
                 explained by efforts that change between samples"
            ),
        );
    }

    fn restarts(&mut self, count: usize) {
        if count > 0 {
            let detail = format!(
                "time restarts {count} times (reset, or played again); each run is checked separately"
            );
            self.add("runs", Verdict::Noted, None, detail);
        }
    }

    /// Lists the phases of a mission and its result. Unless `is_last`, the run was ended by a reset and may be
    /// unfinished.
    fn mission(&mut self, run: &RecordedRun, mission: &MissionState, is_last: bool) {
        let phases = phases(mission);
        for (i, phase) in phases.iter().enumerate() {
            let (duration, start) = (phase.end - phase.start, phase.start);
            match phase.name {
                "done" => self.add("mission", Verdict::Passed, None, phase.outcome),
                "aborted" => {
                    let detail = format!("aborted at {start:.1} s: {}", phase.outcome);
                    self.add("mission", Verdict::Failed, None, detail);
                }
                name if i + 1 == phases.len() => {
                    let detail =
                        format!("in phase {name} since {start:.1} s when the recording ends");
                    let verdict = if is_last {
                        Verdict::Failed
                    } else {
                        Verdict::Noted
                    };
                    self.add("mission", verdict, None, detail);
                }
                name => {
                    let detail = format!("{duration:.1} s: {}", phase.outcome);
                    self.add(&format!("mission, {name}"), Verdict::Noted, None, detail);
                }
            }
            let has_stopped = phase.figure("angular velocity after").is_some();
            if phase.name == "detumble"
                && has_stopped
                && let Some(rate) = base_rate_at(run, phase.end)
            {
                let detail = "of the base, by ground_truth/odom";
                self.compare("rate after detumbling", rate, STOPPED_RATE, "rad/s", detail);
            }
        }
    }

    /// Checks the final tip error. Unless `is_last`, the run was ended by a reset and may be unfinished.
    fn tip_error(&mut self, run: &RecordedRun, limits: &CheckLimits, is_last: bool) {
        let errors = final_errors(run);
        if errors.is_empty() {
            return self.skip(
                "final tip error",
                "no controller/state, no camera poses, no tf with goal_pose",
            );
        }
        let controlled = controlled(run);
        for error in errors {
            let parts = [
                (
                    "position",
                    error.position,
                    limits.position,
                    "m",
                    controlled.position,
                    "k_p",
                ),
                (
                    "attitude",
                    error.attitude,
                    limits.attitude,
                    "rad",
                    controlled.attitude,
                    "k_o",
                ),
            ];
            for (part, deviation, limit, unit, is_controlled, gain) in parts {
                let name = format!("final tip error, {}: {part}", error.name);
                let (source, allowed) = (&error.source, deviation.allowed(limit));
                let why = match (is_controlled, is_last) {
                    (true, true) => {
                        self.compare(&name, deviation.value, allowed, unit, source.clone());
                        continue;
                    }
                    (false, _) => format!("{source}; the law does not control it: {gain} is 0"),
                    (true, false) => format!("{source}; the run was ended by a reset"),
                };
                self.add(
                    &name,
                    Verdict::Noted,
                    Some((deviation.value, allowed, unit)),
                    why,
                );
            }
        }
    }

    fn topics(&mut self, topics: &[TopicHealth], limits: &CheckLimits) {
        let gap = |t: &TopicHealth| t.largest_gap.unwrap_or(0.0);
        let allowed = |t: &TopicHealth| {
            (limits.gap_periods * t.median_period.unwrap_or(0.0)).max(limits.gap_seconds)
        };
        let periodic: Vec<_> = topics.iter().filter(|t| t.periodic).collect();
        let worst = periodic
            .iter()
            .max_by(|a, b| (gap(a) / allowed(a)).total_cmp(&(gap(b) / allowed(b))));
        match worst {
            None => self.skip("gaps in time", "no periodic topic"),
            Some(t) => self.compare(
                "gaps in time",
                gap(t),
                allowed(t),
                "s",
                format!(
                    "largest gap for its rate, of {} periodic topics: {} at {:.2} s, median period {:.4} s",
                    periodic.len(),
                    t.name,
                    t.largest_gap_at.unwrap_or(0.0),
                    t.median_period.unwrap_or(0.0),
                ),
            ),
        }
        self.count(
            "stamps running backwards",
            topics,
            |t| t.backwards,
            |t| t.name.clone(),
        );
        self.count(
            "values that are not finite",
            topics,
            |t| t.not_finite.as_ref().map_or(0, |n| n.1),
            |t| {
                let field = t.not_finite.as_ref().map_or("", |n| n.0.as_str());
                format!("{}, field {field}", t.name)
            },
        );
        self.count(
            "messages that cannot be decoded",
            topics,
            |t| t.malformed,
            |t| t.name.clone(),
        );
        let unknown: Vec<&str> = topics
            .iter()
            .filter(|t| !t.known_type)
            .map(|t| t.name.as_str())
            .collect();
        if !unknown.is_empty() {
            let detail = format!("unknown types: {}", unknown.join(", "));
            self.add("not checked", Verdict::Noted, None, detail);
        }
    }

    fn count(
        &mut self,
        name: &str,
        topics: &[TopicHealth],
        count: fn(&TopicHealth) -> u64,
        place: fn(&TopicHealth) -> String,
    ) {
        let total: u64 = topics.iter().map(count).sum();
        let detail = match topics.iter().find(|t| count(t) > 0) {
            None => format!("in {} topics", topics.len()),
            Some(t) => format!("first in {}", place(t)),
        };
        self.compare(name, total as f64, 0.0, "", detail);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        bag::{Topic, Writer, WriterOptions},
        msg::{fuyu_msgs::Momentum, nav_msgs::Odometry, sensor_msgs::JointState, std_msgs},
        nodes::{
            dynamics::{
                Description, FreeBody as _, InitialJoints, InitialMotion, Target, TargetParams,
                World, momentum, odometry, target_joint_states,
            },
            scenario::Scenario,
            topics,
        },
        ros::Time,
        spatial::Twist,
    };
    use nalgebra::{Isometry3, Vector3};

    const SAIL: &str = r#"<robot name="sail">
        <link name="hull"><inertial><mass value="40"/>
            <inertia ixx="20" iyy="20" izz="20" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <link name="panel"><inertial><mass value="10"/>
            <inertia ixx="5" iyy="5" izz="5" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <joint name="hinge" type="continuous"><parent link="hull"/><child link="panel"/><axis xyz="0 0 1"/></joint>
    </robot>"#;

    fn sail(rate: f64) -> TargetParams {
        TargetParams {
            name: "sail".to_owned(),
            description: Description::new(SAIL.to_owned(), "sail".to_owned(), true),
            motion: InitialMotion {
                pose: Isometry3::identity(),
                velocity_W: Vector3::zeros(),
                angular_velocity_B: Vector3::zeros(),
            },
            joints: InitialJoints {
                positions: vec![0.0],
                velocities: vec![rate],
            },
        }
    }

    // Would break if momentum given from outside, or that of another body of the same name, counted as a residual.
    #[test]
    fn a_target_that_is_moved_or_replaced_begins_another_run() {
        let scenario = Scenario::read("package://fuyu/config/positioning.yaml").unwrap();
        let params = scenario.dynamics().unwrap();
        let mut world = World::new(&params).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("bag");
        let mut writer = Writer::create(&path, WriterOptions::default()).unwrap();
        macro_rules! topic {
            ($topic:expr, $message:ty) => {{
                let name = format!("/{}", $topic.of("sail"));
                writer
                    .add_topic(Topic::of::<$message>(name, $topic.qos))
                    .unwrap()
            }};
        }
        let described = topic!(topics::TARGET_DESCRIPTION, std_msgs::String);
        let moved = topic!(topics::TARGET_ODOMETRY, Odometry);
        let joints = topic!(topics::TARGET_JOINT_STATES, JointState);
        let total = topic!(topics::TARGET_MOMENTUM, Momentum);
        let state = |writer: &mut Writer, world: &World| {
            let stamp = Time::from_secs_f64(world.time());
            let log = u64::try_from(stamp.as_nanos()).unwrap();
            let target = &world.targets[0];
            let odom = odometry(stamp, "sail", &target.body);
            writer.write_message(moved, log, &odom).unwrap();
            let states = target_joint_states(stamp, target);
            writer.write_message(joints, log, &states).unwrap();
            let momentum = momentum(stamp, &target.body);
            writer.write_message(total, log, &momentum).unwrap();
        };
        for rate in [0.2, -0.1] {
            let target = Target::new(&sail(rate), params.method, &params.joint_physics).unwrap();
            let log = u64::try_from(Time::from_secs_f64(world.time()).as_nanos()).unwrap();
            let text = std_msgs::String {
                data: target.description.clone(),
            };
            writer.write_message(described, log, &text).unwrap();
            world.targets = vec![target];
            for _ in 0..30 {
                // Once as a new state, and once repeated for late joiners.
                state(&mut writer, &world);
                state(&mut writer, &world);
                world.step_to_tick();
            }
            state(&mut writer, &world);
            let body = &mut world.targets[0].body;
            let spin = Twist::new(Vector3::new(0.0, 0.1, 0.3), Vector3::new(0.2, 0.0, 0.0));
            body.move_base(&Isometry3::translation(1.0, 0.0, 0.0), &spin)
                .unwrap();
            for _ in 0..30 {
                state(&mut writer, &world);
                world.step_to_tick();
            }
        }
        writer.finish().unwrap();
        let report = check_bag(&Bag::open(&path).unwrap(), &CheckLimits::default());
        let failed: Vec<_> = (report.checks.iter())
            .filter(|line| line.verdict == Verdict::Failed)
            .collect();
        assert!(failed.is_empty(), "{failed:?}");
        let runs = report.checks.iter();
        let runs = runs.filter(|line| line.name.ends_with("momentum from velocities"));
        assert_eq!(runs.count(), 4, "{:?}", report.checks);
    }
}
