//! Teleoperation, Masutani 1995 chapter 8: resolutions of the tip's velocity, the joints' servo, and the indices of
//! operability.

use allocation_counter::measure;
use fuyu::control::{
    JacobianKind, Mapping, OperabilityMap, Operator, OperatorConfig, RateLimits, Resolution,
    ResolvedRate, ResolvedRateConfig, ServoGains, VelocityServo, VelocityServoConfig,
};
use fuyu::dynamics::{Floating, IntegrationMethod, State, Workspace};
use fuyu::experiments::masutani_ch8::{
    self, ARRIVED, Base, EXPERIMENTS, START, attempt, planar_model, planar_posture, targets,
};
use fuyu::model::Model;
use fuyu::spatial::Twist;
use nalgebra::{DVector, Matrix6, Matrix6xX, Vector2, Vector3, Vector6};
use std::f64::consts::PI;

use crate::fixtures::servicer;

fn posture() -> DVector<f64> {
    DVector::from_row_slice(&[1.13, 1.73, -1.66, -0.38, 0.5, -0.73])
}

fn resolver(model: &Model, method: Resolution, components: [bool; 6]) -> ResolvedRate {
    let config = ResolvedRateConfig {
        method,
        components,
        characteristic_length: 0.7,
        transpose_gain: 0.3,
        ..ResolvedRateConfig::default()
    };
    ResolvedRate::new(model, model.frame("tool0").unwrap(), config)
}

const TWIST: Twist = Twist {
    angular: Vector3::new(0.02, -0.05, 0.03),
    linear: Vector3::new(0.1, -0.2, 0.05),
};

const ALL: [bool; 6] = [true; 6];
const LINEAR: [bool; 6] = [true, true, true, false, false, false];

/// What the tip does: its twist in the world, and relative to the base, in base axes. From the motion of the bodies, not
/// from a Jacobian.
fn tip_twists(model: &Model, q: &DVector<f64>, qd: &DVector<f64>) -> (Twist, Twist) {
    let tip = model.frame("tool0").unwrap();
    let mut state = State::at_rest_with(model, q);
    state.qd.copy_from(qd);
    let mut workspace = Workspace::new(model);
    workspace.set_positions(q);
    workspace.set_motion(&state);
    let (tip_W, base) = (workspace.V_WF_B(tip), *workspace.V_WB_B());
    let p_BE = workspace.X_BF(tip).translation.vector;
    let carried = base.linear + base.angular.cross(&p_BE);
    let relative = Twist::new(tip_W.angular - base.angular, tip_W.linear - carried);
    (tip_W, relative)
}

// A Jacobian of the wrong base, rows in the wrong order, or scaling that is not undone would show.
#[test]
fn inverses_move_the_tip_as_commanded() {
    let model = servicer();
    let q = posture();
    let mut workspace = Workspace::new(&model);
    let mut rates = DVector::zeros(6);
    for components in [ALL, LINEAR] {
        for method in [Resolution::InverseGeneralized, Resolution::InverseFixedBase] {
            let mut resolver = resolver(&model, method, components);
            let resolved = resolver.rates(&model, &mut workspace, &q, &TWIST, &mut rates);
            assert!(!resolved.damped && resolved.smallest_singular_value > 0.1);
            let (in_world, relative) = tip_twists(&model, &q, &rates);
            let (done, other) = match method.jacobian() {
                JacobianKind::Generalized => (in_world, relative),
                JacobianKind::FixedBase => (relative, in_world),
            };
            // Forming J Jᵀ squares a condition number of some 20.
            assert!((done.linear - TWIST.linear).norm() < 1e-13, "{method:?}");
            let turned = (done.angular - TWIST.angular).norm();
            assert_eq!(turned < 1e-13, components == ALL, "{method:?}: {turned}");
            assert!((other.linear - TWIST.linear).norm() > 1e-3);
        }
    }
}

#[test]
fn transposes_are_transposes() {
    let model = servicer();
    let q = posture();
    let tip = model.frame("tool0").unwrap();
    let mut workspace = Workspace::new(&model);
    let mut rates = DVector::zeros(6);
    let mut J = Matrix6xX::zeros(6);
    for method in [
        Resolution::TransposeGeneralized,
        Resolution::TransposeFixedBase,
    ] {
        let mut resolver = resolver(&model, method, LINEAR);
        resolver.rates(&model, &mut workspace, &q, &TWIST, &mut rates);
        match method.jacobian() {
            JacobianKind::Generalized => workspace.generalized_jacobian(tip, &mut J),
            JacobianKind::FixedBase => workspace.fixed_base_jacobian(tip, &mut J),
        }
        let expected = J.fixed_rows::<3>(0).transpose() * TWIST.linear * 0.3;
        assert!((&rates - expected).norm() < 1e-15);
    }
}

