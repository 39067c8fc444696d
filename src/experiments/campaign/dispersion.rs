//! Dispersions: how the parameters of a run are drawn.

use fuyu_campaign::{
    Covariance, Design, Distribution, compose, on_sphere, rotation_from_vector, rotation_within,
    uniform_rotation,
};
use serde_json::Value;

use super::{
    file::{Apply, CorrelatedFile, DispersionFile, GridFile, Numbers, RotationFile},
    parameters::{Changes, Parameters, Place, length},
};
use crate::ros::ParameterValue;

/// Most values of a grid.
const LARGEST_GRID: u64 = 1_000_000;

/// How one parameter, or several correlated numbers, are drawn.
#[derive(Clone)]
pub(super) struct Dispersion {
    /// One whole parameter or element; of a correlated dispersion a place for each number.
    pub places: Vec<Place>,
    apply: Apply,
    /// Its first coordinate in the design.
    first: usize,
    draw: Draw,
}

#[derive(Clone)]
enum Draw {
    /// The values in turn, each for `stride` runs.
    Listed {
        values: Vec<ParameterValue>,
        stride: u64,
    },
    /// One of them at random.
    Choice(Vec<ParameterValue>),
    /// A number for each element.
    Each(Vec<Distribution>),
    Correlated {
        mean: Vec<f64>,
        covariance: Covariance,
    },
    /// A vector of this length, uniform on the sphere.
    Sphere(f64),
    Rotation(Turn),
}

#[derive(Clone, Copy)]
enum Turn {
    Uniform,
    /// By at most this angle \[rad\].
    Within(f64),
    /// About a normal vector with this standard deviation of each component \[rad\].
    Normal(Distribution),
}

/// What dispersions share while they are built.
#[derive(Default)]
pub(super) struct Building {
    /// Names of the coordinates.
    pub coordinates: Vec<String>,
    /// Length of the lists, which advance together.
    list: Option<(String, u64)>,
    /// Dispersions that belong to grids, with their numbers of values.
    grids: Vec<(usize, u64)>,
}

impl Building {
    /// Number of runs after which lists and grids repeat; sets how long the values of grids last: the last grid varies
    /// fastest, after the lists.
    pub fn finish(&self, dispersions: &mut [Dispersion]) -> Result<Option<u64>, String> {
        let mut total = self.list.as_ref().map_or(1, |(_, length)| *length);
        for (index, count) in self.grids.iter().rev() {
            if let Draw::Listed { stride, .. } = &mut dispersions[*index].draw {
                *stride = total;
            }
            total = total.checked_mul(*count).filter(|n| *n < 1 << 40).ok_or(
                "the grids have more than 10^12 combinations; use fewer values, or latin_hypercube",
            )?;
        }
        Ok((self.list.is_some() || !self.grids.is_empty()).then_some(total))
    }
}

impl Dispersion {
    /// The dispersion of the parameter `name`.
    ///
    /// # Errors
    /// A line with the parameter, and what would be right.
    pub fn new(
        name: &str,
        file: &DispersionFile,
        parameters: &Parameters,
        building: &mut Building,
        index: usize,
    ) -> Result<Self, String> {
        let place = parameters.find(name)?;
        let at = |e: String| format!("dispersion of {name}: {e}");
        let target = Target::new(&place, parameters);
        let kind = target.kind(file).map_err(at)?;
        let first = building.coordinates.len();
        let draw = target.draw(kind, file, name, building, index).map_err(at)?;
        target.check(&draw, file.apply).map_err(at)?;
        let drawn = draw.dimensions();
        let own = (0..drawn).map(|i| match drawn {
            1 => name.to_owned(),
            _ => format!("{name}[{i}]"),
        });
        building.coordinates.extend(own);
        Ok(Self {
            places: vec![place],
            apply: file.apply,
            first,
            draw,
        })
    }

