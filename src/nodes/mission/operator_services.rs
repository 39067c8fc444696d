//! Services for the operator of a mission: `hold`, `resume`, `skip` and `abort`.

use crate::{
    control::capture::{CaptureMission, MissionError},
    msg::std_srvs::{Trigger, TriggerResponse},
    ros::{Calls, Node, NodeError},
};

/// An operator's request.
#[derive(Clone, Copy)]
enum Wish {
    Hold,
    Resume,
    Skip,
    Abort,
}

/// Serves `~/hold`, `~/resume`, `~/skip` and `~/abort`.
pub(super) struct Operator {
    calls: [(Wish, Calls<Trigger>); 4],
}

impl Operator {
    /// Advertises the services.
    ///
    /// # Errors
    /// When DDS reports an error.
    pub fn new(node: &Node) -> Result<Self, NodeError> {
        let serve = |wish, name: &str| Ok::<_, NodeError>((wish, node.serve_calls(name)?));
        Ok(Self {
            calls: [
                serve(Wish::Hold, "~/hold")?,
                serve(Wish::Resume, "~/resume")?,
                serve(Wish::Skip, "~/skip")?,
                serve(Wish::Abort, "~/abort")?,
            ],
        })
    }

    /// Passes pending calls to the mission, and answers them.
    pub fn follow(&mut self, mut mission: Option<&mut CaptureMission>) {
        for (wish, calls) in &self.calls {
            while let Some(call) = calls.take() {
                let done = match mission.as_deref_mut() {
                    None => Err("no mission has begun".to_owned()),
                    Some(mission) => act(*wish, mission).map_err(|e| e.to_string()),
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
fn act(wish: Wish, mission: &mut CaptureMission) -> Result<String, MissionError> {
    match wish {
        Wish::Hold => mission.hold()?,
        Wish::Resume => mission.resume()?,
        Wish::Skip => mission.skip()?,
        Wish::Abort => mission.abort("aborted by the operator")?,
    }
    Ok(format!("in phase {}", mission.phase().name()))
}
