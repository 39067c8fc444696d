//! Sobol points with Owen's scrambling.

use std::sync::OnceLock;

use crate::{
    SamplingError,
    random::{at, mix},
    refuse,
};

/// Primitive polynomials and initial direction numbers, a line per dimension from the second one: degree `s`, coefficients `a`,
/// `m_1 ... m_s`. From S. Joe and F. Y. Kuo 2008, "Constructing Sobol sequences with better two-dimensional projections",
/// SIAM J. Sci. Comput. 30, 2635-2654, file new-joe-kuo-6.
const TABLE: &str = include_str!("joe_kuo.txt");

/// Bits of a point: number of points after which the sequence ends, as a logarithm.
const BITS: u32 = 32;

/// Dimensions that the table has.
pub const MOST_DIMENSIONS: usize = 100;

/// Direction numbers `v_1 ... v_32` of each dimension, as binary fractions.
fn directions() -> &'static [[u32; BITS as usize]] {
    static DIRECTIONS: OnceLock<Vec<[u32; BITS as usize]>> = OnceLock::new();
    DIRECTIONS.get_or_init(|| {
        // The first dimension: the van der Corput sequence.
        let mut all = vec![std::array::from_fn(|k| 1 << (BITS - 1 - k as u32))];
        all.extend(TABLE.lines().map(direction_numbers));
        all
    })
}

/// Eqs. (2) and (3) of the article.
fn direction_numbers(line: &str) -> [u32; BITS as usize] {
    let numbers = line.split_whitespace().filter_map(|word| word.parse().ok());
    let numbers: Vec<u32> = numbers.collect();
    let (s, a, m) = (numbers[0] as usize, numbers[1], &numbers[2..]);
    let mut v = [0; BITS as usize];
    for k in 0..BITS as usize {
        v[k] = if k < s {
            m[k] << (BITS - 1 - k as u32)
        } else {
            let mut value = v[k - s] ^ (v[k - s] >> s);
            for j in 1..s {
                value ^= ((a >> (s - 1 - j)) & 1) * v[k - j];
            }
            value
        };
    }
    v
}

/// Number of points of the sequence.
pub(crate) const POINTS: u64 = 1 << BITS;

pub(crate) fn check(dimensions: usize) -> Result<(), SamplingError> {
    if dimensions > MOST_DIMENSIONS {
        return refuse(format!(
            "Sobol points have at most {MOST_DIMENSIONS} dimensions here, but {dimensions} numbers are drawn per run; use latin_hypercube or random"
        ));
    }
    Ok(())
}

/// Coordinate `dimension` of point `index`, as 32 bits after the binary point. The points are in the order of their
/// definition; that of the Gray code has the same points in each block of 2^k.
pub(crate) fn point(index: u64, dimension: usize) -> u32 {
    let v = &directions()[dimension];
    let bits = (0..BITS as usize).filter(|k| (index >> k) & 1 == 1);
    bits.fold(0, |sum, k| sum ^ v[k])
}

/// Owen's nested uniform scrambling (A. B. Owen 1995, "Randomly permuted (t,m,s)-nets and (t,s)-sequences"): each bit is flipped
/// or not, at random, by a choice that belongs to all bits above it. Returns 64 random bits that begin with the scrambled
/// ones.
pub(crate) fn scramble(x: u32, key: u64) -> u64 {
    let mut scrambled = 0u64;
    for bit in 0..BITS {
        // The bits above, with a leading one that tells prefixes of different length apart.
        let above = (1u64 << bit) | (u64::from(x) >> (BITS - bit));
        let flip = (at(key, above) >> 63) as u32;
        let value = ((x >> (BITS - 1 - bit)) & 1) ^ flip;
        scrambled |= u64::from(value) << (63 - bit);
    }
    // Bits below those of the sequence are random.
    scrambled | (mix(at(!key, u64::from(x))) >> BITS)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_is_whole() {
        assert_eq!(directions().len(), MOST_DIMENSIONS);
        for v in directions() {
            // Odd initial numbers: each direction number has its own lowest bit.
            for (k, v) in v.iter().enumerate() {
                assert_eq!(v.trailing_zeros(), BITS - 1 - k as u32);
            }
        }
    }

    // scipy.stats.qmc.Sobol(4, scramble=False).random(16), SciPy 1.14, as a set: it goes through them in Gray code.
    #[test]
    fn the_first_points_are_those_of_scipy() {
        let mut ours: Vec<[f64; 4]> = (0..8)
            .map(|i| std::array::from_fn(|d| f64::from(point(i, d)) / 2f64.powi(32)))
            .collect();
        let mut scipys = [
            [0.0, 0.0, 0.0, 0.0],
            [0.5, 0.5, 0.5, 0.5],
            [0.75, 0.25, 0.25, 0.25],
            [0.25, 0.75, 0.75, 0.75],
            [0.375, 0.375, 0.625, 0.875],
            [0.875, 0.875, 0.125, 0.375],
            [0.625, 0.125, 0.875, 0.625],
            [0.125, 0.625, 0.375, 0.125],
        ];
        ours.sort_by(|a, b| a.partial_cmp(b).unwrap());
        scipys.sort_by(|a, b| a.partial_cmp(b).unwrap());
        assert_eq!(ours, scipys);
    }

    // A scrambled (0, m, 1)-net in each dimension: one point in each of 2^k equal parts.
    #[test]
    fn every_dimension_is_stratified_after_scrambling() {
        for dimension in [0, 1, 17, 99] {
            let mut hit = vec![false; 256];
            for i in 256..512 {
                let x = scramble(point(i, dimension), mix(dimension as u64));
                hit[(x >> 56) as usize] = true;
            }
            assert!(hit.into_iter().all(|h| h), "{dimension}");
        }
    }

    // The first two dimensions are a (0, m, 2)-net: one point in every elementary rectangle of area 2^-8.
    #[test]
    fn elementary_rectangles_have_one_point_each() {
        for (a, b) in [(4, 4), (2, 6), (7, 1)] {
            let mut hit = vec![false; 256];
            for i in 0..256 {
                let x = scramble(point(i, 0), 5) >> (64 - a);
                let y = scramble(point(i, 1), 6) >> (64 - b);
                hit[((x << b) | y) as usize] = true;
            }
            assert!(hit.into_iter().all(|h| h), "{a} {b}");
        }
    }
}
