//! One controller, step by step.

use nalgebra::{DVector, Translation3, Vector3};

use super::*;
use crate::control::{
    Gains, GoalRate, IkError, JacobianKind, JointPdConfig, LawError, LawKind, Saturation,
    StraightPath, StraightPathConfig, TipMeasurement, TransposeJacobianConfig,
};
use crate::dynamics::Workspace;
use crate::spatial::Pose;

fn planar(law: LawKind) -> Controller {
    let xml = include_str!("../../../../../urdf/planar_two_link.urdf");
    let model = Model::from_urdf(xml, "planar_two_link.urdf").unwrap();
    let tip = model.frame("tool0").unwrap().clone();
    Controller::new(model, tip, config(law)).unwrap()
}

fn gains() -> Gains {
    Gains {
        k_p: 100.0,
        k_o: 1.0,
        k_v: vec![200.0, 1000.0],
        saturation: Saturation::NONE,
    }
}

fn config(law: LawKind) -> ControllerConfig {
    let law: LawConfig = match law {
        LawKind::JointPd => JointPdConfig {
            k_p: vec![40.0, 200.0],
        }
        .into(),
        law => law.into(),
    };
    ControllerConfig::new(law, gains())
}

fn poses(controller: &Controller, q: [f64; 2], goal: [f64; 2]) -> (DVector<f64>, TipMeasurement) {
    let mut workspace = Workspace::new(controller.model());
    let mut pose = |q: &DVector<f64>| {
        workspace.set_positions(q);
        workspace.X_BF(controller.tip())
    };
    let q = DVector::from_row_slice(&q);
    let tip = pose(&q);
    let goal = pose(&DVector::from_row_slice(&goal));
    (q, TipMeasurement::new(0.0, tip, goal))
}

fn update(
    controller: &mut Controller,
    time: f64,
    q: &DVector<f64>,
    qd: &DVector<f64>,
    tip: &TipMeasurement,
) -> Result<ControlReport, ControlError> {
    controller.update(&Measurement::new(time, q, qd).with_tip(Some(tip)))
}

#[test]
fn without_a_measurement_the_joints_are_damped() {
    let mut controller = planar(LawKind::TransposeJacobian);
    let (q, tip) = poses(&controller, [0.3, 1.0], [0.5, 0.8]);
    let qd = DVector::from_row_slice(&[0.1, -0.2]);
    controller.update(&Measurement::new(0.0, &q, &qd)).unwrap();
    assert_eq!(controller.efforts().as_slice(), [-20.0, 200.0]);
    let report = update(&mut controller, 0.01, &q, &qd, &tip).unwrap();
    assert!(report.error.is_some());
    assert_ne!(controller.efforts().as_slice(), [-20.0, 200.0]);
}

#[test]
fn joint_pd_uses_only_the_first_camera_measurement() {
    let mut controller = planar(LawKind::JointPd);
    let (q, tip) = poses(&controller, [0.3, 1.0], [0.5, 0.8]);
    let rest = DVector::zeros(2);
    update(&mut controller, 0.0, &q, &rest, &tip).unwrap();
    let first = controller.efforts().clone();
    assert!((first[0] - 40.0 * 0.2).abs() < 1e-6 && (first[1] + 200.0 * 0.2).abs() < 1e-6);
    controller
        .update(&Measurement::new(0.01, &q, &rest))
        .unwrap();
    assert_eq!(controller.efforts(), &first);
}

