//! The step loop does not allocate.

use allocation_counter::measure;
use fuyu::control::prediction::Prediction;
use fuyu::control::{
    BaseTask, ControlLoop, ControlLoopConfig, ControlMode, Controller, ControllerConfig, Gains,
    JacobianKind, JointPdConfig, LawConfig, LawKind, Measurement, OperationalSpaceConfig,
    Resolution, ResolvedRate, ResolvedRateConfig, Saturation, Shaping, SingularityEscapeConfig,
    Stamp, StraightPathConfig, TipMeasurement,
};
use fuyu::dynamics::{Floating, Input, IntegrationMethod, Integrator, State, Workspace};
use fuyu::model::Model;
use fuyu::spatial::{Pose, Twist};
use nalgebra::{DVector, Matrix6xX, Translation3, Vector3};

use crate::fixtures::servicer;
use crate::loops::mechanisms::{HINGE, on_branch, pantograph, pantograph_loops};

const LIMITED: Saturation = Saturation {
    position: 0.2,
    orientation: 0.1,
};

/// Gains of Masutani 1995 chapter 5.
fn gains(saturation: Saturation) -> Gains {
    Gains {
        k_p: 75.0,
        k_o: 100.0,
        k_v: vec![400.0, 100.0, 200.0, 10.0, 2.0, 2.0],
        saturation,
    }
}

#[test]
fn steps_jacobians_and_the_control_law_do_not_allocate() {
    let model = servicer();
    let tip = model.frame("tool0").unwrap().clone();
    let mut state = State::at_rest(&model);
    let mut workspace = Workspace::new(&model);
    let gains = gains(LIMITED);
    // The computed-torque law plans when the goal moves, as it does here: its own test is below.
    let laws = LawKind::NAMES.map(|(_, law)| law);
    let laws = laws.into_iter().filter(|l| *l != LawKind::ComputedTorque);
    let controllers = laws.map(|law| {
        let law = match law {
            LawKind::JointPd => JointPdConfig { k_p: vec![1.0; 6] }.into(),
            law => LawConfig::from(law),
        };
        let config = ControllerConfig {
            prediction: Prediction::Motion,
            ..ControllerConfig::new(law, gains.clone())
        };
        let mut controller = Controller::new(model.clone(), tip.clone(), config.clone()).unwrap();
        // The joint PD searches its joint goal at its first step, and every law hands over in the next ones.
        let X_BE = Workspace::new(&model).X_BF(&tip);
        let sight = TipMeasurement::new(0.0, X_BE, X_BE);
        let seen = Measurement::new(0.0, &state.q, &state.qd).with_tip(Some(&sight));
        controller.update(&seen).unwrap();
        let mut approximate = config;
        let fixed_base = JacobianKind::FixedBase;
        match &mut approximate.law {
            LawConfig::TransposeJacobian(config) => config.jacobian = fixed_base,
            LawConfig::StraightPath(config) => config.jacobian = fixed_base,
            _ => {}
        }
        controller.set_config(approximate).unwrap();
        controller
    });
    let mut controllers: Vec<Controller> = controllers.collect();
    let mut matrix = Matrix6xX::zeros(6);
    let mut push = |_: f64, _: &State, input: &mut Input| input.efforts.fill(0.1);
    for method in [IntegrationMethod::Rk4, IntegrationMethod::Dop8] {
        let mut integrator = Integrator::new(&model, method);
        let mut floating = Floating::new(model.clone(), state.clone(), method);
        let used = measure(|| {
            for _ in 0..100 {
                integrator.step(&mut state, &mut workspace, 0.01, &mut push);
                let X_BE = workspace.X_BF(&tip);
                let sight = TipMeasurement::new(state.time, X_BE, X_BE);
                let seen = Measurement::new(state.time, &state.q, &state.qd);
                for controller in &mut controllers {
                    controller.update(&seen.with_tip(Some(&sight))).unwrap();
                }
                workspace.base_map(&mut matrix);
                workspace.generalized_jacobian(&tip, &mut matrix);
                workspace.reduced_inertia();
                floating.hold_efforts(controllers[0].efforts().as_slice());
                floating.step(0.01, 1);
                floating.accelerations();
            }
        });
        assert_eq!(used.count_total, 0, "{method:?}: {used:?}");
    }
}

