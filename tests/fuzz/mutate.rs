//! Mutations of inputs.

use rand::rngs::StdRng;
use rand::{Rng, RngExt};

/// Values at which sizes and counts go wrong.
const EDGES: [u64; 12] = [
    0,
    1,
    0x7f,
    0xff,
    0x7fff,
    0xffff,
    0x00ff_ffff,
    0x7fff_ffff,
    0xffff_ffff,
    0x7fff_ffff_ffff_ffff,
    0xffff_ffff_ffff_fff0,
    u64::MAX,
];

/// Largest input [bytes].
const LARGEST: usize = 1 << 18;

/// A few random changes of one of the inputs of a corpus.
pub fn mutated(corpus: &[Vec<u8>], words: &[&str], rng: &mut StdRng) -> Vec<u8> {
    let mut input = corpus[rng.random_range(0..corpus.len())].clone();
    for _ in 0..rng.random_range(1..6) {
        change(&mut input, corpus, words, rng);
    }
    input.truncate(LARGEST);
    input
}

fn change(input: &mut Vec<u8>, corpus: &[Vec<u8>], words: &[&str], rng: &mut StdRng) {
    if input.is_empty() {
        input.push(0);
    }
    let at = rng.random_range(0..input.len());
    let span = |rng: &mut StdRng| at..(at + 1 + rng.random_range(0..64)).min(input.len());
    match rng.random_range(0..10) {
        0 => input[at] ^= 1 << rng.random_range(0..8),
        1 => input[at] = rng.random(),
        2 => {
            let span = span(rng);
            input.drain(span);
        }
        3 => {
            let mut copy = input[span(rng)].to_vec();
            let many = match rng.random_range(0..8) {
                0 => rng.random_range(0..500),
                _ => 1,
            };
            copy = copy.repeat(many);
            input.splice(at..at, copy);
        }
        4 => {
            let other = &corpus[rng.random_range(0..corpus.len())];
            let from = rng.random_range(0..=other.len());
            let to = (from + rng.random_range(0..256)).min(other.len());
            input.splice(at..at, other[from..to].iter().copied());
        }
        5 | 6 => {
            let edge = EDGES[rng.random_range(0..EDGES.len())].to_le_bytes();
            let size = [1, 2, 4, 8][rng.random_range(0..4)];
            for (byte, value) in input[at..].iter_mut().zip(&edge[..size]) {
                *byte = *value;
            }
        }
        7 if !words.is_empty() => {
            let word = words[rng.random_range(0..words.len())].bytes();
            let end = match rng.random() {
                true => at,
                false => span(rng).end,
            };
            input.splice(at..end, word);
        }
        8 => input.truncate(at),
        _ => {
            let mut noise = vec![0; rng.random_range(1..16)];
            rng.fill_bytes(&mut noise);
            input.splice(at..at, noise);
        }
    }
}
