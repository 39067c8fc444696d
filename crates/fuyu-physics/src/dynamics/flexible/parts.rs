//! Descriptions of wheels, thrusters and elastic joints.

use nalgebra::{Unit, Vector3};

use super::FlexibleError;
use super::error::require;

/// A reaction wheel: a rotor on a body, driven by a motor between the two.
///
/// The body's inertia contains the locked wheel. The wheel's angular momentum about its axis is then `inertia * (speed
/// relative to the body)` in addition to that of the body.
#[derive(Clone, Debug, PartialEq)]
pub struct Wheel {
    /// Name in messages.
    pub name: String,
    /// Axis, in axes of the link that carries the wheel.
    pub axis: Unit<Vector3<f64>>,
    /// Moment of inertia about the axis \[kg m²\].
    pub inertia: f64,
    /// Largest motor torque \[N m\]; infinite for no limit.
    pub max_torque: f64,
    /// Largest angular momentum relative to the body \[N m s\]; infinite for no limit. The motor does not accelerate
    /// the wheel beyond it.
    pub max_momentum: f64,
    /// Largest speed relative to the body \[rad/s\]; infinite for no limit.
    pub max_speed: f64,
    /// Viscous friction of the bearing \[N m s/rad\].
    pub viscous_friction: f64,
    /// Coulomb friction of the bearing \[N m\]. Below [`Wheel::FRICTION_SPEED`] it falls to zero as `tanh`.
    pub coulomb_friction: f64,
}

impl Wheel {
    /// Speed at which 76 % of the Coulomb friction acts \[rad/s\].
    pub const FRICTION_SPEED: f64 = 0.1;

    /// Relative distance from the speed limit within which a wheel counts as at the limit.
    pub(super) const AT_LIMIT: f64 = 1e-9;

    /// A wheel without limits and friction.
    pub fn new(name: &str, axis: Unit<Vector3<f64>>, inertia: f64) -> Self {
        Self {
            name: name.to_owned(),
            axis,
            inertia,
            max_torque: f64::INFINITY,
            max_momentum: f64::INFINITY,
            max_speed: f64::INFINITY,
            viscous_friction: 0.0,
            coulomb_friction: 0.0,
        }
    }

    /// Largest speed relative to the body that momentum and speed limits allow \[rad/s\].
    pub fn speed_limit(&self) -> f64 {
        self.max_speed.min(self.max_momentum / self.inertia)
    }

    /// Torque of the bearing on the wheel at `speed` relative to the body \[N m\].
    pub fn friction(&self, speed: f64) -> f64 {
        -self.viscous_friction * speed
            - self.coulomb_friction * (speed / Self::FRICTION_SPEED).tanh()
    }

    /// Motor torque for a commanded torque `wanted` at `speed`, held for `duration` \[s\] (0: an instant): within the
    /// torque limit, and not beyond the speed limit at the end of the duration.
    pub fn limited_torque(&self, wanted: f64, speed: f64, duration: f64) -> f64 {
        let mut torque = wanted.clamp(-self.max_torque, self.max_torque);
        let limit = self.speed_limit();
        if limit < f64::INFINITY {
            // Remaining change of momentum in the direction of the torque; a wheel beyond its limit is only braked.
            let room = (limit - speed * torque.signum()).max(0.0) * self.inertia;
            let is_there = room <= Self::AT_LIMIT * limit * self.inertia;
            if torque.abs() * duration > room || (duration == 0.0 && is_there) {
                torque = torque.signum() * if duration > 0.0 { room / duration } else { 0.0 };
            }
        }
        torque
    }

    pub(super) fn check(&self) -> Result<(), FlexibleError> {
        let name = &self.name;
        require(
            || format!("wheel {name}, inertia [kg m²]"),
            self.inertia,
            self.inertia > 0.0 && self.inertia.is_finite(),
            "positive",
        )?;
        for (field, value) in [
            ("max_torque [N m]", self.max_torque),
            ("max_momentum [N m s]", self.max_momentum),
            ("max_speed [rad/s]", self.max_speed),
        ] {
            require(
                || format!("wheel {name}, {field}"),
                value,
                value > 0.0,
                "positive",
            )?;
        }
        for (field, value) in [
            ("viscous_friction [N m s/rad]", self.viscous_friction),
            ("coulomb_friction [N m]", self.coulomb_friction),
        ] {
            require(
                || format!("wheel {name}, {field}"),
                value,
                value >= 0.0 && value.is_finite(),
                "zero or positive",
            )?;
        }
        let axis = self.axis.norm();
        require(
            || format!("wheel {name}, length of the axis"),
            axis,
            (axis - 1.0).abs() < 1e-9,
            "1",
        )
    }
}