// Undamped, the rates at the singular posture would have no bound, and near it they would be thousands.
#[test]
fn near_singular_postures_rates_are_bounded_and_continuous() {
    let model = masutani_ch8::model(Base::Free);
    let mut workspace = Workspace::new(&model);
    let mut before: Option<DVector<f64>> = None;
    let (mut largest, mut damped) = (0.0f64, 0);
    let mut resolver = resolver(&model, Resolution::InverseFixedBase, LINEAR);
    let threshold = resolver.config.damping_threshold;
    let V = Twist::new(Vector3::zeros(), Vector3::new(0.0, 0.5, 0.0));
    let steps = 4000;
    for i in 0..=steps {
        // The elbow goes through straight.
        let elbow = -0.4 + 0.8 * f64::from(i) / f64::from(steps);
        let q = DVector::from_row_slice(&[0.0, 0.3, elbow]);
        let mut rates = DVector::zeros(3);
        let resolved = resolver.rates(&model, &mut workspace, &q, &V, &mut rates);
        damped += i32::from(resolved.damped);
        let bound = 2.0 / 3f64.sqrt() * V.linear.norm() / threshold;
        assert!(rates.norm() <= bound * (1.0 + 1e-12), "{}", rates.norm());
        if let Some(before) = before {
            assert!((&rates - before).norm() < 0.02 * bound, "at {elbow}");
        }
        largest = largest.max(rates.norm());
        before = Some(rates);
    }
    assert!(damped > 100 && damped < steps / 2, "{damped}");
    assert!(largest > 1.0);
    // Elsewhere damping does nothing at all: sideways the arm is far from singular when it is straight.
    let q = DVector::from_row_slice(&[0.0, 0.3, 0.0]);
    let mut rates = DVector::zeros(3);
    let up = Twist::new(
        Vector3::zeros(),
        Vector3::new(0.0, -0.3f64.sin(), 0.3f64.cos()) * 0.1,
    );
    assert!(
        resolver
            .rates(&model, &mut workspace, &q, &up, &mut rates)
            .damped
    );
    let (_, relative) = tip_twists(&model, &q, &rates);
    assert!(
        (relative.linear - up.linear).norm() < 1e-12,
        "{}",
        relative.linear
    );
}

// With fewer joints than commanded components the nearest motion is found, not a division by zero.
#[test]
fn a_planar_arm_does_what_it_can_of_a_twist_in_space() {
    let model = planar_model();
    let q = DVector::from_row_slice(&[0.3, 1.0]);
    let mut workspace = Workspace::new(&model);
    let mut rates = DVector::zeros(2);
    let mut resolver = resolver(&model, Resolution::InverseGeneralized, LINEAR);
    let resolved = resolver.rates(&model, &mut workspace, &q, &TWIST, &mut rates);
    assert!(!resolved.damped);
    let (done, _) = tip_twists(&model, &q, &rates);
    let planar = Vector3::new(TWIST.linear.x, TWIST.linear.y, 0.0);
    assert!((done.linear - planar).norm() < 1e-13, "{}", done.linear);
}

fn servo(model: &Model, gains: ServoGains, integral: f64) -> VelocityServo {
    VelocityServo::new(model, VelocityServoConfig { gains, integral }).unwrap()
}

/// Rates while the servo drives them to `reference` for so many steps of 2 ms.
fn driven(model: &Model, servo: &mut VelocityServo, reference: &[f64], steps: usize) -> State {
    let mut robot = Floating::new(
        model.clone(),
        State::at_rest_with(model, &posture()),
        IntegrationMethod::Rk4,
    );
    for (j, rate) in reference.iter().enumerate() {
        servo.set_reference(model, j, *rate);
    }
    for _ in 0..steps {
        let efforts = servo.efforts(model, robot.state(), 0.002).clone();
        robot.hold_efforts(efforts.as_slice());
        robot.step(0.002, 1);
    }
    robot.state().clone()
}

// The lag is that of the bandwidth: an ideal source would be there at once, a servo that did not know the inertia of the
// free arm would be slower at some joints than at others.
#[test]
fn the_servo_follows_with_its_bandwidth() {
    let model = servicer();
    // Slow, so that what the motion itself asks of the joints is small.
    let reference = [1e-3, -2e-3, 1e-3, 2e-3, -1e-3, 1e-3];
    let omega = 8.0;
    for steps in [25, 50, 125] {
        let mut servo = servo(&model, ServoGains::Bandwidth(omega), 0.0);
        let state = driven(&model, &mut servo, &reference, steps);
        // Sampled and held: (1 - ωT) a step.
        let followed = 1.0 - (1.0 - omega * 0.002f64).powi(steps as i32);
        for (rate, reference) in state.qd.iter().zip(reference) {
            let part = rate / reference;
            assert!((part - followed).abs() < 2e-3, "{part} for {followed}");
        }
        assert!(followed > 0.3 && followed < 0.99);
    }
}

