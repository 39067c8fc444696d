//! Strips (panels) and booms: slender bodies that are clamped at their root.

use nalgebra::DMatrix;

use crate::{
    Appendage, Beam, Cantilever, End, Invariants, MassPoint, Outline, OutputPoint, QuadraticRod,
    Shaft, StructureError, error,
    line::{Line, Sample},
};

/// Pieces into which the length is divided for integrals over closed forms.
const PIECES: usize = 24;

/// Shapes of modes at x.
type Shapes<'a> = Vec<Box<dyn Fn(f64) -> Sample + 'a>>;

/// A thin rectangular panel that is clamped at one short side, such as a solar panel: Euler-Bernoulli bending out of its plane and
/// St Venant torsion, uniform.
///
/// Attachment frame: origin at the middle of the clamped side, x from root to tip, y along the chord, z normal. Bending modes
/// are positive at the tip along +z, torsion modes about +x; all are mass-normalised.
#[derive(Clone, Debug, PartialEq)]
pub struct PlateStrip {
    /// Length along x \[m\].
    pub length: f64,
    /// Width along y \[m\].
    pub width: f64,
    /// Mass per area \[kg/m²\].
    pub areal_mass: f64,
    /// Bending stiffness \[N m²\].
    pub EI: f64,
    /// Torsional stiffness \[N m²\].
    pub GJ: f64,
    /// How many bending modes.
    pub bending_modes: usize,
    /// How many torsion modes.
    pub torsion_modes: usize,
    /// Damping ratio of every mode \[-\].
    pub damping: f64,
    /// Whether to compute second-order displacements: foreshortening, bending-torsion coupling and turning of the chord.
    pub second_order: bool,
}

impl PlateStrip {
    fn mass_per_length(&self) -> f64 {
        self.areal_mass * self.width
    }

    /// About x \[kg m\].
    fn inertia_per_length(&self) -> f64 {
        self.mass_per_length() * self.width * self.width / 12.0
    }

    fn check(&self) -> Result<(), StructureError> {
        error::positive("length [m]", self.length)?;
        error::positive("width [m]", self.width)?;
        error::positive("areal_mass [kg/m²]", self.areal_mass)?;
        error::positive("EI [N m²]", self.EI)?;
        error::positive("GJ [N m²]", self.GJ)?;
        error::not_negative("damping", self.damping)?;
        error::count("bending_modes", self.bending_modes, 0, 12)?;
        error::count("torsion_modes", self.torsion_modes, 0, 12)
    }

    /// The panel with the exact shapes and frequencies of Euler-Bernoulli and St Venant theory: bending modes first.
    ///
    /// # Errors
    /// A value that is not positive, or more than 12 modes of a kind.
    pub fn appendage(&self, name: &str) -> Result<Appendage, StructureError> {
        let (modes, frequencies) = self.exact_modes()?;
        self.assemble(name, PIECES, modes, &frequencies)
    }

    /// The edge of the panel at the ends of `parts` equal parts of its length, with the modes of
    /// [`PlateStrip::appendage`].
    ///
    /// # Errors
    /// As [`PlateStrip::appendage`]; no parts, or more than 400.
    pub fn outline(&self, parts: usize) -> Result<Outline, StructureError> {
        error::count("parts of the outline", parts, 1, 400)?;
        Ok(self.line(PIECES, self.exact_modes()?.0).outline(parts))
    }

    /// Closed forms of the shapes, and frequencies \[rad/s\].
    fn exact_modes(&self) -> Result<(Shapes<'static>, Vec<f64>), StructureError> {
        self.check()?;
        let bending = Cantilever::new(self.length, self.mass_per_length(), self.EI)?;
        let torsion = Shaft::new(self.length, self.inertia_per_length(), self.GJ)?;
        let mut modes: Shapes<'static> = Vec::new();
        for k in 0..self.bending_modes {
            modes.push(Box::new(move |x| Sample {
                w: bending.shape(k, x),
                ..Sample::default()
            }));
        }
        for k in 0..self.torsion_modes {
            modes.push(Box::new(move |x| Sample {
                theta: torsion.shape(k, x),
                ..Sample::default()
            }));
        }
        let frequencies = (0..self.bending_modes)
            .map(|k| bending.frequency(k))
            .chain((0..self.torsion_modes).map(|k| torsion.frequency(k)));
        let frequencies = frequencies.collect();
        Ok((modes, frequencies))
    }

