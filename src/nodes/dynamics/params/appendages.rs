//! Parameters of deformable appendages: panels, beams, and bodies whose modes were computed by another program.

use fuyu_structures::{Appendage, Beam, Boom, Outline, PlateStrip, StructureError, modes_file};
use nalgebra::{Rotation3, Translation3};

use super::numbers::{not_negative, positive};
use crate::{
    nodes::{
        choice,
        placement::{declare_vector, finite},
        resource::Lookup,
    },
    ros::Declare,
    spatial::Pose,
};

/// Number of finite elements of a beam: the error of its third frequency is then 2.5e-6.
const ELEMENTS: usize = 32;

/// Number of sections into which viewers divide the length.
const STATIONS: usize = 12;

/// Maximum number of modes of one kind.
const MOST_MODES: i64 = 12;

/// Kind of appendage.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    PlateStrip,
    Beam,
    ModesFile,
}

impl Kind {
    const NAMES: [(&'static str, Self); 3] = [
        ("plate_strip", Self::PlateStrip),
        ("beam", Self::Beam),
        ("modes_file", Self::ModesFile),
    ];
}

/// Parameters of an appendage.
#[derive(Debug, Clone)]
pub struct AppendageParams {
    /// Link that carries it; empty is the root link.
    pub link: String,
    /// Pose of its attachment frame in the link's frame.
    pub X_FA: Pose,
    /// The deformable body.
    pub body: Appendage,
    /// Initial deformation.
    pub initial: InitialModes,
    /// Points that viewers draw.
    pub outline: Outline,
}

/// Initial modal coordinates of a deformable body.
#[derive(Debug, Clone)]
pub struct InitialModes {
    /// Modal coordinates, one for each mode; empty for zero.
    pub mu: Vec<f64>,
    /// Rates of the modal coordinates, one for each mode; empty for zero.
    pub mud: Vec<f64>,
}

impl InitialModes {
    /// Declares `PREFIX.initial_mu` and `PREFIX.initial_mud`, and reads them.
    pub(super) fn declare(declare: &mut Declare, prefix: &str) -> Self {
        let mut modal = |parameter: &str, what: &str| {
            let text = format!("{what} at the start, one for each mode; empty is zero");
            (declare.param(&format!("{prefix}.{parameter}"), Vec::<f64>::new(), &text))
                .read_only()
                .check("finite numbers, one for each mode, or none", |values| {
                    finite(values, values.len())
                })
                .value()
        };
        Self {
            mu: modal("initial_mu", "Modal coordinates [kg^1/2 m]"),
            mud: modal("initial_mud", "Rates of the modal coordinates [kg^1/2 m/s]"),
        }
    }

