//! fuyu's programs for each kernel.

use std::hint::black_box;

use fuyu::control::{
    Controller, ControllerConfig, Gains, LawKind, Measurement, Saturation, TipMeasurement,
};
use fuyu::dynamics::{
    Formulation, FormulationKind, ForwardDynamics, Input, IntegrationMethod, Integrator, State,
    TreeAcceleration, TreeMotion, Workspace,
};
use fuyu::model::{Frame, Model};
use fuyu::spatial::Pose;
use nalgebra::{Matrix6xX, Rotation3, Translation3};

use super::robots::{Moving, Robot};

/// Step of the integrators \[s\], that of the peers.
pub const DT: f64 = 1e-3;

/// A way to compute a kernel.
pub trait Program {
    /// Computes it for a state.
    fn call(&mut self, state: &Moving);

    /// The result, in the same order as that of the peers.
    fn answer(&mut self, state: &Moving) -> Vec<f64>;

    /// Computes it for one state after the other, `calls` times or a few more; returns how often.
    fn calls(&mut self, states: &[Moving], calls: usize) -> usize {
        for state in states.iter().cycle().take(calls) {
            self.call(black_box(state));
        }
        calls
    }
}

/// Most joints for formulations that solve for the motion of all bodies at once: their cost is cubic.
const DENSE: usize = 30;

/// Every formulation of forward dynamics, by name.
pub fn forward(model: &Model) -> Vec<(&'static str, Box<dyn Program + '_>)> {
    let is_affordable = |kind: FormulationKind| match kind {
        FormulationKind::Kane | FormulationKind::NewtonEuler => model.dof() <= DENSE,
        FormulationKind::ArticulatedBody | FormulationKind::Reduced => true,
    };
    let affordable = FormulationKind::NAMES.into_iter();
    let affordable = affordable.filter(|(_, kind)| is_affordable(*kind));
    let formulations = affordable.map(|(name, kind)| {
        let program = Forward {
            dynamics: kind.prepare(model).expect("robots have masses"),
            answer: TreeAcceleration::zero(model),
        };
        (name, Box::new(program) as Box<dyn Program + '_>)
    });
    formulations.collect()
}

/// Generalized Jacobian of the tip; momentum map and base map come with it.
pub fn jacobian(robot: &Robot) -> Box<dyn Program + '_> {
    Box::new(Jacobian {
        tip: robot.model.frame(&robot.tip).expect("robots have tips"),
        workspace: Workspace::new(&robot.model),
        jacobian: Matrix6xX::zeros(robot.model.dof()),
    })
}

/// A step, one of many or one after which the workspace is read.
pub fn step(model: &Model, method: IntegrationMethod, is_read: bool) -> Box<dyn Program + '_> {
    Box::new(Step {
        is_read,
        integrator: Integrator::new(model, method),
        workspace: Workspace::new(model),
        state: State::at_rest(model),
    })
}

/// The reduced inertia from joint positions.
pub fn reduced_inertia(model: &Model) -> Box<dyn Program + '_> {
    Box::new(ReducedInertia {
        workspace: Workspace::new(model),
    })
}

/// Efforts of the transpose-Jacobian law for a measurement.
pub fn control_law(robot: &Robot) -> Box<dyn Program + '_> {
    let model = &robot.model;
    let gains = Gains {
        k_p: 75.0,
        k_o: 100.0,
        k_v: vec![10.0; model.dof()],
        saturation: Saturation {
            position: 0.2,
            orientation: 0.1,
        },
    };
    let tip = model.frame(&robot.tip).expect("robots have tips");
    let config = ControllerConfig::new(LawKind::TransposeJacobian, gains);
    let controller = Controller::new(model.clone(), tip.clone(), config);
    let goal = Translation3::new(1.0, 2.0, 0.5);
    Box::new(ControlLaw {
        controller: controller.expect("gains are positive"),
        sight: TipMeasurement::new(
            0.0,
            Workspace::new(model).X_BF(tip),
            Pose::from_parts(goal, Rotation3::identity()),
        ),
    })
}

struct Forward {
    dynamics: ForwardDynamics,
    answer: TreeAcceleration,
}

impl Program for Forward {
    fn call(&mut self, s: &Moving) {
        let motion = TreeMotion {
            R_WB: s.state.R_WB,
            V_WB_B: s.V_WB_B,
            q: s.state.q.as_slice(),
            qd: s.state.qd.as_slice(),
        };
        self.dynamics
            .accelerations(&motion, &s.input, &mut self.answer);
        black_box(&self.answer);
    }

    fn answer(&mut self, s: &Moving) -> Vec<f64> {
        self.call(s);
        let base = &self.answer.A_WB_B;
        let base = base.angular.iter().chain(&base.linear);
        base.chain(&self.answer.qdd).copied().collect()
    }
}

struct Jacobian<'a> {
    tip: &'a Frame,
    workspace: Workspace,
    jacobian: Matrix6xX<f64>,
}

impl Program for Jacobian<'_> {
    fn call(&mut self, s: &Moving) {
        self.workspace.set_positions(&s.state.q);
        self.workspace
            .generalized_jacobian(self.tip, &mut self.jacobian);
        black_box(&self.jacobian);
    }

    fn answer(&mut self, s: &Moving) -> Vec<f64> {
        self.call(s);
        self.jacobian.iter().copied().collect()
    }
}

struct Step {
    /// Whether the workspace is read after every step.
    is_read: bool,
    integrator: Integrator,
    workspace: Workspace,
    state: State,
}

impl Program for Step {
    fn call(&mut self, s: &Moving) {
        self.steps(s, 1);
    }

    fn answer(&mut self, s: &Moving) -> Vec<f64> {
        self.state.clone_from(&s.state);
        self.call(s);
        let after = self.state.q.iter().chain(&self.state.qd);
        after.copied().collect()
    }

    /// One step after the other, from the first state.
    fn calls(&mut self, states: &[Moving], calls: usize) -> usize {
        self.state.clone_from(&states[0].state);
        if self.is_read {
            for _ in 0..calls {
                self.steps(&states[0], 1);
            }
        } else {
            self.steps(&states[0], calls);
        }
        black_box(&self.state);
        calls
    }
}

impl Step {
    fn steps(&mut self, s: &Moving, count: usize) {
        let mut hold =
            |_: f64, _: &State, input: &mut Input| input.efforts.copy_from(&s.input.efforts);
        self.integrator
            .steps(&mut self.state, &mut self.workspace, DT, count, &mut hold);
    }
}

struct ReducedInertia {
    workspace: Workspace,
}

impl Program for ReducedInertia {
    fn call(&mut self, s: &Moving) {
        self.workspace.set_positions(&s.state.q);
        black_box(self.workspace.reduced_inertia());
    }

    fn answer(&mut self, s: &Moving) -> Vec<f64> {
        self.call(s);
        self.workspace.reduced_inertia().iter().copied().collect()
    }
}

struct ControlLaw {
    controller: Controller,
    sight: TipMeasurement,
}

impl Program for ControlLaw {
    fn call(&mut self, s: &Moving) {
        let seen = Measurement::new(0.0, &s.state.q, &s.state.qd);
        let report = (self.controller).update(&seen.with_tip(Some(&self.sight)));
        black_box(report.is_ok());
        black_box(self.controller.efforts());
    }

    fn answer(&mut self, s: &Moving) -> Vec<f64> {
        self.call(s);
        self.controller.efforts().iter().copied().collect()
    }
}