    /// The panel as finite elements: Hermite cubics in bending, quadratic elements in torsion, `elements` of each. Its error in
    /// frequency falls with the fourth power of their number.
    ///
    /// # Errors
    /// As [`PlateStrip::appendage`]; fewer elements than modes, or more than 400.
    pub fn finite_elements(
        &self,
        name: &str,
        elements: usize,
    ) -> Result<Appendage, StructureError> {
        self.check()?;
        error::count("number of elements", elements, 1, 400)?;
        let beam = Beam::uniform(self.length, self.mass_per_length(), self.EI, elements);
        let rod = QuadraticRod {
            length: self.length,
            mass_per_length: self.inertia_per_length(),
            stiffness: self.GJ,
            elements,
        };
        let bending = beam.modes(End::Clamped, End::Free, self.bending_modes)?;
        let torsion = rod.modes(self.torsion_modes)?;
        let mut modes: Shapes<'_> = Vec::new();
        let (beam, rod) = (&beam, &rod);
        for shape in bending.shapes.column_iter().map(|c| c.into_owned()) {
            modes.push(Box::new(move |x| Sample {
                w: beam.deflection(&shape, x),
                ..Sample::default()
            }));
        }
        for shape in torsion.shapes.column_iter().map(|c| c.into_owned()) {
            modes.push(Box::new(move |x| Sample {
                theta: rod.twist(&shape, x),
                ..Sample::default()
            }));
        }
        let frequencies = bending
            .frequencies
            .iter()
            .chain(&torsion.frequencies)
            .copied();
        self.assemble(name, elements, modes, &frequencies.collect::<Vec<_>>())
    }

    fn assemble<'a>(
        &'a self,
        name: &str,
        pieces: usize,
        modes: Shapes<'a>,
        frequencies: &[f64],
    ) -> Result<Appendage, StructureError> {
        let body = self.line(pieces, modes).invariants(self.second_order)?;
        let kinds = [("b", self.bending_modes), ("t", self.torsion_modes)];
        with_modes(name, body, frequencies, self.damping, kinds)
    }

    fn line<'a>(&self, pieces: usize, modes: Shapes<'a>) -> Line<'a> {
        let density = self.mass_per_length();
        Line {
            breaks: (0..=pieces)
                .map(|i| self.length * i as f64 / pieces as f64)
                .collect(),
            mass_per_length: Box::new(move |_| density),
            width: self.width,
            modes,
        }
    }
}

/// An appendage with modes of two kinds, in the given numbers. They are named by a letter and numbers from 1.
fn with_modes(
    name: &str,
    (invariants, outputs): (Invariants, Vec<OutputPoint>),
    frequencies: &[f64],
    damping: f64,
    kinds: [(&str, usize); 2],
) -> Result<Appendage, StructureError> {
    let damping = vec![damping; frequencies.len()];
    let mut appendage = Appendage::with_frequencies(name, invariants, frequencies, &damping)?;
    let names = kinds.map(|(letter, count)| (1..=count).map(move |k| format!("{letter}{k}")));
    appendage.mode_names = names.into_iter().flatten().collect();
    appendage.outputs = outputs;
    Ok(appendage)
}

/// A boom that is clamped at its root and bends in two planes; uniform or not, possibly with a mass at its tip.
///
/// Attachment frame: x from root to tip. The first modes bend along y, the others along z; mass-normalised, positive at the
/// tip. Torsion is neglected, and so is the rotary inertia of the cross sections.
#[derive(Clone, Debug, PartialEq)]
pub struct Boom {
    /// The boom as it bends along y. Its mass is that of the boom.
    pub along_y: Beam,
    /// The boom as it bends along z: the same lengths and masses, another stiffness.
    pub along_z: Beam,
    /// How many modes along y, and along z.
    pub modes: [usize; 2],
    /// Damping ratio of every mode \[-\].
    pub damping: f64,
    /// Whether to compute second-order displacements: foreshortening.
    pub second_order: bool,
}

impl Boom {
    /// The boom with its finite-element modes.
    ///
    /// # Errors
    /// Beams with different elements or with bodies at other nodes than the tip, values that are not positive, too many modes.
    pub fn appendage(&self, name: &str) -> Result<Appendage, StructureError> {
        error::not_negative("damping", self.damping)?;
        let y = self.along_y.modes(End::Clamped, End::Free, self.modes[0])?;
        let z = self.along_z.modes(End::Clamped, End::Free, self.modes[1])?;
        let body = bending_invariants(
            [&self.along_y, &self.along_z],
            [&y.shapes, &z.shapes],
            self.second_order,
        )?;
        let frequencies: Vec<f64> = y
            .frequencies
            .iter()
            .chain(&z.frequencies)
            .copied()
            .collect();
        let kinds = [("y", self.modes[0]), ("z", self.modes[1])];
        with_modes(name, body, &frequencies, self.damping, kinds)
    }

