//! Fixtures, the servicer with its panels, and comparisons.

use fuyu_physics::dynamics::flexible::{
    FlexibleBuilder, FlexibleState, FlexibleSystem, FlexibleWorkspace, Thruster, Wheel,
};
use fuyu_physics::model::Model;
use fuyu_physics::spatial::{Pose, Twist};
use fuyu_structures::{Appendage, PlateStrip};
use nalgebra::{DVector, Quaternion, Rotation3, Translation3, Unit, UnitQuaternion, Vector3};
use serde_json::Value;

/// Amplitudes and periods of the joint efforts, and damping, of the fixtures' runs.
pub const AMP: [f64; 6] = [5.0, 10.0, -6.0, 0.5, 0.1, 0.005];
pub const PERIOD: [f64; 6] = [20.0, 24.0, 16.0, 10.0, 12.0, 8.0];
pub const DAMPING: [f64; 6] = [20.0, 40.0, 30.0, 4.0, 1.0, 0.1];
/// Postures A, B and C.
pub const POSTURES: [(&str, [f64; 6]); 3] = [
    ("A", [0.0; 6]),
    ("B", [0.3, 0.8, -1.4, 0.6, 0.4, 0.0]),
    ("C", [1.2, 1.9, -2.2, -0.7, 0.5, 0.3]),
];

pub fn fixture(name: &str) -> Value {
    let folder = env!("CARGO_MANIFEST_DIR");
    let path = format!("{folder}/tests/flexible/fixtures/{name}.json");
    let text = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{path}: {e}"));
    serde_json::from_str(&text).unwrap()
}

/// Base-free frequencies of the servicer with panels of 14 bending and 7 torsion modes, posture B, panels not turned
/// \[Hz\].
pub fn fixture_lumped() -> Vec<f64> {
    vec![
        0.198_223_859_282_658_9,
        0.320_066_134_231_394_63,
        0.624_999_999_999_893_3,
        0.627_298_445_891_477,
        1.230_551_842_167_182,
        1.284_812_936_674_915_5,
    ]
}

pub fn numbers(value: &Value) -> Vec<f64> {
    let list = value
        .as_array()
        .unwrap_or_else(|| panic!("not a list: {value}"));
    list.iter().map(|v| v.as_f64().unwrap()).collect()
}

pub fn vector(value: &Value) -> Vector3<f64> {
    Vector3::from_column_slice(&numbers(value))
}

pub fn quaternion(value: &Value) -> UnitQuaternion<f64> {
    let [x, y, z, w] = numbers(value)[..] else {
        panic!("not a quaternion: {value}")
    };
    UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z))
}

/// Largest difference of two lists of the same length.
pub fn difference(found: &[f64], expected: &[f64]) -> f64 {
    assert_eq!(found.len(), expected.len(), "{found:?} {expected:?}");
    let differences = found.iter().zip(expected).map(|(a, b)| (a - b).abs());
    differences.fold(0.0, f64::max)
}

/// Largest relative difference of two lists of the same length.
pub fn relative(found: &[f64], expected: &[f64]) -> f64 {
    assert_eq!(found.len(), expected.len(), "{found:?} {expected:?}");
    let differences = found.iter().zip(expected).map(|(a, b)| (a / b - 1.0).abs());
    differences.fold(0.0, f64::max)
}

pub fn servicer() -> Model {
    let text = include_str!("../../../../urdf/servicer.urdf");
    Model::from_urdf(text, "servicer.urdf").unwrap()
}

/// The servicer with its joints locked at `q`: one body.
pub fn locked_servicer(q: &[f64]) -> Model {
    use fuyu_physics::dynamics::Workspace;
    use fuyu_physics::model::ModelBuilder;
    let model = servicer();
    let mut workspace = Workspace::new(&model);
    workspace.set_positions(&DVector::from_row_slice(q));
    let mut inertia = model.bodies()[0].inertia;
    for body in &model.bodies()[1..] {
        let X_BF = workspace.X_BF(model.frame(&body.name).unwrap());
        inertia = inertia.merged_with(&body.inertia.expressed_in(&X_BF));
    }
    ModelBuilder::new("locked", "base_link", inertia).build()
}

