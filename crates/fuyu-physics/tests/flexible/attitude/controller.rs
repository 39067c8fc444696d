//! The control step with sensors: accuracy in closed loop, lost inputs, wrong inputs.

use allocation_counter::measure;
use fuyu_physics::control::attitude::{
    AttitudeController, AttitudeControllerConfig, AttitudeFilter, AttitudeFilterConfig,
    AttitudeMode, AttitudeRegulator, AttitudeReport, AttitudeTarget, Dvdfb, GyroErrors,
    RegulatorConfig, SimulatedGyro,
};
use fuyu_physics::control::{InputStatus, Stamp};
use fuyu_physics::dynamics::IntegrationMethod;
use fuyu_physics::dynamics::flexible::{
    FlexibleInput, FlexibleIntegrator, FlexibleState, FlexibleSystem, FlexibleWorkspace,
};
use fuyu_physics::vision::{StarTracker, StarTrackerConfig};
use nalgebra::{DVector, UnitQuaternion, Vector3};

use crate::support::{POSTURES, efforts, servicer_with_wheels, servicer_with_wheels_and_thrusters};

/// .01 deg/s^½ of angle random walk, and a bias of 20 deg/h.
const GYRO: GyroErrors = GyroErrors {
    angle_random_walk: 3e-6,
    rate_random_walk: 1e-7,
    initial_bias: 1e-4,
};

fn controller(system: &FlexibleSystem) -> AttitudeController {
    let law = Dvdfb::diagonal([60.0; 3], [900.0; 3]).unwrap();
    let filter = AttitudeFilter::new(AttitudeFilterConfig::new(GYRO, 5e-5)).unwrap();
    let config = RegulatorConfig::new(0.1);
    let regulator = AttitudeRegulator::new(system, Box::new(law), config).unwrap();
    AttitudeController::new(filter, regulator, AttitudeControllerConfig::default()).unwrap()
}

/// Robot, sensors and controller in closed loop, while the arm is driven.
struct Loop {
    state: FlexibleState,
    workspace: FlexibleWorkspace,
    integrator: FlexibleIntegrator,
    gyro: SimulatedGyro,
    tracker: StarTracker,
    controller: AttitudeController,
    period: usize,
}

impl Loop {
    fn new(seed: u64) -> Self {
        let system = servicer_with_wheels(0.0);
        let q = DVector::from_row_slice(&POSTURES[1].1);
        let state = FlexibleState::at_rest_with(&system, &q);
        let mut workspace = FlexibleWorkspace::new(&system);
        workspace.set_state(&state);
        Self {
            integrator: FlexibleIntegrator::new(&system, IntegrationMethod::Rk4),
            gyro: SimulatedGyro::new(GYRO, seed),
            tracker: StarTracker::new(StarTrackerConfig {
                rate: 4.0,
                latency: 0.25,
                noise: 5e-5,
                dropout: 0.05,
                seed,
            }),
            controller: controller(&system),
            state,
            workspace,
            period: 0,
        }
    }

    /// One control period of .1 s: a step, then the motion with gyro samples every 20 ms.
    fn period(&mut self) -> AttitudeReport {
        let mut report = None;
        for k in 0..5 {
            let time = (self.period * 5 + k) as f64 * 0.02;
            let stamp = Stamp::from_secs_f64(time);
            let w = self.gyro.sample(&self.workspace.V_WB_B().angular, 0.02);
            self.controller.add_gyro(stamp, w).unwrap();
            self.tracker.show(time, &self.state.tree.R_WB);
            while let Some(frame) = self.tracker.deliver(time) {
                let stamp = Stamp::from_secs_f64(frame.time);
                self.controller
                    .add_star_tracker(stamp, &frame.R_WB)
                    .unwrap();
            }
            if k == 0 {
                let (state, controller) = (&self.state, &mut self.controller);
                controller
                    .add_wheel_speeds(stamp, state.wheel_speeds())
                    .unwrap();
                let (q, qd) = (state.tree.q.as_slice(), state.tree.qd.as_slice());
                controller.add_joint_state(stamp, q, qd).unwrap();
                report = Some(controller.step(stamp));
            }
            let torques = self.controller.wheel_torques();
            let mut forcing = |t: f64, s: &FlexibleState, input: &mut FlexibleInput| {
                efforts(0.1, t, s.tree.qd.as_slice(), &mut input.tree.efforts);
                input.wheel_torques.copy_from_slice(torques);
            };
            self.integrator
                .step(&mut self.state, &mut self.workspace, 0.02, &mut forcing);
        }
        self.period += 1;
        report.expect("the first sample of a period has a report")
    }
}