// Fails if state of the previous run remains: a joint goal, a bumpless transfer, an escape motion.
#[test]
fn a_restarted_controller_does_what_a_new_one_does() {
    for (_, law) in LawKind::NAMES {
        let mut used = planar(law);
        let (q, tip) = poses(&used, [0.3, 1.0], [0.5, 0.8]);
        let (_, other) = poses(&used, [0.3, 1.0], [1.5, -0.8]);
        let qd = DVector::from_row_slice(&[0.1, -0.2]);
        for k in 0..500 {
            update(&mut used, 0.01 * f64::from(k), &q, &qd, &other).ok();
        }
        used.set_config(config(law)).unwrap();
        update(&mut used, 5.0, &q, &qd, &other).ok();
        used.restart();
        let mut fresh = planar(law);
        for k in 0..100 {
            let time = 0.01 * f64::from(k);
            update(&mut used, time, &q, &qd, &tip).ok();
            update(&mut fresh, time, &q, &qd, &tip).ok();
            assert_eq!(used.efforts(), fresh.efforts(), "{law:?} at {time} s");
        }
    }
}

#[test]
fn an_unreachable_goal_is_an_error_and_the_joints_are_damped() {
    let mut controller = planar(LawKind::JointPd);
    let (q, mut tip) = poses(&controller, [0.3, 1.0], [0.5, 0.8]);
    tip.X_BD = Pose::from_parts(Translation3::new(20.0, 0.0, 0.0), tip.X_BE.rotation);
    let qd = DVector::from_row_slice(&[0.1, 0.0]);
    for _ in 0..2 {
        let refused = update(&mut controller, 0.0, &q, &qd, &tip);
        let Err(ControlError::Law(LawError::Unreachable(error))) = refused else {
            panic!("{refused:?}");
        };
        let IkError::NotFound { position, .. } = error;
        assert!(position > 10.0);
        assert_eq!(controller.efforts().as_slice(), [-20.0, 0.0]);
    }
}

/// Fails if efforts step at a change, if a difference does not decay, or if damping jumps.
#[test]
fn changed_settings_take_over_without_a_jump() {
    let mut controller = planar(LawKind::TransposeJacobian);
    let (q, tip) = poses(&controller, [0.3, 1.0], [0.5, 0.8]);
    let qd = DVector::from_row_slice(&[0.1, -0.2]);
    let mut time = 0.0;
    let mut step = |controller: &mut Controller, dt: f64| {
        time += dt;
        update(controller, time, &q, &qd, &tip).unwrap();
        controller.efforts().clone()
    };
    let law = config(LawKind::TransposeJacobian);
    let stronger = ControllerConfig {
        gains: Gains {
            k_p: 300.0,
            k_v: vec![20.0, 3000.0],
            ..law.gains.clone()
        },
        ..law.clone()
    };
    let approximate = ControllerConfig {
        law: TransposeJacobianConfig {
            jacobian: JacobianKind::FixedBase,
        }
        .into(),
        ..law
    };
    for settings in [config(LawKind::JointPd), stronger, approximate] {
        let before = step(&mut controller, 0.01);
        let mut fresh = planar(settings.law.kind().unwrap());
        fresh.set_config(settings.clone()).unwrap();
        let after = step(&mut fresh, 0.0);
        let jump = (&after - &before).norm();
        assert!(jump > 5.0, "{jump}: the change makes no difference");
        controller.set_config(settings).unwrap();
        let mut last = before;
        for _ in 0..500 {
            let now = step(&mut controller, 0.01);
            assert!((&now - &last).norm() < 0.021 * jump.max(700.0), "{now}");
            last = now;
        }
        assert!((last - after).norm() < 1e-3 * jump.max(700.0));
    }
}

