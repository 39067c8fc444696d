//! What diagnostics say of the motion.

use super::belief::{Belief, Source, TELLING};
use crate::{estimation::filter::Update, ros::Status};

/// Tells how well the motion at `time` \[s\] is known; `unsolved` is why the last batch has no solution.
pub fn tell(status: &Status, belief: &Belief, time: f64, unsolved: Option<&str>) {
    let (motion, batch) = (belief.motion(), belief.batch());
    let model = motion.model().name();
    let mut remarks = batch.estimated.diagnosis.clone();
    remarks.extend(unsolved.map(|why| format!("the motion before stays: {why}")));
    let source = belief.source(time);
    if source == Source::Coasting {
        let seconds = time - belief.corrected();
        remarks.push(format!(
            "coasting for {seconds:.1} s: {}",
            why(belief.last())
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
    status.set("frames", belief.frames());
    if let Some(last) = belief.last() {
        status.set("features used", last.used);
        status.set("features that do not fit", last.rejected);
        status.set("features not known yet", last.unknown);
    }
}

/// Why the filter was not corrected.
fn why(last: Option<&Update>) -> &'static str {
    match last {
        Some(Update { rejected, .. }) if *rejected >= TELLING => {
            "the features are not where they should be"
        }
        Some(Update { unknown, .. }) if *unknown > 0 => {
            "the features are not those of the structure"
        }
        _ => "no features",
    }
}
