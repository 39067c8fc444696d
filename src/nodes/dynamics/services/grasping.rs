//! Services of the robot's grasps: `~/attach` and `~/detach`.

use super::check_active;
use crate::{
    msg::std_srvs::TriggerResponse,
    nodes::dynamics::{simulation::Simulation, world::World},
};

/// Latches the first grasp whose frames are close enough.
pub fn attach(simulation: &mut Simulation) -> TriggerResponse {
    change(simulation, World::attach)
}

/// Opens all grasps.
pub fn detach(simulation: &mut Simulation) -> TriggerResponse {
    change(simulation, World::detach)
}

fn change(
    simulation: &mut Simulation,
    act: impl FnOnce(&mut World) -> Result<String, String>,
) -> TriggerResponse {
    let outcome = match check_active(simulation) {
        Ok(()) => act(&mut simulation.world),
        Err(inactive) => Err(inactive.error_message),
    };
    if outcome.is_ok() {
        simulation.outputs.invalidate();
    }
    let success = outcome.is_ok();
    let message = outcome.unwrap_or_else(|reason| reason);
    TriggerResponse { success, message }
}
