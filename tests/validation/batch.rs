//! A batch moves every state exactly as it moves alone.

use fuyu::control::{
    Controller, ControllerConfig, Gains, LawKind, Measurement, Saturation, TipMeasurement,
};
use fuyu::dynamics::{
    Batch, Floating, Input, IntegrationMethod, Integrator, State, Tableau, Workspace,
};
use fuyu::model::{Frame, Model};
use fuyu::spatial::Pose;
use nalgebra::{DVector, UnitQuaternion};

use crate::fixtures::servicer;
use crate::formulations::Draw;

/// No number of lanes divides this.
const COUNT: usize = 37;

/// A random tree with branches, springs and dampers, and states of it with their efforts. Some states spin so fast that
/// a step leaves the range of the series for small rotations.
fn random_states() -> (Model, Vec<(State, DVector<f64>)>) {
    let mut draw = Draw::new(37);
    let model = draw.tree(12);
    let states = (0..COUNT).map(|index| {
        let motion = draw.motion(&model);
        let mut state = State::at_rest_with(&model, &DVector::from_row_slice(&motion.q));
        state.qd = DVector::from_row_slice(&motion.qd);
        state.R_WB = UnitQuaternion::new(draw.vector(2.0));
        state.momentum_W.linear = draw.vector(20.0);
        state.momentum_W.angular = draw.vector(if index % 5 == 0 { 1e5 } else { 20.0 });
        (state, motion.input.efforts)
    });
    let states = states.collect();
    (model, states)
}

fn batch_of(model: &Model, tableau: &'static Tableau, states: &[(State, DVector<f64>)]) -> Batch {
    let mut batch = Batch::with_tableau(model, tableau, states.len());
    for (index, (state, efforts)) in states.iter().enumerate() {
        batch.set_state(index, state);
        batch.hold_efforts(index, efforts.as_slice());
    }
    batch
}

fn bits(state: &State) -> Vec<u64> {
    let m = &state.momentum_W;
    let numbers = [state.time, state.work]
        .into_iter()
        .chain(state.R_WB.coords.iter().copied())
        .chain(state.p_WC.iter().copied())
        .chain(m.linear.iter().chain(m.angular.iter()).copied())
        .chain(state.q.iter().chain(state.qd.iter()).copied());
    numbers.map(f64::to_bits).collect()
}

#[track_caller]
fn assert_same_bits(index: usize, together: &State, alone: &State) {
    assert!(alone.is_finite());
    assert_eq!(
        bits(together),
        bits(alone),
        "state {index}: {together:?} {alone:?}"
    );
}

/// All methods, held efforts. Fails if one operation in the lanes is rounded differently or comes in another order.
#[test]
fn held_efforts_give_the_bits_of_single_runs_with_every_method() {
    let (model, states) = random_states();
    for (_, method) in IntegrationMethod::NAMES {
        let mut batch = batch_of(&model, method.tableau(), &states);
        batch.accelerate();
        batch.step(1e-3, 20);
        batch.step(1e-3, 1);
        for (index, (state, efforts)) in states.iter().enumerate() {
            let mut robot = Floating::new(model.clone(), state.clone(), method);
            robot.hold_efforts(efforts.as_slice());
            let qdd = robot.accelerations();
            for j in 0..model.dof() {
                assert_eq!(batch.qdd(index, j).to_bits(), qdd[j].to_bits());
            }
            robot.step(1e-3, 21);
            assert_same_bits(index, &batch.state(index), robot.state());
        }
    }
}

/// Efforts from time and state at every stage, with memory of their own.
#[test]
fn efforts_of_time_and_state_give_the_bits_of_single_runs_with_every_tableau() {
    let (model, states) = random_states();
    let forcing = |calls: &mut f64, state: &State, efforts: &mut [f64]| {
        *calls += 1.0;
        for (j, effort) in efforts.iter_mut().enumerate() {
            *effort += 0.1 * (30.0 * state.time + *calls).sin() - 0.2 * state.qd[j];
        }
        efforts[0] += state.p_WC.x + state.R_WB.i + 1e-3 * state.work + state.q[0];
    };
    for tableau in [&Tableau::RK4, &Tableau::RK_GILL, &Tableau::DOP8] {
        let mut batch = batch_of(&model, tableau, &states);
        let mut calls = vec![0.0; COUNT];
        batch.step_with(1e-3, 7, &mut calls, forcing);
        let mut workspace = Workspace::new(&model);
        for (index, (state, efforts)) in states.iter().enumerate() {
            let (mut state, mut calls_alone, mut first) = (state.clone(), 0.0, true);
            let mut alone = |_: f64, state: &State, input: &mut Input| {
                if std::mem::take(&mut first) {
                    input.efforts.copy_from(efforts);
                }
                forcing(&mut calls_alone, state, input.efforts.as_mut_slice());
            };
            let mut integrator = Integrator::with_tableau(&model, tableau);
            integrator.steps(&mut state, &mut workspace, 1e-3, 7, &mut alone);
            assert_same_bits(index, &batch.state(index), &state);
            assert_eq!(calls[index], calls_alone);
        }
    }
}

