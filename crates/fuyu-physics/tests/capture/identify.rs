//! Identification of a captured or pushed body (`inertia_id.json`).

use fuyu_physics::control::capture::with_payload;
use fuyu_physics::dynamics::flexible::{
    FlexibleFloating, FlexibleState, FlexibleSystem, FlexibleWorkspace, Wheel,
};
use fuyu_physics::dynamics::{IntegrationMethod, State, Workspace};
use fuyu_physics::estimation::inertia::{
    GyroSample, IdentificationError, InertiaParameters, Push, TwistSample, identify,
    identify_from_pushes, identify_from_twists,
};
use fuyu_physics::model::{Connection, Frame, Model, ModelBuilder};
use fuyu_physics::spatial::{Pose, Twist};
use nalgebra::{DMatrix, DVector, Matrix3xX, SVector, Unit, Vector3};
use rand::SeedableRng;
use rand::rngs::StdRng;
use rand_distr::{Distribution, Normal};
use serde_json::Value;

use crate::support::{fixture, list, near, number, numbers, rotation, servicer, vector};

fn tool(model: &Model) -> &Frame {
    model.frame("tool0").unwrap()
}

fn gyro_samples(value: &Value) -> Vec<GyroSample> {
    let sample = |s: &Value| GyroSample {
        R_WB: rotation(&s["base_R"]),
        w_WB_B: vector(&s["base_w_body"]),
        q: DVector::from_vec(numbers(&s["q"])),
        qd: DVector::from_vec(numbers(&s["qd"])),
        wheels: Vector3::zeros(),
    };
    list(value).iter().map(sample).collect()
}

fn known(case: &Value) -> Option<Vector3<f64>> {
    (case["Lc_known"] == true).then(|| vector(&case["Lc"]))
}

fn truth(file: &Value) -> InertiaParameters {
    InertiaParameters::from_vector(&SVector::from_vec(numbers(&file["phi"])))
}

/// No sample at all is an error like too little motion; the decomposition of an empty matrix panics.
#[test]
fn nothing_is_identified_from_nothing() {
    let model = servicer(0.0);
    for momentum in [None, Some(Vector3::zeros())] {
        let error = identify(&model, tool(&model), &[], momentum, 1e-4).unwrap_err();
        assert!(matches!(
            error,
            IdentificationError::NotExcited { rank: 0, .. }
        ));
    }
    let error = identify_from_twists(&model, tool(&model), &[]).unwrap_err();
    assert!(matches!(
        error,
        IdentificationError::NotExcited { rank: 0, .. }
    ));
    assert!(identify_from_pushes(&[]).is_err());
}

/// Samples of the servicer that moves its arm and holds the body of the fixture, with wheels whose motors give `torques`
/// \[N m\] from the speeds `speeds` \[rad/s\] on.
fn gyro_samples_with_wheels(
    held: &InertiaParameters,
    speeds: [f64; 3],
    torques: [f64; 3],
) -> Vec<GyroSample> {
    const SPIN: f64 = 0.3;
    let model = servicer(0.0);
    let whole = with_payload(&model, tool(&model), &held.rigid()).unwrap();
    let base = &whole.frames()[0];
    // Oblique, so that no axis of the base stands for a wheel.
    let axes = [[1.0, 0.2, 0.0], [0.0, 1.0, -0.3], [0.4, 0.0, 1.0]];
    let axes = axes.map(|axis| Unit::new_normalize(Vector3::from(axis)));
    let mut builder = FlexibleSystem::builder(&whole);
    for (i, axis) in axes.iter().enumerate() {
        builder = builder.wheel(base, Wheel::new(&format!("wheel{i}"), *axis, SPIN));
    }
    let system = builder.build().unwrap();
    let q = DVector::from_fn(whole.dof(), |j, _| 0.3 - 0.2 * j as f64);
    let mut state = FlexibleState::at_rest_with(&system, &q);
    state.wheel_speeds_mut().copy_from_slice(&speeds);
    let V = Twist::new(Vector3::new(0.02, -0.03, 0.01), Vector3::zeros());
    state.set_base(&mut FlexibleWorkspace::new(&system), &Pose::identity(), &V);
    let mut robot = FlexibleFloating::new(&system, state, IntegrationMethod::Dop8);
    robot.input_mut().wheel_torques.copy_from_slice(&torques);
    let mut samples = Vec::new();
    for k in 0..=1000 {
        let time = f64::from(k) * 0.01;
        for (j, effort) in robot.input_mut().tree.efforts.iter_mut().enumerate() {
            let rate = 0.7 + 0.23 * j as f64;
            *effort = [60.0, 80.0, 40.0, 4.0, 6.0, 3.0][j] * (rate * time + j as f64).cos();
        }
        if k % 20 == 0 {
            let wheels = robot.state().wheel_speeds().iter().zip(&axes);
            samples.push(GyroSample {
                R_WB: robot.state().tree.R_WB,
                w_WB_B: robot.workspace().V_WB_B().angular,
                q: robot.state().tree.q.clone(),
                qd: robot.state().tree.qd.clone(),
                wheels: wheels.map(|(speed, axis)| axis.scale(SPIN * speed)).sum(),
            });
        }
        robot.step(0.01, 1);
    }
    samples
}

