//! Placement of the kernel frames on the bodies; definition in [`super::tree`].

use nalgebra::{Matrix3, Rotation3, Translation3, Vector3};

use crate::model::Model;
use crate::spatial::Pose;

/// `X_BK` of every body.
pub(super) fn kernel_frames(model: &Model) -> Vec<Pose> {
    let bodies = model.bodies();
    let mut frames = vec![Pose::identity(); bodies.len()];
    for b in (0..bodies.len()).rev() {
        let own = b.checked_sub(1).map(|j| model.tree_joint(j));
        let next = (bodies[b].subtree_end > b + 1).then(|| model.tree_joint(b));
        frames[b] = match (own, next) {
            (None, None) => Pose::identity(),
            // No joint moves the base; its z is the axis of the first joint.
            (None, Some(next)) => {
                let z = next.X_PJ.rotation * next.axis;
                let p = (next.X_PJ * frames[b + 1]).translation.vector;
                Pose::from_parts(Translation3::identity(), axes(&z, &(p - *z * z.dot(&p))))
            }
            (Some(own), None) => {
                Pose::from_parts(Translation3::identity(), axes(&own.axis, &Vector3::zeros()))
            }
            (Some(own), Some(next)) => {
                let at = next.X_PJ * frames[b + 1];
                let (z, w) = (*own.axis, *(next.X_PJ.rotation * next.axis));
                let p = at.translation.vector;
                let normal = z.cross(&w);
                let sine = normal.norm_squared();
                let (x, along) = if sine < 1e-12 {
                    (p - z * z.dot(&p), z.dot(&p))
                } else {
                    // The point where the common normal meets this body's axis.
                    (normal, normal.dot(&p.cross(&w)) / sine)
                };
                // The common normal of nearly parallel axes is far away, which would cost precision.
                let size = p.norm() + bodies[b].inertia.com.norm();
                let along = if along.abs() <= size { along } else { 0.0 };
                Pose::from_parts(Translation3::from(z * along), axes(&z, &x))
            }
        };
    }
    frames
}

/// Axes with the given z, and x as close to `x` as possible (arbitrary if `x` is parallel to z).
fn axes(z: &Vector3<f64>, x: &Vector3<f64>) -> Rotation3<f64> {
    let z = z.normalize();
    let mut x = x - z * z.dot(x);
    if x.norm() <= 1e-9 {
        let mut least = Vector3::zeros();
        least[z.iamin()] = 1.0;
        x = least - z * z.dot(&least);
    }
    let x = x.normalize();
    let y = z.cross(&x).normalize();
    Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[y.cross(&z), y, z]))
}
