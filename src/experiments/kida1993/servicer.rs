//! The servicer with two solar panels, an arm and three wheels, as a plant of attitude control: Kida's hybrid model,
//! whose rigid part depends on the arm's posture.

use fuyu_lti::{LtiError, Matrix, StateSpace, Structure};
use fuyu_structures::{PlateStrip, StructureError};
use nalgebra::{DVector, Rotation3, Translation3, Vector3};

use super::random::Random;
use crate::dynamics::flexible::{FlexibleError, FlexibleSystem, LinearModel, Wheel};
use crate::model::{Model, UrdfError};
use crate::spatial::Pose;

/// Joint angles \[rad\] of the postures A, B and C.
pub const POSTURES: [(&str, [f64; 6]); 3] = [
    ("A", [0.0; 6]),
    ("B", [0.3, 0.8, -1.4, 0.6, 0.4, 0.0]),
    ("C", [1.2, 1.9, -2.2, -0.7, 0.5, 0.3]),
];

/// Gains of direct feedback about each axis: P \[N m/rad\] and D \[N m s/rad\].
pub const GAINS: (f64, f64) = (60.0, 900.0);

/// Axial inertia of each wheel \[kg m²\].
const WHEEL_INERTIA: f64 = 0.2;

/// Reason why the model cannot be built; does not occur with these data.
#[derive(Debug, thiserror::Error)]
pub enum ServicerError {
    /// Invalid robot description.
    #[error(transparent)]
    Urdf(#[from] UrdfError),
    /// Invalid panel structure.
    #[error(transparent)]
    Structure(#[from] StructureError),
    /// Invalid combination of robot, panels and wheels.
    #[error(transparent)]
    Flexible(#[from] FlexibleError),
    /// Error of the linear systems.
    #[error(transparent)]
    Lti(#[from] LtiError),
}

/// The panels: 8 m x 2 m, 48 kg, three bending modes and one of torsion.
pub const PANEL: PlateStrip = PlateStrip {
    length: 8.0,
    width: 2.0,
    areal_mass: 3.0,
    EI: 3000.0,
    GJ: 800.0,
    bending_modes: 3,
    torsion_modes: 1,
    damping: 0.005,
    second_order: false,
};

/// The robot with panels and wheels.
pub struct Servicer {
    system: FlexibleSystem,
}

/// The servicer with the joints locked in a posture.
pub struct Posture {
    /// Inputs: six forces and torques on the base, wheels locked. Coordinates: base, then modes.
    pub free: Structure,
    /// Inputs: three torques on the base, wheels locked. Translation is eliminated.
    pub attitude: Structure,
    /// As [`Self::attitude`], but with the torques of wheels as inputs; wheels turn freely under their motors.
    pub under_wheels: Structure,
    /// Undamped frequencies with the base free \[Hz\].
    pub frequencies_hz: Vec<f64>,
}

impl Servicer {
    /// The servicer of `urdf/servicer.urdf` with the panels turned by `array_angle` \[rad\] about the base's x axis.
    ///
    /// # Errors
    /// None with these data.
    pub fn new(array_angle: f64) -> Result<Self, ServicerError> {
        let text = include_str!("../../../urdf/servicer.urdf");
        let model = Model::from_urdf(text, "servicer.urdf")?;
        let panel = PANEL.appendage("panel")?;
        let turn = Rotation3::from_axis_angle(&Vector3::x_axis(), array_angle);
        let back = Rotation3::from_axis_angle(&Vector3::z_axis(), std::f64::consts::PI);
        let base = model.frame("base_link").expect("a link of the servicer");
        let mut builder = FlexibleSystem::builder(&model);
        for (name, x, R) in [
            ("solar_plus", 1.2, turn),
            ("solar_minus", -1.2, turn * back),
        ] {
            let mut panel = panel.clone();
            name.clone_into(&mut panel.name);
            let X_BA = Pose::from_parts(Translation3::new(x, 0.0, 0.0), R);
            builder = builder.appendage(base, X_BA, panel);
        }
        let axes = [Vector3::x_axis(), Vector3::y_axis(), Vector3::z_axis()];
        for (name, axis) in ["x", "y", "z"].into_iter().zip(axes) {
            builder = builder.wheel(base, Wheel::new(name, axis, WHEEL_INERTIA));
        }
        Ok(Self {
            system: builder.build()?,
        })
    }

    /// The linear models in a posture.
    ///
    /// # Errors
    /// None for finite angles.
    pub fn posture(&self, q: &[f64; 6]) -> Result<Posture, ServicerError> {
        let linear = LinearModel::new(&self.system, &DVector::from_row_slice(q));
        let kept = linear.base_and_modes();
        let part = |matrix| LinearModel::part(matrix, &kept);
        let (mass, damping) = (part(&linear.mass), part(&linear.damping));
        let stiffness = part(&linear.stiffness);
        let n = kept.len();
        let inputs = Matrix::from_fn(n, 6, |i, j| f64::from(i == j));
        let free = Structure::new(
            mass.clone(),
            damping.clone(),
            stiffness.clone(),
            inputs.clone(),
        )?;
        // Wheels without torque keep their speed, so that their acceleration can be eliminated.
        let wheels: Vec<usize> = linear.wheels().collect();
        let coupling = linear.mass.select_rows(&kept).select_columns(&wheels);
        let own = LinearModel::part(&linear.mass, &wheels).diagonal();
        let mut freed = mass;
        for (column, inertia) in coupling.column_iter().zip(own.iter()) {
            freed -= column * column.transpose() / *inertia;
        }
        let freed = Structure::new(freed.symmetric_part(), damping, stiffness, inputs)?;
        let torques = |s: &Structure| {
            s.with_actuators(&[3, 4, 5])?
                .without_free_coordinates(&[0, 1, 2])
        };
        Ok(Posture {
            attitude: torques(&free)?,
            under_wheels: torques(&freed)?,
            frequencies_hz: linear.frequencies_hz(&kept)?,
            free,
        })
    }

    /// Joint angles within half a turn, the same in every run.
    pub fn random_postures(count: usize) -> Vec<[f64; 6]> {
        let mut random = Random::new(14);
        let pi = std::f64::consts::PI;
        let posture = |_| std::array::from_fn(|_| random.between(-pi, pi));
        (0..count).map(posture).collect()
    }
}

/// Direct feedback `[P D]` from three angles and three rates to three torques, closed by negative feedback.
pub fn direct_feedback((p, d): (f64, f64)) -> StateSpace {
    StateSpace::gain(Matrix::from_fn(3, 6, |i, j| {
        if j == i {
            p
        } else if j == i + 3 {
            d
        } else {
            0.0
        }
    }))
}
