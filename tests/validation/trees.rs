//! Random trees for tests of the physics: shapes, inertias, joints, springs and dampers.

use fuyu::model::{Joint, JointKind, JointLimits, Model, ModelBuilder, Spring};
use fuyu::spatial::{Pose, RigidInertia};
use nalgebra::{Matrix3, Rotation3, Translation3, Unit, Vector3};
use proptest::prelude::*;
use std::ops::RangeInclusive;

/// Vectors with components of at most `scale`.
pub fn vector(scale: f64) -> impl Strategy<Value = Vector3<f64>> {
    prop::array::uniform3(-scale..scale).prop_map(Vector3::from)
}

/// Unit vectors.
pub fn direction() -> impl Strategy<Value = Unit<Vector3<f64>>> {
    vector(1.0)
        .prop_filter("not zero", |v| v.norm() > 0.1)
        .prop_map(Unit::new_normalize)
}

/// Rotations by up to 3.5 rad.
pub fn rotation() -> impl Strategy<Value = Rotation3<f64>> {
    vector(2.0).prop_map(Rotation3::new)
}

/// Principal moments from three positive second moments, so the triangle inequality holds strictly.
pub fn inertia(mass: std::ops::Range<f64>) -> impl Strategy<Value = RigidInertia> {
    (
        mass,
        vector(0.5),
        prop::array::uniform3(0.02..0.5f64),
        rotation(),
    )
        .prop_map(|(mass, com, s, r)| {
            let principal = Vector3::new(s[1] + s[2], s[0] + s[2], s[0] + s[1]) * mass;
            let m = r.matrix();
            let about_com = m * Matrix3::from_diagonal(&principal) * m.transpose();
            RigidInertia {
                mass,
                com,
                about_com: (about_com + about_com.transpose()) * 0.5,
            }
        })
}

#[derive(Debug, Clone)]
struct Link {
    up: usize,
    prismatic: bool,
    damping: f64,
    spring: Spring,
    axis: Unit<Vector3<f64>>,
    placement: (Vector3<f64>, Rotation3<f64>),
    inertia: RigidInertia,
}

fn link() -> impl Strategy<Value = Link> {
    let placement = (vector(1.0), rotation());
    let passive = (0.0..5.0f64, 0.0..20.0f64, -1.0..1.0f64);
    (
        0usize..4,
        any::<bool>(),
        passive,
        direction(),
        placement,
        inertia(1.0..20.0),
    )
        .prop_map(|(up, prismatic, passive, axis, placement, inertia)| Link {
            up,
            prismatic,
            damping: passive.0,
            spring: Spring {
                stiffness: passive.1,
                rest: passive.2,
            },
            axis,
            placement,
            inertia,
        })
}

/// Trees with a number of joints in the range `joints`. The parent of each new body is the previous body or one of its
/// ancestors, up to four levels higher.
pub fn trees(joints: RangeInclusive<usize>) -> impl Strategy<Value = Model> {
    (inertia(5.0..500.0), prop::collection::vec(link(), joints)).prop_map(|(base, links)| {
        let mut builder = ModelBuilder::new("random", "base_link", base);
        let mut path = vec![0];
        for (k, link) in links.iter().enumerate() {
            path.truncate(path.len().saturating_sub(link.up).max(1));
            let (p, r) = link.placement;
            let joint = Joint {
                name: format!("joint{k}"),
                kind: if link.prismatic {
                    JointKind::Prismatic
                } else {
                    JointKind::Continuous
                },
                axis: link.axis,
                X_PJ: Pose::from_parts(Translation3::from(p), r),
                limits: JointLimits::NONE,
                damping: link.damping,
                friction: 0.0,
                spring: link.spring,
            };
            let parent = *path.last().unwrap();
            path.push(builder.joint(&format!("link{k}"), parent, joint, link.inertia));
        }
        builder.build()
    })
}
