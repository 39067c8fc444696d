//! The robot with a held body, its payload.

use nalgebra::{Matrix3, Vector3};

use super::detumble::Stack;
use crate::dynamics::Workspace;
use crate::model::{Connection, Frame, Model, ModelBuilder};
use crate::spatial::{InertiaError, Pose, RigidInertia};

/// The robot with `payload` (in the tip's frame) fixed to its tip. Joints keep their order.
///
/// # Errors
/// [`InertiaError`] if the inertia is physically impossible.
pub fn with_payload(
    model: &Model,
    tip: &Frame,
    payload: &RigidInertia,
) -> Result<Model, InertiaError> {
    payload.check()?;
    let mut prefix = "payload/".to_owned();
    while model.frames().iter().any(|f| f.name.starts_with(&prefix)) {
        prefix.insert(0, '_');
    }
    let body = ModelBuilder::new("payload", "body", *payload).build();
    let (body_of_tip, X_BF) = (tip.body, tip.X_BF);
    let joined = model.joined(body_of_tip, &body, Connection::Weld, &X_BF, &X_BF, &prefix);
    Ok(joined.model)
}

/// An assumed body, of which only the centre of mass is known: `mass` \[kg\], and the inertia of a ball with radius of
/// gyration `gyration` \[m\].
pub fn presumed(mass: f64, com: Vector3<f64>, gyration: f64) -> RigidInertia {
    RigidInertia {
        mass,
        com,
        about_com: Matrix3::identity() * (mass * gyration * gyration),
    }
}

/// Robot and payload as one rigid body, at the positions of `workspace` (of the robot with its payload).
pub fn stack(workspace: &Workspace, tip: &Frame, payload: &RigidInertia) -> Stack {
    let X_BE: Pose = workspace.X_BF(tip);
    let at_rest = nalgebra::DVector::zeros(workspace.model().dof());
    let columns = [0, 1, 2].map(|i| {
        let w = Vector3::ith(i, 1.0);
        let twist = crate::spatial::Twist::new(w, Vector3::zeros());
        workspace.momentum_of(&twist, &at_rest).angular
    });
    Stack {
        inertia: Matrix3::from_columns(&columns),
        com: *workspace.p_BC(),
        target: payload.expressed_in(&X_BE),
        grasp: X_BE.translation.vector,
    }
}