/// Every field with NaN, and the name that the error gives it.
fn not_finite() -> Vec<(&'static str, ControllerConfig)> {
    const NAN: f64 = f64::NAN;
    type Change = fn(&mut ControllerConfig);
    let law = |law: LawKind, name: &'static str, change: Change| {
        let mut config = config(law);
        change(&mut config);
        (name, config)
    };
    let any = |name, change| law(LawKind::TransposeJacobian, name, change);
    macro_rules! field {
        ($kind:ident, $config:ident.$field:ident, $name:literal) => {
            law(LawKind::$kind, $name, |c| match &mut c.law {
                LawConfig::$kind($config) => $config.$field = NAN,
                other => panic!("{other:?}"),
            })
        };
    }
    vec![
        any("k_p", |c| c.gains.k_p = NAN),
        any("k_o", |c| c.gains.k_o = NAN),
        any("k_v[1]", |c| c.gains.k_v[1] = NAN),
        any("e_p_max", |c| c.gains.saturation.position = NAN),
        any("e_o_max", |c| c.gains.saturation.orientation = NAN),
        any("bumpless_transfer_time", |c| c.bumpless_transfer_time = NAN),
        any("goal_position_noise", |c| c.goal.position_noise = NAN),
        any("goal_attitude_noise", |c| c.goal.attitude_noise = NAN),
        any("goal_jerk", |c| c.goal.jerk = NAN),
        any("goal_angular_jerk", |c| c.goal.angular_jerk = NAN),
        any("goal_rate_noise", |c| c.goal.rate_noise = NAN),
        any("singularity_escape.rate", |c| {
            c.singularity_escape.rate = NAN
        }),
        any("singularity_escape.delay", |c| {
            c.singularity_escape.delay = NAN
        }),
        law(LawKind::JointPd, "joint_k_p[0]", |c| {
            c.law = JointPdConfig {
                k_p: vec![NAN, 1.0],
            }
            .into();
        }),
        field!(StraightPath, c.k_r, "straight_path.k_r"),
        field!(StraightPath, c.psi_max, "straight_path.psi_max"),
        field!(StraightPath, c.d_along, "straight_path.d_along"),
        field!(StraightPath, c.d_across, "straight_path.d_across"),
        field!(StraightPath, c.d_turn, "straight_path.d_turn"),
        field!(StraightPath, c.period, "straight_path.period"),
        field!(
            StraightPath,
            c.joint_damping_fraction,
            "straight_path.joint_damping_fraction"
        ),
        field!(ComputedTorque, c.frequency, "computed_torque.frequency"),
        field!(
            ComputedTorque,
            c.max_joint_rate,
            "computed_torque.max_joint_rate"
        ),
        field!(OperationalSpace, c.frequency, "operational_space.frequency"),
        field!(
            OperationalSpace,
            c.damping_ratio,
            "operational_space.damping_ratio"
        ),
        field!(
            OperationalSpace,
            c.null_space_damping,
            "operational_space.null_space_damping"
        ),
        field!(
            OperationalSpace,
            c.max_joint_rate,
            "operational_space.max_joint_rate"
        ),
        field!(
            OperationalSpace,
            c.task_damping,
            "operational_space.task_damping"
        ),
    ]
}

#[test]
fn settings_that_are_not_finite_are_refused_by_name_and_change_nothing() {
    for (name, broken) in not_finite() {
        let mut controller = planar(LawKind::TransposeJacobian);
        let before = controller.config().clone();
        let error = controller.set_config(broken.clone()).unwrap_err();
        assert!(
            error.to_string().starts_with(&format!("{name} is NaN")),
            "{error}"
        );
        assert_eq!(controller.config(), &before);
        let Manipulator { model, tip, .. } = controller.manipulator;
        assert!(Controller::new(model, tip, broken).is_err());
    }
}

#[test]
fn settings_that_do_not_fit_the_robot_change_nothing() {
    let mut controller = planar(LawKind::TransposeJacobian);
    let before = controller.config().clone();
    let mut one_gain = before.clone();
    one_gain.gains.k_v = vec![1.0];
    let mut negative = before.clone();
    negative.gains.k_p = -1.0;
    let no_gains = ControllerConfig::new(LawKind::JointPd, gains());
    let no_law = ControllerConfig::new(LawConfig::Custom, gains());
    for (broken, message) in [
        (one_gain, "k_v has 1 values; the robot has 2 joints"),
        (negative, "k_p is -1"),
        (no_gains, "joint_k_p has 0 values"),
        (no_law, "law is custom"),
    ] {
        let error = controller.set_config(broken.clone()).unwrap_err();
        assert!(error.to_string().starts_with(message), "{error}");
        assert_eq!(controller.config(), &before);
    }
}

