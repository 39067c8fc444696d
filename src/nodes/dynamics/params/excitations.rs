//! Parameters of excitations: waves on joints, wheels and links.

use nalgebra::Vector3;

use super::numbers::not_negative;
use crate::{
    nodes::{choice, dynamics::excitations::Wave, placement::declare_vector},
    ros::Declare,
    spatial::Wrench,
};

/// Names of the axes of force and torque on a link; true for the axes of the world.
const AXES: [(&str, bool); 2] = [("link", false), ("world", true)];

/// The excited part and the amplitude.
#[derive(Debug, Clone, PartialEq)]
pub enum Excited {
    /// A joint effort.
    Joint {
        /// Name of the joint.
        joint: String,
        /// Amplitude \[N m or N\].
        amplitude: f64,
    },
    /// A motor torque of a wheel.
    Wheel {
        /// Name of the wheel.
        wheel: String,
        /// Amplitude \[N m\].
        amplitude: f64,
    },
    /// A wrench on a link.
    Link {
        /// Name of the link.
        link: String,
        /// Whether force, torque and position are in axes of the world instead of the link.
        in_world_axes: bool,
        /// Point at which the force acts, relative to the link's origin \[m\].
        position: Vector3<f64>,
        /// Amplitude: torque \[N m\] and force \[N\].
        wrench: Wrench,
    },
}

/// Parameters of an excitation.
#[derive(Debug, Clone, PartialEq)]
pub struct ExcitationParams {
    /// Its name.
    pub name: String,
    /// The excited joint, wheel or link.
    pub on: Excited,
    /// Its variation with time.
    pub wave: Wave,
}

/// Declares and reads `excitations.NAME.*` for every excitation for which at least one of them is given.
///
/// # Errors
/// A line that names an excitation without an excited part, or with several.
pub(super) fn declare_excitations(declare: &mut Declare) -> Result<Vec<ExcitationParams>, String> {
    let names = declare.children("excitations");
    // All are declared before the first error is returned, so that no parameter is reported as unknown.
    let all: Vec<_> = (names.into_iter())
        .map(|name| declare_excitation(declare, name))
        .collect();
    all.into_iter().collect()
}

fn declare_excitation(declare: &mut Declare, name: String) -> Result<ExcitationParams, String> {
    let key = |parameter: &str| format!("excitations.{name}.{parameter}");
    let [joint, wheel, link] = [
        ("joint", "Joint whose effort is excited"),
        ("wheel", "Wheel whose motor torque is excited"),
        ("link", "Link that is pushed"),
    ]
    .map(|(part, text)| {
        (declare.param(&key(part), "", &format!("{text}; or give another part")))
            .read_only()
            .value()
    });
    let mut number = |parameter: &str, text: &str| {
        (declare.param(&key(parameter), 0.0, text))
            .check("a finite number", |value: &f64| match value.is_finite() {
                true => Ok(()),
                false => Err(format!("{value} is wrong, expected a finite number")),
            })
            .read_only()
            .value()
    };
    let amplitude = number(
        "amplitude",
        "Largest effort of the joint, or torque of the wheel, in addition to the commanded one [N m or N]",
    );
    let phase = number("phase", "Angle of the sine at its start [rad]");
    let force = declare_vector(declare, &key("force"), "Largest force on the link [N]");
    let torque = declare_vector(declare, &key("torque"), "Largest torque on the link [N m]");
    let position = declare_vector(
        declare,
        &key("position"),
        "Where the force acts, from the link's origin, in the axes of the force [m]",
    );
    let axes = choice::declare(declare, &key("axes"), &AXES, "Axes of force and torque");
    let axes = axes.read_only().value();
    let period = not_negative(
        declare,
        &key("period"),
        0.0,
        "Period of the sine [s]; 0 is a constant",
    );
    let start = not_negative(
        declare,
        &key("start"),
        0.0,
        "Time at which the excitation begins [s]",
    );
    let duration = not_negative(
        declare,
        &key("duration"),
        0.0,
        "How long the excitation lasts [s]; 0 is for ever",
    );
    let given = [&joint, &wheel, &link].map(|part| !part.is_empty());
    if given.iter().filter(|given| **given).count() != 1 {
        return Err(format!(
            "parameter excitations.{name}: joint is '{joint}', wheel is '{wheel}' and link is '{link}'; one of the three must name what is excited"
        ));
    }
    let pushes = force != Vector3::zeros() || torque != Vector3::zeros();
    let (missing, is_missing) = match given[2] {
        true => ("force or torque", !pushes),
        false => ("amplitude", amplitude == 0.0),
    };
    if is_missing {
        return Err(format!(
            "parameter excitations.{name}.{missing} is not given; without it the excitation does nothing"
        ));
    }
    if (given[2] && amplitude != 0.0) || (!given[2] && pushes) {
        return Err(format!(
            "parameter excitations.{name}: amplitude is for a joint or wheel, force and torque are for a link"
        ));
    }
    let on = match given {
        [true, ..] => Excited::Joint { joint, amplitude },
        [_, true, _] => Excited::Wheel { wheel, amplitude },
        _ => Excited::Link {
            link,
            in_world_axes: choice::find(&AXES, &axes).unwrap_or_default(),
            position,
            wrench: Wrench::new(torque, force),
        },
    };
    let wave = Wave {
        start,
        end: match duration > 0.0 {
            true => start + duration,
            false => f64::INFINITY,
        },
        period,
        phase,
    };
    Ok(ExcitationParams { name, on, wave })
}
