//! Does the physics in a bag hold? What `fuyu bag check` asks of a recording.

use nalgebra::{DVector, Isometry3, Vector3};
use serde::Serialize;
use std::collections::HashMap;

use super::recorded::{BaseSample, JointSample, MomentumSample, RecordedRun, RecordedRuns};
use super::topic_health::{TopicHealth, TopicWatch};
use crate::bag::{Bag, Damage};
use crate::dynamics::{Momentum, State, Workspace};
use crate::model::Model;

/// How large a deviation may be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CheckLimits {
    /// Change of momentum, relative to the momentum that the bodies carry or start with.
    pub momentum: f64,
    /// Energy that is not accounted for, relative to the energy that flowed. Efforts that change between
    /// samples are not seen, hence no smaller.
    pub energy: f64,
    /// Final distance of the tip from its goal \[m\].
    pub position: f64,
    /// Final angle of the tip from its goal \[rad\].
    pub attitude: f64,
    /// Gap in a periodic topic, in median periods ...
    pub gap_periods: f64,
    /// ... if it is also longer than this \[s\].
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

/// How a check ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// It holds.
    Passed,
    /// It does not.
    Failed,
    /// The bag lacks what it needs.
    Skipped,
    /// Worth knowing, but no failure.
    Noted,
}

/// One line of the report.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CheckLine {
    /// What was checked; behind a namespace if the robot has one.
    pub name: String,
    /// How it ended.
    pub verdict: Verdict,
    /// What was found.
    pub value: Option<f64>,
    /// What is allowed.
    pub limit: Option<f64>,
    /// Unit of both; empty for ratios and counts.
    pub unit: &'static str,
    /// In words.
    pub detail: String,
}

/// What `fuyu bag check` reports.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CheckReport {
    /// The bag.
    pub bag: String,
    /// Whether no check failed.
    pub passed: bool,
    /// The checks.
    pub checks: Vec<CheckLine>,
    /// How each topic came.
    pub topics: Vec<TopicHealth>,
}