#[test]
fn gains_of_its_own_make_a_joint_follow_as_its_inertia_lets_it() {
    let model = servicer();
    let gains = vec![400.0, 100.0, 200.0, 10.0, 2.0, 2.0];
    let mut servo = servo(&model, ServoGains::PerJoint(gains.clone()), 0.0);
    // The same rate limits the delay in `tests/launch/process.rs`: joint damping over reduced inertia.
    let fastest = servo.max_bandwidth(&model, &posture());
    assert!((60.0..100.0).contains(&fastest), "{fastest}");
    let reference = [0.01; 6];
    let state = driven(&model, &mut servo, &reference, 1);
    // First step: Ĥ q̈ = K e.
    let mut workspace = Workspace::new(&model);
    workspace.set_positions(&posture());
    let inertia = workspace.reduced_inertia().clone();
    let pull = DVector::from_iterator(6, gains.iter().map(|k| k * 0.01));
    let expected = inertia.lu().solve(&pull).unwrap() * 0.002;
    assert!((&state.qd - &expected).norm() < 1e-3 * expected.norm());
}

// Motion itself asks torque of the joints; only the integral part takes the last of the error away.
#[test]
fn the_integral_part_leaves_no_error() {
    let model = servicer();
    let reference = [0.3, -0.2, 0.25, 0.2, -0.3, 0.3];
    let error = |integral: f64| {
        let mut servo = servo(&model, ServoGains::Bandwidth(10.0), integral);
        let state = driven(&model, &mut servo, &reference, 1000);
        (&state.qd - DVector::from_row_slice(&reference)).norm()
    };
    let (without, with) = (error(0.0), error(2.0));
    println!("{without:.2e} rad/s without, {with:.2e} with");
    assert!(with < 0.3 * without, "{with} against {without}");
}

#[test]
fn the_servo_has_no_more_torque_than_the_drives() {
    let xml = include_str!("../../urdf/servicer.urdf");
    let joint1 = "<joint name=\"joint1\" type=\"continuous\">";
    assert!(xml.contains(joint1));
    let weak = format!("{joint1}<limit effort=\"5\" velocity=\"0.1\"/>");
    let model = Model::from_urdf(&xml.replace(joint1, &weak), "weak").unwrap();
    let mut servo = servo(&model, ServoGains::Bandwidth(20.0), 1.0);
    assert!(
        servo.set_reference(&model, 0, 1.0),
        "cut to the joint's limit"
    );
    assert_eq!(servo.reference()[0], 0.1);
    let state = State::at_rest_with(&model, &posture());
    for _ in 0..1000 {
        assert_eq!(servo.efforts(&model, &state, 0.01)[0], 5.0);
    }
    // What it could not do has not added up: it brakes as soon as the joint is too fast.
    let mut fast = state.clone();
    fast.qd[0] = 0.2;
    assert_eq!(servo.efforts(&model, &fast, 0.01)[0], -5.0);
    servo.halt();
    assert_eq!(servo.reference().amax(), 0.0);
}

/// A posture of Fig. 8.10's arm, and what an independent program (numpy) finds there for the recovered parameters.
struct Spot {
    q: [f64; 2],
    distortion: f64,
    misdirection_degrees: f64,
    manipulability: f64,
    tip: [f64; 2],
}

const SPOTS: [Spot; 4] = [
    Spot {
        q: [0.3, 1.0],
        distortion: 0.6226656538383813,
        misdirection_degrees: 37.142384122437186,
        manipulability: 2.499223684414348,
        tip: [4.807088294375483, 3.1476959801963313],
    },
    Spot {
        q: [2.5, 0.8],
        distortion: 0.21666649847151725,
        misdirection_degrees: 10.569191844739285,
        manipulability: 3.650510169788483,
        tip: [-2.7215584636394965, 1.1018161249017708],
    },
    Spot {
        q: [-2.0, 1.5],
        distortion: 0.2839073484772043,
        misdirection_degrees: 13.25251673558333,
        manipulability: 4.567005189462052,
        tip: [2.9035893133580757, -3.471807413574712],
    },
    Spot {
        q: [0.0, 1.5],
        distortion: 0.5146889259886976,
        misdirection_degrees: 26.83157224085779,
        manipulability: 3.2398809135524513,
        tip: [4.426843004169258, 2.493737466510136],
    },
];

