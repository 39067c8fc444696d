//! The regulator: from the estimated attitude to wheel torques and thruster on-times.

use nalgebra::Vector3;

use super::error::{require_not_negative, require_positive};
use super::{
    ArmMomentum, ArmMotion, AttitudeConfigError, AttitudeDeviation, AttitudeLaw,
    ThrusterAllocation, ThrusterAllocator, Unloading, UnloadingConfig, WheelAllocation,
    WheelAllocator,
};
use crate::dynamics::flexible::FlexibleSystem;

/// Settings of an [`AttitudeRegulator`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RegulatorConfig {
    /// Control period, for which torques are held \[s\].
    pub period: f64,
    /// Whether the wheels balance the arm's momentum ([`ArmMomentum`]).
    pub feed_forward: bool,
    /// Whether the torque `w x h` is added that a turning base needs to carry the momentum h of its wheels. This torque
    /// does no work on the base.
    pub gyroscopic: bool,
    /// Desaturation of the wheels, for robots with thrusters; `None` for never.
    pub unloading: Option<UnloadingConfig>,
    /// Time constant with which the momenta of more than three wheels are equalised \[s\].
    pub equalization_time: f64,
    /// Time constant of the bumpless transfer \[s\], with which the torque difference of a change of law decays; with
    /// zero the torque jumps. While the difference decays it turns the base, by its integral divided by the gain on the
    /// rate.
    pub bumpless_transfer_time: f64,
}

impl RegulatorConfig {
    /// Settings with feed-forward, gyroscopic torque and desaturation.
    pub fn new(period: f64) -> Self {
        Self {
            period,
            feed_forward: true,
            gyroscopic: true,
            unloading: Some(UnloadingConfig::default()),
            equalization_time: 20.0,
            bumpless_transfer_time: 1.0,
        }
    }
}

/// Input of a step of an [`AttitudeRegulator`].
#[derive(Debug, Clone, Copy)]
pub struct RegulatorInput<'a> {
    /// Deviation of the base.
    pub deviation: AttitudeDeviation,
    /// Angular velocity of the base, base axes \[rad/s\].
    pub w_WB_B: Vector3<f64>,
    /// Speeds of the wheels relative to the base \[rad/s\]. Without them momentum limits are unknown, and the wheels
    /// are not unloaded.
    pub wheel_speeds: Option<&'a [f64]>,
    /// Motion of the arm; without it there is no feed-forward.
    pub arm: Option<ArmMotion<'a>>,
}

/// Result of a step of an [`AttitudeRegulator`]. Torques act on the base, base axes \[N m\].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RegulatorReport {
    /// Torque of the law, including the remainder of a bumpless transfer.
    pub law: Vector3<f64>,
    /// Torque for the motion of the arm.
    pub feed_forward: Vector3<f64>,
    /// Torque for the momentum of the wheels.
    pub gyroscopic: Vector3<f64>,
    /// Torque of the wheels.
    pub wheels: WheelAllocation,
    /// Torque of the thrusters, averaged over the period.
    pub thrusters: Option<ThrusterAllocation>,
    /// Angular momentum of the wheels, base axes \[N m s\], if their speeds are known.
    pub wheel_momentum: Option<Vector3<f64>>,
    /// Largest momentum of a wheel as a fraction of its limit, if the speeds are known.
    pub wheel_load: Option<f64>,
    /// Whether thrusters unload the wheels.
    pub is_unloading: bool,
}

/// Bumpless transfer: the torque difference of a change of law, and its decay.
///
/// The torque `d exp(-t/T)` is added to that of the new law, so the torque is continuous. It is bounded and its integral
/// is finite, so a stable law remains stable: with direct feedback of rate gain D, the energy of Kida 1993 Theorem 4.1
/// grows by `T |d|² / 8 d_min` at most, where `d_min` is the smallest eigenvalue of D.
#[derive(Debug, Clone, Copy, Default)]
struct Transfer {
    /// Whether the law has changed since the last step.
    changed: bool,
    /// Torque of the last step, difference included \[N m\]; `None` before the first step of a run.
    last: Option<Vector3<f64>>,
    /// The remaining difference \[N m\].
    difference: Vector3<f64>,
}

impl Transfer {
    /// The torque to apply if the present law gives `torque`; `decay` is the factor for one period.
    fn apply(&mut self, torque: Vector3<f64>, decay: f64) -> Vector3<f64> {
        self.difference = match (std::mem::take(&mut self.changed), self.last) {
            (true, Some(last)) if decay > 0.0 => last - torque,
            (true, _) => Vector3::zeros(),
            (false, _) => self.difference * decay,
        };
        let given = torque + self.difference;
        self.last = Some(given);
        given
    }
}

/// A law with feed-forward, allocation and desaturation. No step allocates memory.
#[derive(Debug)]
pub struct AttitudeRegulator {
    config: RegulatorConfig,
    law: Box<dyn AttitudeLaw>,
    transfer: Transfer,
    arm: ArmMomentum,
    wheels: WheelAllocator,
    thrusters: Option<ThrusterAllocator>,
    unloading: Option<Unloading>,
}

