//! Parameters of the teleop node.

use nalgebra::{UnitQuaternion, Vector3};
use std::time::Duration;

use super::{
    operator_command::{AXES, CommandFrame, Joystick},
    steering::SteeringConfig,
};
use crate::{
    control::{OperatorConfig, Resolution, ResolvedRateConfig},
    nodes::{choice, geometry::unit_quaternion, placement::finite, tip::declare_tip_link},
    ros::{Declare, Param},
};

/// Parameters of the teleop node.
#[derive(Debug, Clone)]
pub struct TeleopParams {
    /// Link whose frame is the tip.
    pub tip_link: String,
    /// Minimum rate of commands \[Hz\].
    pub rate: f64,
    /// Age of the operator's last message above which the arm stops.
    pub command_timeout: Duration,
    /// Attitude of the base in the world at the first measurement of `imu`.
    pub base_orientation: UnitQuaternion<f64>,
    /// Mapping of the joystick.
    pub joystick: Joystick,
    /// Settings of the steering.
    pub steering: SteeringConfig,
    /// Axes of joystick commands, and of twists without a frame name.
    pub frame: CommandFrame,
    /// The simulated operator of `fuyu simulate`, if there is one.
    pub operator: Option<SimulatedOperator>,
}

/// Simulated operator.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SimulatedOperator {
    /// Goal of the tip in the world \[m\].
    pub goal: Vector3<f64>,
    /// Parameters of the operator.
    pub config: OperatorConfig,
}

/// Live parameters, which may change while the node runs.
pub(super) struct Live {
    method: Param<String>,
    frame: Param<String>,
    numbers: [Param<f64>; 6],
    fixed: ResolvedRateConfig,
}

const COMPONENTS: [&str; 6] = ["vx", "vy", "vz", "wx", "wy", "wz"];

impl Live {
    fn declare(declare: &mut Declare) -> Self {
        let method = choice::declare(
            declare,
            "method",
            &Resolution::NAMES,
            "Method that resolves a twist of the tip into joint rates",
        )
        .live();
        let frame = choice::declare(
            declare,
            "frame",
            &CommandFrame::NAMES,
            "Axes of joystick commands, and of twists without a frame_id",
        )
        .live();
        let mut number = |name: &str, default: f64, text: &str| {
            let declared = declare.param(name, default, text);
            declared.range(1e-9, 1e9).live()
        };
        let numbers = [
            number(
                "max_linear_speed",
                0.5,
                "Largest speed of the tip that may be commanded [m/s]",
            ),
            number(
                "max_angular_speed",
                0.3,
                "Largest angular speed of the tip that may be commanded [rad/s]",
            ),
            number(
                "max_joint_rate",
                0.5,
                "Largest rate of any joint, in addition to its own limit [rad/s or m/s]",
            ),
            number(
                "max_joint_acceleration",
                1.0,
                "Largest change of any joint's rate, stops excepted [rad/s2 or m/s2]",
            ),
            number(
                "damping_threshold",
                0.1,
                "Singular value of the Jacobian below which a direction is damped [m]",
            ),
            number(
                "transpose_gain",
                1.0,
                "Gain of the transposes: joint rate per Jacobian times speed [1/m2]",
            ),
        ];
        let all = COMPONENTS.join(", ");
        let chosen = declare
            .param(
                "components",
                COMPONENTS,
                &format!("Which rates of the tip are commanded, out of {all}; the others are free"),
            )
            .read_only()
            .check(&format!("some of {all}"), |chosen: &Vec<String>| {
                let unknown = chosen.iter().find(|c| !COMPONENTS.contains(&c.as_str()));
                match (unknown, chosen.is_empty()) {
                    (Some(unknown), _) => Err(format!("'{unknown}' is not one of them")),
                    (None, true) => Err("names none".to_owned()),
                    (None, false) => Ok(()),
                }
            })
            .value();
        let characteristic_length = declare
            .param(
                "characteristic_length",
                1.0,
                "Length that weights angular rates against velocities [m]",
            )
            .range(1e-6, 1e6)
            .read_only()
            .value();
        Self {
            method,
            frame,
            numbers,
            fixed: ResolvedRateConfig {
                components: COMPONENTS.map(|c| chosen.iter().any(|chosen| chosen == c)),
                characteristic_length,
                ..ResolvedRateConfig::default()
            },
        }
    }

    pub(super) fn steering(&self) -> SteeringConfig {
        let [
            max_linear_speed,
            max_angular_speed,
            max_joint_rate,
            max_joint_acceleration,
            damping_threshold,
            transpose_gain,
        ] = self.numbers.each_ref().map(Param::get);
        SteeringConfig {
            resolution: ResolvedRateConfig {
                // Any other text has been refused by the declaration.
                method: choice::find(&Resolution::NAMES, &self.method.get())
                    .unwrap_or(Resolution::InverseGeneralized),
                damping_threshold,
                transpose_gain,
                ..self.fixed
            },
            max_linear_speed,
            max_angular_speed,
            max_joint_rate,
            max_joint_acceleration,
        }
    }

    pub(super) fn frame(&self) -> CommandFrame {
        // Any other text has been refused by the declaration.
        choice::find(&CommandFrame::NAMES, &self.frame.get()).unwrap_or(CommandFrame::Base)
    }