// The wheels turn at 30 to 90 rad/s and are accelerated meanwhile: they have as much momentum as the moving arm, and are no
// part of it. Without their momentum the result is not that of the body.
#[test]
fn wheels_that_turn_do_not_disturb_the_identification() {
    let held = truth(&fixture("inertia_id"));
    let model = servicer(0.0);
    let mut samples = gyro_samples_with_wheels(&held, [60.0, -40.0, 90.0], [0.2, 0.4, -0.3]);
    let found = identify(&model, tool(&model), &samples, None, 1e-4).unwrap();
    near(
        "with wheels",
        found.inertia.to_vector().as_slice(),
        held.to_vector().as_slice(),
        1e-9,
    );
    assert!(found.residual < 1e-13, "{:e}", found.residual);
    for sample in &mut samples {
        sample.wheels = Vector3::zeros();
    }
    let wrong = identify(&model, tool(&model), &samples, None, 1e-4);
    // A moment of inertia of -106 kg m² instead of 168 kg m².
    assert!(wrong.is_err() || wrong.unwrap().residual > 1e-4);
    samples[3].wheels.y = f64::NAN;
    let error = identify(&model, tool(&model), &samples, None, 1e-4).unwrap_err();
    assert!(matches!(
        error,
        IdentificationError::Sample { index: 3, .. }
    ));
}

/// All ten parameters to 1e-9 from samples without noise. A frame that is not the grasp's, a term that is left out
/// of the regressor, or the base's velocity where it must not matter fail at the first digits.
#[test]
fn gyro_and_encoders_alone_determine_the_inertia() {
    let file = fixture("inertia_id");
    let model = servicer(0.0);
    for case in list(&file["fixtures"]) {
        let name = case["name"].as_str().unwrap();
        let found = identify(
            &model,
            tool(&model),
            &gyro_samples(&case["samples"]),
            known(case),
            1e-4,
        )
        .unwrap();
        near(
            name,
            found.inertia.to_vector().as_slice(),
            &numbers(&file["phi"]),
            1e-9,
        );
        near(name, found.momentum.as_slice(), &numbers(&case["Lc"]), 1e-9);
        assert!(found.residual < 1e-13, "{name}: {:e}", found.residual);
        assert_eq!(found.excitation.rank as u64, case["rank"].as_u64().unwrap());
        let condition = number(&case["cond_scaled"]);
        assert!(
            (found.excitation.condition / condition - 1.0).abs() < 0.1,
            "{name}: {} {condition}",
            found.excitation.condition
        );
        // The fixture's bound is for 201 samples of the same motion, of which these are every tenth: ends count for
        // more.
        let bound = &case["crlb"];
        let scale = (number(&bound["n"]) / case["samples"].as_array().unwrap().len() as f64).sqrt();
        let sds: Vec<f64> = (0..10)
            .map(|i| found.covariance.parameters[(i, i)].sqrt())
            .collect();
        for (sd, expected) in sds.iter().zip(numbers(&bound["sd"])) {
            assert!(
                (sd / (expected * scale) - 1.0).abs() < 0.25,
                "{name}: {sd} {}",
                expected * scale
            );
        }
        let com = found.covariance.com();
        for (sd, expected) in com.iter().zip(numbers(&bound["sd_com_position"])) {
            assert!(
                (sd / (expected * scale) - 1.0).abs() < 0.25,
                "{name}: {sd} {}",
                expected * scale
            );
        }
    }
}

