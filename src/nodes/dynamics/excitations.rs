//! Excitations: sine waves and pulses of joint efforts, wheel torques and wrenches, as in a vibration test.

use std::f64::consts::TAU;

use super::{
    external_wrenches::{ExternalWrench, WrenchAxes},
    params::{ExcitationParams, Excited},
    robot::Robot,
};
use crate::{dynamics::flexible::Wheel, model::Model};

/// A sine wave, or a constant, of unit amplitude over a time interval.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wave {
    /// Start \[s\]; the sine begins then.
    pub start: f64,
    /// End \[s\]; may be infinite.
    pub end: f64,
    /// Period of the sine \[s\]; zero for a constant.
    pub period: f64,
    /// Phase of the sine at its start \[rad\].
    pub phase: f64,
}

impl Wave {
    /// Whether the wave acts in a step that begins at `time` \[s\]; steps are split at the wave's start and end.
    fn acts_from(&self, time: f64) -> bool {
        self.start <= time + 1e-12 && time < self.end - 1e-12
    }

    /// Angle of the sine at `time` \[s\].
    fn angle(&self, time: f64) -> f64 {
        TAU * (time - self.start) / self.period + self.phase
    }

    fn at(&self, time: f64) -> f64 {
        match self.period > 0.0 {
            true => self.angle(time).sin(),
            false => 1.0,
        }
    }

    /// Mean over a step that begins at `time` and is `seconds` long; zero if the wave does not act.
    fn mean(&self, time: f64, seconds: f64) -> f64 {
        match (self.acts_from(time), self.period > 0.0) {
            (false, _) => 0.0,
            (true, false) => 1.0,
            (true, true) => {
                let [a, b] = [time, time + seconds].map(|t| self.angle(t).cos());
                (a - b) * self.period / (TAU * seconds)
            }
        }
    }
}

/// Waves on joints, wheels and links of one robot, added to its commands.
#[derive(Debug, Default)]
pub struct Excitations {
    /// Joint, amplitude \[N m or N\], and wave.
    joints: Vec<(usize, f64, Wave)>,
    /// Wheel, amplitude \[N m\], and wave.
    wheels: Vec<(usize, f64, Wave)>,
    /// Wrench at unit amplitude, valid from the wave's start to its end, and wave.
    links: Vec<(ExternalWrench, Wave)>,
    /// Held efforts of all joints and torques of all wheels, without excitations ([`Self::save`]).
    held: (Vec<f64>, Vec<f64>),
}

impl Excitations {
    /// The excitations that the parameters describe.
    ///
    /// # Errors
    /// A line that names the parameter and lists the joints, wheels or links there are.
    pub fn new(
        params: &[ExcitationParams],
        model: &Model,
        wheels: &[Wheel],
    ) -> Result<Self, String> {
        let mut all = Self {
            held: (vec![0.0; model.dof()], vec![0.0; wheels.len()]),
            ..Self::default()
        };
        for ExcitationParams { name, on, wave } in params {
            let unknown = |what: &str, given: &str, known: Vec<&str>| {
                let known = match known.is_empty() {
                    true => format!("the robot has no {what}"),
                    false => format!("it must be one of {}", known.join(", ")),
                };
                format!(
                    "parameter excitations.{name}.{what} is '{given}', which is not a {what} of the robot; {known}"
                )
            };
            match on {
                Excited::Joint { joint, amplitude } => {
                    let j = model.joint_index(joint).ok_or_else(|| {
                        let names = model.joints().iter().map(|j| j.name.as_str());
                        unknown("joint", joint, names.collect())
                    })?;
                    all.joints.push((j, *amplitude, *wave));
                }
                Excited::Wheel { wheel, amplitude } => {
                    let names: Vec<_> = wheels.iter().map(|w| w.name.as_str()).collect();
                    let i = names.iter().position(|name| name == wheel);
                    let i = i.ok_or_else(|| unknown("wheel", wheel, names))?;
                    all.wheels.push((i, *amplitude, *wave));
                }
                Excited::Link {
                    link,
                    in_world_axes,
                    position,
                    wrench,
                } => {
                    let frame = model.frame(link).cloned().ok_or_else(|| {
                        let names = model.frames().iter().map(|f| f.name.as_str());
                        unknown("link", link, names.collect())
                    })?;
                    let wrench = ExternalWrench {
                        axes: match in_world_axes {
                            true => WrenchAxes::World,
                            false => WrenchAxes::Robot(frame.clone()),
                        },
                        link: frame,
                        point: *position,
                        wrench: *wrench,
                        from: wave.start,
                        until: wave.end,
                        is_streamed: false,
                    };
                    all.links.push((wrench, *wave));
                }
            }
        }
        Ok(all)
    }