/// A controller of the library with what it needs to measure.
struct Loop {
    controller: Controller,
    workspace: Workspace,
    tip: Frame,
    X_WD: Pose,
}

impl Loop {
    fn new(model: &Model, index: usize) -> Self {
        let tip = model.frame("tool0").unwrap().clone();
        let gains = Gains {
            k_p: 75.0,
            k_o: 100.0,
            k_v: vec![400.0, 100.0, 200.0, 10.0, 2.0, 2.0],
            saturation: Saturation {
                position: 0.2,
                orientation: 0.1,
            },
        };
        let config = ControllerConfig::new(LawKind::TransposeJacobian, gains);
        let mut workspace = Workspace::new(model);
        let start = start(model, index);
        workspace.set_positions(&start.q);
        let mut X_WD = start.X_WB(&workspace) * workspace.X_BF(&tip);
        X_WD.translation.vector.x -= 0.3;
        Self {
            controller: Controller::new(model.clone(), tip.clone(), config).unwrap(),
            workspace,
            tip,
            X_WD,
        }
    }

    fn update(&mut self, state: &State, efforts: &mut [f64]) {
        self.workspace.set_positions(&state.q);
        let X_BE = self.workspace.X_BF(&self.tip);
        let X_BD = state.X_WB(&self.workspace).inverse() * self.X_WD;
        let tip = TipMeasurement::new(state.time, X_BE, X_BD);
        let measurement = Measurement::new(state.time, &state.q, &state.qd);
        let measurement = measurement.with_tip(Some(&tip));
        self.controller.update(&measurement).unwrap();
        efforts.copy_from_slice(self.controller.efforts().as_slice());
    }
}

fn start(model: &Model, index: usize) -> State {
    let q = DVector::from_fn(6, |j, _| 0.4 + 0.1 * ((3 * index + j) as f64).sin());
    State::at_rest_with(model, &q)
}

/// 0.5 s of a sampled control loop, for every state its own controller.
#[test]
fn closed_loops_give_the_bits_of_single_runs_with_every_method() {
    let model = servicer();
    for (_, method) in IntegrationMethod::NAMES {
        let mut batch = Batch::new(&model, method, 11);
        (0..11).for_each(|index| batch.set_state(index, &start(&model, index)));
        let mut loops: Vec<Loop> = (0..11).map(|index| Loop::new(&model, index)).collect();
        for _ in 0..50 {
            batch.control(&mut loops, Loop::update);
            batch.step(0.005, 2);
        }
        for index in 0..batch.len() {
            let mut robot = Floating::new(model.clone(), start(&model, index), method);
            let mut own = Loop::new(&model, index);
            let mut efforts = [0.0; 6];
            for _ in 0..50 {
                own.update(robot.state(), &mut efforts);
                robot.hold_efforts(&efforts);
                robot.step(0.005, 2);
            }
            assert!(robot.state().qd.amax() > 1e-4, "the arm moves");
            assert_same_bits(index, &batch.state(index), robot.state());
        }
    }
}

#[test]
fn the_number_of_threads_does_not_change_a_bit() {
    let (model, states) = random_states();
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        let mut batch = batch_of(&model, &Tableau::RK4, &states);
        pool.build().unwrap().install(|| batch.step(1e-3, 20));
        let after = (0..COUNT).map(|index| bits(&batch.state(index)));
        after.collect::<Vec<_>>()
    };
    assert_eq!(run(1), run(3));
}

/// Held efforts are clamped to the limits of the joints, as those of a single robot are.
#[test]
fn effort_limits_are_those_of_single_runs() {
    let model = servicer();
    let efforts = [1e9, -1e9, 1e9, -1e9, 1e9, 1.0];
    let mut batch = Batch::new(&model, IntegrationMethod::Rk4, 1);
    batch.hold_efforts(0, &efforts);
    let state = State::at_rest(&model);
    let mut robot = Floating::new(model, state, IntegrationMethod::Rk4);
    robot.hold_efforts(&efforts);
    batch.step(1e-4, 1);
    robot.step(1e-4, 1);
    assert_same_bits(0, &batch.state(0), robot.state());
}
