//! Image sensor: from radiance to numbers, with noise.

use rand::{RngExt, SeedableRng, rngs::Xoshiro256PlusPlus};
use rand_distr::{Distribution, Poisson, StandardNormal};
use rayon::prelude::*;

use crate::{Frame, to_srgb};

/// How electrons become numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Transfer {
    /// In proportion, as cameras for measurement do.
    Linear,
    /// Coded as sRGB (IEC 61966-2-1), for people to look at.
    Srgb,
}

/// An image sensor.
///
/// A pixel collects `sensitivity * exposure * radiance` electrons on average; their number is Poisson distributed (shot
/// noise). It holds at most `full_well` electrons; reading it out adds noise that is normally distributed. 255 is
/// a full well.
#[derive(Debug, Clone, PartialEq)]
pub struct Sensor {
    /// Exposure \[s\].
    pub exposure: f64,
    /// Electrons per second in a pixel that sees a white surface in full sunlight at normal incidence.
    pub sensitivity: f64,
    /// Most electrons that a pixel holds.
    pub full_well: f64,
    /// Whether the number of electrons is random.
    pub shot_noise: bool,
    /// Standard deviation of the read noise \[electrons\].
    pub read_noise: f64,
    /// From electrons to numbers.
    pub transfer: Transfer,
    /// Seed of the noise.
    pub seed: u64,
}

impl Default for Sensor {
    /// 1 ms, in which a white surface in full sunlight nearly fills the wells.
    fn default() -> Self {
        Self {
            exposure: 1e-3,
            sensitivity: 1e7,
            full_well: 12_000.0,
            shot_noise: true,
            read_noise: 10.0,
            transfer: Transfer::Linear,
            seed: 1,
        }
    }
}

/// Electrons above which a Poisson distribution is taken as normal: skewness 0.1.
const MANY: f64 = 100.0;

impl Sensor {
    /// Grey values, row by row. Frames with different numbers have independent noise.
    pub fn mono8(&self, frame: &Frame, number: u64) -> Vec<u8> {
        // Luminance (Rec. ITU-R BT.709).
        let grey = |c: &[f32; 3]| [0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2]];
        self.expose(frame, number, grey)
    }

    /// Red, green and blue values, row by row.
    pub fn rgb8(&self, frame: &Frame, number: u64) -> Vec<u8> {
        self.expose(frame, number, |c| *c)
    }

    fn expose<const N: usize>(
        &self,
        frame: &Frame,
        number: u64,
        channels: impl Fn(&[f32; 3]) -> [f32; N] + Sync,
    ) -> Vec<u8> {
        let mut values = vec![0; N * frame.radiance.len()];
        let codes = self.codes();
        let rows = values.par_chunks_mut(N * frame.width).enumerate();
        rows.for_each(|(row, values)| {
            // A generator for each row, so that threads do not matter.
            let mut random =
                Xoshiro256PlusPlus::seed_from_u64(mixed(self.seed, number, row as u64));
            let radiance = &frame.radiance[row * frame.width..][..frame.width];
            for (values, radiance) in values.chunks_exact_mut(N).zip(radiance) {
                for (value, radiance) in values.iter_mut().zip(channels(radiance)) {
                    let electrons = self.electrons(f64::from(radiance), &mut random);
                    let level = electrons / self.full_well * 255.0;
                    *value = codes[(level * 16.0).clamp(0.0, 255.0 * 16.0) as usize];
                }
            }
        });
        values
    }

    /// The electrons that are read out.
    fn electrons(&self, radiance: f64, random: &mut Xoshiro256PlusPlus) -> f64 {
        let mean = self.sensitivity * self.exposure * radiance;
        // Also if it is not a number.
        let mean = if mean > 0.0 { mean.min(1e12) } else { 0.0 };
        let collected = if !self.shot_noise || mean <= 0.0 {
            mean
        } else if mean > MANY {
            let noise: f64 = random.sample(StandardNormal);
            (mean + mean.sqrt() * noise).max(0.0)
        } else {
            // The mean is positive and finite.
            Poisson::new(mean).map_or(mean, |poisson| poisson.sample(random))
        };
        let full = collected.min(self.full_well);
        if self.read_noise > 0.0 {
            let noise: f64 = random.sample(StandardNormal);
            full + self.read_noise * noise
        } else {
            full
        }
    }

    /// The value for each sixteenth of a level.
    fn codes(&self) -> Vec<u8> {
        let codes = (0..=255 * 16).map(|i| {
            // In the middle of the sixteenth, so that rounding has no bias.
            let level = ((f64::from(i) + 0.5) / 16.0).min(255.0);
            match self.transfer {
                Transfer::Linear => level.round() as u8,
                Transfer::Srgb => (to_srgb((level / 255.0) as f32) * 255.0).round() as u8,
            }
        });
        codes.collect()
    }
}

/// A seed from three numbers (finalizer of SplitMix64).
fn mixed(seed: u64, number: u64, row: u64) -> u64 {
    let mut h: u64 = 0;
    // The seed on its own first: added to the number, seed 2 would give the frames of seed 1 one number later.
    for part in [seed, number, row] {
        h = h.wrapping_add(part).wrapping_add(0x9e37_79b9_7f4a_7c15);
        h = (h ^ (h >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        h = (h ^ (h >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        h ^= h >> 31;
    }
    h
}