#[test]
fn indices_of_operability_are_those_of_an_independent_program() {
    let model = planar_model();
    let tip = model.frame("tool0").unwrap();
    let mut mapping = Mapping::new(&model, tip, [0, 1]).unwrap();
    for spot in SPOTS {
        let (q, [x, y]) = (spot.q, spot.tip);
        let point = mapping.at(q);
        let found = point.operability;
        assert!((found.distortion - spot.distortion).abs() < 1e-13);
        assert!((found.misdirection.to_degrees() - spot.misdirection_degrees).abs() < 1e-11);
        assert!((found.manipulability - spot.manipulability).abs() < 1e-13);
        assert!((point.tip - Vector2::new(x, y)).norm() < 1e-13);
        let found = planar_posture(x, y).unwrap();
        for (found, q) in found.iter().zip(q) {
            assert!((found - q).sin().abs() < 1e-12);
        }
    }
    let refused = Mapping::new(&servicer(), tip, [0, 1]).unwrap_err();
    assert!(refused.to_string().contains("6 joints"), "{refused}");
}

// The definitions, by trying commands all round: a wrong extremum would be below or above.
#[test]
fn indices_are_the_worst_over_all_commands() {
    let model = planar_model();
    let tip = model.frame("tool0").unwrap();
    let mut mapping = Mapping::new(&model, tip, [0, 1]).unwrap();
    let mut workspace = Workspace::new(&model);
    let (mut J, mut generalized) = (Matrix6xX::zeros(2), Matrix6xX::zeros(2));
    for q in [
        [0.3, 1.0],
        [2.5, 0.8],
        [-2.0, 1.5],
        [0.1, 0.05],
        [-1.0, 3.0],
    ] {
        workspace.set_positions(&DVector::from_row_slice(&q));
        workspace.fixed_base_jacobian(tip, &mut J);
        workspace.generalized_jacobian(tip, &mut generalized);
        let plane = |J: &Matrix6xX<f64>| J.fixed_view::<2, 2>(0, 0).into_owned();
        let A = plane(&generalized) * plane(&J).try_inverse().unwrap();
        let (mut distortion, mut misdirection) = (0.0f64, 0.0f64);
        for i in 0..100_000 {
            let angle = PI * f64::from(i) / 1e5;
            let command = Vector2::new(angle.cos(), angle.sin());
            let done = A * command;
            distortion = distortion.max((done - command).norm());
            misdirection = misdirection.max(done.angle(&command));
        }
        let found = mapping.at(q).operability;
        assert!((found.distortion - distortion).abs() < 1e-6 * distortion);
        assert!((found.misdirection - misdirection).abs() < 1e-4, "{q:?}");
    }
}

/// Section 8.4: I1 < 0.3 and I2 < 15 degrees nearly everywhere in the half of the work space where the base is, and larger
/// values beyond. Shares of an independent computation, to 2 points.
#[test]
fn the_half_where_the_base_is_is_good_to_work_in() {
    let model = planar_model();
    let tip = model.frame("tool0").unwrap();
    let map = OperabilityMap::over(&model, tip, [0, 1], [-PI, 0.0], [PI, PI], 200).unwrap();
    let mount = 1.75;
    for (base_side, distortion, misdirection) in [(true, 77.0, 81.0), (false, 16.0, 21.0)] {
        let side = |p: &fuyu::control::MapPoint| (p.tip.x < mount) == base_side;
        let first = 100.0 * map.share(side, |o| o.distortion < 0.3);
        let second = 100.0 * map.share(side, |o| o.misdirection < 15f64.to_radians());
        println!("base side {base_side}: {first:.2} %, {second:.2} %");
        assert!((first - distortion).abs() < 2.0 && (second - misdirection).abs() < 2.0);
    }
    // The tip's area in all: a disc of 5 m.
    let area: f64 = map.points.iter().map(|p| p.area).sum();
    assert!((area / (PI * 25.0) - 1.0).abs() < 1e-3, "{area}");
    let least = map.least(|p| p.operability.distortion).unwrap();
    assert!(
        (least.operability.distortion - 0.031).abs() < 5e-3,
        "{least:?}"
    );
    let least = map.least(|p| p.operability.misdirection).unwrap();
    assert!(least.operability.misdirection.to_degrees() < 1.5);
    let most = map.least(|p| -p.operability.manipulability).unwrap();
    assert!(
        (most.operability.manipulability - 5.668).abs() < 2e-3,
        "{most:?}"
    );
    assert!((most.tip - Vector2::new(-1.475, -1.002)).norm() < 0.05);
}