/// Only planning a trajectory takes memory, which happens at the first step here.
#[test]
fn the_computed_torque_law_takes_no_memory_between_plans() {
    let model = servicer();
    let tip = model.frame("tool0").unwrap().clone();
    let gains = gains(Saturation::NONE);
    let config = ControllerConfig::new(LawKind::ComputedTorque, gains);
    let mut controller = Controller::new(model.clone(), tip.clone(), config).unwrap();
    let q = DVector::from_element(6, 0.4);
    let state = State::at_rest_with(&model, &q);
    let mut robot = Floating::new(model, state, IntegrationMethod::Rk4);
    let X_WE = robot.state().X_WB(robot.workspace()) * robot.workspace().X_BF(&tip);
    let X_WD = Translation3::new(0.1, -0.2, 0.1) * X_WE;
    let mut step = |robot: &mut Floating, time: f64| {
        let X_BW = robot.state().X_WB(robot.workspace()).inverse();
        let X_BE = robot.workspace().X_BF(&tip);
        let sight = TipMeasurement::new(time, X_BE, X_BW * X_WD);
        let state = robot.state();
        let seen = Measurement::new(time, &state.q, &state.qd).with_tip(Some(&sight));
        controller.update(&seen).unwrap();
        robot.hold_efforts(controller.efforts().as_slice());
        robot.step(0.01, 1);
    };
    step(&mut robot, 0.0);
    let used = measure(|| (1..500).for_each(|k| step(&mut robot, 0.01 * f64::from(k))));
    assert_eq!(used.count_total, 0, "{used:?}");
    // It has moved.
    assert!((&robot.state().q - &q).amax() > 0.01);
}

/// All settings that make a control step do something else: shapes of straight paths, tasks, predictions. The settings
/// change just before every measured stretch, so that efforts are handed over in it.
#[test]
fn control_steps_take_no_memory_whatever_they_do() {
    let model = servicer();
    let tip = model.frame("tool0").unwrap().clone();
    let gains = gains(LIMITED);
    let mut configs = Vec::new();
    for (_, prediction) in Prediction::NAMES {
        for (_, shaping) in Shaping::NAMES {
            let straight_path = StraightPathConfig {
                shaping,
                period: 0.01,
                ..StraightPathConfig::default()
            };
            configs.push(ControllerConfig {
                prediction,
                ..ControllerConfig::new(straight_path, gains.clone())
            });
        }
        for (_, base) in BaseTask::NAMES {
            let operational = OperationalSpaceConfig {
                base,
                // The rate limit acts too.
                max_joint_rate: 0.01,
                ..OperationalSpaceConfig::default()
            };
            configs.push(ControllerConfig {
                prediction,
                ..ControllerConfig::new(operational, gains.clone())
            });
        }
        configs.push(ControllerConfig {
            prediction,
            ..ControllerConfig::new(LawKind::TransposeJacobian, gains.clone())
        });
    }
    let q = DVector::from_fn(6, |j, _| 0.3 + 0.2 * j as f64);
    let qd = DVector::from_element(6, 0.02);
    let mut workspace = Workspace::new(&model);
    workspace.set_positions(&q);
    let X_BE = workspace.X_BF(&tip);
    let X_BD = |time: f64| {
        let p = X_BE.translation.vector + Vector3::new(0.3 - 0.05 * time, 0.1, 0.0);
        Pose::from_parts(Translation3::from(p), X_BE.rotation)
    };
    let w = Vector3::new(0.001, 0.002, 0.0);
    let mut controller = Controller::new(model, tip, configs[0].clone()).unwrap();
    let mut time = 0.0;
    for config in configs {
        let what = format!("{:?} {:?}", config.law, config.prediction);
        controller.set_config(config).unwrap();
        let used = measure(|| {
            for _ in 0..50 {
                time += 0.01;
                let sight = TipMeasurement::new(time, X_BE, X_BD(time));
                let seen = Measurement::new(time, &q, &qd).with_gyro(Some(&w));
                controller.update(&seen.with_tip(Some(&sight))).unwrap();
            }
            // Nothing is seen: damping.
            time += 0.01;
            let blind = Measurement::new(time, &q, &qd);
            controller.update(&blind).unwrap();
        });
        assert_eq!(used.count_total, 0, "{what}: {used:?}");
        assert!(controller.efforts().iter().all(|e| e.is_finite()), "{what}");
    }
}

/// A stretched arm whose goal is on its own line: the law moves no joint, and kicks come.
#[test]
fn kicks_take_no_memory() {
    let xml = include_str!("../../urdf/planar_two_link.urdf");
    let model = Model::from_urdf(xml, "urdf/planar_two_link.urdf").unwrap();
    let tip = model.frame("tool0").unwrap().clone();
    let (q, qd) = (DVector::zeros(2), DVector::zeros(2));
    let mut workspace = Workspace::new(&model);
    workspace.set_positions(&q);
    let X_BE = workspace.X_BF(&tip);
    let inwards = -(X_BE.translation.vector - workspace.p_BC()).normalize();
    let nearer = Translation3::from(X_BE.translation.vector + inwards);
    let gains = Gains {
        k_p: 100.0,
        k_o: 0.0,
        k_v: vec![200.0, 1000.0],
        saturation: Saturation::NONE,
    };
    let config = ControllerConfig {
        singularity_escape: SingularityEscapeConfig {
            delay: 0.5,
            ..SingularityEscapeConfig::default()
        },
        ..ControllerConfig::new(LawKind::TransposeJacobian, gains)
    };
    let mut controller = Controller::new(model, tip, config).unwrap();
    let X_BD = Pose::from_parts(nearer, X_BE.rotation);
    let mut kicked = 0.0f64;
    let mut update = |k: u32| {
        let time = 0.01 * f64::from(k);
        let sight = TipMeasurement::new(time, X_BE, X_BD);
        let seen = Measurement::new(time, &q, &qd).with_tip(Some(&sight));
        controller.update(&seen).unwrap();
        kicked = kicked.max(controller.efforts().amax());
    };
    update(0);
    let used = measure(|| (1..400).for_each(&mut update));
    assert_eq!(used.count_total, 0, "{used:?}");
    // A tenth of a radian a second against 200 and 1000 N m s/rad.
    assert!(kicked > 10.0, "{kicked}");
}

