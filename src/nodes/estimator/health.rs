//! Diagnostics of the motion estimate.

use crate::{
    estimation::{MIN_KNOWN_POINTS, MotionSource, MotionTracker, filter::Update},
    ros::Status,
};

/// Reports the motion at `time` \[s\] and the quality of the estimate; `failure` says why the last batch has no
/// solution.
pub fn report(status: &Status, tracker: &MotionTracker, time: f64, failure: Option<&str>) {
    let (motion, batch) = (tracker.motion(), tracker.batch());
    let model = motion.model().name();
    let mut remarks = batch.estimated.diagnosis.clone();
    remarks.extend(failure.map(|why| format!("the previous motion is kept: {why}")));
    let source = tracker.source(time);
    if source == MotionSource::Coasting {
        let seconds = time - tracker.corrected();
        remarks.push(format!(
            "coasting for {seconds:.1} s: {}",
            reason(tracker.last_update())
        ));
    }
    match remarks.as_slice() {
        [] => status.ok(model),
        some => status.warn(format!("{model}: {}", some.join("; "))),
    }
    status.set("model", model);
    status.set("answered by", source.name());
    status.set("residual", format!("{:.3}", motion.rms()));
    status.set(
        "residual of the batch",
        format!("{:.3}", batch.estimated.motion.rms()),
    );
    status.set(
        "age of the batch [s]",
        format!("{:.1}", time - batch.span.1),
    );
    status.set("frames", tracker.frames());
    if let Some(last) = tracker.last_update() {
        status.set("features used", last.used);
        status.set("features that do not fit", last.rejected);
        status.set("features not known yet", last.unknown);
    }
}

/// The reason why the newest frame did not correct the filter.
fn reason(last: Option<&Update>) -> &'static str {
    match last {
        Some(Update { rejected, .. }) if *rejected >= MIN_KNOWN_POINTS => {
            "the features contradict the motion"
        }
        Some(Update { unknown, .. }) if *unknown > 0 => {
            "no feature is a point of the known structure"
        }
        _ => "no features",
    }
}
