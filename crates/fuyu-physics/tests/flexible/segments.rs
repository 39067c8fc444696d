//! Panels as chains of rigid segments with springs, in rigid multibody dynamics, which know nothing of modes.

use fuyu_physics::dynamics::Workspace;
use fuyu_physics::model::{Joint, JointKind, JointLimits, Model, ModelBuilder, Spring};
use fuyu_physics::spatial::{Pose, RigidInertia};
use fuyu_structures::generalized_eigen;
use nalgebra::{DMatrix, DVector, Matrix3, Unit, Vector3};

/// Length \[m\], width \[m\], mass per area \[kg/m²\], EI and GJ \[N m²\] of the panels.
pub const PANEL: [f64; 5] = [8.0, 2.0, 3.0, 3000.0, 800.0];

/// A piece of the panel of length `l`, about a point at its root: mass at mid-length.
fn piece(l: f64) -> RigidInertia {
    let [_, width, areal_mass, ..] = PANEL;
    let mass = areal_mass * width * l;
    let (along, across) = (mass * l * l / 12.0, mass * width * width / 12.0);
    RigidInertia {
        mass,
        com: Vector3::new(l / 2.0, 0.0, 0.0),
        about_com: Matrix3::from_diagonal(&Vector3::new(across, along, along + across)),
    }
}

/// A base with two panels of `n` hinges each, in the middle of `n` equal parts: at each a bending and a torsion spring.
pub fn chain(base: &RigidInertia, mounts: &[(&str, Pose)], n: usize) -> Model {
    let [length, _, _, EI, GJ] = PANEL;
    let h = length / n as f64;
    let mut base = *base;
    for (_, X_BA) in mounts {
        base = base.merged_with(&piece(h / 2.0).expressed_in(X_BA));
    }
    let mut builder = ModelBuilder::new("chain", "base_link", base);
    for (name, X_BA) in mounts {
        let mut parent = 0;
        for i in 0..n {
            let at = if i == 0 {
                X_BA * Pose::translation(h / 2.0, 0.0, 0.0)
            } else {
                Pose::translation(h, 0.0, 0.0)
            };
            let joint = |what: &str, axis: Unit<Vector3<f64>>, X_PJ: Pose, stiffness: f64| Joint {
                name: format!("{name}_{what}{i}"),
                kind: JointKind::Continuous,
                axis,
                X_PJ,
                limits: JointLimits::NONE,
                damping: 0.0,
                friction: 0.0,
                spring: Spring {
                    stiffness,
                    rest: 0.0,
                },
            };
            let bend = joint("bend", -Vector3::y_axis(), at, EI / h);
            let label = format!("{name}_hinge{i}");
            let hinge = builder.joint(&label, parent, bend, RigidInertia::zero());
            let twist = joint("twist", Vector3::x_axis(), Pose::identity(), GJ / h);
            let l = if i + 1 == n { h / 2.0 } else { h };
            parent = builder.joint(&format!("{name}{i}"), hinge, twist, piece(l));
        }
    }
    builder.build()
}

/// Frequencies with the base free, ascending \[Hz\].
pub fn frequencies_hz(chain: &Model) -> Vec<f64> {
    let M = Workspace::new(chain).reduced_inertia().clone();
    let springs = chain.joints().iter().map(|joint| joint.spring.stiffness);
    let K = DMatrix::from_diagonal(&DVector::from_iterator(chain.dof(), springs));
    let values = generalized_eigen(&K, &M).map(|eigen| eigen.values);
    let values = values.expect("a positive definite inertia");
    (values.iter())
        .map(|value| value.sqrt() / std::f64::consts::TAU)
        .collect()
}