    /// Numbers with a covariance.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn correlated(
        file: &CorrelatedFile,
        parameters: &Parameters,
        building: &mut Building,
    ) -> Result<Self, String> {
        let at = |e: String| format!("correlated {}: {e}", file.parameters.join(", "));
        let n = file.parameters.len();
        let covariance = Covariance::new(&file.covariance).map_err(|e| at(e.to_string()))?;
        if covariance.dimensions() != n {
            let rows = covariance.dimensions();
            return Err(at(format!("covariance has {rows} rows for {n} parameters")));
        }
        let mean = file.mean.clone().unwrap_or_else(|| vec![0.0; n]);
        check_mean(&mean, n).map_err(at)?;
        let places = file.parameters.iter().map(|name| {
            let place = parameters.find(name)?;
            match (parameters.nominal(&place), place.element) {
                (ParameterValue::Double(_), _) | (ParameterValue::DoubleArray(_), Some(_)) => {
                    Ok(place)
                }
                (value, _) => Err(at(format!(
                    "{name} is {}; give doubles, or elements as in {name}[0]",
                    value.kind()
                ))),
            }
        });
        let places = places.collect::<Result<Vec<_>, String>>()?;
        let first = building.coordinates.len();
        building.coordinates.extend(file.parameters.iter().cloned());
        Ok(Self {
            places,
            apply: file.apply,
            first,
            draw: Draw::Correlated { mean, covariance },
        })
    }

    /// Number of elements that a whole list has after it.
    pub fn length(&self, parameters: &Parameters) -> Option<usize> {
        let place = &self.places[0];
        if place.element.is_some() || self.places.len() > 1 {
            return None;
        }
        let nominal = length(parameters.nominal(place))?;
        Some(match &self.draw {
            Draw::Listed { values, .. } | Draw::Choice(values) => {
                values.first().and_then(length).unwrap_or(nominal)
            }
            Draw::Each(all) => all.len(),
            Draw::Correlated { mean, .. } => mean.len(),
            Draw::Sphere(_) => 3,
            Draw::Rotation(_) => 4,
        })
    }

    /// Draws for a run and changes the parameters.
    pub fn change(&self, run: u64, design: &Design, parameters: &Parameters, changes: &mut Changes) {
        let u = |k: usize| design.coordinate(run, self.first + k);
        let numbers: Vec<f64> = match &self.draw {
            Draw::Listed { values, stride } => {
                let at = (run / stride) % values.len() as u64;
                return self.put_value(&values[at as usize], parameters, changes);
            }
            Draw::Choice(values) => {
                let at = (u(0) * values.len() as f64) as usize;
                let value = &values[at.min(values.len() - 1)];
                return self.put_value(value, parameters, changes);
            }
            Draw::Each(all) => (all.iter().enumerate()).map(|(k, d)| d.quantile(u(k))).collect(),
            Draw::Correlated { mean, covariance } => {
                let numbers: Vec<_> = (0..mean.len()).map(u).collect();
                let deviations = covariance.deviations(&numbers);
                mean.iter().zip(deviations).map(|(m, d)| m + d).collect()
            }
            Draw::Sphere(radius) => on_sphere([u(0), u(1)]).map(|x| radius * x).to_vec(),
            Draw::Rotation(turn) => {
                let u = [u(0), u(1), u(2)];
                let drawn = match turn {
                    Turn::Uniform => uniform_rotation(u),
                    Turn::Within(largest) => rotation_within(u, *largest),
                    Turn::Normal(normal) => rotation_from_vector(u.map(|u| normal.quantile(u))),
                };
                let value = current(&self.places[0], parameters, changes);
                if let (Apply::Add, ParameterValue::DoubleArray(v)) = (self.apply, &*value)
                    && let Ok(nominal) = <[f64; 4]>::try_from(v.as_slice())
                {
                    *value = ParameterValue::DoubleArray(compose(nominal, drawn).to_vec());
                } else {
                    *value = ParameterValue::DoubleArray(drawn.to_vec());
                }
                return;
            }
        };
        if self.places.len() > 1 {
            for (place, number) in self.places.iter().zip(numbers) {
                put_numbers(place, &[number], self.apply, parameters, changes);
            }
        } else {
            put_numbers(&self.places[0], &numbers, self.apply, parameters, changes);
        }
    }

    /// Puts a listed value, which fits the parameter.
    fn put_value(&self, value: &ParameterValue, parameters: &Parameters, changes: &mut Changes) {
        let place = &self.places[0];
        match (self.apply, numbers_of(value)) {
            (Apply::Add | Apply::Scale, Some(numbers)) => {
                put_numbers(place, &numbers, self.apply, parameters, changes);
            }
            _ => put_whole(place, value, parameters, changes),
        }
    }
}

