//! Conversion between ROS messages and the mission's inputs and commands.

use crate::{
    control::capture::{CaptureMission, Phase, RotationForecast},
    msg::{
        fuyu_msgs::{
            MissionState, ThrusterCommands,
            capture::{Feedback, Outcome},
        },
        geometry_msgs::{self, WrenchStamped},
        nav_msgs::Path,
        sensor_msgs::JointState,
        std_msgs::Header,
    },
    nodes::geometry::{unit_quaternion, vector_to_msg},
    ros::Time,
};
use nalgebra::Vector3;

/// The forecast of the target's rotation in a message of `estimator/prediction`.
///
/// # Errors
/// A line that says what is invalid.
pub fn forecast(path: &Path) -> Result<RotationForecast, String> {
    let time = |k: usize| Time::from(&path.poses[k].header.stamp).as_secs_f64();
    if path.poses.len() < 3 {
        return Err(format!(
            "{} attitudes; at least 3 are needed",
            path.poses.len()
        ));
    }
    let (start, last) = (time(0), path.poses.len() - 1);
    let period = (time(last) - start) / last as f64;
    let is_even = |k: usize| (time(k) - start - period * k as f64).abs() < 1e-3 * period;
    if !(period > 0.0 && (0..=last).all(is_even)) {
        return Err("its stamps are not at equal intervals".to_owned());
    }
    let attitudes = path.poses.iter().map(|pose| {
        let q = &pose.pose.orientation;
        unit_quaternion(q.x, q.y, q.z, q.w)
    });
    Ok(RotationForecast {
        start,
        period,
        attitudes: attitudes.collect::<Result<_, _>>()?,
    })
}

/// Efforts of joints, or motor torques of wheels, as a message.
pub fn efforts<'a>(
    names: impl IntoIterator<Item = &'a str>,
    header: Header,
    efforts: &[f64],
) -> JointState {
    JointState {
        header,
        name: names.into_iter().map(str::to_owned).collect(),
        effort: efforts.to_vec(),
        ..JointState::default()
    }
}

/// On-times of thrusters as a message.
pub fn on_times<'a>(
    names: impl IntoIterator<Item = &'a str>,
    header: Header,
    on_times: &[f64],
) -> ThrusterCommands {
    ThrusterCommands {
        header,
        name: names.into_iter().map(str::to_owned).collect(),
        on_time: on_times.to_vec(),
    }
}

/// A couple on the base as a message; the frame of `header` is the base.
pub fn couple(header: Header, couple: &Vector3<f64>) -> WrenchStamped {
    WrenchStamped {
        header,
        wrench: geometry_msgs::Wrench {
            torque: vector_to_msg(couple),
            ..geometry_msgs::Wrench::default()
        },
    }
}

/// The mission's state as feedback.
pub fn feedback(mission: &CaptureMission, header: Header) -> Feedback {
    Feedback {
        header,
        phase: mission.phase().name().to_owned(),
        progress: mission.progress(),
        waits_for: mission.waits_for().to_owned(),
        is_held: mission.is_paused(),
    }
}

/// The mission's state, with its phases so far.
pub fn state(mission: &CaptureMission, header: Header) -> MissionState {
    let now = Time::from(&header.stamp).as_secs_f64();
    let mut state = MissionState {
        header,
        phase: mission.phase().name().to_owned(),
        progress: mission.progress(),
        waits_for: mission.waits_for().to_owned(),
        is_held: mission.is_paused(),
        ..MissionState::default()
    };
    for (phase, report) in (0..).zip(mission.reports()) {
        state.phase_name.push(report.phase.name().to_owned());
        state.phase_start.push(report.start);
        state.phase_end.push(report.end.unwrap_or(now));
        state.outcome.push(report.outcome.clone());
        for figure in report.figures.iter().filter(|f| f.value.is_finite()) {
            state.figure_phase.push(phase);
            state.figure_name.push(figure.name.to_owned());
            state.figure_value.push(figure.value);
            state.figure_unit.push(figure.unit.to_owned());
        }
    }
    state
}

/// Decides when the mission's state is published: every 0.2 s, when a phase begins, and when the mission is held or
/// resumed.
#[derive(Debug, Default)]
pub struct StateTimer {
    next: f64,
    /// Number of phases so far, and whether the mission was held, as last published.
    published: (usize, bool),
}

/// Simulated time between two states of a mission on its topic \[s\].
pub const STATE_PERIOD: f64 = 0.2;

impl StateTimer {
    /// Whether the state at `time` \[s\] must be published.
    pub fn is_due(&mut self, mission: &CaptureMission, time: f64) -> bool {
        let present = (mission.reports().len(), mission.is_paused());
        let is_due = present != self.published || time >= self.next - 1e-9;
        if is_due {
            (self.next, self.published) = (time + STATE_PERIOD, present);
        }
        is_due
    }
}

/// The result of a finished mission.
pub fn outcome(mission: &CaptureMission) -> Outcome {
    let reports = mission.reports();
    let (last, phases) = match reports.split_last() {
        Some((last, phases)) => (Some(last), phases),
        None => (None, reports),
    };
    let payload = mission.payload().filter(|_| mission.is_identified());
    Outcome {
        captured: mission.phase() == Phase::Done,
        reason: last.map_or_else(String::new, |last| last.outcome.clone()),
        mass: payload.map_or(0.0, |payload| payload.mass),
        phases: phases.iter().map(|r| r.phase.name().to_owned()).collect(),
        durations: (phases.iter())
            .map(|r| r.end.unwrap_or(r.start) - r.start)
            .collect(),
    }
}
