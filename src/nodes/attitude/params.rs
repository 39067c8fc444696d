//! Parameters of the attitude node.

use nalgebra::{Matrix3, UnitQuaternion};

use crate::{
    control::attitude::{
        AttitudeControllerConfig, AttitudeFilterConfig, AttitudeLawConfig, DoubleLoopConfig, Dvdfb,
        GyroErrors, LqrWeights, RegulatorConfig, UnloadingConfig,
    },
    nodes::{choice, dynamics::FlexibleParams, geometry::unit_quaternion, placement::finite},
    ros::{Declare, Lifecycle, Param},
};

/// Parameters of the attitude node; all but `law` are read once, at the start.
#[derive(Debug, Clone)]
pub struct AttitudeParams {
    /// Parts of the robot that are not in its URDF: appendages, elastic joints, wheels, thrusters.
    pub flexible: FlexibleParams,
    /// The active law.
    pub law: NamedLaw,
    /// All laws with their settings; `law` selects one of them while the node runs.
    pub laws: [NamedLaw; 3],
    /// Number of postures covered by `hinf` in addition to the design posture.
    pub hinf_postures: usize,
    /// Feed-forward, allocation and desaturation.
    pub regulator: RegulatorConfig,
    /// Sensor error models.
    pub filter: AttitudeFilterConfig,
    /// Age limits of measurements.
    pub controller: AttitudeControllerConfig,
    /// Reference attitude until a message on `attitude_target`; `None` to hold the first known attitude.
    pub target: Option<UnitQuaternion<f64>>,
    /// Lockstep: whether every state is answered, using samples of its own stamp only.
    pub lockstep: bool,
    /// Whether the node configures and activates itself.
    pub autostart: bool,
}

/// A law with its settings, and its value in the parameter `law`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NamedLaw {
    /// Its name.
    pub name: &'static str,
    /// Its settings.
    pub config: AttitudeLawConfig,
}

#[derive(Debug, Clone, Copy)]
enum Law {
    Dvdfb,
    Lqr,
    Hinf,
}

/// Default of `hinf.postures`.
const POSTURES: i64 = 0;

const LAWS: [(&str, Law); 3] = [
    ("dvdfb", Law::Dvdfb),
    ("lqr", Law::Lqr),
    ("hinf", Law::Hinf),
];

impl AttitudeParams {
    /// Declares the parameters and reads them.
    ///
    /// # Errors
    /// A line that names a parameter, its value, and the allowed values.
    pub fn declare(declare: &mut Declare) -> Result<Self, String> {
        Ok(Self::declare_live(declare)?.0)
    }

