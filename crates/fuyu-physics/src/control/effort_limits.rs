//! Effort limits for joints whose description gives none.

use crate::model::{Joint, JointKind, Model};

/// Upper bound of the inertia that joint `j` has to move in any posture \[kg m² or kg\]: the inertia of all bodies that
/// it moves, on an immobile base. For a rotation the other joints are assumed to stretch the arm away from the axis;
/// for a translation it is the mass.
///
/// # Panics
/// If there is no joint `j`.
pub fn outstretched_inertia(model: &Model, j: usize) -> f64 {
    let (joint, moved) = (&model.joints()[j], model.joint_body(j));
    let subtree = moved..model.bodies()[moved].subtree_end;
    let inertia = |b: usize| {
        let body = &model.bodies()[b].inertia;
        if joint.kind == JointKind::Prismatic {
            return body.mass;
        }
        if b == moved {
            // The body turns about the axis itself.
            let axis = joint.axis.into_inner();
            let distance = body.com - axis * axis.dot(&body.com);
            return axis.dot(&(body.about_com * axis)) + body.mass * distance.norm_squared();
        }
        let distance = body.com.norm() + distance_to(model, moved, b);
        body.about_com.symmetric_eigenvalues().max() + body.mass * distance * distance
    };
    subtree.map(inertia).sum()
}

/// Largest distance from the origin of body `from` to that of body `to` in its subtree \[m\].
fn distance_to(model: &Model, from: usize, to: usize) -> f64 {
    let (mut body, mut distance) = (to, 0.0);
    while body != from {
        let joint = model.tree_joint(body - 1);
        distance += joint.X_PJ.translation.vector.norm() + stroke(joint);
        body = model.tree_parent(body - 1);
    }
    distance
}

/// Largest translation of the joint's body \[m\]; zero without limits.
fn stroke(joint: &Joint) -> f64 {
    let reach = joint.limits.lower.abs().max(joint.limits.upper.abs());
    match joint.kind {
        JointKind::Prismatic if reach.is_finite() => reach,
        _ => 0.0,
    }
}

/// The robot with effort limits for all joints. A joint without a limit gets the effort that accelerates
/// [`outstretched_inertia`] by `acceleration` \[rad/s² or m/s²\]; limits of the description are kept.
pub fn with_default_effort_limits(model: &Model, acceleration: f64) -> Model {
    model.with_effort_limits(|j, joint| match joint.limits.effort {
        limit if limit.is_finite() => limit,
        _ => acceleration * outstretched_inertia(model, j),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dynamics::Workspace;
    use nalgebra::DVector;

    fn servicer() -> Model {
        Model::from_urdf(include_str!("../../../../urdf/servicer.urdf"), "servicer").unwrap()
    }

    // Fails if a posture has more inertia than the bound.
    #[test]
    fn no_posture_has_more_inertia() {
        let model = servicer();
        let mut workspace = Workspace::new(&model);
        for k in 0..200 {
            let q = DVector::from_fn(6, |j, _| (1.7 * (k * 6 + j) as f64).sin() * 3.0);
            workspace.set_positions(&q);
            let inertia = workspace.reduced_inertia();
            for j in 0..6 {
                assert!(inertia[(j, j)] <= outstretched_inertia(&model, j) * (1.0 + 1e-12));
            }
        }
        // The last joint turns one body about its axis of symmetry.
        assert_eq!(outstretched_inertia(&model, 5), 0.025);
    }

    #[test]
    fn limits_of_the_description_stay() {
        let model = servicer();
        let limited = model.with_effort_limits(|j, joint| match j {
            0 => 7.0,
            _ => joint.limits.effort,
        });
        let limited = with_default_effort_limits(&limited, 100.0);
        let limits: Vec<f64> = (limited.joints().iter()).map(|j| j.limits.effort).collect();
        assert_eq!((limits[0], limits[5]), (7.0, 2.5));
        assert!(limits.iter().all(|limit| limit.is_finite()));
        assert!(model.joints()[0].limits.effort.is_infinite());
    }
}
