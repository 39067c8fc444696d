//! The robots of the benchmark, and states in which everything moves.

use fuyu::dynamics::{Input, State, Workspace};
use fuyu::model::{JointKind, Model, ModelBuilder};
use fuyu::spatial::{Pose, RigidInertia, Twist};
use nalgebra::{DVector, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng, rngs::StdRng};

/// A robot and where its tip is.
pub struct Robot {
    pub name: String,
    pub model: Model,
    /// Link whose generalized Jacobian is computed.
    pub tip: String,
}

/// Numbers of links of the compared chains.
pub const CHAINS: [usize; 5] = [10, 30, 100, 300, 1000];

pub fn robots() -> Vec<Robot> {
    let servicer = include_str!("../../urdf/servicer.urdf");
    let mut robots = vec![
        Robot {
            name: "arm of 6 joints (servicer)".to_owned(),
            model: Model::from_urdf(servicer, "servicer").expect("a robot of the repository"),
            tip: "tool0".to_owned(),
        },
        arms("arm of 7 joints", &[Vector3::new(0.0, 1.5, 0.0)]),
        arms(
            "two arms of 7 joints",
            &[Vector3::new(0.6, 1.5, 0.0), Vector3::new(-0.6, 1.5, 0.0)],
        ),
    ];
    robots.extend(CHAINS.map(chain));
    robots
}

/// Uniform rod along x.
fn rod(mass: f64, length: f64) -> RigidInertia {
    let (along, across) = (
        mass * 0.1 * 0.1 / 2.0,
        mass * (3.0 * 0.1 * 0.1 + length * length) / 12.0,
    );
    RigidInertia {
        mass,
        com: Vector3::new(length / 2.0, 0.0, 0.0),
        about_com: Matrix3::from_diagonal(&Vector3::new(along, across, across)),
    }
}

/// The servicer's base with arms of seven joints (roll, pitch, roll, pitch, roll, pitch, roll) at `mounts`.
fn arms(name: &str, mounts: &[Vector3<f64>]) -> Robot {
    let base = RigidInertia {
        mass: 2000.0,
        com: Vector3::zeros(),
        about_com: Matrix3::from_diagonal(&Vector3::new(1400.0, 1400.0, 2040.0)),
    };
    let mut builder = ModelBuilder::new(name, "base_link", base);
    for (arm, mount) in mounts.iter().enumerate() {
        let (x, z) = (Vector3::x_axis(), Vector3::z_axis());
        let links = [
            (x, 20.0, 0.25),
            (z, 40.0, 0.5),
            (x, 40.0, 2.0),
            (z, 30.0, 0.5),
            (x, 30.0, 2.0),
            (z, 10.0, 0.25),
            (x, 5.0, 0.2),
        ];
        let mut parent = 0;
        let quarter = std::f64::consts::FRAC_PI_2;
        let mut placement = Pose::from_parts(
            Translation3::from(*mount),
            Rotation3::from_euler_angles(quarter, 0.0, quarter),
        );
        for (k, (axis, mass, length)) in links.into_iter().enumerate() {
            let name = format!("arm{arm}_link{k}");
            let kind = JointKind::Continuous;
            parent = builder.body(&name, parent, kind, axis, placement, rod(mass, length));
            placement = Translation3::new(length, 0.0, 0.0).into();
        }
        let last = Some(format!("arm{arm}_link6"));
        builder.frame(&format!("tool{arm}"), parent, last, placement);
    }
    Robot {
        name: name.to_owned(),
        model: builder.build(),
        tip: "tool0".to_owned(),
    }
}

/// A chain of equal links, each rotated relative to the one before it.
fn chain(links: usize) -> Robot {
    let name = format!("chain of {links} links");
    let base = RigidInertia {
        mass: 1000.0,
        com: Vector3::new(0.2, 0.01, 0.0),
        about_com: Matrix3::from_diagonal(&Vector3::new(20.0, 150.0, 150.0)),
    };
    let mut builder = ModelBuilder::new(&name, "base_link", base);
    let mut parent = 0;
    for k in 0..links {
        let placement = Pose::from_parts(
            Translation3::new(0.4, 0.0, 0.0),
            Rotation3::from_euler_angles(1.2, 0.1, 0.3),
        );
        let (kind, axis) = (JointKind::Continuous, Vector3::z_axis());
        parent = builder.body(
            &format!("link{k}"),
            parent,
            kind,
            axis,
            placement,
            rod(5.0, 0.4),
        );
    }
    Robot {
        name,
        model: builder.build(),
        tip: format!("link{}", links - 1),
    }
}

/// A state, with its base twist, and the forces on it.
pub struct Moving {
    pub V_WB_B: Twist,
    pub state: State,
    pub input: Input,
}

/// States of `model`, the same in every run.
pub fn states(model: &Model, count: usize) -> Vec<Moving> {
    let rng = &mut StdRng::seed_from_u64(1);
    let mut number = |scale: f64| rng.random_range(-scale..scale);
    let mut workspace = Workspace::new(model);
    (0..count)
        .map(|_| {
            let mut vector = |scale| Vector3::from_fn(|_, _| number(scale));
            let (turn, angular, linear) = (vector(2.0), vector(0.1), vector(0.1));
            let n = model.dof();
            let mut joints = |scale| DVector::from_fn(n, |_, _| number(scale));
            let mut state = State::at_rest_with(model, &joints(1.5));
            state.qd = joints(0.3);
            let mut input = Input::zero(model);
            input.efforts = joints(20.0);
            let X_WB = UnitQuaternion::new(turn);
            let V_WB_B = Twist::new(angular, linear);
            state.set_base(
                &mut workspace,
                &nalgebra::Isometry3::from_parts(Translation3::identity(), X_WB),
                &V_WB_B,
            );
            Moving {
                V_WB_B,
                state,
                input,
            }
        })
        .collect()
}
