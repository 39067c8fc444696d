//! Attitude control of the servicer with panels and wheels.

mod controller;
mod double_loop;
mod dvdfb;
mod feed_forward;
mod held_base;
mod unloading;

use fuyu_physics::control::attitude::{
    ArmMotion, AttitudeDeviation, AttitudePlant, AttitudeRegulator, AttitudeTarget, Dvdfb,
    RegulatorConfig, RegulatorInput, RegulatorReport,
};
use fuyu_physics::dynamics::flexible::{FlexibleState, FlexibleSystem, FlexibleWorkspace};
use nalgebra::{DVector, UnitQuaternion};
use serde_json::Value;

use crate::support::{POSTURES, panel, servicer_with_wheels, with_panels};

/// A fixture of the linear-systems package, which designs with the same robot's mass matrices.
fn lti_fixture(name: &str) -> Value {
    let folder = env!("CARGO_MANIFEST_DIR");
    let path = format!("{folder}/../fuyu-lti/tests/fixtures/{name}.json");
    let text = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{path}: {e}"));
    serde_json::from_str(&text).unwrap()
}

/// The servicer with wheels in posture A, B or C, panels not turned.
fn plant(posture: &str) -> AttitudePlant {
    let (_, q) = POSTURES.iter().find(|(name, _)| *name == posture).unwrap();
    plant_at(&servicer_with_wheels(0.0), q)
}

fn plant_at(system: &FlexibleSystem, q: &[f64]) -> AttitudePlant {
    AttitudePlant::new(system, &DVector::from_row_slice(q)).unwrap()
}

/// Direct feedback with the gains of the fixtures.
fn regulator(system: &FlexibleSystem, config: RegulatorConfig) -> AttitudeRegulator {
    let law = Dvdfb::diagonal([60.0; 3], [900.0; 3]).unwrap();
    AttitudeRegulator::new(system, Box::new(law), config).unwrap()
}

/// A control step from the true state towards the axes of the world.
fn regulate(
    regulator: &mut AttitudeRegulator,
    state: &FlexibleState,
    workspace: &FlexibleWorkspace,
) -> RegulatorReport {
    let target = AttitudeTarget::fixed(UnitQuaternion::identity());
    let w_WB_B = workspace.V_WB_B().angular;
    regulator.step(&RegulatorInput {
        deviation: AttitudeDeviation::new(&state.tree.R_WB, &w_WB_B, &target),
        w_WB_B,
        wheel_speeds: Some(state.wheel_speeds()),
        arm: Some(ArmMotion {
            q: state.tree.q.as_slice(),
            qd: state.tree.qd.as_slice(),
            qdd: None,
        }),
    })
}

/// The servicer with its joints locked at `q`, with panels and wheels.
fn locked_with_wheels(q: &[f64]) -> FlexibleSystem {
    use crate::support::{locked_servicer, with_wheels};
    let model = locked_servicer(q);
    with_wheels(with_panels(&model, &panel(false), 0.0), &model, 4.0)
        .build()
        .unwrap()
}