/// What the gyro measures if the grasp frame carries a body with these parameters: from the tree of both, whose
/// recursions share nothing with the regressor.
fn gyro(
    model: &Model,
    parameters: &SVector<f64, 10>,
    momentum: &Vector3<f64>,
    s: &GyroSample,
) -> Vector3<f64> {
    let inertia = InertiaParameters::from_vector(parameters).rigid();
    let payload = ModelBuilder::new("payload", "payload", inertia).build();
    let X_BF = &tool(model).X_BF;
    let joined = model.joined(
        tool(model).body,
        &payload,
        Connection::Weld,
        X_BF,
        X_BF,
        "held/",
    );
    let mut state = State::at_rest_with(&joined.model, &s.q);
    (state.R_WB, state.qd) = (s.R_WB, s.qd.clone());
    state.momentum_W.angular = *momentum;
    let mut workspace = Workspace::new(&joined.model);
    workspace.set_positions(&state.q);
    workspace.set_motion(&state);
    workspace.V_WB_B().angular
}

/// Standard deviations to 1 % of the Cramér-Rao bound, from differences of what the gyro would measure.
#[test]
fn standard_deviations_are_those_of_the_bound() {
    let file = fixture("inertia_id");
    let model = servicer(0.0);
    let truth = truth(&file).to_vector();
    for case in list(&file["fixtures"]) {
        let samples = gyro_samples(&case["samples"]);
        let found = identify(&model, tool(&model), &samples, known(case), 1e-4).unwrap();
        let L = vector(&case["Lc"]);
        let unknowns = if known(case).is_some() { 10 } else { 13 };
        let mut information = DMatrix::<f64>::zeros(unknowns, unknowns);
        for sample in &samples {
            let derivative = |k: usize| {
                let size = if k < 10 {
                    truth[k].abs().max(1e-2 * truth.amax())
                } else {
                    L.norm().max(1.0)
                };
                let h = 1e-4 * size;
                let at = |h: f64| {
                    let (mut parameters, mut momentum) = (truth, L);
                    if k < 10 {
                        parameters[k] += h;
                    } else {
                        momentum[k - 10] += h;
                    }
                    gyro(&model, &parameters, &momentum, sample)
                };
                (at(h) - at(-h)) / (2.0 * h)
            };
            let columns: Vec<Vector3<f64>> = (0..unknowns).map(derivative).collect();
            let jacobian = Matrix3xX::from_columns(&columns);
            information += jacobian.tr_mul(&jacobian) / (1e-4f64 * 1e-4);
        }
        // Scaled to ones on the diagonal, for the accuracy of the inverse.
        let scale = information.diagonal().map(|x| 1.0 / x.sqrt());
        let scaled = DMatrix::from_fn(unknowns, unknowns, |i, j| {
            information[(i, j)] * scale[i] * scale[j]
        });
        let covariance = scaled.try_inverse().unwrap();
        for i in 0..10 {
            let bound = covariance[(i, i)].sqrt() * scale[i];
            let sd = found.covariance.parameters[(i, i)].sqrt();
            assert!(
                (sd / bound - 1.0).abs() < 0.01,
                "{}: {i}: {sd} {bound}",
                case["name"]
            );
        }
    }
}

/// With noise of the gyro the errors are as large as the bound says: root mean square of the normalised error .9 to
/// 1.1.
#[test]
fn errors_have_the_size_of_the_bound() {
    let file = fixture("inertia_id");
    let model = servicer(0.0);
    let expected = truth(&file).to_vector();
    let noise = Normal::new(0.0, 1e-4).unwrap();
    for case in list(&file["fixtures"]) {
        let mut random = StdRng::seed_from_u64(7);
        let clean = gyro_samples(&case["samples"]);
        let (mut squares, mut count) = (0.0, 0);
        for _ in 0..200 {
            let mut samples = clean.clone();
            for sample in &mut samples {
                sample.w_WB_B += Vector3::from_fn(|_, _| noise.sample(&mut random));
            }
            let found = identify(&model, tool(&model), &samples, known(case), 1e-4).unwrap();
            let error = found.inertia.to_vector() - expected;
            for i in 0..10 {
                squares += error[i] * error[i] / found.covariance.parameters[(i, i)];
                count += 1;
            }
        }
        let rms = (squares / f64::from(count)).sqrt();
        assert!((0.9..1.1).contains(&rms), "{}: {rms}", case["name"]);
    }
}

