//! The services of `ros2 bag record`, with its names and types.

use std::sync::Arc;

use super::{folders::RecordFolders, recording_session::RecordingSession};
use crate::{
    msg::rosbag2_interfaces::{
        IsPaused, IsPausedResponse, Pause, PauseResponse, Record, RecordResponse, Resume,
        ResumeResponse, SplitBagfile, SplitBagfileResponse, Stop, StopResponse, TogglePaused,
        TogglePausedResponse,
    },
    ros::{Node, NodeError, ServiceServer},
};

/// Serves until the returned value is dropped. Callers may request bags in `folders` only.
///
/// # Errors
/// When DDS reports an error.
pub fn serve(
    node: &Node,
    session: &Arc<RecordingSession>,
    folders: RecordFolders,
) -> Result<Vec<ServiceServer>, NodeError> {
    let with = || Arc::clone(session);
    let (record, stop, split) = (with(), with(), with());
    let (pause, resume, toggle, is_paused) = (with(), with(), with(), with());
    Ok(vec![
        node.serve::<Record>("~/record", move |request| {
            let folder = match request.uri.as_str() {
                "" => Ok(None),
                uri => folders.allow(uri).map(Some),
            };
            match folder.and_then(|folder| record.begin(folder)) {
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
