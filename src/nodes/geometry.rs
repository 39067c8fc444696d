//! Conversions between nalgebra and the messages of `geometry_msgs`.

use nalgebra::{Isometry3, Quaternion, Rotation3, Translation3, UnitQuaternion, Vector3};

use crate::msg::geometry_msgs;
use crate::spatial::Pose;

/// A vector as a message.
pub fn vector_to_msg(v: &Vector3<f64>) -> geometry_msgs::Vector3 {
    geometry_msgs::Vector3 {
        x: v.x,
        y: v.y,
        z: v.z,
    }
}

/// A message as a vector.
pub fn vector_from_msg(v: &geometry_msgs::Vector3) -> Vector3<f64> {
    Vector3::new(v.x, v.y, v.z)
}

/// An attitude as a message.
pub fn quaternion_to_msg(q: &UnitQuaternion<f64>) -> geometry_msgs::Quaternion {
    geometry_msgs::Quaternion {
        x: q.i,
        y: q.j,
        z: q.k,
        w: q.w,
    }
}

/// A pose as a message.
pub fn pose_to_msg(X: &Pose) -> geometry_msgs::Pose {
    let p = &X.translation;
    geometry_msgs::Pose {
        position: geometry_msgs::Point {
            x: p.x,
            y: p.y,
            z: p.z,
        },
        orientation: quaternion_to_msg(&UnitQuaternion::from_rotation_matrix(&X.rotation)),
    }
}

/// A pose as a transform message.
pub fn transform_to_msg(X: &Pose) -> geometry_msgs::Transform {
    geometry_msgs::Transform {
        translation: vector_to_msg(&X.translation.vector),
        rotation: quaternion_to_msg(&UnitQuaternion::from_rotation_matrix(&X.rotation)),
    }
}

/// An attitude from x, y, z, w.
///
/// # Errors
/// When a component is not finite or the norm differs from one by more than 1 %.
pub fn unit_quaternion(x: f64, y: f64, z: f64, w: f64) -> Result<UnitQuaternion<f64>, String> {
    let q = Quaternion::new(w, x, y, z);
    let norm = q.norm();
    if (norm - 1.0).abs() <= 0.01 {
        Ok(UnitQuaternion::new_normalize(q))
    } else {
        Err(format!(
            "quaternion [{x}, {y}, {z}, {w}] (x, y, z, w) has norm {norm}; it must be 1"
        ))
    }
}

/// Largest coordinate of a position that can be simulated \[m\].
const FARTHEST: f64 = 1e9;

/// A pose from a message.
///
/// # Errors
/// Names the field if a coordinate is not finite or larger than 1e9 m, or the quaternion is not a unit quaternion.
pub fn pose_from_msg(pose: &geometry_msgs::Pose) -> Result<Isometry3<f64>, String> {
    let (p, q) = (&pose.position, &pose.orientation);
    for (name, value) in [("x", p.x), ("y", p.y), ("z", p.z)] {
        // This is false for NaN, too.
        let within = value.abs() <= FARTHEST;
        if !within {
            return Err(format!(
                "position.{name} is {value}; give metres, at most {FARTHEST:e}"
            ));
        }
    }
    let rotation = unit_quaternion(q.x, q.y, q.z, q.w).map_err(|e| format!("orientation: {e}"))?;
    Ok(Isometry3::from_parts(
        Translation3::new(p.x, p.y, p.z),
        rotation,
    ))
}

/// The same pose with its rotation as a matrix.
pub fn with_matrix(X: &Isometry3<f64>) -> Pose {
    Pose::from_parts(X.translation, Rotation3::from(X.rotation))
}

/// A pose converted to a message and back, which may change the last bit of its rotation.
pub fn message_round_trip(X: &Pose) -> Pose {
    let q = UnitQuaternion::from_rotation_matrix(&X.rotation);
    let q = UnitQuaternion::new_normalize(q.into_inner());
    with_matrix(&Isometry3::from_parts(X.translation, q))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn poses_are_unchanged_by_a_message() {
        let X = Pose::from_parts(
            Translation3::new(1.0, -2.0, 0.3),
            Rotation3::from_euler_angles(0.4, -1.0, 2.9),
        );
        let back = with_matrix(&pose_from_msg(&pose_to_msg(&X)).unwrap());
        assert!((back.to_homogeneous() - X.to_homogeneous()).amax() < 1e-15);
        assert_eq!(message_round_trip(&X), back);
    }

    #[test]
    fn invalid_poses_are_refused_with_the_field() {
        let mut pose = pose_to_msg(&Pose::identity());
        pose.orientation.w = 0.5;
        assert!(pose_from_msg(&pose).unwrap_err().contains("norm 0.5"));
        pose.orientation.w = f64::NAN;
        assert!(pose_from_msg(&pose).unwrap_err().starts_with("orientation"));
        pose.position.y = f64::INFINITY;
        assert!(pose_from_msg(&pose).unwrap_err().starts_with("position"));
    }
}