    /// As [`Self::declare`], with the live parameter `law`, which may change while the node runs.
    pub(super) fn declare_live(declare: &mut Declare) -> Result<(Self, Param<String>), String> {
        let flexible = FlexibleParams::declare_with_packages(declare);
        let live = choice::declare(
            declare,
            "law",
            &LAWS,
            "Attitude law; may change while the node runs",
        )
        .live();
        let mut number = |name: &str, default: f64, least: f64, most: f64, text: &str| {
            let parameter = declare.param(name, default, text).range(least, most);
            parameter.read_only().value()
        };
        const TINY: f64 = 1e-12;
        const LARGE: f64 = 1e9;
        let regulator = RegulatorConfig {
            period: number(
                "period",
                0.1,
                1e-4,
                100.0,
                "Control period, for which torques are held [s]",
            ),
            equalization_time: number(
                "equalization_time",
                20.0,
                TINY,
                LARGE,
                "Time constant with which momenta of more than three wheels are equalised [s]",
            ),
            bumpless_transfer_time: number(
                "bumpless_transfer_time",
                1.0,
                0.0,
                1e3,
                "Time constant of the bumpless transfer after a change of law; 0: the torque jumps [s]",
            ),
            ..RegulatorConfig::new(0.1)
        };
        let weights = LqrWeights {
            angle: number(
                "lqr.angle",
                0.01,
                TINY,
                LARGE,
                "Deviation of an angle that costs as much as lqr.torque [rad]",
            ),
            rate: number(
                "lqr.rate",
                0.002,
                TINY,
                LARGE,
                "Deviation of a rate that costs as much as lqr.torque [rad/s]",
            ),
            torque: number(
                "lqr.torque",
                1.0,
                TINY,
                LARGE,
                "Torque for these costs [N m]",
            ),
        };
        let mut double_loop = DoubleLoopConfig::new(
            number(
                "hinf.rate_gain",
                900.0,
                TINY,
                LARGE,
                "Gain of the inner rate feedback [N m s/rad]",
            ),
            number(
                "hinf.frequency",
                0.2,
                TINY,
                LARGE,
                "Frequency near the bandwidth wanted [rad/s]",
            ),
        );
        double_loop.fraction = number(
            "hinf.fraction",
            0.9,
            0.01,
            0.999,
            "Part of the largest possible gamma that is designed for",
        );
        let hinf_postures = declare
            .param(
                "hinf.postures",
                POSTURES,
                "Postures, spread over the ranges of the joints, whose model error the weight covers besides that of the start",
            )
            .range(0, 1000)
            .read_only()
            .value();
        let mut number = |name: &str, default: f64, least: f64, most: f64, text: &str| {
            let parameter = declare.param(name, default, text).range(least, most);
            parameter.read_only().value()
        };
        let gyro = GyroErrors {
            angle_random_walk: number(
                "gyro.angle_random_walk",
                1e-5,
                0.0,
                1.0,
                "Angle random walk of the gyro [rad/s^(1/2)]: noise of a sample times the square root of the interval",
            ),
            rate_random_walk: number(
                "gyro.rate_random_walk",
                1e-7,
                0.0,
                1.0,
                "Rate random walk of the gyro's bias [rad/s^(3/2)]",
            ),
            initial_bias: number(
                "gyro.initial_bias",
                1e-3,
                0.0,
                10.0,
                "Standard deviation of the gyro's bias at the start [rad/s]",
            ),
        };
        let filter = AttitudeFilterConfig::new(
            gyro,
            number(
                "star_tracker_noise",
                1e-4,
                TINY,
                1.0,
                "Standard deviation of each component of the star tracker's error [rad]",
            ),
        );
        let controller = AttitudeControllerConfig {
            timeout: number(
                "measurement_timeout",
                0.5,
                1e-3,
                100.0,
                "Age beyond which samples of gyro, wheels and joints are not used [s]",
            ),
            star_tracker_timeout: number(
                "star_tracker_timeout",
                2.0,
                1e-3,
                1e4,
                "Age of its last measurement beyond which the star tracker counts as lost [s]",
            ),
            largest_uncertainty: number(
                "largest_uncertainty",
                0.1,
                TINY,
                10.0,
                "Standard deviation of the attitude beyond which only the rate is damped [rad]",
            ),
        };
        let unloading = UnloadingConfig {
            start: number(
                "unloading.start",
                0.7,
                0.01,
                1.0,
                "Share of its momentum limit at which a wheel makes thrusters unload all",
            ),
            stop: number(
                "unloading.stop",
                0.1,
                1e-3,
                1.0,
                "Share of the momentum limit at which unloading ends; below unloading.start",
            ),
            time: number(
                "unloading.time",
                20.0,
                TINY,
                LARGE,
                "Time constant of the momentum while it is unloaded [s]",
            ),
        };
        let mut flag = |name: &str, default: bool, text: &str| {
            declare.param(name, default, text).read_only().value()
        };
        let regulator = RegulatorConfig {
            feed_forward: flag(
                "feed_forward",
                true,
                "Let the wheels take the arm's momentum",
            ),
            gyroscopic: flag(
                "gyroscopic",
                true,
                "Add the torque with which a turning base carries the wheels' momentum",
            ),
            unloading: flag("unloading.enabled", true, "Unload the wheels by thrusters")
                .then_some(unloading),
            ..regulator
        };
        let lockstep = flag(
            "lockstep",
            false,
            "Answer every state, with the samples of its own stamp",
        );
        let mut list =
            |name: &str, default: Vec<f64>, text: &str, right: &str, lengths: [usize; 2]| {
                let parameter = declare.param(name, default, text).read_only();
                let right = right.to_owned();
                let values: Vec<f64> = parameter
                    .check(&right.clone(), move |values: &Vec<f64>| {
                        if !lengths.contains(&values.len()) {
                            return Err(format!(
                                "{values:?} has {} values, expected {right}",
                                values.len()
                            ));
                        }
                        finite(values, values.len())
                    })
                    .value();
                values
            };
        const GAIN: &str = "3 values, one for each axis, or 9, a matrix by rows";
        let p = list(
            "dvdfb.p",
            vec![60.0; 3],
            "Gain on the angle [N m/rad], base axes",
            GAIN,
            [3, 9],
        );
        let d = list(
            "dvdfb.d",
            vec![900.0; 3],
            "Gain on the rate [N m s/rad], base axes",
            GAIN,
            [3, 9],
        );
        let cover = list(
            "hinf.cover",
            Vec::new(),
            "k of the weight that covers the model error, for each axis; empty: computed for hinf.postures",
            "3 values, or none",
            [3, 0],
        );
        let target = list(
            "target",
            Vec::new(),
            "Attitude to hold until a message on attitude_target (x, y, z, w); empty: that of the start",
            "4 values, or none",
            [4, 0],
        );
        let autostart = Lifecycle::declare_autostart(declare);
        if let &[x, y, z] = cover.as_slice() {
            double_loop.cover = Some([x, y, z]);
        }
        // Invalid values have been reported by their declarations; the names are from the list.
        let dvdfb =
            Dvdfb::new(matrix(&p), matrix(&d)).map_err(|e| format!("parameter dvdfb: {e}"))?;
        let laws = LAWS.map(|(name, law)| NamedLaw {
            name,
            config: match law {
                Law::Dvdfb => AttitudeLawConfig::Dvdfb(dvdfb),
                Law::Lqr => AttitudeLawConfig::Lqr(weights),
                Law::Hinf => AttitudeLawConfig::DoubleLoop(double_loop),
            },
        });
        if regulator.unloading.is_some() {
            unloading.check().map_err(|e| format!("parameter {e}"))?;
        }
        let target = match target.as_slice() {
            &[x, y, z, w] => {
                Some(unit_quaternion(x, y, z, w).map_err(|e| format!("parameter target: {e}"))?)
            }
            _ => None,
        };
        let params = Self {
            flexible: flexible?,
            law: laws[0],
            laws,
            // Invalid values have been reported by the declaration.
            hinf_postures: usize::try_from(hinf_postures).unwrap_or(0),
            regulator,
            filter,
            controller,
            target,
            lockstep,
            autostart,
        };
        let law = params.named(&live.get());
        Ok((Self { law, ..params }, live))
    }

    /// The law called `name`; the first law if there is none, which the declaration of `law` has reported.
    pub(super) fn named(&self, name: &str) -> NamedLaw {
        let found = self.laws.iter().find(|law| law.name == name);
        *found.unwrap_or(&self.laws[0])
    }
}

/// A gain matrix from three values, its diagonal, or from nine values, row by row.
fn matrix(values: &[f64]) -> Matrix3<f64> {
    match values.len() {
        9 => Matrix3::from_row_slice(values),
        _ => Matrix3::from_fn(|i, j| match i == j {
            true => values.get(i).copied().unwrap_or(0.0),
            false => 0.0,
        }),
    }
}
