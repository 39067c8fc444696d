//! Robots and numbers that the other modules test with.

use fuyu::model::{JointKind, Model, ModelBuilder};
use fuyu::spatial::{Pose, RigidInertia};
use nalgebra::{DVector, Matrix3, Rotation3, Translation3, Unit, Vector3};
use serde_json::Value;

/// The servicer of Masutani 1995 Fig. 5.2, from its URDF.
pub fn servicer() -> Model {
    let xml = include_str!("../../urdf/servicer.urdf");
    Model::from_urdf(xml, "urdf/servicer.urdf").expect("the servicer is well formed")
}

/// Joint positions in degrees, as the thesis prints them.
pub fn degrees(values: &[f64]) -> DVector<f64> {
    DVector::from_iterator(values.len(), values.iter().map(|x| x.to_radians()))
}

/// A JSON array of numbers.
pub fn numbers(value: &Value) -> Vec<f64> {
    let items = value.as_array().expect("an array");
    items
        .iter()
        .map(|x| x.as_f64().expect("a number"))
        .collect()
}

/// A JSON array of three numbers.
pub fn vector(value: &Value) -> Vector3<f64> {
    Vector3::from_row_slice(&numbers(value))
}

/// A JSON matrix as rows.
pub fn rows(value: &Value) -> Vec<Vec<f64>> {
    value
        .as_array()
        .expect("rows")
        .iter()
        .map(numbers)
        .collect()
}

/// A JSON 3 × 3 matrix.
pub fn matrix3(value: &Value) -> Matrix3<f64> {
    Matrix3::from_row_slice(&rows(value).concat())
}

/// A rotation printed to 16 digits.
pub fn rotation(value: &Value) -> Rotation3<f64> {
    Rotation3::from_matrix_unchecked(matrix3(value))
}

/// Cases of `gjm.json`: free-floating trees with every quantity computed by Pinocchio.
pub struct Case {
    pub data: Value,
    pub model: Model,
    /// Position of each of the file's links in the model's joint order (the model is depth first).
    pub order: Vec<usize>,
}

impl Case {
    pub fn all() -> Vec<Self> {
        let file: Value = serde_json::from_str(include_str!("fixtures/gjm.json")).unwrap();
        file["cases"]
            .as_array()
            .unwrap()
            .iter()
            .map(|data| Self::new(data.clone()))
            .collect()
    }

    fn new(data: Value) -> Self {
        let base = RigidInertia {
            mass: data["base"]["m"].as_f64().unwrap(),
            com: Vector3::zeros(),
            about_com: matrix3(&data["base"]["I"]),
        };
        let mut builder = ModelBuilder::new("case", "base_link", base);
        let links = data["links"].as_array().unwrap().clone();
        let mut order = vec![usize::MAX; links.len()];
        let mut count = 0;
        let tip = (
            data["ee"]["link"].as_u64().unwrap() as usize,
            pose(&data["ee"], "R", "p"),
        );
        grow(&mut builder, &links, -1, 0, &mut order, &mut count, &tip);
        Self {
            model: builder.build(),
            data,
            order,
        }
    }

    /// A joint vector of the file in the model's order.
    pub fn joint_vector(&self, key: &str) -> DVector<f64> {
        let values = numbers(&self.data[key]);
        let mut out = DVector::zeros(values.len());
        for (link, &j) in self.order.iter().enumerate() {
            out[j] = values[link];
        }
        out
    }
}

fn pose(value: &Value, rotation_key: &str, position_key: &str) -> Pose {
    Pose::from_parts(
        Translation3::from(vector(&value[position_key])),
        rotation(&value[rotation_key]),
    )
}

fn grow(
    builder: &mut ModelBuilder,
    links: &[Value],
    parent: i64,
    parent_body: usize,
    order: &mut [usize],
    count: &mut usize,
    tip: &(usize, Pose),
) {
    for (k, link) in links
        .iter()
        .enumerate()
        .filter(|(_, l)| l["parent"].as_i64() == Some(parent))
    {
        let kind = if link["type"] == "P" {
            JointKind::Prismatic
        } else {
            JointKind::Continuous
        };
        let inertia = RigidInertia {
            mass: link["m"].as_f64().unwrap(),
            com: vector(&link["c"]),
            about_com: matrix3(&link["I"]),
        };
        let axis = Unit::new_normalize(vector(&link["axis"]));
        let name = format!("link{k}");
        let body = builder.body(
            &name,
            parent_body,
            kind,
            axis,
            pose(link, "R0", "p0"),
            inertia,
        );
        order[k] = *count;
        *count += 1;
        if k == tip.0 {
            builder.frame("tip", body, Some(name), tip.1);
        }
        grow(builder, links, k as i64, body, order, count, tip);
    }
}