/// Measurements that are not finite, and the quantity that the error names.
#[test]
fn measurements_that_are_not_finite_are_refused_by_name() {
    let fresh = planar(LawKind::TransposeJacobian);
    let (good_q, good) = poses(&fresh, [0.3, 1.0], [0.5, 0.8]);
    let good_qd = DVector::from_row_slice(&[0.1, -0.2]);
    let (mut q, mut qd) = (good_q.clone(), good_qd.clone());
    (q[1], qd[0]) = (f64::NAN, f64::INFINITY);
    let (mut tip, mut goal) = (good, good);
    tip.X_BE.translation.x = f64::NAN;
    goal.X_BD.translation.z = f64::NEG_INFINITY;
    let late = TipMeasurement::new(f64::NAN, good.X_BE, good.X_BD);
    let w = Vector3::new(0.0, f64::NAN, 0.0);
    let rate = GoalRate {
        time: 0.0,
        w_ID_B: w,
    };
    let second = [Some(goal)];
    let short = DVector::zeros(1);
    let base = Measurement::new(0.0, &good_q, &good_qd).with_tip(Some(&good));
    let no_efforts = [0.0, 0.0];
    let damping = [-20.0, 200.0];
    for (measurement, message, efforts) in [
        (
            Measurement { q: &q, ..base },
            "the position of joint 'joint2' is NaN",
            no_efforts,
        ),
        (
            Measurement { qd: &qd, ..base },
            "the rate of joint 'joint1' is inf",
            no_efforts,
        ),
        (
            Measurement { q: &short, ..base },
            "the measurement has 1 joint positions; the robot has 2 joints",
            no_efforts,
        ),
        (
            Measurement {
                time: f64::NAN,
                ..base
            },
            "the time of the joint state is NaN",
            no_efforts,
        ),
        (
            base.with_tip(Some(&tip)),
            "the tip pose X_BE is NaN",
            damping,
        ),
        (
            base.with_tip(Some(&goal)),
            "the goal pose X_BD is -inf",
            damping,
        ),
        (
            base.with_tip(Some(&late)),
            "the exposure time is NaN",
            damping,
        ),
        (
            Measurement {
                more_tips: &second,
                ..base
            },
            "the goal pose X_BD of tip 2 is -inf",
            damping,
        ),
        (
            base.with_gyro(Some(&w)),
            "the gyro's angular velocity w_IB_B is NaN",
            damping,
        ),
        (
            Measurement {
                goal_rate: Some(&rate),
                ..base
            },
            "the goal's angular velocity w_ID_B or its time is NaN",
            damping,
        ),
    ] {
        let mut controller = planar(LawKind::TransposeJacobian);
        let error = controller.update(&measurement).unwrap_err();
        assert!(error.to_string().starts_with(message), "{error}");
        assert_eq!(controller.efforts().as_slice(), efforts, "{message}");
        // No value of the refused measurement remains.
        let mut fresh = planar(LawKind::TransposeJacobian);
        for controller in [&mut controller, &mut fresh] {
            controller.restart();
            controller.update(&base).unwrap();
        }
        assert_eq!(controller.efforts(), fresh.efforts());
    }
}

/// A user-defined law with fixed efforts.
#[derive(Debug)]
struct Fixed(Vec<f64>);

impl Law for Fixed {
    fn efforts(
        &mut self,
        _: &LawInput<'_>,
        _: &mut Manipulator,
        efforts: &mut DVector<f64>,
    ) -> Result<LawStatus, LawError> {
        *efforts = DVector::from_row_slice(&self.0);
        Ok(LawStatus::JointFeedback)
    }
}

fn with_law(law: impl Law + 'static) -> Controller {
    let Manipulator { model, tip, .. } = planar(LawKind::TransposeJacobian).manipulator;
    let config = ControllerConfig::new(LawConfig::Custom, gains());
    Controller::with_law(Manipulator::new(model, tip), Box::new(law), config).unwrap()
}

