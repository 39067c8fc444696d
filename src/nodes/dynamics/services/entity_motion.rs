//! Moving an entity: a new pose and twist for a free body or the robot's base.

use super::{check_active, entities::isometry};
use crate::{
    msg::simulation_interfaces::{
        Result as Outcome,
        services::{SetEntityStateRequest, SetEntityStateResponse as Set},
    },
    nodes::{
        dynamics::{messages::WORLD, simulation::Simulation},
        geometry::{pose_from_msg, vector_from_msg},
    },
    spatial::Twist,
};

/// Sets pose and twist of an entity. Its acceleration cannot be set, since it follows from the forces.
pub fn set(simulation: &mut Simulation, request: &SetEntityStateRequest) -> Set {
    let result = move_entity(simulation, request).err().unwrap_or_else(|| {
        let mut done = Outcome::ok();
        if request.set_acceleration {
            done.error_message =
                "the acceleration is ignored: it follows from the forces on the entity".to_owned();
        }
        done
    });
    Set { result }
}

fn move_entity(
    simulation: &mut Simulation,
    request: &SetEntityStateRequest,
) -> Result<(), Outcome> {
    check_active(simulation)?;
    if !(request.set_pose || request.set_twist || request.set_acceleration) {
        return Err(Outcome::new(
            Outcome::OPERATION_FAILED,
            "nothing to set: set_pose, set_twist and set_acceleration are all false",
        ));
    }
    let world = &mut simulation.world;
    let frame = request.state.header.frame_id.as_str();
    let X_WR = world.frame(frame)?;
    let invalid = |e: String| Outcome::new(Set::INVALID_POSE, e);
    let X_RB = match request.set_pose {
        true => Some(pose_from_msg(&request.state.pose).map_err(invalid)?),
        false => None,
    };
    let twist = &request.state.twist;
    let (v, w) = (
        vector_from_msg(&twist.linear),
        vector_from_msg(&twist.angular),
    );
    if request.set_twist {
        if !frame.is_empty() && frame != WORLD {
            return Err(Outcome::new(
                Outcome::FEATURE_UNSUPPORTED,
                format!("a twist in frame '{frame}' is not supported; give it in {WORLD}"),
            ));
        }
        if !v.iter().chain(w.iter()).all(|x| x.is_finite()) {
            return Err(Outcome::new(
                Outcome::OPERATION_FAILED,
                "twist has a number that is not finite",
            ));
        }
    }
    if world.held_target() == Some(request.entity.as_str()) {
        return Err(Outcome::new(
            Outcome::OPERATION_FAILED,
            format!("the robot holds '{}'; detach it first", request.entity),
        ));
    }
    world.body(&request.entity)?;
    if world.is_between_ticks() {
        // In a recording, the move appears as two states of the same time.
        simulation.publish();
    }
    let body = simulation.world.body(&request.entity)?;
    let X_WB = match X_RB {
        Some(X_RB) => X_WR * X_RB,
        None => isometry(&body.X_WB()),
    };
    let now_B = body.V_WB_B();
    // If only the pose is set, the velocity in the world is kept.
    let R_WB_before = body.state().R_WB;
    let (w_W, v_W) = match request.set_twist {
        true => (w, v),
        false => (R_WB_before * now_B.angular, R_WB_before * now_B.linear),
    };
    let R_BW = X_WB.rotation.inverse();
    let V_WB_B = Twist::new(R_BW * w_W, R_BW * v_W);
    body.move_base(&X_WB, &V_WB_B).map_err(|what| {
        Outcome::new(
            Outcome::OPERATION_FAILED,
            format!("{} cannot be simulated like this: {what}", request.entity),
        )
    })?;
    simulation.outputs.invalidate();
    Ok(())
}
