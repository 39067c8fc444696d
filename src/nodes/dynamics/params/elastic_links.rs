//! Parameters of elastic links.

use fuyu_structures::{Appendage, ElasticLink};
use nalgebra::{Rotation3, Translation3};

use super::{
    appendages::{InitialModes, second_order},
    numbers::{not_negative, positive},
};
use crate::{nodes::placement::declare_vector, ros::Declare, spatial::Pose};

/// Number of finite elements of a link: the error of its frequencies is then below 1e-7.
const ELEMENTS: usize = 16;

/// Parameters of an elastic link.
#[derive(Debug, Clone)]
pub struct ElasticLinkParams {
    /// Pose of its attachment frame in the link's frame; its x axis points from root to tip.
    pub X_LA: Pose,
    /// The deformable body, which has the link's name; its inertia replaces the link's.
    pub body: Appendage,
    /// Initial deformation.
    pub initial: InitialModes,
}

/// Declares and reads `links.LINK.*` for every link for which at least one of them is given.
///
/// # Errors
/// A line that names the parameter, its value, and the allowed values.
pub(super) fn declare_elastic_links(
    declare: &mut Declare,
) -> Result<Vec<ElasticLinkParams>, String> {
    let names = declare.children("links");
    // All are declared before the first error is returned, so that no parameter is reported as unknown.
    let all: Vec<_> = (names.iter())
        .map(|link| ElasticLinkParams::declare(declare, link))
        .collect();
    all.into_iter().collect()
}

impl ElasticLinkParams {
    fn declare(declare: &mut Declare, link: &str) -> Result<Self, String> {
        let prefix = format!("links.{link}");
        let key = |parameter: &str| format!("{prefix}.{parameter}");
        let length = positive(
            declare,
            &key("length"),
            "Length of the elastic link from its root to the section that carries what follows [m]",
        );
        let mass_per_length = positive(
            declare,
            &key("linear_mass"),
            "Mass of the elastic link per length [kg/m]",
        );
        let EI = positive(
            declare,
            &key("EI"),
            "Bending stiffness of the elastic link along y, and along z unless EI_z is given [N m2]",
        );
        let EI_z = not_negative(
            declare,
            &key("EI_z"),
            0.0,
            "Bending stiffness of the elastic link along z [N m2]; 0 is that along y",
        );
        let radius_of_gyration = not_negative(
            declare,
            &key("radius_of_gyration"),
            0.0,
            "Radius of gyration of the elastic link's cross sections about its axis [m]",
        );
        let clamped_modes = declare
            .param(
                &key("clamped_modes"),
                0_i64,
                "Number of modes with both ends clamped in each plane, in addition to the shapes of a force and a moment at the tip",
            )
            .range(0, 8)
            .read_only()
            .value();
        let damping_time = not_negative(
            declare,
            &key("damping_time"),
            0.0,
            "Damping of the elastic link as a multiple of its stiffness [s]",
        );
        let second_order = second_order(declare, &prefix);
        let xyz = declare_vector(
            declare,
            &key("origin_xyz"),
            "Position of the elastic link's root in the link's frame [m]",
        );
        let rpy = declare_vector(
            declare,
            &key("origin_rpy"),
            "Attitude of the elastic link's attachment frame, x from root to tip, in the link's frame: roll, pitch, yaw about fixed axes, as in URDF [rad]",
        );
        let initial = InitialModes::declare(declare, &prefix);
        let shape = ElasticLink {
            length,
            mass_per_length,
            EI: [EI, if EI_z > 0.0 { EI_z } else { EI }],
            radius_of_gyration,
            // Other numbers have been reported by the declaration.
            fixed_interface_modes: usize::try_from(clamped_modes).unwrap_or_default(),
            elements: ELEMENTS,
            damping_time,
            second_order,
        };
        let body = (shape.appendage(link)).map_err(|e| format!("parameter {prefix}.{e}"))?;
        initial.check(&prefix, &body)?;
        let rotation = Rotation3::from_euler_angles(rpy.x, rpy.y, rpy.z);
        Ok(Self {
            X_LA: Pose::from_parts(Translation3::from(xyz), rotation),
            body,
            initial,
        })
    }
}
