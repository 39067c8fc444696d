//! What the mission reads from messages, and its commands as messages.

use crate::{
    control::capture::{CaptureMission, Phase, RotationForecast},
    model::Model,
    msg::{
        fuyu_msgs::capture::{Feedback, Outcome},
        geometry_msgs::{self, WrenchStamped},
        nav_msgs::Path,
        sensor_msgs::JointState,
        std_msgs::Header,
    },
    nodes::geometry::{unit_quaternion, vector_to_msg},
    ros::Time,
};
use nalgebra::Vector3;

/// The forecast that a message of `estimator/prediction` contains.
///
/// # Errors
/// A line that says what is wrong.
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

/// Joint efforts as a message.
pub fn efforts(model: &Model, header: Header, efforts: &[f64]) -> JointState {
    JointState {
        header,
        name: model.joints().iter().map(|j| j.name.clone()).collect(),
        effort: efforts.to_vec(),
        ..JointState::default()
    }
}

/// A couple on the base as a message; `header` names the base.
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

/// How a mission ended.
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
