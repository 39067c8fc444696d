//! Elastic joints with motor rotors, full and reduced.

use fuyu_physics::dynamics::IntegrationMethod;
use fuyu_physics::dynamics::flexible::{
    ElasticJoint, FlexibleInput, FlexibleIntegrator, FlexibleState, FlexibleSystem,
    FlexibleWorkspace, LinearModel, RotorModel,
};
use fuyu_physics::model::{JointKind, Model, ModelBuilder};
use fuyu_physics::spatial::{Pose, RigidInertia};
use nalgebra::{DVector, Matrix3, Vector3};
use serde_json::Value;

use crate::support::{
    attitude_error, difference, efforts, fixture, numbers, relative, servicer, vector,
};

/// The planar arm of two links on a base so heavy that it does not move.
fn planar() -> Model {
    let heavy = 1e12;
    let base = RigidInertia {
        mass: heavy,
        com: Vector3::zeros(),
        about_com: Matrix3::identity() * heavy,
    };
    let link = RigidInertia {
        mass: 5.0,
        com: Vector3::new(0.5, 0.0, 0.0),
        about_com: Matrix3::from_diagonal(&Vector3::new(0.3, 0.4, 0.5)),
    };
    let mut builder = ModelBuilder::new("planar", "base", base);
    let (turn, z) = (JointKind::Continuous, Vector3::z_axis());
    let first = builder.body("first", 0, turn, z, Pose::identity(), link);
    let elbow = Pose::translation(1.0, 0.0, 0.0);
    builder.body("second", first, turn, z, elbow, link);
    builder.build()
}

fn with_elastic_joints(
    model: &Model,
    parameters: &Value,
    rotor: RotorModel,
    stiffer: f64,
) -> FlexibleSystem {
    let [Jm, n, K, D] = ["Jm", "n", "K", "D"].map(|name| numbers(&parameters[name]));
    let mut builder = FlexibleSystem::builder(model);
    for (j, joint) in model.joints().iter().enumerate() {
        builder = builder.elastic_joint(ElasticJoint {
            joint: joint.name.clone(),
            stiffness: K[j] * stiffer,
            damping: D[j] * stiffer.sqrt(),
            rotor_inertia: Jm[j],
            gear_ratio: n[j],
            rotor,
        });
    }
    builder.build().unwrap()
}

const ROTORS: [(&str, RotorModel); 2] =
    [("full", RotorModel::Full), ("reduced", RotorModel::Reduced)];

fn planar_efforts(t: f64, state: &FlexibleState, input: &mut FlexibleInput) {
    let rates = state.motor_rates();
    input.tree.efforts[0] = 4.0 * t.sin() - rates[0];
    input.tree.efforts[1] = 1.5 * (2.0 * t).sin() - 0.5 * rates[1];
}

// Frequencies and a run of 10 s. Without the term n Jm a·w' the two models would be the same: they differ by 1e-3.
#[test]
fn a_planar_arm_with_elastic_joints() {
    let planar2 = &fixture("flexible_joints")["planar2"];
    let model = planar();
    for (name, rotor) in ROTORS {
        let expected = &planar2[name];
        let system = with_elastic_joints(&model, &planar2["parameters"], rotor, 1.0);
        let q0 = DVector::from_row_slice(&[0.3, 0.8]);
        let mut state = FlexibleState::at_rest_with(&system, &q0);
        let linear = LinearModel::new(&system, &q0);
        let found = linear.frequencies_hz(&linear.without_wheels()).unwrap();
        let frequencies = relative(&found, &numbers(&expected["frequencies_hz"]));
        // Motors locked: joints alone. Fewer coordinates, lower frequencies.
        let locked = linear.frequencies_hz(&[6, 7]).unwrap();
        let motors_locked = numbers(&expected["frequencies_motors_locked_hz"]);
        let locked = relative(&locked, &motors_locked);
        let mut workspace = FlexibleWorkspace::new(&system);
        let mut integrator = FlexibleIntegrator::new(&system, IntegrationMethod::Dop8);
        let mut worst = [0.0_f64; 3];
        for i in 1..=40 {
            integrator.steps(&mut state, &mut workspace, 0.005, 50, &mut planar_efforts);
            let at = |key: &str| numbers(&expected[key][i]);
            worst[0] = worst[0].max(difference(state.tree.q.as_slice(), &at("q")));
            worst[1] = worst[1].max(difference(state.motor_angles(), &at("theta")));
            let energy = workspace.kinetic_energy(&state) + workspace.strain_energy(&state);
            let balance = energy - state.tree.work + state.losses().total();
            worst[2] = worst[2].max(balance.abs());
        }
        println!(
            "{name}: frequencies {frequencies:.1e}, motors locked {locked:.1e}, run {worst:?}"
        );
        assert!(
            frequencies < 1e-8 && locked < 1e-8,
            "{name}: {frequencies:e} {locked:e}"
        );
        assert!(worst[0] < 1e-8 && worst[1] < 1e-8, "{name}: {worst:?}");
        assert!(worst[2] < 1e-9, "{name}: {worst:?}");
    }
}

