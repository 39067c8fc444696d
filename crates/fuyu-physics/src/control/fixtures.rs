//! Robots of the unit tests.

use nalgebra::{Matrix3, Unit, Vector3};

use crate::dynamics::flexible::{FlexibleSystem, Wheel};
use crate::model::{Frame, Model, ModelBuilder};
use crate::spatial::RigidInertia;

/// The servicer of Masutani 1995 Fig. 5.2, and its tip.
pub(super) fn servicer() -> (Model, Frame) {
    let xml = include_str!("../../../../urdf/servicer.urdf");
    let model = Model::from_urdf(xml, "servicer").unwrap();
    let tip = model.frame("tool0").unwrap().clone();
    (model, tip)
}

/// A satellite of one body.
pub(super) fn satellite() -> Model {
    let inertia = RigidInertia {
        mass: 500.0,
        com: Vector3::zeros(),
        about_com: Matrix3::identity() * 300.0,
    };
    ModelBuilder::new("satellite", "base_link", inertia).build()
}

/// Moment of inertia of each wheel of [`satellite_with_wheels`] about its axis \[kg m²\].
pub(super) const SPIN: f64 = 0.1;

/// Axes of four wheels, not of unit length.
pub(super) const PYRAMID: [[f64; 3]; 4] = [
    [1.0, 0.0, 1.0],
    [0.0, 1.0, 1.0],
    [-1.0, 0.0, 1.0],
    [0.0, -1.0, 1.0],
];

/// The satellite with wheels about the given axes, each with limits of torque \[N m\] and momentum \[N m s\].
pub(super) fn satellite_with_wheels(
    axes: &[[f64; 3]],
    max_torque: f64,
    max_momentum: f64,
) -> FlexibleSystem {
    let model = satellite();
    let base = model.frame("base_link").unwrap();
    let mut builder = FlexibleSystem::builder(&model);
    for (i, axis) in axes.iter().enumerate() {
        let axis = Unit::new_normalize(Vector3::from(*axis));
        let mut wheel = Wheel::new(&format!("w{i}"), axis, SPIN);
        (wheel.max_torque, wheel.max_momentum) = (max_torque, max_momentum);
        builder = builder.wheel(base, wheel);
    }
    builder.build().unwrap()
}
