//! Times of programs that run alternately, so that other load on the machine affects all alike.

use std::time::{Duration, Instant};

use super::ours::Program;
use super::peer::Peer;
use super::robots::Moving;

/// Rounds in which every program has its turn ...
const ROUNDS: usize = 201;
/// ... of this length: shorter than a scheduler's slice ...
const TURN: Duration = Duration::from_millis(1);
/// ... but a program that is so slow that all its turns would take longer than this has only the first ones.
const PATIENCE: Duration = Duration::from_secs(1);
const FEWEST_ROUNDS: usize = 5;

/// What takes a turn.
pub enum Runner<'a> {
    Ours(Box<dyn Program + 'a>),
    Peer {
        peer: &'a Peer,
        kernel: &'static str,
    },
}

impl Runner<'_> {
    /// Nanoseconds a call.
    fn time(&mut self, states: &[Moving], calls: usize) -> f64 {
        match self {
            Self::Ours(program) => {
                let start = Instant::now();
                let calls = program.calls(states, calls);
                start.elapsed().as_nanos() as f64 / calls as f64
            }
            Self::Peer { peer, kernel } => peer.time(kernel, calls),
        }
    }

    /// The result for the state with this index.
    pub fn answer(&mut self, states: &[Moving], index: usize) -> Vec<f64> {
        match self {
            Self::Ours(program) => program.answer(&states[index]),
            Self::Peer { peer, kernel } => peer.ask(kernel, index),
        }
    }
}

/// A program's nanoseconds a call, round by round.
pub struct Times(Vec<f64>);

impl Times {
    pub fn median(&self) -> f64 {
        quartiles(self.0.clone())[1]
    }

    /// Quartiles of the rounds' ratios of this to another.
    pub fn over(&self, other: &Self) -> [f64; 3] {
        quartiles(self.0.iter().zip(&other.0).map(|(a, b)| a / b).collect())
    }
}

fn quartiles(mut values: Vec<f64>) -> [f64; 3] {
    values.sort_by(f64::total_cmp);
    [1, 2, 3].map(|k| values[(values.len() - 1) * k / 4])
}

/// Times of all runners, round by round.
pub fn measure(runners: &mut [Runner], states: &[Moving]) -> Vec<Times> {
    // Calls in a turn, and turns.
    let plan: Vec<_> = runners
        .iter_mut()
        .map(|runner| {
            let turn = TURN.as_nanos() as f64;
            // The first calls allocate and warm caches.
            let once = runner.time(states, 1).min(runner.time(states, 2));
            let call = runner.time(states, (turn / once / 10.0).max(1.0) as usize);
            let calls = (turn / call).max(1.0);
            let affordable = (PATIENCE.as_nanos() as f64 / (calls * call)) as usize;
            (calls as usize, affordable.clamp(FEWEST_ROUNDS, ROUNDS))
        })
        .collect();
    let mut times: Vec<_> = runners.iter().map(|_| Times(Vec::new())).collect();
    for round in 0..ROUNDS {
        for i in 0..runners.len() {
            // In alternating order, so that no program always follows the same one.
            let i = match round % 2 {
                0 => i,
                _ => runners.len() - 1 - i,
            };
            let (calls, rounds) = plan[i];
            if round < rounds {
                times[i].0.push(runners[i].time(states, calls));
            }
        }
    }
    times
}