impl AttitudeRegulator {
    /// For the wheels and thrusters of `system`.
    ///
    /// # Errors
    /// [`AttitudeConfigError`] for a setting out of its range, and as [`WheelAllocator::new`] and
    /// [`ThrusterAllocator::new`]. Thrusters are only checked if they are to unload the wheels.
    pub fn new(
        system: &FlexibleSystem,
        law: Box<dyn AttitudeLaw>,
        config: RegulatorConfig,
    ) -> Result<Self, AttitudeConfigError> {
        require_positive("period [s]", config.period)?;
        require_not_negative("bumpless_transfer_time [s]", config.bumpless_transfer_time)?;
        let thrusters = match config.unloading {
            Some(_) => ThrusterAllocator::new(system, config.period)?,
            None => None,
        };
        Ok(Self {
            law,
            transfer: Transfer::default(),
            arm: ArmMomentum::new(system),
            wheels: WheelAllocator::new(system, config.equalization_time)?,
            thrusters,
            unloading: config.unloading.map(Unloading::new).transpose()?,
            config,
        })
    }

    /// Settings.
    pub fn config(&self) -> &RegulatorConfig {
        &self.config
    }

    /// The law.
    pub fn law(&self) -> &dyn AttitudeLaw {
        &*self.law
    }

    /// Replaces the law without a step in the torque: the difference decays with
    /// [`RegulatorConfig::bumpless_transfer_time`].
    pub fn set_law(&mut self, law: Box<dyn AttitudeLaw>) {
        self.law = law;
        self.transfer.changed = true;
    }

    /// The allocation to the wheels.
    pub fn wheels(&self) -> &WheelAllocator {
        &self.wheels
    }

    /// Number of joints.
    pub fn joints(&self) -> usize {
        self.arm.joints()
    }

    /// Motor torques of the wheels \[N m\], of the last step.
    pub fn wheel_torques(&self) -> &[f64] {
        self.wheels.torques()
    }

    /// On-times of the thrusters from the beginning of the period \[s\], of the last step; empty if thrusters are not
    /// used.
    pub fn on_times(&self) -> &[f64] {
        self.thrusters
            .as_ref()
            .map_or(&[], ThrusterAllocator::on_times)
    }

    /// Discards the past: the next step belongs to another run.
    pub fn reset(&mut self) {
        self.law.reset();
        self.transfer = Transfer::default();
        self.arm.reset();
        self.stop();
    }

    /// Zero torque, closed valves.
    pub fn stop(&mut self) {
        self.wheels.release();
        if let Some(thrusters) = &mut self.thrusters {
            thrusters.reset();
        }
        if let Some(unloading) = &mut self.unloading {
            unloading.reset();
        }
    }

    /// Computes torques and on-times for one period.
    ///
    /// # Panics
    /// If a list has a wrong length.
    pub fn step(&mut self, input: &RegulatorInput<'_>) -> RegulatorReport {
        let period = self.config.period;
        let law = self.law.torque(&input.deviation);
        let decay = match self.config.bumpless_transfer_time {
            time if time > 0.0 => (-period / time).exp(),
            _ => 0.0,
        };
        let law = self.transfer.apply(law, decay);
        let arm = input
            .arm
            .as_ref()
            .map(|motion| self.arm.torque(motion, period));
        if arm.is_none() {
            self.arm.reset();
        }
        let feed_forward = match arm {
            Some(torque) if self.config.feed_forward => torque,
            _ => Vector3::zeros(),
        };
        let wheel_momentum = input
            .wheel_speeds
            .map(|speeds| self.wheels.momentum(speeds));
        let wheel_load = input
            .wheel_speeds
            .map(|speeds| self.wheels.largest_load(speeds));
        let gyroscopic = match wheel_momentum {
            Some(h) if self.config.gyroscopic => input.w_WB_B.cross(&h),
            _ => Vector3::zeros(),
        };
        let thrusters = self.unload(wheel_load, wheel_momentum);
        // The wheels must absorb the momentum that the thrusters change.
        let external = thrusters.map_or_else(Vector3::zeros, |given| given.torque);
        let wanted = law + feed_forward + gyroscopic - external;
        let wheels = self.wheels.allocate(&wanted, input.wheel_speeds, period);
        RegulatorReport {
            law,
            feed_forward,
            gyroscopic,
            wheels,
            thrusters,
            wheel_momentum,
            wheel_load,
            is_unloading: self
                .unloading
                .is_some_and(|unloading| unloading.is_active()),
        }
    }

    fn unload(
        &mut self,
        load: Option<f64>,
        momentum: Option<Vector3<f64>>,
    ) -> Option<ThrusterAllocation> {
        let thrusters = self.thrusters.as_mut()?;
        let wanted = match (&mut self.unloading, load, momentum) {
            (Some(unloading), Some(load), Some(momentum)) => unloading.torque(load, &momentum),
            _ => None,
        };
        match wanted {
            Some(torque) => Some(thrusters.allocate(&torque, self.arm.p_BC())),
            None => {
                thrusters.reset();
                None
            }
        }
    }
}
