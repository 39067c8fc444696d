//! Operator commands, read from messages that may be invalid.

use nalgebra::Vector3;

use crate::{
    msg::{geometry_msgs::TwistStamped, sensor_msgs::Joy},
    nodes::geometry::vector_from_msg,
    spatial::Twist,
};

/// Axes in which a command is given.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CommandFrame {
    /// Base axes, as seen by an operator on board or in the image of a camera on the base.
    Base,
    /// Tip axes.
    Tip,
    /// World axes, as integrated from the base's gyro.
    World,
}

impl CommandFrame {
    /// All frames by name.
    pub const NAMES: [(&'static str, Self); 3] = [
        ("base", Self::Base),
        ("tip", Self::Tip),
        ("world", Self::World),
    ];
}

/// Frame names that messages may have.
#[derive(Debug, Clone)]
pub struct FrameNames {
    /// Link of the base.
    pub base: String,
    /// Link of the tip.
    pub tip: String,
}

/// A twist commanded by an operator.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OperatorCommand {
    /// Axes of the twist.
    pub frame: CommandFrame,
    /// The twist of the tip's origin.
    pub twist: Twist,
}

/// Mapping of a joystick to a twist.
#[derive(Debug, Clone, PartialEq)]
pub struct Joystick {
    /// Axis of the message for x, y, z, roll, pitch, yaw; `None` if that component is not commanded.
    pub axes: [Option<usize>; 6],
    /// Command at full deflection of an axis \[m/s, rad/s\].
    pub scales: [f64; 6],
    /// Deflection, as a fraction of the full one, below which an axis commands zero.
    pub deadband: f64,
    /// The dead man's switch: without it pressed nothing moves. `None` if there is no such button.
    pub enable_button: Option<usize>,
}

impl Joystick {
    /// The commanded twist; `None` while the dead man's switch is not pressed.
    ///
    /// # Errors
    /// The axis or button that is missing or not finite.
    pub fn twist(&self, message: &Joy) -> Result<Option<Twist>, String> {
        let counts = (message.axes.len(), message.buttons.len());
        if let Some(button) = self.enable_button {
            let pressed = message.buttons.get(button).ok_or_else(|| {
                format!(
                    "has {} buttons; enable_button is {button}, counted from 0",
                    counts.1
                )
            })?;
            if *pressed == 0 {
                return Ok(None);
            }
        }
        let mut values = [0.0; 6];
        for (i, value) in values.iter_mut().enumerate() {
            let Some(axis) = self.axes[i] else { continue };
            let read = message.axes.get(axis).ok_or_else(|| {
                let name = AXES[i];
                format!("has {} axes; {name} is {axis}, counted from 0", counts.0)
            })?;
            if !read.is_finite() {
                return Err(format!("axis {axis} is {read}; it must be -1 to 1"));
            }
            *value = self.beyond_deadband(f64::from(*read)) * self.scales[i];
        }
        let [x, y, z, roll, pitch, yaw] = values;
        Ok(Some(Twist::new(
            Vector3::new(roll, pitch, yaw),
            Vector3::new(x, y, z),
        )))
    }

    /// Deflection after the deadband: zero within it, one at full deflection, continuous in between.
    fn beyond_deadband(&self, axis: f64) -> f64 {
        let beyond = (axis.abs() - self.deadband) / (1.0 - self.deadband);
        beyond.clamp(0.0, 1.0).copysign(axis)
    }
}

/// Names of the axes in parameters, the same as in teleop_twist_joy.
pub const AXES: [&str; 6] = [
    "axis_linear.x",
    "axis_linear.y",
    "axis_linear.z",
    "axis_angular.roll",
    "axis_angular.pitch",
    "axis_angular.yaw",
];