    pub(super) fn changed(&self) -> bool {
        // No short circuit: every handle must be queried, or it would report its change later.
        let texts = [&self.method, &self.frame];
        let changed = texts.iter().filter(|p| p.changed()).count()
            + self.numbers.iter().filter(|p| p.changed()).count();
        changed > 0
    }
}

impl TeleopParams {
    /// Declares and reads the parameters. The caller must call `declare.finish`.
    ///
    /// # Errors
    /// A line that names the invalid parameter.
    pub fn declare(declare: &mut Declare) -> Result<Self, String> {
        Self::declare_live(declare).map(|(params, _)| params)
    }

    pub(super) fn declare_live(declare: &mut Declare) -> Result<(Self, Live), String> {
        let tip_link = declare_tip_link(declare);
        let rate = declare
            .param(
                "rate",
                50.0,
                "Lowest rate of commands; those of the operator are passed on at once [Hz]",
            )
            .range(1.0, 100.0)
            .read_only()
            .value();
        let command_timeout = declare
            .param(
                "command_timeout",
                0.5,
                "Age of the last message of joy or cmd_vel beyond which the arm stops [s]",
            )
            .range(0.02, 60.0)
            .read_only()
            .value();
        let joystick = declare_joystick(declare);
        let base_orientation = declare
            .param(
                "base_orientation",
                [0.0, 0.0, 0.0, 1.0],
                "Attitude of the base in the world at the first imu measurement (x, y, z, w): imu measures rotations only",
            )
            .read_only()
            .check("4 finite numbers, norm 1", |v| finite(v, 4))
            .value();
        let live = Live::declare(declare);
        let operator = declare_operator(declare);
        let base_orientation = match base_orientation.as_slice() {
            &[x, y, z, w] => unit_quaternion(x, y, z, w)
                .map_err(|e| format!("parameter base_orientation: {e}"))?,
            // A wrong length has been reported by the declaration.
            _ => UnitQuaternion::identity(),
        };
        let params = Self {
            tip_link,
            rate,
            command_timeout: Duration::from_secs_f64(command_timeout),
            base_orientation,
            joystick,
            steering: live.steering(),
            frame: live.frame(),
            operator,
        };
        Ok((params, live))
    }
}

fn declare_joystick(declare: &mut Declare) -> Joystick {
    /// Largest index of an axis or button.
    const MAX_INDEX: i64 = 255;
    // Gamepad axes as numbered by joy_node: left stick for x and y, right stick for z and yaw.
    const DEFAULT_AXES: [i64; 6] = [1, 0, 4, -1, -1, 3];
    let mut index = |name: &str, default: i64, text: &str| {
        let declared = declare.param(name, default, text).range(-1, MAX_INDEX);
        usize::try_from(declared.read_only().value()).ok()
    };
    let axes = std::array::from_fn(|i| {
        let text = format!("Axis of joy for {}, from 0; -1 is none", COMPONENTS[i]);
        index(AXES[i], DEFAULT_AXES[i], &text)
    });
    let enable_button = index(
        "enable_button",
        0,
        "Button of joy that must be pressed for the arm to move, from 0; -1 is none",
    );
    let scales = std::array::from_fn(|i| {
        let (default, unit) = if i < 3 { (0.5, "m/s") } else { (0.2, "rad/s") };
        let text = format!("Command at full deflection of {} [{unit}]", AXES[i]);
        let name = AXES[i].replacen("axis", "scale", 1);
        let declared = declare.param(&name, default, &text).range(-1e3, 1e3);
        declared.read_only().value()
    });
    let deadband = declare
        .param(
            "deadband",
            0.05,
            "Deflection, as a fraction of the full one, below which an axis commands zero",
        )
        .range(0.0, 0.9)
        .read_only()
        .value();
    Joystick {
        axes,
        scales,
        deadband,
        enable_button,
    }
}

fn declare_operator(declare: &mut Declare) -> Option<SimulatedOperator> {
    let goal = declare
        .param(
            "operator.goal",
            Vec::<f64>::new(),
            "Goal to which the operator of `fuyu simulate` steers the tip, in the world [m]; empty: no operator",
        )
        .read_only()
        .check("3 finite numbers, or none", |v| match v.is_empty() {
            true => Ok(()),
            false => finite(v, 3),
        })
        .value();
    let usual = OperatorConfig::default();
    let mut number = |name: &str, default: f64, text: &str, least: f64, most: f64| {
        let declared = declare.param(name, default, text).range(least, most);
        declared.read_only().value()
    };
    let config = OperatorConfig {
        reaction: number(
            "operator.reaction",
            usual.reaction,
            "Reaction time of the operator, from an image to the command [s]",
            0.0,
            10.0,
        ),
        image_period: number(
            "operator.image_period",
            usual.image_period,
            "Time from one image to the next [s]",
            1e-3,
            10.0,
        ),
        gain: Vector3::repeat(number(
            "operator.gain",
            usual.gain.x,
            "Speed that the operator commands per distance [1/s]",
            1e-3,
            100.0,
        )),
        full_speed: number(
            "operator.full_speed",
            usual.full_speed,
            "Largest speed that the operator commands along each axis [m/s]",
            1e-6,
            100.0,
        ),
    };
    match goal.as_slice() {
        &[x, y, z] => Some(SimulatedOperator {
            goal: Vector3::new(x, y, z),
            config,
        }),
        _ => None,
    }
}