    /// The boom's line at the ends of `parts` equal parts of its length, with the modes of [`Boom::appendage`].
    ///
    /// # Errors
    /// As [`Boom::appendage`]; no parts, or more than 400.
    pub fn outline(&self, parts: usize) -> Result<Outline, StructureError> {
        error::count("parts of the outline", parts, 1, 400)?;
        let y = self.along_y.modes(End::Clamped, End::Free, self.modes[0])?;
        let z = self.along_z.modes(End::Clamped, End::Free, self.modes[1])?;
        let line = bending_line([&self.along_y, &self.along_z], [&y.shapes, &z.shapes]);
        Ok(line.outline(parts))
    }
}

/// Mass integrals of a beam that bends along y and along z with given shapes (values of the degrees of freedom, one column for
/// each shape).
pub(crate) fn bending_invariants(
    [y, z]: [&Beam; 2],
    [y_shapes, z_shapes]: [&DMatrix<f64>; 2],
    second_order: bool,
) -> Result<(Invariants, Vec<OutputPoint>), StructureError> {
    let inertias = |b: &Beam| {
        b.elements
            .iter()
            .map(|e| (e.length, e.mass_per_length))
            .collect::<Vec<_>>()
    };
    let tip = y.elements.len();
    let bodies = |b: &Beam| {
        b.bodies
            .iter()
            .map(|b| (b.node, b.mass))
            .collect::<Vec<_>>()
    };
    if inertias(y) != inertias(z)
        || bodies(y) != bodies(z)
        || y.bodies.iter().any(|b| b.node != tip)
    {
        return Err(StructureError::Size {
            field: "the beam along z".to_owned(),
            found: "other lengths or masses than the beam along y, or bodies away from the tip"
                .to_owned(),
            expected: "the same elements but for EI, and bodies at the tip only".to_owned(),
        });
    }
    let line = bending_line([y, z], [y_shapes, z_shapes]);
    let (mut points, outputs) = line.points(second_order);
    for body in &y.bodies {
        let tip: &OutputPoint = &outputs[0];
        points.push(MassPoint {
            mass: body.mass,
            position: tip.position,
            psi: tip.translation.clone(),
            chi: tip.chi.clone(),
        });
    }
    let mut invariants = Invariants::from_points(&points)?;
    add_rotary_inertia(&mut invariants, &outputs[0], [y, z]);
    Ok((invariants, outputs))
}

/// A beam that bends along y and along z with given shapes.
fn bending_line<'a>([y, z]: [&'a Beam; 2], [y_shapes, z_shapes]: [&DMatrix<f64>; 2]) -> Line<'a> {
    let mut modes: Shapes<'a> = Vec::new();
    for shape in y_shapes.column_iter().map(|c| c.into_owned()) {
        modes.push(Box::new(move |x| Sample {
            v: y.deflection(&shape, x),
            ..Sample::default()
        }));
    }
    for shape in z_shapes.column_iter().map(|c| c.into_owned()) {
        modes.push(Box::new(move |x| Sample {
            w: z.deflection(&shape, x),
            ..Sample::default()
        }));
    }
    Line {
        breaks: y.nodes(),
        mass_per_length: Box::new(move |x| y.mass_per_length(x)),
        width: 0.0,
        modes,
    }
}

/// Adds what the rotary inertia of bodies at the tip contributes to the body's inertia and to the modes' angular momentum.
fn add_rotary_inertia(invariants: &mut Invariants, tip: &OutputPoint, [y, z]: [&Beam; 2]) {
    use nalgebra::{Matrix3, Vector3};
    // Bending along y turns the tip about z, bending along z about y.
    let about = |beam: &Beam| beam.bodies.iter().map(|b| b.inertia).sum::<f64>();
    let inertia = Vector3::new(0.0, about(z), about(y));
    let second = Matrix3::identity() * (inertia.sum() / 2.0) - Matrix3::from_diagonal(&inertia);
    invariants.set_second(0, 0, invariants.second(0, 0) + second);
    for (k, rotation) in tip.rotation.iter().enumerate() {
        let moment = inertia.component_mul(rotation);
        let cross = invariants.second(0, 1 + k) + crate::appendage::antisymmetric(moment);
        invariants.set_second(0, 1 + k, cross);
    }
}
