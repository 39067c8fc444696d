//! How far the tip of a floating arm can come.

use nalgebra::Vector3;

use crate::model::{Frame, Model};

/// A distance from the system's centre of mass that `tip` cannot exceed, whatever the joints and the base do \[m\];
/// `None` if a joint that slides has no limits.
///
/// The vector from the centre of mass to the tip is a sum of vectors that are fixed in the bodies, one for each
/// (the virtual links of Vafa and Dubowsky), so their lengths bound it. The bound is attained by planar arms.
/// Without external forces the centre of mass does not accelerate: a goal that rests out of this reach stays out of it.
pub fn workspace_radius(model: &Model, tip: &Frame) -> Option<f64> {
    let bodies = model.bodies();
    let mass = model.total_mass();
    let subtree = |b: usize| -> f64 {
        let all = &bodies[b..bodies[b].subtree_end];
        all.iter().map(|body| body.inertia.mass).sum()
    };
    let on_the_way = |b: usize| (b..bodies[b].subtree_end).contains(&tip.body);
    let mut links: Vec<Vector3<f64>> = bodies
        .iter()
        .map(|body| body.inertia.com * (-body.inertia.mass / mass))
        .collect();
    links[tip.body] += tip.X_BF.translation.vector;
    let mut slides = 0.0;
    for (j, joint) in model.joints().iter().enumerate() {
        // What this joint's place on its parent contributes to the tip, less what it does to the centre of mass.
        let part = f64::from(u8::from(on_the_way(j + 1))) - subtree(j + 1) / mass;
        links[model.joint_parent(j)] += joint.X_PJ.translation.vector * part;
        if !joint.kind.is_rotational() {
            let most = joint.limits.lower.abs().max(joint.limits.upper.abs());
            slides += part.abs() * most;
        }
    }
    let reach = links.iter().map(Vector3::norm).sum::<f64>() + slides;
    reach.is_finite().then_some(reach)
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
        workspace.set_positions(model, &DVector::from_row_slice(q));
        (workspace.X_BF(tip).translation.vector - workspace.p_BC()).norm()
    }

    #[test]
    fn the_stretched_planar_arm_is_as_far_as_it_can_be() {
        let xml = include_str!("../../../../urdf/planar_two_link.urdf");
        let model = Model::from_urdf(xml, "planar_two_link.urdf").unwrap();
        let tip = model.frame("tool0").unwrap();
        let reach = workspace_radius(&model, tip).unwrap();
        assert!((distance(&model, tip, &[0.0, 0.0]) - reach).abs() < 1e-12);
        assert!(distance(&model, tip, &[0.1, 0.2]) < reach);
    }

    #[test]
    fn no_posture_of_the_servicer_is_beyond_its_reach() {
        let xml = include_str!("../../../../urdf/servicer.urdf");
        let model = Model::from_urdf(xml, "servicer.urdf").unwrap();
        let tip = model.frame("tool0").unwrap();
        let reach = workspace_radius(&model, tip).unwrap();
        let mut rng = StdRng::seed_from_u64(1);
        let mut most = 0f64;
        for _ in 0..20_000 {
            let q: [f64; 6] = std::array::from_fn(|_| rng.random_range(-PI..PI));
            most = most.max(distance(&model, tip, &q));
        }
        // A bound that is far away would never tell that a goal is out of reach.
        assert!(most < reach && most > 0.9 * reach, "{most} {reach}");
    }
}
