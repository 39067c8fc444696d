//! Closed loops of the servicer with delayed efforts.

use nalgebra::DVector;

use super::*;
use crate::control::fixtures::servicer;
use crate::control::{
    ControlLoop, ControlLoopConfig, ControlMode, ControllerConfig, Gains, LawKind, LoopReport,
    Saturation,
};

/// Period of the states \[s\].
const PERIOD: f64 = 0.01;
/// Gains of the thesis.
const K_V: [f64; 6] = [400.0, 100.0, 200.0, 10.0, 2.0, 2.0];
const START: [f64; 6] = [1.134, 1.728, -1.658, -0.384, 0.0524, -0.733];

fn control_loop(compensates_delay: bool, gain: f64) -> ControlLoop {
    let (model, tip) = servicer();
    let gains = Gains {
        k_p: 75.0,
        k_o: 100.0,
        k_v: K_V.map(|k| gain * k).to_vec(),
        saturation: Saturation {
            position: 0.2,
            orientation: 0.1,
        },
    };
    let config = ControllerConfig::new(LawKind::TransposeJacobian, gains);
    let controller = Controller::new(model, tip, config).unwrap();
    let settings = ControlLoopConfig {
        timeout: 1.0,
        lockstep: false,
        compensates_delay,
    };
    ControlLoop::new(controller, settings)
}

/// A servicer whose efforts act `delay` late; its actuators give `actuator` times the commanded effort.
struct Plant {
    integrator: Integrator,
    workspace: Workspace,
    state: State,
    delay: f64,
    actuator: f64,
    /// Commanded efforts, with the times at which they act.
    coming: VecDeque<(f64, DVector<f64>)>,
    acting: DVector<f64>,
    /// Largest joint rate so far \[rad/s\].
    fastest: f64,
}

impl Plant {
    fn new(delay: f64, actuator: f64) -> Self {
        let (model, _) = servicer();
        let q = DVector::from_row_slice(&START);
        Self {
            integrator: Integrator::new(&model, IntegrationMethod::Dop8),
            workspace: Workspace::new(&model),
            state: State::at_rest_with(&model, &q),
            delay,
            actuator,
            coming: VecDeque::new(),
            acting: DVector::zeros(6),
            fastest: 0.0,
        }
    }

    fn to(&mut self, end: f64) {
        while self.state.time < end - 1e-9 {
            let first = self.coming.front().map_or(f64::INFINITY, |(at, _)| *at);
            if first <= self.state.time + 1e-9 {
                let (_, efforts) = self.coming.pop_front().unwrap();
                self.acting = efforts * self.actuator;
                continue;
            }
            let dt = first.min(end) - self.state.time;
            let acting = self.acting.clone();
            let mut hold = |_: f64, _: &State, input: &mut Input| input.efforts.copy_from(&acting);
            (self.integrator).step(&mut self.state, &mut self.workspace, dt, &mut hold);
        }
        self.fastest = self.fastest.max(self.state.qd.amax());
    }

    /// Runs the loop for `periods` from a goal 0.5 m away. Returns the last report, and the tip's deviation \[m\].
    fn run(&mut self, control_loop: &mut ControlLoop, periods: u32) -> (LoopReport, f64) {
        let tip = control_loop.controller().tip().clone();
        self.workspace.set_positions(&self.state.q);
        let start = self.state.X_WB(&self.workspace) * self.workspace.X_BF(&tip);
        let X_WD = nalgebra::Translation3::new(0.3, 0.4, 0.0) * start;
        let mut last = None;
        let mut error = f64::NAN;
        for k in 0..periods {
            let time = PERIOD * f64::from(k);
            self.to(time);
            if !self.state.is_finite() {
                self.fastest = f64::INFINITY;
                break;
            }
            let stamp = Stamp::from_secs_f64(time);
            self.workspace.set_motion(&self.state);
            let X_WB = self.state.X_WB(&self.workspace);
            let X_BE = self.workspace.X_BF(&tip);
            let X_BD = X_WB.inverse() * X_WD;
            error = (X_BD.translation.vector - X_BE.translation.vector).norm();
            let (q, qd) = (self.state.q.as_slice(), self.state.qd.as_slice());
            control_loop.add_joint_state(stamp, q, qd).unwrap();
            control_loop.add_tip_pose(0, stamp, X_BE).unwrap();
            control_loop.add_goal_pose(0, stamp, X_BD).unwrap();
            let w_IB_B = self.workspace.V_WB_B().angular;
            control_loop.add_gyro(stamp, w_IB_B).unwrap();
            if time > 2.0 * self.delay {
                control_loop.add_command_delay(self.delay).unwrap();
            }
            last = Some(control_loop.step().unwrap());
            let efforts = control_loop.efforts().clone();
            self.coming.push_back((time + self.delay, efforts));
        }
        (last.unwrap(), error)
    }
}