impl OperatorCommand {
    /// Reads a stamped twist; `frame` applies if the message names no frame.
    ///
    /// # Errors
    /// The component that is not finite, or the allowed frames.
    pub fn from_msg(
        message: &TwistStamped,
        names: &FrameNames,
        frame: CommandFrame,
    ) -> Result<Self, String> {
        let given = message.header.frame_id.as_str();
        let frame = if given.is_empty() {
            frame
        } else if given == names.base {
            CommandFrame::Base
        } else if given == names.tip {
            CommandFrame::Tip
        } else if given == crate::nodes::dynamics::WORLD {
            CommandFrame::World
        } else {
            return Err(format!(
                "frame_id is '{given}'; expected {}, {}, world, or none for the parameter frame",
                names.base, names.tip
            ));
        };
        let part = |name: &str, v| {
            let v = vector_from_msg(v);
            match v.iter().zip(["x", "y", "z"]).find(|(v, _)| !v.is_finite()) {
                Some((v, axis)) => Err(format!("twist.{name}.{axis} is {v}; it must be finite")),
                None => Ok(v),
            }
        };
        let linear = part("linear", &message.twist.linear)?;
        let angular = part("angular", &message.twist.angular)?;
        Ok(Self {
            frame,
            twist: Twist::new(angular, linear),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stick() -> Joystick {
        Joystick {
            axes: [Some(1), Some(0), None, None, None, Some(2)],
            scales: [0.5, -0.5, 0.5, 0.2, 0.2, 0.2],
            deadband: 0.1,
            enable_button: Some(1),
        }
    }

    fn joy(axes: &[f32], buttons: &[i32]) -> Joy {
        Joy {
            axes: axes.to_vec(),
            buttons: buttons.to_vec(),
            ..Joy::default()
        }
    }

    #[test]
    fn axes_are_mapped_and_scaled_with_a_deadband() {
        let twist = |axes: &[f32]| stick().twist(&joy(axes, &[0, 1])).unwrap().unwrap();
        let V = twist(&[1.0, -1.0, 0.55]);
        assert_eq!(V.linear, Vector3::new(-0.5, -0.5, 0.0));
        assert!((V.angular - Vector3::new(0.0, 0.0, 0.1)).norm() < 1e-7);
        let V = twist(&[0.09, -0.09, 0.0]);
        assert_eq!(V.linear.norm() + V.angular.norm(), 0.0);
        // Continuous at the edge of the deadband.
        assert!(twist(&[0.101, 0.0, 0.0]).linear.norm() < 1e-3);
        // Values beyond full deflection are clamped.
        assert_eq!(twist(&[2.0, 0.0, 0.0]).linear.y, -0.5);
    }

    #[test]
    fn nothing_is_commanded_without_the_button() {
        assert_eq!(stick().twist(&joy(&[1.0; 3], &[1, 0])), Ok(None));
        let free = Joystick {
            enable_button: None,
            ..stick()
        };
        assert!(free.twist(&joy(&[1.0; 3], &[])).unwrap().is_some());
    }

    #[test]
    fn invalid_messages_are_refused_with_the_reason() {
        let refusal =
            |axes: &[f32], buttons: &[i32]| stick().twist(&joy(axes, buttons)).unwrap_err();
        assert_eq!(
            refusal(&[0.0, f32::NAN, 0.0], &[0, 1]),
            "axis 1 is NaN; it must be -1 to 1"
        );
        assert_eq!(
            refusal(&[0.0, 0.0], &[0, 1]),
            "has 2 axes; axis_angular.yaw is 2, counted from 0"
        );
        assert!(refusal(&[0.0; 3], &[1]).contains("1 buttons; enable_button is 1"));
        let names = FrameNames {
            base: "base_link".to_owned(),
            tip: "tool0".to_owned(),
        };
        let mut message = TwistStamped::default();
        let read = |m: &TwistStamped| OperatorCommand::from_msg(m, &names, CommandFrame::World);
        assert_eq!(read(&message).unwrap().frame, CommandFrame::World);
        message.header.frame_id = "tool0".to_owned();
        assert_eq!(read(&message).unwrap().frame, CommandFrame::Tip);
        message.twist.angular.y = f64::INFINITY;
        assert!(
            read(&message)
                .unwrap_err()
                .contains("twist.angular.y is inf")
        );
        message.header.frame_id = "odom".to_owned();
        assert!(
            read(&message)
                .unwrap_err()
                .contains("'odom'; expected base_link, tool0, world")
        );
    }
}
