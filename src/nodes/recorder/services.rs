//! The services of `ros2 bag record`, with its names and types.

use std::{path::PathBuf, sync::Arc};

use super::recording_session::RecordingSession;
use crate::{
    msg::rosbag2_interfaces::{
        IsPaused, IsPausedResponse, Pause, PauseResponse, Record, RecordResponse, Resume,
        ResumeResponse, SplitBagfile, SplitBagfileResponse, Stop, StopResponse, TogglePaused,
        TogglePausedResponse,
    },
    ros::{Node, NodeError, ServiceServer},
};

/// Serves them until the returned value is dropped.
///
/// # Errors
/// When DDS fails.
pub fn serve(
    node: &Node,
    session: &Arc<RecordingSession>,
) -> Result<Vec<ServiceServer>, NodeError> {
    let with = || Arc::clone(session);
    let (record, stop, split) = (with(), with(), with());
    let (pause, resume, toggle, is_paused) = (with(), with(), with(), with());
    Ok(vec![
        node.serve::<Record>("~/record", move |request| {
            let folder = (!request.uri.is_empty()).then(|| PathBuf::from(request.uri));
            match record.begin(folder) {
                Ok(()) => RecordResponse::default(),
                Err(problem) => {
                    tracing::warn!("cannot record: {problem}");
                    RecordResponse {
                        return_code: 1,
                        error_string: problem,
                    }
                }
            }
        })?,
        node.serve::<Stop>("~/stop", move |_| {
            match stop.end() {
                Ok(true) => {}
                Ok(false) => tracing::warn!("stop requested, but no recording is in progress"),
                Err(problem) => tracing::error!("{problem}"),
            }
            StopResponse::default()
        })?,
        node.serve::<SplitBagfile>("~/split_bagfile", move |_| {
            match split.handle().map(|handle| handle.split()) {
                Some(Ok(())) => {}
                Some(Err(problem)) => tracing::error!("{problem}"),
                None => tracing::warn!("split requested, but no recording is in progress"),
            }
            SplitBagfileResponse::default()
        })?,
        node.serve::<Pause>("~/pause", move |_| {
            pause.pause(true);
            PauseResponse::default()
        })?,
        node.serve::<Resume>("~/resume", move |_| {
            resume.pause(false);
            ResumeResponse::default()
        })?,
        node.serve::<TogglePaused>("~/toggle_paused", move |_| {
            toggle.pause(!toggle.is_paused());
            TogglePausedResponse::default()
        })?,
        node.serve::<IsPaused>("~/is_paused", move |_| IsPausedResponse {
            paused: is_paused.is_paused(),
        })?,
    ])
}