/// Joint states, poses, gyro samples and goal rates into a control loop, one camera frame in ten: pairing and queues too.
#[test]
fn steps_of_the_control_loop_take_no_memory() {
    let model = servicer();
    let tip = model.frame("tool0").unwrap().clone();
    let X_BE = Workspace::new(&model).X_BF(&tip);
    let gains = gains(Saturation::NONE);
    let config = ControllerConfig {
        prediction: Prediction::Motion,
        ..ControllerConfig::new(LawKind::TransposeJacobian, gains)
    };
    // Damping is slow enough in this posture that the delay can be compensated.
    let q = [1.13, 1.73, -1.66, -0.38, 0.05, -0.73];
    let (qd, w) = ([0.01; 6], Vector3::new(0.001, 0.002, 0.0));
    for compensates_delay in [false, true] {
        let (model, tip) = (model.clone(), tip.clone());
        let controller = Controller::new(model, tip, config.clone()).unwrap();
        let settings = ControlLoopConfig {
            timeout: 0.05,
            lockstep: false,
            compensates_delay,
        };
        let mut control_loop = ControlLoop::new(controller, settings);
        // The first states and delays are judged, which takes memory.
        for k in [-2, -1] {
            let stamp = Stamp::from_secs_f64(0.01 * f64::from(k));
            control_loop.add_joint_state(stamp, &q, &qd).unwrap();
            for _ in 0..10 {
                control_loop.add_command_delay(0.03).unwrap();
            }
            control_loop.step().unwrap();
        }
        let (mut acted, mut delay) = (0, None);
        let used = measure(|| {
            for k in 0..500 {
                let stamp = Stamp::from_secs_f64(0.01 * f64::from(k));
                control_loop.add_joint_state(stamp, &q, &qd).unwrap();
                control_loop.add_tip_pose(0, stamp, X_BE).unwrap();
                if k % 10 == 0 {
                    control_loop.add_goal_pose(0, stamp, X_BE).unwrap();
                }
                control_loop.add_gyro(stamp, w).unwrap();
                control_loop.add_goal_rate(stamp, w).unwrap();
                control_loop.add_command_delay(0.03).unwrap();
                let report = control_loop.step().unwrap();
                acted += usize::from(report.mode == ControlMode::Law);
                delay = Some(report.delay);
            }
        });
        assert_eq!(used.count_total, 0, "{used:?}");
        // Of ten states one has a frame and five more are within the timeout.
        assert_eq!(acted, 300, "{delay:?}");
    }
}

#[test]
fn resolved_rates_take_no_memory() {
    let model = servicer();
    let tip = model.frame("tool0").unwrap().clone();
    let mut workspace = Workspace::new(&model);
    let q = DVector::from_fn(6, |j, _| 0.3 + 0.2 * j as f64);
    let mut rates = DVector::zeros(6);
    let wanted = Twist::new(Vector3::zeros(), Vector3::new(0.0, 0.05, 0.0));
    for (name, method) in Resolution::NAMES {
        let config = ResolvedRateConfig {
            method,
            ..ResolvedRateConfig::default()
        };
        let mut resolved = ResolvedRate::new(&model, &tip, config);
        let used = measure(|| {
            resolved.rates(&model, &mut workspace, &q, &wanted, &mut rates);
        });
        assert_eq!(used.count_total, 0, "{name}: {used:?}");
        assert!(rates.amax() > 0.0, "{name}");
    }
}

/// Closed loops neither, from a singular state on.
#[test]
fn steps_of_closed_loops_do_not_allocate() {
    let model = pantograph(1.0);
    let mut state = on_branch(&model, 0.3, 0.0, 0.0, 0.3);
    let mut loops = pantograph_loops(&model, HINGE);
    loops.assemble(&mut state, 1e-9).unwrap();
    let mut floating = Floating::with_loops(loops, state, IntegrationMethod::Dop8);
    let used = measure(|| floating.step(0.01, 20));
    assert_eq!(used.count_total, 0, "{used:?}");
    assert!(floating.state().q[1] > 0.01);
}