/// A thruster that is either on or off.
#[derive(Clone, Debug, PartialEq)]
pub struct Thruster {
    /// Name in messages.
    pub name: String,
    /// Where the force acts, in the frame of the link that carries the thruster \[m\].
    pub position: Vector3<f64>,
    /// Direction of the force on the robot, opposite to that of the exhaust, in the link's axes.
    pub direction: Unit<Vector3<f64>>,
    /// Force while it is on \[N\].
    pub thrust: f64,
    /// Shortest time that the valve can be open \[s\]; shorter commands are lengthened to it.
    pub min_on_time: f64,
}

impl Thruster {
    pub(super) fn check(&self) -> Result<(), FlexibleError> {
        let name = &self.name;
        require(
            || format!("thruster {name}, thrust [N]"),
            self.thrust,
            self.thrust > 0.0 && self.thrust.is_finite(),
            "positive",
        )?;
        require(
            || format!("thruster {name}, min_on_time [s]"),
            self.min_on_time,
            self.min_on_time >= 0.0 && self.min_on_time.is_finite(),
            "zero or positive",
        )?;
        let position = self.position.sum();
        require(
            || format!("thruster {name}, sum of the position [m]"),
            position,
            position.is_finite(),
            "finite",
        )?;
        let direction = self.direction.norm();
        require(
            || format!("thruster {name}, length of the direction"),
            direction,
            (direction - 1.0).abs() < 1e-9,
            "1",
        )
    }
}

/// Model of a motor's rotor in an elastic joint.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum RotorModel {
    /// The rotor is a gyrostat on the parent link: it has angular momentum, and follows the link's rotation. The
    /// parent's inertia contains the locked rotor.
    #[default]
    Full,
    /// The rotor moves as if the parent link were at rest (M. W. Spong, "Modeling and control of elastic joint robots",
    /// J. Dyn. Sys. Meas. Control 109, 1987): terms of the order 1/gear_ratio are neglected, and the momentum is that
    /// of the links alone.
    Reduced,
}

/// Elasticity between the motor of a joint and the link that it moves.
///
/// With the motor angle θ, measured on the output side of the gear, the link is driven by `stiffness (θ - q) + damping
/// (θ' - q')`, and the motor by the joint's effort minus this torque. Efforts of the joint are on the output side.
#[derive(Clone, Debug, PartialEq)]
pub struct ElasticJoint {
    /// Name of the joint.
    pub joint: String,
    /// Torque per angle between motor and link \[N m/rad, N/m\].
    pub stiffness: f64,
    /// Torque per rate of the same angle \[N m s/rad, N s/m\].
    pub damping: f64,
    /// Moment of inertia of the rotor about its axis, on the motor side of the gear \[kg m²\].
    pub rotor_inertia: f64,
    /// Revolutions of the rotor per revolution of the joint.
    pub gear_ratio: f64,
    /// Model of the rotor.
    pub rotor: RotorModel,
}

impl ElasticJoint {
    /// Inertia of the rotor on the output side of the gear \[kg m²\].
    pub fn reflected_inertia(&self) -> f64 {
        self.rotor_inertia * self.gear_ratio * self.gear_ratio
    }

    pub(super) fn check(&self) -> Result<(), FlexibleError> {
        let name = &self.joint;
        for (field, value) in [
            ("stiffness [N m/rad]", self.stiffness),
            ("rotor_inertia [kg m²]", self.rotor_inertia),
        ] {
            require(
                || format!("joint {name}, {field}"),
                value,
                value > 0.0 && value.is_finite(),
                "positive",
            )?;
        }
        require(
            || format!("joint {name}, damping [N m s/rad]"),
            self.damping,
            self.damping >= 0.0 && self.damping.is_finite(),
            "zero or positive",
        )?;
        require(
            || format!("joint {name}, gear_ratio"),
            self.gear_ratio,
            self.gear_ratio != 0.0 && self.gear_ratio.is_finite(),
            "a number other than zero",
        )
    }
}
