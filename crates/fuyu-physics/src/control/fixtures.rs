//! Robots of the unit tests.

use crate::model::{Frame, Model};

/// The servicer of Masutani 1995 Fig. 5.2, and its tip.
pub(super) fn servicer() -> (Model, Frame) {
    let xml = include_str!("../../../../urdf/servicer.urdf");
    let model = Model::from_urdf(xml, "servicer").unwrap();
    let tip = model.frame("tool0").unwrap().clone();
    (model, tip)
}