#[test]
fn efforts_of_a_law_that_are_not_finite_or_too_few_are_refused() {
    let qd = DVector::from_row_slice(&[0.1, -0.2]);
    let q = DVector::from_row_slice(&[0.3, 1.0]);
    for (law, message) in [
        (
            Fixed(vec![1.0, f64::NAN]),
            "the effort that the law custom computed for joint 'joint2' is NaN",
        ),
        (
            Fixed(vec![1.0]),
            "the law custom gave 1 efforts; the robot has 2 joints",
        ),
    ] {
        let mut controller = with_law(law);
        let error = controller
            .update(&Measurement::new(0.0, &q, &qd))
            .unwrap_err();
        assert!(error.to_string().starts_with(message), "{error}");
        assert_eq!(controller.efforts().as_slice(), [-20.0, 200.0]);
    }
}

/// A user-defined law may be replaced, kept and given up as the built-in ones, and may contain one of them.
#[test]
fn a_user_defined_law_takes_over_and_gives_way_without_a_jump() {
    let mut controller = with_law(Fixed(vec![5.0, -3.0]));
    let (q, tip) = poses(&controller, [0.3, 1.0], [0.5, 0.8]);
    let rest = DVector::zeros(2);
    let mut time = 0.0;
    let mut step = |controller: &mut Controller| {
        time += 0.01;
        update(controller, time, &q, &rest, &tip).unwrap();
        controller.efforts().clone()
    };
    assert_eq!(step(&mut controller).as_slice(), [5.0, -3.0]);
    controller.set_law(Box::new(Fixed(vec![50.0, 3.0])));
    let next = step(&mut controller);
    assert!((next[0] - 5.0).abs() < 1e-12, "{next}");
    for _ in 0..1000 {
        step(&mut controller);
    }
    let settled = step(&mut controller);
    assert!((settled[0] - 50.0).abs() < 1e-6, "{settled}");
    // Other gains keep the law; a built-in law replaces it.
    let mut config = controller.config().clone();
    config.gains.k_p = 1.0;
    controller.set_config(config).unwrap();
    assert!((step(&mut controller)[0] - settled[0]).abs() < 1e-12);
    controller
        .set_config(self::config(LawKind::TransposeJacobian))
        .unwrap();
    assert!((step(&mut controller)[0] - settled[0]).abs() < 1e-6);
    for _ in 0..1000 {
        step(&mut controller);
    }
    let mut fresh = planar(LawKind::TransposeJacobian);
    let expected = step(&mut fresh);
    assert!((step(&mut controller) - expected).amax() < 1e-6);
}

/// A built-in law with a constant effort added.
#[derive(Debug)]
struct Biased(StraightPath);

impl Law for Biased {
    fn efforts(
        &mut self,
        input: &LawInput<'_>,
        manipulator: &mut Manipulator,
        efforts: &mut DVector<f64>,
    ) -> Result<LawStatus, LawError> {
        let status = self.0.efforts(input, manipulator, efforts)?;
        efforts[0] += 1.0;
        Ok(status)
    }
}

#[test]
fn a_user_defined_law_may_extend_a_built_in_one() {
    let mut plain = planar(LawKind::StraightPath);
    let law = StraightPath::new(StraightPathConfig::default(), &plain.manipulator);
    let mut biased = with_law(Biased(law));
    let (q, tip) = poses(&plain, [0.3, 1.0], [0.5, 0.8]);
    let qd = DVector::from_row_slice(&[0.1, -0.2]);
    update(&mut plain, 0.0, &q, &qd, &tip).unwrap();
    update(&mut biased, 0.0, &q, &qd, &tip).unwrap();
    let difference = biased.efforts() - plain.efforts();
    assert!((difference - DVector::from_row_slice(&[1.0, 0.0])).amax() < 1e-12);
}
