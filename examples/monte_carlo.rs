//! Monte Carlo: how far do small unknown efforts turn the base in a minute?
//!
//! `cargo run --release --example monte_carlo`. A thousand copies of the servicer start at rest, each under its own
//! constant joint efforts, drawn at random. `Batch` steps all of them at once, several per instruction and on all
//! processors; each comes out as if it had been simulated alone.

use std::error::Error;

use fuyu::dynamics::{Batch, State};
use fuyu::model::Model;
use nalgebra::DVector;
use rand::{RngExt, SeedableRng, rngs::StdRng};

const COPIES: usize = 1000;
/// Standing for friction that no model has [N m].
const LARGEST_EFFORT: f64 = 1e-3;
/// Step of the integrator [s].
const TIME_STEP: f64 = 0.05;
const SECONDS: f64 = 60.0;

fn main() -> Result<(), Box<dyn Error>> {
    let model = Model::from_urdf(include_str!("../urdf/servicer.urdf"), "servicer.urdf")?;
    let mut random = StdRng::seed_from_u64(1);
    let q = DVector::from_element(model.dof(), 0.5);
    let start = State::at_rest_with(&model, &q);

    let mut batch = Batch::new(&model, COPIES);
    for copy in 0..COPIES {
        let efforts: Vec<f64> = (0..model.dof())
            .map(|_| random.random_range(-LARGEST_EFFORT..LARGEST_EFFORT))
            .collect();
        batch.set_state(copy, &start);
        batch.hold_efforts(copy, &efforts);
    }
    batch.step(TIME_STEP, (SECONDS / TIME_STEP).round() as usize);

    let mut turns: Vec<f64> = (0..COPIES)
        .map(|copy| batch.state(copy).R_WB.angle_to(&start.R_WB).to_degrees())
        .collect();
    turns.sort_by(f64::total_cmp);
    println!("base attitude after {SECONDS} s, {COPIES} runs:");
    for percent in [5, 50, 95] {
        let turn = turns[percent * (COPIES - 1) / 100];
        println!("  {percent:2} % turn by less than {turn:.3} deg");
    }
    Ok(())
}
