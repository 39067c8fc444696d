//! Times of programs that take turns, so that what else the machine does hits all alike.

use std::time::{Duration, Instant};

use super::ours::Program;
use super::peer::Peer;
use super::robots::Moving;

/// Rounds in which every program has its turn ...
const ROUNDS: usize = 201;
/// ... of this length: shorter than a scheduler's slice ...
const TURN: Duration = Duration::from_millis(1);
/// ... unless programs are so slow that all of it would take longer than this.
const PATIENCE: Duration = Duration::from_secs(8);
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
                program.calls(states, calls);
                start.elapsed().as_nanos() as f64 / calls as f64
            }
            Self::Peer { peer, kernel } => peer.time(kernel, calls),
        }
    }

    /// What it computes for the state with this index.
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
    let turns: Vec<_> = runners
        .iter_mut()
        .map(|runner| {
            // The first calls take memory and warm caches.
            let once = runner.time(states, 1).min(runner.time(states, 2));
            let few = ((TURN.as_nanos() as f64 / once) as usize / 10).max(1);
            let call = runner.time(states, few);
            let calls = ((TURN.as_nanos() as f64 / call) as usize).max(1);
            (calls, calls as f64 * call)
        })
        .collect();
    let round: f64 = turns.iter().map(|(_, took)| took).sum();
    let affordable = (PATIENCE.as_nanos() as f64 / round) as usize;
    let rounds = affordable.clamp(FEWEST_ROUNDS, ROUNDS);
    let mut times: Vec<_> = runners.iter().map(|_| Times(Vec::new())).collect();
    for round in 0..rounds {
        for i in 0..runners.len() {
            // There and back, so that nobody always follows the same one.
            let i = match round % 2 {
                0 => i,
                _ => runners.len() - 1 - i,
            };
            times[i].0.push(runners[i].time(states, turns[i].0));
        }
    }
    times
}
