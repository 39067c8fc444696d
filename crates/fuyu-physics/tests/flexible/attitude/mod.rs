//! Attitude control of the servicer with panels and wheels.

mod controller;
mod double_loop;
mod dvdfb;
mod feed_forward;
mod held_base;
mod unloading;

use fuyu_physics::control::attitude::AttitudePlant;
use fuyu_physics::dynamics::flexible::FlexibleSystem;
use nalgebra::DVector;
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

/// The servicer with its joints locked at `q`, with panels and wheels.
fn locked_with_wheels(q: &[f64]) -> FlexibleSystem {
    use crate::support::{locked_servicer, with_wheels};
    let model = locked_servicer(q);
    with_wheels(with_panels(&model, &panel(false), 0.0), &model, 4.0)
        .build()
        .unwrap()
}