    /// Checks that the number of values is that of the modes of `body`.
    ///
    /// # Errors
    /// A line that names the parameter and lists the modes.
    pub(super) fn check(&self, prefix: &str, body: &Appendage) -> Result<(), String> {
        for (parameter, values) in [("initial_mu", &self.mu), ("initial_mud", &self.mud)] {
            if !values.is_empty() && values.len() != body.modes() {
                return Err(format!(
                    "parameter {prefix}.{parameter} has {} values; the appendage has {} modes: {}",
                    values.len(),
                    body.modes(),
                    body.mode_names.join(", ")
                ));
            }
        }
        Ok(())
    }
}

impl AppendageParams {
    /// Declares and reads the parameters of the appendage called `name`. `lookup` finds files relative to the file of a
    /// parameter.
    ///
    /// # Errors
    /// A line that names the parameter, or file, line and field of a file of modes.
    pub(super) fn declare(
        declare: &mut Declare,
        name: &str,
        lookup: &dyn Fn(&Declare, &str) -> Lookup,
    ) -> Result<Self, String> {
        let key = |parameter: &str| format!("{name}.{parameter}");
        let link = declare
            .param(
                &key("link"),
                "",
                "Link that carries the appendage; empty is the root link",
            )
            .read_only()
            .value();
        let xyz = declare_vector(
            declare,
            &key("origin_xyz"),
            "Position of the attachment in the link's frame [m]",
        );
        let rpy = declare_vector(
            declare,
            &key("origin_rpy"),
            "Attitude of the attachment frame, x from root to tip and z normal to a panel, in the link's frame: roll, pitch, yaw about fixed axes, as in URDF [rad]",
        );
        let kind = choice::declare(
            declare,
            &key("kind"),
            &Kind::NAMES,
            "What the appendage is, clamped at its root",
        )
        .read_only()
        .value();
        let kind = choice::find(&Kind::NAMES, &kind).unwrap_or(Kind::PlateStrip);
        let body = match kind {
            Kind::PlateStrip => declare_strip(declare, name),
            Kind::Beam => declare_beam(declare, name),
            Kind::ModesFile => declare_modes_file(declare, name, lookup),
        };
        let initial = InitialModes::declare(declare, name);
        let (body, outline) = body?;
        initial.check(name, &body)?;
        let rotation = Rotation3::from_euler_angles(rpy.x, rpy.y, rpy.z);
        Ok(Self {
            link,
            X_FA: Pose::from_parts(Translation3::from(xyz), rotation),
            body,
            initial,
            outline,
        })
    }
}

fn length(declare: &mut Declare, name: &str) -> f64 {
    let text = "Length of the appendage from root to tip [m]";
    positive(declare, &format!("{name}.length"), text)
}

fn count(declare: &mut Declare, key: &str, default: i64, what: &str) -> usize {
    let count = declare
        .param(key, default, &format!("How many {what}"))
        .range(0, MOST_MODES)
        .read_only()
        .value();
    usize::try_from(count).unwrap_or(0)
}

fn damping(declare: &mut Declare, name: &str) -> f64 {
    let text = "Damping ratio of every mode [-]";
    not_negative(declare, &format!("{name}.damping"), 0.005, text)
}

pub(super) fn second_order(declare: &mut Declare, name: &str) -> bool {
    declare
        .param(
            &format!("{name}.second_order"),
            false,
            "Whether deformation also shortens the appendage: needed for fast spin and large deflections",
        )
        .read_only()
        .value()
}

/// An error of a structure, whose field is the name of a parameter.
fn of_parameter(name: &str, error: &StructureError) -> String {
    format!("parameter {name}.{error}")
}

fn declare_strip(declare: &mut Declare, name: &str) -> Result<(Appendage, Outline), String> {
    let key = |parameter: &str| format!("{name}.{parameter}");
    let length = length(declare, name);
    let width = positive(declare, &key("width"), "Width of the panel [m]");
    let areal_mass = not_negative(
        declare,
        &key("areal_mass"),
        0.0,
        "Mass of the panel per area [kg/m2]; or give linear_mass",
    );
    let linear_mass = not_negative(
        declare,
        &key("linear_mass"),
        0.0,
        "Mass of the panel per length [kg/m]; or give areal_mass",
    );
    let EI = positive(declare, &key("EI"), "Bending stiffness [N m2]");
    let GJ = positive(declare, &key("GJ"), "Torsional stiffness [N m2]");
    let bending_modes = count(declare, &key("bending_modes"), 3, "bending modes");
    let torsion_modes = count(declare, &key("torsion_modes"), 1, "torsion modes");
    let damping = damping(declare, name);
    let second_order = second_order(declare, name);
    let areal_mass = match (areal_mass > 0.0, linear_mass > 0.0) {
        (true, false) => areal_mass,
        (false, true) => linear_mass / width,
        _ => {
            return Err(format!(
                "parameter {name}.areal_mass is {areal_mass} and {name}.linear_mass is {linear_mass}; one of the two must be above 0.0"
            ));
        }
    };
    let strip = PlateStrip {
        length,
        width,
        areal_mass,
        EI,
        GJ,
        bending_modes,
        torsion_modes,
        damping,
        second_order,
    };
    let body = strip.appendage(name).map_err(|e| of_parameter(name, &e))?;
    let outline = strip
        .outline(STATIONS)
        .map_err(|e| of_parameter(name, &e))?;
    Ok((body, outline))
}

fn declare_beam(declare: &mut Declare, name: &str) -> Result<(Appendage, Outline), String> {
    let key = |parameter: &str| format!("{name}.{parameter}");
    let length = length(declare, name);
    let linear_mass = positive(
        declare,
        &key("linear_mass"),
        "Mass of the beam per length [kg/m]",
    );
    let EI = positive(
        declare,
        &key("EI"),
        "Bending stiffness, the same along y and z [N m2]",
    );
    let bending_modes = count(
        declare,
        &key("bending_modes"),
        3,
        "bending modes along y, and along z",
    );
    let damping = damping(declare, name);
    let second_order = second_order(declare, name);
    let beam = Beam::uniform(length, linear_mass, EI, ELEMENTS);
    let boom = Boom {
        along_y: beam.clone(),
        along_z: beam,
        modes: [bending_modes; 2],
        damping,
        second_order,
    };
    let body = boom.appendage(name).map_err(|e| of_parameter(name, &e))?;
    let outline = boom.outline(STATIONS).map_err(|e| of_parameter(name, &e))?;
    Ok((body, outline))
}

fn declare_modes_file(
    declare: &mut Declare,
    name: &str,
    lookup: &dyn Fn(&Declare, &str) -> Lookup,
) -> Result<(Appendage, Outline), String> {
    let key = format!("{name}.file");
    let lookup = lookup(declare, &key);
    let file: String = declare
        .required(
            &key,
            "Modes of the appendage, YAML or .csv: a path (relative to the parameter file) or package://PACKAGE/PATH",
        )
        .read_only()
        .value();
    let (text, source) = lookup
        .read(&file)
        .map_err(|e| format!("parameter {key}: {e}"))?;
    let is_csv = file.to_ascii_lowercase().ends_with(".csv");
    let read = match is_csv {
        true => modes_file::from_csv(&text, &source),
        false => modes_file::from_yaml(&text, &source),
    };
    let mut body = read.map_err(|e| format!("parameter {key}: {e}"))?;
    name.clone_into(&mut body.name);
    let outline = body.outputs.clone();
    Ok((body, Outline::of_points(outline)))
}