/// The positioning experiment: every method reaches every target, and the same run gives the same numbers.
#[test]
fn an_operator_reaches_all_targets_by_all_methods() {
    for (base, method) in EXPERIMENTS {
        let mut times = Vec::new();
        for target in targets() {
            let run = attempt(base, method, &target);
            assert!(run.time.is_finite(), "{base:?} {method:?} {target}");
            let end = run.path.last().unwrap();
            assert!((end - target).norm() <= ARRIVED);
            assert!((run.path[0] - Vector3::from(START)).norm() < 1e-12);
            // A fixed base does not turn.
            assert_eq!(
                run.base_turn > 1e-5,
                base == Base::Free,
                "{}",
                run.base_turn
            );
            times.push(run.time);
        }
        println!("{base:?} {method:?}: {times:.2?}");
    }
    let again = |_: usize| attempt(Base::Free, Resolution::TransposeFixedBase, &targets()[3]);
    assert_eq!(again(0), again(1));
}

/// The straight way is that of the inverse of the generalized Jacobian: in the world by construction. The transpose
/// goes round.
#[test]
fn only_the_inverse_of_the_generalized_jacobian_goes_straight_in_the_world() {
    let worst = |method: Resolution| {
        let runs = targets().map(|target| attempt(Base::Free, method, &target).deviation);
        runs.into_iter().fold(0.0, f64::max)
    };
    let [straight, fixed_base, transpose, _] = Resolution::NAMES.map(|(_, method)| worst(method));
    println!("off the line: {straight:.4} m, {fixed_base:.4} m, {transpose:.4} m");
    assert!(straight < 0.5 * fixed_base && fixed_base < transpose);
}

#[test]
fn steering_and_servo_do_not_allocate() {
    let model = servicer();
    let mut workspace = Workspace::new(&model);
    let mut resolver = resolver(&model, Resolution::InverseGeneralized, ALL);
    let limits = RateLimits::new(&model, 0.5, 1.0);
    let mut servo = servo(&model, ServoGains::Bandwidth(10.0), 1.0);
    let mut operator = Operator::new(OperatorConfig::default());
    let (q, rest) = (posture(), DVector::zeros(6));
    let mut rates = rest.clone();
    let state = State::at_rest_with(&model, &q);
    let used = measure(|| {
        for i in 0..1000 {
            let time = f64::from(i) * 0.01;
            let velocity = operator.command(time, &Vector3::new(0.1, 0.2, 0.3));
            let V = Twist::new(Vector3::zeros(), velocity);
            resolver.rates(&model, &mut workspace, &q, &V, &mut rates);
            limits.apply(&model, &q, &rest, 0.01, &mut rates);
            for (j, rate) in rates.iter().enumerate() {
                servo.set_reference(&model, j, *rate);
            }
            servo.efforts(&model, &state, 0.01);
        }
    });
    assert_eq!(used.count_total, 0, "{used:?}");
}

// The inverse against a general solver, at random postures.
#[test]
fn far_from_singular_the_damped_inverse_is_the_inverse() {
    use rand::{RngExt, SeedableRng, rngs::StdRng};
    let model = servicer();
    let tip = model.frame("tool0").unwrap();
    let mut random = StdRng::seed_from_u64(8);
    let mut workspace = Workspace::new(&model);
    let mut J = Matrix6xX::zeros(6);
    let mut rates = DVector::zeros(6);
    let mut resolver = resolver(&model, Resolution::InverseGeneralized, ALL);
    let mut compared = 0;
    for _ in 0..500 {
        let q = DVector::from_fn(6, |_, _| random.random_range(-PI..PI));
        let v = Vector6::from_fn(|_, _| random.random_range(-1.0..1.0));
        let V = Twist::new(v.fixed_rows::<3>(3).into(), v.fixed_rows::<3>(0).into());
        let resolved = resolver.rates(&model, &mut workspace, &q, &V, &mut rates);
        assert!(rates.iter().all(|r| r.is_finite()));
        if resolved.damped {
            continue;
        }
        workspace.generalized_jacobian(tip, &mut J);
        let J: Matrix6<f64> = J.fixed_columns::<6>(0).into();
        let expected = J.lu().solve(&v).unwrap();
        // Condition numbers up to some 100, squared.
        let off = (&rates - DVector::from_column_slice(expected.as_slice())).norm();
        assert!(off < 1e-10 * expected.norm(), "{off:e}");
        compared += 1;
    }
    assert!(compared > 100, "{compared}");
}