impl Draw {
    /// Number of coordinates that it needs.
    fn dimensions(&self) -> usize {
        match self {
            Self::Listed { .. } => 0,
            Self::Choice(_) => 1,
            Self::Each(all) => all.len(),
            Self::Correlated { mean, .. } => mean.len(),
            Self::Sphere(_) => 2,
            Self::Rotation(_) => 3,
        }
    }
}

/// The parameter that is dispersed.
struct Target<'a> {
    nominal: &'a ParameterValue,
    /// Whether it is an element of a list.
    is_element: bool,
}

impl<'a> Target<'a> {
    fn new(place: &Place, parameters: &'a Parameters) -> Self {
        Self {
            nominal: parameters.nominal(place),
            is_element: place.element.is_some(),
        }
    }

    /// The one kind that the file gives.
    fn kind(&self, file: &DispersionFile) -> Result<&'static str, String> {
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
        let kinds: Vec<_> = given.iter().filter(|(_, is)| *is).map(|(k, _)| *k).collect();
        match kinds.as_slice() {
            [one] => Ok(one),
            [] => Err(format!(
                "give one of {}",
                given.map(|(kind, _)| kind).join(", ")
            )),
            several => Err(format!("{} are given; give one", several.join(" and "))),
        }
    }

    /// Number of elements of a whole list, otherwise `None`.
    fn elements(&self) -> Option<usize> {
        match self.is_element {
            true => None,
            false => length(self.nominal),
        }
    }

    /// How many numbers are drawn: one for a number, one for each element of a list.
    fn count(&self, lists: &[Option<&Numbers>]) -> Result<usize, String> {
        let given = lists.iter().flatten().find_map(|numbers| numbers.count());
        let count = match (self.elements(), given) {
            (None, _) => 1,
            (Some(0), Some(given)) => given,
            (Some(0), None) => {
                return Err("the scenario's list is empty; give a list of numbers, one for each element".to_owned());
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

    fn draw(
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
            ("list", DispersionFile { list: Some(values), .. }) => {
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
            ("grid", DispersionFile { grid: Some(grid), .. }) => {
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
                        let values: Vec<_> = (0..range.count).map(|i| Value::from(value(i))).collect();
                        self.values(&values)?
                    }
                };
                building.grids.push((index, values.len() as u64));
                Ok(Draw::Listed { values, stride: 1 })
            }
            ("choice", DispersionFile { choice: Some(values), .. }) => {
                self.values(values).map(Draw::Choice)
            }
            ("uniform", DispersionFile { uniform: Some(f), .. }) => {
                let count = self.count(&[Some(&f.min), Some(&f.max)])?;
                each(count, &|i| Distribution::uniform(f.min.get(i), f.max.get(i)).map_err(text))
            }
            ("normal", DispersionFile { normal: Some(f), .. }) => {
                let zero = Numbers::One(0.0);
                let mean = f.mean.as_ref().unwrap_or(&zero);
                match (&f.sigma, &f.covariance) {
                    (Some(sigma), None) => {
                        let count = self.count(&[Some(mean), Some(sigma)])?;
                        each(count, &|i| Distribution::normal(mean.get(i), sigma.get(i)).map_err(text))
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
            ("truncated_normal", DispersionFile { truncated_normal: Some(f), .. }) => {
                let zero = Numbers::One(0.0);
                let mean = f.mean.as_ref().unwrap_or(&zero);
                let count = self.count(&[Some(mean), Some(&f.sigma), f.min.as_ref(), f.max.as_ref()])?;
                if f.min.is_none() && f.max.is_none() {
                    return Err("truncated_normal needs min, max or both".to_owned());
                }
                let end = |numbers: &Option<Numbers>, i: usize, open: f64| {
                    numbers.as_ref().map_or(open, |n| n.get(i))
                };
                each(count, &|i| {
                    let min = end(&f.min, i, f64::NEG_INFINITY);
                    let max = end(&f.max, i, f64::INFINITY);
                    Distribution::truncated_normal(mean.get(i), f.sigma.get(i), min, max).map_err(text)
                })
            }
            ("log_normal", DispersionFile { log_normal: Some(f), .. }) => {
                let count = self.count(&[Some(&f.median), Some(&f.sigma)])?;
                each(count, &|i| Distribution::log_normal(f.median.get(i), f.sigma.get(i)).map_err(text))
            }
            ("integers", DispersionFile { integers: Some(f), .. }) => {
                let count = self.count(&[])?;
                each(count, &|_| Distribution::integers(f.min, f.max).map_err(text))
            }
            ("sphere", DispersionFile { sphere: Some(f), .. }) => {
                match f.radius > 0.0 && f.radius.is_finite() {
                    true => Ok(Draw::Sphere(f.radius)),
                    false => Err(format!("radius is {}; give a positive number", f.radius)),
                }
            }
            (_, DispersionFile { rotation: Some(f), .. }) => turn(f).map(Draw::Rotation),
            _ => Err(format!("{kind} has no value")),
        }
    }

    /// Whether what is drawn fits the parameter.
    fn check(&self, draw: &Draw, apply: Apply) -> Result<(), String> {
        let is_list = !self.is_element && length(self.nominal).is_some();
        let kind = self.nominal.kind();
        let is_double = matches!(self.nominal, ParameterValue::Double(_) | ParameterValue::DoubleArray(_));
        let is_integer = matches!(self.nominal, ParameterValue::Integer(_) | ParameterValue::IntegerArray(_));
        match draw {
            Draw::Listed { values, .. } | Draw::Choice(values) => {
                if apply != Apply::Set && values.iter().any(|v| numbers_of(v).is_none()) {
                    return Err(format!("apply is add or scale, but the parameter is {kind}"));
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
                    (false, false) => Err(format!(
                        "the parameter is {kind}; use list, grid or choice"
                    )),
                    (_, true) if !whole || apply == Apply::Scale => Err(
                        "the parameter is an integer; use integers, list, grid or choice".to_owned(),
                    ),
                    _ => Ok(()),
                }
            }
            Draw::Correlated { mean, .. } => match (is_double, is_list || mean.len() == 1) {
                (true, true) => Ok(()),
                _ => Err(format!("the parameter is {kind}; a covariance is for a list of doubles")),
            },
            Draw::Sphere(_) | Draw::Rotation(_) => {
                let (needed, what) = match draw {
                    Draw::Sphere(_) => (3, "a sphere is for a list of 3 doubles"),
                    _ => (4, "a rotation is for a list of 4 doubles, a quaternion x, y, z, w"),
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

    /// Values of the file as the parameter's type.
    fn values(&self, values: &[Value]) -> Result<Vec<ParameterValue>, String> {
        if values.is_empty() {
            return Err("there are no values".to_owned());
        }
        let fitted = values.iter().map(|v| fit(v, self.nominal, self.is_element));
        fitted.collect()
    }
}

fn check_mean(mean: &[f64], count: usize) -> Result<(), String> {
    if mean.len() != count {
        return Err(format!("mean has {} numbers for {count} rows of the covariance", mean.len()));
    }
    match mean.iter().find(|x| !x.is_finite()) {
        Some(x) => Err(format!("mean has {x}; give finite numbers")),
        None => Ok(()),
    }
}

fn turn(file: &RotationFile) -> Result<Turn, String> {
    let positive = |name: &str, value: f64| match value > 0.0 && value.is_finite() {
        true => Ok(value),
        false => Err(format!("{name} is {value}; give a positive number of radians")),
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

/// A value of the file as the type of `like`, or of an element of it.
pub(super) fn fit(value: &Value, like: &ParameterValue, is_element: bool) -> Result<ParameterValue, String> {
    use ParameterValue as P;
    fn all<T>(value: &Value, one: impl Fn(&Value) -> Option<T>) -> Option<Vec<T>> {
        value.as_array()?.iter().map(one).collect()
    }
    let double = |v: &Value| v.as_f64();
    let text = |v: &Value| v.as_str().map(str::to_owned);
    let byte = |v: &Value| u8::try_from(v.as_u64()?).ok();
    let fitted = match (like, is_element) {
        (P::NotSet, _) => None,
        (P::Bool(_), _) | (P::BoolArray(_), true) => value.as_bool().map(P::Bool),
        (P::Integer(_), _) | (P::IntegerArray(_) | P::ByteArray(_), true) => value.as_i64().map(P::Integer),
        (P::Double(_), _) | (P::DoubleArray(_), true) => double(value).map(P::Double),
        (P::String(_), _) | (P::StringArray(_), true) => text(value).map(P::String),
        (P::ByteArray(_), false) => all(value, byte).map(P::ByteArray),
        (P::BoolArray(_), false) => all(value, Value::as_bool).map(P::BoolArray),
        (P::IntegerArray(_), false) => all(value, Value::as_i64).map(P::IntegerArray),
        (P::DoubleArray(_), false) => all(value, double).map(P::DoubleArray),
        (P::StringArray(_), false) => all(value, text).map(P::StringArray),
    };
    fitted.ok_or_else(|| {
        let kind = like.kind();
        match is_element {
            true => format!("{value} does not fit an element of {kind}"),
            false => format!("{value} is given, expected {kind}"),
        }
    })
}

/// The numbers of a value, if it has numbers.
fn numbers_of(value: &ParameterValue) -> Option<Vec<f64>> {
    match value {
        ParameterValue::Integer(i) => Some(vec![*i as f64]),
        ParameterValue::Double(x) => Some(vec![*x]),
        ParameterValue::IntegerArray(v) => Some(v.iter().map(|i| *i as f64).collect()),
        ParameterValue::DoubleArray(v) => Some(v.clone()),
        _ => None,
    }
}

/// The value of a parameter as it is now, to change it.
fn current<'a>(place: &Place, parameters: &Parameters, changes: &'a mut Changes) -> &'a mut ParameterValue {
    let key = (place.node, place.parameter.clone());
    changes.entry(key).or_insert_with(|| parameters.nominal(place).clone())
}

/// Replaces a parameter or an element.
pub(super) fn put_whole(place: &Place, value: &ParameterValue, parameters: &Parameters, changes: &mut Changes) {
    use ParameterValue as P;
    let now = current(place, parameters, changes);
    let Some(element) = place.element else {
        *now = value.clone();
        return;
    };
    match (now, value) {
        (P::BoolArray(v), P::Bool(x)) => v[element] = *x,
        (P::IntegerArray(v), P::Integer(x)) => v[element] = *x,
        // A byte was checked to be one when the campaign was read.
        (P::ByteArray(v), P::Integer(x)) => v[element] = u8::try_from(*x).unwrap_or(u8::MAX),
        (P::DoubleArray(v), P::Double(x)) => v[element] = *x,
        (P::StringArray(v), P::String(x)) => v[element].clone_from(x),
        _ => {}
    }
}

fn put_numbers(
    place: &Place,
    numbers: &[f64],
    apply: Apply,
    parameters: &Parameters,
    changes: &mut Changes,
) {
    let combine = |now: f64, drawn: f64| match apply {
        Apply::Set => drawn,
        Apply::Add => now + drawn,
        Apply::Scale => now * drawn,
    };
    // Integers are below 2^53.
    let whole = |now: i64, drawn: f64| combine(now as f64, drawn) as i64;
    match (current(place, parameters, changes), place.element) {
        (ParameterValue::Double(x), _) => *x = combine(*x, numbers[0]),
        (ParameterValue::Integer(i), _) => *i = whole(*i, numbers[0]),
        (ParameterValue::DoubleArray(v), Some(element)) => v[element] = combine(v[element], numbers[0]),
        (ParameterValue::IntegerArray(v), Some(element)) => v[element] = whole(v[element], numbers[0]),
        (ParameterValue::DoubleArray(v), None) => {
            // Numbers that are added to an empty list are added to zeros.
            v.resize(numbers.len(), 0.0);
            v.iter_mut().zip(numbers).for_each(|(x, n)| *x = combine(*x, *n));
        }
        (ParameterValue::IntegerArray(v), None) => {
            v.resize(numbers.len(), 0);
            v.iter_mut().zip(numbers).for_each(|(i, n)| *i = whole(*i, *n));
        }
        _ => {}
    }
}