/// A robot at rest, and one that moves only its first joint, learn too little, with and without noise.
#[test]
fn motion_that_determines_too_little_is_refused() {
    let file = fixture("inertia_id");
    let model = servicer(0.0);
    let mut samples = gyro_samples(&list(&file["fixtures"])[0]["samples"]);
    for sample in &mut samples {
        sample.qd.fill(0.0);
        sample.w_WB_B = Vector3::zeros();
        sample.q = DVector::from_element(6, 0.3);
    }
    let refused = identify(&model, tool(&model), &samples, Some(Vector3::zeros()), 1e-4);
    assert_eq!(
        refused,
        Err(IdentificationError::NotExcited {
            rank: 0,
            unknowns: 10
        })
    );
    let noise = Normal::new(0.0, 1e-4).unwrap();
    let mut random = StdRng::seed_from_u64(3);
    for sample in &mut samples {
        sample.w_WB_B = Vector3::from_fn(|_, _| noise.sample(&mut random));
    }
    for momentum in [Some(Vector3::zeros()), None] {
        let refused = identify(&model, tool(&model), &samples, momentum, 1e-4);
        assert!(refused.is_err(), "{refused:?}");
    }
    samples[4].qd = DVector::zeros(5);
    let message = identify(&model, tool(&model), &samples, None, 1e-4)
        .unwrap_err()
        .to_string();
    assert_eq!(
        message,
        "sample 4: it must have one position and one rate per joint of the robot"
    );
}

#[test]
fn with_the_bases_velocity_the_equations_are_linear() {
    let file = fixture("inertia_id");
    let model = servicer(0.0);
    let case = &file["R1"];
    let sample = |s: &Value| TwistSample {
        R_WB: rotation(&s["base_R"]),
        p_WB: vector(&s["base_p"]),
        V_WB: Twist::new(vector(&s["base_w_world"]), vector(&s["base_v"])),
        q: DVector::from_vec(numbers(&s["q"])),
        qd: DVector::from_vec(numbers(&s["qd"])),
    };
    let samples: Vec<TwistSample> = list(&case["samples"]).iter().map(sample).collect();
    let (found, excitation) = identify_from_twists(&model, tool(&model), &samples).unwrap();
    near(
        "R1",
        found.to_vector().as_slice(),
        &numbers(&file["phi"]),
        1e-9,
    );
    assert_eq!(excitation.rank, 16);
}

#[test]
fn three_pushes_determine_a_free_body() {
    let file = fixture("inertia_id");
    let case = &file["R3_pushes"];
    let push = |p: &Value| {
        let of = |name: &str| vector(&p[name]);
        Push {
            R_WF: rotation(&p["R"]),
            impulse: of("impulse"),
            at: of("at_from_g"),
            couple: of("couple"),
            change: Twist::new(
                of("w_after") - of("w_before"),
                of("v_g_after") - of("v_g_before"),
            ),
        }
    };
    let pushes: Vec<Push> = list(&case["pushes"]).iter().map(push).collect();
    for (k, rank) in numbers(&case["rank_after"]).into_iter().enumerate() {
        match identify_from_pushes(&pushes[..=k]) {
            Ok((found, excitation)) => {
                assert_eq!((excitation.rank, rank), (10, 10.0));
                near(
                    "R3",
                    found.to_vector().as_slice(),
                    &numbers(&file["phi"]),
                    1e-9,
                );
            }
            Err(IdentificationError::NotExcited { rank: found, .. }) => {
                assert_eq!(found as f64, rank)
            }
            Err(other) => panic!("{other}"),
        }
    }
    // Mass, centre of mass and inertia about it are those of the parameters.
    let all = truth(&file);
    let back = InertiaParameters::from(&all.rigid());
    near(
        "back",
        back.to_vector().as_slice(),
        all.to_vector().as_slice(),
        1e-12,
    );
    assert_eq!(all.rigid().mass, number(&file["phi"][0]));
}
