//! Parameters of contact between bodies: the contact law by default and for individual pairs.

use std::path::PathBuf;

use super::numbers::not_negative;
use crate::{
    dynamics::contact::{Bristle, ContactLaw},
    ros::Declare,
};

/// Contact between the bodies of the world.
#[derive(Debug, Clone)]
pub struct ContactParams {
    /// The default law.
    pub law: ContactLaw,
    /// Laws of individual pairs.
    pub pairs: Vec<ContactPairParams>,
    /// Whether links of the robot can touch each other.
    pub self_contact: bool,
    /// Integration tolerance; zero for the default of [`Self::tolerance_of`].
    pub tolerance: f64,
    /// Folders with ROS packages in which meshes are searched.
    pub packages: Vec<PathBuf>,
}

/// The contact law of a pair.
#[derive(Debug, Clone)]
pub struct ContactPairParams {
    /// The two bodies: names of links, targets or `<collision>` elements.
    pub names: [String; 2],
    /// The law; `None` if there is no contact between the two.
    pub law: Option<ContactLaw>,
}

/// Declares and reads `contact.*`; `None` if there is no contact.
pub(super) fn declare_contact(
    declare: &mut Declare,
    packages: &[PathBuf],
) -> Option<ContactParams> {
    let is_given = !declare.children("contact").is_empty();
    let is_on: bool = declare
        .param(
            "contact.enabled",
            is_given,
            "Whether bodies with <collision> elements touch; if it is not given, any other parameter of contact switches it on",
        )
        .read_only()
        .value();
    let law = declare_law(
        declare,
        "contact",
        "pairs of bodies",
        &ContactLaw::default(),
    );
    let self_contact = declare
        .param(
            "contact.self_contact",
            false,
            "Whether links of the robot touch each other; those that a joint connects never do",
        )
        .read_only()
        .value();
    let tolerance = declare
        .param(
            "contact.tolerance",
            0.0,
            "About the error of an integration step with contact [m, rad, m/s, rad/s]; 0 is 1e-14 for bodies without joints, 1e-8 if any has joints",
        )
        .check("0.0, or 1e-16 to 0.01", |value| {
            match *value == 0.0 || (1e-16..=1e-2).contains(value) {
                true => Ok(()),
                false => Err(format!("{value} is out of range, expected 0.0 or 1e-16 to 0.01")),
            }
        })
        .read_only()
        .value();
    let mut pairs = Vec::new();
    for first in declare.children("contact.pairs") {
        for second in declare.children(&format!("contact.pairs.{first}")) {
            let prefix = format!("contact.pairs.{first}.{second}");
            let touches: bool = declare
                .param(
                    &format!("{prefix}.enabled"),
                    true,
                    &format!("Whether {first} and {second} touch"),
                )
                .read_only()
                .value();
            let own = declare_law(declare, &prefix, &format!("{first} and {second}"), &law);
            pairs.push(ContactPairParams {
                names: [first.clone(), second],
                law: touches.then_some(own),
            });
        }
    }
    is_on.then(|| ContactParams {
        law,
        pairs,
        self_contact,
        tolerance,
        packages: packages.to_vec(),
    })
}

impl ContactParams {
    /// The integration tolerance of the contact world. Impacts of bodies without joints are cheap: their default
    /// tolerance gives restitution and duration to 1e-9. `has_joints`: some body has joints; a step then costs many
    /// times as much, and the default is coarser, so that gripping can be simulated in real time.
    pub fn tolerance_of(&self, has_joints: bool) -> f64 {
        match (self.tolerance > 0.0, has_joints) {
            (true, _) => self.tolerance,
            (false, true) => 1e-8,
            (false, false) => 1e-14,
        }
    }
}

/// Declares and reads a law below `prefix`.
fn declare_law(
    declare: &mut Declare,
    prefix: &str,
    what: &str,
    default: &ContactLaw,
) -> ContactLaw {
    let key = |name: &str| format!("{prefix}.{name}");
    let mut above_zero = |name: &str, default: f64, text: &str| {
        declare
            .param(&key(name), default, &format!("{text}, of {what}"))
            .check("a number above 0.0", |value: &f64| {
                match *value > 0.0 && value.is_finite() {
                    true => Ok(()),
                    false => Err(format!(
                        "{value} is out of range, expected a number above 0.0"
                    )),
                }
            })
            .read_only()
            .value()
    };
    let stiffness = above_zero(
        "stiffness",
        default.stiffness,
        "Stiffness k of the normal force k depth^p (1 + d depth') [N/m^p]",
    );
    let stiction_speed = above_zero(
        "stiction_speed",
        default.stiction_speed,
        "Slip at which friction has reached 71 % of its limit [m/s]",
    );
    let exponent = declare
        .param(
            &key("exponent"),
            default.exponent,
            &format!("Exponent p: 1 for a linear spring, 1.5 for Hertz's law, of {what}"),
        )
        .range(1.0, 3.0)
        .read_only()
        .value();
    let point_weight = declare
        .param(
            &key("point_weight"),
            default.point_weight,
            &format!(
                "Where the forces act, as a fraction of the depth: 0 at the deepest point of the first, 0.5 in the middle, of {what}"
            ),
        )
        .range(0.0, 1.0)
        .read_only()
        .value();
    let mut from_zero = |name: &str, default: f64, text: &str| {
        not_negative(declare, &key(name), default, &format!("{text}, of {what}"))
    };
    let dissipation = from_zero(
        "dissipation",
        default.dissipation,
        "Dissipation d of the normal force [s/m]",
    );
    let friction = from_zero("friction", default.friction, "Coefficient of friction");
    let of_bristle = default.bristle;
    let stiffness_of_bristle = from_zero(
        "bristle_stiffness",
        of_bristle.map_or(0.0, |b| b.stiffness),
        "Friction over normal force per deflection of bristles, which hold without creep [1/m]; 0 is none",
    );
    let damping_of_bristle = from_zero(
        "bristle_damping",
        of_bristle.map_or(0.0, |b| b.damping),
        "Friction over normal force per rate of deflection of bristles [s/m]",
    );
    ContactLaw {
        // Invalid values have been reported by the declaration.
        stiffness: if stiffness > 0.0 { stiffness } else { 1.0 },
        exponent: exponent.clamp(1.0, 3.0),
        dissipation,
        friction,
        stiction_speed: if stiction_speed > 0.0 {
            stiction_speed
        } else {
            1.0
        },
        point_weight,
        bristle: (stiffness_of_bristle > 0.0).then_some(Bristle {
            stiffness: stiffness_of_bristle,
            damping: damping_of_bristle,
        }),
    }
}
