//! Elastic links: slender bodies that carry a load at their far end.

use nalgebra::{DMatrix, Matrix3};

use crate::{Appendage, Beam, StructureError, error, strip::bending_invariants};

/// A uniform elastic link along x of its attachment frame, which bends along y and along z.
///
/// Its shapes are those of Craig and Bampton (1968): in each plane the static shapes of a force and a moment at the tip, which
/// span s² and s³, then modes with both ends clamped. Modes of the clamped-free link would be a poor choice, because they have no
/// moment at the tip: the frequencies of a loaded link converge with 1/n only.
#[derive(Clone, Debug, PartialEq)]
pub struct ElasticLink {
    /// Length \[m\].
    pub length: f64,
    /// Mass per length \[kg/m\].
    pub mass_per_length: f64,
    /// Bending stiffness along y, and along z \[N m²\].
    pub EI: [f64; 2],
    /// Radius of gyration of the cross sections about x \[m\]; half of its square acts about y and z. It is part of the rigid
    /// inertia only.
    pub radius_of_gyration: f64,
    /// How many modes with both ends clamped in each plane, in addition to the two static shapes.
    pub fixed_interface_modes: usize,
    /// How many finite elements; 16 give four digits more than the beam theory has.
    pub elements: usize,
    /// Damping as a multiple of the stiffness: `C = damping_time K` \[s\].
    pub damping_time: f64,
    /// Whether to compute second-order displacements: foreshortening.
    pub second_order: bool,
}

impl ElasticLink {
    /// The link in the coordinates of its tip: displacement along y \[m\] and rotation about z \[rad\] of the tip, amplitudes of the clamped modes of this
    /// plane; then displacement along z, slope dw/ds (minus the rotation about y), and the modes of the other plane. Modal mass and stiffness are
    /// not diagonal; [`Appendage::diagonalised`] makes them so.
    ///
    /// # Errors
    /// A value that is not positive, or more modes than the elements allow.
    pub fn appendage(&self, name: &str) -> Result<Appendage, StructureError> {
        error::not_negative("radius_of_gyration [m]", self.radius_of_gyration)?;
        error::not_negative("damping_time [s]", self.damping_time)?;
        error::count("elements", self.elements, 1, 400)?;
        let beams = self
            .EI
            .map(|EI| Beam::uniform(self.length, self.mass_per_length, EI, self.elements));
        let tip = [2 * self.elements, 2 * self.elements + 1];
        let mut shapes = Vec::new();
        let in_plane = 2 + self.fixed_interface_modes;
        let n = 2 * in_plane;
        let (mut mass, mut stiffness) = (DMatrix::zeros(n, n), DMatrix::zeros(n, n));
        for (plane, beam) in beams.iter().enumerate() {
            let matrices = beam.matrices()?;
            let basis = matrices.craig_bampton(&tip, &[0, 1], self.fixed_interface_modes)?;
            let at = plane * in_plane;
            let reduced = |m: &DMatrix<f64>| (basis.transpose() * m * &basis).symmetric_part();
            mass.view_mut((at, at), (in_plane, in_plane))
                .copy_from(&reduced(&matrices.M));
            stiffness
                .view_mut((at, at), (in_plane, in_plane))
                .copy_from(&reduced(&matrices.K));
            shapes.push(basis);
        }
        let [y, z] = &beams;
        let (mut invariants, outputs) =
            bending_invariants([y, z], [&shapes[0], &shapes[1]], self.second_order)?;
        let section = self.mass_per_length * self.length * self.radius_of_gyration.powi(2) / 2.0;
        let second =
            invariants.second(0, 0) + Matrix3::from_diagonal(&[0.0, section, section].into());
        invariants.set_second(0, 0, second);
        let of_plane = |axis: &str| {
            let modes = (1..=self.fixed_interface_modes).map(|k| format!("{axis}_clamped{k}"));
            let statics = [format!("{axis}_tip"), format!("{axis}_slope")];
            statics.into_iter().chain(modes).collect::<Vec<_>>()
        };
        let appendage = Appendage {
            name: name.to_owned(),
            mode_names: [of_plane("y"), of_plane("z")].concat(),
            invariants,
            modal_damping: &stiffness * self.damping_time,
            modal_mass: mass,
            modal_stiffness: stiffness,
            outputs,
        };
        appendage.check()?;
        Ok(appendage)
    }
}
