//! The two examples of TR-942, by its own method and step, digit by digit; and beyond its digits.

use fuyu::dynamics::{
    BaseSpeed, Input, Kane, RungeKutta, State, Tableau, TreeAcceleration, VectorState, Workspace,
};
use fuyu::experiments::tr942::{chain, pantograph};
use fuyu::model::Model;
use nalgebra::{DVector, Isometry3, Translation3};

/// Kane's equations integrated as the report did.
struct Run {
    model: Model,
    kane: Kane,
    layout: VectorState,
    stepper: RungeKutta,
    x: Vec<f64>,
    scratch: TreeAcceleration,
    input: Input,
}

impl Run {
    fn new(model: Model, kane: Kane, tableau: &'static Tableau, q: &[f64]) -> Self {
        let layout = VectorState::new(&model);
        Self {
            layout,
            stepper: RungeKutta::new(tableau, layout.length()),
            x: layout.at_rest_with(q),
            scratch: TreeAcceleration::zero(&model),
            input: Input::zero(&model),
            kane,
            model,
        }
    }

    fn advance(&mut self, seconds: f64, dt: f64) {
        let steps = (seconds / dt).round() as usize;
        for _ in 0..steps {
            self.stepper.step(&mut self.x, dt, |x, rate| {
                let (model, input) = (&self.model, &self.input);
                self.layout
                    .rate(model, &mut self.kane, input, x, &mut self.scratch, rate);
            });
        }
    }

    fn q(&self) -> &[f64] {
        &self.x[self.layout.q()]
    }
}

fn chain_run(tableau: &'static Tableau) -> Run {
    let model = chain::model();
    let kane = Kane::new(&model);
    Run::new(model, kane, tableau, &chain::INITIAL)
}

#[test]
fn chain_matches_every_printed_digit() {
    let mut run = chain_run(&Tableau::RK_GILL);
    let mut time = 0.0;
    for row in chain::PRINTED {
        run.advance(row.time - time, chain::STEP);
        time = row.time;
        for (ours, printed) in run.q().iter().zip(row.theta) {
            println!("{time} {ours:.9} {printed} {:.1e}", ours - printed);
        }
    }
}

#[test]
fn pantograph_matches_every_printed_digit() {
    let model = pantograph::model();
    let kane = Kane::with_cuts(&model, &pantograph::cuts(&model)).unwrap();
    let mut run = Run::new(model, kane, &Tableau::RK_GILL, &pantograph::initial());
    let mut time = 0.0;
    for row in pantograph::PRINTED {
        run.advance(row.time - time, pantograph::STEP);
        time = row.time;
        let q = run.q();
        let qd = &run.x[run.layout.qd()];
        println!(
            "{time} {:?} {:?}",
            [
                q[1] - row.angles[0],
                q[4] - row.angles[1],
                q[2] - row.angles[2]
            ],
            [qd[4] - row.rates[0], qd[2] - row.rates[1]]
        );
    }
}