// Sensors as on a small satellite, while the arm moves: bias and attitude are found, and the base stays within some
// hundredths of a degree of the reference, although the gyro's bias alone would turn it by .34 deg a minute.
#[test]
fn the_base_is_held_with_real_sensors() {
    for seed in [1, 2, 3] {
        let mut run = Loop::new(seed);
        let target = AttitudeTarget::fixed(UnitQuaternion::identity());
        let now = Stamp::from_secs_f64(0.0);
        run.controller.set_target(now, &target).unwrap();
        let first = run.period();
        // The star tracker's first attitude is on its way.
        assert_eq!(first.mode, AttitudeMode::RateDamping);
        let (mut largest, mut normalized) = (0.0_f64, 0.0);
        for k in 0..1200 {
            let R_WB = run.state.tree.R_WB;
            let report = run.period();
            assert!(k < 3 || report.mode == AttitudeMode::Law);
            if k >= 600 {
                largest = largest.max(R_WB.angle());
                let estimate = report.estimate.unwrap();
                let error = (estimate.R_WB.inverse() * R_WB).scaled_axis();
                let block = estimate.covariance.fixed_view::<3, 3>(0, 0).into_owned();
                normalized += error.dot(&(block.try_inverse().unwrap() * error)) / 600.0;
                let bias = (run.gyro.bias() - estimate.bias).norm();
                assert!(bias < 2e-5, "{bias}");
            }
        }
        println!(
            "seed {seed}: largest deviation {:.4} deg, normalized squared error {normalized:.2} of 3",
            largest.to_degrees()
        );
        assert!(largest < 0.05f64.to_radians(), "{largest}");
        assert!(normalized > 1.0 && normalized < 7.0, "{normalized}");
        assert_eq!(run.controller.filter().outliers(), 0);
    }
}

#[test]
fn lost_inputs_have_their_fallbacks() {
    let system = servicer_with_wheels_and_thrusters();
    let mut c = controller(&system);
    let stamp = |t: f64| Stamp::from_secs_f64(t);
    let one = UnitQuaternion::identity();
    // Nothing yet.
    let report = c.step(stamp(0.0));
    assert_eq!(
        (report.mode, report.gyro),
        (AttitudeMode::ZeroTorque, InputStatus::Missing)
    );
    assert_eq!(c.wheel_torques(), [0.0; 3]);
    // A gyro alone: the rate is damped.
    c.add_gyro(stamp(0.0), Vector3::x() * 1e-3).unwrap();
    let report = c.step(stamp(0.0));
    assert_eq!(report.mode, AttitudeMode::RateDamping);
    assert!((c.wheel_torques()[0] - 0.9).abs() < 1e-12);
    assert_eq!(report.wheels, InputStatus::Missing);
    // With a star tracker: the first attitude is the reference.
    c.add_star_tracker(stamp(0.0), &one).unwrap();
    assert_eq!(c.step(stamp(0.0)).mode, AttitudeMode::Law);
    assert_eq!(c.target(stamp(0.0)).unwrap().R_WD, one);
    // Without it, the gyro alone carries the attitude on, until it is not known well enough.
    let mut modes = Vec::new();
    for k in 1..=20_000 {
        let now = stamp(f64::from(k) * 0.1);
        c.add_gyro(now, Vector3::zeros()).unwrap();
        let report = c.step(now);
        assert_eq!(report.star_tracker.is_used(), k <= 20);
        modes.push(report.mode);
    }
    let lost = modes
        .iter()
        .position(|m| *m == AttitudeMode::RateDamping)
        .unwrap();
    // The uncertain bias of 1e-4 rad/s turns into .1 rad in 1000 s.
    assert!((9_000..10_100).contains(&lost), "{lost}");
    assert!(
        modes[lost..]
            .iter()
            .all(|m| *m == AttitudeMode::RateDamping)
    );
    // Old wheel speeds and joint states are not used; a lost gyro ends all torques.
    c.add_wheel_speeds(stamp(2000.0), &[10.0, 0.0, -10.0])
        .unwrap();
    c.add_joint_state(stamp(2000.0), &[0.1; 6], &[0.2; 6])
        .unwrap();
    let report = c.step(stamp(2000.1));
    assert!(report.wheels.is_used() && report.joints.is_used());
    assert!((report.regulator.unwrap().wheel_momentum.unwrap().x - 2.0).abs() < 1e-12);
    c.add_gyro(stamp(2000.6), Vector3::x() * 1e-3).unwrap();
    let report = c.step(stamp(2000.6));
    assert!(!report.wheels.is_used() && !report.joints.is_used());
    assert!(c.wheel_torques()[0] != 0.0);
    let report = c.step(stamp(2001.2));
    assert_eq!(report.mode, AttitudeMode::ZeroTorque);
    assert!(matches!(report.gyro, InputStatus::Stale { .. }));
    assert_eq!(
        (c.wheel_torques(), c.on_times()),
        (&[0.0; 3][..], &[0.0; 12][..])
    );
    // An earlier time is another run.
    c.add_gyro(stamp(1.0), Vector3::zeros()).unwrap();
    assert!(c.target(stamp(1.0)).is_none());
    assert_eq!(c.step(stamp(1.0)).wheels, InputStatus::Missing);
}

