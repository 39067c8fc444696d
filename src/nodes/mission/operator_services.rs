//! Services for the operator of a mission: `hold`, `resume`, `skip` and `abort`.

use crate::{
    control::capture::{CaptureMission, MissionError},
    msg::std_srvs::{Trigger, TriggerResponse},
    ros::{Calls, Node, NodeError},
};

/// An operator's request.
#[derive(Clone, Copy)]
enum OperatorRequest {
    Hold,
    Resume,
    Skip,
    Abort,
}

/// Serves `~/hold`, `~/resume`, `~/skip` and `~/abort`.
pub(super) struct Operator {
    calls: [(OperatorRequest, Calls<Trigger>); 4],
}

impl Operator {
    /// Advertises the services.
    ///
    /// # Errors
    /// When DDS reports an error.
    pub fn new(node: &Node) -> Result<Self, NodeError> {
        let serve = |request, name: &str| Ok::<_, NodeError>((request, node.serve_calls(name)?));
        Ok(Self {
            calls: [
                serve(OperatorRequest::Hold, "~/hold")?,
                serve(OperatorRequest::Resume, "~/resume")?,
                serve(OperatorRequest::Skip, "~/skip")?,
                serve(OperatorRequest::Abort, "~/abort")?,
            ],
        })
    }

    /// Passes pending calls to the mission, and answers them.
    pub fn follow(&mut self, mut mission: Option<&mut CaptureMission>) {
        for (request, calls) in &self.calls {
            while let Some(call) = calls.take() {
                let done = match mission.as_deref_mut() {
                    None => Err("no mission has begun".to_owned()),
                    Some(mission) => act(*request, mission).map_err(|e| e.to_string()),
                };
                let success = done.is_ok();
                let message = match done {
                    Ok(phase) => phase,
                    Err(reason) => reason,
                };
                call.reply.send(&TriggerResponse { success, message });
            }
        }
    }
}

/// Executes a request. Returns the mission's phase.
fn act(request: OperatorRequest, mission: &mut CaptureMission) -> Result<String, MissionError> {
    match request {
        OperatorRequest::Hold => mission.hold()?,
        OperatorRequest::Resume => mission.resume()?,
        OperatorRequest::Skip => mission.skip()?,
        OperatorRequest::Abort => mission.abort("aborted by the operator")?,
    }
    Ok(format!("in phase {}", mission.phase().name()))
}