pub fn strip(second_order: bool) -> PlateStrip {
    PlateStrip {
        length: 8.0,
        width: 2.0,
        areal_mass: 3.0,
        EI: 3000.0,
        GJ: 800.0,
        bending_modes: 3,
        torsion_modes: 1,
        damping: 0.005,
        second_order,
    }
}

/// Poses of the two panels on the base at array angle `alpha`.
pub fn mounts(alpha: f64) -> [(&'static str, Pose); 2] {
    let turn = Rotation3::from_axis_angle(&Vector3::x_axis(), alpha);
    let back = Rotation3::from_axis_angle(&Vector3::z_axis(), std::f64::consts::PI);
    let at = |x: f64, R: Rotation3<f64>| Pose::from_parts(Translation3::new(x, 0.0, 0.0), R);
    [
        ("solar_plus", at(1.2, turn)),
        ("solar_minus", at(-1.2, turn * back)),
    ]
}

/// `model` with two panels on its base.
pub fn with_panels(model: &Model, panel: &Appendage, alpha: f64) -> FlexibleBuilder {
    let base = model.frame("base_link").unwrap();
    let mut builder = FlexibleSystem::builder(model);
    for (name, X_FA) in mounts(alpha) {
        let mut panel = panel.clone();
        name.clone_into(&mut panel.name);
        builder = builder.appendage(base, X_FA, panel);
    }
    builder
}

pub fn panel(second_order: bool) -> Appendage {
    strip(second_order).appendage("panel").unwrap()
}

/// The servicer with two panels of four modes.
pub fn servicer_with_panels(alpha: f64) -> FlexibleSystem {
    with_panels(&servicer(), &panel(false), alpha)
        .build()
        .unwrap()
}

/// Adds wheels about the base's axes, with a momentum limit of 100 N m s.
pub fn with_wheels(
    mut builder: FlexibleBuilder,
    model: &Model,
    max_torque: f64,
) -> FlexibleBuilder {
    let base = model.frame("base_link").unwrap();
    for (name, axis) in [
        ("x", Vector3::x_axis()),
        ("y", Vector3::y_axis()),
        ("z", Vector3::z_axis()),
    ] {
        let mut wheel = Wheel::new(name, axis, 0.2);
        (wheel.max_torque, wheel.max_momentum) = (max_torque, 100.0);
        builder = builder.wheel(base, wheel);
    }
    builder
}

/// The servicer with panels, and wheels of at most `max_torque`.
pub fn servicer_with_wheels_of(alpha: f64, max_torque: f64) -> FlexibleSystem {
    let model = servicer();
    let builder = with_panels(&model, &panel(false), alpha);
    with_wheels(builder, &model, max_torque).build().unwrap()
}

/// The servicer with panels and wheels of 4 N m.
pub fn servicer_with_wheels(alpha: f64) -> FlexibleSystem {
    servicer_with_wheels_of(alpha, 4.0)
}

/// The same with twelve thrusters of 2 N and 20 ms, which make couples about the base's axes.
pub fn servicer_with_wheels_and_thrusters() -> FlexibleSystem {
    let model = servicer();
    let base = model.frame("base_link").unwrap();
    let mut builder = with_wheels(with_panels(&model, &panel(false), 0.0), &model, 4.0);
    for axis in 0..3 {
        let (along, across) = ((axis + 1) % 3, (axis + 2) % 3);
        for (i, (side, sense)) in [(1.0, 1.0), (-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0)]
            .into_iter()
            .enumerate()
        {
            let mut position = Vector3::zeros();
            position[along] = side;
            let mut direction = Vector3::zeros();
            direction[across] = sense;
            let thruster = Thruster {
                name: format!("{}{i}", ["x", "y", "z"][axis]),
                position,
                direction: Unit::new_normalize(direction),
                thrust: 2.0,
                min_on_time: 0.02,
            };
            builder = builder.thruster(base, thruster);
        }
    }
    builder.build().unwrap()
}

/// Efforts of the fixtures' runs at `t`, scaled, with damping by the rates `qd`.
pub fn efforts(scale: f64, t: f64, qd: &[f64], out: &mut DVector<f64>) {
    for (j, effort) in out.iter_mut().enumerate() {
        let wave = (std::f64::consts::TAU * t / PERIOD[j]).sin();
        *effort = scale * AMP[j] * wave - DAMPING[j] * qd[j];
    }
}

/// The state of sample `i` of a fixture's run. Missing entries are zero.
pub fn sample(system: &FlexibleSystem, run: &Value, i: usize) -> FlexibleState {
    let dof = system.model().dof();
    let q = numbers(&run["q"][i]);
    let mut state = FlexibleState::at_rest_with(system, &DVector::from_row_slice(&q[..dof]));
    if dof > 0 {
        state.tree.qd = DVector::from_vec(numbers(&run["qd"][i]));
    }
    state.mu_mut().copy_from_slice(&numbers(&run["mu"][i]));
    state.mu_dot_mut().copy_from_slice(&numbers(&run["mud"][i]));
    if !run["wheel_speed_relative"].is_null() {
        let speeds = numbers(&run["wheel_speed_relative"][i]);
        state.wheel_speeds_mut().copy_from_slice(&speeds);
    }
    let R_WB = quaternion(&run["base_quaternion_xyzw"][i]);
    let p = vector(&run["base_position"][i]);
    let X_WB = Pose::from_parts(Translation3::from(p), R_WB.to_rotation_matrix());
    let w = vector(&run["base_angular_velocity_world"][i]);
    let v = vector(&run["base_velocity_world"][i]);
    let V = Twist::new(
        R_WB.inverse_transform_vector(&w),
        R_WB.inverse_transform_vector(&v),
    );
    state.set_base(&mut FlexibleWorkspace::new(system), &X_WB, &V);
    state
}

/// Angle between the attitude of `state` and that of the fixture \[rad\].
pub fn attitude_error(state: &FlexibleState, expected: &Value) -> f64 {
    let expected = quaternion(expected);
    // Half the angle is the norm of the difference of the quaternions, to third order.
    let (a, b) = (state.tree.R_WB.coords, expected.coords);
    2.0 * (a - b).norm().min((a + b).norm())
}

/// Uniform random numbers in (-1, 1), the same in every run (Knuth's linear congruential generator).
pub struct Random(u64);

impl Random {
    pub fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1)
    }

    pub fn number(&mut self) -> f64 {
        self.0 = (self.0)
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    pub fn vector(&mut self, scale: f64) -> Vector3<f64> {
        Vector3::from_fn(|_, _| scale * self.number())
    }

    /// A state with everything in motion.
    pub fn state(&mut self, system: &FlexibleSystem, deflection: f64) -> FlexibleState {
        let dof = system.model().dof();
        let q = DVector::from_fn(dof, |_, _| 2.0 * self.number());
        let mut state = FlexibleState::at_rest_with(system, &q);
        state.tree.qd = DVector::from_fn(dof, |_, _| 0.5 * self.number());
        state
            .mu_mut()
            .iter_mut()
            .for_each(|x| *x = deflection * self.number());
        state
            .mu_dot_mut()
            .iter_mut()
            .for_each(|x| *x = deflection * self.number());
        let wind_up: Vec<f64> = state
            .motor_angles()
            .iter()
            .map(|a| a + 0.02 * self.number())
            .collect();
        state.motor_angles_mut().copy_from_slice(&wind_up);
        state
            .motor_rates_mut()
            .iter_mut()
            .for_each(|x| *x = 0.5 * self.number());
        state
            .wheel_speeds_mut()
            .iter_mut()
            .for_each(|x| *x = 100.0 * self.number());
        let axis = self.vector(1.0);
        let R = Rotation3::from_scaled_axis(axis);
        let X_WB = Pose::from_parts(Translation3::from(self.vector(3.0)), R);
        let V = Twist::new(self.vector(0.3), self.vector(0.5));
        state.set_base(&mut FlexibleWorkspace::new(system), &X_WB, &V);
        state
    }
}
