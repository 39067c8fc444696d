//! Results of `fuyu simulate` as text.

use std::fmt::Write as _;

use crate::{
    experiments::{Event, MomentumResidual, Summary},
    nodes::dynamics::{FreeBody as _, World},
};

/// Table of the figures of a robot's run, headed by `name`.
pub(super) fn table(name: &str, s: &Summary) -> String {
    let time = |t: Option<f64>| t.map_or("not reached".to_owned(), |t| format!("{t:.2} s"));
    let [x, y, z] = s.base_displacement;
    let [roll, pitch, yaw] = s.base_attitude_rpy.map(f64::to_degrees);
    let mut out = String::new();
    let mut row = |label: &str, value: String| {
        // Writing to a string cannot fail.
        let _ = writeln!(out, "{:<32}{value}", format!("{label} "));
    };
    row(
        name,
        format!(
            "{} s simulated in {:.3} s ({:.0} x real time)",
            s.duration,
            s.wall_time,
            s.duration / s.wall_time
        ),
    );
    if let Some(position) = s.tip_position_error {
        row("tip position error", format!("{position:.3e} m"));
        if let Some(attitude) = s.tip_attitude_error {
            row("tip attitude error", format!("{attitude:.3e} rad"));
        }
        row("within 1 cm after", time(s.time_to_1cm));
        if s.tip_attitude_error.is_some() {
            row("within 2 degrees after", time(s.time_to_2deg));
        }
    }
    row("base displacement", format!("{x:.4}, {y:.4}, {z:.4} m"));
    row(
        "base roll, pitch, yaw",
        format!("{roll:.3}, {pitch:.3}, {yaw:.3} deg"),
    );
    row(
        "momentum residual",
        format!(
            "{:.1e} linear, {:.1e} angular",
            s.momentum_residual.linear, s.momentum_residual.angular
        ),
    );
    row("energy residual", format!("{:.1e}", s.energy_residual));
    for (target, t) in &s.targets {
        let MomentumResidual { linear, angular } = t.momentum_residual;
        row(
            &format!("{target}: momentum residual"),
            format!("{linear:.1e} linear, {angular:.1e} angular"),
        );
        row(
            &format!("{target}: energy residual"),
            format!("{:.1e}", t.energy_residual),
        );
    }
    if let Some(gap) = s.loop_gap {
        row("largest loop gap", format!("{gap:.1e} m or rad"));
    }
    if let (Some(speed), Some(acceleration)) = (s.max_tip_speed, s.max_tip_acceleration) {
        row("largest tip speed", format!("{speed:.3} m/s"));
        row(
            "largest tip acceleration",
            format!("{acceleration:.3} m/s2"),
        );
    }
    row(
        "largest base acceleration",
        format!("{:.4} rad/s2", s.max_base_angular_acceleration),
    );
    out
}

/// Deflections, wheels and events of a run.
pub(super) fn table_of_parts(world: &World, events: &[Event]) -> String {
    let mut out = String::new();
    let mut row = |label: &str, value: String| {
        // Writing to a string cannot fail.
        let _ = writeln!(out, "{label:<32}{value}");
    };
    if let Some(robot) = world.robot.flexible() {
        let (system, state) = (robot.system(), robot.state());
        for (i, body) in system.modal_bodies().iter().enumerate() {
            if !body.appendage.outputs.is_empty() {
                let tip = robot.workspace().deflection(state, i, 0);
                let label = format!("{} tip deflection", body.name());
                row(
                    &label,
                    format!("{:.4}, {:.4}, {:.4} m", tip.x, tip.y, tip.z),
                );
            }
        }
        for (wheel, speed) in system.wheels().iter().zip(state.wheel_speeds()) {
            row(
                &format!("wheel {}", wheel.name),
                format!("{speed:.4} rad/s"),
            );
        }
        row(
            "strain energy",
            format!("{:.3e} J", world.robot.strain_energy()),
        );
    }
    for event in events {
        row(&format!("{:.2} s", event.time), event.what.clone());
    }
    out
}
