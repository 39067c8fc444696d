//! Inputs for external wrenches on the robot: the topic `wrench` and the services `apply_link_wrench` and
//! `clear_link_wrenches`.

use nalgebra::Vector3;

use super::{
    external_wrenches::{ExternalWrench, WrenchAxes},
    messages::WORLD,
    motions::{Refusals, link_names},
    simulation::Simulation,
    step_status::StepStatus,
    world::World,
};
use crate::{
    model::Frame,
    msg::{
        fuyu_msgs::services::{
            ApplyLinkWrench, ApplyLinkWrenchRequest, ApplyLinkWrenchResponse, ClearLinkWrenches,
            ClearLinkWrenchesRequest, ClearLinkWrenchesResponse,
        },
        geometry_msgs::{self, WrenchStamped},
    },
    nodes::{geometry::vector_from_msg, topics},
    ros::{Calls, Node, NodeError, Subscription},
    spatial::Wrench,
};

/// Largest force \[N\], torque \[N m\] and distance of the point \[m\].
const LARGEST: f64 = 1e6;

/// Maximum number of messages that one call of [`take`] handles, so that a flood cannot stall simulated time.
const MAX_MESSAGES: usize = 64;

/// The topic and the services.
pub struct WrenchInputs {
    wrenches: Subscription<WrenchStamped>,
    apply: Calls<ApplyLinkWrench>,
    clear: Calls<ClearLinkWrenches>,
    refusals: Refusals,
    status: StepStatus,
}

impl WrenchInputs {
    /// Subscribes to the topic and advertises the services.
    ///
    /// # Errors
    /// When DDS reports an error.
    pub fn new(node: &Node) -> Result<Self, NodeError> {
        let mut status = StepStatus::new(node.diagnostics().status("wrenches"));
        status.ok("no wrench was applied yet");
        let wrenches = topics::WRENCH.subscribe(node)?;
        // The queue keeps messages per publisher, so that one publisher cannot crowd out another.
        wrenches.separate_publishers();
        Ok(Self {
            wrenches,
            apply: node.serve_calls("apply_link_wrench")?,
            clear: node.serve_calls("clear_link_wrenches")?,
            refusals: Refusals::default(),
            status,
        })
    }

    /// Drops pending messages, and refuses pending calls with `reason`.
    pub fn discard(&mut self, reason: &str) {
        while self.wrenches.take().is_some() {}
        while let Some(call) = self.apply.take() {
            call.reply.send(&ApplyLinkWrenchResponse {
                success: false,
                status_message: reason.to_owned(),
            });
        }
        while let Some(call) = self.clear.take() {
            call.reply.send(&ClearLinkWrenchesResponse {
                success: false,
                status_message: reason.to_owned(),
            });
        }
    }
}

/// Applies pending wrenches, and answers calls.
pub fn take(simulation: &mut Simulation) {
    let Simulation {
        wrench_inputs: inputs,
        world,
        params,
        ..
    } = simulation;
    let Some(inputs) = inputs else {
        return;
    };
    for _ in 0..MAX_MESSAGES {
        let Some(received) = inputs.wrenches.take() else {
            break;
        };
        let added = of_message(&received.message, world, params.motions.wrench_timeout)
            .and_then(|wrench| world.wrenches_mut().add(wrench));
        match added {
            Ok(()) if !inputs.refusals.is_shown() => inputs.status.ok("wrenches are applied"),
            Ok(()) => {}
            Err(problem) => inputs
                .refusals
                .report(&mut inputs.status, "wrench", &problem),
        }
    }
    for _ in 0..MAX_MESSAGES {
        let Some(call) = inputs.apply.take() else {
            break;
        };
        let added =
            of_call(&call.request, world).and_then(|wrench| world.wrenches_mut().add(wrench));
        if let Err(problem) = &added {
            inputs
                .refusals
                .report(&mut inputs.status, "apply_link_wrench", problem);
        }
        call.reply.send(&ApplyLinkWrenchResponse {
            success: added.is_ok(),
            status_message: added.err().unwrap_or_default(),
        });
    }
    for _ in 0..MAX_MESSAGES {
        let Some(call) = inputs.clear.take() else {
            break;
        };
        call.reply.send(&clear(&call.request, world));
    }
}

/// The link called `name`.
fn link(world: &World, field: &str, name: &str) -> Result<Frame, String> {
    let model = world.robot.model();
    let found = model.frame(name).cloned();
    found.ok_or_else(|| {
        format!(
            "{field} is '{name}'; give a link of the robot: {}",
            link_names(model)
        )
    })
}

/// Force and torque of a message, checked to be finite and not too large.
fn checked(wrench: &geometry_msgs::Wrench) -> Result<Wrench, String> {
    let parts = [("force", &wrench.force), ("torque", &wrench.torque)];
    let [force, torque] = parts.map(|(name, part)| finite(name, &vector_from_msg(part)));
    Ok(Wrench::new(torque?, force?))
}

fn finite(name: &str, v: &Vector3<f64>) -> Result<Vector3<f64>, String> {
    for (axis, value) in ["x", "y", "z"].iter().zip(v) {
        // This is false for NaN, too.
        let is_valid = value.abs() <= LARGEST;
        if !is_valid {
            return Err(format!(
                "{name}.{axis} is {value}; it must be finite and at most 1e6"
            ));
        }
    }
    Ok(*v)
}

fn of_message(
    message: &WrenchStamped,
    world: &World,
    timeout: f64,
) -> Result<ExternalWrench, String> {
    let link = link(world, "frame_id", &message.header.frame_id)?;
    let now = world.time();
    Ok(ExternalWrench {
        axes: WrenchAxes::Robot(link.clone()),
        link,
        point: Vector3::zeros(),
        wrench: checked(&message.wrench)?,
        from: now,
        until: now + timeout,
        is_streamed: true,
    })
}

fn of_call(request: &ApplyLinkWrenchRequest, world: &World) -> Result<ExternalWrench, String> {
    let at = link(world, "link_name", &request.link_name)?;
    let axes = match request.reference_frame.as_str() {
        "" => WrenchAxes::Robot(at.clone()),
        WORLD => WrenchAxes::World,
        name => WrenchAxes::Robot(link(world, "reference_frame", name)?),
    };
    let point = &request.reference_point;
    let duration = f64::from(request.duration.sec) + f64::from(request.duration.nanosec) * 1e-9;
    if duration == 0.0 {
        return Err(
            "duration is 0; give seconds, or a negative duration for a wrench until it is cleared"
                .to_owned(),
        );
    }
    let from = request.start_time.seconds().max(world.time());
    Ok(ExternalWrench {
        link: at,
        axes,
        point: finite("reference_point", &Vector3::new(point.x, point.y, point.z))?,
        wrench: checked(&request.wrench)?,
        from,
        until: match duration > 0.0 {
            true => from + duration,
            false => f64::INFINITY,
        },
        is_streamed: false,
    })
}

fn clear(request: &ClearLinkWrenchesRequest, world: &mut World) -> ClearLinkWrenchesResponse {
    let name = request.link_name.as_str();
    let checked = match name {
        "" => Ok(None),
        name => link(world, "link_name", name).map(|link| Some(link.name)),
    };
    match checked {
        Ok(link) => {
            let count = world.wrenches_mut().clear(link.as_deref());
            ClearLinkWrenchesResponse {
                success: true,
                status_message: format!("{count} wrenches have ended"),
            }
        }
        Err(status_message) => ClearLinkWrenchesResponse {
            success: false,
            status_message,
        },
    }
}