// Six elastic joints on a free base, 20 s. The rotors' momentum is at most 5e-3 N m s; without it the sum would not be
// constant.
#[test]
fn the_servicer_with_elastic_joints() {
    let data = &fixture("flexible_joints")["servicer"];
    let model = servicer();
    for (name, rotor) in ROTORS {
        let expected = &data[name];
        let system = with_elastic_joints(&model, &data["parameters"], rotor, 1.0);
        let q0 = DVector::from_vec(numbers(&data["parameters"]["q0"]));
        let mut state = FlexibleState::at_rest_with(&system, &q0);
        let linear = LinearModel::new(&system, &q0);
        let found = linear.frequencies_hz(&linear.without_wheels()).unwrap();
        let frequencies = relative(&found, &numbers(&expected["frequencies_hz"]));
        let mut workspace = FlexibleWorkspace::new(&system);
        let mut integrator = FlexibleIntegrator::new(&system, IntegrationMethod::Dop8);
        let mut drive = |t: f64, state: &FlexibleState, input: &mut FlexibleInput| {
            efforts(1.0, t, state.motor_rates(), &mut input.tree.efforts);
        };
        let mut worst = [0.0_f64; 6];
        for i in 1..=20 {
            integrator.steps(&mut state, &mut workspace, 0.005, 200, &mut drive);
            let at = |key: &str| numbers(&expected[key][i]);
            worst[0] = worst[0].max(attitude_error(&state, &expected["quat"][i]));
            worst[1] = worst[1].max(difference(state.tree.q.as_slice(), &at("q")));
            worst[2] = worst[2].max(difference(state.motor_angles(), &at("theta")));
            let carried = workspace.carried_momentum(&state);
            worst[3] = worst[3].max(carried.angular.norm() + carried.linear.norm());
            let energy = workspace.kinetic_energy(&state) + workspace.strain_energy(&state);
            let balance = energy - state.tree.work + state.losses().total();
            worst[4] = worst[4].max(balance.abs());
            if rotor == RotorModel::Full {
                let rotors = state.tree.R_WB * workspace.rotor_momentum(&state);
                let expected = vector(&expected["L_rotors"][i]);
                worst[5] = worst[5].max((rotors - expected).norm());
            }
        }
        println!("{name}: frequencies {frequencies:.1e}, run {worst:?}");
        assert!(frequencies < 1e-8, "{name}: {frequencies:e}");
        assert!(
            worst[0] < 1e-8 && worst[1] < 1e-8 && worst[2] < 1e-8,
            "{name}: {worst:?}"
        );
        assert!(worst[3] < 1e-12 && worst[4] < 1e-9, "{name}: {worst:?}");
        assert!(worst[5] < 1e-9, "{name}: {worst:?}");
    }
}

// With stiffer springs the joints approach rigid ones that carry the reflected inertia: the error falls with 1/K. The
// limit is a fixture.
#[test]
fn stiff_joints_approach_rigid_ones() {
    let planar2 = &fixture("flexible_joints")["planar2"];
    let model = planar();
    for (name, rotor) in ROTORS {
        let expected = &planar2[name];
        let mut errors = Vec::new();
        for (stiffer, dt) in [(1.0, 0.005), (10.0, 0.0025), (100.0, 1.0 / 1200.0)] {
            let system = with_elastic_joints(&model, &planar2["parameters"], rotor, stiffer);
            let q0 = DVector::from_row_slice(&[0.3, 0.8]);
            let mut state = FlexibleState::at_rest_with(&system, &q0);
            let mut workspace = FlexibleWorkspace::new(&system);
            let mut integrator = FlexibleIntegrator::new(&system, IntegrationMethod::Dop8);
            let count = (0.25_f64 / dt).round() as usize;
            let mut worst = 0.0_f64;
            for i in 1..=40 {
                let w = &mut workspace;
                integrator.steps(&mut state, w, dt, count, &mut planar_efforts);
                let limit = numbers(&expected["stiff_limit_q"][i]);
                worst = worst.max(difference(state.tree.q.as_slice(), &limit));
            }
            let published = expected["stiff_limit_error"][format!("{stiffer}")].as_f64();
            println!("{name}, K x {stiffer}: {worst:.3e}, published {published:?}");
            errors.push(worst);
        }
        let slope = (errors[2] / errors[1]).log10();
        assert!(
            (slope + 1.0).abs() < 0.05,
            "{name}: slope {slope}, {errors:?}"
        );
    }
}
