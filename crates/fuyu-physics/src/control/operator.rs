//! Simulated operator who steers the tip to a point by a camera image from the base.

use nalgebra::Vector3;
use std::collections::VecDeque;

/// Parameters of an operator.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OperatorConfig {
    /// Reaction time from an image to the command \[s\].
    pub reaction: f64,
    /// Time from one image to the next \[s\].
    pub image_period: f64,
    /// Command per distance along each axis of the image \[1/s\]: the crossover frequency in rad/s if the tip moves as
    /// commanded.
    pub gain: Vector3<f64>,
    /// Largest command along each axis, at full deflection of the joystick \[m/s\].
    pub full_speed: f64,
}

impl Default for OperatorConfig {
    /// A trained person: a reaction time of 0.25 s, images at 10 Hz, and a crossover frequency
    /// that leaves a phase margin of some 70 degrees; commands up to 0.5 m/s as in Masutani 1995 section 8.3.
    fn default() -> Self {
        Self {
            reaction: 0.25,
            image_period: 0.1,
            gain: Vector3::repeat(1.0),
            full_speed: 0.5,
        }
    }
}

/// Largest number of images for which memory is reserved; with a period of zero every command has an image.
const MOST_EXPECTED: f64 = 1e4;

/// An operator after the crossover model of manual control (McRuer): proportional with a delay, `k e^(-τs)`.
/// Deterministic.
#[derive(Debug, Clone)]
pub struct Operator {
    /// Parameters.
    pub config: OperatorConfig,
    /// Images within the reaction time: the times at which they were shown, and the displacement from tip to goal in
    /// them.
    images: VecDeque<(f64, Vector3<f64>)>,
    next_image: f64,
    /// Displacement in the image to which the operator reacts.
    displacement: Vector3<f64>,
}

impl Operator {
    /// An operator who has seen no image yet and commands zero.
    pub fn new(config: OperatorConfig) -> Self {
        // At most one image per period is within the reaction time.
        let capacity = (config.reaction / config.image_period)
            .ceil()
            .min(MOST_EXPECTED);
        Self {
            config,
            images: VecDeque::with_capacity(capacity as usize + 2),
            next_image: f64::NEG_INFINITY,
            displacement: Vector3::zeros(),
        }
    }

    /// The commanded velocity \[m/s\] at `time` \[s\], with the `displacement` from tip to goal \[m\]; axes of the image,
    /// which are the base's.
    pub fn command(&mut self, time: f64, displacement: &Vector3<f64>) -> Vector3<f64> {
        // Rounding of the times must not accumulate over the periods.
        const ROUNDING: f64 = 1e-9;
        let OperatorConfig {
            reaction,
            image_period,
            gain,
            full_speed,
        } = self.config;
        if time >= self.next_image - ROUNDING {
            self.next_image = self.next_image.max(time) + image_period;
            self.images.push_back((time, *displacement));
        }
        while let Some((shown, displacement)) = self.images.front() {
            if time < shown + reaction - ROUNDING {
                break;
            }
            self.displacement = *displacement;
            self.images.pop_front();
        }
        (self.displacement.component_mul(&gain)).map(|v| v.clamp(-full_speed, full_speed))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // Memory for infinitely many images cannot be reserved.
    #[test]
    fn every_command_may_have_an_image() {
        let mut operator = Operator::new(OperatorConfig {
            image_period: 0.0,
            ..OperatorConfig::default()
        });
        for i in 0..100 {
            let time = f64::from(i) * 0.01;
            let command = operator.command(time, &Vector3::new(time, 0.0, 0.0));
            let shown = (time - 0.25).clamp(0.0, 0.5);
            assert!((command.x - shown).abs() < 1e-9, "{time}: {command}");
        }
    }

    #[test]
    fn commands_follow_the_images_after_the_reaction_time() {
        let mut operator = Operator::new(OperatorConfig::default());
        let way = |t: f64| Vector3::new(0.2 + t, 0.0, 0.0);
        for i in 0..200 {
            let time = f64::from(i) * 0.01;
            let command = operator.command(time, &way(time));
            if time < 0.25 - 1e-6 {
                assert_eq!(command, Vector3::zeros());
                continue;
            }
            // The newest image that is at least 0.25 s old, at 10 Hz.
            let shown = ((time - 0.25 + 1e-6) * 10.0).floor() / 10.0;
            let expected = way(shown).map(|v| v.min(0.5));
            assert!((command - expected).norm() < 1e-9, "{time}: {command}");
        }
    }
}