#[test]
fn wrong_inputs_are_refused_by_name() {
    let mut c = controller(&servicer_with_wheels(0.0));
    let now = Stamp::from_secs_f64(0.0);
    let text = c
        .add_wheel_speeds(now, &[0.0, f64::NAN, 0.0])
        .unwrap_err()
        .to_string();
    assert_eq!(text, "speed of wheel y is NaN; it must be finite");
    let text = c.add_wheel_speeds(now, &[0.0]).unwrap_err().to_string();
    assert_eq!(text, "wheel speeds: 1 values; 3 are needed");
    let rates = [0.0, 0.0, f64::INFINITY, 0.0, 0.0, 0.0];
    let text = c
        .add_joint_state(now, &[0.0; 6], &rates)
        .unwrap_err()
        .to_string();
    assert_eq!(text, "joint rates[2] is inf; it must be finite");
    let text = c
        .add_gyro(now, Vector3::new(0.0, 0.0, f64::NAN))
        .unwrap_err()
        .to_string();
    assert_eq!(text, "angular_velocity.z is NaN; it must be finite");
    let mut target = AttitudeTarget::fixed(UnitQuaternion::identity());
    target.w_WD_D.y = f64::NAN;
    let text = c.set_target(now, &target).unwrap_err().to_string();
    assert_eq!(text, "angular_velocity.y is NaN; it must be finite");
    // Nothing of it was taken.
    let report = c.step(now);
    assert_eq!(
        (report.gyro, report.wheels),
        (InputStatus::Missing, InputStatus::Missing)
    );
}

// The torque of the new law would be twice that of the old one. It is approached with the time constant, from the torque
// that acts; after a release nothing of the past remains.
#[test]
fn a_law_that_replaces_another_takes_over_without_a_jump() {
    let mut c = controller(&servicer_with_wheels(0.0));
    let mut time = 0.0;
    let mut torque = |c: &mut AttitudeController| {
        let now = Stamp::from_secs_f64(time);
        time += 0.1;
        c.add_gyro(now, Vector3::x() * 1e-3).unwrap();
        assert_eq!(c.step(now).mode, AttitudeMode::RateDamping);
        c.wheel_torques()[0]
    };
    let twice = || Box::new(Dvdfb::diagonal([60.0; 3], [1800.0; 3]).unwrap());
    assert!((torque(&mut c) - 0.9).abs() < 1e-12);
    c.set_law(twice());
    for k in 0..100 {
        let expected = 1.8 - 0.9 * (-0.1 * f64::from(k)).exp();
        let found = torque(&mut c);
        assert!((found - expected).abs() < 1e-12, "{k}: {found} {expected}");
    }
    c.release();
    assert_eq!(c.wheel_torques(), [0.0; 3]);
    assert!((torque(&mut c) - 1.8).abs() < 1e-12);
    // Before the first step of a run there is no torque to begin with.
    c.release();
    c.set_law(Box::new(Dvdfb::diagonal([60.0; 3], [900.0; 3]).unwrap()));
    assert!((torque(&mut c) - 0.9).abs() < 1e-12);
}

// A stamp far ahead would otherwise hide all samples until that time.
#[test]
fn a_wheel_state_from_the_future_does_not_hide_later_ones() {
    let mut c = controller(&servicer_with_wheels(0.0));
    let at = Stamp::from_secs_f64;
    c.add_gyro(at(0.2), Vector3::zeros()).unwrap();
    c.add_wheel_speeds(at(1000.0), &[1.0; 3]).unwrap();
    assert!(!c.step(at(0.2)).wheels.is_used());
    c.add_wheel_speeds(at(0.2), &[10.0; 3]).unwrap();
    // Late, so not used.
    c.add_wheel_speeds(at(0.1), &[20.0; 3]).unwrap();
    let report = c.step(at(0.2));
    assert!(report.wheels.is_used());
    let momentum = report.regulator.unwrap().wheel_momentum.unwrap();
    assert!((momentum.x - 2.0).abs() < 1e-12, "{momentum}");
}

#[test]
fn steps_do_not_allocate() {
    let system = servicer_with_wheels_and_thrusters();
    let mut c = controller(&system);
    let one = UnitQuaternion::identity();
    let used = measure(|| {
        for k in 0..400 {
            let now = Stamp::from_secs_f64(f64::from(k) * 0.1);
            c.add_gyro(now, Vector3::z() * 1e-3).unwrap();
            if k >= 5 && k % 3 == 0 {
                let late = Stamp::from_secs_f64(f64::from(k - 2) * 0.1 + 0.05);
                c.add_star_tracker(late, &one).unwrap();
            }
            c.add_wheel_speeds(now, &[400.0, -300.0, 100.0]).unwrap();
            c.add_joint_state(now, &[0.3; 6], &[0.01; 6]).unwrap();
            c.step(now);
        }
    });
    assert_eq!(used.count_total, 0);
    // The wheels were being unloaded.
    assert!(c.on_times().iter().any(|t| *t > 0.0));
}
