//! Radius of the workspace of a free-floating arm.

use nalgebra::Vector3;

use crate::model::{Frame, Model};

/// Upper bound of the distance of `tip` from the system's centre of mass, for any joint positions and any pose of the
/// base \[m\]; `None` if a prismatic joint has no limits.
///
/// The vector from the centre of mass to the tip is a sum of vectors that are fixed in the bodies, one for each (the
/// virtual links of Vafa and Dubowsky), so the sum of their lengths bounds it. Planar arms reach the bound. Without
/// external forces the centre of mass does not accelerate, so a goal at rest outside this radius stays outside.
pub(super) fn workspace_radius(model: &Model, tip: &Frame) -> Option<f64> {
    let bodies = model.bodies();
    let mass = model.total_mass();
    let subtree_mass = |b: usize| -> f64 {
        let all = &bodies[b..bodies[b].subtree_end];
        all.iter().map(|body| body.inertia.mass).sum()
    };
    let carries_tip = |b: usize| (b..bodies[b].subtree_end).contains(&tip.body);
    let mut links: Vec<Vector3<f64>> = bodies
        .iter()
        .map(|body| body.inertia.com * (-body.inertia.mass / mass))
        .collect();
    links[tip.body] += tip.X_BF.translation.vector;
    let mut travel = 0.0;
    for (j, joint) in model.tree_joints().enumerate() {
        // Motion of the tip minus that of the centre of mass, per motion of the joint's origin.
        let part = f64::from(u8::from(carries_tip(j + 1))) - subtree_mass(j + 1) / mass;
        links[model.tree_parent(j)] += joint.X_PJ.translation.vector * part;
        if !joint.kind.is_rotational() {
            let most = joint.limits.lower.abs().max(joint.limits.upper.abs());
            travel += part.abs() * most;
        }
    }
    let radius = links.iter().map(Vector3::norm).sum::<f64>() + travel;
    radius.is_finite().then_some(radius)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dynamics::Workspace;
    use nalgebra::DVector;
    use rand::{RngExt, SeedableRng, rngs::StdRng};
    use std::f64::consts::PI;

    fn distance(model: &Model, tip: &Frame, q: &[f64]) -> f64 {
        let mut workspace = Workspace::new(model);
        workspace.set_positions(&DVector::from_row_slice(q));
        (workspace.X_BF(tip).translation.vector - workspace.p_BC()).norm()
    }

    #[test]
    fn a_stretched_planar_arm_attains_the_bound() {
        let xml = include_str!("../../../../urdf/planar_two_link.urdf");
        let model = Model::from_urdf(xml, "planar_two_link.urdf").unwrap();
        let tip = model.frame("tool0").unwrap();
        let radius = workspace_radius(&model, tip).unwrap();
        assert!((distance(&model, tip, &[0.0, 0.0]) - radius).abs() < 1e-12);
        assert!(distance(&model, tip, &[0.1, 0.2]) < radius);
    }

    #[test]
    fn random_postures_stay_within_a_tight_bound() {
        let xml = include_str!("../../../../urdf/servicer.urdf");
        let model = Model::from_urdf(xml, "servicer.urdf").unwrap();
        let tip = model.frame("tool0").unwrap();
        let radius = workspace_radius(&model, tip).unwrap();
        let mut rng = StdRng::seed_from_u64(1);
        let mut most = 0f64;
        for _ in 0..20_000 {
            let q: [f64; 6] = std::array::from_fn(|_| rng.random_range(-PI..PI));
            most = most.max(distance(&model, tip, &q));
        }
        // A loose bound would not detect goals outside the workspace.
        assert!(most < radius && most > 0.9 * radius, "{most} {radius}");
    }
}