/// Checks a bag.
pub fn check_bag(bag: &Bag, limits: &CheckLimits) -> CheckReport {
    let mut runs = RecordedRuns::default();
    let mut watch = TopicWatch::default();
    let mut messages = bag.messages();
    for message in messages.by_ref() {
        runs.accept(&message);
        watch.accept(&message);
    }
    let topics = watch.finish();
    let mut report = Report::default();
    report.wholeness(&messages.damage());
    for (namespace, run) in runs.robots() {
        report.prefix = match namespace.trim_start_matches('/') {
            "" => String::new(),
            name => format!("{name}: "),
        };
        report.momentum(run, limits);
        report.momentum_from_motion(run, limits);
        report.energy(run, limits);
        report.tip_error(run, limits);
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

    /// Passed if `value` is within `limit`; NaN is not.
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
            [] => self.add("recording", Verdict::Passed, None, "closed and whole"),
            [only] if only.what.contains("not closed") || only.what.contains("ends") => self.add(
                "recording",
                Verdict::Noted,
                None,
                format!("cut off: {}; checked up to there", only.what),
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

    /// The same from recorded velocities, whatever the dynamics node says about its momentum.
    fn momentum_from_motion(&mut self, run: &RecordedRun, limits: &CheckLimits) {
        const NAME: &str = "momentum from velocities";
        let model = match &run.model {
            None => return self.skip(NAME, "no robot_description"),
            Some(Err(e)) => return self.add(NAME, Verdict::Failed, None, e.clone()),
            Some(Ok(model)) => model,
        };
        let Some(mut motion) = Motion::new(model, &run.joint_names) else {
            return self.skip(NAME, "joint_states and robot_description name other joints");
        };
        let samples: Vec<(Momentum, (f64, f64))> =
            paired(run).map(|(j, b)| motion.momentum(j, b)).collect();
        let Some((first, _)) = samples.first() else {
            return self.skip(
                NAME,
                "no joint_states and ground_truth/odom of the same time",
            );
        };
        let carried = samples.iter().fold((0.0, 0.0), |s: (f64, f64), (_, c)| {
            (s.0.max(c.0), s.1.max(c.1))
        });
        let (linear_scale, _) = scale_of(first.linear.norm(), carried.0);
        let (angular_scale, _) = scale_of(first.angular.norm(), carried.1);
        let change = max(samples.iter().map(|(m, _)| {
            let linear = (m.linear - first.linear).norm() / linear_scale;
            let angular = (m.angular - first.angular).norm() / angular_scale;
            linear.max(angular)
        }));
        self.compare(
            NAME,
            change,
            limits.momentum,
            "",
            format!(
                "computed from {} joint states and odometries; relative to {linear_scale:.3} N s and {angular_scale:.3} N m s",
                samples.len()
            ),
        );
    }

    /// Kinetic energy against the work of joint efforts.
    fn energy(&mut self, run: &RecordedRun, limits: &CheckLimits) {
        const NAME: &str = "energy balance";
        let energy: HashMap<i64, f64> = run
            .momentum
            .iter()
            .map(|m| (m.time, m.kinetic_energy))
            .collect();
        if energy.is_empty() {
            return self.skip(NAME, "no ground_truth/momentum");
        }
        if !run.joints.iter().any(|j| !j.effort.is_empty()) {
            return self.skip(NAME, "joint_states carry no effort");
        }
        let damping = damping(run);
        let mut start = None;
        let (mut work, mut flow, mut largest, mut residual) = (0.0, 0.0, 0.0f64, 0.0f64);
        let mut compared = 0;
        for pair in run.joints.windows(2) {
            let now = energy.get(&pair[0].time);
            if start.is_none() {
                start = now.map(|e| (*e, work));
            }
            let (step, moved) = work_between(&pair[0], &pair[1], &damping);
            work += step;
            flow += moved;
            if let (Some((e0, w0)), Some(e1)) = (start, energy.get(&pair[1].time)) {
                residual = residual.max(((e1 - e0) - (work - w0)).abs());
                largest = largest.max(*e1);
                compared += 1;
            }
        }
        if compared == 0 {
            return self.skip(
                NAME,
                "no joint_states and ground_truth/momentum of the same time",
            );
        }
        let scale = largest.max(flow);
        let relative = if residual == 0.0 {
            0.0
        } else {
            residual / scale
        };
        self.compare(
            NAME,
            relative,
            limits.energy,
            "",
            format!("{residual:.1e} J not accounted for, of {scale:.3} J that flowed (peak kinetic energy {largest:.3} J)"),
        );
    }

    fn tip_error(&mut self, run: &RecordedRun, limits: &CheckLimits) {
        let said = run
            .controller
            .last()
            .map(|s| (s.position_error, s.attitude_error));
        let seen = run
            .seen_tip
            .zip(run.seen_goal)
            .map(|(tip, goal)| deviation(&tip, &goal));
        let truth = true_tip_error(run);
        let sources = [
            ("final tip error, controller", "last controller/state", said),
            (
                "final tip error, camera",
                "last camera/tip_pose and camera/goal_pose",
                seen,
            ),
            (
                "final tip error, tf",
                "last tf of tool0 and goal_pose",
                truth,
            ),
        ];
        if sources.iter().all(|s| s.2.is_none()) {
            return self.skip(
                "final tip error",
                "no controller/state, no camera poses, no tf with goal_pose",
            );
        }
        for (name, source, error) in sources {
            let Some((position, attitude)) = error else {
                continue;
            };
            self.compare(
                &format!("{name}: position"),
                position,
                limits.position,
                "m",
                source,
            );
            self.compare(
                &format!("{name}: attitude"),
                attitude,
                limits.attitude,
                "rad",
                source,
            );
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
            "numbers that are not finite",
            topics,
            |t| t.not_finite.as_ref().map_or(0, |n| n.1),
            |t| {
                let field = t.not_finite.as_ref().map_or("", |n| n.0.as_str());
                format!("{}, field {field}", t.name)
            },
        );
        self.count(
            "messages that do not decode",
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
            let detail = format!("types that fuyu does not know: {}", unknown.join(", "));
            self.add("not looked into", Verdict::Noted, None, detail);
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

/// Change of a momentum since the start.
pub struct Residual {
    /// Stamps \[ns\] and changes relative to `scale`.
    pub values: Vec<(i64, f64)>,
    /// What the changes are relative to.
    pub scale: f64,
    /// What that is.
    pub scale_of: &'static str,
}

/// Residuals of linear and angular momentum as `ground_truth/momentum` states them.
pub fn momentum_residuals(run: &RecordedRun) -> Option<[Residual; 2]> {
    let first = run.momentum.first()?;
    let carried = carried(run);
    let residual = |pick: fn(&MomentumSample) -> Vector3<f64>, carried: f64| {
        let start = pick(first);
        let (scale, scale_of) = scale_of(start.norm(), carried);
        let values = run
            .momentum
            .iter()
            .map(|m| (m.time, (pick(m) - start).norm() / scale))
            .collect();
        Residual {
            values,
            scale,
            scale_of,
        }
    };
    Some([
        residual(|m| m.linear, carried.0),
        residual(|m| m.angular, carried.1),
    ])
}

fn max(values: impl Iterator<Item = f64>) -> f64 {
    // NaN must not be lost in a comparison.
    values.fold(0.0, |m, v| if v > m || v.is_nan() { v } else { m })
}

/// What a momentum is compared with, and what that is called.
fn scale_of(initial: f64, carried: f64) -> (f64, &'static str) {
    if initial >= carried && initial > 0.0 {
        (initial, "at the start")
    } else if carried > 0.0 {
        (carried, "carried by the bodies, summed without sign")
    } else {
        (1.0, "(nothing moves)")
    }
}

/// Largest sum of the momenta that single bodies carry (linear, angular); zero if it is not known.
fn carried(run: &RecordedRun) -> (f64, f64) {
    let Some(Ok(model)) = &run.model else {
        return (0.0, 0.0);
    };
    let Some(mut motion) = Motion::new(model, &run.joint_names) else {
        return (0.0, 0.0);
    };
    paired(run)
        .map(|(j, b)| motion.momentum(j, b).1)
        .fold((0.0, 0.0), |s, c| (s.0.max(c.0), s.1.max(c.1)))
}

/// Joint states and base states of the same time.
fn paired(run: &RecordedRun) -> impl Iterator<Item = (&JointSample, &BaseSample)> {
    let base: HashMap<i64, &BaseSample> = run.base.iter().map(|b| (b.time, b)).collect();
    run.joints
        .iter()
        .filter_map(move |j| Some((j, *base.get(&j.time)?)))
}

/// Momentum from recorded joint and base velocities.
struct Motion<'a> {
    model: &'a Model,
    workspace: Workspace,
    state: State,
    /// Place in the model of each recorded joint.
    order: Vec<usize>,
}

impl<'a> Motion<'a> {
    fn new(model: &'a Model, names: &[String]) -> Option<Self> {
        let order: Vec<usize> = names
            .iter()
            .map(|name| model.joint_index(name))
            .collect::<Option<_>>()?;
        (order.len() == model.dof()).then(|| Self {
            model,
            workspace: Workspace::new(model),
            state: State::at_rest(model),
            order,
        })
    }

    /// Momentum in world axes, and the sum of what single bodies carry.
    fn momentum(&mut self, joints: &JointSample, base: &BaseSample) -> (Momentum, (f64, f64)) {
        let state = &mut self.state;
        for (i, &j) in self.order.iter().enumerate() {
            state.q[j] = joints.q[i];
            state.qd[j] = joints.qd[i];
        }
        let X_WB = &base.X_WB;
        state.set_base(self.model, &mut self.workspace, X_WB, &base.V_WB_B);
        self.workspace.set_motion(state);
        (state.momentum_W, self.workspace.momentum_scale(self.model))
    }
}

/// Viscous damping of each recorded joint.
fn damping(run: &RecordedRun) -> DVector<f64> {
    DVector::from_iterator(
        run.joint_names.len(),
        run.joint_names.iter().map(|name| match &run.model {
            Some(Ok(model)) => model
                .joint_index(name)
                .map_or(0.0, |j| model.joints()[j].damping),
            _ => 0.0,
        }),
    )
}

/// Work of efforts less damping losses between two samples \[J\], and the sum of its parts without sign.
fn work_between(a: &JointSample, b: &JointSample, damping: &DVector<f64>) -> (f64, f64) {
    let dt = (b.time - a.time) as f64 * 1e-9;
    let (mut work, mut flow) = (0.0, 0.0);
    for (j, c) in damping.iter().enumerate() {
        // A sample's effort acted since the one before; rates in between are taken as linear.
        let done = b.effort.get(j).copied().unwrap_or(0.0) * (b.q[j] - a.q[j]);
        let lost = c * dt * (a.qd[j] * a.qd[j] + a.qd[j] * b.qd[j] + b.qd[j] * b.qd[j]) / 3.0;
        work += done - lost;
        flow += done.abs() + lost;
    }
    (work, flow)
}

/// Distance \[m\] and angle \[rad\] between two poses.
fn deviation(a: &Isometry3<f64>, b: &Isometry3<f64>) -> (f64, f64) {
    (
        (a.translation.vector - b.translation.vector).norm(),
        a.rotation.angle_to(&b.rotation),
    )
}

/// The tip against the goal from tf, which neither the controller nor the camera makes.
fn true_tip_error(run: &RecordedRun) -> Option<(f64, f64)> {
    const TIP: &str = "tool0";
    run.frames.get(TIP)?;
    let (goal_frame, X_FD) = run.goal.as_ref()?;
    let (tip_root, X_RE) = run.pose_in_root(TIP);
    let (goal_root, X_RF) = run.pose_in_root(goal_frame);
    (tip_root == goal_root).then(|| deviation(&X_RE, &(X_RF * X_FD)))
}
