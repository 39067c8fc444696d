//! Joint values on the command line: for all joints in order, or for some by name.

use nalgebra::DVector;

use super::{Failure, Numbers};
use crate::model::Model;

/// Values given as `1,-2,3e-1`, or as `elbow=1,wrist=-2`.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum JointValues {
    /// Values for all joints, in their order.
    All(Vec<f64>),
    /// Values for the joints with these names.
    Named(Vec<(String, f64)>),
}

impl std::str::FromStr for JointValues {
    type Err = String;

    fn from_str(list: &str) -> Result<Self, String> {
        if !list.contains('=') {
            let Numbers(values) = list.parse()?;
            return Ok(Self::All(values));
        }
        let named = |word: &str| {
            // Names of joints may contain an equals sign.
            let pair = word.rsplit_once('=');
            let value = pair.and_then(|(name, value)| Some((name, value.trim().parse().ok()?)));
            match value.filter(|(_, value): &(&str, f64)| value.is_finite()) {
                Some((name, value)) => Ok((name.trim().to_owned(), value)),
                None => Err(format!(
                    "'{word}' is not NAME=NUMBER; give all values by name, or none"
                )),
            }
        };
        list.split(',')
            .map(named)
            .collect::<Result<_, _>>()
            .map(Self::Named)
    }
}

/// The values of all joints; joints without a value get zero.
///
/// # Errors
/// [`Failure::Input`] for a wrong number of values, or a name that is unknown, repeated, or that of a mimic joint.
pub(super) fn vector(
    option: &str,
    values: Option<&JointValues>,
    model: &Model,
) -> Result<DVector<f64>, Failure> {
    let names = || {
        let names: Vec<&str> = model.joints().iter().map(|j| j.name.as_str()).collect();
        names.join(", ")
    };
    let n = model.dof();
    match values {
        None => Ok(DVector::zeros(n)),
        Some(JointValues::All(values)) if values.len() == n => {
            Ok(DVector::from_column_slice(values))
        }
        Some(_) if n == 0 => Err(Failure::Input(format!(
            "{option} has values, but the robot has no moving joint"
        ))),
        Some(JointValues::All(values)) => Err(Failure::Input(format!(
            "{option} has {} of {n} values; give one for each moving joint: {}",
            values.len(),
            names()
        ))),
        Some(JointValues::Named(named)) => {
            let mut vector = DVector::from_element(n, None);
            for (name, value) in named {
                let fail = |problem: String| Failure::Input(format!("{option} {name}: {problem}"));
                let Some(j) = model.joint_index(name) else {
                    let mut mimics = model.mimics();
                    return Err(match mimics.find(|m| m.joint.name == *name) {
                        Some(mimic) => {
                            let leader = &model.joints()[mimic.coupling.coordinate].name;
                            fail(format!(
                                "a mimic joint; give the joint that it follows, {leader}"
                            ))
                        }
                        None => fail(format!(
                            "no moving joint; the moving joints are {}",
                            names()
                        )),
                    });
                };
                if vector[j].replace(*value).is_some() {
                    return Err(fail("given twice".to_owned()));
                }
            }
            Ok(vector.map(Option::unwrap_or_default))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn model() -> Model {
        let xml = include_str!("../../urdf/planar_two_link.urdf");
        Model::from_urdf(xml, "planar").unwrap()
    }

    fn parse(text: &str) -> Result<Vec<f64>, String> {
        let values = text.parse::<JointValues>()?;
        let vector = vector("--q", Some(&values), &model());
        vector
            .map(|v| v.as_slice().to_vec())
            .map_err(|e| e.to_string())
    }

    #[test]
    fn values_are_given_in_order_or_by_name() {
        let [first, second] = [0, 1].map(|j| model().joints()[j].name.clone());
        assert_eq!(parse("1,-2e-1").unwrap(), [1.0, -0.2]);
        assert_eq!(parse(&format!("{second}=-2")).unwrap(), [0.0, -2.0]);
        assert_eq!(
            parse(&format!("{second}=3, {first}=1")).unwrap(),
            [1.0, 3.0]
        );
        for (text, says) in [
            (format!("{first}=1,2"), "'2' is not NAME=NUMBER"),
            (format!("{first}=inf"), "is not NAME=NUMBER"),
            (format!("{first}=1,{first}=1"), "given twice"),
            (
                "nose=1".to_owned(),
                "--q nose: no moving joint; the moving joints are",
            ),
            ("1".to_owned(), "--q has 1 of 2 values"),
            ("1,x".to_owned(), "'x' is not a finite number"),
        ] {
            let error = parse(&text).unwrap_err();
            assert!(error.contains(says), "{error}");
        }
    }
}
