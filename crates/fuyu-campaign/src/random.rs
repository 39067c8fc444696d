//! Random numbers as a pure function of a seed, a name and a number.

/// The increment of SplitMix64: 2^64 divided by the golden ratio, made odd.
const GOLDEN: u64 = 0x9E37_79B9_7F4A_7C15;

/// A bijection of 64-bit numbers that maps similar numbers to dissimilar ones: the output function of SplitMix64 (Steele,
/// Lea and Flood 2014, "Fast splittable pseudorandom number generators", with Stafford's variant 13 of the constants).
pub fn mix(number: u64) -> u64 {
    let mut z = number;
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

/// A hash of a text: FNV-1a (RFC 9923), 64 bits.
pub fn text_hash(text: &str) -> u64 {
    text.bytes().fold(0xCBF2_9CE4_8422_2325, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01B3)
    })
}

/// The number at place `index` of the SplitMix64 sequence of a seed.
pub(crate) fn at(seed: u64, index: u64) -> u64 {
    mix(seed.wrapping_add(index.wrapping_add(1).wrapping_mul(GOLDEN)))
}

/// The seed of the sequence of a name: sequences of different names and seeds are independent.
pub(crate) fn stream(seed: u64, name: u64) -> u64 {
    at(mix(seed ^ GOLDEN), mix(name))
}

/// A seed for what is called `name` in run `run` of a campaign with the seed `seed`: below 2^53, so that every program
/// reads it exactly.
pub fn seed_of(seed: u64, run: u64, name: &str) -> u64 {
    at(stream(seed, text_hash(name)), run) >> 11
}

/// The centre of one of 2^52 equal parts of the unit interval, exactly: never 0 or 1.
pub(crate) fn unit(bits: u64) -> f64 {
    ((bits >> 12) as f64 + 0.5) * (1.0 / (1u64 << 52) as f64)
}

/// `index` under a random permutation of `0..count`: a Feistel network over the next power of four, walked along its cycle
/// until the result is below `count` (Black and Rogaway 2002, "Ciphers with arbitrary finite domains", section 4). Needs
/// no memory.
pub(crate) fn permute(index: u64, count: u64, key: u64) -> u64 {
    debug_assert!(index < count);
    let bits = 64 - count.saturating_sub(1).leading_zeros();
    let half = bits.div_ceil(2).max(1);
    let mask = (1u64 << half) - 1;
    let mut place = index;
    loop {
        let (mut left, mut right) = (place >> half, place & mask);
        for round in 0..12 {
            let turned = at(key ^ (round << 56), right) & mask;
            (left, right) = (right, left ^ turned);
        }
        place = (left << half) | right;
        if place < count {
            return place;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // The first outputs of the reference implementation (prng.di.unimi.it/splitmix64.c) for the seed 1234567.
    #[test]
    fn the_sequence_is_that_of_splitmix64() {
        let reference = [
            6_457_827_717_110_365_317,
            3_203_168_211_198_807_973,
            9_817_491_932_198_370_423,
        ];
        for (i, expected) in reference.into_iter().enumerate() {
            assert_eq!(at(1_234_567, i as u64), expected);
        }
    }

    #[test]
    fn the_ends_of_the_unit_interval_are_never_drawn() {
        assert!(unit(0) > 0.0 && unit(u64::MAX) < 1.0);
    }

    #[test]
    fn a_permutation_is_one() {
        for count in [1, 2, 3, 5, 16, 17, 100, 1000] {
            let mut seen = vec![false; count as usize];
            for i in 0..count {
                seen[permute(i, count, 99) as usize] = true;
            }
            assert!(seen.into_iter().all(|s| s), "{count}");
        }
    }

    // Every place is equally likely for the first number: chi-square with 9 degrees of freedom, 99.99 % quantile 33.7.
    #[test]
    fn permutations_are_unbiased() {
        let keys = 20_000;
        let mut counts = [0u32; 10];
        for key in 0..keys {
            counts[permute(0, 10, mix(key)) as usize] += 1;
        }
        let expected = keys as f64 / 10.0;
        let terms = counts
            .iter()
            .map(|&n| (f64::from(n) - expected).powi(2) / expected);
        assert!(terms.sum::<f64>() < 33.7, "{counts:?}");
    }
}