/// Largest joint rate \[rad/s\] and last deviation of the tip \[m\] within 20 s.
fn fastest(delay: f64, compensates: bool, actuator: f64) -> (f64, f64) {
    let mut plant = Plant::new(delay, actuator);
    let (_, error) = plant.run(&mut control_loop(compensates, 1.0), 2000);
    (plant.fastest, error)
}

// Fails if the state is predicted by a wrong time, or with efforts that do not act then: the joint rates would grow, as
// they do without compensation.
#[test]
fn efforts_that_act_late_are_as_good_as_prompt_ones() {
    let (prompt, end) = fastest(0.0, false, 1.0);
    assert!(prompt < 3.0 && end < 0.05, "{prompt} rad/s, {end} m");
    for delay in [0.01, 0.026, 0.04, 0.1] {
        let (late, _) = fastest(delay, false, 1.0);
        assert!(
            delay < 0.02 || late > 5.0 * prompt,
            "{delay} s late: {late} rad/s"
        );
        let (compensated, error) = fastest(delay, true, 1.0);
        let more = (compensated / prompt - 1.0).abs();
        assert!(
            more < 0.01,
            "{delay} s late: {compensated}, prompt {prompt} rad/s"
        );
        assert!(
            (error - end).abs() < 0.005,
            "{delay} s late: {error}, prompt {end} m"
        );
    }
}

// Fails if the limit leaves no room for the model error that it allows.
#[test]
fn a_model_that_is_wrong_by_a_fifth_does() {
    let (prompt, _) = fastest(0.0, false, 1.0);
    for actuator in [0.8, 1.2] {
        let (compensated, error) = fastest(0.05, true, actuator);
        assert!(
            compensated < 1.3 * prompt,
            "{actuator}: {compensated}, {prompt} rad/s"
        );
        assert!(error < 0.05, "{actuator}: {error} m");
    }
}

/// The root condition of the module's description, by its recursion.
#[test]
fn the_limit_with_a_wrong_model_is_that_of_the_recursion() {
    for error in [-MODEL_ERROR, MODEL_ERROR] {
        for periods in [1, 2, 5, 20, 50] {
            let damping = 0.99 * largest_damping(0.0);
            let mut rates = vec![1.0; periods + 1];
            for i in 0..20_000 {
                let now = rates[rates.len() - 1];
                rates.push((1.0 - damping * (1.0 + error)) * now + error * damping * rates[i]);
            }
            let last = rates[rates.len() - 100..].iter();
            let last = last.fold(0.0, |most: f64, rate| most.max(rate.abs()));
            assert!(last < 1e-2, "{error}, {periods} periods: {last}");
        }
    }
}

// Fails if the arm moves before the delay is known, or with a delay for which the loop is unstable.
#[test]
fn efforts_are_zero_until_the_delay_is_known_and_beyond_the_limit() {
    let mut plant = Plant::new(0.04, 1.0);
    let mut measuring = control_loop(true, 1.0);
    let (report, _) = plant.run(&mut measuring, 15);
    assert_eq!(report.delay, DelayStatus::Measuring);
    assert_eq!(report.mode, ControlMode::ZeroEfforts);
    assert_eq!(plant.fastest, 0.0);

    let refused = |delay: f64, gain: f64| {
        let mut plant = Plant::new(delay, 1.0);
        let (report, _) = plant.run(&mut control_loop(true, gain), 200);
        assert_eq!(plant.fastest, 0.0);
        assert_eq!(report.mode, ControlMode::ZeroEfforts);
        match report.delay {
            DelayStatus::Refused(error) => error,
            other => panic!("{other:?}"),
        }
    };
    let error = refused(0.6, 1.0);
    assert!(matches!(error, DelayError::TooLong { .. }), "{error}");
    let text = refused(0.04, 10.0).to_string();
    assert!(
        text.contains("efforts act 0.040 s after") && text.contains("stable up to 143 1/s"),
        "{text}"
    );
}

// Fails if delays that vary by more than the gains allow are accepted as known.
#[test]
fn a_delay_that_varies_is_refused() {
    let mut control_loop = control_loop(true, 1.0);
    let mut last = DelayStatus::Measuring;
    for k in 0..40 {
        let stamp = Stamp::from_secs_f64(PERIOD * f64::from(k));
        control_loop
            .add_joint_state(stamp, &START, &[0.0; 6])
            .unwrap();
        let delay = 0.02 + 0.01 * f64::from(k % 5);
        control_loop.add_command_delay(delay).unwrap();
        last = control_loop.step().unwrap().delay;
    }
    let DelayStatus::Refused(DelayError::Unstable { delay, spread, .. }) = last else {
        panic!("{last:?}");
    };
    assert!(
        (delay - 0.04).abs() < 1e-9 && (spread - 0.04).abs() < 1e-9,
        "{delay}, {spread}"
    );
    assert!(control_loop.add_command_delay(-1.0).is_err());
    assert!(control_loop.add_command_delay(f64::NAN).is_err());
}
