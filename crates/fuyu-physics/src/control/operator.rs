//! A simulated operator: somebody who steers the tip to a point by a picture from the base.

use nalgebra::Vector3;
use std::collections::VecDeque;

/// What an operator is like.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OperatorConfig {
    /// Time from a picture to the hand \[s\].
    pub reaction: f64,
    /// Time from one picture to the next \[s\].
    pub picture_period: f64,
    /// Command per distance along each axis of the picture \[1/s\]: with a tip that moves as commanded, the crossover
    /// frequency in rad/s.
    pub gain: Vector3<f64>,
    /// Command of a joystick's axis that is pushed all the way \[m/s\].
    pub full_speed: f64,
}

impl Default for OperatorConfig {
    /// A person who has got used to the task: a reaction time of 0.25 s, pictures at 10 Hz, and a crossover frequency
    /// that leaves a phase margin of some 70 degrees; commands up to 0.5 m/s as in Masutani 1995 section 8.3.
    fn default() -> Self {
        Self {
            reaction: 0.25,
            picture_period: 0.1,
            gain: Vector3::repeat(1.0),
            full_speed: 0.5,
        }
    }
}

/// An operator after the crossover model of manual control (McRuer): proportional with a delay, `k e^(-τs)`. The
/// same scenes give the same commands.
#[derive(Debug, Clone)]
pub struct Operator {
    /// What the operator is like.
    pub config: OperatorConfig,
    /// Pictures not reacted to yet: when they were shown, and the way to go in them.
    pictures: VecDeque<(f64, Vector3<f64>)>,
    next_picture: f64,
    acted_on: Vector3<f64>,
}

impl Operator {
    /// Has seen nothing yet and commands nothing.
    pub fn new(config: OperatorConfig) -> Self {
        // A picture is drawn once a period at most, so no more than these wait.
        let waiting = (config.reaction / config.picture_period).ceil();
        Self {
            config,
            pictures: VecDeque::with_capacity(waiting as usize + 2),
            next_picture: f64::NEG_INFINITY,
            acted_on: Vector3::zeros(),
        }
    }

    /// The commanded velocity \[m/s\] at `time` \[s\], when the goal lies `way` from the tip \[m\]; axes of the picture,
    /// which are the base's.
    pub fn command(&mut self, time: f64, way: &Vector3<f64>) -> Vector3<f64> {
        // Periods that do not fit the times asked for must not add up.
        const ROUNDING: f64 = 1e-9;
        let OperatorConfig {
            reaction,
            picture_period,
            gain,
            full_speed,
        } = self.config;
        if time >= self.next_picture - ROUNDING {
            self.next_picture = self.next_picture.max(time) + picture_period;
            self.pictures.push_back((time, *way));
        }
        while let Some((shown, seen)) = self.pictures.front() {
            if time < shown + reaction - ROUNDING {
                break;
            }
            self.acted_on = *seen;
            self.pictures.pop_front();
        }
        (self.acted_on.component_mul(&gain)).map(|v| v.clamp(-full_speed, full_speed))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hand_follows_the_picture_by_the_reaction_time() {
        let mut operator = Operator::new(OperatorConfig::default());
        let way = |t: f64| Vector3::new(0.2 + t, 0.0, 0.0);
        for i in 0..200 {
            let time = f64::from(i) * 0.01;
            let command = operator.command(time, &way(time));
            if time < 0.25 - 1e-6 {
                assert_eq!(command, Vector3::zeros());
                continue;
            }
            // The newest picture that is 0.25 s old, 10 of them a second.
            let shown = ((time - 0.25 + 1e-6) * 10.0).floor() / 10.0;
            let expected = way(shown).map(|v| v.min(0.5));
            assert!((command - expected).norm() < 1e-9, "{time}: {command}");
        }
    }
}