    fn waves(&self) -> impl Iterator<Item = &Wave> {
        let parts = self.joints.iter().chain(&self.wheels);
        let links = self.links.iter().map(|(_, wave)| wave);
        parts.map(|(_, _, wave)| wave).chain(links)
    }

    /// Times at which an excitation begins or ends \[s\].
    pub fn changes(&self) -> impl Iterator<Item = f64> {
        self.waves().flat_map(|wave| [wave.start, wave.end])
    }

    /// Whether any excitation acts in a step that begins at `time` \[s\].
    pub fn act_from(&self, time: f64) -> bool {
        self.waves().any(|wave| wave.acts_from(time))
    }

    /// Whether there are no excitations.
    pub fn are_none(&self) -> bool {
        self.waves().next().is_none()
    }

    /// Whether any excitation acts on a link, now or at another time.
    pub fn has_link_waves(&self) -> bool {
        !self.links.is_empty()
    }

    /// Whether any excitation acts on a link in a step that begins at `time` \[s\].
    pub fn link_wave_acts_from(&self, time: f64) -> bool {
        self.links.iter().any(|(_, wave)| wave.acts_from(time))
    }

    /// Wrenches at unit amplitude with their factors at `time` \[s\], for the excitations that act in the step that
    /// began at `start`.
    pub fn wrenches(&self, start: f64, time: f64) -> impl Iterator<Item = (&ExternalWrench, f64)> {
        let acting = self.links.iter().filter(move |(_, w)| w.acts_from(start));
        acting.map(move |(wrench, wave)| (wrench, wave.at(time)))
    }

    /// Saves the held input of `robot`, before [`Self::add`].
    pub fn save(&mut self, robot: &Robot) {
        let (efforts, torques) = &mut self.held;
        efforts.copy_from_slice(robot.efforts().as_slice());
        if let Some(robot) = robot.flexible() {
            torques.copy_from_slice(robot.input().wheel_torques.as_slice());
        }
    }

    /// Restores the held input of `robot` as saved by [`Self::save`].
    pub fn restore(&self, robot: &mut Robot) {
        let (efforts, torques) = &self.held;
        robot
            .input_mut()
            .efforts
            .as_mut_slice()
            .copy_from_slice(efforts);
        if let Some(robot) = robot.flexible_mut() {
            let held = robot.input_mut().wheel_torques.as_mut_slice();
            held.copy_from_slice(torques);
        }
    }

    /// Sets joint efforts and wheel torques to the held ones plus the excitations at `time` \[s\], for the excitations
    /// that act in the step that began at `start`.
    pub fn add(&self, start: f64, time: f64, efforts: &mut [f64], torques: &mut [f64]) {
        let lists = [
            (&self.joints, &self.held.0, efforts),
            (&self.wheels, &self.held.1, torques),
        ];
        for (waves, held, out) in lists {
            for (i, ..) in waves {
                out[*i] = held[*i];
            }
            for (i, amplitude, wave) in waves {
                if wave.acts_from(start) {
                    out[*i] += amplitude * wave.at(time);
                }
            }
        }
    }

    /// Adds the excitations at `time` \[s\] to the input that [`Self::save`] has saved.
    pub fn add_to(&self, robot: &mut Robot, time: f64) {
        if let Some(robot) = robot.flexible_mut() {
            let input = robot.input_mut();
            let efforts = input.tree.efforts.as_mut_slice();
            self.add(time, time, efforts, input.wheel_torques.as_mut_slice());
        } else {
            let efforts = robot.input_mut().efforts.as_mut_slice();
            self.add(time, time, efforts, &mut []);
        }
    }

    /// Joints with the mean efforts of their excitations over a step that begins at `time` and is `seconds` long.
    pub fn mean_efforts(&self, time: f64, seconds: f64) -> impl Iterator<Item = (usize, f64)> {
        let joints = self.joints.iter();
        joints.map(move |(j, amplitude, wave)| (*j, amplitude * wave.mean(time, seconds)))
    }

    /// Mean torque of the excitations on wheel `i` over a step that begins at `time` and is `seconds` long \[N m\].
    pub fn mean_torque(&self, i: usize, time: f64, seconds: f64) -> f64 {
        let on_wheel = self.wheels.iter().filter(|(wheel, ..)| *wheel == i);
        on_wheel
            .map(|(_, amplitude, wave)| amplitude * wave.mean(time, seconds))
            .sum()
    }
}
