//! Target of a dispersion: the parameter, and the dispersions that fit it.

use fuyu_campaign::{Covariance, Distribution};
use serde_json::Value;

use super::{
    dispersion::{Building, Draw, Turn},
    file::{Apply, DispersionFile, GridFile, Numbers, RotationFile},
    parameters::{Parameters, Place, length},
    values::{fit, numbers_of},
};
use crate::ros::ParameterValue;

/// Maximum number of values in a grid.
const LARGEST_GRID: u64 = 1_000_000;

/// The parameter that is dispersed.
pub(super) struct Target<'a> {
    nominal: &'a ParameterValue,
    /// Whether it is an element of a list.
    is_element: bool,
}

impl<'a> Target<'a> {
    pub fn new(place: &Place, parameters: &'a Parameters) -> Self {
        Self {
            nominal: parameters.nominal(place),
            is_element: place.element.is_some(),
        }
    }

    /// The only kind given in the file.
    pub fn kind(&self, file: &DispersionFile) -> Result<&'static str, String> {
        let given = [
            ("list", file.list.is_some()),
            ("grid", file.grid.is_some()),
            ("choice", file.choice.is_some()),
            ("uniform", file.uniform.is_some()),
            ("normal", file.normal.is_some()),
            ("truncated_normal", file.truncated_normal.is_some()),
            ("log_normal", file.log_normal.is_some()),
            ("integers", file.integers.is_some()),
            ("sphere", file.sphere.is_some()),
            ("rotation", file.rotation.is_some()),
        ];
        let kinds: Vec<_> = given
            .iter()
            .filter(|(_, is)| *is)
            .map(|(k, _)| *k)
            .collect();
        match kinds.as_slice() {
            [one] => Ok(one),
            [] => Err(format!(
                "give one of {}",
                given.map(|(kind, _)| kind).join(", ")
            )),
            several => Err(format!("{} are given; give one", several.join(" and "))),
        }
    }

    /// Number of elements of a whole list; `None` for a number or an element.
    fn elements(&self) -> Option<usize> {
        match self.is_element {
            true => None,
            false => length(self.nominal),
        }
    }

    /// Number of drawn numbers: one for a number, one per element for a list.
    fn count(&self, lists: &[Option<&Numbers>]) -> Result<usize, String> {
        let given = lists.iter().flatten().find_map(|numbers| numbers.count());
        let count = match (self.elements(), given) {
            (None, _) => 1,
            (Some(0), Some(given)) => given,
            (Some(0), None) => {
                return Err(
                    "the scenario's list is empty; give a list of numbers, one for each element"
                        .to_owned(),
                );
            }
            (Some(elements), _) => elements,
        };
        for numbers in lists.iter().flatten() {
            if let Some(given) = numbers.count().filter(|given| *given != count) {
                let of = match self.elements() {
                    None => "the parameter is one number".to_owned(),
                    Some(_) => format!("the parameter has {count}"),
                };
                return Err(format!("a list of {given} numbers is given, but {of}"));
            }
        }
        Ok(count)
    }

    /// The draw described by the file.
    ///
    /// # Errors
    /// The correct form.
    pub fn draw(
        &self,
        kind: &str,
        file: &DispersionFile,
        name: &str,
        building: &mut Building,
        index: usize,
    ) -> Result<Draw, String> {
        let text = |e: fuyu_campaign::SamplingError| e.to_string();
        let each = |count: usize, of: &dyn Fn(usize) -> Result<Distribution, String>| {
            (0..count).map(of).collect::<Result<_, _>>().map(Draw::Each)
        };
        match (kind, file) {
            (
                "list",
                DispersionFile {
                    list: Some(values), ..
                },
            ) => {
                let values = self.values(values)?;
                let count = values.len() as u64;
                match &building.list {
                    Some((other, length)) if *length != count => {
                        return Err(format!(
                            "the list has {count} values, but that of {other} has {length}; lists advance together, run by run"
                        ));
                    }
                    _ => building.list = Some((name.to_owned(), count)),
                }
                Ok(Draw::Listed { values, stride: 1 })
            }
            (
                "grid",
                DispersionFile {
                    grid: Some(grid), ..
                },
            ) => {
                let values = match grid {
                    GridFile::Values(values) => self.values(values)?,
                    GridFile::Range(range) => {
                        if range.count < 2 || range.count > LARGEST_GRID || range.min >= range.max {
                            return Err(format!(
                                "grid from {} to {} with {} values; give min below max, and a count of 2 to {LARGEST_GRID}",
                                range.min, range.max, range.count
                            ));
                        }
                        let last = (range.count - 1) as f64;
                        let value = |i: u64| match i == range.count - 1 {
                            true => range.max,
                            false => range.min + (range.max - range.min) * (i as f64 / last),
                        };
                        let values: Vec<_> =
                            (0..range.count).map(|i| Value::from(value(i))).collect();
                        self.values(&values)?
                    }
                };
                building.grids.push((index, values.len() as u64));
                Ok(Draw::Listed { values, stride: 1 })
            }
            (
                "choice",
                DispersionFile {
                    choice: Some(values),
                    ..
                },
            ) => self.values(values).map(Draw::Choice),
            (
                "uniform",
                DispersionFile {
                    uniform: Some(f), ..
                },
            ) => {
                let count = self.count(&[Some(&f.min), Some(&f.max)])?;
                each(count, &|i| {
                    Distribution::uniform(f.min.get(i), f.max.get(i)).map_err(text)
                })
            }
            (
                "normal",
                DispersionFile {
                    normal: Some(f), ..
                },
            ) => {
                let zero = Numbers::One(0.0);
                let mean = f.mean.as_ref().unwrap_or(&zero);
                match (&f.sigma, &f.covariance) {
                    (Some(sigma), None) => {
                        let count = self.count(&[Some(mean), Some(sigma)])?;
                        each(count, &|i| {
                            Distribution::normal(mean.get(i), sigma.get(i)).map_err(text)
                        })
                    }
                    (None, Some(matrix)) => {
                        let covariance = Covariance::new(matrix).map_err(text)?;
                        let rows = Numbers::Each(vec![0.0; covariance.dimensions()]);
                        let count = self.count(&[Some(&rows), Some(mean)])?;
                        let mean: Vec<_> = (0..count).map(|i| mean.get(i)).collect();
                        check_mean(&mean, count)?;
                        Ok(Draw::Correlated { mean, covariance })
                    }
                    _ => Err("normal needs sigma, or a covariance for a list".to_owned()),
                }
            }
            (
                "truncated_normal",
                DispersionFile {
                    truncated_normal: Some(f),
                    ..
                },
            ) => {
                let zero = Numbers::One(0.0);
                let mean = f.mean.as_ref().unwrap_or(&zero);
                let count =
                    self.count(&[Some(mean), Some(&f.sigma), f.min.as_ref(), f.max.as_ref()])?;
                if f.min.is_none() && f.max.is_none() {
                    return Err("truncated_normal needs min, max or both".to_owned());
                }
                let end = |numbers: &Option<Numbers>, i: usize, open: f64| {
                    numbers.as_ref().map_or(open, |n| n.get(i))
                };
                each(count, &|i| {
                    let min = end(&f.min, i, f64::NEG_INFINITY);
                    let max = end(&f.max, i, f64::INFINITY);
                    Distribution::truncated_normal(mean.get(i), f.sigma.get(i), min, max)
                        .map_err(text)
                })
            }
            (
                "log_normal",
                DispersionFile {
                    log_normal: Some(f),
                    ..
                },
            ) => {
                let count = self.count(&[Some(&f.median), Some(&f.sigma)])?;
                each(count, &|i| {
                    Distribution::log_normal(f.median.get(i), f.sigma.get(i)).map_err(text)
                })
            }
            (
                "integers",
                DispersionFile {
                    integers: Some(f), ..
                },
            ) => {
                let count = self.count(&[])?;
                each(count, &|_| {
                    Distribution::integers(f.min, f.max).map_err(text)
                })
            }
            (
                "sphere",
                DispersionFile {
                    sphere: Some(f), ..
                },
            ) => match f.radius > 0.0 && f.radius.is_finite() {
                true => Ok(Draw::Sphere(f.radius)),
                false => Err(format!("radius is {}; give a positive number", f.radius)),
            },
            (
                _,
                DispersionFile {
                    rotation: Some(f), ..
                },
            ) => turn(f).map(Draw::Rotation),
            _ => Err(format!("{kind} has no value")),
        }
    }

    /// Checks that the drawn quantity fits the parameter.
    pub fn check(&self, draw: &Draw, apply: Apply) -> Result<(), String> {
        let is_list = !self.is_element && length(self.nominal).is_some();
        let kind = self.nominal.kind();
        let is_double = matches!(
            self.nominal,
            ParameterValue::Double(_) | ParameterValue::DoubleArray(_)
        );
        let is_integer = matches!(
            self.nominal,
            ParameterValue::Integer(_) | ParameterValue::IntegerArray(_)
        );
        match draw {
            Draw::Listed { values, .. } | Draw::Choice(values) => {
                if apply != Apply::Set && values.iter().any(|v| numbers_of(v).is_none()) {
                    return Err(format!(
                        "apply is add or scale, but the parameter is {kind}"
                    ));
                }
                if is_integer && apply == Apply::Scale {
                    return Err("apply is scale, but the parameter is an integer".to_owned());
                }
                let lengths: Vec<_> = values.iter().map(length).collect();
                match lengths.windows(2).any(|pair| pair[0] != pair[1]) {
                    true => Err("the lists have different lengths".to_owned()),
                    false => Ok(()),
                }
            }
            Draw::Each(all) => {
                let whole = all.iter().all(Distribution::is_integer);
                match (is_double, is_integer) {
                    (false, false) => {
                        Err(format!("the parameter is {kind}; use list, grid or choice"))
                    }
                    (_, true) if !whole || apply == Apply::Scale => Err(
                        "the parameter is an integer; use integers, list, grid or choice"
                            .to_owned(),
                    ),
                    _ => Ok(()),
                }
            }
            Draw::Correlated { mean, .. } => match (is_double, is_list || mean.len() == 1) {
                (true, true) => Ok(()),
                _ => Err(format!(
                    "the parameter is {kind}; a covariance is for a list of doubles"
                )),
            },
            Draw::Sphere(_) | Draw::Rotation(_) => {
                let (needed, what) = match draw {
                    Draw::Sphere(_) => (3, "a sphere is for a list of 3 doubles"),
                    _ => (
                        4,
                        "a rotation is for a list of 4 doubles, a quaternion x, y, z, w",
                    ),
                };
                let found = length(self.nominal).unwrap_or(0);
                let fits = is_double && is_list && (found == needed || found == 0);
                if !fits {
                    let count = match is_list {
                        true => format!("a list of {found}"),
                        false => "no list".to_owned(),
                    };
                    return Err(format!("the parameter is {count}; {what}"));
                }
                match (draw, apply, found) {
                    (Draw::Rotation(_), Apply::Scale, _) => {
                        Err("apply is scale; a rotation is set or added".to_owned())
                    }
                    (Draw::Rotation(_), Apply::Add, 0) => {
                        Err("apply is add, but the scenario's list is empty".to_owned())
                    }
                    _ => Ok(()),
                }
            }
        }
    }

    /// Values of the file, converted to the parameter's type.
    fn values(&self, values: &[Value]) -> Result<Vec<ParameterValue>, String> {
        if values.is_empty() {
            return Err("there are no values".to_owned());
        }
        let fitted = values.iter().map(|v| fit(v, self.nominal, self.is_element));
        fitted.collect()
    }
}

/// A mean must have a finite number for each row of the covariance.
pub(super) fn check_mean(mean: &[f64], count: usize) -> Result<(), String> {
    if mean.len() != count {
        return Err(format!(
            "mean has {} numbers for {count} rows of the covariance",
            mean.len()
        ));
    }
    match mean.iter().find(|x| !x.is_finite()) {
        Some(x) => Err(format!("mean has {x}; give finite numbers")),
        None => Ok(()),
    }
}

fn turn(file: &RotationFile) -> Result<Turn, String> {
    let positive = |name: &str, value: f64| match value > 0.0 && value.is_finite() {
        true => Ok(value),
        false => Err(format!(
            "{name} is {value}; give a positive number of radians"
        )),
    };
    match (file.max_angle, file.sigma) {
        (None, None) => Ok(Turn::Uniform),
        (Some(angle), None) => positive("max_angle", angle).map(Turn::Within),
        (None, Some(sigma)) => {
            let normal = Distribution::normal(0.0, positive("sigma", sigma)?);
            normal.map(Turn::Normal).map_err(|e| e.to_string())
        }
        (Some(_), Some(_)) => Err("max_angle and sigma are given; give one".to_owned()),
    }
}
